//! The point the grasp should be near.

use crate::Point;
use serde::{Deserialize, Serialize};

/// Centre of the part to hold, with the region around it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TaskKeyPoint {
    /// The point; the component-wise median of the part's surface points, so that a hole does not move it.
    pub point_in_base: Point,
    /// Surface points of the part seen by the cameras.
    #[serde(skip)]
    pub part_points_in_base: Vec<Point>,
    /// How many masked pixels had a depth, over all views.
    pub n_pixels: usize,
}

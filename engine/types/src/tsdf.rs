//! The object as a truncated signed distance function.

use crate::{Point, Pose};

/// Voxels along one side, 40 in the paper.
pub const EDGE: usize = 40;
/// Side of the cube. The parent method of the paper's network uses the same (0.30 m, 7.5 mm voxels).
pub const CUBE_M: f64 = 0.30;
/// Side of one voxel.
pub const VOXEL_M: f64 = CUBE_M / EDGE as f64;
/// Distances are cut here: four voxels.
pub const TRUNCATION_M: f64 = 4.0 * VOXEL_M;

/// A `1 x 40^3` TSDF of one object, `V` of the paper.
///
/// | field | shape | unit | frame |
/// |---|---|---|---|
/// | `distances` | `EDGE^3`, x fastest then y then z | truncations in [-1, 1], positive in free space | grid |
/// | `weights` | `EDGE^3` | number of fused views; 0 = unobserved, its distance is 1 | grid |
/// | `base_from_grid` | SE(3) | m | voxel (i, j, k) is centred at `VOXEL_M * (i + 0.5, j + 0.5, k + 0.5)` |
#[derive(Clone, Debug, PartialEq)]
pub struct Tsdf {
    /// Signed distances.
    pub distances: Vec<f32>,
    /// Observation counts.
    pub weights: Vec<f32>,
    /// Pose of the grid's corner.
    pub base_from_grid: Pose,
}

impl Tsdf {
    /// An unobserved grid whose cube is centred on `centre_in_base` with axes along the base frame.
    #[must_use]
    pub fn unobserved(centre_in_base: &Point) -> Self {
        let corner = centre_in_base.coords - nalgebra::Vector3::repeat(CUBE_M / 2.0);
        Self {
            distances: vec![1.0; EDGE * EDGE * EDGE],
            weights: vec![0.0; EDGE * EDGE * EDGE],
            base_from_grid: Pose::translation(corner.x, corner.y, corner.z),
        }
    }

    /// Position of voxel (i, j, k) in the arrays.
    #[must_use]
    pub fn index(i: usize, j: usize, k: usize) -> usize {
        i + EDGE * (j + EDGE * k)
    }

    /// Centre of voxel (i, j, k).
    #[must_use]
    pub fn centre_in_base(&self, i: usize, j: usize, k: usize) -> Point {
        self.base_from_grid * (Point::new(i as f64 + 0.5, j as f64 + 0.5, k as f64 + 0.5) * VOXEL_M)
    }
}

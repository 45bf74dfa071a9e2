//! Surface points of a TSDF with normals, at the zero crossings between neighbouring observed voxels.

use crate::shape::Sample;
use sfg_types::tsdf::EDGE;
use sfg_types::{Point, Tsdf, Vector};

/// A surface sample and whether it belongs to the part to hold.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PartSample {
    /// Point and normal, base frame.
    pub sample: Sample,
    /// One of its two voxels is in the affordance region.
    pub is_on_part: bool,
}

/// Samples above `table_height_m + margin_m`, in voxel order. A crossing into unobserved space is no surface.
///
/// # Panics
/// If `affordance_region` has not `EDGE^3` voxels.
#[must_use]
pub fn samples(tsdf: &Tsdf, affordance_region: &[u8], table_height_m: f64, margin_m: f64) -> Vec<PartSample> {
    assert_eq!(affordance_region.len(), EDGE * EDGE * EDGE, "one flag for each voxel");
    const STRIDES: [usize; 3] = [1, EDGE, EDGE * EDGE];
    let mut out = Vec::with_capacity(4096);
    for k in 0..EDGE {
        for j in 0..EDGE {
            for i in 0..EDGE {
                let at = Tsdf::index(i, j, k);
                let here = tsdf.distances[at];
                if tsdf.weights[at] <= 0.0 || here.abs() >= 1.0 {
                    continue;
                }
                let from = [i, j, k];
                for axis in 0..3 {
                    if from[axis] + 1 >= EDGE {
                        continue;
                    }
                    let next = at + STRIDES[axis];
                    let there = tsdf.distances[next];
                    if tsdf.weights[next] <= 0.0 || there.abs() >= 1.0 || (here > 0.0) == (there > 0.0) {
                        continue;
                    }
                    let share = f64::from(here / (here - there));
                    let Some(slope) = gradient(tsdf, from, axis, share) else { continue };
                    let low = tsdf.centre_in_base(i, j, k);
                    let mut to = from;
                    to[axis] += 1;
                    let point: Point = low + (tsdf.centre_in_base(to[0], to[1], to[2]) - low) * share;
                    if point.z < table_height_m + margin_m {
                        continue;
                    }
                    out.push(PartSample {
                        sample: Sample { point, normal: tsdf.base_from_grid * slope },
                        is_on_part: affordance_region[at] != 0 || affordance_region[next] != 0,
                    });
                }
            }
        }
    }
    out
}

/// Unit gradient, grid frame, between a voxel and its neighbour along `axis`.
fn gradient(tsdf: &Tsdf, from: [usize; 3], axis: usize, share: f64) -> Option<Vector> {
    let mut to = from;
    to[axis] += 1;
    let (a, b) = (voxel_gradient(tsdf, from), voxel_gradient(tsdf, to));
    (a * (1.0 - share) + b * share).try_normalize(1e-6)
}

/// Differences over the observed neighbours; one-sided where only one side was seen.
fn voxel_gradient(tsdf: &Tsdf, [i, j, k]: [usize; 3]) -> Vector {
    let value = |at: [usize; 3]| {
        let at = Tsdf::index(at[0], at[1], at[2]);
        (tsdf.weights[at] > 0.0).then(|| f64::from(tsdf.distances[at]))
    };
    let here = value([i, j, k]).unwrap_or(0.0);
    let mut slope = Vector::zeros();
    for axis in 0..3 {
        let at = [i, j, k];
        let below = at[axis].checked_sub(1).and_then(|x| value(std::array::from_fn(|d| if d == axis { x } else { at[d] })));
        let above =
            (at[axis] + 1 < EDGE).then(|| value(std::array::from_fn(|d| if d == axis { at[d] + 1 } else { at[d] }))).flatten();
        slope[axis] = match (below, above) {
            (Some(low), Some(high)) => 0.5 * (high - low),
            (Some(low), None) => here - low,
            (None, Some(high)) => high - here,
            (None, None) => 0.0,
        };
    }
    slope
}

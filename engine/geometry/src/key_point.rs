//! Masks and depth to the task key point, and the part's region in the grid.

use crate::GeometryError;
use crate::cloud::points_in_base;
use sfg_types::tsdf::{EDGE, VOXEL_M};
use sfg_types::{AffordanceMask, Point, RgbdImage, TaskKeyPoint, Tsdf};

/// Points further from the median than this many robust deviations are dropped. Half of a handle lies within one deviation, so
/// only pixels off the part (flying pixels at its edge, the table through its hole) are that far.
const TRIM_DEVIATIONS: f64 = 3.5;
/// Parts smaller than this are not trimmed below it: depth noise alone makes that much.
const TRIM_AT_LEAST_M: f64 = 0.02;

/// The 3D point a grasp should be near: the middle of the masked surface over all views.
///
/// Every masked pixel with a return becomes a point; the result is the component-wise median, taken again after points far from
/// it are dropped. A median over points in space neither falls through a hole of the part nor follows flying pixels.
///
/// | name | shape | unit | frame |
/// |---|---|---|---|
/// | `masks[i].pixels` | `height * width`, row-major | - | image of `views[i]` |
/// | `views[i].depth_m` | same grid | m | camera, +Z forward |
/// | result | point, part points, pixel count | m | base |
///
/// # Errors
/// [`GeometryError::EmptyMask`] when no mask selects anything, [`GeometryError::NoDepth`] when no selected pixel has a return.
/// Both are ordinary outcomes.
///
/// # Panics
/// If masks and views differ in number or size; both come from one observation.
///
/// # Source
/// SayFuncGrasp, section IV-D. Differs: the paper reads the depth at the mask's centre pixel only.
pub fn task_key_point(masks: &[AffordanceMask], views: &[RgbdImage]) -> Result<TaskKeyPoint, GeometryError> {
    assert_eq!(masks.len(), views.len(), "one mask a view");
    let n_masked: usize = masks.iter().map(AffordanceMask::n_selected).sum();
    if n_masked == 0 {
        return Err(GeometryError::EmptyMask { n_views: views.len() });
    }
    let points: Vec<Point> = masks.iter().zip(views).flat_map(|(mask, view)| points_in_base(view, Some(&mask.pixels))).collect();
    if points.is_empty() {
        return Err(GeometryError::NoDepth { n_masked });
    }
    let n_pixels = points.len();
    let first = median_point(&points);
    let mut distances: Vec<f64> = points.iter().map(|p| (p - first).norm()).collect();
    let limit = (TRIM_DEVIATIONS * median(&mut distances)).max(TRIM_AT_LEAST_M);
    let kept: Vec<Point> = points.into_iter().filter(|p| (p - first).norm() <= limit).collect();
    Ok(TaskKeyPoint { point_in_base: median_point(&kept), part_points_in_base: kept, n_pixels })
}

/// `EDGE^3` voxels in the order of [`Tsdf::index`]: 1 on both sides of the observed surface within about a voxel of a part point.
#[must_use]
pub fn affordance_region(tsdf: &Tsdf, part_points_in_base: &[Point]) -> Vec<u8> {
    let mut near = vec![false; EDGE * EDGE * EDGE];
    for point in part_points_in_base {
        let p = tsdf.base_from_grid.inverse_transform_point(point) / VOXEL_M;
        // All voxel centres within one voxel along each axis.
        let range = |x: f64| {
            let low = (x - 1.5).ceil().clamp(0.0, EDGE as f64) as usize;
            let high = (x + 0.5).floor().clamp(-1.0, EDGE as f64 - 1.0);
            low..(high + 1.0) as usize
        };
        for k in range(p.z) {
            for j in range(p.y) {
                for i in range(p.x) {
                    near[Tsdf::index(i, j, k)] = true;
                }
            }
        }
    }
    let mut region = vec![0; near.len()];
    for k in 0..EDGE {
        for j in 0..EDGE {
            for i in 0..EDGE {
                let here = Tsdf::index(i, j, k);
                if near[here] && meets_surface(tsdf, [i, j, k]) {
                    region[here] = 1;
                }
            }
        }
    }
    region
}

fn meets_surface(tsdf: &Tsdf, voxel: [usize; 3]) -> bool {
    let here = Tsdf::index(voxel[0], voxel[1], voxel[2]);
    let differs = |other: usize| tsdf.weights[other] > 0.0 && (tsdf.distances[other] < 0.0) != (tsdf.distances[here] < 0.0);
    tsdf.weights[here] > 0.0
        && [1, EDGE, EDGE * EDGE].into_iter().enumerate().any(|(axis, stride)| {
            (voxel[axis] > 0 && differs(here - stride)) || (voxel[axis] + 1 < EDGE && differs(here + stride))
        })
}

fn median_point(points: &[Point]) -> Point {
    let axis = |axis: usize| median(&mut points.iter().map(|p| p[axis]).collect::<Vec<_>>());
    Point::new(axis(0), axis(1), axis(2))
}

/// The middle value; of two middle ones the upper.
fn median(values: &mut [f64]) -> f64 {
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "tests fail by panicking")]
    use super::*;
    use sfg_types::{CameraIntrinsics, Pose, Vector};

    /// A view along +Z whose pixel (column, row) sees `depths[row * 3 + column]`, one centimetre between pixels at 1 m.
    fn view(depths: &[f32]) -> RgbdImage {
        let (width, height) = (3, depths.len() / 3);
        let intrinsics = CameraIntrinsics { width, height, fx: 100.0, fy: 100.0, cx: 1.0, cy: 1.0 };
        RgbdImage {
            camera: "test".to_owned(),
            intrinsics,
            base_from_camera: Pose::identity(),
            rgb: vec![0; depths.len() * 3],
            depth_m: depths.to_vec(),
        }
    }

    fn mask(text: &str) -> AffordanceMask {
        let pixels: Vec<u8> = text.chars().filter(|c| !c.is_whitespace()).map(|c| u8::from(c == '#')).collect();
        AffordanceMask { camera: "test".to_owned(), width: 3, height: pixels.len() / 3, pixels }
    }

    #[track_caller]
    fn check(mask_text: &str, depths: &[f32], expected: [f64; 3]) {
        let found = task_key_point(&[mask(mask_text)], &[view(depths)]).unwrap();
        assert!((found.point_in_base - Point::from(expected)).norm() < 1e-6, "{:?}", found.point_in_base);
    }

    #[test]
    fn the_key_point_is_the_middle_of_the_part() {
        check("### ### ###", &[1.0; 9], [0.0, 0.0, 1.0]);
        check("### #.# ###", &[1.0, 1.0, 1.0, 1.0, 2.0, 1.0, 1.0, 1.0, 1.0], [0.0, 0.0, 1.0]);
        // The hole belongs to the mask: the table behind it does not count.
        check("### ### ###", &[1.0, 1.0, 1.0, 1.0, 2.0, 1.0, 1.0, 1.0, 1.0], [0.0, 0.0, 1.0]);
        // A flying pixel and a pixel without return.
        check("### ### ###", &[1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.6, 0.0], [0.0, 0.0, 1.0]);
    }

    #[test]
    fn nothing_selected_and_no_return_are_told_apart() {
        let empty = task_key_point(&[mask("... ... ...")], &[view(&[1.0; 9])]).unwrap_err();
        assert_eq!(empty.to_string(), "the affordance masks select no pixel in any of 1 views");
        let blind = task_key_point(&[mask("### ... ...")], &[view(&[0.0; 9])]).unwrap_err();
        assert_eq!(blind.to_string(), "none of the 3 masked pixels has a depth");
    }

    #[test]
    fn the_region_is_the_surface_near_the_part_points() {
        let mut tsdf = Tsdf::unobserved(&Point::origin());
        for k in 0..EDGE {
            for j in 0..EDGE {
                for i in 0..EDGE {
                    let idx = Tsdf::index(i, j, k);
                    tsdf.distances[idx] = (tsdf.centre_in_base(i, j, k).z / 0.03).clamp(-1.0, 1.0) as f32;
                    tsdf.weights[idx] = 1.0;
                }
            }
        }
        let region = affordance_region(&tsdf, &[Point::new(0.05, 0.0, 0.0)]);
        let n_marked = region.iter().filter(|&&v| v == 1).count();
        assert!((8..=18).contains(&n_marked), "{n_marked} voxels of a plane near one point");
        for (idx, _) in region.iter().enumerate().filter(|(_, v)| **v == 1) {
            let centre = tsdf.centre_in_base(idx % EDGE, idx / EDGE % EDGE, idx / (EDGE * EDGE));
            assert!((centre - Point::new(0.05, 0.0, 0.0)).amax() <= VOXEL_M + 1e-9, "{centre:?}");
        }
        assert!(affordance_region(&tsdf, &[Point::from(Vector::repeat(1.0))]).iter().all(|&v| v == 0));
    }
}

//! How much lies in an open vessel, as the cameras see it from above.

use crate::post_grasp::pour_path::PourTarget;
use serde::{Deserialize, Serialize};
use sfg_types::{Observation, Point};

/// Side of a cell of the height map: about two pixels at the working distance.
const CELL_M: f64 = 0.004;
/// Only the middle of the opening is measured: content gathers there, and on the steep wall a millimetre sideways reads as
/// a millimetre of fill.
const INNER_SHARE: f64 = 0.6;
/// Content may be heaped this far above the rim; what is higher is the vessel that pours or the hand.
const HEAP_M: f64 = 0.012;
/// Fewest cells seen in both maps for a judgement.
const MIN_CELLS: usize = 40;

/// Height of the visible surface inside a vessel's opening, on a square grid about its centre.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct HeightMap {
    n_cells: usize,
    /// Median height of each cell in the base frame, metres; nothing where nothing was seen.
    heights_m: Vec<Option<f64>>,
}

/// The surface inside `target` as all views together see it.
#[must_use]
pub fn surface_inside(observation: &Observation, target: &PourTarget, table_height_m: f64) -> HeightMap {
    let radius_m = INNER_SHARE * target.rim_radius_m;
    let n_cells = (2.0 * radius_m / CELL_M).ceil() as usize;
    let mut samples: Vec<Vec<f64>> = vec![Vec::new(); n_cells * n_cells];
    for view in &observation.views {
        let (width, height) = (view.intrinsics.width, view.intrinsics.height);
        let camera_from_base = view.base_from_camera.inverse();
        let Some((columns, rows)) = pixel_window(&camera_from_base, view, target) else { continue };
        for row in rows.0.max(0.0) as usize..(rows.1.max(0.0) as usize).min(height) {
            for column in columns.0.max(0.0) as usize..(columns.1.max(0.0) as usize).min(width) {
                let depth_m = f64::from(view.depth_m[row * width + column]);
                if depth_m.is_nan() || depth_m <= 0.0 {
                    continue;
                }
                let point: Point = view.base_from_camera * view.intrinsics.deproject(column as f64, row as f64, depth_m);
                let (x, y) = (point.x - target.rim_centre_in_base.x, point.y - target.rim_centre_in_base.y);
                let too_high = point.z > target.rim_centre_in_base.z + HEAP_M;
                if x.hypot(y) > radius_m || too_high || point.z < table_height_m - HEAP_M {
                    continue;
                }
                let (i, j) = (((x + radius_m) / CELL_M) as usize, ((y + radius_m) / CELL_M) as usize);
                if i < n_cells && j < n_cells {
                    samples[i + n_cells * j].push(point.z);
                }
            }
        }
    }
    let heights_m = samples
        .into_iter()
        .map(|mut cell| {
            cell.sort_by(f64::total_cmp);
            cell.get(cell.len() / 2).copied()
        })
        .collect();
    HeightMap { n_cells, heights_m }
}

/// Pixels that can see the opening, as (columns, rows) ranges.
fn pixel_window(
    camera_from_base: &sfg_types::Pose,
    view: &sfg_types::RgbdImage,
    target: &PourTarget,
) -> Option<((f64, f64), (f64, f64))> {
    let centre = view.intrinsics.project(&(camera_from_base * target.rim_centre_in_base))?;
    let depth_m = (camera_from_base * target.rim_centre_in_base).z;
    // The content lies below the rim, so the window reaches a good way further than the opening.
    let reach = 2.0 * target.rim_radius_m / depth_m * view.intrinsics.fx.max(view.intrinsics.fy);
    Some(((centre.x - reach, centre.x + reach), (centre.y - reach, centre.y + reach)))
}

/// Volume that came into the vessel between two maps, millilitres; `None` when too little of it was seen.
///
/// Cells seen in both maps stand for all: the mean rise times the area of the opening.
#[must_use]
pub fn poured_ml(before: &HeightMap, after: &HeightMap, target: &PourTarget) -> Option<f64> {
    if before.n_cells != after.n_cells {
        return None;
    }
    let rises: Vec<f64> =
        before.heights_m.iter().zip(&after.heights_m).filter_map(|(before, after)| Some((*after)? - (*before)?)).collect();
    if rises.len() < MIN_CELLS {
        return None;
    }
    let mean_m = rises.iter().sum::<f64>() / rises.len() as f64;
    let radius_m = INNER_SHARE * target.rim_radius_m;
    Some(mean_m * std::f64::consts::PI * radius_m * radius_m * 1e6)
}

#[cfg(test)]
mod tests {
    #![expect(clippy::unwrap_used, reason = "tests fail by panicking")]
    use super::*;
    use nalgebra::UnitQuaternion;
    use sfg_types::{CameraIntrinsics, Pose, RgbdImage};

    /// A camera straight above the target that sees a flat surface at `height_m`.
    fn flat(height_m: f64) -> Observation {
        let intrinsics = CameraIntrinsics { width: 160, height: 120, fx: 200.0, fy: 200.0, cx: 80.0, cy: 60.0 };
        let down = UnitQuaternion::from_axis_angle(&nalgebra::Vector3::x_axis(), std::f64::consts::PI);
        let base_from_camera = Pose::from_parts(nalgebra::Translation3::new(0.8, 0.0, 1.5), down);
        let depth_m = vec![(1.5 - height_m) as f32; 160 * 120];
        let view = RgbdImage { camera: "top".into(), intrinsics, base_from_camera, rgb: vec![0; 3 * 160 * 120], depth_m };
        Observation { views: vec![view], stamp_secs: 0.0 }
    }

    const BOWL: PourTarget = PourTarget { rim_centre_in_base: Point::new(0.8, 0.0, 0.81), rim_radius_m: 0.08 };

    #[test]
    fn a_risen_surface_gives_its_volume() {
        let (before, after) = (surface_inside(&flat(0.76), &BOWL, 0.75), surface_inside(&flat(0.77), &BOWL, 0.75));
        let expected_ml = std::f64::consts::PI * (INNER_SHARE * 0.08).powi(2) * 0.01 * 1e6;
        let measured_ml = poured_ml(&before, &after, &BOWL).unwrap();
        assert!((measured_ml - expected_ml).abs() < 0.02 * expected_ml, "{measured_ml} {expected_ml}");
        assert!(poured_ml(&before, &before, &BOWL).unwrap().abs() < 1e-9);
    }

    #[test]
    fn an_occluded_vessel_is_not_judged() {
        let hidden = surface_inside(&flat(1.0), &BOWL, 0.75);
        assert_eq!(poured_ml(&surface_inside(&flat(0.76), &BOWL, 0.75), &hidden, &BOWL), None);
    }
}

//! Depth images to points.

use sfg_types::{Point, RgbdImage};

/// The surface points seen by the selected pixels of a view, base frame, in pixel order.
///
/// `selected` is `height * width`, row-major, 0 = leave out; `None` selects all. Pixels without a return give no point.
///
/// # Panics
/// If `selected` and the depth differ in length; both come from one camera frame.
#[must_use]
pub fn points_in_base(view: &RgbdImage, selected: Option<&[u8]>) -> Vec<Point> {
    if let Some(mask) = selected {
        assert_eq!(mask.len(), view.depth_m.len(), "mask and depth belong to one image");
    }
    let width = view.intrinsics.width;
    view.depth_m
        .iter()
        .enumerate()
        .filter(|&(idx, &depth)| depth > 0.0 && selected.is_none_or(|mask| mask[idx] != 0))
        .map(|(idx, &depth)| pixel_in_base(view, idx % width, idx / width, f64::from(depth)))
        .collect()
}

/// The base-frame point that a pixel sees at a depth in metres along the camera's +Z.
#[must_use]
pub fn pixel_in_base(view: &RgbdImage, column: usize, row: usize, depth_m: f64) -> Point {
    view.base_from_camera * view.intrinsics.deproject(column as f64, row as f64, depth_m)
}

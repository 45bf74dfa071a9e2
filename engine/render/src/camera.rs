//! Camera constants and placement.

use nalgebra::{Rotation3, UnitQuaternion};
use sfg_types::{CameraIntrinsics, Point, Pose, Vector};

/// Colour-aligned depth of an Intel RealSense D435i at 640 x 480.
///
/// Assumption: the 69.4 degree horizontal view of the colour sensor (Intel D400 series data sheet) over the full width, so
/// `fx = 320 / tan(34.7 deg) = 462`, square pixels, centred, undistorted. A real unit that crops 16:9 to 4:3 has about 615.
pub const D435I: CameraIntrinsics = CameraIntrinsics { width: 640, height: 480, fx: 462.1, fy: 462.1, cx: 319.5, cy: 239.5 };

/// Intrinsics of a picture of any size with the given horizontal view.
#[must_use]
pub fn intrinsics(width: usize, height: usize, horizontal_fov_rad: f64) -> CameraIntrinsics {
    let focal = width as f64 / 2.0 / (horizontal_fov_rad / 2.0).tan();
    let centre = |n: usize| (n as f64 - 1.0) / 2.0;
    CameraIntrinsics { width, height, fx: focal, fy: focal, cx: centre(width), cy: centre(height) }
}

/// Camera pose at `eye_in_base` looking at `target_in_base`, image upright; looking straight up or down, +X of the base is up.
#[must_use]
pub fn look_at(eye_in_base: &Point, target_in_base: &Point) -> Pose {
    let forward = (target_in_base - eye_in_base).try_normalize(1e-9).unwrap_or_else(Vector::x);
    let down = (-Vector::z() + forward * forward.z).try_normalize(1e-6).unwrap_or_else(|| -Vector::x());
    let right = down.cross(&forward);
    let rotation = Rotation3::from_matrix_unchecked(nalgebra::Matrix3::from_columns(&[right, down, forward]));
    Pose::from_parts(eye_in_base.coords.into(), UnitQuaternion::from_rotation_matrix(&rotation))
}

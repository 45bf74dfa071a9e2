//! What the cameras saw.

use crate::Pose;
use nalgebra::{Point2, Point3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Pinhole intrinsics in pixels; pixel centres lie at integer coordinates.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct CameraIntrinsics {
    /// Image width in pixels.
    pub width: usize,
    /// Image height in pixels.
    pub height: usize,
    /// Focal length along image x, pixels.
    pub fx: f64,
    /// Focal length along image y, pixels.
    pub fy: f64,
    /// Principal point, image x.
    pub cx: f64,
    /// Principal point, image y.
    pub cy: f64,
}

impl CameraIntrinsics {
    /// The camera-frame point seen at pixel (`column`, `row`) with depth `depth_m` along +Z.
    #[must_use]
    pub fn deproject(&self, column: f64, row: f64, depth_m: f64) -> Point3<f64> {
        Point3::new((column - self.cx) / self.fx * depth_m, (row - self.cy) / self.fy * depth_m, depth_m)
    }

    /// The pixel (column, row) that sees `point_in_camera`; `None` behind the camera.
    #[must_use]
    pub fn project(&self, point_in_camera: &Point3<f64>) -> Option<Point2<f64>> {
        (point_in_camera.z > 1e-9).then(|| {
            Point2::new(
                self.fx * point_in_camera.x / point_in_camera.z + self.cx,
                self.fy * point_in_camera.y / point_in_camera.z + self.cy,
            )
        })
    }
}

/// One colour image with its aligned depth.
///
/// | field | shape | unit | frame |
/// |---|---|---|---|
/// | `rgb` | `height * width * 3`, row-major | 0-255 | image |
/// | `depth_m` | `height * width`, row-major; 0 = no return | m along +Z | camera |
#[derive(Clone, Debug, PartialEq)]
pub struct RgbdImage {
    /// Name of the camera, for example `right`.
    pub camera: String,
    /// Calibration.
    pub intrinsics: CameraIntrinsics,
    /// Calibrated pose of the camera.
    pub base_from_camera: Pose,
    /// Colours.
    pub rgb: Vec<u8>,
    /// Depths; 0 where the sensor returned nothing.
    pub depth_m: Vec<f32>,
}

/// The views of one moment, `[omega_r, omega_l]` of the paper (equation 1).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Observation {
    /// One image a camera, in the order of the robot description.
    pub views: Vec<RgbdImage>,
    /// Time of the exposure on the driver's clock.
    pub stamp_secs: f64,
}

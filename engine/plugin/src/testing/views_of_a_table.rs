//! Two exact RGB-D views of a grey table with coloured blocks, by casting a ray a pixel.

use super::scenes::TABLE_HEIGHT_M;
use nalgebra::{Matrix3, Rotation3, Vector3};
use sfg_types::{CameraIntrinsics, Observation, Point, Pose, RgbdImage, Vector};

/// An upright block on the table.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Block {
    /// Centre of its foot: x and y in the base frame, metres.
    pub at_m: [f64; 2],
    /// Extents along base x, y and z, metres.
    pub size_m: [f64; 3],
    /// Colour.
    pub rgb: [u8; 3],
}

impl Block {
    /// Centre of the block.
    #[must_use]
    pub fn centre_in_base(&self) -> Point {
        Point::new(self.at_m[0], self.at_m[1], TABLE_HEIGHT_M + self.size_m[2] / 2.0)
    }

    /// Where a ray enters the block, in multiples of `direction`.
    fn entry(&self, origin: &Point, direction: &Vector) -> Option<f64> {
        let (mut near, mut far) = (0.0_f64, f64::INFINITY);
        for axis in 0..3 {
            let offset = self.centre_in_base()[axis] - origin[axis];
            let half = self.size_m[axis] / 2.0 * direction[axis].signum();
            near = near.max((offset - half) / direction[axis]);
            far = far.min((offset + half) / direction[axis]);
        }
        (near < far).then_some(near)
    }
}

/// The views of `blocks` on a table 1.0 m deep and 1.6 m wide, from two cameras above the shoulders (640 x 480). The floor around
/// the table is out of range and has no depth.
#[must_use]
pub fn table_observation(blocks: &[Block]) -> Observation {
    let views = [("right", -0.22), ("left", 0.22)].map(|(camera, y)| view(camera, &Point::new(0.05, y, 1.45), blocks));
    Observation { views: views.into(), stamp_secs: 0.0 }
}

fn view(camera: &str, eye: &Point, blocks: &[Block]) -> RgbdImage {
    let intrinsics = CameraIntrinsics { width: 640, height: 480, fx: 615.0, fy: 615.0, cx: 319.5, cy: 239.5 };
    let ahead = (Point::new(0.65, 0.0, TABLE_HEIGHT_M) - eye).normalize();
    let right = ahead.cross(&Vector3::z()).normalize();
    let axes = Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[right, ahead.cross(&right), ahead]));
    let base_from_camera = Pose::from_parts(eye.coords.into(), axes.into());
    let n_pixels = intrinsics.width * intrinsics.height;
    let (mut rgb, mut depth_m) = (Vec::with_capacity(3 * n_pixels), Vec::with_capacity(n_pixels));
    for pixel in 0..n_pixels {
        let (column, row) = ((pixel % intrinsics.width) as f64, (pixel / intrinsics.width) as f64);
        // Its z is 1, so multiples of it are depths.
        let direction = base_from_camera * intrinsics.deproject(column, row, 1.0).coords;
        let table = (TABLE_HEIGHT_M - eye.z) / direction.z;
        let on_table = eye + direction * table;
        let mut nearest =
            (table > 0.0 && (on_table.x - 0.7).abs() < 0.5 && on_table.y.abs() < 0.8).then_some((table, [140, 140, 140]));
        for block in blocks {
            if let Some(depth) = block.entry(eye, &direction)
                && nearest.is_none_or(|(best, _)| depth < best)
            {
                nearest = Some((depth, block.rgb));
            }
        }
        let (depth, colour) = nearest.unwrap_or((0.0, [60, 60, 60]));
        rgb.extend(colour);
        depth_m.push(depth as f32);
    }
    RgbdImage { camera: camera.to_owned(), intrinsics, base_from_camera, rgb, depth_m }
}

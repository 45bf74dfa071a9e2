//! Two depth images become one coloured cloud in the base frame.

use nalgebra::{Point3, Vector3};
use sfg_plugin::SelfSphere;
use sfg_types::{Observation, RgbdImage};

/// Returns beyond this are dropped: a D435i is no longer accurate there and the arm does not reach so far.
const MAX_DEPTH_M: f32 = 3.0;

/// One pixel with a return.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct CloudPoint {
    /// Position, base frame, metres.
    pub(crate) position: Point3<f32>,
    /// Colour, 0-255.
    pub(crate) rgb: [u8; 3],
}

/// Calls `visit(pixel index, position in base)` for every pixel of `view` with a usable depth.
pub(crate) fn for_each_return(view: &RgbdImage, mut visit: impl FnMut(usize, Point3<f32>)) {
    let k = &view.intrinsics;
    let rotation = view.base_from_camera.rotation.to_rotation_matrix();
    let rotation = rotation.matrix().map(|value| value as f32);
    let origin: Vector3<f32> = view.base_from_camera.translation.vector.map(|value| value as f32);
    let (x_axis, y_axis, z_axis) = (rotation.column(0), rotation.column(1), rotation.column(2));
    for row in 0..k.height {
        let from_row = y_axis * ((row as f64 - k.cy) / k.fy) as f32 + z_axis;
        let depths = view.depth_m.iter().skip(row * k.width).take(k.width);
        for (column, &depth) in depths.enumerate() {
            // NaN fails the comparison, so it is dropped with zero and infinity.
            if !(depth > 0.0 && depth < MAX_DEPTH_M) {
                continue;
            }
            let ray = x_axis * ((column as f64 - k.cx) / k.fx) as f32 + from_row;
            visit(row * k.width + column, Point3::from(origin + ray * depth));
        }
    }
}

/// All returns of all views.
pub(crate) fn cloud(observation: &Observation) -> Vec<CloudPoint> {
    let mut points = Vec::with_capacity(observation.views.iter().map(|view| view.depth_m.len()).sum());
    for view in &observation.views {
        for_each_return(view, |pixel, position| {
            let rgb = view.rgb.get(3 * pixel..3 * pixel + 3).map_or([128; 3], |c| [c[0], c[1], c[2]]);
            points.push(CloudPoint { position, rgb });
        });
    }
    points
}

/// The robot's own body, ready for many tests.
#[derive(Clone, Debug)]
pub(crate) struct RobotBody {
    balls: Vec<(Point3<f32>, f32)>,
    low: Point3<f32>,
    high: Point3<f32>,
}

impl RobotBody {
    pub(crate) fn new(robot: &[SelfSphere]) -> Self {
        let balls: Vec<(Point3<f32>, f32)> =
            robot.iter().map(|ball| (ball.centre_in_base.cast::<f32>(), ball.radius_m as f32)).collect();
        let margin = |radius: f32| Vector3::repeat(radius);
        let low = balls.iter().fold(Point3::from(Vector3::repeat(f32::MAX)), |low, (c, r)| low.inf(&(c - margin(*r))));
        let high = balls.iter().fold(Point3::from(Vector3::repeat(f32::MIN)), |high, (c, r)| high.sup(&(c + margin(*r))));
        Self { balls, low, high }
    }

    /// True when `position` lies in one of the balls.
    pub(crate) fn contains(&self, position: &Point3<f32>) -> bool {
        // Most points lie outside the box around the arm, which spares them a hundred distances.
        (0..3).all(|axis| position[axis] >= self.low[axis] && position[axis] <= self.high[axis])
            && self.balls.iter().any(|(centre, radius)| (position - centre).norm_squared() < radius * radius)
    }
}

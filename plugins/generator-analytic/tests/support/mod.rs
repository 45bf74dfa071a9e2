//! Synthetic scenes seen as the robot sees them: two cameras above the shoulders, so only the front and the top of a thing.
#![allow(dead_code, clippy::unwrap_used, reason = "shared by tests and the bench, which stop by panicking")]

use nalgebra::{Matrix3, Rotation3, UnitQuaternion};
use sfg_generator_analytic::AnalyticGenerator;
use sfg_geometry::{Oval, TsdfView, affordance_region, fuse_views, task_key_point};
use sfg_kinematics::description::load_hand_profile;
use sfg_plugin::{PluginContext, PoseGenerator, PoseRequest};
use sfg_types::{
    AffordanceMask, CameraIntrinsics, GraspType, HandProfile, HandSide, PalmPoseCandidate, Point, Pose, RgbdImage,
    SynergyCoordinates, TaskKeyPoint, Tsdf, Vector,
};
use std::path::{Path, PathBuf};

/// Height of the table.
pub(crate) const TABLE_M: f64 = 0.75;

/// A solid with a part to hold, both in the base frame.
pub(crate) struct Solid {
    /// Signed distance, metres.
    pub(crate) distance: Box<dyn Fn(&Point) -> f64>,
    /// Whether a surface point belongs to the part.
    pub(crate) is_part: Box<dyn Fn(&Point) -> bool>,
    /// Ball around everything.
    pub(crate) bounds: (Point, f64),
}

/// What the generator is given.
pub(crate) struct Seen {
    /// Fused grid.
    pub(crate) tsdf: Tsdf,
    /// Affordance region.
    pub(crate) region: Vec<u8>,
    /// Key point.
    pub(crate) key_point: TaskKeyPoint,
}

/// A capped cylinder between two points.
pub(crate) fn cylinder(from: Point, to: Point, radius_m: f64) -> Solid {
    let axis = (to - from).normalize();
    let half = 0.5 * (to - from).norm();
    let middle = nalgebra::center(&from, &to);
    Solid {
        distance: Box::new(move |p| {
            let d = p - middle;
            let along = d.dot(&axis);
            corner((d - axis * along).norm() - radius_m, along.abs() - half)
        }),
        is_part: Box::new(|_| true),
        bounds: (middle, half + radius_m + 0.01),
    }
}

/// An upright cylinder on the table.
pub(crate) fn standing(x: f64, y: f64, radius_m: f64, height_m: f64) -> Solid {
    cylinder(Point::new(x, y, TABLE_M), Point::new(x, y, TABLE_M + height_m), radius_m)
}

/// A standing bottle of oval cross-section (`half_m` along its yaw and across), whose shoulder ends in a round neck.
pub(crate) fn flat_bottle(x: f64, y: f64, yaw: f64, half_m: [f64; 2], height_m: f64) -> Solid {
    let oval = Oval::new(yaw, half_m[0] / half_m[1]);
    let radius_m = (half_m[0] * half_m[1]).sqrt();
    let (shoulder_m, neck_m) = (0.78 * height_m, 0.014);
    Solid {
        distance: Box::new(move |p| {
            let (offset, z) = (nalgebra::Vector2::new(p.x - x, p.y - y), p.z - TABLE_M);
            let body = corner(oval.distance_m(&offset, radius_m), (z - 0.5 * shoulder_m).abs() - 0.5 * shoulder_m);
            let neck = corner(offset.norm() - neck_m, (z - 0.5 * height_m).abs() - 0.5 * height_m);
            body.min(neck)
        }),
        is_part: Box::new(move |p| p.z < TABLE_M + shoulder_m),
        bounds: (Point::new(x, y, TABLE_M + 0.5 * height_m), half_m[0].hypot(0.5 * height_m) + 0.01),
    }
}

/// An upright box on the table.
pub(crate) fn cuboid(x: f64, y: f64, yaw: f64, size: [f64; 3]) -> Solid {
    let base_from_box =
        Pose::from_parts(Vector::new(x, y, TABLE_M + size[2] / 2.0).into(), UnitQuaternion::from_euler_angles(0.0, 0.0, yaw));
    let half = Vector::from(size) / 2.0;
    Solid {
        distance: Box::new(move |p| {
            let excess = base_from_box.inverse_transform_point(p).coords.abs() - half;
            excess.map(|e| e.max(0.0)).norm() + excess.max().min(0.0)
        }),
        is_part: Box::new(|_| true),
        bounds: (base_from_box * Point::origin(), half.norm() + 0.01),
    }
}

/// A ball on the table.
pub(crate) fn ball(x: f64, y: f64, radius_m: f64) -> Solid {
    let centre = Point::new(x, y, TABLE_M + radius_m);
    Solid {
        distance: Box::new(move |p| (p - centre).norm() - radius_m),
        is_part: Box::new(|_| true),
        bounds: (centre, radius_m + 0.01),
    }
}

/// A mug of radius 40 mm with a ring handle towards `yaw`; the handle is the part.
pub(crate) fn mug(x: f64, y: f64, yaw: f64) -> Solid {
    let body = standing(x, y, 0.04, 0.095);
    let out = Vector::new(yaw.cos(), yaw.sin(), 0.0);
    let centre = Point::new(x, y, TABLE_M + 0.05) + out * 0.045;
    let ring = move |p: &Point| {
        let d = p - centre;
        let side = d.dot(&Vector::z().cross(&out));
        let in_plane = (d.norm_squared() - side * side).max(0.0).sqrt();
        (in_plane - 0.03).hypot(side) - 0.006
    };
    let body_distance = body.distance;
    let axis = Point::new(x, y, 0.0);
    Solid {
        distance: Box::new(move |p| body_distance(p).min(ring(p))),
        is_part: Box::new(move |p| (p - axis).xy().norm() > 0.046),
        bounds: (Point::new(x, y, TABLE_M + 0.05), 0.14),
    }
}

/// The two views of a solid on the table, fused; `scale` divides the camera's 640 x 480 pixels.
pub(crate) fn observe(solid: &Solid, scale: usize) -> Seen {
    let mut views = Vec::new();
    let (mut object_masks, mut part_masks) = (Vec::new(), Vec::new());
    for (name, y) in [("left", 0.27), ("right", -0.27)] {
        let eye = Point::new(0.08, y, 1.45);
        let view = look_at(name, eye, Point::new(0.62, 0.0, 0.80), scale);
        let (view, object, part) = render(view, solid);
        object_masks.push(object);
        part_masks.push(part);
        views.push(view);
    }
    let key_point = task_key_point(&part_masks, &views).unwrap();
    let inputs: Vec<TsdfView<'_>> =
        views.iter().zip(&object_masks).map(|(image, mask)| TsdfView { image, object_mask: Some(mask) }).collect();
    let tsdf = fuse_views(&key_point.point_in_base, &inputs);
    let region = affordance_region(&tsdf, &key_point.part_points_in_base);
    Seen { tsdf, region, key_point }
}

/// The scenario folder of this repository.
pub(crate) fn scenarios_dir() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenarios")
}

/// The shipped hand.
pub(crate) fn softhand() -> HandProfile {
    load_hand_profile(&scenarios_dir().join("robots/softhand2.yaml")).unwrap()
}

/// A generator with the shipped hand.
pub(crate) fn generator(profile: &HandProfile, side: HandSide) -> AnalyticGenerator {
    let params = serde_json::json!({});
    let dir = scenarios_dir();
    let context = PluginContext { params: &params, scenarios_dir: &dir, hand: profile, hand_side: side, seed: 1 };
    AnalyticGenerator::new(&context).unwrap()
}

/// Candidates for a scene.
pub(crate) fn candidates(
    generator: &mut AnalyticGenerator,
    profile: &HandProfile,
    seen: &Seen,
    side: HandSide,
    kind: GraspType,
) -> Vec<PalmPoseCandidate> {
    let blank = PalmPoseCandidate {
        base_from_palm: Pose::identity(),
        hand_side: side,
        stability: 0.0,
        synergy: SynergyCoordinates::OPEN,
        terms: Vec::new(),
    };
    let mut out = vec![blank; 15];
    let request = PoseRequest {
        tsdf: &seen.tsdf,
        affordance_region: &seen.region,
        key_point: &seen.key_point,
        hand: profile,
        hand_side: side,
        grasp_type: kind,
        table_height_m: TABLE_M,
    };
    let n = generator.generate(&request, &mut out).unwrap();
    out.truncate(n);
    out
}

/// A term of a candidate by name.
#[track_caller]
pub(crate) fn term(candidate: &PalmPoseCandidate, name: &str) -> f64 {
    candidate.terms.iter().find(|t| t.name == name).unwrap().value
}

fn look_at(name: &str, eye: Point, target: Point, scale: usize) -> RgbdImage {
    let forward = (target - eye).normalize();
    let right = forward.cross(&Vector::z()).normalize();
    let down = forward.cross(&right);
    let rotation = Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[right, down, forward]));
    let (width, height) = (640 / scale, 480 / scale);
    let focal = 0.5 * width as f64 / (0.5 * 69.0_f64.to_radians()).tan();
    RgbdImage {
        camera: name.to_owned(),
        intrinsics: CameraIntrinsics {
            width,
            height,
            fx: focal,
            fy: focal,
            cx: 0.5 * (width as f64 - 1.0),
            cy: 0.5 * (height as f64 - 1.0),
        },
        base_from_camera: Pose::from_parts(eye.coords.into(), UnitQuaternion::from_rotation_matrix(&rotation)),
        rgb: Vec::new(),
        depth_m: vec![0.0; width * height],
    }
}

/// Depth, object mask and part mask by sphere tracing; the table is a plane.
fn render(mut view: RgbdImage, solid: &Solid) -> (RgbdImage, Vec<u8>, AffordanceMask) {
    let k = view.intrinsics;
    let mut object = vec![0; k.width * k.height];
    let mut part = AffordanceMask::empty(&view.camera, k.width, k.height);
    let eye = view.base_from_camera * Point::origin();
    for row in 0..k.height {
        for column in 0..k.width {
            let at = row * k.width + column;
            let through = view.base_from_camera * k.deproject(column as f64, row as f64, 1.0);
            let per_depth = through - eye;
            let step = per_depth.norm();
            let direction = per_depth / step;
            let table = if direction.z < -1e-6 { (TABLE_M - eye.z) / direction.z } else { f64::INFINITY };
            let mut reach = table;
            if let Some(hit) = trace(solid, &eye, &direction, table) {
                reach = hit;
                object[at] = 1;
                part.pixels[at] = u8::from((solid.is_part)(&(eye + direction * hit)));
            }
            view.depth_m[at] = if reach.is_finite() { (reach / step) as f32 } else { 0.0 };
        }
    }
    (view, object, part)
}

fn trace(solid: &Solid, eye: &Point, direction: &Vector, limit: f64) -> Option<f64> {
    let to_centre = solid.bounds.0 - eye;
    let nearest = to_centre.dot(direction);
    let miss = to_centre.norm_squared() - nearest * nearest;
    let half = (solid.bounds.1 * solid.bounds.1 - miss).max(-1.0);
    if half < 0.0 {
        return None;
    }
    let mut t = nearest - half.sqrt();
    let end = (nearest + half.sqrt()).min(limit);
    while t < end {
        let d = (solid.distance)(&(eye + direction * t));
        if d < 1e-4 {
            return Some(t);
        }
        t += d;
    }
    None
}

fn corner(a: f64, b: f64) -> f64 {
    if a > 0.0 && b > 0.0 { a.hypot(b) } else { a.max(b) }
}

//! A small ray marcher for tests: bodies of revolution, capsules and boxes on a table, seen by two noisy depth cameras.

#![allow(clippy::unwrap_used, reason = "tests fail by panicking")]

use nalgebra::{Point3, Rotation3, UnitQuaternion, Vector3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use sfg_types::{CameraIntrinsics, Observation, Pose, RgbdImage};

pub(crate) const TABLE_Z: f64 = 0.75;

/// A solid in its own frame, standing on z = 0.
#[derive(Clone, Debug)]
pub(crate) enum Solid {
    /// Closed outline (r, z), revolved about z.
    Lathe(Vec<[f64; 2]>),
    /// Segment with a radius.
    Capsule([f64; 3], [f64; 3], f64),
    /// Centre and half extents.
    Cuboid([f64; 3], [f64; 3]),
}

impl Solid {
    fn distance(&self, p: &Point3<f64>) -> f64 {
        match self {
            Self::Lathe(outline) => polygon_distance(outline, p.x.hypot(p.y), p.z),
            Self::Capsule(a, b, radius) => {
                let (a, b) = (Point3::from(*a), Point3::from(*b));
                let t = ((p - a).dot(&(b - a)) / (b - a).norm_squared()).clamp(0.0, 1.0);
                (p - (a + (b - a) * t)).norm() - radius
            }
            Self::Cuboid(centre, half) => {
                let q = [0, 1, 2].map(|i| (p[i] - centre[i]).abs() - half[i]);
                Vector3::from(q.map(|v| v.max(0.0))).norm() + q[0].max(q[1]).max(q[2]).min(0.0)
            }
        }
    }
}

fn polygon_distance(outline: &[[f64; 2]], r: f64, z: f64) -> f64 {
    let n = outline.len();
    let (mut best, mut sign) = (f64::MAX, 1.0);
    for i in 0..n {
        let (a, b) = (outline[i], outline[(i + 1) % n]);
        let (ex, ey, wx, wy) = (b[0] - a[0], b[1] - a[1], r - a[0], z - a[1]);
        let t = ((wx * ex + wy * ey) / (ex * ex + ey * ey)).clamp(0.0, 1.0);
        best = f64::min(best, (wx - ex * t).hypot(wy - ey * t));
        if (a[1] > z) != (b[1] > z) && r < (b[0] - a[0]) * (z - a[1]) / (b[1] - a[1]) + a[0] {
            sign = -sign;
        }
    }
    sign * best
}

/// A thing on the table.
#[derive(Clone, Debug)]
pub(crate) struct Body {
    pub(crate) name: &'static str,
    pub(crate) solids: Vec<Solid>,
    pub(crate) rgb: [u8; 3],
    /// x, y, yaw.
    pub(crate) at: [f64; 3],
}

impl Body {
    fn distance(&self, p: &Point3<f64>) -> f64 {
        let local = Rotation3::from_axis_angle(&Vector3::z_axis(), -self.at[2])
            * Vector3::new(p.x - self.at[0], p.y - self.at[1], p.z - TABLE_Z);
        self.solids.iter().map(|solid| solid.distance(&Point3::from(local))).fold(f64::MAX, f64::min)
    }
}

pub(crate) fn bottle(radius: f64, height: f64) -> Vec<Solid> {
    let neck = 0.42 * radius;
    vec![Solid::Lathe(vec![
        [0.0, 0.0],
        [radius, 0.0],
        [radius, 0.62 * height],
        [0.8 * radius, 0.70 * height],
        [neck, 0.80 * height],
        [neck, height],
        [0.0, height],
    ])]
}

pub(crate) fn vessel(foot: f64, rim: f64, height: f64, wall: f64) -> Vec<Solid> {
    vec![Solid::Lathe(vec![[0.0, 0.0], [foot, 0.0], [rim, height], [rim - wall, height], [foot - wall, wall], [0.0, wall]])]
}

pub(crate) fn mug(radius: f64, height: f64) -> Vec<Solid> {
    let mut solids = vessel(radius, radius, height, 0.004);
    let (near, far) = (radius - 0.002, radius + 0.032);
    let (low, high) = (0.22 * height, 0.80 * height);
    solids.push(Solid::Capsule([near, 0.0, low], [far, 0.0, low], 0.006));
    solids.push(Solid::Capsule([near, 0.0, high], [far, 0.0, high], 0.006));
    solids.push(Solid::Capsule([far, 0.0, low], [far, 0.0, high], 0.006));
    solids
}

pub(crate) fn can(radius: f64, height: f64) -> Vec<Solid> {
    vec![Solid::Lathe(vec![[0.0, 0.0], [radius, 0.0], [radius, height], [0.0, height]])]
}

pub(crate) fn cuboid(x: f64, y: f64, z: f64) -> Vec<Solid> {
    vec![Solid::Cuboid([0.0, 0.0, z / 2.0], [x / 2.0, y / 2.0, z / 2.0])]
}

pub(crate) fn sphere(radius: f64) -> Vec<Solid> {
    vec![Solid::Capsule([0.0, 0.0, radius], [0.0, 1e-6, radius], radius)]
}

pub(crate) fn hammer() -> Vec<Solid> {
    vec![Solid::Capsule([-0.15, 0.0, 0.016], [0.13, 0.0, 0.016], 0.014), Solid::Cuboid([0.14, 0.0, 0.016], [0.015, 0.055, 0.015])]
}

pub(crate) fn screwdriver() -> Vec<Solid> {
    vec![
        Solid::Capsule([-0.095, 0.0, 0.015], [-0.015, 0.0, 0.015], 0.015),
        Solid::Capsule([-0.015, 0.0, 0.015], [0.11, 0.0, 0.015], 0.004),
    ]
}

pub(crate) fn spatula() -> Vec<Solid> {
    vec![Solid::Capsule([-0.17, 0.0, 0.012], [0.06, 0.0, 0.012], 0.009), Solid::Cuboid([0.115, 0.0, 0.012], [0.055, 0.04, 0.003])]
}

/// A pan: shallow vessel with a straight handle.
pub(crate) fn pan() -> Vec<Solid> {
    let mut solids = vessel(0.10, 0.12, 0.05, 0.004);
    solids.push(Solid::Capsule([0.115, 0.0, 0.04], [0.29, 0.0, 0.045], 0.011));
    solids
}

/// How bad the depth is.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sensor {
    /// Standard deviation at 1 m; it grows with the square of the depth.
    pub(crate) sigma_at_1m: f64,
    /// Share of pixels without a return.
    pub(crate) dropout: f64,
}

pub(crate) const CLEAN: Sensor = Sensor { sigma_at_1m: 0.0, dropout: 0.0 };
pub(crate) const NOISY: Sensor = Sensor { sigma_at_1m: 0.0025, dropout: 0.02 };

/// Both views of `bodies` on a table (1.2 m x 1.4 m) above a floor.
pub(crate) fn observe(bodies: &[Body], sensor: Sensor, seed: u64) -> Observation {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let views = [("right", -0.20), ("left", 0.20)].map(|(name, y)| {
        let eye = Point3::new(0.10, y, 1.55);
        let forward = (Point3::new(0.65, 0.0, 0.78) - eye).normalize();
        let right = forward.cross(&Vector3::z()).normalize();
        let rotation =
            Rotation3::from_matrix_unchecked(nalgebra::Matrix3::from_columns(&[right, forward.cross(&right), forward]));
        let pose = Pose::from_parts(eye.coords.into(), UnitQuaternion::from_rotation_matrix(&rotation));
        let intrinsics = CameraIntrinsics { width: 640, height: 480, fx: 600.0, fy: 600.0, cx: 319.5, cy: 239.5 };
        view(name, pose, intrinsics, bodies, sensor, &mut rng)
    });
    Observation { views: views.into(), stamp_secs: 0.0 }
}

fn view(name: &str, pose: Pose, k: CameraIntrinsics, bodies: &[Body], sensor: Sensor, rng: &mut ChaCha8Rng) -> RgbdImage {
    let eye = Point3::from(pose.translation.vector);
    let forward = pose.rotation * Vector3::z();
    let mut rgb = Vec::with_capacity(k.width * k.height * 3);
    let mut depth_m = Vec::with_capacity(k.width * k.height);
    for row in 0..k.height {
        for column in 0..k.width {
            let ray = (pose.rotation * k.deproject(column as f64, row as f64, 1.0).coords).normalize();
            let (mut t, mut colour, mut normal) = ((TABLE_Z - eye.z) / ray.z, [150, 120, 90], Vector3::z());
            let hit = eye + ray * t;
            if ray.z >= 0.0 || !(0.2..1.4).contains(&hit.x) || hit.y.abs() > 0.7 {
                (t, colour) = (if ray.z < 0.0 { -eye.z / ray.z } else { 0.0 }, [90, 90, 90]);
            }
            for body in bodies {
                // Only rays that pass near the thing are marched.
                let centre = Point3::new(body.at[0], body.at[1], TABLE_Z + 0.1);
                let nearest = (centre - eye).dot(&ray);
                if (eye + ray * nearest - centre).norm() > 0.36 {
                    continue;
                }
                let mut s = nearest - 0.36;
                for _ in 0..80 {
                    let gap = body.distance(&(eye + ray * s));
                    s += gap.max(2e-4);
                    if gap < 2e-4 || s > nearest + 0.36 {
                        break;
                    }
                }
                if s < nearest + 0.36 && (t <= 0.0 || s < t) {
                    (t, colour) = (s, body.rgb);
                    let at = eye + ray * s;
                    let slope = |axis: Vector3<f64>| body.distance(&(at + axis * 1e-4)) - body.distance(&(at - axis * 1e-4));
                    normal = Vector3::new(slope(Vector3::x()), slope(Vector3::y()), slope(Vector3::z())).normalize();
                }
            }
            let light = 0.35 + 0.65 * normal.dot(&Vector3::new(-0.3, 0.2, 0.93).normalize()).max(0.0);
            rgb.extend(colour.map(|c| (f64::from(c) * light) as u8));
            let depth = t * ray.dot(&forward);
            let noise = sensor.sigma_at_1m * depth * depth * ((0..12).map(|_| rng.random::<f64>()).sum::<f64>() - 6.0);
            let lost = sensor.dropout > 0.0 && rng.random::<f64>() < sensor.dropout;
            depth_m.push(if lost || t <= 0.0 { 0.0 } else { (depth + noise) as f32 });
        }
    }
    RgbdImage { camera: name.to_owned(), intrinsics: k, base_from_camera: pose, rgb, depth_m }
}

//! Solids with an exact signed distance, in their own frame.

use super::profile::Profile;
use crate::mesh::{self, TriMesh};
use nalgebra::{Point3, Vector3};

/// Meridians of display meshes.
const N_AROUND: usize = 48;

#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Primitive {
    Capsule { half_height: f64, radius: f64 },
    Box { half: Vector3<f64>, rounding: f64 },
    Lathe(Profile),
    Torus { major: f64, minor: f64, half_arc: f64 },
    Sweep { points: Vec<Point3<f64>>, radius: f64 },
}

impl Primitive {
    /// Exact signed distance; inside a sweep, where its bars overlap, a lower bound of the depth.
    pub(crate) fn signed_distance(&self, p: &Point3<f64>) -> f64 {
        match self {
            Self::Capsule { half_height, radius } => {
                let z = p.z - p.z.clamp(-half_height, *half_height);
                (p.x * p.x + p.y * p.y + z * z).sqrt() - radius
            }
            Self::Box { half, rounding } => box_distance(p, &(half - Vector3::repeat(*rounding))) - rounding,
            Self::Lathe(profile) => profile.signed_distance(p.x.hypot(p.y), p.z),
            Self::Torus { major, minor, half_arc } => torus_distance(p, *major, *minor, *half_arc),
            Self::Sweep { points, radius } => {
                points.windows(2).map(|pair| segment_distance(p, &pair[0], &pair[1])).fold(f64::INFINITY, f64::min) - radius
            }
        }
    }

    /// A box that holds the solid.
    pub(crate) fn bounds(&self) -> (Point3<f64>, Point3<f64>) {
        let symmetric = |half: Vector3<f64>| (Point3::from(-half), Point3::from(half));
        match self {
            Self::Capsule { half_height, radius } => symmetric(Vector3::new(*radius, *radius, half_height + radius)),
            Self::Box { half, .. } => symmetric(*half),
            Self::Lathe(profile) => {
                let (r, low, high) = profile.extent();
                (Point3::new(-r, -r, low), Point3::new(r, r, high))
            }
            Self::Torus { major, minor, .. } => symmetric(Vector3::new(major + minor, major + minor, *minor)),
            Self::Sweep { points, radius } => {
                let (low, high) = points.iter().fold((points[0], points[0]), |(low, high), p| (low.inf(p), high.sup(p)));
                (low - Vector3::repeat(*radius), high + Vector3::repeat(*radius))
            }
        }
    }

    /// A closed mesh that looks like the solid.
    pub(crate) fn display_mesh(&self) -> TriMesh {
        match self {
            Self::Capsule { half_height, radius } => mesh::capsule(*half_height, *radius, N_AROUND),
            Self::Box { half, rounding } if *rounding < 5e-4 => mesh::cuboid(half),
            Self::Box { .. } => {
                let (low, high) = self.bounds();
                let step = ((high - low).max() / 40.0).max(5e-4);
                mesh::surface_of(&|p| self.signed_distance(p), &low, &high, step)
            }
            Self::Lathe(profile) => mesh::revolve(profile.outline(), N_AROUND),
            Self::Torus { major, minor, half_arc } => {
                let closed = *half_arc >= std::f64::consts::PI - 1e-9;
                let n = ((half_arc / std::f64::consts::PI * N_AROUND as f64) as usize).max(6);
                let points: Vec<_> = (0..=n)
                    .take(if closed { n } else { n + 1 })
                    .map(|i| {
                        let angle = half_arc * (2.0 * i as f64 / n as f64 - 1.0);
                        Point3::new(major * angle.cos(), major * angle.sin(), 0.0)
                    })
                    .collect();
                mesh::tube(&points, *minor, closed, N_AROUND / 2)
            }
            Self::Sweep { points, radius } => mesh::tube(points, *radius, false, N_AROUND / 2),
        }
    }
}

/// Distance of a point to a box centred on the origin, negative inside.
pub(crate) fn box_distance(p: &Point3<f64>, half: &Vector3<f64>) -> f64 {
    let q = p.coords.abs() - half;
    q.sup(&Vector3::zeros()).norm() + q.max().min(0.0)
}

/// Distance of a point to a cylinder along z centred on the origin, negative inside.
pub(crate) fn cylinder_distance(p: &Point3<f64>, half_height: f64, radius: f64) -> f64 {
    let (dr, dz) = (p.x.hypot(p.y) - radius, p.z.abs() - half_height);
    dr.max(0.0).hypot(dz.max(0.0)) + dr.max(dz).min(0.0)
}

/// Distance of a point to the segment from `a` to `b`.
pub(crate) fn segment_distance(p: &Point3<f64>, a: &Point3<f64>, b: &Point3<f64>) -> f64 {
    let (ab, ap) = (b - a, p - a);
    let t = (ap.dot(&ab) / ab.norm_squared().max(1e-18)).clamp(0.0, 1.0);
    (ap - ab * t).norm()
}

fn torus_distance(p: &Point3<f64>, major: f64, minor: f64, half_arc: f64) -> f64 {
    let angle = p.y.atan2(p.x);
    if angle.abs() <= half_arc {
        return (p.x.hypot(p.y) - major).hypot(p.z) - minor;
    }
    // Beyond the arc the nearer end ball counts.
    let end = Point3::new(major * half_arc.cos(), major * half_arc.sin() * p.y.signum(), 0.0);
    (p - end).norm() - minor
}

//! Collision pieces as native shapes.
//!
//! Walls that hold grains must not be hulls: in measured pours, balls leaked through hull walls (45-78 of 150) and never through
//! cuboids, cylinders and capsules. So a vessel is a ring of cuboid staves for each profile segment on a cylinder as floor.

use super::primitive::{Primitive, box_distance, cylinder_distance, segment_distance};
use super::profile::Profile;
use crate::mesh;
use nalgebra::{Matrix3, Point3, Rotation3, UnitQuaternion, Vector3};
use parry3d::query::PointQuery;
use sfg_types::Pose;
use std::f64::consts::{PI, TAU};

/// How far a flat or straight piece may leave the round surface before both sides share the error.
const MAX_SAGITTA_M: f64 = 0.8e-3;

/// A convex solid that physics engines know, in its own frame.
#[derive(Clone, Debug, PartialEq)]
pub enum Piece {
    /// A box, centred.
    Cuboid {
        /// Half lengths of the sides.
        half_extents_m: Vector3<f64>,
    },
    /// A cylinder along z, centred.
    Cylinder {
        /// Half the length.
        half_height_m: f64,
        /// Radius.
        radius_m: f64,
    },
    /// All points within the radius of a segment along z, centred.
    Capsule {
        /// Half the length of the segment.
        half_height_m: f64,
        /// Radius.
        radius_m: f64,
    },
    /// A ball, centred.
    Ball {
        /// Radius.
        radius_m: f64,
    },
    /// The convex hull of points.
    ConvexHull {
        /// The points; they need not all be corners.
        points: Vec<Point3<f64>>,
    },
}

/// A piece in its place.
#[derive(Clone, Debug, PartialEq)]
pub struct LabelledPiece {
    /// The solid.
    pub piece: Piece,
    /// Where it is.
    pub object_from_piece: Pose,
    /// Index into [`super::ObjectInstance::parts`].
    pub part_idx: usize,
    /// What it collides with.
    pub touches: Touches,
}

/// What a piece collides with. A scan that was bored has two sets of pieces: its convex groups, which fill the cavity and give the
/// outside its true shape, and round walls about the cavity.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Touches {
    /// All that there is.
    #[default]
    Everything,
    /// Hands, the table, other objects: all but grains.
    AllButGrains,
    /// Grains, and nothing else.
    GrainsOnly,
}

impl Piece {
    /// Signed distance of a point, metres, negative inside. Exact; hulls to single precision, and meant for checks rather than
    /// loops, since a hull is built at each call.
    #[must_use]
    pub fn signed_distance(&self, point_in_piece: &Point3<f64>) -> f64 {
        let p = point_in_piece;
        match self {
            Self::Cuboid { half_extents_m } => box_distance(p, half_extents_m),
            Self::Cylinder { half_height_m, radius_m } => cylinder_distance(p, *half_height_m, *radius_m),
            Self::Capsule { half_height_m, radius_m } => {
                let end = Point3::new(0.0, 0.0, *half_height_m);
                segment_distance(p, &Point3::from(-end.coords), &end) - radius_m
            }
            Self::Ball { radius_m } => p.coords.norm() - radius_m,
            Self::ConvexHull { points } => hull_distance(points, p),
        }
    }

    /// Enclosed volume of the natives, `None` for hulls.
    #[must_use]
    pub fn volume_m3(&self) -> Option<f64> {
        Some(match self {
            Self::Cuboid { half_extents_m: h } => 8.0 * h.x * h.y * h.z,
            Self::Cylinder { half_height_m, radius_m } => TAU * half_height_m * radius_m * radius_m,
            Self::Capsule { half_height_m, radius_m } => PI * radius_m * radius_m * (2.0 * half_height_m + 4.0 / 3.0 * radius_m),
            Self::Ball { radius_m } => 4.0 / 3.0 * PI * radius_m.powi(3),
            Self::ConvexHull { .. } => return None,
        })
    }
}

/// The pieces of one part.
pub(crate) fn pieces_of(primitive: &Primitive, object_from_part: &Pose, part_idx: usize) -> Result<Vec<LabelledPiece>, String> {
    let native: Vec<(Piece, Pose)> = match primitive {
        Primitive::Capsule { half_height, radius } if *half_height < 1e-6 => {
            vec![(Piece::Ball { radius_m: *radius }, Pose::identity())]
        }
        Primitive::Capsule { half_height, radius } => {
            vec![(Piece::Capsule { half_height_m: *half_height, radius_m: *radius }, Pose::identity())]
        }
        // A sharp corner leaves its rounding by 0.73 radii.
        Primitive::Box { half, rounding } if *rounding <= 1.3e-3 => {
            vec![(Piece::Cuboid { half_extents_m: *half }, Pose::identity())]
        }
        Primitive::Box { half, rounding } => vec![(chamfered_box(half, *rounding), Pose::identity())],
        Primitive::Lathe(profile) => match profile.inner() {
            Some(inner) => {
                let outer = profile.outer();
                let mut pieces = vec![floor_disk(outer[1][0], outer[0][1], inner[0][1])];
                pieces.extend(stave_walls(&outer[1..], profile.wall()));
                pieces
            }
            None => solid_pieces(profile),
        },
        Primitive::Torus { major, minor, half_arc } => {
            let step = 2.0 * (1.0 - MAX_SAGITTA_M / major).clamp(-1.0, 1.0).acos();
            let n = ((2.0 * half_arc / step).ceil() as usize).max(4);
            let angle_step = 2.0 * half_arc / n as f64;
            // Corners outside and middles inside the circle share the error.
            let radius = major * 2.0 / (1.0 + (angle_step / 2.0).cos());
            let points: Vec<Point3<f64>> = (0..=n)
                .map(|i| {
                    let angle = -half_arc + angle_step * i as f64;
                    Point3::new(radius * angle.cos(), radius * angle.sin(), 0.0)
                })
                .collect();
            chain(&points, *minor)
        }
        Primitive::Sweep { points, radius } => chain(points, *radius),
    };
    if native.is_empty() {
        return Err("the shape has no solid piece".to_owned());
    }
    Ok(native
        .into_iter()
        .map(|(piece, part_from_piece)| LabelledPiece {
            piece,
            object_from_piece: object_from_part * part_from_piece,
            part_idx,
            touches: Touches::Everything,
        })
        .collect())
}

/// A cylinder between two heights.
pub(crate) fn floor_disk(radius_m: f64, low: f64, high: f64) -> (Piece, Pose) {
    let half_height_m = (high - low) / 2.0;
    (Piece::Cylinder { half_height_m, radius_m }, Pose::translation(0.0, 0.0, low + half_height_m))
}

/// Rings of staves inside an outline of `[radius, height]`, bottom to top.
pub(crate) fn stave_walls(outer: &[[f64; 2]], wall: f64) -> Vec<(Piece, Pose)> {
    let widest = outer.iter().map(|p| p[0]).fold(0.0, f64::max);
    let n_staves = (16..=32).step_by(2).find(|&n| sagitta(widest, widest, n) <= MAX_SAGITTA_M).unwrap_or(32);
    let mut pieces = Vec::new();
    let direction = |i: usize| {
        let (dr, dz) = (outer[i + 1][0] - outer[i][0], outer[i + 1][1] - outer[i][1]);
        [dr / dr.hypot(dz), dz / dr.hypot(dz)]
    };
    // Where the wall bends outwards a wedge would open on its inside: both neighbours reach over the bend.
    let overlap = |i: usize, j: usize| {
        let (t, u) = (direction(i), direction(j));
        let turn = (t[0] * u[1] - t[1] * u[0]).atan2(t[0] * u[0] + t[1] * u[1]);
        wall * (-turn / 2.0).max(0.0).tan()
    };
    for i in 0..outer.len() - 1 {
        let before = if i > 0 { overlap(i - 1, i) } else { 0.0 };
        let after = if i + 2 < outer.len() { overlap(i, i + 1) } else { 0.0 };
        let [tr, tz] = direction(i);
        let p = [outer[i][0] - tr * before, outer[i][1] - tz * before];
        let q = [outer[i + 1][0] + tr * after, outer[i + 1][1] + tz * after];
        for (p, q) in cut(p, q) {
            stave_ring(p, q, wall, n_staves, &mut pieces);
        }
    }
    pieces
}

/// Cuts a slanted segment so that one width of stave fits its both ends.
fn cut(p: [f64; 2], q: [f64; 2]) -> Vec<([f64; 2], [f64; 2])> {
    const MAX_RATIO: f64 = 1.2;
    let ratio = (p[0] / q[0]).max(q[0] / p[0]);
    let n = (ratio.ln() / MAX_RATIO.ln()).ceil().clamp(1.0, 12.0) as usize;
    let at = |i: usize| {
        let t = i as f64 / n as f64;
        [p[0] + (q[0] - p[0]) * t, p[1] + (q[1] - p[1]) * t]
    };
    (0..n).map(|i| (at(i), at(i + 1))).collect()
}

/// How far the corner of a stave of `n` at radius `widest` stands out at a place of radius `here`.
fn sagitta(widest: f64, here: f64, n_staves: usize) -> f64 {
    (widest * (PI / n_staves as f64).tan()).hypot(here) - here
}

fn stave_ring(p: [f64; 2], q: [f64; 2], wall: f64, n_staves: usize, pieces: &mut Vec<(Piece, Pose)>) {
    let length = (q[0] - p[0]).hypot(q[1] - p[1]);
    let (along_r, along_z) = ((q[0] - p[0]) / length, (q[1] - p[1]) / length);
    let widest = p[0].max(q[0]);
    // Middles lie inside the round wall and corners outside by the same amount.
    let inwards = wall / 2.0 + sagitta(widest, p[0].min(q[0]), n_staves) * along_z.abs() / 2.0;
    let centre_r = (p[0] + q[0]) / 2.0 - along_z * inwards;
    let centre_z = (p[1] + q[1]) / 2.0 + along_r * inwards;
    let half_extents_m = Vector3::new(widest * (PI / n_staves as f64).tan(), wall / 2.0, length / 2.0);
    for i in 0..n_staves {
        let (sin, cos) = (TAU * i as f64 / n_staves as f64).sin_cos();
        let radial = Vector3::new(cos, sin, 0.0);
        let along = radial * along_r + Vector3::z() * along_z;
        let tangent = Vector3::new(-sin, cos, 0.0);
        let rotation = Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[tangent, along.cross(&tangent), along]));
        let centre = radial * centre_r + Vector3::z() * centre_z;
        pieces.push((
            Piece::Cuboid { half_extents_m },
            Pose::from_parts(centre.into(), UnitQuaternion::from_rotation_matrix(&rotation)),
        ));
    }
}

/// A solid of revolution: cylinders where straight, hulls of the rest; one hull when the whole is convex.
fn solid_pieces(profile: &Profile) -> Vec<(Piece, Pose)> {
    let outline = profile.outline();
    let turn = |a: [f64; 2], b: [f64; 2], c: [f64; 2]| (b[0] - a[0]) * (c[1] - b[1]) - (b[1] - a[1]) * (c[0] - b[0]);
    let convex = outline.windows(3).all(|w| turn(w[0], w[1], w[2]) >= -1e-12);
    let outer = profile.outer();
    let slices: Vec<Vec<[f64; 2]>> = if convex {
        vec![outer.to_vec()]
    } else {
        outer.windows(2).filter(|pair| pair[1][1] - pair[0][1] > 1e-6).map(|pair| pair.to_vec()).collect()
    };
    slices.iter().map(|slice| slice_piece(slice)).collect()
}

fn slice_piece(slice: &[[f64; 2]]) -> (Piece, Pose) {
    let rounds: Vec<[f64; 2]> = slice.iter().copied().filter(|p| p[0] > 0.0).collect();
    let on_axis: Vec<[f64; 2]> = slice.iter().copied().filter(|p| p[0] <= 0.0).collect();
    let flat_ends = on_axis.iter().all(|a| rounds.iter().any(|p| (p[1] - a[1]).abs() < 1e-9));
    if let ([p, q], true) = (rounds.as_slice(), flat_ends)
        && (p[0] - q[0]).abs() < 1e-6
    {
        let half_height_m = (q[1] - p[1]) / 2.0;
        return (Piece::Cylinder { half_height_m, radius_m: p[0] }, Pose::translation(0.0, 0.0, p[1] + half_height_m));
    }
    const N_AROUND: usize = 32;
    let spread = 2.0 / (1.0 + (PI / N_AROUND as f64).cos());
    let middle = slice.iter().map(|p| p[1]).sum::<f64>() / slice.len() as f64;
    let mut points: Vec<Point3<f64>> =
        on_axis.iter().filter(|_| !flat_ends).map(|p| Point3::new(0.0, 0.0, p[1] - middle)).collect();
    for [r, z] in rounds {
        points.extend((0..N_AROUND).map(|i| {
            let (sin, cos) = (TAU * i as f64 / N_AROUND as f64).sin_cos();
            Point3::new(r * spread * cos, r * spread * sin, z - middle)
        }));
    }
    // Corners about the hull's own middle: single precision collision code is best near its origin.
    (Piece::ConvexHull { points }, Pose::translation(0.0, 0.0, middle))
}

/// The hull of a box with cut edges and corners; it leaves the rounding by less than a tenth of its radius.
fn chamfered_box(half: &Vector3<f64>, rounding: f64) -> Piece {
    let cut = rounding * (2.0 - 2.0_f64.sqrt());
    let mut points = Vec::with_capacity(24);
    for full_axis in 0..3 {
        for corner in 0..8 {
            points.push(Point3::from(Vector3::from_fn(|axis, _| {
                let length = if axis == full_axis { half[axis] } else { half[axis] - cut };
                if corner >> axis & 1 == 1 { length } else { -length }
            })));
        }
    }
    Piece::ConvexHull { points }
}

/// Capsules along a polyline.
fn chain(points: &[Point3<f64>], radius_m: f64) -> Vec<(Piece, Pose)> {
    points
        .windows(2)
        .map(|pair| {
            let along = pair[1] - pair[0];
            let rotation = UnitQuaternion::rotation_between(&Vector3::z(), &along)
                .unwrap_or_else(|| UnitQuaternion::from_axis_angle(&Vector3::x_axis(), PI));
            let centre = nalgebra::center(&pair[0], &pair[1]);
            (Piece::Capsule { half_height_m: along.norm() / 2.0, radius_m }, Pose::from_parts(centre.coords.into(), rotation))
        })
        .collect()
}

fn hull_distance(points: &[Point3<f64>], p: &Point3<f64>) -> f64 {
    let hull = mesh::convex_hull(points);
    // Inside, the nearest face plane; outside, the nearest triangle.
    let (mut deepest, mut nearest) = (f64::NEG_INFINITY, f64::INFINITY);
    for idx in 0..hull.triangles.len() {
        let corners = hull.corners(idx);
        let normal = hull.area_vector(idx).try_normalize(1e-18).unwrap_or_else(Vector3::zeros);
        deepest = deepest.max(normal.dot(&(p - corners[0])));
        let [a, b, c] = corners.map(|v| parry3d::math::Vector::new(v.x as f32, v.y as f32, v.z as f32));
        let point = parry3d::math::Vector::new(p.x as f32, p.y as f32, p.z as f32);
        let on_face = parry3d::shape::Triangle::new(a, b, c).project_local_point(point, true).point;
        nearest = nearest.min(f64::from((on_face - point).length()));
    }
    if deepest <= 0.0 { deepest } else { nearest }
}

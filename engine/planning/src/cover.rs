//! Balls that cover the surface of a link: few, and standing out by no more than is asked.

use nalgebra::{Point3, Vector3};
use parry3d::math as parry;
use parry3d::query::PointQuery as _;
use parry3d::shape::TriMesh;
use sfg_kinematics::{Primitive, Shape};
use sfg_types::{Point, Vector};
use std::f64::consts::{PI, TAU};

use crate::shapes::signed_distance_m;

/// One shape of a link, in the link frame.
pub enum Surface {
    /// A shape with a formula.
    Primitive(Primitive),
    /// Triangles, metres.
    Mesh {
        /// Corners, three for each triangle.
        triangles: Vec<[Point; 3]>,
        /// The same for queries.
        tree: Box<TriMesh>,
    },
}

/// How well balls cover a link.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CoverQuality {
    /// Points of the surface that were looked at.
    pub n_points: usize,
    /// How many of them are in some ball.
    pub n_covered: usize,
    /// How far the farthest of the others is from the next ball, metres; 0 when all are covered.
    pub bare_m: f64,
    /// How far the outside of the balls is from the link, metres: mean over its area.
    pub mean_excess_m: f64,
    /// The same at the worst place.
    pub worst_excess_m: f64,
}

impl Surface {
    /// A surface of triangles; `None` when there is none with an area.
    #[must_use]
    pub fn mesh(triangles: Vec<[Point; 3]>) -> Option<Self> {
        let area = |[a, b, c]: &[Point; 3]| (b - a).cross(&(c - a)).norm();
        let triangles: Vec<[Point; 3]> = triangles.into_iter().filter(|t| area(t) > 1e-14).collect();
        let corner = |p: &Point| parry::Vector::new(p.x as f32, p.y as f32, p.z as f32);
        let vertices = triangles.iter().flatten().map(corner).collect();
        let indices = (0..triangles.len() as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        let tree = Box::new(TriMesh::new(vertices, indices).ok()?);
        Some(Self::Mesh { triangles, tree })
    }

    /// Distance of a point to the surface, negative inside, metres.
    fn signed_distance_m(&self, point: &Point) -> f64 {
        match self {
            Self::Primitive(one) => signed_distance_m(&one.shape, &(one.link_from_shape.inverse() * point)),
            Self::Mesh { triangles, tree } => {
                let local = parry::Vector::new(point.x as f32, point.y as f32, point.z as f32);
                let gap = f64::from(tree.distance_to_local_point(local, true));
                if is_inside(triangles, point) { -gap } else { gap }
            }
        }
    }

    /// Points of the surface such that every point of it is within `0.75 * spacing_m` of one.
    fn points(&self, spacing_m: f64, points: &mut Vec<Point>) {
        match self {
            Self::Primitive(Primitive { shape, link_from_shape }) => {
                let begin = points.len();
                match shape {
                    Shape::Cuboid { half_extents_m: h } => box_points(h, spacing_m, points),
                    Shape::Sphere { radius_m } => round_points(*radius_m, 0.0, true, spacing_m, points),
                    Shape::Capsule { radius_m, half_length_m } => {
                        round_points(*radius_m, *half_length_m, true, spacing_m, points);
                    }
                    Shape::Cylinder { radius_m, half_length_m } => {
                        round_points(*radius_m, *half_length_m, false, spacing_m, points);
                    }
                    Shape::Mesh { .. } => {}
                }
                points[begin..].iter_mut().for_each(|p| *p = link_from_shape * *p);
            }
            Self::Mesh { triangles, .. } => {
                let begin = points.len();
                triangles.iter().for_each(|triangle| triangle_points(triangle, spacing_m, points));
                // Triangles share their edges.
                let key = |p: &Point| [0, 1, 2].map(|axis| (p[axis] * 1e6).round() as i64);
                points[begin..].sort_by_key(key);
                points.dedup_by_key(|p| key(p));
            }
        }
    }
}

/// Rows along the longest edge: of a sliver no more points are needed than of its length.
fn triangle_points(corners: &[Point; 3], spacing: f64, points: &mut Vec<Point>) {
    let turned = |first: usize| [corners[first], corners[(first + 1) % 3], corners[(first + 2) % 3]];
    let longest = |a: &[Point; 3], b: &[Point; 3]| (a[1] - a[0]).norm().total_cmp(&(b[1] - b[0]).norm());
    let Some([a, b, c]) = [0, 1, 2].map(turned).into_iter().max_by(longest) else { return };
    let edge = b - a;
    let height = edge.cross(&(c - a)).norm() / edge.norm();
    let n_rows = (height / (0.55 * spacing)).ceil().max(1.0) as usize;
    for row in 0..=n_rows {
        let up = row as f64 / n_rows as f64;
        let n = (edge.norm() * (1.0 - up) / spacing).ceil().max(1.0) as usize;
        points.extend((0..=n).map(|i| a + (c - a) * up + edge * ((1.0 - up) * i as f64 / n as f64)));
    }
}

/// Steps of at most `spacing` from `-half` to `half`, ends included.
fn steps(half: f64, spacing: f64) -> impl Iterator<Item = f64> + Clone {
    let n = (2.0 * half / spacing).ceil().max(1.0);
    (0..=n as usize).map(move |i| half * (2.0 * i as f64 / n - 1.0))
}

fn box_points(half: &Vector, spacing: f64, points: &mut Vec<Point>) {
    for axis in 0..3 {
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        for side in [-1.0, 1.0] {
            for a in steps(half[u], spacing) {
                for b in steps(half[v], spacing) {
                    let mut point = Point::origin();
                    (point[axis], point[u], point[v]) = (side * half[axis], a, b);
                    points.push(point);
                }
            }
        }
    }
}

/// A cylinder about Z with flat or round ends.
fn round_points(radius: f64, half: f64, has_round_ends: bool, spacing: f64, points: &mut Vec<Point>) {
    let mut ring = |r: f64, z: f64| {
        let n = (TAU * r / spacing).ceil().max(1.0) as usize;
        points.extend((0..n).map(|i| (TAU * i as f64 / n as f64).sin_cos()).map(|(s, c)| Point::new(r * c, r * s, z)));
    };
    steps(half, spacing).for_each(|z| ring(radius, z));
    let n = ((if has_round_ends { 0.5 * PI } else { 1.0 }) * radius / spacing).ceil().max(1.0) as usize;
    for end in [-half, half] {
        for i in 0..n {
            let share = i as f64 / n as f64;
            let (sin, cos) = (0.5 * PI * share).sin_cos();
            let (r, beyond) = if has_round_ends { (radius * sin, radius * cos) } else { (radius * share, 0.0) };
            ring(r, end + beyond * if end < 0.0 { -1.0 } else { 1.0 });
            if half == 0.0 && has_round_ends {
                ring(r, -beyond);
            }
        }
    }
}

/// By the solid angle of all triangles (Van Oosterom and Strackee 1983), which forgives small holes.
fn is_inside(triangles: &[[Point; 3]], point: &Point) -> bool {
    let angle = |t: &[Point; 3]| {
        let [a, b, c] = t.map(|corner| corner - point);
        let (la, lb, lc) = (a.norm(), b.norm(), c.norm());
        a.dot(&b.cross(&c)).atan2(la * lb * lc + a.dot(&b) * lc + b.dot(&c) * la + c.dot(&a) * lb)
    };
    // Half of the full angle, and files that list corners the other way round.
    triangles.iter().map(angle).sum::<f64>().abs() > PI
}

/// Distance to the nearest of several shapes, negative inside one.
fn distance_m(surfaces: &[Surface], point: &Point) -> f64 {
    surfaces.iter().map(|s| s.signed_distance_m(point)).fold(f64::INFINITY, f64::min)
}

/// Points on the outside of the whole link.
fn outer_points(surfaces: &[Surface], spacing_m: f64) -> Vec<Point> {
    let mut points = Vec::new();
    for (idx, surface) in surfaces.iter().enumerate() {
        let mut of_one = Vec::new();
        surface.points(spacing_m, &mut of_one);
        let is_hidden =
            |p: &Point| surfaces.iter().enumerate().any(|(other, s)| other != idx && s.signed_distance_m(p) < -spacing_m);
        points.extend(of_one.into_iter().filter(|p| surfaces.len() == 1 || !is_hidden(p)));
    }
    points
}

/// Points of a surface that are looked at, at most about so many.
const MOST_POINTS: f64 = 30_000.0;
/// Centres that are tried.
const MOST_CENTRES: f64 = 6_000.0;

/// Balls in the link frame that cover the whole surface and stand out of it by at most `excess_m` anywhere (where a mesh has a
/// hole, by more).
///
/// Candidates are points inside; a ball about one may reach beyond the nearest surface by `excess_m`. The ball that covers most of
/// what is bare is taken, again and again; then each is shrunk to what it alone covers. "The whole surface" is meant: balls cover
/// points of the surface with a margin that holds what lies between them.
///
/// # Panics
/// If `excess_m` is not above 0.
#[must_use]
pub fn fit_spheres(surfaces: &[Surface], excess_m: f64) -> Vec<(Point, f64)> {
    assert!(excess_m > 0.0, "balls must be allowed to stand out");
    if let [Surface::Primitive(Primitive { shape: Shape::Sphere { radius_m }, link_from_shape })] = surfaces {
        return vec![(link_from_shape.translation.vector.into(), *radius_m)];
    }
    // The margin that holds what lies between points is lost to the balls, so points lie close where there may be enough.
    let mut spacing = 0.12 * excess_m;
    let mut points = outer_points(surfaces, spacing);
    while points.len() as f64 > MOST_POINTS && spacing < excess_m {
        spacing = (spacing * 1.3).min(excess_m);
        points = outer_points(surfaces, spacing);
    }
    if points.is_empty() {
        return Vec::new();
    }
    let margin = 0.75 * spacing;
    let (mut low, mut high) = (points[0], points[0]);
    for point in &points {
        (low, high) = (low.inf(point), high.sup(point));
    }
    let size = (high - low).map(|edge| edge.max(1e-3));
    let step = (size.product() / MOST_CENTRES).cbrt();
    let n = size.map(|edge| (edge / step).ceil().max(1.0));
    let mut balls: Vec<(Point, f64)> = Vec::new();
    for i in 0..n.x as usize {
        for j in 0..n.y as usize {
            for k in 0..n.z as usize {
                let share = Vector3::new(i as f64 + 0.5, j as f64 + 0.5, k as f64 + 0.5).component_div(&n);
                let centre = low + size.component_mul(&share);
                let depth = -distance_m(surfaces, &centre);
                if depth > 0.0 {
                    balls.push((centre, depth + excess_m));
                }
            }
        }
    }
    // For parts that are too thin for the grid.
    let stride = points.len().div_ceil(1000);
    balls.extend(points.iter().step_by(stride).map(|point| (*point, excess_m)));
    let covers = |(centre, radius): &(Point, f64), point: &Point| (point - centre).norm() + margin <= *radius;
    let masks: Vec<Vec<u64>> = balls
        .iter()
        .map(|ball| {
            let word = |part: &[Point]| part.iter().rev().fold(0, |bits, point| bits << 1 | u64::from(covers(ball, point)));
            points.chunks(64).map(word).collect()
        })
        .collect();
    let mut bare: Vec<u64> =
        points.chunks(64).map(|part| if part.len() == 64 { u64::MAX } else { (1 << part.len()) - 1 }).collect();
    let mut chosen = Vec::new();
    loop {
        let gain = |mask: &Vec<u64>| mask.iter().zip(&bare).map(|(a, b)| (a & b).count_ones()).sum::<u32>();
        let best =
            masks.iter().enumerate().map(|(idx, mask)| (gain(mask), idx)).max_by_key(|(gain, idx)| (*gain, usize::MAX - idx));
        match best {
            Some((gain, idx)) if gain > 0 => {
                bare.iter_mut().zip(&masks[idx]).for_each(|(bare, mask)| *bare &= !mask);
                chosen.push(balls[idx]);
            }
            _ => break,
        }
    }
    for (idx, point) in points.iter().enumerate() {
        if bare[idx / 64] >> (idx % 64) & 1 == 1 && !chosen.iter().any(|ball| covers(ball, point)) {
            chosen.push((*point, excess_m));
        }
    }
    shrink(chosen, &points, margin)
}

/// Gives each point to the ball that holds it most safely, and each ball the radius that its points need.
fn shrink(balls: Vec<(Point, f64)>, points: &[Point], margin_m: f64) -> Vec<(Point, f64)> {
    let mut needed = vec![0.0_f64; balls.len()];
    for point in points {
        let gaps = balls.iter().map(|(centre, radius)| (point - centre).norm() - radius).enumerate();
        if let Some((idx, _)) = gaps.min_by(|a, b| a.1.total_cmp(&b.1)) {
            needed[idx] = needed[idx].max((point - balls[idx].0).norm() + margin_m);
        }
    }
    let kept = balls.into_iter().zip(needed).filter(|(_, radius)| *radius > 0.0);
    kept.map(|((centre, radius), needed)| (centre, needed.min(radius))).collect()
}

/// Measures balls against the shapes that they stand for, with points `spacing_m` apart.
#[must_use]
pub fn cover_quality(surfaces: &[Surface], spheres: &[(Point, f64)], spacing_m: f64) -> CoverQuality {
    let points = outer_points(surfaces, spacing_m);
    let bare = |point: &Point| spheres.iter().map(|(c, r)| (point - c).norm() - r).fold(f64::INFINITY, f64::min);
    let gaps: Vec<f64> = points.iter().map(bare).collect();
    let n_covered = gaps.iter().filter(|gap| **gap <= 1e-9).count();
    let (mut area, mut sum, mut worst) = (0.0, 0.0, 0.0_f64);
    for (idx, (centre, radius)) in spheres.iter().enumerate() {
        // Evenly spread over the ball (Fibonacci's lattice).
        let n = 500;
        for i in 0..n {
            let z = 1.0 - (2 * i + 1) as f64 / f64::from(n);
            let (sin, cos) = (f64::from(i) * PI * (3.0 - 5.0_f64.sqrt())).sin_cos();
            let across = (1.0 - z * z).sqrt();
            let point = centre + Vector3::new(across * cos, across * sin, z) * *radius;
            let is_within = |(other, (c, r)): (usize, &(Point3<f64>, f64))| other != idx && (point - c).norm() < *r;
            if !spheres.iter().enumerate().any(is_within) {
                let excess = distance_m(surfaces, &point).max(0.0);
                let share = radius * radius / f64::from(n);
                (area, sum, worst) = (area + share, sum + excess * share, worst.max(excess));
            }
        }
    }
    CoverQuality {
        n_points: points.len(),
        n_covered,
        bare_m: gaps.into_iter().fold(0.0, f64::max),
        mean_excess_m: if area > 0.0 { sum / area } else { 0.0 },
        worst_excess_m: worst,
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "tests fail by panicking")]
    use super::*;
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;
    use sfg_types::Pose;

    fn primitive(shape: Shape) -> Surface {
        Surface::Primitive(Primitive {
            shape,
            link_from_shape: Pose::new(Vector::new(0.1, -0.2, 0.3), Vector::new(0.4, 1.0, -0.7)),
        })
    }

    /// A box of twelve triangles.
    fn box_mesh(half: Vector) -> Surface {
        let corner = |i: usize| Point::from(Vector::from_fn(|axis, _| if i >> axis & 1 == 1 { half[axis] } else { -half[axis] }));
        let faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let two = |f: [usize; 4]| [[f[0], f[1], f[2]], [f[0], f[2], f[3]]];
        Surface::mesh(faces.into_iter().flat_map(two).map(|t| t.map(corner)).collect()).unwrap()
    }

    #[test]
    fn balls_cover_everything_and_stand_out_by_no_more_than_asked() {
        let excess_m = 0.01;
        let links: Vec<Vec<Surface>> = vec![
            vec![primitive(Shape::Cuboid { half_extents_m: Vector::new(0.05, 0.08, 0.03) })],
            vec![primitive(Shape::Cylinder { radius_m: 0.05, half_length_m: 0.1 })],
            vec![primitive(Shape::Capsule { radius_m: 0.04, half_length_m: 0.08 })],
            vec![box_mesh(Vector::new(0.05, 0.08, 0.03))],
            // Thinner than the grid of centres.
            vec![primitive(Shape::Cuboid { half_extents_m: Vector::new(0.06, 0.06, 0.0005) })],
            vec![primitive(Shape::Capsule { radius_m: 0.03, half_length_m: 0.08 }), primitive(Shape::Sphere { radius_m: 0.05 })],
        ];
        for (idx, link) in links.iter().enumerate() {
            let balls = fit_spheres(link, excess_m);
            // Looked at much closer than it was made.
            let quality = cover_quality(link, &balls, 0.002);
            assert_eq!(quality.n_covered, quality.n_points, "link {idx}: {quality:?}");
            assert!(quality.worst_excess_m <= excess_m + 1e-6, "link {idx}: {quality:?}");
            assert!(quality.mean_excess_m < 0.85 * excess_m && quality.n_points > 1000, "link {idx}: {quality:?}");
        }
        let n_balls = |link: &[Surface]| fit_spheres(link, excess_m).len();
        assert!(n_balls(&links[3]) <= n_balls(&links[0]) + 3, "the mesh of a box needs no more than the box");
        assert!(fit_spheres(&links[1], 2.0 * excess_m).len() < n_balls(&links[1]), "fewer balls where they may stand out more");
        let ball = [primitive(Shape::Sphere { radius_m: 0.05 })];
        assert_eq!(fit_spheres(&ball, excess_m), [(Point::new(0.1, -0.2, 0.3), 0.05)]);
    }

    #[test]
    fn a_mesh_of_a_box_has_the_distances_of_the_box() {
        let half = Vector::new(0.05, 0.08, 0.03);
        let mesh = box_mesh(half);
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        for _ in 0..2000 {
            let point = Point::from(Vector::from_fn(|_, _| rng.random_range(-0.12..0.12)));
            let exact = signed_distance_m(&Shape::Cuboid { half_extents_m: half }, &point);
            assert!((mesh.signed_distance_m(&point) - exact).abs() < 1e-6, "{point}: {exact}");
        }
        assert!(Surface::mesh(Vec::new()).is_none());
    }

    #[test]
    fn a_missing_ball_is_seen() {
        let link = [primitive(Shape::Capsule { radius_m: 0.04, half_length_m: 0.08 })];
        let mut balls = fit_spheres(&link, 0.01);
        balls.remove(0);
        let quality = cover_quality(&link, &balls, 0.003);
        assert!(quality.n_covered < quality.n_points && quality.bare_m > 1e-3, "{quality:?}");
    }
}

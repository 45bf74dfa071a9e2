//! Closed meshes of simple bodies, centred on the origin, axis along +Z.

use super::TriMesh;
use nalgebra::{Point3, Vector3};
use std::f64::consts::{PI, TAU};

/// A box, 12 triangles.
#[must_use]
pub fn cuboid(half_extents: &Vector3<f64>) -> TriMesh {
    let vertices = (0..8)
        .map(|i| {
            let sign = |bit: usize| if i >> bit & 1 == 1 { 1.0 } else { -1.0 };
            Point3::new(sign(0) * half_extents.x, sign(1) * half_extents.y, sign(2) * half_extents.z)
        })
        .collect();
    const QUADS: [[u32; 4]; 6] = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
    TriMesh::new(vertices, QUADS.iter().flat_map(|q| [[q[0], q[1], q[2]], [q[0], q[2], q[3]]]).collect())
}

/// A ball as a UV sphere with `n_around` meridians.
#[must_use]
pub fn sphere(radius_m: f64, n_around: usize) -> TriMesh {
    capsule(0.0, radius_m, n_around)
}

/// A cylinder of height `2 * half_height_m`.
#[must_use]
pub fn cylinder(half_height_m: f64, radius_m: f64, n_around: usize) -> TriMesh {
    let (r, h) = (radius_m, half_height_m);
    revolve(&[[0.0, -h], [r, -h], [r, h], [0.0, h]], n_around)
}

/// A capsule whose end balls have their centres at `z = -half_height_m` and `z = half_height_m`.
#[must_use]
pub fn capsule(half_height_m: f64, radius_m: f64, n_around: usize) -> TriMesh {
    let n_quarter = (n_around / 4).max(2);
    let arc = |i: usize| PI / 2.0 * i as f64 / n_quarter as f64;
    let lower = (0..=n_quarter).map(|i| [radius_m * arc(i).sin(), -half_height_m - radius_m * arc(i).cos()]);
    // A ball needs its equator once.
    let first_upper = usize::from(half_height_m <= 0.0);
    let upper = (first_upper..=n_quarter).map(|i| [radius_m * arc(i).cos(), half_height_m + radius_m * arc(i).sin()]);
    let mut outline: Vec<[f64; 2]> = lower.chain(upper).collect();
    // Exact zeros close the poles.
    if let Some(last) = outline.last_mut() {
        last[0] = 0.0;
    }
    revolve(&outline, n_around)
}

/// The body swept by turning `outline` about +Z.
///
/// `outline` lists `[radius_m, height_m]` counter-clockwise in the half plane (radius right, height up): from the axis at the
/// bottom, along the outside, back to the axis. Points on the axis become one vertex each.
#[must_use]
pub fn revolve(outline: &[[f64; 2]], n_around: usize) -> TriMesh {
    let n = n_around as u32;
    let mut mesh = TriMesh::default();
    let mut rings: Vec<(u32, bool)> = Vec::with_capacity(outline.len());
    for &[radius, height] in outline {
        let start = mesh.vertices.len() as u32;
        if radius <= 1e-9 {
            mesh.vertices.push(Point3::new(0.0, 0.0, height));
            rings.push((start, true));
        } else {
            mesh.vertices.extend((0..n_around).map(|i| {
                let angle = TAU * i as f64 / n_around as f64;
                Point3::new(radius * angle.cos(), radius * angle.sin(), height)
            }));
            rings.push((start, false));
        }
    }
    for pair in rings.windows(2) {
        let ((a, a_pole), (b, b_pole)) = (pair[0], pair[1]);
        for i in 0..n {
            let j = (i + 1) % n;
            match (a_pole, b_pole) {
                (true, true) => {}
                (true, false) => mesh.triangles.push([a, b + j, b + i]),
                (false, true) => mesh.triangles.push([a + i, a + j, b]),
                (false, false) => {
                    mesh.triangles.push([a + i, a + j, b + j]);
                    mesh.triangles.push([a + i, b + j, b + i]);
                }
            }
        }
    }
    mesh
}

/// A round tube along a polyline: a ring when `closed`, otherwise with round ends.
///
/// # Panics
/// With fewer than two points.
#[must_use]
pub fn tube(points: &[Point3<f64>], radius_m: f64, closed: bool, n_around: usize) -> TriMesh {
    assert!(points.len() >= 2, "a tube needs two points");
    let n_points = points.len();
    let tangent = |i: usize| -> Vector3<f64> {
        let (before, after) = if closed {
            ((i + n_points - 1) % n_points, (i + 1) % n_points)
        } else {
            (i.saturating_sub(1), (i + 1).min(n_points - 1))
        };
        (points[after] - points[before]).normalize()
    };
    // Each ring is a circle in the plane normal to the tangent; the frame is carried along without twist.
    let mut side = any_normal_to(&tangent(0));
    let mut mesh = TriMesh::default();
    let mut add_ring = |centre: Point3<f64>, side: Vector3<f64>, up: Vector3<f64>, radius: f64| {
        mesh.vertices.extend((0..n_around).map(|k| {
            let angle = TAU * k as f64 / n_around as f64;
            centre + (side * angle.cos() + up * angle.sin()) * radius
        }));
    };
    let n_cap = if closed { 0 } else { (n_around / 4).max(2) };
    for i in 0..n_points {
        let along = tangent(i);
        side = (side - along * along.dot(&side)).normalize();
        let up = along.cross(&side);
        if i == 0 {
            for k in 1..n_cap {
                let angle = PI / 2.0 * (1.0 - k as f64 / n_cap as f64);
                add_ring(points[0] - along * (radius_m * angle.sin()), side, up, radius_m * angle.cos());
            }
        }
        add_ring(points[i], side, up, radius_m);
        if i + 1 == n_points {
            for k in 1..n_cap {
                let angle = PI / 2.0 * k as f64 / n_cap as f64;
                add_ring(points[i] + along * (radius_m * angle.sin()), side, up, radius_m * angle.cos());
            }
        }
    }
    let n_rings = mesh.vertices.len() / n_around;
    let n = n_around as u32;
    // A closed tube's frame may come back turned; the seam then joins the nearest corners.
    let seam_shift = if closed {
        let first = mesh.vertices[0];
        let last = (n_rings - 1) * n_around;
        (0..n_around)
            .min_by(|&a, &b| {
                let distance = |k: usize| (mesh.vertices[last + k] - first).norm_squared();
                distance(a).total_cmp(&distance(b))
            })
            .unwrap_or(0) as u32
    } else {
        0
    };
    let n_rings = n_rings as u32;
    let n_bands = if closed { n_rings } else { n_rings - 1 };
    for band in 0..n_bands {
        let a = band * n;
        let last_of_closed = closed && band + 1 == n_rings;
        let b = (band + 1) % n_rings * n;
        for i in 0..n {
            let j = (i + 1) % n;
            let shift = if last_of_closed { n - seam_shift } else { 0 };
            let (bi, bj) = (b + (i + shift) % n, b + (j + shift) % n);
            mesh.triangles.push([a + i, a + j, bj]);
            mesh.triangles.push([a + i, bj, bi]);
        }
    }
    if !closed {
        let start_pole = mesh.vertices.len() as u32;
        mesh.vertices.push(points[0] - tangent(0) * radius_m);
        mesh.vertices.push(points[n_points - 1] + tangent(n_points - 1) * radius_m);
        let last = (n_rings - 1) * n;
        for i in 0..n {
            let j = (i + 1) % n;
            mesh.triangles.push([start_pole, j, i]);
            mesh.triangles.push([last + i, last + j, start_pole + 1]);
        }
    }
    mesh
}

/// The convex hull of points, to single precision; empty when they span no volume.
#[must_use]
pub fn convex_hull(points: &[Point3<f64>]) -> TriMesh {
    let points: Vec<_> = points.iter().map(|p| parry3d::math::Vector::new(p.x as f32, p.y as f32, p.z as f32)).collect();
    let Ok((vertices, triangles)) = parry3d::transformation::try_convex_hull(&points) else { return TriMesh::default() };
    let vertices = vertices.iter().map(|v| Point3::new(f64::from(v.x), f64::from(v.y), f64::from(v.z))).collect();
    TriMesh::new(vertices, triangles)
}

/// A unit vector at right angles to `direction`.
fn any_normal_to(direction: &Vector3<f64>) -> Vector3<f64> {
    let axis = if direction.x.abs() < 0.8 { Vector3::x() } else { Vector3::y() };
    direction.cross(&axis).normalize()
}

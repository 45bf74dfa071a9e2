//! Distances, normals and surface points of a fused grid.

use sfg_types::tsdf::{EDGE, TRUNCATION_M, VOXEL_M};
use sfg_types::{Point, Tsdf, Vector};

/// A point of the observed surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfacePoint {
    /// Where, metres.
    pub point_in_base: Point,
    /// Unit normal, out of the object.
    pub normal_in_base: Vector,
}

/// Distance to the surface at a point, metres, positive outside; trilinear, cut at the truncation.
///
/// `None` outside the grid and where one of the eight voxels around is unobserved.
#[must_use]
pub fn distance_at(tsdf: &Tsdf, point_in_base: &Point) -> Option<f64> {
    let (cell, t) = cell_of(tsdf, point_in_base)?;
    let mut sum = 0.0;
    for corner in 0..8 {
        let bit = |axis: usize| corner >> axis & 1;
        let idx = Tsdf::index(cell[0] + bit(0), cell[1] + bit(1), cell[2] + bit(2));
        if tsdf.weights[idx] <= 0.0 {
            return None;
        }
        let weight: f64 = (0..3).map(|axis| if bit(axis) == 1 { t[axis] } else { 1.0 - t[axis] }).product();
        sum += weight * f64::from(tsdf.distances[idx]);
    }
    Some(sum * TRUNCATION_M)
}

/// Unit gradient of the distance at a point, base frame: out of the object. `None` where no gradient is observed.
#[must_use]
pub fn normal_at(tsdf: &Tsdf, point_in_base: &Point) -> Option<Vector> {
    let (cell, t) = cell_of(tsdf, point_in_base)?;
    let mut sum = Vector::zeros();
    for corner in 0..8 {
        let bit = |axis: usize| corner >> axis & 1;
        let weight: f64 = (0..3).map(|axis| if bit(axis) == 1 { t[axis] } else { 1.0 - t[axis] }).product();
        let voxel = [cell[0] + bit(0), cell[1] + bit(1), cell[2] + bit(2)];
        if tsdf.weights[Tsdf::index(voxel[0], voxel[1], voxel[2])] > 0.0 {
            sum += gradient(tsdf, voxel) * weight;
        }
    }
    Some(tsdf.base_from_grid.rotation * sum.try_normalize(1e-9)?)
}

/// Where the observed distance changes sign between neighbouring voxels, with normals.
///
/// Both voxels must be observed. So the side on the table and everything hidden from all views gives no points: the object is
/// open there, and the caller must not take a missing surface for free space.
#[must_use]
pub fn surface_points(tsdf: &Tsdf) -> Vec<SurfacePoint> {
    let mut points = Vec::new();
    for k in 0..EDGE {
        for j in 0..EDGE {
            for i in 0..EDGE {
                for (axis, stride) in [1, EDGE, EDGE * EDGE].into_iter().enumerate() {
                    let voxel = [i, j, k];
                    if voxel[axis] + 1 == EDGE {
                        continue;
                    }
                    let a = Tsdf::index(i, j, k);
                    let b = a + stride;
                    let (da, db) = (tsdf.distances[a], tsdf.distances[b]);
                    if tsdf.weights[a] <= 0.0 || tsdf.weights[b] <= 0.0 || (da < 0.0) == (db < 0.0) {
                        continue;
                    }
                    let t = f64::from(da / (da - db));
                    let mut next = voxel;
                    next[axis] += 1;
                    let normal = gradient(tsdf, voxel) * (1.0 - t) + gradient(tsdf, next) * t;
                    let Some(normal) = normal.try_normalize(1e-9) else { continue };
                    let (p, q) = (tsdf.centre_in_base(i, j, k), tsdf.centre_in_base(next[0], next[1], next[2]));
                    points.push(SurfacePoint {
                        point_in_base: p + (q - p) * t,
                        normal_in_base: tsdf.base_from_grid.rotation * normal,
                    });
                }
            }
        }
    }
    points
}

/// The cell whose corners are voxel centres, and the place in it, 0 to 1.
fn cell_of(tsdf: &Tsdf, point_in_base: &Point) -> Option<([usize; 3], [f64; 3])> {
    let p = tsdf.base_from_grid.inverse_transform_point(point_in_base);
    let mut cell = [0; 3];
    let mut t = [0.0; 3];
    for axis in 0..3 {
        let x = p[axis] / VOXEL_M - 0.5;
        if !(0.0..(EDGE - 1) as f64).contains(&x) {
            return None;
        }
        cell[axis] = x as usize;
        t[axis] = x - x.floor();
    }
    Some((cell, t))
}

/// Central differences, one-sided beside unobserved voxels, zero between two of them.
fn gradient(tsdf: &Tsdf, voxel: [usize; 3]) -> Vector {
    let here = Tsdf::index(voxel[0], voxel[1], voxel[2]);
    let mut slope = Vector::zeros();
    for (axis, stride) in [1, EDGE, EDGE * EDGE].into_iter().enumerate() {
        let after = (voxel[axis] + 1 < EDGE).then_some(here + stride).filter(|&idx| tsdf.weights[idx] > 0.0);
        let before = (voxel[axis] > 0).then(|| here - stride).filter(|&idx| tsdf.weights[idx] > 0.0);
        let value = |idx: usize| f64::from(tsdf.distances[idx]);
        slope[axis] = match (before, after) {
            (Some(a), Some(b)) => (value(b) - value(a)) / 2.0,
            (Some(a), None) => value(here) - value(a),
            (None, Some(b)) => value(b) - value(here),
            (None, None) => 0.0,
        };
    }
    slope
}

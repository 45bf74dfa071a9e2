//! Finds the table: the horizontal plane above the floor that carries the most points.

use crate::cloud::CloudPoint;
use nalgebra::{Matrix3, Vector3};

/// Lower than this is floor, higher is no table a standing robot works at.
const HEIGHT_RANGE_M: (f32, f32) = (0.25, 1.30);
const BIN_M: f32 = 0.004;
/// A table seen by a camera has tens of thousands of points; fewer are a shelf edge or noise.
const MIN_POINTS: usize = 1500;
/// Points this near the plane are the table: three sigmas of a D435i at 1 m.
const INLIER_M: f32 = 0.010;
/// Steepest accepted plane: `tan(6 deg)`, more than a calibration error.
const MAX_SLOPE: f64 = 0.105;
/// Cell of the map that says how far the table reaches.
const EXTENT_CELL_M: f32 = 0.02;
const MIN_POINTS_PER_EXTENT_CELL: u32 = 3;

/// `z = slope_x x + slope_y y + offset`, with the outline of the points that support it.
#[derive(Clone, Debug)]
pub(crate) struct Table {
    slope_x: f32,
    slope_y: f32,
    offset_m: f32,
    /// Convex outline, counter-clockwise, metres.
    outline: Vec<[f32; 2]>,
    /// The same as half planes: inward unit normal and offset.
    edges: Vec<[f32; 3]>,
}

impl Table {
    /// Height of the plane at (x, y).
    pub(crate) fn height_at(&self, x: f32, y: f32) -> f32 {
        self.slope_x * x + self.slope_y * y + self.offset_m
    }

    /// Height of the plane in the middle of the outline.
    pub(crate) fn height_m(&self) -> f64 {
        let n = self.outline.len().max(1) as f32;
        let (x, y) = self.outline.iter().fold((0.0, 0.0), |(x, y), p| (x + p[0] / n, y + p[1] / n));
        f64::from(self.height_at(x, y))
    }

    /// True when (x, y) lies over the table, with 2 cm to spare for the rounding of the outline.
    pub(crate) fn carries(&self, x: f32, y: f32) -> bool {
        self.edges.iter().all(|[normal_x, normal_y, offset]| normal_x * x + normal_y * y >= offset - EXTENT_CELL_M)
    }
}

/// The sides of a counter-clockwise outline as inward unit normals and offsets.
fn edges(outline: &[[f32; 2]]) -> Vec<[f32; 3]> {
    let n = outline.len();
    let edge = |i: usize| {
        let (a, b) = (outline[i], outline[(i + 1) % n]);
        let length = (b[0] - a[0]).hypot(b[1] - a[1]);
        let (x, y) = ((a[1] - b[1]) / length, (b[0] - a[0]) / length);
        [x, y, x * a[0] + y * a[1]]
    };
    (0..n).map(edge).collect()
}

/// The table under `points`, `None` when nothing horizontal is large enough.
///
/// The height histogram finds the level (the mode ignores objects and noise), then three rounds of least squares with
/// shrinking inlier bands give height and slope, so a few millimetres of noise and a slight tilt of the calibration do not matter.
pub(crate) fn find_table(points: &[CloudPoint]) -> Option<Table> {
    let (low, high) = HEIGHT_RANGE_M;
    let n_bins = ((high - low) / BIN_M) as usize + 1;
    let mut histogram = vec![0_usize; n_bins];
    for point in points {
        let z = point.position.z;
        if z > low && z < high {
            histogram[((z - low) / BIN_M) as usize] += 1;
        }
    }
    // Five bins (2 cm) together, so that a level spread by noise over several bins is not beaten by a sharp small one.
    let level = (2..n_bins - 2).max_by_key(|&i| (histogram[i - 2..=i + 2].iter().sum::<usize>(), n_bins - i))?;
    if histogram[level - 2..=level + 2].iter().sum::<usize>() < MIN_POINTS {
        return None;
    }
    let mut plane = Vector3::new(0.0, 0.0, f64::from(low + (level as f32 + 0.5) * BIN_M));
    for band in [0.025, 0.015, INLIER_M] {
        plane = refine(points, plane, band)?;
    }
    if plane.x.hypot(plane.y) > MAX_SLOPE {
        return None;
    }
    let mut table = Table {
        slope_x: plane.x as f32,
        slope_y: plane.y as f32,
        offset_m: plane.z as f32,
        outline: Vec::new(),
        edges: Vec::new(),
    };
    table.outline = outline(points, &table);
    table.edges = edges(&table.outline);
    (table.outline.len() >= 3).then_some(table)
}

/// Least squares of `z = a x + b y + c` over the points within `band` of `plane = (a, b, c)`.
fn refine(points: &[CloudPoint], plane: Vector3<f64>, band: f32) -> Option<Vector3<f64>> {
    let (a, b, c) = (plane.x as f32, plane.y as f32, plane.z as f32);
    let (mut normal, mut right) = (Matrix3::<f64>::zeros(), Vector3::<f64>::zeros());
    // Every third point: a hundred thousand equations are enough for three unknowns.
    for point in points.iter().step_by(3) {
        let p = &point.position;
        let miss = p.z - (a * p.x + b * p.y + c);
        if miss.abs() < band {
            let row = Vector3::new(f64::from(p.x), f64::from(p.y), 1.0);
            normal += row * row.transpose();
            right += row * f64::from(p.z);
        }
    }
    normal.cholesky().map(|factor| factor.solve(&right))
}

fn outline(points: &[CloudPoint], table: &Table) -> Vec<[f32; 2]> {
    const HALF_WIDTH: i32 = 150;
    let edge = 2 * HALF_WIDTH;
    let mut counts = vec![0_u32; (edge * edge) as usize];
    for point in points.iter().step_by(3) {
        let p = &point.position;
        if (p.z - table.height_at(p.x, p.y)).abs() < INLIER_M {
            let (i, j) = ((p.x / EXTENT_CELL_M).floor() as i32 + HALF_WIDTH, (p.y / EXTENT_CELL_M).floor() as i32 + HALF_WIDTH);
            if (0..edge).contains(&i) && (0..edge).contains(&j) {
                counts[(i * edge + j) as usize] += 1;
            }
        }
    }
    let mut cells = Vec::new();
    for i in 0..edge {
        for j in 0..edge {
            if counts[(i * edge + j) as usize] >= MIN_POINTS_PER_EXTENT_CELL {
                let at = |k: i32| (k - HALF_WIDTH) as f32 * EXTENT_CELL_M + EXTENT_CELL_M / 2.0;
                cells.push([at(i), at(j)]);
            }
        }
    }
    convex_hull(cells)
}

/// Convex hull, counter-clockwise (Andrew's monotone chain).
pub(crate) fn convex_hull(mut points: Vec<[f32; 2]>) -> Vec<[f32; 2]> {
    points.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    points.dedup();
    if points.len() < 3 {
        return points;
    }
    let turns_left = |a: [f32; 2], b: [f32; 2], c: [f32; 2]| (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]) > 0.0;
    let half = |points: &mut dyn Iterator<Item = [f32; 2]>| {
        let mut chain: Vec<[f32; 2]> = Vec::new();
        for point in points {
            while chain.len() >= 2 && !turns_left(chain[chain.len() - 2], chain[chain.len() - 1], point) {
                chain.pop();
            }
            chain.push(point);
        }
        chain.pop();
        chain
    };
    let mut hull = half(&mut points.iter().copied());
    hull.extend(half(&mut points.iter().rev().copied()));
    hull
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hull_of_a_square_with_inner_points_is_its_corners() {
        let hull = convex_hull(vec![[0.0, 0.0], [1.0, 0.0], [0.5, 0.5], [1.0, 1.0], [0.0, 1.0], [0.5, 0.0]]);
        assert_eq!(hull, vec![[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]);
    }
}

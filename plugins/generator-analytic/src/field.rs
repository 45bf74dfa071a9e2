//! The completed object as one distance field: what the cameras saw, and a fitted solid where they saw nothing.

use crate::shape::{Sample, Shape};
use sfg_types::tsdf::{EDGE, TRUNCATION_M, VOXEL_M};
use sfg_types::{Point, Pose, Tsdf, Vector};

/// Radius of the ball that stands for a surface point that no shape explains, metres.
const BALL_M: f64 = 0.5 * VOXEL_M;
/// How far such a ball reaches into the field, voxels.
const BALL_REACH: isize = 3;
/// Seen free space further than this from any surface overrules a fitted solid, metres.
const SURELY_FREE_M: f64 = 0.5 * TRUNCATION_M;

/// Signed distances in metres on the grid of the TSDF, positive outside the completed object and not truncated.
///
/// An unobserved voxel is unknown, not free: it takes the distance to the fitted shapes. Where the cameras saw free space
/// well inside a fitted shape the object is hollow, and the field follows the cameras.
#[derive(Clone, Debug)]
pub struct Field {
    values: Vec<f32>,
    base_from_grid: Pose,
    grid_from_base: Pose,
}

impl Field {
    /// The field of `shapes`, the surface points `loose` that they leave unexplained, and the free space seen in `tsdf`.
    #[must_use]
    pub fn new(tsdf: &Tsdf, shapes: &[Shape], loose: &[Sample]) -> Self {
        let mut values = vec![0.15_f32; EDGE * EDGE * EDGE];
        for k in 0..EDGE {
            for j in 0..EDGE {
                for i in 0..EDGE {
                    let point = tsdf.centre_in_base(i, j, k);
                    let mut value = shapes.iter().map(|s| s.distance(&point)).fold(0.15, f64::min);
                    let at = Tsdf::index(i, j, k);
                    let seen_m = f64::from(tsdf.distances[at]) * TRUNCATION_M;
                    if value < 0.0 && tsdf.weights[at] > 0.0 && seen_m > SURELY_FREE_M {
                        value = VOXEL_M;
                    }
                    values[at] = value as f32;
                }
            }
        }
        let grid_from_base = tsdf.base_from_grid.inverse();
        for sample in loose {
            add_ball(&mut values, &(grid_from_base * sample.point));
        }
        Self { values, base_from_grid: tsdf.base_from_grid, grid_from_base }
    }

    /// Grid from base, to turn many points at once.
    #[must_use]
    pub fn grid_from_base(&self) -> &Pose {
        &self.grid_from_base
    }

    /// Trilinear distance at a point of the grid frame, metres. Outside the cube the way to it is added.
    #[must_use]
    #[inline]
    pub fn distance_in_grid(&self, point_in_grid: &Point) -> f64 {
        const LAST: f32 = (EDGE - 1) as f32;
        let voxel = point_in_grid.coords.map(|x| (x / VOXEL_M - 0.5) as f32);
        let inside = voxel.map(|x| x.clamp(0.0, LAST - 1e-3));
        let beyond = (voxel - inside).norm();
        let low = inside.map(|x| x as usize);
        let share = [inside.x - low.x as f32, inside.y - low.y as f32, inside.z - low.z as f32];
        let at = Tsdf::index(low.x, low.y, low.z);
        let v = &self.values[at..=at + 1 + EDGE + EDGE * EDGE];
        let mix = |a: f32, b: f32, t: f32| a + (b - a) * t;
        let near = mix(mix(v[0], v[1], share[0]), mix(v[EDGE], v[EDGE + 1], share[0]), share[1]);
        let up = EDGE * EDGE;
        let far = mix(mix(v[up], v[up + 1], share[0]), mix(v[up + EDGE], v[up + EDGE + 1], share[0]), share[1]);
        f64::from(mix(near, far, share[2])) + f64::from(beyond) * VOXEL_M
    }

    /// Distance at a point of the base frame, metres.
    #[must_use]
    pub fn distance(&self, point_in_base: &Point) -> f64 {
        self.distance_in_grid(&(self.grid_from_base * point_in_base))
    }

    /// Unit direction of growing distance, base frame; up where the field is flat.
    #[must_use]
    pub fn outward_normal(&self, point_in_base: &Point) -> Vector {
        const STEP_M: f64 = 0.5 * VOXEL_M;
        let at = self.grid_from_base * point_in_base;
        let slope = |axis: usize| {
            let mut offset = Vector::zeros();
            offset[axis] = STEP_M;
            self.distance_in_grid(&(at + offset)) - self.distance_in_grid(&(at - offset))
        };
        let in_grid = Vector::new(slope(0), slope(1), slope(2));
        (self.base_from_grid * in_grid).try_normalize(1e-9).unwrap_or_else(Vector::z)
    }

    /// Centre of the voxels inside the completed object, base frame; `None` when there are none.
    #[must_use]
    pub fn centroid(&self) -> Option<Point> {
        let (mut sum, mut n) = (Vector::zeros(), 0.0);
        for k in 0..EDGE {
            for j in 0..EDGE {
                for i in 0..EDGE {
                    if self.values[Tsdf::index(i, j, k)] < 0.0 {
                        sum += Vector::new(i as f64 + 0.5, j as f64 + 0.5, k as f64 + 0.5);
                        n += 1.0;
                    }
                }
            }
        }
        (n > 0.0).then(|| self.base_from_grid * Point::from(sum * (VOXEL_M / n)))
    }
}

fn add_ball(values: &mut [f32], centre_in_grid: &Point) {
    let middle = centre_in_grid.coords.map(|x| (x / VOXEL_M).floor() as isize);
    let range = |m: isize| (m - BALL_REACH).max(0)..(m + BALL_REACH + 1).min(EDGE as isize);
    for k in range(middle.z) {
        for j in range(middle.y) {
            for i in range(middle.x) {
                let voxel = Vector::new(i as f64 + 0.5, j as f64 + 0.5, k as f64 + 0.5) * VOXEL_M;
                let distance = ((voxel - centre_in_grid.coords).norm() - BALL_M) as f32;
                let value = &mut values[Tsdf::index(i as usize, j as usize, k as usize)];
                *value = value.min(distance);
            }
        }
    }
}

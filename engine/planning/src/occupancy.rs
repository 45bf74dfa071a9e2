//! What depth cameras have seen of a box of space: free, occupied, or nothing yet.

use crate::collision::BodySphere;
use crate::points::PointObstacles;
use sfg_types::{Point, RgbdImage};

/// State of a voxel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Voxel {
    /// No camera has looked there.
    Unobserved,
    /// A camera has looked through it.
    Free,
    /// A camera has seen a surface in it.
    Occupied,
}

/// A box of voxels in the base frame; what was seen last counts.
#[derive(Clone, Debug, PartialEq)]
pub struct Occupancy {
    low: Point,
    edge_m: f64,
    n: [usize; 3],
    voxels: Vec<Voxel>,
}

/// Most voxels of a box: a metre and a half each way at 1 cm.
const MAX_VOXELS: usize = 4_000_000;

impl Occupancy {
    /// A box between two corners, nothing of it observed. `None` when it is empty, not finite or has more than four million voxels.
    #[must_use]
    pub fn new(low: Point, high: Point, edge_m: f64) -> Option<Self> {
        let size = high - low;
        if !(edge_m > 0.0 && size.iter().all(|v| v.is_finite() && *v > 0.0)) {
            return None;
        }
        let along = |axis: usize| (size[axis] / edge_m).ceil();
        let total = along(0) * along(1) * along(2);
        if total > MAX_VOXELS as f64 {
            return None;
        }
        let n = [0, 1, 2].map(|axis| along(axis) as usize);
        Some(Self { low, edge_m, n, voxels: vec![Voxel::Unobserved; n.iter().product()] })
    }

    /// Takes over a depth image: voxels in front of what was seen are free, those at it are occupied, those behind keep their state.
    ///
    /// The robot is no obstacle: what lies within `self_spheres` is free.
    pub fn update(&mut self, view: &RgbdImage, self_spheres: &[BodySphere]) {
        let lens = &view.intrinsics;
        if view.depth_m.len() != lens.width * lens.height {
            return;
        }
        let camera_from_base = view.base_from_camera.inverse();
        let margin_m = 0.5 * 3.0_f64.sqrt() * self.edge_m;
        for idx in 0..self.voxels.len() {
            let centre = self.centre(idx);
            let seen = camera_from_base * centre;
            let Some(pixel) = lens.project(&seen) else { continue };
            let (column, row) = (pixel.x.round(), pixel.y.round());
            if column < 0.0 || row < 0.0 || column >= lens.width as f64 || row >= lens.height as f64 {
                continue;
            }
            let depth_m = f64::from(view.depth_m[row as usize * lens.width + column as usize]);
            if depth_m.is_nan() || depth_m <= 0.0 {
                continue;
            }
            if seen.z < depth_m - margin_m {
                self.voxels[idx] = Voxel::Free;
            } else if seen.z <= depth_m + margin_m {
                let is_self = self_spheres.iter().any(|ball| {
                    let reach_m = ball.radius_m + margin_m;
                    (ball.centre_in_base - centre).norm_squared() < reach_m * reach_m
                });
                self.voxels[idx] = if is_self { Voxel::Free } else { Voxel::Occupied };
            }
        }
    }

    /// The state of the voxel at a point; none outside the box.
    #[must_use]
    pub fn at(&self, point: &Point) -> Option<Voxel> {
        let mut idx = 0;
        for axis in 0..3 {
            let along = ((point[axis] - self.low[axis]) / self.edge_m).floor();
            if along < 0.0 || along >= self.n[axis] as f64 {
                return None;
            }
            idx = idx * self.n[axis] + along as usize;
        }
        Some(self.voxels[idx])
    }

    /// Number of voxels in a state.
    #[must_use]
    pub fn count(&self, state: Voxel) -> usize {
        self.voxels.iter().filter(|voxel| **voxel == state).count()
    }

    /// Occupied voxels as balls that cover them; unobserved ones too if `unobserved_blocks`, for a careful approach. Voxels for which
    /// `is_known` holds are left out: what stands there is in the scene by another name.
    #[must_use]
    pub fn obstacles(&self, unobserved_blocks: bool, is_known: impl Fn(&Point) -> bool) -> PointObstacles {
        let blocks = |voxel: Voxel| voxel == Voxel::Occupied || (unobserved_blocks && voxel == Voxel::Unobserved);
        let points = (0..self.voxels.len()).filter(|idx| blocks(self.voxels[*idx])).map(|idx| self.centre(idx));
        PointObstacles::new(points.filter(|point| !is_known(point)).collect(), 0.5 * 3.0_f64.sqrt() * self.edge_m)
    }

    fn centre(&self, idx: usize) -> Point {
        let (z, rest) = (idx % self.n[2], idx / self.n[2]);
        let (y, x) = (rest % self.n[1], rest / self.n[1]);
        let along = |axis: usize, at: usize| self.low[axis] + (at as f64 + 0.5) * self.edge_m;
        Point::new(along(0, x), along(1, y), along(2, z))
    }
}

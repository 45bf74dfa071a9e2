//! Unknown clutter as a cloud of points, each with a radius.

use sfg_types::Point;
use std::collections::HashMap;

/// Points that must not be touched, in a hash grid.
#[derive(Clone, Debug)]
pub struct PointObstacles {
    points_in_base: Vec<Point>,
    radius_m: f64,
    cells: HashMap<[i32; 3], Vec<u32>>,
    low: Point,
    high: Point,
}

/// Edge of a grid cell.
const CELL_M: f64 = 0.05;

impl PointObstacles {
    /// Puts points into the grid; each keeps a distance of `radius_m` (half of the cloud's spacing is a good choice).
    #[must_use]
    pub fn new(points_in_base: Vec<Point>, radius_m: f64) -> Self {
        let mut cells: HashMap<[i32; 3], Vec<u32>> = HashMap::new();
        let mut low = Point::from([f64::INFINITY; 3]);
        let mut high = Point::from([f64::NEG_INFINITY; 3]);
        for (idx, point) in points_in_base.iter().enumerate() {
            cells.entry(cell(point)).or_default().push(idx as u32);
            low = low.inf(point);
            high = high.sup(point);
        }
        Self { points_in_base, radius_m, cells, low, high }
    }

    /// Number of points.
    #[must_use]
    pub fn len(&self) -> usize {
        self.points_in_base.len()
    }

    /// Whether there is none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.points_in_base.is_empty()
    }

    /// How deep a ball reaches into the cloud; negative or `None` when it does not (only near points are looked at).
    #[must_use]
    pub fn depth_m(&self, centre: &Point, radius_m: f64) -> Option<f64> {
        let reach = radius_m + self.radius_m;
        let outside = (0..3).any(|i| centre[i] < self.low[i] - reach || centre[i] > self.high[i] + reach);
        if outside || self.is_empty() {
            return None;
        }
        let (from, to) = (cell(&centre.map(|v| v - reach)), cell(&centre.map(|v| v + reach)));
        let mut nearest = f64::INFINITY;
        for x in from[0]..=to[0] {
            for y in from[1]..=to[1] {
                for z in from[2]..=to[2] {
                    for idx in self.cells.get(&[x, y, z]).into_iter().flatten() {
                        nearest = nearest.min((self.points_in_base[*idx as usize] - centre).norm_squared());
                    }
                }
            }
        }
        nearest.is_finite().then(|| reach - nearest.sqrt())
    }
}

fn cell(point: &Point) -> [i32; 3] {
    [0, 1, 2].map(|i| (point[i] / CELL_M).floor() as i32)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    #[test]
    fn the_grid_answers_as_the_exhaustive_search() {
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let mut random = |half: f64| Point::from([0; 3].map(|_| rng.random_range(-half..half)));
        let points: Vec<Point> = (0..500).map(|_| random(0.4)).collect();
        let cloud = PointObstacles::new(points.clone(), 0.01);
        let mut n_touching = 0;
        for _ in 0..2000 {
            let centre = random(0.6);
            let exact = points.iter().map(|p| 0.06 - (p - centre).norm()).fold(f64::NEG_INFINITY, f64::max);
            match cloud.depth_m(&centre, 0.05) {
                Some(depth) if depth > 0.0 => {
                    n_touching += 1;
                    assert!((depth - exact).abs() < 1e-12);
                }
                _ => assert!(exact <= 0.0),
            }
        }
        assert!(n_touching > 100);
        assert_eq!(PointObstacles::new(Vec::new(), 0.01).depth_m(&Point::origin(), 1.0), None);
    }
}

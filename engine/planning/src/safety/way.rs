//! The way to rest, and whether anything is met on it.

use crate::collision::CollisionModel;

/// Configurations period by period until the arm rests.
pub(super) struct Way {
    n_joints: usize,
    q: Vec<f64>,
    /// How far any ball can have moved since the first configuration, metres.
    pub(super) ball_moved_m: Vec<f64>,
    /// How far any two balls can have moved against each other.
    pair_moved_m: Vec<f64>,
}

/// Looks taken together.
const N_LOOKS: usize = 8;
/// A stretch that must keep more than this from everything is split first, metres.
const MAX_COARSE_M: f64 = 0.05;

impl Way {
    /// A way that begins at `q`.
    pub(super) fn from(q: Vec<f64>) -> Self {
        Self { n_joints: q.len(), q, ball_moved_m: vec![0.0], pair_moved_m: vec![0.0] }
    }

    /// One period further; how far a ball, and two balls against each other, can have moved in it.
    pub(super) fn push(&mut self, q: impl Iterator<Item = f64>, ball_m: f64, pair_m: f64) {
        self.q.extend(q);
        let further = |sums: &mut Vec<f64>, by: f64| sums.push(sums.last().copied().unwrap_or(0.0) + by);
        further(&mut self.ball_moved_m, ball_m);
        further(&mut self.pair_moved_m, pair_m);
    }

    pub(super) fn len(&self) -> usize {
        self.ball_moved_m.len()
    }

    pub(super) fn at(&self, idx: usize) -> &[f64] {
        &self.q[idx * self.n_joints..(idx + 1) * self.n_joints]
    }

    /// A look near something that is met: at each look things must be farther apart than half the way to the next one, and than
    /// half of `step_m`.
    pub(super) fn first_met(&self, world: &CollisionModel, step_m: f64) -> Option<usize> {
        let mut waiting = vec![(0, self.len() - 1)];
        while let Some((first, last)) = waiting.pop() {
            let looks: [usize; N_LOOKS] = std::array::from_fn(|nth| first + (last - first) * nth / (N_LOOKS - 1));
            let farthest_m = |moved_m: &[f64]| looks.windows(2).map(|w| moved_m[w[1]] - moved_m[w[0]]).fold(0.0, f64::max);
            let (ball_m, pair_m) = (farthest_m(&self.ball_moved_m), farthest_m(&self.pair_moved_m));
            let (ball_away_m, pair_away_m) = (0.5 * ball_m.max(step_m), 0.5 * pair_m.max(step_m));
            let configurations = looks.map(|idx| self.at(idx));
            if ball_away_m <= MAX_COARSE_M && world.is_clear_at(&configurations, ball_away_m, pair_away_m) {
                continue;
            }
            if pair_m <= step_m || last - first < N_LOOKS {
                return Some(last);
            }
            // The end first: there the arm is nearest to what it runs into.
            let middle = (first + last) / 2;
            waiting.extend([(first, middle), (middle, last)]);
        }
        None
    }

    /// At most `n` samples spread over the way, both ends among them.
    pub(super) fn spread(&self, n: usize) -> Vec<usize> {
        let n = n.min(self.len());
        (0..n).map(|nth| if n > 1 { (self.len() - 1) * nth / (n - 1) } else { 0 }).collect()
    }
}

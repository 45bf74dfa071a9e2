//! The way to rest, and whether anything is met on it.

use crate::collision::CollisionModel;

/// Configurations period by period until the arm rests.
pub(super) struct Way {
    pub(super) n_joints: usize,
    pub(super) q: Vec<f64>,
    /// How far anything can have moved since the first one, metres.
    pub(super) moved_m: Vec<f64>,
}

/// Looks taken together.
const N_LOOKS: usize = 8;
/// A stretch that must keep more than this from everything is split first, metres.
const MAX_COARSE_M: f64 = 0.05;

impl Way {
    pub(super) fn len(&self) -> usize {
        self.moved_m.len()
    }

    pub(super) fn at(&self, idx: usize) -> &[f64] {
        &self.q[idx * self.n_joints..(idx + 1) * self.n_joints]
    }

    /// A look near the first thing that is met: at each look things must be farther apart than half the way to the next one, and than
    /// half of `step_m`.
    pub(super) fn first_met(&self, world: &CollisionModel, step_m: f64) -> Option<usize> {
        let mut waiting = vec![(0, self.len() - 1)];
        while let Some((first, last)) = waiting.pop() {
            let looks: [usize; N_LOOKS] = std::array::from_fn(|nth| first + (last - first) * nth / (N_LOOKS - 1));
            let farthest_m = looks.windows(2).map(|w| self.moved_m[w[1]] - self.moved_m[w[0]]).fold(0.0, f64::max);
            let distance_m = 0.5 * farthest_m.max(step_m);
            if distance_m <= MAX_COARSE_M && world.is_clear_at(looks.map(|idx| self.at(idx)).as_slice(), distance_m) {
                continue;
            }
            if farthest_m <= step_m || last - first < N_LOOKS {
                return Some(last);
            }
            let middle = (first + last) / 2;
            waiting.extend([(middle, last), (first, middle)]);
        }
        None
    }

    /// At most `n` samples spread over the way, both ends among them.
    pub(super) fn spread(&self, n: usize) -> Vec<usize> {
        let n = n.min(self.len());
        (0..n).map(|nth| if n > 1 { (self.len() - 1) * nth / (n - 1) } else { 0 }).collect()
    }
}

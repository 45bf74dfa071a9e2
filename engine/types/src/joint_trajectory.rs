//! A timed arm motion.

/// Arm configurations over time.
///
/// | field | shape | unit |
/// |---|---|---|
/// | `stamps_secs` | n, ascending from 0 | s |
/// | `q` | n x joints | rad |
/// | `dq` | n x joints | rad/s |
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct JointTrajectory {
    /// Time of each sample after the start.
    pub stamps_secs: Vec<f64>,
    /// Joint positions in the order of the arm's chain.
    pub q: Vec<Vec<f64>>,
    /// Joint velocities.
    pub dq: Vec<Vec<f64>>,
}

impl JointTrajectory {
    /// Length in seconds.
    #[must_use]
    pub fn duration_secs(&self) -> f64 {
        self.stamps_secs.last().copied().unwrap_or(0.0)
    }

    /// Position and velocity at `t_secs`, linear between samples and at rest beyond the ends.
    ///
    /// # Panics
    /// If the trajectory has no sample.
    #[must_use]
    pub fn sample(&self, t_secs: f64) -> (Vec<f64>, Vec<f64>) {
        assert!(!self.q.is_empty(), "a trajectory has at least one sample");
        let last = self.q.len() - 1;
        if t_secs >= self.stamps_secs[last] {
            return (self.q[last].clone(), vec![0.0; self.q[last].len()]);
        }
        let next = self.stamps_secs.partition_point(|&stamp| stamp <= t_secs);
        if next == 0 {
            return (self.q[0].clone(), vec![0.0; self.q[0].len()]);
        }
        let (a, b) = (next - 1, next);
        let s = (t_secs - self.stamps_secs[a]) / (self.stamps_secs[b] - self.stamps_secs[a]);
        let mix = |x: &[f64], y: &[f64]| x.iter().zip(y).map(|(x, y)| x + s * (y - x)).collect();
        (mix(&self.q[a], &self.q[b]), mix(&self.dq[a], &self.dq[b]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sampling_interpolates_and_rests_beyond_the_ends() {
        let motion = JointTrajectory {
            stamps_secs: vec![0.0, 1.0, 3.0],
            q: vec![vec![0.0], vec![1.0], vec![2.0]],
            dq: vec![vec![0.0], vec![1.0], vec![0.5]],
        };
        assert_eq!(motion.sample(0.5), (vec![0.5], vec![0.5]));
        assert_eq!(motion.sample(2.0), (vec![1.5], vec![0.75]));
        assert_eq!(motion.sample(9.0), (vec![2.0], vec![0.0]));
        assert_eq!(motion.sample(-1.0), (vec![0.0], vec![0.0]));
    }
}

//! Inverse kinematics: damped least squares from a seed, then from random configurations, with counted budgets.

use crate::chain::{Chain, Frame};
use nalgebra::{Matrix6, Rotation3, Vector3, Vector6};
use rand::Rng;
use rand_chacha::ChaCha8Rng;
use sfg_types::Pose;

/// Budgets and tolerances.
#[derive(Clone, Debug, PartialEq)]
pub struct IkSettings {
    /// Largest distance of the tip from the target, metres. Default 1e-5, as in TRAC-IK's benchmark.
    pub position_tolerance_m: f64,
    /// Largest angle between tip and target, radians. Default 1e-5.
    pub rotation_tolerance_rad: f64,
    /// Steps of one descent. Default 60: nearly all descents that converge need fewer than 25.
    pub max_iterations: usize,
    /// Descents: one from the seed, the others from random configurations. Default 100.
    pub max_starts: usize,
    /// A solution is drawn towards this configuration by self-motion of the redundant arm; none by default.
    pub posture_q: Option<Vec<f64>>,
    /// Steps of that self-motion. Default 20.
    pub max_posture_steps: usize,
}

impl Default for IkSettings {
    fn default() -> Self {
        Self {
            position_tolerance_m: 1e-5,
            rotation_tolerance_rad: 1e-5,
            max_iterations: 60,
            max_starts: 100,
            posture_q: None,
            max_posture_steps: 20,
        }
    }
}

/// What came of it.
#[derive(Clone, Debug, PartialEq)]
pub enum IkOutcome {
    /// A configuration inside the position limits that reaches the target within the tolerances.
    Solved {
        /// The configuration.
        q: Vec<f64>,
        /// Descent steps over all starts.
        iterations: usize,
    },
    /// None was found within the budget.
    Failed {
        /// The nearest configuration met.
        best_q: Vec<f64>,
        /// Its distance from the target.
        position_miss_m: f64,
        /// Its angle to the target.
        rotation_miss_rad: f64,
    },
}

impl IkOutcome {
    /// The solution, if there is one.
    #[must_use]
    pub fn solution(self) -> Option<Vec<f64>> {
        match self {
            Self::Solved { q, .. } => Some(q),
            Self::Failed { .. } => None,
        }
    }
}

/// Inverse kinematics of a [`Chain`].
#[derive(Clone, Copy, Debug)]
pub struct IkSolver;

/// A radian weighs as much as this many metres: about the lever of the arm's wrist.
const METRES_PER_RADIAN: f64 = 0.3;
/// A descent that has not halved its error in this many steps is given up.
const STALL_STEPS: usize = 10;

impl IkSolver {
    /// A configuration whose tip is at `base_from_tip`.
    ///
    /// The first descent starts at `seed_q`, so that a target near the seed's pose gives a configuration near the seed; only
    /// further descents draw from `rng`.
    ///
    /// # Panics
    /// If `seed_q` or the posture has not one value for each joint.
    ///
    /// # Source
    /// Levenberg-Marquardt with error-proportional damping (Sugihara 2011), clamped to the limits with blocked joints left out.
    #[must_use]
    pub fn solve(chain: &Chain, base_from_tip: &Pose, seed_q: &[f64], settings: &IkSettings, rng: &mut ChaCha8Rng) -> IkOutcome {
        assert_eq!(seed_q.len(), chain.n_joints(), "one value for each joint");
        let mut descent = Descent::new(chain, base_from_tip, settings);
        let mut best: Option<(f64, Vec<f64>)> = None;
        let mut iterations = 0;
        for start in 0..settings.max_starts.max(1) {
            let mut q = if start == 0 { seed_q.to_vec() } else { random_q(chain, rng) };
            chain.clamp(&mut q);
            let solved = descent.run(&mut q, settings.max_iterations);
            iterations += descent.n_steps;
            if solved {
                descent.draw_to_posture(&mut q);
                return IkOutcome::Solved { q, iterations };
            }
            let (error, _) = descent.error(&q);
            if best.as_ref().is_none_or(|(least, _)| error.norm() < *least) {
                best = Some((error.norm(), q));
            }
        }
        let best_q = best.map_or_else(|| seed_q.to_vec(), |(_, q)| q);
        let (error, _) = descent.error(&best_q);
        IkOutcome::Failed {
            best_q,
            position_miss_m: error.fixed_rows::<3>(0).norm(),
            rotation_miss_rad: error.fixed_rows::<3>(3).norm() / METRES_PER_RADIAN,
        }
    }

    /// Up to `n` different solutions (each at least 0.1 rad from the others in some joint), nearest to `seed_q` first.
    ///
    /// # Panics
    /// As [`Self::solve`].
    #[must_use]
    pub fn solve_several(
        chain: &Chain,
        base_from_tip: &Pose,
        seed_q: &[f64],
        n: usize,
        settings: &IkSettings,
        rng: &mut ChaCha8Rng,
    ) -> Vec<Vec<f64>> {
        let mut descent = Descent::new(chain, base_from_tip, settings);
        let mut found: Vec<Vec<f64>> = Vec::new();
        for start in 0..settings.max_starts.max(1) {
            if found.len() >= n {
                break;
            }
            let mut q = if start == 0 { seed_q.to_vec() } else { random_q(chain, rng) };
            chain.clamp(&mut q);
            if descent.run(&mut q, settings.max_iterations) {
                descent.draw_to_posture(&mut q);
                if found.iter().all(|other| largest_gap(other, &q) > 0.1) {
                    found.push(q);
                }
            }
        }
        found.sort_by(|a, b| largest_gap(a, seed_q).total_cmp(&largest_gap(b, seed_q)));
        found
    }
}

/// A random configuration inside the position limits (within half a turn of 0 where there are none).
#[must_use]
pub fn random_q(chain: &Chain, rng: &mut ChaCha8Rng) -> Vec<f64> {
    let pi = std::f64::consts::PI;
    chain.limits.iter().map(|l| rng.random_range(l.lower.max(-pi)..=l.upper.min(pi).max(l.lower.max(-pi)))).collect()
}

fn largest_gap(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

struct Descent<'a> {
    chain: &'a Chain,
    settings: &'a IkSettings,
    target: Frame,
    columns: Vec<Vector6<f64>>,
    step: Vec<f64>,
    blocked: Vec<bool>,
    n_steps: usize,
}

impl<'a> Descent<'a> {
    fn new(chain: &'a Chain, base_from_tip: &Pose, settings: &'a IkSettings) -> Self {
        let n = chain.n_joints();
        Self {
            chain,
            settings,
            target: Frame::of(base_from_tip),
            columns: vec![Vector6::zeros(); n],
            step: vec![0.0; n],
            blocked: vec![false; n],
            n_steps: 0,
        }
    }

    /// Weighted error (metres) and whether it is within tolerance; leaves the weighted Jacobian in `columns`.
    fn error(&mut self, q: &[f64]) -> (Vector6<f64>, bool) {
        let tip = self.chain.tip_and_columns(q, &mut self.columns);
        for column in &mut self.columns {
            for row in 3..6 {
                column[row] *= METRES_PER_RADIAN;
            }
        }
        let linear = self.target.translation - tip.translation;
        let angular = rotation_vector(&(self.target.rotation * tip.rotation.transpose()));
        let within =
            linear.norm() <= self.settings.position_tolerance_m && angular.norm() <= self.settings.rotation_tolerance_rad;
        let angular = angular * METRES_PER_RADIAN;
        (Vector6::new(linear.x, linear.y, linear.z, angular.x, angular.y, angular.z), within)
    }

    /// Descends from `q`; true when the target is reached.
    fn run(&mut self, q: &mut [f64], max_iterations: usize) -> bool {
        let mut mark = f64::INFINITY;
        let mut steps_since_mark = 0;
        for iteration in 0..=max_iterations {
            self.n_steps = iteration;
            let (error, within) = self.error(q);
            if within {
                return true;
            }
            let size = error.norm();
            steps_since_mark += 1;
            if size < 0.5 * mark {
                (mark, steps_since_mark) = (size, 0);
            } else if steps_since_mark > STALL_STEPS {
                return false;
            }
            self.newton_step(&error, q);
            for ((value, step), limits) in q.iter_mut().zip(&self.step).zip(&self.chain.limits) {
                *value = (*value + step).clamp(limits.lower, limits.upper);
            }
        }
        false
    }

    /// Damped step towards less error; joints that would leave their limits are left out and the others take over.
    fn newton_step(&mut self, error: &Vector6<f64>, q: &[f64]) {
        let damping = 0.02 * error.norm_squared() + 1e-10;
        self.blocked.fill(false);
        for _ in 0..3 {
            let mut gram = Matrix6::identity() * damping;
            for (column, blocked) in self.columns.iter().zip(&self.blocked) {
                if !blocked {
                    gram.ger(1.0, column, column, 1.0);
                }
            }
            let Some(factor) = gram.cholesky() else {
                self.step.fill(0.0);
                return;
            };
            let y = factor.solve(error);
            let mut newly_blocked = false;
            for (idx, column) in self.columns.iter().enumerate() {
                let step = if self.blocked[idx] { 0.0 } else { column.dot(&y) };
                let limits = &self.chain.limits[idx];
                let leaves = (q[idx] <= limits.lower && step < 0.0) || (q[idx] >= limits.upper && step > 0.0);
                if leaves {
                    self.blocked[idx] = true;
                    newly_blocked = true;
                }
                // A step of more than a quarter turn says nothing any more.
                self.step[idx] = if leaves { 0.0 } else { step.clamp(-1.5, 1.5) };
            }
            if !newly_blocked {
                return;
            }
        }
    }

    /// Self-motion: moves `q` towards the posture while the tip stays at the target.
    fn draw_to_posture(&mut self, q: &mut Vec<f64>) {
        let Some(posture) = &self.settings.posture_q else { return };
        assert_eq!(posture.len(), q.len(), "one value for each joint");
        let distance = |q: &[f64]| q.iter().zip(posture).map(|(a, b)| (a - b).powi(2)).sum::<f64>();
        for _ in 0..self.settings.max_posture_steps {
            self.error(q);
            let gram = self.columns.iter().fold(Matrix6::identity() * 1e-8, |sum, c| sum + c * c.transpose());
            let Some(factor) = gram.cholesky() else { return };
            let pull: Vec<f64> = q.iter().zip(posture).map(|(q, p)| 0.3 * (p - q)).collect();
            let moved = self.columns.iter().zip(&pull).fold(Vector6::zeros(), |sum, (c, d)| sum + c * *d);
            let correction = factor.solve(&moved);
            let mut next: Vec<f64> = (0..q.len()).map(|i| q[i] + pull[i] - self.columns[i].dot(&correction)).collect();
            self.chain.clamp(&mut next);
            if !self.run(&mut next, 6) || distance(&next) > distance(q) - 1e-6 {
                return;
            }
            *q = next;
        }
    }
}

/// Axis times angle of a rotation matrix; a cheap form of the logarithm that is exact near 0 and safe near a half turn.
fn rotation_vector(rotation: &nalgebra::Matrix3<f64>) -> Vector3<f64> {
    let r = rotation;
    let skew = Vector3::new(r[(2, 1)] - r[(1, 2)], r[(0, 2)] - r[(2, 0)], r[(1, 0)] - r[(0, 1)]);
    let sin2 = skew.norm();
    let angle = sin2.atan2(r.trace() - 1.0);
    if sin2 < 1e-4 && angle > 1.0 {
        return Rotation3::from_matrix_unchecked(*r).scaled_axis();
    }
    if sin2 < 1e-9 { skew * 0.5 } else { skew * (angle / sin2) }
}

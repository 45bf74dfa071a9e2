//! Inverse kinematics: damped least squares from a seed, then from random configurations, with counted budgets.

use crate::chain::{Axes, Chain, Frame};
use nalgebra::{Rotation3, SMatrix, SVector, Vector3};
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
    /// A configuration inside the position limits that reaches the target (with every tip its own) within the tolerances.
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
        /// Its distance from the target, of the tip that is farthest from its own.
        position_miss_m: f64,
        /// Its angle to the target, likewise.
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
/// A tip this near its target, metres and weighted radians, keeps its joints while the others are drawn anew.
const NEARLY_THERE_M: f64 = 1e-3;
/// Every so many starts all joints are drawn anew, as what one tip keeps may be what keeps the other off.
const KEEPING_STARTS: usize = 4;

impl IkSolver {
    /// A configuration whose tip is at `base_from_tip`.
    ///
    /// The first descent starts at `seed_q`, so that a target near the seed's pose gives a configuration near the seed; only
    /// further descents draw from `rng`.
    ///
    /// # Panics
    /// If `seed_q` or the posture has not one value for each joint, or the chain has several tips.
    ///
    /// # Source
    /// Levenberg-Marquardt with error-proportional damping (Sugihara 2011), clamped to the limits with blocked joints left out.
    #[must_use]
    pub fn solve(chain: &Chain, base_from_tip: &Pose, seed_q: &[f64], settings: &IkSettings, rng: &mut ChaCha8Rng) -> IkOutcome {
        Self::solve_tips(chain, std::slice::from_ref(base_from_tip), seed_q, settings, rng)
    }

    /// As [`Self::solve`] with a target for each tip of the chain.
    ///
    /// Tips that share no joint are solved one after the other, with a budget each; tips that share some descend together.
    ///
    /// # Panics
    /// If a configuration has not one value for each joint, there is not one target for each tip, or more than four tips share
    /// joints.
    #[must_use]
    pub fn solve_tips(
        chain: &Chain,
        base_from_tips: &[Pose],
        seed_q: &[f64],
        settings: &IkSettings,
        rng: &mut ChaCha8Rng,
    ) -> IkOutcome {
        let mut best_q = seed_q.to_vec();
        let mut iterations = 0;
        let mut miss: Option<(f64, f64)> = None;
        for tips in tips_that_share_joints(chain, base_from_tips) {
            let island = Island { chain, settings, tips: &tips, base_from_tips };
            match island.solve(&best_q, rng) {
                IkOutcome::Solved { q, iterations: spent } => {
                    best_q = q;
                    iterations += spent;
                }
                IkOutcome::Failed { best_q: q, position_miss_m, rotation_miss_rad } => {
                    best_q = q;
                    let (metres, radians) = miss.unwrap_or((0.0, 0.0));
                    miss = Some((position_miss_m.max(metres), rotation_miss_rad.max(radians)));
                }
            }
        }
        match miss {
            None => IkOutcome::Solved { q: best_q, iterations },
            Some((position_miss_m, rotation_miss_rad)) => IkOutcome::Failed { best_q, position_miss_m, rotation_miss_rad },
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
        Self::solve_tips_several(chain, std::slice::from_ref(base_from_tip), seed_q, n, settings, rng)
    }

    /// As [`Self::solve_several`] with a target for each tip; where tips share no joint, each solution of one goes with each of
    /// the other.
    ///
    /// # Panics
    /// As [`Self::solve_tips`].
    #[must_use]
    pub fn solve_tips_several(
        chain: &Chain,
        base_from_tips: &[Pose],
        seed_q: &[f64],
        n: usize,
        settings: &IkSettings,
        rng: &mut ChaCha8Rng,
    ) -> Vec<Vec<f64>> {
        let nearest_first =
            |all: &mut Vec<Vec<f64>>| all.sort_by(|a, b| largest_gap(a, seed_q).total_cmp(&largest_gap(b, seed_q)));
        let mut all = vec![seed_q.to_vec()];
        for tips in tips_that_share_joints(chain, base_from_tips) {
            let island = Island { chain, settings, tips: &tips, base_from_tips };
            let mut found = island.solve_several(seed_q, n, rng);
            nearest_first(&mut found);
            let joints = island.joints();
            let with = |rest: &Vec<f64>, own: &Vec<f64>| {
                let mut q = rest.clone();
                joints.iter().for_each(|&idx| q[idx] = own[idx]);
                q
            };
            all = all.iter().flat_map(|rest| found.iter().map(|own| with(rest, own))).collect();
            nearest_first(&mut all);
            all.truncate(n);
        }
        all
    }
}

/// Tips in groups that share no joint with each other.
fn tips_that_share_joints(chain: &Chain, base_from_tips: &[Pose]) -> Vec<Vec<usize>> {
    assert_eq!(base_from_tips.len(), chain.n_tips(), "one target for each tip");
    let mut islands: Vec<Vec<usize>> = Vec::new();
    for tip in 0..chain.n_tips() {
        let shares = |island: &Vec<usize>| {
            island.iter().any(|other| (0..chain.n_joints()).any(|idx| chain.moves_tip(idx, tip) && chain.moves_tip(idx, *other)))
        };
        let (joined, apart): (Vec<_>, Vec<_>) = islands.into_iter().partition(shares);
        islands = apart;
        islands.push(joined.into_iter().flatten().chain([tip]).collect());
    }
    islands
}

/// Tips that are solved together.
struct Island<'a> {
    chain: &'a Chain,
    settings: &'a IkSettings,
    tips: &'a [usize],
    base_from_tips: &'a [Pose],
}

impl Island<'_> {
    /// The joints that move one of the tips.
    fn joints(&self) -> Vec<usize> {
        let moves = |idx: &usize| self.tips.iter().any(|tip| self.chain.moves_tip(*idx, *tip));
        (0..self.chain.n_joints()).filter(moves).collect()
    }

    fn solve(&self, seed_q: &[f64], rng: &mut ChaCha8Rng) -> IkOutcome {
        match self.tips.len() {
            1 => Descent::<6>::new(self).solve(seed_q, rng),
            2 => Descent::<12>::new(self).solve(seed_q, rng),
            3 => Descent::<18>::new(self).solve(seed_q, rng),
            4 => Descent::<24>::new(self).solve(seed_q, rng),
            n => panic!("{n} tips share joints; at most 4 can"),
        }
    }

    fn solve_several(&self, seed_q: &[f64], n: usize, rng: &mut ChaCha8Rng) -> Vec<Vec<f64>> {
        match self.tips.len() {
            1 => Descent::<6>::new(self).solve_several(seed_q, n, rng),
            2 => Descent::<12>::new(self).solve_several(seed_q, n, rng),
            3 => Descent::<18>::new(self).solve_several(seed_q, n, rng),
            4 => Descent::<24>::new(self).solve_several(seed_q, n, rng),
            n_tips => panic!("{n_tips} tips share joints; at most 4 can"),
        }
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

/// `ROWS` is six for each tip.
struct Descent<'a, const ROWS: usize> {
    chain: &'a Chain,
    settings: &'a IkSettings,
    tips: &'a [usize],
    targets: Vec<Frame>,
    // Those that move a tip.
    joints: Vec<usize>,
    axes: Axes,
    columns: Vec<SVector<f64, ROWS>>,
    step: Vec<f64>,
    blocked: Vec<bool>,
    n_steps: usize,
}

impl<'a, const ROWS: usize> Descent<'a, ROWS> {
    fn new(island: &Island<'a>) -> Self {
        let n = island.chain.n_joints();
        Self {
            chain: island.chain,
            settings: island.settings,
            tips: island.tips,
            targets: island.tips.iter().map(|tip| Frame::of(&island.base_from_tips[*tip])).collect(),
            joints: island.joints(),
            axes: Axes::new(),
            columns: vec![SVector::zeros(); n],
            step: vec![0.0; n],
            blocked: vec![false; n],
            n_steps: 0,
        }
    }

    fn solve(mut self, seed_q: &[f64], rng: &mut ChaCha8Rng) -> IkOutcome {
        assert_eq!(seed_q.len(), self.chain.n_joints(), "one value for each joint");
        let mut best: Option<(f64, Vec<f64>)> = None;
        let mut iterations = 0;
        let mut q = seed_q.to_vec();
        for start in 0..self.settings.max_starts.max(1) {
            self.begin(start, &mut q, rng);
            let solved = self.run(&mut q, self.settings.max_iterations);
            iterations += self.n_steps;
            if solved {
                self.draw_to_posture(&mut q);
                return IkOutcome::Solved { q, iterations };
            }
            let (error, _) = self.error(&q);
            if best.as_ref().is_none_or(|(least, _)| error.norm() < *least) {
                best = Some((error.norm(), q.clone()));
            }
        }
        let best_q = best.map_or_else(|| seed_q.to_vec(), |(_, q)| q);
        let (error, _) = self.error(&best_q);
        let farthest = |first: usize| {
            let norms = (0..self.tips.len()).map(|nth| error.fixed_rows::<3>(6 * nth + first).norm());
            norms.fold(0.0, f64::max)
        };
        IkOutcome::Failed { position_miss_m: farthest(0), rotation_miss_rad: farthest(3) / METRES_PER_RADIAN, best_q }
    }

    fn solve_several(mut self, seed_q: &[f64], n: usize, rng: &mut ChaCha8Rng) -> Vec<Vec<f64>> {
        let mut found: Vec<Vec<f64>> = Vec::new();
        let mut q = seed_q.to_vec();
        for start in 0..self.settings.max_starts.max(1) {
            if found.len() >= n {
                break;
            }
            self.begin(start, &mut q, rng);
            if self.run(&mut q, self.settings.max_iterations) {
                let mut drawn = q.clone();
                self.draw_to_posture(&mut drawn);
                if found.iter().all(|other| largest_gap(other, &drawn) > 0.1) {
                    found.push(drawn);
                }
            }
        }
        found
    }

    /// Where a descent starts: the first at `q` itself, the others at random, though tips that the last one brought near mostly
    /// keep their joints.
    fn begin(&mut self, start: usize, q: &mut [f64], rng: &mut ChaCha8Rng) {
        if start > 0 {
            let (error, within) = self.error(q);
            let keeps = !within && self.tips.len() > 1 && !start.is_multiple_of(KEEPING_STARTS);
            let is_kept = |idx: usize| {
                let is_near = |nth: &usize| error.fixed_rows::<6>(6 * nth).norm() < NEARLY_THERE_M;
                let moved = |nth: &usize| self.chain.moves_tip(idx, self.tips[*nth]);
                keeps && (0..self.tips.len()).filter(moved).any(|nth| is_near(&nth))
            };
            let random = random_q(self.chain, rng);
            self.joints.iter().filter(|idx| !is_kept(**idx)).for_each(|&idx| q[idx] = random[idx]);
        }
        self.chain.clamp(q);
    }

    /// Weighted error (metres) and whether it is within tolerance; leaves the weighted Jacobian in `columns`.
    fn error(&mut self, q: &[f64]) -> (SVector<f64, ROWS>, bool) {
        self.columns.fill(SVector::zeros());
        let mut error = SVector::<f64, ROWS>::zeros();
        let mut within = true;
        for (nth, (tip, target)) in self.tips.iter().zip(&self.targets).enumerate() {
            let columns = &mut self.columns;
            let tip = self.chain.tip_and_columns(*tip, q, &mut self.axes, |q_idx, part| {
                for row in 0..3 {
                    columns[q_idx][6 * nth + row] += part[row];
                    columns[q_idx][6 * nth + 3 + row] += part[3 + row] * METRES_PER_RADIAN;
                }
            });
            let linear = target.translation - tip.translation;
            let angular = rotation_vector(&(target.rotation * tip.rotation.transpose()));
            within &=
                linear.norm() <= self.settings.position_tolerance_m && angular.norm() <= self.settings.rotation_tolerance_rad;
            error.fixed_rows_mut::<3>(6 * nth).copy_from(&linear);
            error.fixed_rows_mut::<3>(6 * nth + 3).copy_from(&(angular * METRES_PER_RADIAN));
        }
        (error, within)
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
            for &idx in &self.joints {
                let limits = &self.chain.limits[idx];
                q[idx] = (q[idx] + self.step[idx]).clamp(limits.lower, limits.upper);
            }
        }
        false
    }

    /// Damped step towards less error; joints that would leave their limits are left out and the others take over.
    fn newton_step(&mut self, error: &SVector<f64, ROWS>, q: &[f64]) {
        let damping = 0.02 * error.norm_squared() + 1e-10;
        self.blocked.fill(false);
        for _ in 0..3 {
            let mut gram = SMatrix::<f64, ROWS, ROWS>::identity() * damping;
            for &idx in &self.joints {
                if !self.blocked[idx] {
                    let column = &self.columns[idx];
                    gram.ger(1.0, column, column, 1.0);
                }
            }
            let Some(factor) = gram.cholesky() else {
                self.step.fill(0.0);
                return;
            };
            let y = factor.solve(error);
            let mut newly_blocked = false;
            for &idx in &self.joints {
                let step = if self.blocked[idx] { 0.0 } else { self.columns[idx].dot(&y) };
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
        let joints = self.joints.clone();
        let distance = |q: &[f64]| joints.iter().map(|&idx| (q[idx] - posture[idx]).powi(2)).sum::<f64>();
        for _ in 0..self.settings.max_posture_steps {
            self.error(q);
            let gram = self.columns.iter().fold(SMatrix::identity() * 1e-8, |sum, c| sum + c * c.transpose());
            let Some(factor) = gram.cholesky() else { return };
            let mut pull = vec![0.0; q.len()];
            joints.iter().for_each(|&idx| pull[idx] = 0.3 * (posture[idx] - q[idx]));
            let moved = self.columns.iter().zip(&pull).fold(SVector::zeros(), |sum, (c, d)| sum + c * *d);
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

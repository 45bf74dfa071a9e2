//! Inverse kinematics of many targets: each begins at solutions of near ones.

use crate::chain::{Chain, JointLimits};
use crate::ik::{IkOutcome, IkSettings, IkSolver, random_q};
use rand_chacha::ChaCha8Rng;
use sfg_types::Pose;

/// A radian counts as this many metres when targets are compared: the same weight as in the descent.
const METRES_PER_RADIAN: f64 = 0.3;
/// Targets are visited along a curve through cubes of this edge, so that near ones follow each other.
const CUBE_M: f64 = 0.025;
/// Solutions looked at for each target: those found last.
const N_LOOK_BACK: usize = 64;
/// Solutions that a target begins at.
const N_SEEDS: usize = 3;

impl IkSolver {
    /// A configuration whose tip is at `base_from_tip`: one descent from each of `seeds`, then descents from random configurations.
    ///
    /// `settings.max_starts` counts all of them. A failure reports the nearest configuration met.
    ///
    /// # Panics
    /// If a seed or the posture has not one value for each joint.
    #[must_use]
    pub fn solve_from(
        chain: &Chain,
        base_from_tip: &Pose,
        seeds: &[&[f64]],
        settings: &IkSettings,
        rng: &mut ChaCha8Rng,
    ) -> IkOutcome {
        let one = IkSettings { max_starts: 1, ..settings.clone() };
        let mut nearest: Option<IkOutcome> = None;
        for seed_q in seeds.iter().take(settings.max_starts.max(1)) {
            let outcome = Self::solve(chain, base_from_tip, seed_q, &one, rng);
            if matches!(outcome, IkOutcome::Solved { .. }) {
                return outcome;
            }
            keep_nearer(&mut nearest, outcome);
        }
        let n_left = settings.max_starts.saturating_sub(seeds.len());
        if n_left > 0 || nearest.is_none() {
            let start_q = random_q(chain, rng);
            let rest = IkSettings { max_starts: n_left, ..settings.clone() };
            keep_nearer(&mut nearest, Self::solve(chain, base_from_tip, &start_q, &rest, rng));
        }
        nearest.unwrap_or_else(|| unreachable!("one descent at least was made"))
    }

    /// One outcome for each target, in their order. Each target begins at the solutions of the nearest targets solved
    /// before it, then at `seed_q`, then at random configurations.
    ///
    /// It pays where targets lie close: palm poses about one object, cells of a grid. The answers depend on the set of targets:
    /// take [`Self::solve`] where a target must give the same configuration by itself.
    ///
    /// # Panics
    /// As [`Self::solve`].
    #[must_use]
    pub fn solve_batch(
        chain: &Chain,
        base_from_tips: &[Pose],
        seed_q: &[f64],
        settings: &IkSettings,
        rng: &mut ChaCha8Rng,
    ) -> Vec<IkOutcome> {
        let mut order: Vec<usize> = (0..base_from_tips.len()).collect();
        order.sort_by_key(|idx| (place_on_curve(&base_from_tips[*idx]), *idx));
        let mut outcomes: Vec<Option<IkOutcome>> = vec![None; base_from_tips.len()];
        let mut solved: Vec<(usize, Vec<f64>)> = Vec::new();
        for idx in order {
            let target = &base_from_tips[idx];
            let look_back = &solved[solved.len().saturating_sub(N_LOOK_BACK)..];
            let mut near: Vec<(f64, &[f64])> =
                look_back.iter().map(|(other, q)| (distance_m(target, &base_from_tips[*other]), q.as_slice())).collect();
            near.sort_by(|a, b| a.0.total_cmp(&b.0));
            let seeds: Vec<&[f64]> = near.iter().take(N_SEEDS).map(|(_, q)| *q).chain([seed_q]).collect();
            let outcome = Self::solve_from(chain, target, &seeds, settings, rng);
            if let IkOutcome::Solved { q, .. } = &outcome {
                solved.push((idx, q.clone()));
            }
            outcomes[idx] = Some(outcome);
        }
        outcomes.into_iter().flatten().collect()
    }
}

/// Names of the joints that stand at a position limit.
#[must_use]
pub fn joints_at_limit(chain: &Chain, q: &[f64]) -> Vec<String> {
    let stands_at = |value: f64, limits: &JointLimits| value - limits.lower < 1e-6 || limits.upper - value < 1e-6;
    let all = chain.joint_names.iter().zip(q.iter().zip(&chain.limits));
    all.filter(|(_, (value, limits))| stands_at(**value, limits)).map(|(name, _)| name.clone()).collect()
}

fn keep_nearer(nearest: &mut Option<IkOutcome>, outcome: IkOutcome) {
    let miss_m = |outcome: &IkOutcome| match outcome {
        IkOutcome::Solved { .. } => -1.0,
        IkOutcome::Failed { position_miss_m, rotation_miss_rad, .. } => {
            position_miss_m.hypot(METRES_PER_RADIAN * rotation_miss_rad)
        }
    };
    if nearest.as_ref().is_none_or(|kept| miss_m(&outcome) < miss_m(kept)) {
        *nearest = Some(outcome);
    }
}

fn distance_m(a: &Pose, b: &Pose) -> f64 {
    (a.translation.vector - b.translation.vector).norm() + METRES_PER_RADIAN * a.rotation.angle_to(&b.rotation)
}

/// Place of a position on a Z-order curve: neighbours on it are near in space.
fn place_on_curve(pose: &Pose) -> u64 {
    let mut place = 0;
    for (axis, value) in pose.translation.vector.iter().enumerate() {
        let cube = ((value / CUBE_M).floor() + f64::from(1 << 19)).clamp(0.0, f64::from((1 << 20) - 1)) as u64;
        for bit in 0..20 {
            place |= (cube >> bit & 1) << (3 * bit + axis);
        }
    }
    place
}

//! Asking a map about a palm pose, and which arm reaches more of several.

use crate::chain::Chain;
use crate::ik::{IkOutcome, IkSettings, IkSolver, random_q};
use crate::reach::map::{Cell, ReachMap, base_from_shoulder};
use nalgebra::Vector3;
use rand::SeedableRng as _;
use rand_chacha::ChaCha8Rng;
use sfg_types::{HandSide, Point, Pose};

/// Rotations that count as near: of the eight voxels about a place, so 32 cells.
const N_NEAR: usize = 4;
/// Near cells whose configurations a descent begins at,
const N_DESCENTS: usize = 4;
/// when they differ by this much in some joint from those tried before.
const DIFFERENT_RAD: f64 = 0.5;
/// Steps of such a descent: those that converge take about five.
const STEPS: usize = 8;
/// A pose counts as reached within this,
const TOLERANCE_M: f64 = 1e-3;
/// and this.
const TOLERANCE_RAD: f64 = 3e-3;
/// A radian counts as this many metres when cells are ranked by nearness.
const METRES_PER_RADIAN: f64 = 0.3;

/// What a map says of a palm pose.
#[derive(Clone, Debug, PartialEq)]
pub struct ReachVerdict {
    /// Share of the near cells that the arm reaches, the nearer the more it counts: 0 to 1. High well inside the
    /// reach, low at its edge.
    pub score: f64,
    /// What descents from the configurations of near cells found, within 1 mm and 3 mrad; `None` when no near cell is reached, and
    /// the pose is hopeless.
    pub outcome: Option<IkOutcome>,
}

impl ReachVerdict {
    /// Whether a configuration was found.
    #[must_use]
    pub fn is_reachable(&self) -> bool {
        matches!(self.outcome, Some(IkOutcome::Solved { .. }))
    }
}

/// The 32 cells about a pose.
struct Near {
    score: f64,
    /// Those that are reached, with their distance.
    reached: [(f64, Cell); 8 * N_NEAR],
    n_reached: usize,
}

/// The voxel at the lower corner of the eight about a place, and how far the place is from it, in voxels.
type Corner = ([usize; 3], [f64; 3]);

impl ReachMap {
    /// The score of a palm pose, 0 to 1: see [`ReachVerdict::score`]. Below a microsecond; 0 is hopeless.
    #[must_use]
    pub fn score(&self, chain: &Chain, base_from_palm: &Pose) -> f64 {
        self.near(&(base_from_shoulder(chain).inverse() * base_from_palm)).score
    }

    /// Whether the arm reaches a palm pose within its joint limits, as descents from the map's own configurations find.
    ///
    /// "Reachable" comes with the configuration that proves it. "Not reachable" is the map's opinion, at 5 cm in about two poses
    /// of a thousand against inverse kinematics with all its random starts; where that matters, ask [`IkSolver::solve`].
    ///
    /// # Panics
    /// If the chain has another number of joints than the map's; [`ReachMap::load`] refuses such a map.
    #[must_use]
    pub fn verdict(&self, chain: &Chain, base_from_palm: &Pose) -> ReachVerdict {
        let mut near = self.near(&(base_from_shoulder(chain).inverse() * base_from_palm));
        let score = near.score;
        if near.n_reached == 0 {
            return ReachVerdict { score, outcome: None };
        }
        let reached = &mut near.reached[..near.n_reached];
        reached.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let settings = IkSettings {
            position_tolerance_m: TOLERANCE_M,
            rotation_tolerance_rad: TOLERANCE_RAD,
            max_iterations: STEPS,
            max_starts: N_DESCENTS,
            ..IkSettings::default()
        };
        let mut seeds: Vec<Vec<f64>> = Vec::with_capacity(N_DESCENTS);
        for (_, cell) in reached {
            let mut q = vec![0.0; chain.n_joints()];
            self.read_q(chain, *cell, &mut q);
            let differs = |other: &Vec<f64>| other.iter().zip(&q).any(|(a, b)| (a - b).abs() > DIFFERENT_RAD);
            if seeds.iter().all(differs) {
                seeds.push(q);
            }
            if seeds.len() == N_DESCENTS {
                break;
            }
        }
        let seeds: Vec<&[f64]> = seeds.iter().map(Vec::as_slice).collect();
        let settings = IkSettings { max_starts: seeds.len(), ..settings };
        // All starts are seeds: nothing is drawn.
        let mut rng = ChaCha8Rng::seed_from_u64(0);
        let outcome = IkSolver::solve_from(chain, base_from_palm, &seeds, &settings, &mut rng);
        ReachVerdict { score, outcome: Some(outcome) }
    }

    /// Share of the rotations with which the palm reaches a place, 0 to 1, between voxel centres linearly.
    #[must_use]
    pub fn share_at(&self, chain: &Chain, point_in_base: &Point) -> f64 {
        let in_shoulder = base_from_shoulder(chain).inverse() * point_in_base;
        let Some(corner) = self.corner(&in_shoulder.coords) else { return 0.0 };
        let share = |(voxel, weight, _): (usize, f64, f64)| weight * f64::from(self.masks[voxel].count_ones());
        self.corners(corner).map(share).sum::<f64>() / self.rotations().len() as f64
    }

    /// The corners of the map's box in the base frame.
    #[must_use]
    pub fn box_in_base(&self, chain: &Chain) -> [Point; 8] {
        let header = self.header();
        std::array::from_fn(|corner| {
            let at = Vector3::from_fn(|axis, _| {
                let n = if corner >> axis & 1 == 1 { header.size[axis] - 1 } else { 0 };
                header.origin_in_shoulder_m[axis] + n as f64 * header.resolution_m
            });
            base_from_shoulder(chain) * Point::from(at)
        })
    }

    fn corner(&self, in_shoulder: &Vector3<f64>) -> Option<Corner> {
        let header = self.header();
        let (mut lower, mut share) = ([0; 3], [0.0; 3]);
        for axis in 0..3 {
            let at = (in_shoulder[axis] - header.origin_in_shoulder_m[axis]) / header.resolution_m;
            // Written so that a NaN is outside.
            if !(at >= 0.0 && at < (header.size[axis] - 1) as f64) {
                return None;
            }
            lower[axis] = at as usize;
            share[axis] = at - lower[axis] as f64;
        }
        Some((lower, share))
    }

    /// The eight voxels about a place: index, weight and squared distance in voxels.
    fn corners(&self, (lower, share): Corner) -> impl Iterator<Item = (usize, f64, f64)> {
        (0..8_usize).map(move |corner| {
            let (mut at, mut weight, mut squared) = (lower, 1.0, 0.0);
            for axis in 0..3 {
                let is_upper = corner >> axis & 1;
                at[axis] += is_upper;
                let gap = if is_upper == 1 { 1.0 - share[axis] } else { share[axis] };
                weight *= 1.0 - gap;
                squared += gap * gap;
            }
            (self.voxel(at), weight, squared)
        })
    }

    fn near(&self, shoulder_from_palm: &Pose) -> Near {
        let mut near = Near { score: 0.0, reached: [(0.0, (0, 0)); 8 * N_NEAR], n_reached: 0 };
        let Some(corner) = self.corner(&shoulder_from_palm.translation.vector) else { return near };
        // Likeness is the cosine of half the angle between; the fifth is the zero from which the nearest four are weighed, so that
        // the score has no jump where another becomes the fourth.
        let mut best = [(-1.0, 0); N_NEAR + 1];
        for (idx, rotation) in self.rotations().iter().enumerate() {
            let likeness = rotation.coords.dot(&shoulder_from_palm.rotation.coords).abs();
            let mut place = N_NEAR + 1;
            while place > 0 && best[place - 1].0 < likeness {
                place -= 1;
            }
            if place <= N_NEAR {
                best[place..].rotate_right(1);
                best[place] = (likeness, idx);
            }
        }
        let weight_of = |likeness: f64| likeness - best[N_NEAR].0 + 1e-9;
        let total: f64 = best[..N_NEAR].iter().map(|(likeness, _)| weight_of(*likeness)).sum();
        for (voxel, weight, squared) in self.corners(corner) {
            for (likeness, rotation) in &best[..N_NEAR] {
                if self.is_reached((voxel, *rotation)) {
                    near.score += weight * weight_of(*likeness) / total;
                    let angle = 2.0 * likeness.min(1.0).acos();
                    let distance_m = self.header().resolution_m * squared.sqrt() + METRES_PER_RADIAN * angle;
                    near.reached[near.n_reached] = (distance_m, (voxel, *rotation));
                    near.n_reached += 1;
                }
            }
        }
        // The weights add up to one but for rounding.
        near.score = near.score.min(1.0);
        near
    }
}

/// How many of some palm poses an arm reaches, and how well.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ReachCount {
    /// Poses that it reaches.
    pub n_reached: usize,
    /// Sum over these of the score, or of 1 where there is no map.
    pub score: f64,
}

impl ReachCount {
    /// Counts with a map.
    #[must_use]
    pub fn by_map(map: &ReachMap, chain: &Chain, base_from_palms: &[Pose]) -> Self {
        base_from_palms
            .iter()
            .map(|pose| map.verdict(chain, pose))
            .filter(ReachVerdict::is_reachable)
            .fold(Self::default(), |count, verdict| Self { n_reached: count.n_reached + 1, score: count.score + verdict.score })
    }

    /// Counts without a map, by inverse kinematics.
    #[must_use]
    pub fn by_ik(chain: &Chain, base_from_palms: &[Pose], settings: &IkSettings, rng: &mut ChaCha8Rng) -> Self {
        let start_q = random_q(chain, rng);
        let outcomes = IkSolver::solve_batch(chain, base_from_palms, &start_q, settings, rng);
        let n_reached = outcomes.iter().filter(|outcome| matches!(outcome, IkOutcome::Solved { .. })).count();
        Self { n_reached, score: n_reached as f64 }
    }
}

/// The arm that reaches more of its palm poses; of two that reach as many the one with the better score, the left one if that is
/// equal too. `None` when neither reaches any.
#[must_use]
pub fn better_arm(left: &ReachCount, right: &ReachCount) -> Option<HandSide> {
    if left.n_reached == 0 && right.n_reached == 0 {
        return None;
    }
    let order = left.n_reached.cmp(&right.n_reached).then(left.score.total_cmp(&right.score));
    Some(if order.is_lt() { HandSide::Right } else { HandSide::Left })
}

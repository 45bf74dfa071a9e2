//! From a configuration to one of several goals without touching anything.

use crate::collision::{CollisionModel, Contact, distance, mix};
use crate::keep::{KeepAxis, project};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// What a planner answers.
#[derive(Clone, Debug, PartialEq)]
pub enum PlanOutcome {
    /// A path from the start to one of the goals, free at the acceptance resolution: corners, joined by straight ways.
    Found(Vec<Vec<f64>>),
    /// The start touches something: the arm must first be freed.
    StartInCollision {
        /// The deepest contact.
        contact: Contact,
    },
    /// Every goal inside the limits touches something; this is the first one's deepest contact.
    GoalInCollision {
        /// Index of the goal.
        goal_idx: usize,
        /// Its deepest contact.
        contact: Contact,
    },
    /// The start, or every goal, leaves the position limits.
    OutsideLimits {
        /// Joint of the first offender.
        joint: String,
        /// Its value, radians.
        value: f64,
        /// Lower limit.
        lower: f64,
        /// Upper limit.
        upper: f64,
    },
    /// The start, or every goal that is inside the limits and free, turns an axis farther than it may.
    AxisNotKept {
        /// Index of the first such goal; `None` for the start.
        goal_idx: Option<usize>,
        /// Link at the tip.
        tip: String,
        /// The angle, radians.
        angle_rad: f64,
        /// The largest allowed one.
        max_angle_rad: f64,
    },
    /// The budget is used up (or there was no goal).
    NotFound {
        /// Iterations spent.
        iterations: usize,
    },
}

/// The seam between skills and path planners: replace the algorithm, keep the contract.
///
/// A planner must return the same answer for the same inputs and seed, count its budget in iterations and not in time, and
/// return only paths whose every point, at 512 checks for each radian, is free in `collision` and inside the chain's limits.
pub trait Planner: Send {
    /// Plans from `start` to whichever of `goals` is cheapest to reach.
    fn plan(&self, collision: &CollisionModel, start: &[f64], goals: &[Vec<f64>], seed: u64) -> PlanOutcome;
}

/// Budgets and resolutions of [`RrtConnect`].
#[derive(Clone, Debug, PartialEq)]
pub struct RrtSettings {
    /// Growth steps of all searches together. Default 20,000.
    pub max_iterations: usize,
    /// Growth steps after which a search begins anew with other samples: an unlucky tree seldom recovers. Default 4000.
    pub restart_after: usize,
    /// Longest growth step. Default 1 rad.
    pub range_rad: f64,
    /// Distance of checks while searching. Default 1/32 rad.
    pub edge_step_rad: f64,
    /// Checks for each radian of the returned path. Default 512: at 32, one path in twenty touches something in between.
    pub acceptance_checks_per_rad: f64,
    /// Attempts to cut a corner. Default 60.
    pub shortcut_attempts: usize,
    /// Axes of tips to keep near a direction along the whole way. None by default.
    pub keep_axes: Vec<KeepAxis>,
    /// Longest growth step while axes are kept: the way to a projected sample is straight. Default 0.3 rad.
    pub keep_range_rad: f64,
}

impl Default for RrtSettings {
    fn default() -> Self {
        Self {
            max_iterations: 20_000,
            restart_after: 4000,
            range_rad: 1.0,
            edge_step_rad: 1.0 / 32.0,
            acceptance_checks_per_rad: 512.0,
            shortcut_attempts: 60,
            keep_axes: Vec::new(),
            keep_range_rad: 0.3,
        }
    }
}

/// Two trees that grow towards each other (Kuffner and LaValle 2000), then shortcuts, then acceptance at a fine resolution.
///
/// A path that fails the acceptance is searched again with checks half as far apart.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RrtConnect {
    /// Budgets and resolutions.
    pub settings: RrtSettings,
}

/// A path as the search found it.
#[derive(Clone, Debug, PartialEq)]
pub struct RawPath {
    /// Corners from the start to a goal.
    pub path: Vec<Vec<f64>>,
    /// Growth steps it took.
    pub iterations: usize,
}

/// Configurations in a row, each with its parent.
struct Nodes {
    n_joints: usize,
    q: Vec<f64>,
    parents: Vec<Option<usize>>,
}

impl Nodes {
    fn new<'a>(n_joints: usize, roots: impl IntoIterator<Item = &'a [f64]>) -> Self {
        let q: Vec<f64> = roots.into_iter().flatten().copied().collect();
        let parents = vec![None; q.len() / n_joints];
        Self { n_joints, q, parents }
    }

    fn get(&self, idx: usize) -> &[f64] {
        &self.q[idx * self.n_joints..(idx + 1) * self.n_joints]
    }

    fn nearest(&self, q: &[f64]) -> usize {
        let mut best = (f64::INFINITY, 0);
        for (idx, node) in self.q.chunks_exact(self.n_joints).enumerate() {
            let gap: f64 = node.iter().zip(q).map(|(a, b)| (a - b) * (a - b)).sum();
            if gap < best.0 {
                best = (gap, idx);
            }
        }
        best.1
    }

    fn add(&mut self, q: &[f64], parent: usize) -> usize {
        self.q.extend_from_slice(q);
        self.parents.push(Some(parent));
        self.parents.len() - 1
    }

    fn branch(&self, mut idx: usize) -> Vec<Vec<f64>> {
        let mut path = vec![self.get(idx).to_vec()];
        while let Some(parent) = self.parents[idx] {
            path.push(self.get(parent).to_vec());
            idx = parent;
        }
        path
    }
}

/// Halton's points in a box, moved round by an offset that the seed draws: they fill the box more evenly than random ones.
struct Halton {
    lower: Vec<f64>,
    width: Vec<f64>,
    offset: Vec<f64>,
    n_drawn: u32,
}

/// Bases of the axes.
const PRIMES: [u32; 24] = [2, 3, 5, 7, 11, 13, 17, 19, 23, 29, 31, 37, 41, 43, 47, 53, 59, 61, 67, 71, 73, 79, 83, 89];

impl Halton {
    fn new(collision: &CollisionModel, seed: u64) -> Self {
        let pi = std::f64::consts::PI;
        let limits = &collision.chain().limits;
        let lower: Vec<f64> = limits.iter().map(|l| l.lower.max(-pi)).collect();
        let width = limits.iter().zip(&lower).map(|(l, low)| (l.upper.min(pi) - low).max(0.0)).collect();
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let offset = lower.iter().map(|_| rng.random_range(0.0..1.0)).collect();
        Self { lower, width, offset, n_drawn: 0 }
    }

    fn draw(&mut self, q: &mut [f64]) {
        self.n_drawn += 1;
        for (axis, value) in q.iter_mut().enumerate() {
            let base = PRIMES[axis % PRIMES.len()];
            let (mut left, mut share, mut inverse) = (self.n_drawn, 1.0, 0.0);
            while left > 0 {
                share /= f64::from(base);
                inverse += share * f64::from(left % base);
                left /= base;
            }
            *value = self.lower[axis] + self.width[axis] * (inverse + self.offset[axis]).fract();
        }
    }
}

impl Planner for RrtConnect {
    fn plan(&self, collision: &CollisionModel, start: &[f64], goals: &[Vec<f64>], seed: u64) -> PlanOutcome {
        let acceptance_step = 1.0 / self.settings.acceptance_checks_per_rad;
        let mut step = self.settings.edge_step_rad;
        let mut iterations = 0;
        for attempt in 0.. {
            let seed = seed.wrapping_add(attempt);
            let raw = match self.search(collision, start, goals, step, seed) {
                Ok(raw) => raw,
                Err(PlanOutcome::NotFound { iterations: spent }) => {
                    iterations += spent;
                    if spent == 0 || iterations >= self.settings.max_iterations {
                        break;
                    }
                    continue;
                }
                Err(outcome) => return outcome,
            };
            iterations += raw.iterations;
            let path = self.simplify(collision, raw.path, step, seed);
            if self.accepts(collision, &path) {
                return PlanOutcome::Found(path);
            }
            if step <= acceptance_step || iterations > self.settings.max_iterations {
                break;
            }
            step = (step / 2.0).max(acceptance_step);
        }
        PlanOutcome::NotFound { iterations }
    }
}

impl RrtConnect {
    /// A path that is free when looked at every `step_rad`, from one pair of trees.
    ///
    /// # Errors
    /// Every [`PlanOutcome`] but `Found`.
    pub fn search(
        &self,
        collision: &CollisionModel,
        start: &[f64],
        goals: &[Vec<f64>],
        step_rad: f64,
        seed: u64,
    ) -> Result<RawPath, PlanOutcome> {
        let free_goals = self.free_ends(collision, start, goals)?;
        if let Some(goal) = free_goals.iter().find(|goal| self.is_good_between(collision, start, goal, step_rad)) {
            return Ok(RawPath { path: vec![start.to_vec(), goal.to_vec()], iterations: 0 });
        }
        let n = start.len();
        let mut growing = Nodes::new(n, [start]);
        let mut other = Nodes::new(n, free_goals.iter().map(|goal| goal.as_slice()));
        let mut growing_is_start = true;
        let mut halton = Halton::new(collision, seed);
        let (mut sample, mut next) = (vec![0.0; n], vec![0.0; n]);
        let most = self.settings.restart_after.min(self.settings.max_iterations);
        for iteration in 1..=most {
            halton.draw(&mut sample);
            let from = growing.nearest(&sample);
            if let Some(new) = self.extend(collision, &mut growing, from, &sample, step_rad, &mut next) {
                // The other tree runs towards the new node until it arrives or is blocked.
                let target = growing.get(new).to_vec();
                let mut reached = other.nearest(&target);
                while distance(other.get(reached), &target) > 1e-9 {
                    match self.extend(collision, &mut other, reached, &target, step_rad, &mut next) {
                        Some(further) => reached = further,
                        None => break,
                    }
                }
                if distance(other.get(reached), &target) <= 1e-9 {
                    let (mut a, mut b) = (growing.branch(new), other.branch(reached));
                    if !growing_is_start {
                        std::mem::swap(&mut a, &mut b);
                    }
                    a.reverse();
                    a.extend(b.into_iter().skip(1));
                    return Ok(RawPath { path: a, iterations: iteration });
                }
            }
            // The smaller tree grows next.
            if growing.parents.len() > other.parents.len() {
                std::mem::swap(&mut growing, &mut other);
                growing_is_start = !growing_is_start;
            }
        }
        Err(PlanOutcome::NotFound { iterations: most })
    }

    /// Whether the straight way is free and keeps the axes, looked at every `step_rad`.
    fn is_good_between(&self, collision: &CollisionModel, a: &[f64], b: &[f64], step_rad: f64) -> bool {
        self.settings.keep_axes.iter().all(|keep| keep.holds_between(collision.chain(), a, b, step_rad))
            && collision.is_free_between(a, b, step_rad)
    }

    /// The node at `target`, or one step towards it, moved to where the axes are kept.
    fn extend(
        &self,
        collision: &CollisionModel,
        tree: &mut Nodes,
        from: usize,
        target: &[f64],
        step_rad: f64,
        next: &mut [f64],
    ) -> Option<usize> {
        let at = tree.get(from);
        let keep_axes = &self.settings.keep_axes;
        let range_rad = if keep_axes.is_empty() { self.settings.range_rad } else { self.settings.keep_range_rad };
        let gap = distance(at, target);
        let share = (range_rad / gap.max(1e-12)).min(1.0);
        for ((next, a), b) in next.iter_mut().zip(at).zip(target) {
            // The very target when it is reached.
            *next = if share < 1.0 { a + share * (b - a) } else { *b };
        }
        if !keep_axes.is_empty() {
            // What is projected back to where it came from is no step.
            let is_step =
                project(keep_axes, collision.chain(), next) && gap - distance(next, target) > LEAST_STEP * range_rad.min(gap);
            if !is_step {
                return None;
            }
        }
        self.is_good_between(collision, at, next, step_rad).then(|| tree.add(next, from))
    }

    /// A shorter path through fewer corners, free when looked at every `step_rad`.
    #[must_use]
    pub fn simplify(&self, collision: &CollisionModel, path: Vec<Vec<f64>>, step_rad: f64, seed: u64) -> Vec<Vec<f64>> {
        let mut path = path;
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        self.skip_corners(collision, &mut path, step_rad);
        for _ in 0..self.settings.shortcut_attempts {
            if path.len() < 3 {
                break;
            }
            let length: f64 = path.windows(2).map(|w| distance(&w[0], &w[1])).sum();
            let (a, b) = (rng.random_range(0.0..length), rng.random_range(0.0..length));
            let ((i, q_a), (j, q_b)) = (point_at(&path, a.min(b)), point_at(&path, a.max(b)));
            // What is nearly straight already costs a check and saves nothing.
            let is_worthwhile = distance(&q_a, &q_b) < (1.0 - LEAST_GAIN) * (a - b).abs();
            if i == j || !is_worthwhile || !self.is_good_between(collision, &q_a, &q_b, step_rad) {
                continue;
            }
            path.splice(i + 1..=j, [q_a, q_b]);
        }
        path.dedup_by(|a, b| distance(a, b) < 1e-9);
        self.skip_corners(collision, &mut path, step_rad);
        path
    }

    /// Whether the path is free and keeps the axes at the acceptance resolution.
    #[must_use]
    pub fn accepts(&self, collision: &CollisionModel, path: &[Vec<f64>]) -> bool {
        let step_rad = 1.0 / self.settings.acceptance_checks_per_rad;
        let keeps = |a: &[f64], b: &[f64]| {
            self.settings.keep_axes.iter().all(|keep| keep.holds_between(collision.chain(), a, b, step_rad))
        };
        path.windows(2).all(|pair| collision.is_free_closely(&pair[0], &pair[1], step_rad) && keeps(&pair[0], &pair[1]))
    }

    /// Leaves out every corner that can be left out.
    fn skip_corners(&self, collision: &CollisionModel, path: &mut Vec<Vec<f64>>, step_rad: f64) {
        let mut idx = 1;
        while idx + 1 < path.len() {
            if self.is_good_between(collision, &path[idx - 1], &path[idx + 1], step_rad) {
                path.remove(idx);
                idx = idx.saturating_sub(1).max(1);
            } else {
                idx += 1;
            }
        }
    }

    /// The goals that can be reached at all, the nearest first; or why there are none.
    fn free_ends<'a>(
        &self,
        collision: &CollisionModel,
        start: &[f64],
        goals: &'a [Vec<f64>],
    ) -> Result<Vec<&'a Vec<f64>>, PlanOutcome> {
        if let Some(outcome) = outside_limits(collision, start) {
            return Err(outcome);
        }
        if let Some(contact) = collision.contact(start) {
            return Err(PlanOutcome::StartInCollision { contact });
        }
        if let Some(outcome) = self.axis_not_kept(collision, start, None) {
            return Err(outcome);
        }
        let mut free = Vec::new();
        let (mut first_turned, mut first_contact, mut first_outside) = (None, None, None);
        for (goal_idx, goal) in goals.iter().enumerate() {
            if let Some(outcome) = outside_limits(collision, goal) {
                first_outside.get_or_insert(outcome);
            } else if let Some(contact) = collision.contact(goal) {
                first_contact.get_or_insert(PlanOutcome::GoalInCollision { goal_idx, contact });
            } else if let Some(outcome) = self.axis_not_kept(collision, goal, Some(goal_idx)) {
                first_turned.get_or_insert(outcome);
            } else {
                free.push(goal);
            }
        }
        if free.is_empty() {
            return Err(first_turned.or(first_contact).or(first_outside).unwrap_or(PlanOutcome::NotFound { iterations: 0 }));
        }
        free.sort_by(|a, b| distance(start, a).total_cmp(&distance(start, b)));
        Ok(free)
    }

    fn axis_not_kept(&self, collision: &CollisionModel, q: &[f64], goal_idx: Option<usize>) -> Option<PlanOutcome> {
        let chain = collision.chain();
        let keep = self.settings.keep_axes.iter().find(|keep| !keep.holds(chain, q))?;
        Some(PlanOutcome::AxisNotKept {
            goal_idx,
            tip: chain.tip_names[keep.tip_idx].clone(),
            angle_rad: keep.angle_rad(chain, q),
            max_angle_rad: keep.max_angle_rad,
        })
    }
}

/// A shortcut saves at least this share of the way that it replaces.
const LEAST_GAIN: f64 = 0.02;
/// A growth step gains at least this share of its length on its target after it was projected.
const LEAST_STEP: f64 = 0.1;

/// The segment and the configuration at arc length `at` of a path.
fn point_at(path: &[Vec<f64>], at: f64) -> (usize, Vec<f64>) {
    let mut left = at;
    for (idx, pair) in path.windows(2).enumerate() {
        let length = distance(&pair[0], &pair[1]);
        if left <= length || idx + 2 == path.len() {
            return (idx, mix(&pair[0], &pair[1], (left / length.max(1e-12)).min(1.0)));
        }
        left -= length;
    }
    (0, path[0].clone())
}

fn outside_limits(collision: &CollisionModel, q: &[f64]) -> Option<PlanOutcome> {
    let chain = collision.chain();
    assert_eq!(q.len(), chain.n_joints(), "one value for each joint");
    let idx = q.iter().zip(&chain.limits).position(|(v, l)| !(l.lower - 1e-9..=l.upper + 1e-9).contains(v))?;
    let limits = &chain.limits[idx];
    Some(PlanOutcome::OutsideLimits {
        joint: chain.joint_names[idx].clone(),
        value: q[idx],
        lower: limits.lower,
        upper: limits.upper,
    })
}

//! From a configuration to one of several goals without touching anything.

use crate::collision::{CollisionModel, Contact, distance, mix};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use sfg_kinematics::ik::random_q;

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
    /// Growth steps of both trees together. Default 4000.
    pub max_iterations: usize,
    /// Longest growth step. Default 0.5 rad.
    pub range_rad: f64,
    /// Distance of checks while searching. Default 0.02 rad.
    pub edge_step_rad: f64,
    /// Checks for each radian of the returned path. Default 512: at 32, one path in twenty touches something in between.
    pub acceptance_checks_per_rad: f64,
    /// Attempts to cut a corner. Default 60.
    pub shortcut_attempts: usize,
}

impl Default for RrtSettings {
    fn default() -> Self {
        Self {
            max_iterations: 4000,
            range_rad: 0.5,
            edge_step_rad: 0.02,
            acceptance_checks_per_rad: 512.0,
            shortcut_attempts: 60,
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

struct Tree {
    nodes: Vec<Vec<f64>>,
    parents: Vec<Option<usize>>,
}

impl Tree {
    fn nearest(&self, q: &[f64]) -> usize {
        let mut best = (f64::INFINITY, 0);
        for (idx, node) in self.nodes.iter().enumerate() {
            let gap: f64 = node.iter().zip(q).map(|(a, b)| (a - b) * (a - b)).sum();
            if gap < best.0 {
                best = (gap, idx);
            }
        }
        best.1
    }

    fn add(&mut self, q: Vec<f64>, parent: usize) -> usize {
        self.nodes.push(q);
        self.parents.push(Some(parent));
        self.nodes.len() - 1
    }

    fn branch(&self, mut idx: usize) -> Vec<Vec<f64>> {
        let mut path = vec![self.nodes[idx].clone()];
        while let Some(parent) = self.parents[idx] {
            path.push(self.nodes[parent].clone());
            idx = parent;
        }
        path
    }
}

impl Planner for RrtConnect {
    fn plan(&self, collision: &CollisionModel, start: &[f64], goals: &[Vec<f64>], seed: u64) -> PlanOutcome {
        if let Some(outcome) = outside_limits(collision, start) {
            return outcome;
        }
        if let Some(contact) = collision.contact(start) {
            return PlanOutcome::StartInCollision { contact };
        }
        let mut free_goals = Vec::new();
        let (mut first_contact, mut first_outside) = (None, None);
        for (goal_idx, goal) in goals.iter().enumerate() {
            if let Some(outcome) = outside_limits(collision, goal) {
                first_outside.get_or_insert(outcome);
            } else if let Some(contact) = collision.contact(goal) {
                first_contact.get_or_insert(PlanOutcome::GoalInCollision { goal_idx, contact });
            } else {
                free_goals.push(goal.clone());
            }
        }
        if free_goals.is_empty() {
            return first_contact.or(first_outside).unwrap_or(PlanOutcome::NotFound { iterations: 0 });
        }
        free_goals.sort_by(|a, b| distance(start, a).total_cmp(&distance(start, b)));
        let acceptance_step = 1.0 / self.settings.acceptance_checks_per_rad;
        let mut step = self.settings.edge_step_rad;
        let mut iterations = 0;
        for attempt in 0.. {
            let mut rng = ChaCha8Rng::seed_from_u64(seed.wrapping_add(attempt));
            let Some(mut path) = self.search(collision, start, &free_goals, step, &mut rng, &mut iterations) else { break };
            self.shortcut(collision, &mut path, step, &mut rng);
            if collision.contact_along(&path, acceptance_step).is_none() {
                return PlanOutcome::Found(path);
            }
            if step <= acceptance_step {
                break;
            }
            step = (step / 2.0).max(acceptance_step);
        }
        PlanOutcome::NotFound { iterations }
    }
}

impl RrtConnect {
    fn search(
        &self,
        collision: &CollisionModel,
        start: &[f64],
        goals: &[Vec<f64>],
        step: f64,
        rng: &mut ChaCha8Rng,
        iterations: &mut usize,
    ) -> Option<Vec<Vec<f64>>> {
        if let Some(goal) = goals.iter().find(|goal| collision.contact_between(start, goal, step).is_none()) {
            return Some(vec![start.to_vec(), goal.clone()]);
        }
        let mut growing = Tree { nodes: vec![start.to_vec()], parents: vec![None] };
        let mut other = Tree { nodes: goals.to_vec(), parents: vec![None; goals.len()] };
        let mut growing_is_start = true;
        while *iterations < self.settings.max_iterations {
            *iterations += 1;
            let sample = random_q(collision.chain(), rng);
            if let Some(new) = self.extend(collision, &mut growing, &sample, step) {
                let target = growing.nodes[new].clone();
                // The other tree runs towards the new node until it arrives or is blocked.
                let mut reached = other.nearest(&target);
                while distance(&other.nodes[reached], &target) > 1e-9 {
                    match self.extend_from(collision, &mut other, reached, &target, step) {
                        Some(next) => reached = next,
                        None => break,
                    }
                }
                if distance(&other.nodes[reached], &target) <= 1e-9 {
                    let (mut a, mut b) = (growing.branch(new), other.branch(reached));
                    if !growing_is_start {
                        std::mem::swap(&mut a, &mut b);
                    }
                    a.reverse();
                    a.extend(b.into_iter().skip(1));
                    return Some(a);
                }
            }
            // The smaller tree grows next.
            if growing.nodes.len() > other.nodes.len() {
                std::mem::swap(&mut growing, &mut other);
                growing_is_start = !growing_is_start;
            }
        }
        None
    }

    fn extend(&self, collision: &CollisionModel, tree: &mut Tree, target: &[f64], step: f64) -> Option<usize> {
        let from = tree.nearest(target);
        self.extend_from(collision, tree, from, target, step)
    }

    fn extend_from(&self, collision: &CollisionModel, tree: &mut Tree, from: usize, target: &[f64], step: f64) -> Option<usize> {
        let gap = distance(&tree.nodes[from], target);
        let q = if gap <= self.settings.range_rad {
            target.to_vec()
        } else {
            mix(&tree.nodes[from], target, self.settings.range_rad / gap)
        };
        collision.contact_between(&tree.nodes[from], &q, step).is_none().then(|| tree.add(q, from))
    }

    /// Replaces stretches between random points of the path by straight ways.
    fn shortcut(&self, collision: &CollisionModel, path: &mut Vec<Vec<f64>>, step: f64, rng: &mut ChaCha8Rng) {
        for _ in 0..self.settings.shortcut_attempts {
            if path.len() < 3 {
                return;
            }
            let length: f64 = path.windows(2).map(|w| distance(&w[0], &w[1])).sum();
            let (a, b) = (rng.random_range(0.0..length), rng.random_range(0.0..length));
            let ((i, q_a), (j, q_b)) = (point_at(path, a.min(b)), point_at(path, a.max(b)));
            if i == j || collision.contact_between(&q_a, &q_b, step).is_some() {
                continue;
            }
            path.splice(i + 1..=j, [q_a, q_b]);
        }
        path.dedup_by(|a, b| distance(a, b) < 1e-9);
        // Corners that the cuts left behind: each one that can be skipped is.
        let mut idx = 1;
        while idx + 1 < path.len() {
            if collision.contact_between(&path[idx - 1], &path[idx + 1], step).is_none() {
                path.remove(idx);
                idx = idx.saturating_sub(1).max(1);
            } else {
                idx += 1;
            }
        }
    }
}

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

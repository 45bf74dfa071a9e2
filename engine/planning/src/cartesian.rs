//! Straight motions of the palm: approach, lift, tilt.

use crate::collision::{CollisionModel, Contact, distance, mix};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use sfg_kinematics::{Chain, IkOutcome, IkSettings, IkSolver};
use sfg_types::Pose;

/// Steps and bounds.
#[derive(Clone, Debug, PartialEq)]
pub struct CartesianSettings {
    /// Longest step of the tip. Default 0.01 m.
    pub max_step_m: f64,
    /// Largest turn of the tip in a step. Default 0.05 rad.
    pub max_step_rad: f64,
    /// Largest motion of a joint in a step; more means that the arm flips. Default 0.3 rad.
    pub max_joint_jump_rad: f64,
    /// Largest distance of the tip from the straight way, between steps too. Default 0.001 m.
    pub max_deviation_m: f64,
    /// Same for its orientation. Default 0.01 rad.
    pub max_deviation_rad: f64,
    /// Distance of collision checks. Default 1/512 rad.
    pub check_step_rad: f64,
}

impl Default for CartesianSettings {
    fn default() -> Self {
        Self {
            max_step_m: 0.01,
            max_step_rad: 0.05,
            max_joint_jump_rad: 0.3,
            max_deviation_m: 0.001,
            max_deviation_rad: 0.01,
            check_step_rad: 1.0 / 512.0,
        }
    }
}

/// What stopped a straight motion.
#[derive(Clone, Debug, PartialEq)]
pub enum CartesianStop {
    /// The arm does not reach on.
    Unreachable {
        /// Distance of the nearest pose that the arm could take.
        position_miss_m: f64,
        /// Its angle.
        rotation_miss_rad: f64,
    },
    /// The arm would have to flip.
    JointJump {
        /// Which joint.
        joint: String,
        /// By how much.
        jump_rad: f64,
    },
    /// The tip leaves the straight way between two steps.
    Deviation {
        /// Distance from the way.
        deviation_m: f64,
        /// Angle.
        deviation_rad: f64,
    },
    /// Something is in the way.
    Collision(Contact),
}

/// What came of it.
#[derive(Clone, Debug, PartialEq)]
pub enum CartesianOutcome {
    /// Configurations from the start to the last waypoint.
    Found(Vec<Vec<f64>>),
    /// It ended early.
    Stopped {
        /// The good part, at least the start.
        path: Vec<Vec<f64>>,
        /// The waypoint on the way to which it ended.
        waypoint_idx: usize,
        /// Share of the steps to that waypoint that were good, 0 to 1.
        share: f64,
        /// Why.
        stop: CartesianStop,
    },
}

/// Moves the tip from where `q_start` has it through `waypoints` on straight ways (positions linear, orientations by slerp).
///
/// Each step is solved from the one before, so the arm keeps its posture; no random numbers are drawn. Pass a collision model to
/// have every step checked.
///
/// # Panics
/// If `q_start` does not fit the chain.
#[must_use]
pub fn cartesian_path(
    chain: &Chain,
    q_start: &[f64],
    waypoints: &[Pose],
    settings: &CartesianSettings,
    collision: Option<&CollisionModel>,
) -> CartesianOutcome {
    let ik = IkSettings { max_starts: 1, max_iterations: 100, ..IkSettings::default() };
    let mut rng = ChaCha8Rng::seed_from_u64(0);
    let mut path = vec![q_start.to_vec()];
    let mut from = chain.fk(q_start);
    for (waypoint_idx, to) in waypoints.iter().enumerate() {
        let steps_m = (to.translation.vector - from.translation.vector).norm() / settings.max_step_m;
        let steps_rad = from.rotation.angle_to(&to.rotation) / settings.max_step_rad;
        let n = steps_m.max(steps_rad).ceil().max(1.0) as usize;
        for i in 1..=n {
            let before = path.last().map_or(q_start, Vec::as_slice).to_vec();
            let at = |share: f64| between(&from, to, share);
            let stopped = |path: &[Vec<f64>], stop| CartesianOutcome::Stopped {
                path: path.to_vec(),
                waypoint_idx,
                share: (i - 1) as f64 / n as f64,
                stop,
            };
            let q = match IkSolver::solve(chain, &at(i as f64 / n as f64), &before, &ik, &mut rng) {
                IkOutcome::Solved { q, .. } => q,
                IkOutcome::Failed { position_miss_m, rotation_miss_rad, .. } => {
                    return stopped(&path, CartesianStop::Unreachable { position_miss_m, rotation_miss_rad });
                }
            };
            let jumps = q.iter().zip(&before).map(|(a, b)| (a - b).abs()).enumerate();
            let (joint, jump_rad) = jumps.max_by(|a, b| a.1.total_cmp(&b.1)).unwrap_or((0, 0.0));
            if jump_rad > settings.max_joint_jump_rad {
                return stopped(&path, CartesianStop::JointJump { joint: chain.joint_names[joint].clone(), jump_rad });
            }
            let middle = chain.fk(&mix(&before, &q, 0.5));
            let wanted = at((i as f64 - 0.5) / n as f64);
            let deviation_m = (middle.translation.vector - wanted.translation.vector).norm();
            let deviation_rad = middle.rotation.angle_to(&wanted.rotation);
            if deviation_m > settings.max_deviation_m || deviation_rad > settings.max_deviation_rad {
                return stopped(&path, CartesianStop::Deviation { deviation_m, deviation_rad });
            }
            if let Some(contact) = collision.and_then(|c| c.contact_between(&before, &q, settings.check_step_rad)) {
                return stopped(&path, CartesianStop::Collision(contact));
            }
            if distance(&before, &q) > 1e-9 {
                path.push(q);
            }
        }
        from = *to;
    }
    if path.len() == 1 {
        path.push(q_start.to_vec());
    }
    CartesianOutcome::Found(path)
}

fn between(from: &Pose, to: &Pose, share: f64) -> Pose {
    let position = from.translation.vector.lerp(&to.translation.vector, share);
    // slerp has no answer for exactly opposite orientations; either way round is then as good.
    let rotation =
        from.rotation.try_slerp(&to.rotation, share, 1e-9).unwrap_or(if share < 0.5 { from.rotation } else { to.rotation });
    Pose::from_parts(position.into(), rotation)
}

//! The judge: watches every step on the simulator's truth and says, at the end, what really happened.
//!
//! | file | what |
//! |---|---|
//! | `invariant` | rules of physics that no run may break |
//! | `hold` | when an object is held, and how far it slips |
//! | `grasp` | contacts, part shares and penetration of a grasp |
//! | `recognise` | the grasp type that a hand shows |
//! | `predicate` | what a scenario may ask |
//! | `evaluate` | the answers |

mod evaluate;
#[cfg(test)]
mod grain_tests;
mod grasp;
mod hold;
#[cfg(test)]
mod hollow_tests;
mod invariant;
mod predicate;
mod recognise;
#[cfg(test)]
mod tamper_tests;

pub use evaluate::{AT_REST_MPS, GraspAsked, HELD_SECS, JudgeReport, LIFTED_M, PART_SHARE};
pub use grasp::{CONTACT_WITHIN_M, GraspRecord, HandContact};
pub use hold::{Hold, HoldPhase, LIFT_OFF_M, LOST_AFTER_SECS, PUT_DOWN_M, slip_between};
pub use invariant::{GRAVITY, Invariant, MAX_PAIR_FRICTION, Tampering};
pub use predicate::{ArgKind, ArgSpec, Check, PREDICATES, Predicate, PredicateSpec, Verdict};
pub use recognise::{Finger, Posture, TypedContact, recognise_grasp_type};

pub(crate) use evaluate::{is_inside, object_idx, report, verdict};
pub(crate) use invariant::{Guard, MotorCap, Protected};

use crate::bodies::{Bodies, Role};
use hold::{HoldSample, HoldTracker};
use sfg_types::Pose;

/// Time after lift-off at which the record of a grasp is taken again: closing transients are over, seconds.
const RECORD_AGAIN_SECS: f64 = 2.0;

/// What the judge needs to know about the robot after a step.
pub(crate) struct RobotTruth {
    pub(crate) base_from_palm: Pose,
    pub(crate) posture: Posture,
    pub(crate) motors: [f64; 2],
}

/// Follows a run from inside the simulator.
#[derive(Debug)]
pub(crate) struct Judge {
    pub(crate) guard: Guard,
    pub(crate) trackers: Vec<HoldTracker>,
    /// The grasp on each object: at lift-off, taken again after two seconds of holding.
    pub(crate) records: Vec<Option<GraspRecord>>,
    pub(crate) tampered: Option<Tampering>,
}

impl Judge {
    pub(crate) fn new(guard: Guard, n_objects: usize) -> Self {
        Self { guard, trackers: vec![HoldTracker::default(); n_objects], records: vec![None; n_objects], tampered: None }
    }

    /// Checks the invariants; the first broken one stays.
    pub(crate) fn before_step(&mut self, bodies: &Bodies, tensions_nm: &[f64], stamp_secs: f64) {
        if self.tampered.is_none() {
            self.tampered = self.guard.check(&bodies.physics, tensions_nm, stamp_secs).err();
        }
    }

    /// Follows every object.
    pub(crate) fn after_step(&mut self, bodies: &Bodies, robot: impl Fn() -> RobotTruth, stamp_secs: f64) {
        self.guard.note_states(&bodies.physics);
        let mut truth = None;
        for object_idx in 0..bodies.objects.len() {
            let (mut touched_by_hand, mut supported) = (false, false);
            for (role, impulse) in bodies.touching(object_idx) {
                match role {
                    Role::Hand(_) => touched_by_hand = true,
                    Role::Grain(_) => {}
                    Role::Table | Role::Robot | Role::Object(..) => supported |= impulse > 0.0,
                }
            }
            let tracker = &mut self.trackers[object_idx];
            let object = &bodies.objects[object_idx];
            if !touched_by_hand && tracker.phase == HoldPhase::Supported {
                if supported {
                    tracker.rests(bodies.centre(object.body).z);
                }
                continue;
            }
            let robot = truth.get_or_insert_with(&robot);
            let sample = HoldSample {
                stamp_secs,
                clearance_m: bodies.clearance_m(object_idx),
                centre_m: bodies.centre(object.body).z,
                touched_by_hand,
                supported,
                palm_from_object: robot.base_from_palm.inverse() * bodies.pose(object.body),
                motors: robot.motors,
            };
            let before_secs = tracker.latest.as_ref().map_or(0.0, Hold::duration_secs);
            let begins = tracker.update(&sample);
            let held_secs = tracker.latest.as_ref().map_or(0.0, Hold::duration_secs);
            let settled = tracker.is_held() && before_secs < RECORD_AGAIN_SECS && held_secs >= RECORD_AGAIN_SECS;
            if begins || settled {
                self.records[object_idx] = Some(grasp::record(bodies, object_idx, robot, stamp_secs));
            }
        }
    }
}

//! Step 10c: is something in the hand? Motor signals only, since the hand has no other sensors.

use crate::context::{SkillContext, SkillFailure, StageNote, hash_of};
use sfg_tree::Registry;
use sfg_types::{FailureReason, HandFeedback, HandProfile};

/// Grip from which something is in the hand: closing on air stays well below a tenth, and a thing that settles deeper into
/// the hand while it is lifted lets the tendon slacken.
const MIN_GRIP: f64 = 0.1;
/// The springs alone never take more than this share of the stall current.
const MAX_FREE_SHARE: f64 = 0.95;

/// What the motors say about the grasp.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct GraspEvidence {
    /// Largest motor current as a share of the stall current.
    pub current_share: f64,
    /// Share of the current left after the springs' part: 0 on air, 1 at stall.
    pub grip: f64,
    /// Something blocks the fingers.
    pub is_holding: bool,
}

/// Judges a closed hand that rests.
///
/// The springs `E q` of the fingers take the more current the further a motor has closed, on air too. What the motors draw
/// beyond that presses on something.
#[must_use]
pub fn grasp_evidence(feedback: &HandFeedback, hand: &HandProfile) -> GraspEvidence {
    let driven = || hand.joints.iter().filter(|joint| hand.synergy_joints.contains(&joint.name) && joint.closing_ratio > 0.0);
    let full_stroke_nm: f64 =
        driven().map(|joint| joint.stiffness_nm_per_rad * (joint.upper_rad - joint.lower_rad) / joint.closing_ratio).sum::<f64>()
            / driven().count().max(1) as f64;
    let of_motor = |motor: usize| {
        let share = feedback.motor_currents_amps[motor].abs() / hand.max_current_amps;
        let free = (full_stroke_nm / hand.max_tension_nm * feedback.motor_positions[motor].abs()).min(MAX_FREE_SHARE);
        (share, (share - free) / (1.0 - free))
    };
    let (first, second) = (of_motor(0), of_motor(1));
    let grip = first.1.max(second.1).clamp(0.0, 1.0);
    GraspEvidence { current_share: first.0.max(second.0), grip, is_holding: grip >= MIN_GRIP }
}

/// `verify_grasp`: Success when the motors feel an object, Failure `grasp_empty`. Never Running.
pub fn register(registry: &mut Registry<SkillContext>) {
    registry
        .step("verify_grasp", [], |tick| {
            let context = &mut *tick.context;
            let feedback = context.robot.state().hand;
            let evidence = grasp_evidence(&feedback, context.synergy.profile());
            let outcome = if evidence.is_holding {
                let note = StageNote {
                    summary: format!(
                        "something blocks the fingers: grip {:.2}, current {:.0} % of stall",
                        evidence.grip,
                        100.0 * evidence.current_share
                    ),
                    input_sha256: hash_of(&feedback),
                    details: serde_json::json!(evidence),
                };
                Ok(((), note))
            } else {
                Err(SkillFailure::new(
                    FailureReason::GraspEmpty,
                    format!(
                        "the hand closed on nothing: grip {:.2}, current {:.0} % of stall",
                        evidence.grip,
                        100.0 * evidence.current_share
                    ),
                ))
            };
            context.finish_stage("verify_grasp", outcome)
        })
        .fails_with([FailureReason::GraspEmpty].map(FailureReason::name));
}

//! Laws of a grasp policy.

use super::{Laws, scenes::TABLE_HEIGHT_M};
use crate::{ClosingPlan, GraspPolicy, GraspPolicyState, PolicyStep};
use sfg_types::{GraspType, HandFeedback, HandProfile, Pose, SynergyCoordinates, Vector};

/// A closing that has not ended after this time never will.
const MAX_CLOSING_SECS: f64 = 20.0;
const PERIOD_SECS: f64 = 0.004;

/// Every law that `policy` breaks with `hand`: set points are finite and in range, also for feedback that is not a number; it
/// ends within 20 s whether the fingers meet something or nothing; a second closing is the same as the first; and it can be
/// stepped before it was started.
///
/// # Errors
/// The broken laws, a sentence each.
pub fn grasp_policy_suite(policy: &mut dyn GraspPolicy, hand: &HandProfile) -> Result<(), Vec<String>> {
    let mut laws = Laws::default();
    // An error and a lawful set point are both answers here.
    if let Ok(step) = policy.step(&state(0.0, SynergyCoordinates::OPEN), &HandFeedback::default()) {
        check_step("before the start", &step, &mut laws);
    }
    for (&kind, profile) in &hand.grasp_types {
        for (case, blocked_at) in [("free fingers", 2.0), ("something in the hand", 0.5), ("blocked at once", 0.0)] {
            let case = format!("{kind}, {case}");
            let plan = plan(kind, profile.c_tar);
            let first = close(policy, &plan, hand, blocked_at, &case, &mut laws);
            let again = close(policy, &plan, hand, blocked_at, &case, &mut laws);
            laws.check(first == again, || format!("{case}: the second closing differs from the first"));
        }
    }
    if let Some((&kind, profile)) = hand.grasp_types.first_key_value() {
        broken_feedback(policy, &plan(kind, profile.c_tar), hand, &mut laws);
    }
    laws.into_result()
}

fn plan(grasp_type: GraspType, target: SynergyCoordinates) -> ClosingPlan {
    let base_from_palm =
        Pose::new(Vector::new(0.6, 0.1, TABLE_HEIGHT_M + 0.1), Vector::new(0.0, std::f64::consts::FRAC_PI_2, 0.0));
    ClosingPlan { preshape: SynergyCoordinates::new(0.1, 0.0), target, grasp_type, base_from_palm }
}

fn state(elapsed_secs: f64, synergy: SynergyCoordinates) -> GraspPolicyState {
    GraspPolicyState { elapsed_secs, period_secs: PERIOD_SECS, synergy, base_from_palm: Pose::identity() }
}

/// Closes on a simple drive: motors follow the set point up to `blocked_at` of their stroke, then the current rises with the
/// stretch of the tendon. Returns every step.
fn close(
    policy: &mut dyn GraspPolicy,
    plan: &ClosingPlan,
    hand: &HandProfile,
    blocked_at: f64,
    case: &str,
    laws: &mut Laws,
) -> Option<Vec<PolicyStep>> {
    laws.ok(case, policy.start(plan, hand))?;
    let mut steps = Vec::new();
    let mut synergy = plan.preshape;
    for i in 0..(MAX_CLOSING_SECS / PERIOD_SECS) as usize {
        let motors = [synergy.c1 + synergy.c2, synergy.c1 - synergy.c2];
        let feedback = HandFeedback {
            motor_positions: motors.map(|motor| motor.min(blocked_at)),
            motor_currents_amps: motors.map(|motor| (0.1 + 4.0 * (motor - blocked_at).max(0.0)).min(1.0) * hand.max_current_amps),
        };
        let step = laws.ok(case, policy.step(&state(i as f64 * PERIOD_SECS, synergy), &feedback))?;
        if !check_step(case, &step, laws) {
            return None;
        }
        synergy = step.synergy;
        steps.push(step);
        if step.done {
            return Some(steps);
        }
    }
    laws.check(false, || format!("{case}: not done after {MAX_CLOSING_SECS} s"));
    Some(steps)
}

fn broken_feedback(policy: &mut dyn GraspPolicy, plan: &ClosingPlan, hand: &HandProfile, laws: &mut Laws) {
    for value in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        let case = format!("feedback {value}");
        if laws.ok(&case, policy.start(plan, hand)).is_none() {
            return;
        }
        let feedback = HandFeedback { motor_positions: [value; 2], motor_currents_amps: [value; 2] };
        for i in 0..10 {
            if let Ok(step) = policy.step(&state(f64::from(i) * PERIOD_SECS, plan.preshape), &feedback) {
                check_step(&case, &step, laws);
            }
        }
    }
}

fn check_step(case: &str, step: &PolicyStep, laws: &mut Laws) -> bool {
    let SynergyCoordinates { c1, c2 } = step.synergy;
    let in_range = (0.0..=1.0).contains(&c1) && (-1.0..=1.0).contains(&c2);
    laws.check(in_range, || format!("{case}: the set point ({c1}, {c2}) is outside [0, 1] x [-1, 1]"));
    let finite = step.palm_correction.iter().all(|value| value.is_finite());
    laws.check(finite, || format!("{case}: the palm correction {:?} is not finite", step.palm_correction));
    in_range && finite
}

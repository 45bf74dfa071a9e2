//! Step 10b: closing, by the grasp policy.

use crate::context::{SkillContext, SkillFailure, StageNote, hash_of};
use crate::saved::starts_anew;
use sfg_plugin::{ClosingPlan, GraspPolicyState};
use sfg_tree::{Action, Literal, Outcome, PortSpec, Progress, Registry, Tick};
use sfg_types::{FailureReason, SynergyCoordinates};
use std::sync::Arc;

/// A policy that has not finished by then never will.
const MAX_CLOSING_SECS: f64 = 6.0;

/// How the hand closed: the path of `c` and the motors at its end.
#[derive(Clone, Debug, PartialEq)]
pub struct Closing {
    /// Time since closing began, set point, largest motor current.
    pub path: Vec<(f64, SynergyCoordinates, f64)>,
    /// Last set point.
    pub synergy: SynergyCoordinates,
}

/// `close_hand`: closes along the policy.
///
/// Running while closing; Success with `closing` written when the policy is done; Failure `plugin_failed` or `timeout`.
/// Halt keeps the fingers where they are.
#[derive(Default)]
struct CloseHand {
    /// The hand has taken its preshape around the object; the policy goes on from there.
    is_preshaped: bool,
    start_secs: f64,
    path: Vec<(f64, SynergyCoordinates, f64)>,
}

impl Action<SkillContext> for CloseHand {
    fn start(&mut self, tick: &mut Tick<'_, SkillContext>) -> Outcome {
        let plan = tick.input::<ClosingPlan>("closing_plan")?;
        let context = &mut *tick.context;
        self.path.clear();
        self.is_preshaped = false;
        context.robot.set_hand(plan.preshape.into());
        Ok(Progress::Running)
    }

    fn poll(&mut self, tick: &mut Tick<'_, SkillContext>) -> Outcome {
        if !self.is_preshaped {
            let plan = tick.input::<ClosingPlan>("closing_plan")?;
            let context = &mut *tick.context;
            if context.robot.sent().hand != plan.preshape.into() {
                return Ok(Progress::Running);
            }
            self.is_preshaped = true;
            self.start_secs = context.robot.active_secs();
            let started = context.plugins.grasp_policy.start(&plan, context.synergy.profile());
            started.map_err(|error| context.fail_stage("close_hand", SkillFailure::plugin(&error)))?;
        }
        let context = &mut *tick.context;
        let elapsed_secs = context.robot.active_secs() - self.start_secs;
        if elapsed_secs > MAX_CLOSING_SECS {
            let failure = SkillFailure::new(FailureReason::Timeout, format!("the hand was not closed after {elapsed_secs:.1} s"));
            return Err(context.fail_stage("close_hand", failure));
        }
        let state = GraspPolicyState {
            elapsed_secs,
            period_secs: context.robot.period_secs(),
            synergy: context.robot.synergy(),
            base_from_palm: context.robot.base_from_palm(),
        };
        let feedback = context.robot.state().hand;
        let step = context.plugins.grasp_policy.step(&state, &feedback).map_err(|error| SkillFailure::plugin(&error))?;
        context.robot.set_hand(step.synergy.into());
        let current_amps = feedback.motor_currents_amps[0].max(feedback.motor_currents_amps[1]);
        self.path.push((elapsed_secs, step.synergy, current_amps));
        if !step.done {
            return Ok(Progress::Running);
        }
        let closing = Closing { path: std::mem::take(&mut self.path), synergy: step.synergy };
        let every_tenth: Vec<_> =
            closing.path.iter().step_by(10).map(|(t, c, amps)| serde_json::json!([t, c.c1, c.c2, amps])).collect();
        let note = StageNote {
            summary: format!(
                "closed in {elapsed_secs:.2} s to c = ({:.2}, {:.2}), {current_amps:.2} A",
                step.synergy.c1, step.synergy.c2
            ),
            input_sha256: hash_of(&(state.synergy, feedback)),
            details: serde_json::json!({"path_t_c1_c2_amps": every_tenth, "feedback": feedback}),
        };
        context.kept.base_from_palm_at_grasp = Some(context.robot.base_from_palm());
        let closing = context.finish_stage("close_hand", Ok((closing, note)))?;
        tick.set_shared("closing", Arc::new(closing));
        Ok(Progress::Success)
    }

    fn save(&self) -> Option<Literal> {
        starts_anew()
    }
}

/// Registers `close_hand`.
pub fn register(registry: &mut Registry<SkillContext>) {
    let ports = [
        PortSpec::input::<ClosingPlan>("closing_plan").default_key("closing_plan"),
        PortSpec::output::<Closing>("closing").default_key("closing").doc("how the hand closed"),
    ];
    registry
        .action("close_hand", ports, CloseHand::default)
        .fails_with([FailureReason::Timeout, FailureReason::PluginFailed].map(FailureReason::name))
        .doc("Closes the hand along the grasp policy.")
        .occupies(["hand"])
        .takes_secs(2.0);
}

//! Step 10a: to the stand-off, then straight to the palm pose, with the hand in the shape that lets it pass.

use crate::context::{SkillContext, SkillFailure, StageNote, hash_of};
use crate::grasp::synthesize_grasp::arrival_shape;
use crate::motion::{Follower, MAX_BESIDE_RAD};
use crate::saved::starts_anew;
use sfg_plugin::ClosingPlan;
use sfg_tree::{Action, Literal, Outcome, PortSpec, Progress, Registry, Tick};
use sfg_types::{FailureReason, Selection};

/// The palm may end this far from where it was planned.
const MAX_PALM_ERROR_M: f64 = 0.01;

/// `reach_palm_pose`: Running on the way; Success at the palm pose; Failure `tracking_lost`. Halt brings the arm to rest.
#[derive(Default)]
struct ReachPalmPose {
    followers: Vec<Follower>,
}

impl Action<SkillContext> for ReachPalmPose {
    fn start(&mut self, tick: &mut Tick<'_, SkillContext>) -> Outcome {
        let selection = tick.input::<Selection>("selection")?;
        let plan = tick.input::<ClosingPlan>("closing_plan")?;
        let shape = arrival_shape(plan.grasp_type, &tick.context.synergy);
        tick.context.robot.set_hand(shape.into());
        // Last first: followers are taken from the end.
        self.followers = vec![Follower::new(selection.chosen.approach.clone()), Follower::new(selection.chosen.transit.clone())];
        self.poll(tick)
    }

    fn poll(&mut self, tick: &mut Tick<'_, SkillContext>) -> Outcome {
        let selection = tick.input::<Selection>("selection")?;
        let context = &mut *tick.context;
        if let Some(follower) = self.followers.last_mut() {
            let progress = follower.poll(&mut context.robot).map_err(|failure| context.fail_stage("reach_palm_pose", failure))?;
            if progress == Progress::Success {
                self.followers.pop();
            }
            return Ok(Progress::Running);
        }
        let planned = selection.chosen.candidate.base_from_palm;
        let reached = context.robot.base_from_palm();
        let error_m = (planned.translation.vector - reached.translation.vector).norm();
        let outcome = if error_m <= MAX_PALM_ERROR_M {
            let note = StageNote {
                summary: format!("palm within {:.1} mm of its pose", 1000.0 * error_m),
                input_sha256: hash_of(&(planned, &context.robot.state().q)),
                details: serde_json::json!({"palm_error_m": error_m}),
            };
            Ok((Progress::Success, note))
        } else {
            Err(SkillFailure::new(
                FailureReason::TrackingLost,
                format!("the palm stopped {:.0} mm from its pose", 1000.0 * error_m),
            ))
        };
        context.finish_stage("reach_palm_pose", outcome)
    }

    fn save(&self) -> Option<Literal> {
        starts_anew()
    }

    /// Goes on along the planned motions from where the arm stopped beside them.
    fn resume(&mut self, _state: &Literal, tick: &mut Tick<'_, SkillContext>) -> Outcome {
        let selection = tick.input::<Selection>("selection")?;
        let plan = tick.input::<ClosingPlan>("closing_plan")?;
        let shape = arrival_shape(plan.grasp_type, &tick.context.synergy);
        tick.context.robot.set_hand(shape.into());
        let q = tick.context.robot.sent().q.clone();
        let (transit, transit_rad) = Follower::taken_up(selection.chosen.transit.clone(), &q);
        let (approach, approach_rad) = Follower::taken_up(selection.chosen.approach.clone(), &q);
        if transit_rad.min(approach_rad) > MAX_BESIDE_RAD {
            let explanation = format!("the arm stands {transit_rad:.2} rad beside the planned motion");
            return Err(tick.context.fail_stage("reach_palm_pose", SkillFailure::new(FailureReason::NoPath, explanation)));
        }
        self.followers = if approach_rad < transit_rad {
            vec![approach]
        } else {
            vec![Follower::new(selection.chosen.approach.clone()), transit]
        };
        self.poll(tick)
    }
}

/// Registers `reach_palm_pose`.
pub fn register(registry: &mut Registry<SkillContext>) {
    let ports = [
        PortSpec::input::<Selection>("selection").default_key("selection"),
        PortSpec::input::<ClosingPlan>("closing_plan").default_key("closing_plan"),
    ];
    registry
        .action("reach_palm_pose", ports, ReachPalmPose::default)
        .fails_with([FailureReason::NoPath, FailureReason::TrackingLost].map(FailureReason::name))
        .doc("Brings the open hand to the selected palm pose.")
        .occupies(["arm", "hand"])
        .takes_secs(5.0);
}

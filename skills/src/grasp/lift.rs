//! Step 10d: straight up, and a second look at the motors: is it still in the hand?

use crate::arm::ArmScene;
use crate::context::{SkillContext, SkillFailure, StageNote, hash_of};
use crate::grasp::verify_grasp::grasp_evidence;
use crate::motion::Follower;
use crate::saved::starts_anew;
use sfg_tree::{Action, Literal, Outcome, PortSpec, Progress, Registry, Tick};
use sfg_types::{FailureReason, ObjectCluster, SceneInventory};

/// Share of the speed limits while something is being lifted.
const LIFT_SPEED: f64 = 0.15;
/// Once the motors have felt nothing for this long the hand is empty: stopping low leaves the thing standing.
const EMPTY_SECS: f64 = 0.1;

/// `lift`: Running on the way up; Success when up and the motors still feel the object; Failure `no_path`, `lift_failed`,
/// `tracking_lost`. Halt brings the arm to rest and keeps the hand closed.
#[derive(Default)]
struct Lift {
    follower: Option<Follower>,
    height_m: f64,
    empty_secs: f64,
}

impl Action<SkillContext> for Lift {
    fn start(&mut self, tick: &mut Tick<'_, SkillContext>) -> Outcome {
        self.empty_secs = 0.0;
        self.height_m = tick.get::<f64>("height_m")?;
        let inventory = tick.input::<SceneInventory>("inventory")?;
        let held = tick.optional::<ObjectCluster>("object")?.map(|object| object.id);
        let context = &mut *tick.context;
        let q = context.robot.sent().q.clone();
        let mut base_from_lift = context.robot.chain().fk(&q);
        base_from_lift.translation.z += self.height_m;
        let scene = ArmScene::new(&context.robot, &inventory, held, context.robot.synergy(), context.seed);
        let planned = scene
            .straight(&q, &[base_from_lift])
            .map_err(|miss| miss.to_string())
            .and_then(|path| scene.time(&path, LIFT_SPEED))
            .map_err(|why| SkillFailure::new(FailureReason::NoPath, format!("the hand cannot go straight up: {why}")));
        let trajectory = planned.map_err(|failure| context.fail_stage("lift", failure))?;
        self.follower = Some(Follower::new(trajectory));
        self.poll(tick)
    }

    fn poll(&mut self, tick: &mut Tick<'_, SkillContext>) -> Outcome {
        let context = &mut *tick.context;
        let Some(follower) = &mut self.follower else { return Ok(Progress::Success) };
        let progress = follower.poll(&mut context.robot).map_err(|failure| context.fail_stage("lift", failure))?;
        let feedback = context.robot.state().hand;
        let evidence = grasp_evidence(&feedback, context.synergy.profile());
        self.empty_secs = if evidence.is_holding { 0.0 } else { self.empty_secs + context.robot.period_secs() };
        if progress != Progress::Success && self.empty_secs < EMPTY_SECS {
            return Ok(Progress::Running);
        }
        let outcome = if evidence.is_holding {
            let note = StageNote {
                summary: format!("up {:.0} mm, grip {:.2}", 1000.0 * self.height_m, evidence.grip),
                input_sha256: hash_of(&feedback),
                details: serde_json::json!(evidence),
            };
            Ok((Progress::Success, note))
        } else {
            Err(SkillFailure::new(FailureReason::LiftFailed, "the hand came up empty: nothing blocks the fingers any more"))
        };
        context.finish_stage("lift", outcome)
    }

    fn save(&self) -> Option<Literal> {
        starts_anew()
    }
}

/// Registers `lift`.
pub fn register(registry: &mut Registry<SkillContext>) {
    let ports = [
        PortSpec::input::<SceneInventory>("inventory").default_key("inventory"),
        PortSpec::input::<ObjectCluster>("object").default_key("object").optional().doc("What is held: no obstacle any more."),
        PortSpec::setting::<f64>("height_m").default_value(0.15).range(0.01, 0.5).doc("How far up, metres."),
    ];
    registry
        .action("lift", ports, Lift::default)
        .fails_with([FailureReason::LiftFailed, FailureReason::NoPath, FailureReason::TrackingLost].map(FailureReason::name))
        .doc("Lifts the held object straight up.")
        .occupies(["arm"])
        .takes_secs(3.0);
}

//! Before a grasp, and before another attempt: hand open, arm back at its ready pose, out of the cameras' way.

use crate::arm::{ArmScene, PLAN_SPEED};
use crate::context::{SkillContext, SkillFailure, StageNote, hash_of};
use crate::motion::Follower;
use crate::saved::starts_anew;
use sfg_tree::{Action, Literal, Outcome, PortSpec, Progress, Registry, Tick};
use sfg_types::{FailureReason, HandCommand, JointTrajectory, Pose, SceneInventory};

/// An arm this close to its ready pose stays there.
const READY_TOLERANCE_RAD: f64 = 0.02;
/// Time for the fingers to open.
const OPEN_SECS: f64 = 0.8;
/// How far the open hand backs off from what it held.
const RETREAT_M: f64 = 0.12;
/// Share of the speed limits while backing off.
const RETREAT_SPEED: f64 = 0.15;

/// `ready`: opens the hand, backs off and returns to the ready pose; at once Success when it is there.
///
/// Running on the way; Failure `no_path` or `tracking_lost`. Halt brings the arm to rest.
#[derive(Default)]
struct Ready {
    opened_secs: Option<f64>,
    opening_secs: f64,
    followers: Vec<Follower>,
}

impl Ready {
    /// Back off along the palm's normal or upwards until nothing is touched, then to the ready pose.
    fn way_home(context: &SkillContext, inventory: &SceneInventory) -> Result<Vec<JointTrajectory>, SkillFailure> {
        let robot = &context.robot;
        let fail = |why: String| SkillFailure::new(FailureReason::NoPath, why);
        let scene = ArmScene::new(robot, inventory, None, robot.synergy(), context.seed);
        let q = robot.sent().q.clone();
        let mut motions = Vec::new();
        let mut from_q = q.clone();
        if scene.touches(&q).is_some() {
            let back = robot.chain().fk(&q) * Pose::translation(0.0, 0.0, -RETREAT_M);
            let raised = |pose: &Pose| {
                let mut pose = *pose;
                pose.translation.z += RETREAT_M;
                pose
            };
            let here = robot.chain().fk(&q);
            let ways = [vec![back, raised(&back)], vec![raised(&here)], vec![back], vec![raised(&here), raised(&back)]];
            let path = ways
                .iter()
                .filter_map(|way| scene.straight(&q, way).ok())
                .find(|path| path[path.len() / 2..].iter().all(|q| scene.touches(q).is_none()))
                .ok_or_else(|| fail("the open hand can back off neither along the palm's normal nor upwards".to_owned()))?;
            from_q = path[path.len() - 1].clone();
            motions.push(scene.time(&path, RETREAT_SPEED).map_err(fail)?);
        }
        let home_q = &robot.model().arm(robot.side()).home_q;
        motions.push(scene.plan(&from_q, home_q, PLAN_SPEED).map_err(fail)?);
        Ok(motions)
    }
}

impl Action<SkillContext> for Ready {
    fn start(&mut self, tick: &mut Tick<'_, SkillContext>) -> Outcome {
        *self = Self::default();
        self.opening_secs = tick.context.robot.active_secs();
        let robot = &tick.context.robot;
        let home_q = &robot.model().arm(robot.side()).home_q;
        let is_home = robot.sent().q.iter().zip(home_q).all(|(q, home)| (q - home).abs() < READY_TOLERANCE_RAD);
        if is_home && robot.sent().hand == HandCommand::default() {
            return Ok(Progress::Success);
        }
        self.poll(tick)
    }

    fn poll(&mut self, tick: &mut Tick<'_, SkillContext>) -> Outcome {
        let inventory = tick.optional::<SceneInventory>("inventory")?;
        let context = &mut *tick.context;
        if self.opened_secs.is_none() {
            context.robot.set_hand(HandCommand::default());
            if context.robot.active_secs() - self.opening_secs < OPEN_SECS {
                return Ok(Progress::Running);
            }
            self.opened_secs = Some(context.robot.active_secs());
            let nothing = SceneInventory::default();
            let inventory = inventory.as_deref().unwrap_or(&nothing);
            let motions = Self::way_home(context, inventory);
            let mut motions = motions.map_err(|failure| context.fail_stage("ready", failure))?;
            // The hand may still stand about what it held; the table remains.
            let table = SceneInventory { clusters: Vec::new(), ..inventory.clone() };
            let guard = ArmScene::new(&context.robot, &table, None, context.robot.synergy(), context.seed).guard();
            context.robot.guard(guard);
            motions.reverse();
            self.followers = motions.into_iter().map(Follower::new).collect();
        }
        if let Some(follower) = self.followers.last_mut() {
            let progress = follower.poll(&mut context.robot).map_err(|failure| context.fail_stage("ready", failure))?;
            if progress == Progress::Success {
                self.followers.pop();
            }
            return Ok(Progress::Running);
        }
        let note = StageNote {
            summary: "hand open, arm at its ready pose".to_owned(),
            input_sha256: hash_of(&context.robot.sent().q),
            details: serde_json::Value::Null,
        };
        context.finish_stage("ready", Ok((Progress::Success, note)))
    }

    fn save(&self) -> Option<Literal> {
        starts_anew()
    }
}

/// Registers `ready`.
pub fn register(registry: &mut Registry<SkillContext>) {
    let ports = [PortSpec::input::<SceneInventory>("inventory")
        .default_key("inventory")
        .optional()
        .doc("What to stay clear of; nothing before the first look.")];
    registry
        .action("ready", ports, Ready::default)
        .fails_with([FailureReason::NoPath, FailureReason::TrackingLost].map(FailureReason::name))
        .doc("Opens the hand and returns to the ready pose.")
        .occupies(["arm", "hand"])
        .takes_secs(4.0);
}

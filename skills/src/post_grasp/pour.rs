//! Pours a held vessel into a target: over it, tilt about the lip until the cameras see no more coming, and back upright.

use crate::arm::ArmScene;
use crate::context::{SkillContext, SkillFailure, StageNote, hash_of};
use crate::motion::{Follower, MAX_BESIDE_RAD};
use crate::post_grasp::fill::{HeightMap, poured_ml, surface_inside};
use crate::post_grasp::held_pose::{HeldPose, Outline, fit_held_pose, points_near};
use crate::post_grasp::pour_path::PourTarget;
use crate::post_grasp::pour_plan::{PourSearch, PourTask, plan_pour};
use serde::{Deserialize, Serialize};
use sfg_tree::{Action, Literal, Outcome, PortSpec, Progress, Registry, Tick};
use sfg_types::{FailureReason, JointTrajectory, ObjectCluster, Pose, SceneInventory, Selection};

/// How the vessel lies in the hand.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct Held {
    palm_from_vessel: Pose,
    /// Lean against the grasp as planned, degrees, and the fit behind it; `None` when the cameras did not show it well enough.
    fit: Option<(f64, HeldPose)>,
}

/// Looks at the vessel in the hand; where the cameras do not show it, it is taken to lie as it stood.
fn held_vessel(
    context: &mut SkillContext,
    object: &ObjectCluster,
    task: &PourTask,
    base_from_palm_at_grasp: &Pose,
) -> Result<Held, SkillFailure> {
    let palm_from_vessel = base_from_palm_at_grasp.inverse() * task.shape.base_from_vessel;
    let base_from_palm = context.robot.base_from_palm();
    let guess = base_from_palm * palm_from_vessel;
    let observation = std::sync::Arc::new(context.robot.observe()?);
    context.kept.last_observation = Some(std::sync::Arc::clone(&observation));
    let spheres = context.robot.self_spheres();
    let table_height_m = task.shape.base_from_vessel.translation.z;
    let points = points_near(&observation, &spheres, &guess, task.shape.height_m, table_height_m);
    let outline = Outline::of(object, &task.shape);
    Ok(match fit_held_pose(&outline, &points, &observation, &guess, &base_from_palm) {
        Some(fit) => {
            let moved = guess.inverse() * fit.base_from_vessel;
            let lean_deg = (moved.rotation * nalgebra::Vector3::z()).angle(&nalgebra::Vector3::z()).to_degrees();
            Held { palm_from_vessel: base_from_palm.inverse() * fit.base_from_vessel, fit: Some((lean_deg, fit)) }
        }
        None => Held { palm_from_vessel, fit: None },
    })
}

/// Share of the speed limits with a full vessel.
const CARRY_SPEED: f64 = 0.35;
/// Afterwards the palm goes this far from the target's centre, seen from above, so that the cameras see into it, metres.
const CLEAR_M: f64 = 0.3;
/// Time between looks at the target while pouring.
const LOOK_EVERY_SECS: f64 = 0.4;
/// The stream has ended when the target gains less than this ...
const STILL_ML: f64 = 1.5;
/// ... from one group of so many looks to the next.
const N_LOOKS: usize = 3;
/// Longest wait at full tilt.
const MAX_DRAIN_SECS: f64 = 5.0;
/// Least gain that counts as poured.
const MIN_POURED_ML: f64 = 5.0;
/// Share of the speed limits while tilting.
const TILT_SPEED: f64 = 0.3;

/// Timed motions of a pour.
#[derive(Debug, Serialize, Deserialize)]
struct Motions {
    carry: JointTrajectory,
    tilt: JointTrajectory,
    /// From upright over the target to where the vessel no longer hides it.
    clear: JointTrajectory,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Phase {
    Carry,
    Tilt,
    Drain,
    Return,
    Clear,
}

/// `pour`: carries the held vessel over `target`, tilts it, turns it back and takes it out of the way.
///
/// Running while it moves; Success when back and the target has gained content; Failure `target_not_found`,
/// `no_path`, `nothing_poured` or `tracking_lost`. Halt brings the arm to rest as it is.
#[derive(Serialize, Deserialize)]
struct Pour {
    phase: Phase,
    motions: Option<Motions>,
    held: Option<Held>,
    /// Found again from the motions when a stopped pour goes on.
    #[serde(skip)]
    follower: Option<Follower>,
    target: Option<PourTarget>,
    table_height_m: f64,
    /// Gain at which enough is poured; nothing for all that comes.
    stop_ml: Option<f64>,
    before: Option<HeightMap>,
    gains_ml: Vec<(f64, f64)>,
    looked_secs: f64,
    phase_secs: f64,
}

impl Default for Pour {
    fn default() -> Self {
        Self {
            phase: Phase::Carry,
            motions: None,
            held: None,
            follower: None,
            target: None,
            table_height_m: 0.0,
            stop_ml: None,
            before: None,
            gains_ml: Vec::new(),
            looked_secs: 0.0,
            phase_secs: 0.0,
        }
    }
}

impl Pour {
    /// Looks at the target; the gain since before the pour, when enough of it is visible.
    fn look(&mut self, context: &mut SkillContext) -> Result<Option<f64>, SkillFailure> {
        let now_secs = context.robot.active_secs();
        self.looked_secs = now_secs;
        let observation = context.robot.observe()?;
        let Some(target) = &self.target else { return Ok(None) };
        let seen = surface_inside(&observation, target, self.table_height_m);
        context.kept.last_observation = Some(std::sync::Arc::new(observation));
        let Some(before) = &self.before else {
            self.before = Some(seen);
            return Ok(None);
        };
        let gain_ml = poured_ml(before, &seen, target);
        if let Some(gain_ml) = gain_ml {
            self.gains_ml.push((now_secs, gain_ml));
        }
        Ok(gain_ml)
    }

    /// No more comes: the mean of the last looks at full tilt is no higher than that of the looks before.
    fn has_ended(&self, now_secs: f64) -> bool {
        let gains: Vec<f64> =
            self.gains_ml.iter().filter(|(stamp, _)| *stamp >= self.phase_secs).map(|(_, gain)| *gain).collect();
        let mean = |looks: &[f64]| looks.iter().sum::<f64>() / looks.len() as f64;
        let is_still = gains.len() >= 2 * N_LOOKS && {
            let (before, last) = gains[gains.len() - 2 * N_LOOKS..].split_at(N_LOOKS);
            mean(last) - mean(before) < STILL_ML
        };
        is_still || now_secs - self.phase_secs > MAX_DRAIN_SECS
    }

    fn enter(&mut self, phase: Phase, trajectory: Option<JointTrajectory>, now_secs: f64) {
        self.phase = phase;
        self.phase_secs = now_secs;
        self.follower = trajectory.map(Follower::new);
    }

    fn step(&mut self, context: &mut SkillContext) -> Result<Option<(Progress, StageNote)>, SkillFailure> {
        let now_secs = context.robot.active_secs();
        let is_pouring = matches!(self.phase, Phase::Tilt | Phase::Drain);
        let mut is_full = false;
        if is_pouring && now_secs - self.looked_secs >= LOOK_EVERY_SECS {
            let gain_ml = self.look(context)?;
            is_full = gain_ml.zip(self.stop_ml).is_some_and(|(gain_ml, stop_ml)| gain_ml >= stop_ml);
        }
        let arrived = match &mut self.follower {
            Some(follower) => follower.poll(&mut context.robot)? == Progress::Success,
            None => true,
        };
        let Some(motions) = &self.motions else { return Ok(None) };
        match self.phase {
            Phase::Carry if arrived => {
                let tilt = motions.tilt.clone();
                self.enter(Phase::Tilt, Some(tilt), now_secs);
            }
            Phase::Tilt if is_full || arrived => self.enter(Phase::Drain, None, now_secs),
            Phase::Drain if is_full || self.has_ended(now_secs) => {
                let back = reversed_from(&motions.tilt, &context.robot.sent().q);
                self.enter(Phase::Return, Some(back), now_secs);
            }
            Phase::Return if arrived => {
                let clear = motions.clear.clone();
                self.enter(Phase::Clear, Some(clear), now_secs);
            }
            Phase::Clear if arrived => {
                self.look(context)?;
                let gain_ml = self.gains_ml.last().map_or(0.0, |(_, gain)| *gain);
                if gain_ml < MIN_POURED_ML {
                    return Err(SkillFailure::new(
                        FailureReason::NothingPoured,
                        format!("the cameras see {gain_ml:.0} ml more in the target after the full tilt"),
                    ));
                }
                let fit = self.held.and_then(|held| held.fit);
                let lean = fit.map_or_else(
                    || "the vessel in the hand was not seen".to_owned(),
                    |(lean_deg, _)| format!("the vessel leant {lean_deg:.0} deg in the hand"),
                );
                let note = StageNote {
                    summary: format!("the cameras see {gain_ml:.0} ml more in the target; {lean}"),
                    input_sha256: hash_of(&self.gains_ml),
                    details: serde_json::json!({
                        "gains_secs_ml": self.gains_ml,
                        "held_fit": fit.map(|(lean_deg, fit)| {
                            serde_json::json!({"lean_deg": lean_deg, "n_points": fit.n_points, "rms_m": fit.rms_m})
                        }),
                    }),
                };
                return Ok(Some((Progress::Success, note)));
            }
            _ => {}
        }
        Ok(None)
    }
}

/// The way back along a trajectory from where the arm stopped on it.
fn reversed_from(trajectory: &JointTrajectory, q: &[f64]) -> JointTrajectory {
    let distance = |sample: &Vec<f64>| sample.iter().zip(q).map(|(a, b)| (a - b).powi(2)).sum::<f64>();
    let nearest =
        (0..trajectory.q.len()).min_by(|&a, &b| distance(&trajectory.q[a]).total_cmp(&distance(&trajectory.q[b]))).unwrap_or(0);
    let end_secs = trajectory.stamps_secs[nearest];
    JointTrajectory {
        stamps_secs: (0..=nearest).rev().map(|idx| end_secs - trajectory.stamps_secs[idx]).collect(),
        q: trajectory.q[..=nearest].iter().rev().cloned().collect(),
        dq: trajectory.dq[..=nearest].iter().rev().map(|dq| dq.iter().map(|v| -v).collect()).collect(),
    }
}

impl Action<SkillContext> for Pour {
    fn start(&mut self, tick: &mut Tick<'_, SkillContext>) -> Outcome {
        *self = Self::default();
        let object = tick.input::<ObjectCluster>("object")?;
        let target = tick.input::<Option<ObjectCluster>>("target")?;
        let inventory = tick.input::<SceneInventory>("inventory")?;
        let selection = tick.input::<Selection>("selection")?;
        self.stop_ml = tick.optional::<f64>("until_ml")?.map(|ml| *ml);
        self.table_height_m = inventory.table_height_m;
        let context = &mut *tick.context;
        let planned = (|| {
            let target = target
                .as_ref()
                .as_ref()
                .ok_or_else(|| SkillFailure::new(FailureReason::TargetNotFound, "the instruction names nothing to pour into"))?;
            let task = PourTask::seen(&object, target, inventory.table_height_m)
                .ok_or_else(|| SkillFailure::new(FailureReason::NoDepth, "the vessel was seen without depth"))?;
            let held = held_vessel(context, &object, &task, &selection.chosen.candidate.base_from_palm)?;
            let scene = ArmScene::new(&context.robot, &inventory, Some(object.id), context.robot.synergy(), context.seed);
            let q = context.robot.sent().q.clone();
            // The fitted vessel may lean in the hand; it is carried upright.
            let plan = plan_pour(&scene, &q, &held.palm_from_vessel, &task, PourSearch::ChangePosture)
                .map_err(|reason| SkillFailure::new(FailureReason::NoPath, reason.to_string()))?;
            self.held = Some(held);
            let time =
                |path: &[Vec<f64>], speed| scene.time(path, speed).map_err(|why| SkillFailure::new(FailureReason::NoPath, why));
            let distance_m =
                |q: &Vec<f64>| (scene.palm_pose(q).translation.vector - task.target.rim_centre_in_base.coords).xy().norm();
            let n_near = plan.carry.iter().rev().take_while(|q| distance_m(q) < CLEAR_M).count();
            let clear: Vec<Vec<f64>> = plan.carry.iter().rev().take(n_near.max(1) + 1).cloned().collect();
            let motions = Motions {
                carry: time(&plan.carry, CARRY_SPEED)?,
                tilt: time(&plan.tilt, TILT_SPEED)?,
                clear: time(&clear, CARRY_SPEED)?,
            };
            Ok((task.target, motions, scene.guard()))
        })();
        let (target, motions, guard) = planned.map_err(|failure| context.fail_stage("pour", failure))?;
        context.robot.guard(guard);
        self.target = Some(target);
        // Before the carry and after the way back the vessel does not hide the target.
        self.look(context).map_err(|failure| context.fail_stage("pour", failure))?;
        let now_secs = context.robot.active_secs();
        self.enter(Phase::Carry, Some(motions.carry.clone()), now_secs);
        self.motions = Some(motions);
        self.poll(tick)
    }

    fn poll(&mut self, tick: &mut Tick<'_, SkillContext>) -> Outcome {
        // Read on every tick: a reloaded scenario may have changed it.
        let pace = tick.get::<f64>("pace")?;
        if let Some(follower) = &mut self.follower {
            follower.set_pace(pace);
        }
        let context = &mut *tick.context;
        match self.step(context) {
            Ok(None) => Ok(Progress::Running),
            Ok(Some(done)) => context.finish_stage("pour", Ok(done)),
            Err(failure) => Err(context.fail_stage("pour", failure)),
        }
    }

    fn save(&self) -> Option<Literal> {
        serde_json::to_string(self).ok().map(Literal::Text)
    }

    /// Goes on along the planned motion of its phase from where the arm stopped beside it.
    fn resume(&mut self, state: &Literal, tick: &mut Tick<'_, SkillContext>) -> Outcome {
        let saved = match state {
            Literal::Text(text) => serde_json::from_str::<Self>(text).map_err(|error| error.to_string()),
            other => Err(format!("expected a text, found {other}")),
        };
        let context = &mut *tick.context;
        let fail = |explanation| SkillFailure::new(FailureReason::NoPath, explanation);
        *self = saved
            .map_err(|error| context.fail_stage("pour", fail(format!("the saved state of the pour cannot be read: {error}"))))?;
        let q = context.robot.sent().q.clone();
        let motion = match (&self.motions, self.phase) {
            (None, _) | (_, Phase::Drain) => None,
            (Some(motions), Phase::Carry) => Some(motions.carry.clone()),
            (Some(motions), Phase::Tilt) => Some(motions.tilt.clone()),
            (Some(motions), Phase::Return) => Some(reversed_from(&motions.tilt, &q)),
            (Some(motions), Phase::Clear) => Some(motions.clear.clone()),
        };
        if let Some(motion) = motion {
            let (follower, beside_rad) = Follower::taken_up(motion, &q);
            if beside_rad > MAX_BESIDE_RAD {
                let explanation = format!("the arm stands {beside_rad:.2} rad beside the planned motion");
                return Err(context.fail_stage("pour", fail(explanation)));
            }
            self.follower = Some(follower);
        }
        self.poll(tick)
    }
}

/// Registers `pour`.
pub fn register(registry: &mut Registry<SkillContext>) {
    let ports = [
        PortSpec::input::<ObjectCluster>("object").default_key("object"),
        PortSpec::input::<Option<ObjectCluster>>("target").default_key("target"),
        PortSpec::input::<SceneInventory>("inventory").default_key("inventory"),
        PortSpec::input::<Selection>("selection").default_key("selection"),
        PortSpec::setting::<f64>("until_ml")
            .optional()
            .range(1.0, 5000.0)
            .doc("Stop when the target has gained this much, millilitres; until nothing more comes when left out."),
        PortSpec::setting::<f64>("pace")
            .default_value(1.0)
            .range(0.1, 1.0)
            .doc("Share of the usual speed; a reload may change it while it pours."),
    ];
    registry
        .action("pour", ports, Pour::default)
        .fails_with(
            [
                FailureReason::TargetNotFound,
                FailureReason::NoDepth,
                FailureReason::NoPath,
                FailureReason::NothingPoured,
                FailureReason::TrackingLost,
                FailureReason::NoView,
            ]
            .map(FailureReason::name),
        )
        .doc("Pours the held vessel into the target.")
        .occupies(["arm", "hand", "cameras"])
        .takes_secs(25.0);
}

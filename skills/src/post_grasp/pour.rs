//! Pours a held vessel into a target: over it, tilt about the lip until the cameras see no more coming, and back upright.

use crate::arm::{ArmScene, Miss};
use crate::context::{SkillContext, SkillFailure, StageNote, hash_of};
use crate::motion::Follower;
use crate::post_grasp::fill::{HeightMap, poured_ml, surface_inside};
use crate::post_grasp::held_pose::{HeldPose, Outline, fit_held_pose, points_near};
use crate::post_grasp::pour_path::{PourSettings, PourTarget, VesselShape, pour_palm_path, vessel_shape};
use crate::saved::starts_anew;
use sfg_planning::CollisionModel;
use sfg_tree::{Action, Literal, Outcome, PortSpec, Progress, Registry, Tick};
use sfg_types::{FailureReason, JointTrajectory, ObjectCluster, Pose, RejectionReason, SceneInventory, Selection};

/// What is poured into what, as seen before the grasp.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PourTask {
    /// The vessel.
    pub shape: VesselShape,
    /// The opening.
    pub target: PourTarget,
    /// How.
    pub settings: PourSettings,
}

impl PourTask {
    /// From the clusters of an inventory; `None` when the vessel has no points.
    #[must_use]
    pub fn seen(vessel: &ObjectCluster, target: &ObjectCluster, table_height_m: f64) -> Option<Self> {
        let shape = vessel_shape(vessel, table_height_m)?;
        Some(Self { shape, target: PourTarget::of(target, table_height_m), settings: PourSettings::default() })
    }
}

/// Arm paths of a pour.
#[derive(Clone, Debug, PartialEq)]
pub struct PourPlan {
    /// From the lifted pose to upright over the target.
    pub carry: Vec<Vec<f64>>,
    /// From upright to full tilt.
    pub tilt: Vec<Vec<f64>>,
    /// Direction of flow.
    pub heading_rad: f64,
}

/// Turns of the vessel about its own axis and directions of flow relative to the palm that are tried, in degrees.
///
/// Tilting about the palm's normal comes first: it is a turn of the last joint, as a person turns the forearm.
const TURNS_DEG: [f64; 11] = [0.0, -30.0, 30.0, -60.0, 60.0, -90.0, 90.0, -120.0, 120.0, -150.0, 150.0];
const FLOWS_DEG: [f64; 8] = [90.0, -90.0, 60.0, -60.0, 120.0, -120.0, 30.0, -30.0];
/// Rim clearances that are tried: a low pour spills less, a high one leaves room for the hand.
const CLEARANCES_M: [f64; 3] = [0.035, 0.06, 0.09];
/// Postures of the arm over the target that are tried.
const N_POSTURES: usize = 4;
/// Share of the speed limits with a full vessel.
const CARRY_SPEED: f64 = 0.35;
/// Afterwards the palm goes this far from the target's centre, seen from above, so that the cameras see into it, metres.
const CLEAR_M: f64 = 0.3;
/// Spacing of poses along the carry.
const CARRY_STEP_M: f64 = 0.02;

/// How hard a way to pour is looked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PourSearch {
    /// The arm keeps its posture: enough to compare candidates.
    KeepPosture,
    /// When that fails the arm may also turn its elbow on the way.
    ChangePosture,
}

/// One way to pour: where the palm goes.
struct PourWay {
    carry_poses: Vec<Pose>,
    tilt_poses: Vec<Pose>,
    heading_rad: f64,
}

/// Every way to pour that is tried, low and simple ones first.
fn pour_ways(base_from_lift: &Pose, palm_from_vessel: &Pose, task: &PourTask) -> Vec<PourWay> {
    let base_from_palm = task.shape.base_from_vessel * palm_from_vessel.inverse();
    let approach = base_from_palm.rotation * nalgebra::Vector3::z();
    let approach_azimuth_rad = approach.y.atan2(approach.x);
    let mut ways = Vec::new();
    for rim_clearance_m in CLEARANCES_M {
        let settings = PourSettings { rim_clearance_m, ..task.settings };
        for (flow_deg, turn_deg) in FLOWS_DEG.into_iter().flat_map(|flow| TURNS_DEG.map(|turn| (flow, turn))) {
            let turn = Pose::from_parts(
                nalgebra::Translation3::identity(),
                nalgebra::UnitQuaternion::from_axis_angle(&nalgebra::Vector3::z_axis(), turn_deg.to_radians()),
            );
            let heading_rad = approach_azimuth_rad + (flow_deg + turn_deg).to_radians();
            let shape = VesselShape { base_from_vessel: task.shape.base_from_vessel * turn, ..task.shape };
            let tilt_poses = pour_palm_path(&shape, palm_from_vessel, &task.target, heading_rad, &settings);
            let carry_poses = carry_palm_path(base_from_lift, &tilt_poses[0]);
            ways.push(PourWay { carry_poses, tilt_poses, heading_rad });
        }
    }
    ways
}

/// Arm paths for the first way of pouring that the arm can follow.
///
/// # Errors
/// The reason of the attempt that came furthest.
pub fn plan_pour(
    scene: &ArmScene<'_>,
    lift_q: &[f64],
    palm_from_vessel: &Pose,
    task: &PourTask,
    search: PourSearch,
) -> Result<PourPlan, RejectionReason> {
    let carrying = scene.with_vessel(&task.shape, palm_from_vessel);
    let ways = pour_ways(&scene.palm_pose(lift_q), palm_from_vessel, task);
    let mut furthest: Option<(usize, RejectionReason)> = None;
    let mut keep = |(n_passed, reason): (usize, RejectionReason)| {
        if furthest.as_ref().is_none_or(|(most, _)| n_passed > *most) {
            furthest = Some((n_passed, reason));
        }
    };
    for way in &ways {
        match follow(scene, &carrying, lift_q, way, None) {
            Ok(plan) => return Ok(plan),
            Err(missed) => keep(missed),
        }
    }
    if search == PourSearch::ChangePosture {
        for way in &ways {
            for posture_q in scene.configurations(&way.tilt_poses[0], lift_q, N_POSTURES).unwrap_or_default() {
                if carrying.contact(&posture_q).is_some() {
                    continue;
                }
                match follow(scene, &carrying, lift_q, way, Some(&posture_q)) {
                    Ok(plan) => return Ok(plan),
                    Err(missed) => keep(missed),
                }
            }
        }
    }
    Err(furthest.map_or(RejectionReason::NoPath { segment: "pour".to_owned() }, |(_, reason)| reason))
}

/// Arm paths along `way`; otherwise how far it came and why not further.
fn follow(
    scene: &ArmScene<'_>,
    carrying: &CollisionModel,
    lift_q: &[f64],
    way: &PourWay,
    posture_q: Option<&[f64]>,
) -> Result<PourPlan, (usize, RejectionReason)> {
    let unreachable = |n_passed: usize, key_pose: &str, miss: &Miss| {
        let key_pose = key_pose.to_owned();
        (n_passed, RejectionReason::NoInverseKinematics { key_pose, miss_m: miss.position_m })
    };
    let carry = scene.straight_towards(lift_q, &way.carry_poses, posture_q).map_err(|miss| unreachable(0, "carry", &miss))?;
    let tilt = scene
        .straight(&carry[carry.len() - 1], &way.tilt_poses)
        .map_err(|miss| unreachable(1 + miss.n_reached, "tilt", &miss))?;
    let touched = carry.iter().step_by(4).map(|q| ("carry", q)).chain(tilt.iter().step_by(2).map(|q| ("tilt", q)));
    for (key_pose, q) in touched {
        if let Some(contact) = carrying.contact(q) {
            let (key_pose, with) = (key_pose.to_owned(), contact.to_string());
            return Err((2 + way.tilt_poses.len(), RejectionReason::Collision { key_pose, with }));
        }
    }
    Ok(PourPlan { carry, tilt, heading_rad: way.heading_rad })
}

/// How the vessel lies in the hand.
#[derive(Clone, Copy, Debug, PartialEq)]
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
    let observation = context.robot.observe()?;
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

/// Palm poses from `from` to `to`: first at the greater height of the two, then down, so that a full vessel passes over things.
fn carry_palm_path(from: &Pose, to: &Pose) -> Vec<Pose> {
    let top_m = from.translation.z.max(to.translation.z);
    let raised = |pose: &Pose| {
        let mut pose = *pose;
        pose.translation.z = top_m;
        pose
    };
    let mut path = Vec::new();
    for (a, b) in [(*from, raised(from)), (raised(from), raised(to)), (raised(to), *to)] {
        let length_m = (b.translation.vector - a.translation.vector).norm();
        let n_steps = (length_m / CARRY_STEP_M).ceil() as usize;
        path.extend((1..=n_steps).map(|step| a.lerp_slerp(&b, step as f64 / n_steps as f64)));
    }
    path.push(*to);
    path
}

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
#[derive(Debug)]
struct Motions {
    carry: JointTrajectory,
    tilt: JointTrajectory,
    /// From upright over the target to where the vessel no longer hides it.
    clear: JointTrajectory,
}

#[derive(Debug, PartialEq)]
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
struct Pour {
    phase: Phase,
    motions: Option<Motions>,
    held: Option<Held>,
    follower: Option<Follower>,
    target: Option<PourTarget>,
    table_height_m: f64,
    stop_ml: f64,
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
            stop_ml: f64::INFINITY,
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
        let now_secs = context.robot.now_secs();
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
        let now_secs = context.robot.now_secs();
        let is_pouring = matches!(self.phase, Phase::Tilt | Phase::Drain);
        let mut is_full = false;
        if is_pouring && now_secs - self.looked_secs >= LOOK_EVERY_SECS {
            is_full = self.look(context)?.is_some_and(|gain_ml| gain_ml >= self.stop_ml);
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
        self.stop_ml = tick.optional::<f64>("until_ml")?.map_or(f64::INFINITY, |ml| *ml);
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
            Ok((task.target, motions))
        })();
        let (target, motions) = planned.map_err(|failure| context.fail_stage("pour", failure))?;
        self.target = Some(target);
        // Before the carry and after the way back the vessel does not hide the target.
        self.look(context).map_err(|failure| context.fail_stage("pour", failure))?;
        let now_secs = context.robot.now_secs();
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
        starts_anew()
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
        .doc("Pours the held vessel into the target.")
        .occupies(["arm", "hand", "cameras"])
        .takes_secs(25.0);
}

//! Arm paths of a pour: which way to carry and to tilt.

use crate::arm::{ArmScene, Miss};
use crate::post_grasp::pour_path::{PourSettings, PourTarget, VesselShape, pour_palm_path, vessel_shape};
use nalgebra::UnitQuaternion;
use sfg_planning::CollisionModel;
use sfg_types::{ObjectCluster, Pose, RejectionReason, Vector};

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
const N_POSTURES: usize = 8;
/// A vessel that leans after the lift is upright after this share of the carry.
const UPRIGHT_AFTER: f64 = 0.2;
/// Spacing of poses along the carry.
const CARRY_STEP_M: f64 = 0.02;

/// How hard a way to pour is looked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PourSearch {
    /// The arm keeps its posture: enough to compare candidates.
    KeepPosture,
    /// When that fails the arm may also come to the target in another posture.
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
        match keep_posture(scene, &carrying, lift_q, way) {
            Ok(plan) => return Ok(plan),
            Err(missed) => keep(missed),
        }
    }
    if search == PourSearch::ChangePosture {
        for way in &ways {
            for posture_q in scene.configurations(&way.tilt_poses[0], lift_q, N_POSTURES).unwrap_or_default() {
                match change_posture(scene, &carrying, lift_q, palm_from_vessel, way, &posture_q) {
                    Ok(plan) => return Ok(plan),
                    Err(missed) => keep(missed),
                }
            }
        }
    }
    Err(furthest.map_or(RejectionReason::NoPath { segment: "pour".to_owned() }, |(_, reason)| reason))
}

/// How far an attempt came and why not further.
type Missed = (usize, RejectionReason);

/// Straight along `way`, each step from the one before.
fn keep_posture(scene: &ArmScene<'_>, carrying: &CollisionModel, lift_q: &[f64], way: &PourWay) -> Result<PourPlan, Missed> {
    let carry = scene.straight(lift_q, &way.carry_poses).map_err(|miss| unreachable(0, "carry", miss))?;
    let tilt = tilt(scene, &carry[carry.len() - 1], way)?;
    free(carrying, way, carry, tilt)
}

/// To the posture `posture_q` over the target, the vessel upright all the way, and on along `way`.
fn change_posture(
    scene: &ArmScene<'_>,
    carrying: &CollisionModel,
    lift_q: &[f64],
    palm_from_vessel: &Pose,
    way: &PourWay,
    posture_q: &[f64],
) -> Result<PourPlan, Missed> {
    let tilt = tilt(scene, posture_q, way)?;
    let axis_in_base = |base_from_palm: &Pose| base_from_palm.rotation * palm_from_vessel.rotation * Vector::z();
    let lean_at_lift = axis_in_base(&scene.palm_pose(lift_q));
    let carry = scene
        .bent(lift_q, posture_q, |share, base_from_palm| {
            let leaning = lean_at_lift.lerp(&Vector::z(), (share / UPRIGHT_AFTER).min(1.0));
            let turn = UnitQuaternion::rotation_between(&axis_in_base(base_from_palm), &leaning).unwrap_or_default();
            Pose::from_parts(base_from_palm.translation, turn * base_from_palm.rotation)
        })
        .map_err(|miss| unreachable(1, "carry", miss))?;
    free(carrying, way, carry, tilt)
}

fn tilt(scene: &ArmScene<'_>, from_q: &[f64], way: &PourWay) -> Result<Vec<Vec<f64>>, Missed> {
    scene.straight(from_q, &way.tilt_poses).map_err(|miss| unreachable(1 + miss.n_reached, "tilt", miss))
}

/// The plan if nothing is touched on it.
fn free(carrying: &CollisionModel, way: &PourWay, carry: Vec<Vec<f64>>, tilt: Vec<Vec<f64>>) -> Result<PourPlan, Missed> {
    let checked = carry.iter().map(|q| ("carry", q)).chain(tilt.iter().map(|q| ("tilt", q)));
    for (key_pose, q) in checked {
        if let Some(contact) = carrying.contact(q) {
            let (key_pose, with) = (key_pose.to_owned(), contact.to_string());
            return Err((2 + way.tilt_poses.len(), RejectionReason::Collision { key_pose, with }));
        }
    }
    Ok(PourPlan { carry, tilt, heading_rad: way.heading_rad })
}

fn unreachable(n_passed: usize, key_pose: &str, miss: Miss) -> Missed {
    (n_passed, miss.rejection(key_pose))
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

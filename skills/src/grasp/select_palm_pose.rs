//! Step 8: which palm pose is executed: one that the arm reaches, before and after the grasp.
//!
//! A grasp is worth nothing when the arm cannot do the task with it. So each candidate is followed through its key poses
//! (stand-off, grasp, lift, and for pouring carry and tilt) before it is chosen, and each rejection names the pose that failed.

use crate::arm::{ArmScene, PLAN_SPEED};
use crate::context::{SkillContext, SkillFailure, StageNote, hash_of};
use crate::grasp::reconstruct_object::Reconstruction;
use crate::grasp::synthesize_grasp::arrival_shape;
use crate::post_grasp::pour_plan::{PourSearch, PourTask, plan_pour};
use sfg_tree::{PortSpec, Registry};
use sfg_types::{
    FailureReason, GraspFunctionality, ObjectCluster, PalmPoseCandidate, PlannedGrasp, Point, Pose, Rejected, RejectionReason,
    SceneInventory, Selection, Task,
};
use std::sync::Arc;

/// What selection needs beyond the candidates.
#[derive(Clone, Debug)]
pub struct SelectionSettings {
    /// Straight way from the stand-off to the grasp, metres.
    pub standoff_m: f64,
    /// Height of the first lift, metres.
    pub lift_m: f64,
    /// A palm farther than this from the key point holds another part, metres.
    pub max_key_point_distance_m: f64,
    /// Arm configurations tried for each candidate.
    pub n_configurations: usize,
}

impl Default for SelectionSettings {
    fn default() -> Self {
        Self { standoff_m: 0.12, lift_m: 0.15, max_key_point_distance_m: 0.12, n_configurations: 6 }
    }
}

/// The first candidate, best first, that the arm can reach and use.
///
/// With a reachability map, candidates that it holds for hopeless cost a few descents instead of all; the choice is the same.
///
/// # Errors
/// Every candidate with the reason of its rejection when none can be used.
pub fn select_palm_pose(
    candidates: &[PalmPoseCandidate],
    key_point_in_base: &Point,
    start_q: &[f64],
    scene: &ArmScene<'_>,
    pour: Option<&PourTask>,
    settings: &SelectionSettings,
) -> Result<Selection, Vec<Rejected>> {
    // What the map holds for hopeless is passed over at first; when nothing else can be used, inverse kinematics decides there too.
    let mut rejected: Vec<Rejected> = Vec::new();
    let mut passed_over: Vec<Rejected> = Vec::new();
    let hopeless = |candidate: &PalmPoseCandidate| scene.hopeless(&candidate.base_from_palm, start_q);
    let follow = |candidate: &PalmPoseCandidate| follow_through(candidate, key_point_in_base, start_q, scene, pour, settings);
    let mut chosen = None;
    for (candidate_idx, candidate) in candidates.iter().enumerate() {
        if chosen.is_some() {
            rejected.push(Rejected { candidate_idx, reason: RejectionReason::RankedLower });
        } else if let Some(miss) = hopeless(candidate) {
            passed_over.push(Rejected { candidate_idx, reason: miss.rejection("grasp") });
        } else {
            match follow(candidate) {
                Ok(plan) => chosen = Some((candidate_idx, plan)),
                Err(reason) => rejected.push(Rejected { candidate_idx, reason }),
            }
        }
    }
    for one in passed_over {
        match chosen {
            Some(_) => rejected.push(one),
            None => match follow(&candidates[one.candidate_idx]) {
                Ok(plan) => chosen = Some((one.candidate_idx, plan)),
                Err(reason) => rejected.push(Rejected { reason, ..one }),
            },
        }
    }
    rejected.sort_by_key(|one| one.candidate_idx);
    let Some((candidate_idx, (base_from_standoff, transit, approach))) = chosen else { return Err(rejected) };
    let candidate = candidates[candidate_idx].clone();
    Ok(Selection { chosen: PlannedGrasp { candidate_idx, candidate, base_from_standoff, transit, approach }, rejected })
}

type Motion = sfg_types::JointTrajectory;

/// Plans one candidate; the reason of the attempt that came furthest when it cannot be used.
fn follow_through(
    candidate: &PalmPoseCandidate,
    key_point_in_base: &Point,
    start_q: &[f64],
    scene: &ArmScene<'_>,
    pour: Option<&PourTask>,
    settings: &SelectionSettings,
) -> Result<(Pose, Motion, Motion), RejectionReason> {
    let base_from_grasp = candidate.base_from_palm;
    let distance_m = (base_from_grasp * Point::origin() - key_point_in_base).norm();
    if distance_m > settings.max_key_point_distance_m {
        return Err(RejectionReason::FarFromKeyPoint { distance_m });
    }
    let grasp_qs =
        scene.configurations(&base_from_grasp, start_q, settings.n_configurations).map_err(|miss| miss.rejection("grasp"))?;
    let base_from_standoff = base_from_grasp * Pose::translation(0.0, 0.0, -settings.standoff_m);
    let mut furthest: Option<(usize, RejectionReason)> = None;
    for grasp_q in &grasp_qs {
        match follow_configuration(grasp_q, &base_from_grasp, &base_from_standoff, start_q, scene, pour, settings) {
            Ok((transit, approach)) => return Ok((base_from_standoff, transit, approach)),
            Err((n_passed, reason)) => {
                if furthest.as_ref().is_none_or(|(most, _)| n_passed > *most) {
                    furthest = Some((n_passed, reason));
                }
            }
        }
    }
    Err(furthest.map_or(RejectionReason::RankedLower, |(_, reason)| reason))
}

/// Follows one arm configuration through the key poses; on failure how many were passed.
fn follow_configuration(
    grasp_q: &[f64],
    base_from_grasp: &Pose,
    base_from_standoff: &Pose,
    start_q: &[f64],
    scene: &ArmScene<'_>,
    pour: Option<&PourTask>,
    settings: &SelectionSettings,
) -> Result<(Motion, Motion), (usize, RejectionReason)> {
    let collision = |key_pose: &str, with: String| RejectionReason::Collision { key_pose: key_pose.to_owned(), with };
    if let Some(with) = scene.touches_at_grasp(grasp_q) {
        return Err((0, collision("grasp", with)));
    }
    let mut approach_path = scene.straight(grasp_q, &[*base_from_standoff]).map_err(|miss| (1, miss.rejection("standoff")))?;
    let standoff_q = approach_path[approach_path.len() - 1].clone();
    if let Some(with) = scene.touches(&standoff_q) {
        return Err((1, collision("standoff", with)));
    }
    if let Some(with) = approach_path.iter().find_map(|q| scene.touches_at_grasp(q)) {
        return Err((1, collision("approach", with)));
    }
    let mut base_from_lift = *base_from_grasp;
    base_from_lift.translation.z += settings.lift_m;
    let lift_path = scene.straight(grasp_q, &[base_from_lift]).map_err(|miss| (2, miss.rejection("lift")))?;
    if let Some(with) = lift_path.iter().find_map(|q| scene.touches_at_grasp(q)) {
        return Err((2, collision("lift", with)));
    }
    let lift_q = &lift_path[lift_path.len() - 1];
    if let Some(pour) = pour {
        let palm_from_vessel = base_from_grasp.inverse() * pour.shape.base_from_vessel;
        plan_pour(scene, lift_q, &palm_from_vessel, pour, PourSearch::KeepPosture).map_err(|reason| (3, reason))?;
    }
    let transit = scene
        .plan(start_q, &standoff_q, PLAN_SPEED)
        .map_err(|why| (4, RejectionReason::NoPath { segment: format!("way to the stand-off ({why})") }))?;
    approach_path.reverse();
    let approach = scene
        .time(&approach_path, APPROACH_SPEED)
        .map_err(|why| (5, RejectionReason::NoPath { segment: format!("approach ({why})") }))?;
    Ok((transit, approach))
}

/// Share of the speed limits near the object.
const APPROACH_SPEED: f64 = 0.15;

/// `select_palm_pose`: Success with `selection` written, Failure `no_candidate_reachable`. Never Running.
pub fn register(registry: &mut Registry<SkillContext>) {
    let ports = [
        PortSpec::input::<Vec<PalmPoseCandidate>>("candidates").default_key("candidates"),
        PortSpec::input::<Reconstruction>("reconstruction").default_key("reconstruction"),
        PortSpec::input::<SceneInventory>("inventory").default_key("inventory"),
        PortSpec::input::<GraspFunctionality>("functionality").default_key("functionality"),
        PortSpec::input::<ObjectCluster>("object").default_key("object"),
        PortSpec::input::<Option<ObjectCluster>>("target").default_key("target"),
        PortSpec::setting::<f64>("lift_m").default_value(0.15).range(0.0, 0.5).doc("Height of the first lift, metres."),
        PortSpec::output::<Selection>("selection").default_key("selection").doc("the grasp to execute, and why not the others"),
    ];
    registry.step("select_palm_pose", ports, |tick| {
        let candidates = tick.input::<Vec<PalmPoseCandidate>>("candidates")?;
        let reconstruction = tick.input::<Reconstruction>("reconstruction")?;
        let inventory = tick.input::<SceneInventory>("inventory")?;
        let functionality = tick.input::<GraspFunctionality>("functionality")?;
        let object = tick.input::<ObjectCluster>("object")?;
        let target = tick.input::<Option<ObjectCluster>>("target")?;
        let settings = SelectionSettings { lift_m: tick.get::<f64>("lift_m")?, ..SelectionSettings::default() };
        let context = &mut *tick.context;
        let scene = ArmScene::new(&context.robot, &inventory, Some(object.id), arrival_shape(functionality.grasp_type, &context.synergy), context.seed);
        let pour = match (functionality.task, target.as_ref()) {
            (Task::Pour, Some(target)) => PourTask::seen(&object, target, inventory.table_height_m),
            _ => None,
        };
        let start_q = context.robot.sent().q.clone();
        let key_point = reconstruction.key_point.point_in_base;
        let guard = scene.guard();
        let scores = |candidates: &[PalmPoseCandidate]| {
            candidates.iter().map(|candidate| scene.reach_score(&candidate.base_from_palm)).collect::<Option<Vec<f64>>>()
        };
        let outcome = match select_palm_pose(&candidates, &key_point, &start_q, &scene, pour.as_ref(), &settings) {
            Ok(selection) => {
                let chosen = &selection.chosen;
                let palm = chosen.candidate.base_from_palm.translation.vector;
                let n_unusable =
                    selection.rejected.iter().filter(|rejected| rejected.reason != RejectionReason::RankedLower).count();
                let note = StageNote {
                    summary: format!(
                        "candidate {} of {}: palm at ({:.2}, {:.2}, {:.2}) m, stability {:.2}; {n_unusable} could not be used",
                        chosen.candidate_idx + 1,
                        candidates.len(),
                        palm.x,
                        palm.y,
                        palm.z,
                        chosen.candidate.stability
                    ),
                    input_sha256: hash_of(&(&*candidates, &start_q)),
                    details: serde_json::json!({"chosen": chosen.candidate_idx, "candidate": chosen.candidate, "reach_scores": scores(&candidates), "rejected": selection.rejected}),
                };
                Ok((selection, note))
            }
            Err(rejected) => {
                let reasons: Vec<String> =
                    rejected.iter().map(|one| format!("{}: {}", one.candidate_idx + 1, one.reason)).collect();
                let explanation = format!("none of {} palm poses can be used: {}", rejected.len(), reasons.join("; "));
                context.kept.rejected = Some(Arc::new(rejected));
                Err(SkillFailure::new(FailureReason::NoCandidateReachable, explanation))
            }
        };
        let selection = Arc::new(context.finish_stage("select_palm_pose", outcome)?);
        context.kept.selection = Some(Arc::clone(&selection));
        context.robot.guard(guard);
        tick.set_shared("selection", selection);
        Ok(())
    }).fails_with([FailureReason::NoCandidateReachable].map(FailureReason::name));
}

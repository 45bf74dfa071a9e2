//! Step 7: candidate palm poses, by the pose generator.

use crate::context::{SkillContext, SkillFailure, StageNote, hash_of};
use crate::grasp::reconstruct_object::Reconstruction;
use sfg_plugin::PoseRequest;
use sfg_tree::{PortSpec, Registry};
use sfg_types::{FailureReason, GraspFunctionality, PalmPoseCandidate, Pose, SceneInventory, SynergyCoordinates};
use std::sync::Arc;

/// `generate_palm_poses`: Success with `candidates` written, best first; Failure `no_candidate` or `plugin_failed`. Never Running.
pub fn register(registry: &mut Registry<SkillContext>) {
    let ports = [
        PortSpec::input::<Reconstruction>("reconstruction").default_key("reconstruction"),
        PortSpec::input::<GraspFunctionality>("functionality").default_key("functionality"),
        PortSpec::input::<SceneInventory>("inventory").default_key("inventory"),
        PortSpec::setting::<usize>("n_candidates").default_value(15).doc("Most candidates to ask for; 15 in the paper."),
        PortSpec::output::<Vec<PalmPoseCandidate>>("candidates").default_key("candidates").doc("palm poses, best first"),
    ];
    registry
        .step("generate_palm_poses", ports, |tick| {
            let reconstruction = tick.input::<Reconstruction>("reconstruction")?;
            let functionality = tick.input::<GraspFunctionality>("functionality")?;
            let inventory = tick.input::<SceneInventory>("inventory")?;
            let n_candidates = tick.get::<usize>("n_candidates")?;
            let context = &mut *tick.context;
            let request = PoseRequest {
                tsdf: &reconstruction.tsdf,
                affordance_region: &reconstruction.affordance_region,
                key_point: &reconstruction.key_point,
                hand: context.synergy.profile(),
                hand_side: context.robot.side(),
                grasp_type: functionality.grasp_type,
                table_height_m: inventory.table_height_m,
            };
            let blank = PalmPoseCandidate {
                base_from_palm: Pose::identity(),
                hand_side: context.robot.side(),
                stability: 0.0,
                synergy: SynergyCoordinates::OPEN,
                terms: Vec::new(),
            };
            let mut candidates = vec![blank; n_candidates];
            let outcome = context
                .plugins
                .pose_generator
                .generate(&request, &mut candidates)
                .map_err(|error| SkillFailure::plugin(&error))
                .and_then(|n_found| {
                    candidates.truncate(n_found);
                    if candidates.is_empty() {
                        return Err(SkillFailure::new(
                            FailureReason::NoCandidate,
                            format!(
                                "no palm pose was found for {} on the {}",
                                functionality.grasp_type, functionality.affordance
                            ),
                        ));
                    }
                    let note = StageNote {
                        summary: format!(
                            "{n_found} palm poses for {}, stability {:.2} to {:.2}",
                            functionality.grasp_type,
                            candidates[n_found - 1].stability,
                            candidates[0].stability
                        ),
                        input_sha256: hash_of(&(&reconstruction.tsdf.distances, &reconstruction.affordance_region)),
                        details: serde_json::json!({"candidates": candidates}),
                    };
                    Ok((candidates, note))
                });
            let candidates = Arc::new(context.finish_stage("generate_palm_poses", outcome)?);
            context.kept.candidates = Some(Arc::clone(&candidates));
            tick.set_shared("candidates", candidates);
            Ok(())
        })
        .fails_with([FailureReason::NoCandidate, FailureReason::PluginFailed].map(FailureReason::name));
}

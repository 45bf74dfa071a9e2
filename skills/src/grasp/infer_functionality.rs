//! Step 4: how the object must be held, by the language backend, checked before anything moves.

use crate::context::{SkillContext, SkillFailure, StageNote, hash_of};
use sfg_plugin::FunctionalityRequest;
use sfg_tree::{PortSpec, Registry};
use sfg_types::{FailureReason, FunctionalityAnswer, GraspFunctionality, ObjectCluster, SceneInventory, Task};
use std::sync::Arc;

/// The functionality in `answer`, when it names things that are there and can be acted on.
///
/// # Errors
/// `needs_answer`, `refused`, or `invalid_functionality` when the answer does not fit the scene: a backend's word is not
/// trusted before a robot moves.
pub fn accepted(answer: FunctionalityAnswer, inventory: &SceneInventory) -> Result<GraspFunctionality, SkillFailure> {
    let functionality = match answer {
        FunctionalityAnswer::Act(functionality) => functionality,
        FunctionalityAnswer::Ask { question, choices } => {
            return Err(SkillFailure::new(FailureReason::NeedsAnswer, format!("{question} ({})", choices.join(" / "))));
        }
        FunctionalityAnswer::Refuse { reason } => return Err(SkillFailure::new(FailureReason::Refused, reason)),
    };
    let invalid = |explanation: String| Err(SkillFailure::new(FailureReason::InvalidFunctionality, explanation));
    if inventory.cluster(functionality.object.cluster_id).is_none() {
        return invalid(format!("the backend wants to hold thing {}, which is not there", functionality.object.cluster_id));
    }
    if let Some(target) = &functionality.target {
        if inventory.cluster(target.cluster_id).is_none() {
            return invalid(format!("the backend acts on thing {}, which is not there", target.cluster_id));
        }
        if target.cluster_id == functionality.object.cluster_id {
            return invalid(format!("the {} cannot be both held and acted on", target.name));
        }
    }
    if functionality.affordance.trim().is_empty() {
        return invalid("the backend names no part to hold".to_owned());
    }
    if !(0.0..=1.0).contains(&functionality.confidence) {
        return invalid(format!("the backend's confidence {} is not between 0 and 1", functionality.confidence));
    }
    if functionality.task == Task::Pour && functionality.target.is_none() {
        return Err(SkillFailure::new(
            FailureReason::NeedsAnswer,
            format!("what should the {} be poured into?", functionality.object.name),
        ));
    }
    Ok(functionality)
}

/// `infer_functionality`: Success with `functionality`, `object` and `target` written, Failure `needs_answer`, `refused`,
/// `invalid_functionality` or `plugin_failed`. Never Running.
pub fn register(registry: &mut Registry<SkillContext>) {
    let ports = [
        PortSpec::input::<SceneInventory>("inventory").default_key("inventory"),
        PortSpec::output::<GraspFunctionality>("functionality").default_key("functionality"),
        PortSpec::output::<ObjectCluster>("object").default_key("object").doc("the thing to hold"),
        PortSpec::output::<Option<ObjectCluster>>("target").default_key("target").doc("what the task acts on, if anything"),
    ];
    registry
        .step("infer_functionality", ports, |tick| {
            let inventory = tick.input::<SceneInventory>("inventory")?;
            let context = &mut *tick.context;
            let request = FunctionalityRequest { instruction: &context.instruction, inventory: &inventory };
            let input_sha256 = hash_of(&(&context.instruction, &*inventory));
            let answer = context.plugins.llm.infer(&request).map_err(|error| SkillFailure::plugin(&error));
            context.kept.answer = answer.as_ref().ok().cloned();
            let outcome = answer.and_then(|answer| accepted(answer, &inventory)).map(|functionality| {
                let target = functionality.target.as_ref().map_or(String::new(), |target| format!(" into the {}", target.name));
                let note = StageNote {
                    summary: format!(
                        "{} the {}{target}: hold the {} with {} ({:.2})",
                        functionality.task,
                        functionality.object.name,
                        functionality.affordance,
                        functionality.grasp_type,
                        functionality.confidence
                    ),
                    input_sha256,
                    details: serde_json::json!(functionality),
                };
                (functionality, note)
            });
            let functionality = context.finish_stage("infer_functionality", outcome)?;
            let object = inventory.cluster(functionality.object.cluster_id).cloned();
            let target = functionality.target.as_ref().and_then(|target| inventory.cluster(target.cluster_id)).cloned();
            tick.set_shared("functionality", Arc::new(functionality));
            if let Some(object) = object {
                tick.context.kept.object_in_base = Some(object.centre_in_base);
                tick.set_shared("object", Arc::new(object));
            }
            tick.set_shared("target", Arc::new(target));
            Ok(())
        })
        .fails_with(
            [
                FailureReason::InvalidFunctionality,
                FailureReason::NeedsAnswer,
                FailureReason::Refused,
                FailureReason::PluginFailed,
            ]
            .map(FailureReason::name),
        );
}

#[cfg(test)]
mod tests {
    #![expect(clippy::unwrap_used, reason = "tests fail by panicking")]
    use super::*;
    use sfg_types::{ColourName, GraspType, ObjectRef, Point, ShapeClass, Vector};

    fn inventory(n: u32) -> SceneInventory {
        let clusters = (0..n)
            .map(|id| ObjectCluster {
                id,
                size_m: Vector::repeat(0.1),
                yaw_rad: 0.0,
                centre_in_base: Point::origin(),
                colour: ColourName::Red,
                shape: ShapeClass::Blob,
                names: Vec::new(),
                points_in_base: Vec::new(),
            })
            .collect();
        SceneInventory { clusters, table_height_m: 0.75 }
    }

    fn act(object: u32, target: Option<u32>, affordance: &str, confidence: f64) -> FunctionalityAnswer {
        let reference = |cluster_id| ObjectRef { cluster_id, name: "thing".into() };
        FunctionalityAnswer::Act(GraspFunctionality {
            object: reference(object),
            task: Task::Pour,
            target: target.map(reference),
            affordance: affordance.into(),
            grasp_type: GraspType::LargeDiameter,
            confidence,
            rationale: Vec::new(),
        })
    }

    #[track_caller]
    fn check(answer: FunctionalityAnswer, expected: Option<FailureReason>) {
        assert_eq!(accepted(answer, &inventory(2)).err().map(|failure| failure.reason), expected);
    }

    #[test]
    fn answers_are_checked_against_the_scene() {
        check(act(0, Some(1), "body", 0.9), None);
        check(act(5, Some(1), "body", 0.9), Some(FailureReason::InvalidFunctionality)); // held thing is absent
        check(act(0, Some(5), "body", 0.9), Some(FailureReason::InvalidFunctionality)); // target is absent
        check(act(0, Some(0), "body", 0.9), Some(FailureReason::InvalidFunctionality)); // poured into itself
        check(act(0, Some(1), " ", 0.9), Some(FailureReason::InvalidFunctionality)); // no part
        check(act(0, Some(1), "body", f64::NAN), Some(FailureReason::InvalidFunctionality));
        check(act(0, None, "body", 0.9), Some(FailureReason::NeedsAnswer)); // poured into what
        check(FunctionalityAnswer::Refuse { reason: "no".into() }, Some(FailureReason::Refused));
    }

    #[test]
    fn a_question_carries_its_choices() {
        let ask = FunctionalityAnswer::Ask { question: "which mug?".into(), choices: vec!["red".into(), "blue".into()] };
        let failure = accepted(ask, &inventory(2)).unwrap_err();
        assert_eq!(failure.explanation, "which mug? (red / blue)");
    }
}

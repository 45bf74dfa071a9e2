//! Step 9: how the hand is shaped on the way and where it closes to.

use crate::context::{SkillContext, StageNote, hash_of};
use sfg_plugin::ClosingPlan;
use sfg_synergy::SynergySpace;
use sfg_tree::{PortSpec, Registry};
use sfg_types::{GraspFunctionality, GraspType, Opposition, Selection, SynergyCoordinates};
use std::sync::Arc;

/// The shape in which the hand comes to the object.
///
/// A wrap's thumb stands opposite the fingers, so that nothing passes between them: it arrives open and takes its preshape
/// around the object. Finger tips arrive in their preshape, wide enough for what they pinch.
#[must_use]
pub fn arrival_shape(grasp_type: GraspType, synergy: &SynergySpace) -> SynergyCoordinates {
    match grasp_type.opposition() {
        Opposition::Palm => SynergyCoordinates::OPEN,
        Opposition::Pad | Opposition::Side => synergy.preshape(grasp_type),
    }
}

/// The closing of `selection` with the hand's target for `grasp_type`.
#[must_use]
pub fn closing_plan(selection: &Selection, grasp_type: GraspType, synergy: &SynergySpace) -> ClosingPlan {
    ClosingPlan {
        preshape: synergy.preshape(grasp_type),
        target: selection.chosen.candidate.synergy,
        grasp_type,
        base_from_palm: selection.chosen.candidate.base_from_palm,
    }
}

/// `synthesize_grasp`: Success with `closing_plan` written. Never Running, never fails.
pub fn register(registry: &mut Registry<SkillContext>) {
    let ports = [
        PortSpec::input::<Selection>("selection").default_key("selection"),
        PortSpec::input::<GraspFunctionality>("functionality").default_key("functionality"),
        PortSpec::output::<ClosingPlan>("closing_plan").default_key("closing_plan").doc("preshape and target synergy"),
    ];
    registry
        .step("synthesize_grasp", ports, |tick| {
            let selection = tick.input::<Selection>("selection")?;
            let functionality = tick.input::<GraspFunctionality>("functionality")?;
            let plan = closing_plan(&selection, functionality.grasp_type, &tick.context.synergy);
            let note = StageNote {
                summary: format!(
                    "preshape c = ({:.2}, {:.2}), close to c = ({:.2}, {:.2})",
                    plan.preshape.c1, plan.preshape.c2, plan.target.c1, plan.target.c2
                ),
                input_sha256: hash_of(&(functionality.grasp_type, &selection.chosen.candidate)),
                details: serde_json::json!({"preshape": plan.preshape, "target": plan.target}),
            };
            let plan = tick.context.finish_stage("synthesize_grasp", Ok((plan, note)))?;
            tick.set_shared("closing_plan", Arc::new(plan));
            Ok(())
        })
        .fails_with(Vec::<&str>::new());
}

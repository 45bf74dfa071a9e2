//! Step 5: which pixels show the part to hold, by the grounder.

use crate::context::{SkillContext, SkillFailure, StageNote, hash_of};
use crate::grasp::observe_scene::hash_observation;
use sfg_plugin::AffordanceQuery;
use sfg_tree::{PortSpec, Registry};
use sfg_types::{AffordanceMask, FailureReason, GraspFunctionality, ObjectCluster, Observation};
use std::sync::Arc;

/// Fewest pixels over all views that make a part.
const MIN_PART_PIXELS: usize = 40;

/// `ground_affordance`: Success with `masks` written (one a view), Failure `part_not_found` or `plugin_failed`. Never Running.
pub fn register(registry: &mut Registry<SkillContext>) {
    let ports = [
        PortSpec::input::<Observation>("observation").default_key("observation"),
        PortSpec::input::<ObjectCluster>("object").default_key("object"),
        PortSpec::input::<GraspFunctionality>("functionality").default_key("functionality"),
        PortSpec::output::<Vec<AffordanceMask>>("masks").default_key("masks").doc("pixels of the part, one mask a view"),
    ];
    registry
        .step("ground_affordance", ports, |tick| {
            let observation = tick.input::<Observation>("observation")?;
            let object = tick.input::<ObjectCluster>("object")?;
            let functionality = tick.input::<GraspFunctionality>("functionality")?;
            let query = AffordanceQuery {
                observation: &observation,
                cluster: &object,
                object_name: &functionality.object.name,
                affordance: &functionality.affordance,
            };
            let mut masks: Vec<AffordanceMask> = observation
                .views
                .iter()
                .map(|view| AffordanceMask::empty(&view.camera, view.intrinsics.width, view.intrinsics.height))
                .collect();
            let context = &mut *tick.context;
            let outcome =
                context.plugins.grounder.ground(&query, &mut masks).map_err(|error| SkillFailure::plugin(&error)).and_then(
                    |()| {
                        let n_pixels: Vec<usize> = masks.iter().map(AffordanceMask::n_selected).collect();
                        if n_pixels.iter().sum::<usize>() < MIN_PART_PIXELS {
                            return Err(SkillFailure::new(
                                FailureReason::PartNotFound,
                                format!("no view shows the {} of the {}", functionality.affordance, functionality.object.name),
                            ));
                        }
                        let note = StageNote {
                            summary: format!(
                                "{} of the {}: {n_pixels:?} pixels",
                                functionality.affordance, functionality.object.name
                            ),
                            input_sha256: hash_of(&(hash_observation(&observation), &*functionality)),
                            details: serde_json::json!({"n_pixels": n_pixels}),
                        };
                        Ok((masks, note))
                    },
                );
            let masks = Arc::new(context.finish_stage("ground_affordance", outcome)?);
            context.kept.masks = Some(Arc::clone(&masks));
            tick.set_shared("masks", masks);
            Ok(())
        })
        .fails_with([FailureReason::PartNotFound, FailureReason::PluginFailed].map(FailureReason::name));
}

//! Step 3: what stands on the table, by the grounder.

use crate::context::{SkillContext, SkillFailure, StageNote};
use crate::grasp::observe_scene::hash_observation;
use sfg_tree::{PortSpec, Registry};
use sfg_types::{FailureReason, Observation, SceneInventory};
use std::sync::Arc;

fn describe(inventory: &SceneInventory) -> String {
    let things: Vec<String> = inventory
        .clusters
        .iter()
        .map(|cluster| {
            let name = cluster.names.first().map_or("thing", |ranked| ranked.name.as_str());
            format!(
                "{name} ({:.0} x {:.0} x {:.0} mm at {:.2}, {:.2})",
                1000.0 * cluster.size_m.x,
                1000.0 * cluster.size_m.y,
                1000.0 * cluster.size_m.z,
                cluster.centre_in_base.x,
                cluster.centre_in_base.y
            )
        })
        .collect();
    format!("table at {:.3} m: {}", inventory.table_height_m, things.join(", "))
}

/// `list_scene`: Success with `inventory` written, Failure `nothing_on_table` or `plugin_failed`. Never Running.
pub fn register(registry: &mut Registry<SkillContext>) {
    let ports = [
        PortSpec::input::<Observation>("observation").default_key("observation"),
        PortSpec::output::<SceneInventory>("inventory").default_key("inventory").doc("the things on the table"),
    ];
    registry
        .step("list_scene", ports, |tick| {
            let observation = tick.input::<Observation>("observation")?;
            let spheres = tick.context.robot.self_spheres();
            let outcome = tick
                .context
                .plugins
                .grounder
                .list_scene(&observation, &spheres)
                .map_err(|error| SkillFailure::plugin(&error))
                .and_then(|inventory| {
                    if inventory.clusters.is_empty() {
                        return Err(SkillFailure::new(FailureReason::NothingOnTable, "no object was found on the table"));
                    }
                    let note = StageNote {
                        summary: describe(&inventory),
                        input_sha256: hash_observation(&observation),
                        details: serde_json::json!(inventory),
                    };
                    Ok((inventory, note))
                });
            let inventory = Arc::new(tick.context.finish_stage("list_scene", outcome)?);
            tick.context.kept.inventory = Some(Arc::clone(&inventory));
            tick.set_shared("inventory", inventory);
            Ok(())
        })
        .fails_with([FailureReason::NothingOnTable, FailureReason::PluginFailed].map(FailureReason::name));
}

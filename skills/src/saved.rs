//! Artefacts as plain data, so that a stopped run can go on in another process.
//!
//! Only what skills after a motion read is here; images and volumes are made anew by looking again.

use crate::context::SkillContext;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use sfg_plugin::ClosingPlan;
use sfg_tree::{Literal, Registry};
use sfg_types::{GraspFunctionality, ObjectCluster, SceneInventory, Selection};

/// Tells the registry how artefacts are written down.
pub fn register(registry: &mut Registry<SkillContext>) {
    keep::<SceneInventory>(registry, |inventory| inventory.clusters.iter_mut().collect());
    keep::<ObjectCluster>(registry, |cluster| vec![cluster]);
    keep::<Option<ObjectCluster>>(registry, |cluster| cluster.iter_mut().collect());
    keep::<GraspFunctionality>(registry, |_| Vec::new());
    keep::<Selection>(registry, |_| Vec::new());
    keep::<ClosingPlan>(registry, |_| Vec::new());
}

/// Points are no part of a cluster's JSON, so that reports stay small; here they are kept beside it.
#[derive(Serialize, Deserialize)]
struct Saved<T> {
    value: T,
    points_in_base: Vec<Vec<[f32; 3]>>,
}

/// A JSON text: artefacts are no business of those who read a saved tree.
fn keep<T: Clone + Serialize + DeserializeOwned + Send + Sync + 'static>(
    registry: &mut Registry<SkillContext>,
    clusters: fn(&mut T) -> Vec<&mut ObjectCluster>,
) {
    registry.saved_form::<T>(
        move |value| {
            let mut value = value.clone();
            let points_in_base = clusters(&mut value)
                .into_iter()
                .map(|cluster| {
                    std::mem::take(&mut cluster.points_in_base).iter().map(|point| [point.x, point.y, point.z]).collect()
                })
                .collect();
            serde_json::to_string(&Saved { value, points_in_base }).ok().map(Literal::Text)
        },
        move |literal| {
            let Literal::Text(text) = literal else { return Err(format!("expected a text, found {literal}")) };
            let mut saved: Saved<T> = serde_json::from_str(text).map_err(|error| error.to_string())?;
            for (cluster, points) in clusters(&mut saved.value).into_iter().zip(saved.points_in_base) {
                cluster.points_in_base = points.into_iter().map(nalgebra::Point3::from).collect();
            }
            Ok(saved.value)
        },
    );
}

/// What a motion says that is resumed by starting anew from where the arm stands.
pub(crate) fn starts_anew() -> Option<Literal> {
    Some(Literal::Text("starts anew".to_owned()))
}

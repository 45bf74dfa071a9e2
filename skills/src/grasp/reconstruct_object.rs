//! Step 6: the task key point and the TSDF of the object, from all views.

use crate::context::{SkillContext, SkillFailure, StageNote, hash_of};
use crate::grasp::observe_scene::hash_observation;
use nalgebra::Point3;
use sfg_geometry::tsdf::{TsdfView, fuse_views};
use sfg_geometry::{affordance_region, cloud, task_key_point};
use sfg_tree::{PortSpec, Registry};
use sfg_types::{AffordanceMask, FailureReason, ObjectCluster, Observation, Point, RgbdImage, TaskKeyPoint, Tsdf};
use std::collections::BTreeSet;
use std::sync::Arc;

/// A pixel belongs to the object when a point of its cluster lies within about this distance.
const CLUSTER_REACH_M: f64 = 0.008;

/// What is known of the object's shape.
#[derive(Clone, Debug, PartialEq)]
pub struct Reconstruction {
    /// Where the grasp should be near.
    pub key_point: TaskKeyPoint,
    /// The object.
    pub tsdf: Tsdf,
    /// `EDGE^3`: 1 where the surface belongs to the part to hold.
    pub affordance_region: Vec<u8>,
}

/// Fuses the views of one object.
///
/// # Errors
/// `part_not_found` or `no_depth` when the masks select nothing that has depth: ordinary outcomes, the caller looks again.
pub fn reconstruct(
    observation: &Observation,
    object: &ObjectCluster,
    masks: &[AffordanceMask],
) -> Result<Reconstruction, SkillFailure> {
    let key_point = task_key_point(masks, &observation.views).map_err(|error| {
        let reason = match error {
            sfg_geometry::GeometryError::EmptyMask { .. } => FailureReason::PartNotFound,
            _ => FailureReason::NoDepth,
        };
        SkillFailure::new(reason, error.to_string())
    })?;
    let voxels = occupied_voxels(&object.points_in_base);
    let object_masks: Vec<Vec<u8>> = observation.views.iter().map(|view| object_mask(view, &voxels)).collect();
    let views: Vec<TsdfView<'_>> =
        observation.views.iter().zip(&object_masks).map(|(image, mask)| TsdfView { image, object_mask: Some(mask) }).collect();
    let tsdf = fuse_views(&key_point.point_in_base, &views);
    let affordance_region = affordance_region(&tsdf, &key_point.part_points_in_base);
    Ok(Reconstruction { key_point, tsdf, affordance_region })
}

type Voxel = (i32, i32, i32);

fn voxel_of(point: &Point) -> Voxel {
    let cell = |x: f64| (x / CLUSTER_REACH_M).floor() as i32;
    (cell(point.x), cell(point.y), cell(point.z))
}

/// The cluster's voxels and their neighbours.
fn occupied_voxels(points: &[Point3<f32>]) -> BTreeSet<Voxel> {
    let own: BTreeSet<Voxel> = points.iter().map(|point| voxel_of(&point.cast::<f64>())).collect();
    let mut all = BTreeSet::new();
    for (x, y, z) in own {
        for (dx, dy, dz) in (0..27).map(|n| (n % 3 - 1, n / 3 % 3 - 1, n / 9 - 1)) {
            all.insert((x + dx, y + dy, z + dz));
        }
    }
    all
}

fn object_mask(view: &RgbdImage, voxels: &BTreeSet<Voxel>) -> Vec<u8> {
    let width = view.intrinsics.width;
    view.depth_m
        .iter()
        .enumerate()
        .map(|(pixel, &depth_m)| {
            let depth_m = f64::from(depth_m);
            if depth_m.is_nan() || depth_m <= 0.0 {
                return 0;
            }
            u8::from(voxels.contains(&voxel_of(&cloud::pixel_in_base(view, pixel % width, pixel / width, depth_m))))
        })
        .collect()
}

/// `reconstruct_object`: Success with `reconstruction` written, Failure `part_not_found` or `no_depth`. Never Running.
pub fn register(registry: &mut Registry<SkillContext>) {
    let ports = [
        PortSpec::input::<Observation>("observation").default_key("observation"),
        PortSpec::input::<ObjectCluster>("object").default_key("object"),
        PortSpec::input::<Vec<AffordanceMask>>("masks").default_key("masks"),
        PortSpec::output::<Reconstruction>("reconstruction").default_key("reconstruction").doc("key point, TSDF and part region"),
    ];
    registry
        .step("reconstruct_object", ports, |tick| {
            let observation = tick.input::<Observation>("observation")?;
            let object = tick.input::<ObjectCluster>("object")?;
            let masks = tick.input::<Vec<AffordanceMask>>("masks")?;
            let outcome = reconstruct(&observation, &object, &masks).map(|reconstruction| {
                let point = reconstruction.key_point.point_in_base;
                let n_part_voxels = reconstruction.affordance_region.iter().filter(|voxel| **voxel != 0).count();
                let note = StageNote {
                    summary: format!(
                        "key point at ({:.3}, {:.3}, {:.3}) m from {} pixels, {n_part_voxels} voxels of the part",
                        point.x, point.y, point.z, reconstruction.key_point.n_pixels
                    ),
                    input_sha256: hash_of(&(hash_observation(&observation), object.id)),
                    details: serde_json::json!({
                        "key_point_in_base": [point.x, point.y, point.z],
                        "n_pixels": reconstruction.key_point.n_pixels,
                        "n_part_voxels": n_part_voxels,
                    }),
                };
                (reconstruction, note)
            });
            let reconstruction = tick.context.finish_stage("reconstruct_object", outcome)?;
            tick.context.kept.key_point = Some(Arc::new(reconstruction.key_point.clone()));
            tick.set_shared("reconstruction", Arc::new(reconstruction));
            Ok(())
        })
        .fails_with([FailureReason::NoDepth, FailureReason::PartNotFound].map(FailureReason::name));
}

//! Rust values lent to the other side.

use super::{grasp_type_number, hand_side_number, pose_view};
use crate::{PluginContext, PoseRequest};
use sfg_plugin_abi as abi;
use sfg_types::tsdf::{EDGE, TRUNCATION_M, VOXEL_M};
use sfg_types::{HandProfile, Tsdf};

/// A hand lent to a plugin.
#[derive(Debug)]
pub struct HandLent<'a> {
    hand: &'a HandProfile,
    joints: Vec<abi::HandJoint>,
    synergy_joints: Vec<abi::Text>,
    grasp_types: Vec<abi::GraspTypeProfile>,
}

impl<'a> HandLent<'a> {
    /// Lends `hand`.
    #[must_use]
    pub fn new(hand: &'a HandProfile) -> Self {
        let joints = hand.joints.iter().map(|joint| abi::HandJoint {
            name: abi::Text::new(&joint.name),
            lower_rad: joint.lower_rad,
            upper_rad: joint.upper_rad,
            stiffness_nm_per_rad: joint.stiffness_nm_per_rad,
            damping_nms_per_rad: joint.damping_nms_per_rad,
            closing_ratio: joint.closing_ratio,
            shifting_ratio: joint.shifting_ratio,
            max_torque_nm: joint.max_torque_nm,
        });
        let grasp_types = hand.grasp_types.iter().map(|(&kind, profile)| abi::GraspTypeProfile {
            grasp_type: grasp_type_number(kind),
            reserved: 0,
            c_tar: [profile.c_tar.c1, profile.c_tar.c2],
            standoff_min_m: profile.standoff_min_m,
            standoff_max_m: profile.standoff_max_m,
        });
        Self {
            joints: joints.collect(),
            synergy_joints: hand.synergy_joints.iter().map(|name| abi::Text::new(name)).collect(),
            grasp_types: grasp_types.collect(),
            hand,
        }
    }

    /// The view; its pointers live as long as `self`.
    #[must_use]
    pub fn view(&self) -> abi::HandProfile {
        let hand = self.hand;
        abi::HandProfile {
            struct_size: abi::struct_size::<abi::HandProfile>(),
            reserved: 0,
            name: abi::Text::new(&hand.name),
            urdf_left: abi::Text::new(&hand.urdf_left),
            urdf_right: abi::Text::new(&hand.urdf_right),
            palm_link: abi::Text::new(&hand.palm_link),
            joints: self.joints.as_ptr(),
            n_joints: self.joints.len(),
            synergy_joints: self.synergy_joints.as_ptr(),
            synergy_matrix: hand.synergy_matrix.as_ptr(),
            // The shorter of the two: a profile with unequal lengths is refused where it is loaded.
            n_synergy_joints: self.synergy_joints.len().min(hand.synergy_matrix.len()),
            grasp_types: self.grasp_types.as_ptr(),
            n_grasp_types: self.grasp_types.len(),
            max_tension_nm: hand.max_tension_nm,
            tendon_stiffness_nm_per_rad: hand.tendon_stiffness_nm_per_rad,
            max_current_amps: hand.max_current_amps,
            max_closing_speed_per_sec: hand.max_closing_speed_per_sec,
        }
    }
}

/// A question lent to a plugin.
#[derive(Debug)]
pub struct RequestLent<'a> {
    request: &'a PoseRequest<'a>,
    hand: abi::HandProfile,
    tsdf: abi::TsdfView,
    part_points: Vec<[f64; 3]>,
}

impl<'a> RequestLent<'a> {
    /// Lends `request`, whose hand is already lent.
    ///
    /// # Panics
    /// If an array of the request has not `EDGE^3` values; all come from one grid.
    #[must_use]
    pub fn new(request: &'a PoseRequest<'a>, hand: &'a HandLent<'a>) -> Self {
        const N: usize = EDGE * EDGE * EDGE;
        let Tsdf { distances, weights, base_from_grid } = request.tsdf;
        let lengths = [distances.len(), weights.len(), request.affordance_region.len()];
        assert!(lengths == [N; 3], "the arrays of a request have {lengths:?} values, {N} each are needed");
        let tsdf = abi::TsdfView {
            struct_size: abi::struct_size::<abi::TsdfView>(),
            edge: EDGE as u32,
            voxel_m: VOXEL_M,
            truncation_m: TRUNCATION_M,
            distances: distances.as_ptr(),
            weights: weights.as_ptr(),
            base_from_grid: pose_view(base_from_grid),
        };
        let part_points = request.key_point.part_points_in_base.iter().map(|point| point.coords.into()).collect();
        Self { request, hand: hand.view(), tsdf, part_points }
    }

    /// The view; its pointers live as long as `self` and as long as `self` is not moved.
    #[must_use]
    pub fn view(&self) -> abi::PoseRequest {
        let request = self.request;
        abi::PoseRequest {
            struct_size: abi::struct_size::<abi::PoseRequest>(),
            hand_side: hand_side_number(request.hand_side),
            grasp_type: grasp_type_number(request.grasp_type),
            reserved: 0,
            tsdf: &raw const self.tsdf,
            affordance_region: request.affordance_region.as_ptr(),
            hand: &raw const self.hand,
            key_point_in_base: request.key_point.point_in_base.coords.into(),
            part_points_in_base: self.part_points.as_ptr(),
            n_part_points: self.part_points.len(),
            n_pixels: request.key_point.n_pixels,
            table_height_m: request.table_height_m,
        }
    }
}

/// The context as a plugin in a library gets it. `params_json` and `scenarios_dir` are its texts.
#[must_use]
pub fn config_view(
    context: &PluginContext<'_>,
    params_json: &str,
    scenarios_dir: &str,
    hand: *const abi::HandProfile,
) -> abi::PoseGeneratorConfig {
    abi::PoseGeneratorConfig {
        struct_size: abi::struct_size::<abi::PoseGeneratorConfig>(),
        hand_side: hand_side_number(context.hand_side),
        seed: context.seed,
        params_json: abi::Text::new(params_json),
        scenarios_dir: abi::Text::new(scenarios_dir),
        hand,
    }
}

//! Capability `sfg.pose-generator/1`: what a pose generator is given and what it writes.

use crate::{ErrorBuffer, Instance, RawStatus, Text};

/// How many score terms a candidate can carry.
pub const TERMS_CAPACITY: usize = 16;
/// Room for the name of a score term, bytes of UTF-8 padded with zeros.
pub const TERM_NAME_BYTES: usize = 32;

/// Values of `hand_side` fields.
pub mod hand_side {
    /// The robot's left hand.
    pub const LEFT: u32 = 0;
    /// The robot's right hand.
    pub const RIGHT: u32 = 1;
}

/// Values of `grasp_type` fields: the numbers `t1..t12` of the project.
#[expect(missing_docs, reason = "each constant is the name of a grasp type; sfg-types describes them")]
pub mod grasp_type {
    pub const LARGE_DIAMETER: u32 = 1;
    pub const MEDIUM_WRAP: u32 = 2;
    pub const SMALL_DIAMETER: u32 = 3;
    pub const ADDUCTED_THUMB: u32 = 4;
    pub const FIXED_HOOK: u32 = 5;
    pub const INDEX_FINGER_EXTENSION: u32 = 6;
    pub const POWER_SPHERE: u32 = 7;
    pub const PRECISION_DISK: u32 = 8;
    pub const PRISMATIC_FOUR_FINGER: u32 = 9;
    pub const TRIPOD: u32 = 10;
    pub const PALMAR_PINCH: u32 = 11;
    pub const LATERAL: u32 = 12;
}

/// A rigid transform.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// Origin, metres.
    pub translation_m: [f64; 3],
    /// Unit quaternion, scalar first.
    pub rotation_wxyz: [f64; 4],
}

impl Pose {
    /// `point` (metres, in this pose's own frame) in the parent frame.
    #[must_use]
    pub fn transform(&self, point: [f64; 3]) -> [f64; 3] {
        let [w, x, y, z] = self.rotation_wxyz;
        let cross = |a: [f64; 3], b: [f64; 3]| [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
        let t = cross([x, y, z], point).map(|value| 2.0 * value);
        let u = cross([x, y, z], t);
        core::array::from_fn(|axis| point[axis] + w * t[axis] + u[axis] + self.translation_m[axis])
    }
}

/// An object as a truncated signed distance function.
///
/// | field | shape | unit | frame |
/// |---|---|---|---|
/// | `distances` | `edge^3`, x fastest then y then z | truncations in [-1, 1], positive in free space | grid |
/// | `weights` | `edge^3` | number of fused views, 0 = unobserved | grid |
/// | `base_from_grid` | SE(3) | m | voxel (i, j, k) is centred at `voxel_m * (i + 0.5, j + 0.5, k + 0.5)` |
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct TsdfView {
    /// Size of this struct in the host, bytes.
    pub struct_size: u32,
    /// Voxels along one side.
    pub edge: u32,
    /// Side of one voxel.
    pub voxel_m: f64,
    /// The distance that a value of 1 stands for.
    pub truncation_m: f64,
    /// Signed distances.
    pub distances: *const f32,
    /// Observation counts.
    pub weights: *const f32,
    /// Pose of the grid's corner.
    pub base_from_grid: Pose,
}

/// One joint of the hand; the fields mean what `sfg_types::HandJoint` says.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
#[expect(missing_docs, reason = "sfg_types::HandJoint documents the same fields")]
pub struct HandJoint {
    pub name: Text,
    pub lower_rad: f64,
    pub upper_rad: f64,
    pub stiffness_nm_per_rad: f64,
    pub damping_nms_per_rad: f64,
    pub closing_ratio: f64,
    pub shifting_ratio: f64,
    pub max_torque_nm: f64,
}

/// Where one grasp type lies in the synergy plane.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct GraspTypeProfile {
    /// One of [`grasp_type`].
    pub grasp_type: u32,
    /// Zero.
    pub reserved: u32,
    /// `c_tar`.
    pub c_tar: [f64; 2],
    /// Smallest distance of the palm surface from the object surface, metres.
    pub standoff_min_m: f64,
    /// Largest one.
    pub standoff_max_m: f64,
}

/// The hand; the fields mean what `sfg_types::HandProfile` says.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct HandProfile {
    /// Size of this struct in the host, bytes.
    pub struct_size: u32,
    /// Zero.
    pub reserved: u32,
    /// Name of the hand.
    pub name: Text,
    /// URDF of the left hand, relative to the profile's folder.
    pub urdf_left: Text,
    /// URDF of the right hand.
    pub urdf_right: Text,
    /// Link whose frame is the palm frame.
    pub palm_link: Text,
    /// All joints.
    pub joints: *const HandJoint,
    /// How many.
    pub n_joints: usize,
    /// Names of the joints the synergy matrix drives, in the order of its rows.
    pub synergy_joints: *const Text,
    /// The synergy matrix, one row for each of `synergy_joints`.
    pub synergy_matrix: *const [f64; 2],
    /// How many rows.
    pub n_synergy_joints: usize,
    /// The grasp types this hand knows.
    pub grasp_types: *const GraspTypeProfile,
    /// How many.
    pub n_grasp_types: usize,
    /// Tension at which a motor stalls, as joint torque at ratio 1, Nm.
    pub max_tension_nm: f64,
    /// Spring of the tendon drive, Nm at ratio 1 for each radian of stretch.
    pub tendon_stiffness_nm_per_rad: f64,
    /// Motor current at `max_tension_nm`, amperes.
    pub max_current_amps: f64,
    /// Largest speed of a motor command, full strokes per second.
    pub max_closing_speed_per_sec: f64,
}

/// What a generator gets when it is made.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct PoseGeneratorConfig {
    /// Size of this struct in the host, bytes.
    pub struct_size: u32,
    /// One of [`hand_side`]: the acting hand.
    pub hand_side: u32,
    /// Seed of the run; every random stream is derived from it.
    pub seed: u64,
    /// The parameters given in the scenario, a JSON object.
    pub params_json: Text,
    /// Folder of the scenario assets.
    pub scenarios_dir: Text,
    /// The acting hand.
    pub hand: *const HandProfile,
}

/// The question to a generator.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct PoseRequest {
    /// Size of this struct in the host, bytes.
    pub struct_size: u32,
    /// One of [`hand_side`]; a left hand is a mirrored right one.
    pub hand_side: u32,
    /// One of [`grasp_type`].
    pub grasp_type: u32,
    /// Zero.
    pub reserved: u32,
    /// The object.
    pub tsdf: *const TsdfView,
    /// `edge^3` voxels, 1 where the surface belongs to the part to hold.
    pub affordance_region: *const u8,
    /// The hand.
    pub hand: *const HandProfile,
    /// Where the grasp should be near, metres.
    pub key_point_in_base: [f64; 3],
    /// Surface points of the part seen by the cameras, metres.
    pub part_points_in_base: *const [f64; 3],
    /// How many.
    pub n_part_points: usize,
    /// How many masked pixels had a depth.
    pub n_pixels: usize,
    /// Height of the table above the base origin, metres.
    pub table_height_m: f64,
}

/// One named part of a candidate's score.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScoreTerm {
    /// UTF-8 padded with zeros, for example `wrench_margin`.
    pub name: [u8; TERM_NAME_BYTES],
    /// Its value.
    pub value: f64,
}

impl ScoreTerm {
    /// A term; a longer name is cut to the first [`TERM_NAME_BYTES`] bytes.
    #[must_use]
    pub const fn new(name: &str, value: f64) -> Self {
        let mut padded = [0; TERM_NAME_BYTES];
        let mut i = 0;
        while i < name.len() && i < TERM_NAME_BYTES {
            padded[i] = name.as_bytes()[i];
            i += 1;
        }
        Self { name: padded, value }
    }
}

/// A candidate palm pose.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PalmPose {
    /// Pose of the palm frame at the grasp.
    pub base_from_palm: Pose,
    /// Predicted grasp stability, 0 to 1.
    pub stability: f64,
    /// Closing target: `c1` in [0, 1], `c2` in [-1, 1].
    pub synergy: [f64; 2],
    /// One of [`hand_side`].
    pub hand_side: u32,
    /// How many of `terms` hold, at most [`TERMS_CAPACITY`].
    pub n_terms: u32,
    /// What the stability is made of, for the report.
    pub terms: [ScoreTerm; TERMS_CAPACITY],
}

impl PalmPose {
    /// What a host fills its buffer with before a call: a pose at the origin with stability 0 and no terms.
    pub const UNSET: Self = Self {
        base_from_palm: Pose { translation_m: [0.0; 3], rotation_wxyz: [1.0, 0.0, 0.0, 0.0] },
        stability: 0.0,
        synergy: [0.0; 2],
        hand_side: hand_side::LEFT,
        n_terms: 0,
        terms: [ScoreTerm { name: [0; TERM_NAME_BYTES], value: 0.0 }; TERMS_CAPACITY],
    };
}

/// The functions behind [`crate::capability::POSE_GENERATOR`].
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct PoseGeneratorTable {
    /// Size of this table in the library, bytes.
    pub struct_size: u32,
    /// Zero.
    pub reserved: u32,
    /// The name a scenario asks for: lower-case letters, digits, `-` and `_`.
    pub name: Text,
    /// Makes a generator.
    ///
    /// Thread: any. State: after `init`. Lifetime: `config` and all it points to are lent until return.
    /// Ownership: `*instance` belongs to the library until `destroy`; it is left alone unless the status is OK.
    /// Unwinding: must not leave this call.
    ///
    /// # Safety
    /// 1. `config` points to a [`PoseGeneratorConfig`] with readable texts and hand.
    /// 2. `instance` points to a writable pointer, `error` to a writable [`ErrorBuffer`].
    pub create: Option<
        unsafe extern "C" fn(
            config: *const PoseGeneratorConfig,
            instance: *mut *mut Instance,
            error: *mut ErrorBuffer,
        ) -> RawStatus,
    >,
    /// Ends a generator.
    ///
    /// Thread: any, no other call on this instance at the same time. State: created, not retired.
    /// Unwinding: must not leave this call.
    ///
    /// # Safety
    /// 1. `instance` came from `create` of this table and is not used again.
    pub destroy: Option<unsafe extern "C" fn(instance: *mut Instance)>,
    /// Writes at most `capacity` candidates, best first. None is an ordinary result.
    ///
    /// Thread: one at a time. State: created, not retired. Lifetime: `request` and all it points to, and `out`, are lent until
    /// return. Ownership: the host owns all of them; the plugin frees nothing. Unwinding: must not leave this call.
    ///
    /// # Safety
    /// 1. `instance` came from `create` of this table.
    /// 2. `request` points to a [`PoseRequest`] whose pointers are readable for the shapes it states.
    /// 3. `out` has room for `capacity` poses.
    /// 4. `written` and `error` are writable; none of the outputs aliases an input or another output.
    pub generate: Option<
        unsafe extern "C" fn(
            instance: *mut Instance,
            request: *const PoseRequest,
            out: *mut PalmPose,
            capacity: usize,
            written: *mut usize,
            error: *mut ErrorBuffer,
        ) -> RawStatus,
    >,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_quarter_turn_about_z_takes_x_to_y() {
        let h = core::f64::consts::FRAC_1_SQRT_2;
        let pose = Pose { translation_m: [1.0, 2.0, 3.0], rotation_wxyz: [h, 0.0, 0.0, h] };
        let moved = pose.transform([0.5, 0.0, 0.25]);
        for (value, expected) in moved.into_iter().zip([1.0, 2.5, 3.25]) {
            assert!((value - expected).abs() < 1e-15, "{moved:?}");
        }
    }

    #[test]
    fn term_names_are_padded_or_cut() {
        assert_eq!(&ScoreTerm::new("margin", 0.5).name[..8], b"margin\0\0");
        assert_eq!(ScoreTerm::new("a_name_that_is_longer_than_thirty_two_bytes", 0.5).name[31], b't');
    }
}

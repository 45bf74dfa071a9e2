//! What the engine knows about a hand beyond its URDF.

use crate::{GraspType, SynergyCoordinates};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// One joint of a tendon-driven hand, moved by the law `tau = R1 u1 + R2 u2 - E q` (`R` transmission ratios, `u` tensions, `E` stiffness).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HandJoint {
    /// Joint name in the URDF, without the side's prefix.
    pub name: String,
    /// Lower limit, radians.
    pub lower_rad: f64,
    /// Upper limit, radians.
    pub upper_rad: f64,
    /// Spring constant `E_j`, Nm/rad.
    pub stiffness_nm_per_rad: f64,
    /// Damping, Nms/rad.
    pub damping_nms_per_rad: f64,
    /// `R1_j`: share of the first tendon tension, dimensionless.
    pub closing_ratio: f64,
    /// `R2_j`: share of the second, graded by pulley friction from thumb (+2) to little finger (-2).
    pub shifting_ratio: f64,
    /// Largest joint torque, Nm.
    pub max_torque_nm: f64,
}

/// Where a grasp type lies in this hand's synergy plane, and how far the palm stays away.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GraspTypeProfile {
    /// Target synergy coordinates `c_tar`.
    pub c_tar: SynergyCoordinates,
    /// Smallest distance of the palm surface from the object surface, metres.
    pub standoff_min_m: f64,
    /// Largest one.
    pub standoff_max_m: f64,
}

/// A hand: joints, synergy matrix, grasp types and motor limits.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HandProfile {
    /// Name, for example `softhand2`.
    pub name: String,
    /// URDF of the left hand, relative to the profile's folder.
    pub urdf_left: String,
    /// URDF of the right hand.
    pub urdf_right: String,
    /// Link whose frame is the palm frame of [`crate::palm_pose`].
    pub palm_link: String,
    /// All joints, 19 on the SoftHand2, in URDF order.
    pub joints: Vec<HandJoint>,
    /// The joints that `M` drives, in the order of its rows: 15 on the SoftHand2.
    pub synergy_joints: Vec<String>,
    /// `M`, one row `[m1, m2]` for each of `synergy_joints` (equation 13, corrected to 15 rows).
    pub synergy_matrix: Vec<[f64; 2]>,
    /// The twelve types.
    pub grasp_types: BTreeMap<GraspType, GraspTypeProfile>,
    /// Tension at which a motor stalls, as joint torque at ratio 1, Nm.
    pub max_tension_nm: f64,
    /// Spring of the tendon drive `k_t`: tension (as joint torque at ratio 1, Nm) for each radian of tendon stretch.
    pub tendon_stiffness_nm_per_rad: f64,
    /// Motor current at `max_tension_nm`, amperes.
    pub max_current_amps: f64,
    /// Largest speed of a motor command, full strokes per second.
    pub max_closing_speed_per_sec: f64,
}

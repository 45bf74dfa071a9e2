//! The robot description file: what a URDF does not say about a robot.

use crate::error::KinematicsError;
use serde::{Deserialize, Serialize};
use sfg_types::{HandProfile, Pose};
use std::collections::BTreeMap;
use std::path::Path;

/// A file such as `scenarios/robots/curi.yaml`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RobotDescription {
    /// Name, for example `curi`.
    pub name: String,
    /// URDF, relative to this file's folder. Its root link is the base frame.
    pub urdf: String,
    /// Hand profile, relative to this file's folder.
    pub hand_profile: String,
    /// Ready pose by joint name, radians; joints that are not named rest at 0 (or at the limit nearest to 0).
    pub home_q: BTreeMap<String, f64>,
    /// The two arms.
    pub arms: Arms,
    /// Cameras fixed to the robot.
    #[serde(default)]
    pub cameras: Vec<CameraDescription>,
}

/// Left and right.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Arms {
    /// The left arm.
    pub left: ArmDescription,
    /// The right arm.
    pub right: ArmDescription,
}

/// One arm.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ArmDescription {
    /// Its joints from shoulder to wrist.
    pub joints: Vec<String>,
    /// Link that carries the hand.
    pub tip_link: String,
    /// Pose of the hand's root link in the tip link.
    pub hand_mount: Mount,
    /// Largest acceleration of each joint, rad/s^2.
    pub max_acceleration: Vec<f64>,
    /// Largest jerk of each joint, rad/s^3.
    pub max_jerk: Vec<f64>,
}

/// A pose as in URDF: metres, then fixed-axis roll, pitch, yaw in radians.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Mount {
    /// Position, metres.
    pub xyz: [f64; 3],
    /// Roll, pitch, yaw, radians.
    pub rpy: [f64; 3],
}

/// A depth camera.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraDescription {
    /// Name, for example `left`.
    pub name: String,
    /// Link that carries it.
    pub mount_link: String,
    /// Position in that link, metres.
    pub xyz: [f64; 3],
    /// Point in the base frame that it looks at when the robot is at home; or give `rpy`.
    #[serde(default)]
    pub look_at_in_base: Option<[f64; 3]>,
    /// Orientation of the camera frame (+Z forward, +X right, +Y down) in the mount link, radians.
    #[serde(default)]
    pub rpy: Option<[f64; 3]>,
    /// Image width, pixels.
    pub width_px: usize,
    /// Image height, pixels.
    pub height_px: usize,
    /// Horizontal field of view, degrees.
    pub horizontal_fov_deg: f64,
}

impl RobotDescription {
    /// Reads a description.
    ///
    /// # Errors
    /// [`KinematicsError::ReadFile`] or [`KinematicsError::Yaml`] with line and column.
    pub fn load(path: &Path) -> Result<Self, KinematicsError> {
        read_yaml(path)
    }
}

impl Mount {
    /// As a transform.
    #[must_use]
    pub fn pose(&self) -> Pose {
        pose(self.xyz, self.rpy)
    }
}

/// Reads a hand profile.
///
/// # Errors
/// [`KinematicsError::ReadFile`] or [`KinematicsError::Yaml`] with line and column.
pub fn load_hand_profile(path: &Path) -> Result<HandProfile, KinematicsError> {
    read_yaml(path)
}

pub(crate) fn pose(xyz: [f64; 3], [roll, pitch, yaw]: [f64; 3]) -> Pose {
    Pose::from_parts(xyz.into(), nalgebra::UnitQuaternion::from_euler_angles(roll, pitch, yaw))
}

fn read_yaml<T: serde::de::DeserializeOwned>(path: &Path) -> Result<T, KinematicsError> {
    let text = std::fs::read_to_string(path).map_err(|source| KinematicsError::ReadFile { path: path.to_owned(), source })?;
    serde_saphyr::from_str(&text).map_err(|error| KinematicsError::Yaml { path: path.to_owned(), message: error.to_string() })
}

//! JSON layouts of the algebra types, for the schemas of what holds them.

use crate::Pose;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A rigid transform as JSON: the form in which [`Pose`] is written.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct PoseLayout {
    /// Unit quaternion x, y, z, w.
    pub rotation: [f64; 4],
    /// Metres.
    pub translation: [f64; 3],
}

impl From<&Pose> for PoseLayout {
    fn from(pose: &Pose) -> Self {
        Self { rotation: pose.rotation.coords.into(), translation: pose.translation.vector.into() }
    }
}

impl From<Pose> for PoseLayout {
    fn from(pose: Pose) -> Self {
        Self::from(&pose)
    }
}

#[cfg(test)]
mod tests {
    #![expect(clippy::unwrap_used, reason = "tests fail by panicking")]
    use super::*;
    use nalgebra::{Translation3, UnitQuaternion};

    #[test]
    fn a_pose_is_written_in_this_form() {
        let pose = Pose::from_parts(Translation3::new(1.0, 2.0, 3.0), UnitQuaternion::from_euler_angles(0.1, 0.2, 0.3));
        assert_eq!(serde_json::to_value(PoseLayout::from(&pose)).unwrap(), serde_json::to_value(pose).unwrap());
    }
}

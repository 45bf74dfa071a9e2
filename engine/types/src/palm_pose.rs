//! Where the palm could go.
//!
//! The palm frame has its origin at the centre of the palm's surface, +X along the stretched fingers, +Z out of the palm
//! (the way the hand approaches), +Y = Z x X. The thumb is on the -Y side of a right hand and the +Y side of a left one.

use crate::{Pose, SynergyCoordinates};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Left or right.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum HandSide {
    /// The robot's left hand; the one used in the paper's experiments.
    #[default]
    Left,
    /// The robot's right hand.
    Right,
}

impl HandSide {
    /// `left` or `right`.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Left => "left",
            Self::Right => "right",
        }
    }
}

/// One named part of a candidate's score, 0 to 1 unless its name carries a unit.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ScoreTerm {
    /// What it measures, for example `wrench_margin`.
    pub name: String,
    /// Its value.
    pub value: f64,
}

/// A palm pose that may hold the object: `S_V, P_V, J_V` of the paper (equation 6) at one voxel.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct PalmPoseCandidate {
    /// Pose of the palm frame at the grasp.
    #[schemars(with = "crate::layout::PoseLayout")]
    pub base_from_palm: Pose,
    /// Which hand.
    pub hand_side: HandSide,
    /// Predicted grasp stability, 0 to 1.
    pub stability: f64,
    /// Closing target.
    pub synergy: SynergyCoordinates,
    /// What the stability is made of, for the report.
    pub terms: Vec<ScoreTerm>,
}

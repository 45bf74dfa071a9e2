//! Which palm pose is executed, and why the others are not.

use crate::{JointTrajectory, PalmPoseCandidate, Pose};
use serde::{Deserialize, Serialize};
use std::fmt;

/// Why a candidate was rejected, with the nearest miss.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", tag = "why")]
#[non_exhaustive]
pub enum RejectionReason {
    /// The closed hand would touch the table.
    TableClearance {
        /// Smallest gap, metres; negative inside the table.
        clearance_m: f64,
    },
    /// No arm configuration reaches a key pose.
    NoInverseKinematics {
        /// Which pose: `grasp`, `standoff`, `lift`, `carry`, `tilt`.
        key_pose: String,
        /// Smallest position error over the attempts, metres.
        miss_m: f64,
    },
    /// Reaching it would touch something.
    Collision {
        /// Which pose or path.
        key_pose: String,
        /// What touches what, and how deep.
        with: String,
    },
    /// Poses are reachable, no path was found between them.
    NoPath {
        /// Between which poses.
        segment: String,
    },
    /// Too far from the part that must be held.
    FarFromKeyPoint {
        /// Distance, metres.
        distance_m: f64,
    },
    /// A better candidate was taken first.
    RankedLower,
}

impl fmt::Display for RejectionReason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::TableClearance { clearance_m } => write!(f, "the closed hand misses the table by {clearance_m:.3} m"),
            Self::NoInverseKinematics { key_pose, miss_m } => {
                write!(f, "no arm configuration reaches the {key_pose} pose, best misses by {miss_m:.3} m")
            }
            Self::Collision { key_pose, with } => write!(f, "{with} at the {key_pose} pose"),
            Self::NoPath { segment } => write!(f, "no path found for the {segment}"),
            Self::FarFromKeyPoint { distance_m } => write!(f, "{distance_m:.3} m from the part to hold"),
            Self::RankedLower => f.write_str("a better candidate was chosen"),
        }
    }
}

/// A candidate that is not executed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Rejected {
    /// Index in the generated list.
    pub candidate_idx: usize,
    /// Why.
    pub reason: RejectionReason,
}

/// A candidate with everything needed to execute it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PlannedGrasp {
    /// Index in the generated list.
    pub candidate_idx: usize,
    /// The candidate.
    pub candidate: PalmPoseCandidate,
    /// Palm pose before the straight approach.
    pub base_from_standoff: Pose,
    /// Collision-checked motion from the present configuration to the stand-off.
    pub transit: JointTrajectory,
    /// Straight motion from the stand-off to the grasp.
    pub approach: JointTrajectory,
}

/// The outcome of selection: `p_tar` of the paper and what was left out.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Selection {
    /// The grasp to execute.
    pub chosen: PlannedGrasp,
    /// The other candidates, by index.
    pub rejected: Vec<Rejected>,
}

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
        /// Position error of the nearest attempt, metres.
        miss_m: f64,
        /// Its rotation error, radians.
        #[serde(default)]
        miss_rad: f64,
        /// Joints that stood at a position limit in it.
        #[serde(default)]
        at_limit: Vec<String>,
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
            Self::NoInverseKinematics { key_pose, miss_m, miss_rad, at_limit } => {
                write!(f, "no arm configuration reaches the {key_pose} pose, best misses by {miss_m:.3} m")?;
                if *miss_rad > 0.0 {
                    write!(f, " and {:.1} deg", miss_rad.to_degrees())?;
                }
                if !at_limit.is_empty() {
                    write!(f, " with {} at the limit", at_limit.join(", "))?;
                }
                Ok(())
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_miss_names_how_far_and_which_joint_and_older_reports_are_still_read() {
        let old: RejectionReason =
            serde_json::from_str(r#"{"why": "no_inverse_kinematics", "key_pose": "lift", "miss_m": 0.042}"#)
                .unwrap_or_else(|e| panic!("{e}"));
        assert_eq!(old.to_string(), "no arm configuration reaches the lift pose, best misses by 0.042 m");
        let new = RejectionReason::NoInverseKinematics {
            key_pose: "grasp".to_owned(),
            miss_m: 0.0421,
            miss_rad: 0.1,
            at_limit: vec!["joint4".to_owned(), "joint6".to_owned()],
        };
        let expected =
            "no arm configuration reaches the grasp pose, best misses by 0.042 m and 5.7 deg with joint4, joint6 at the limit";
        assert_eq!(new.to_string(), expected);
    }
}

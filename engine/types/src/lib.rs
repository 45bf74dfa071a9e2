//! Artefacts of the data path, one module each, in the order in which a run produces them.
//!
//! Units are SI, frames are named: `base` is the robot base (+X ahead, +Y left, +Z up, origin on the floor), `camera` looks
//! along +Z with +X right and +Y down, `grid` is the corner of the TSDF cube, `palm` is defined in [`palm_pose`].
//! Transforms read as chains: `base_from_grid = base_from_camera * camera_from_grid`.
//! The crate does no IO and uses no other crate of the workspace.

pub mod affordance_mask;
pub mod grasp_functionality;
pub mod grasp_type;
pub mod hand_profile;
pub mod instruction;
pub mod joint_trajectory;
pub mod layout;
pub mod observation;
pub mod palm_pose;
pub mod reason;
pub mod robot_state;
pub mod run_report;
pub mod scene_inventory;
pub mod selection;
pub mod synergy;
pub mod task_key_point;
pub mod tsdf;

pub use affordance_mask::AffordanceMask;
pub use grasp_functionality::ObjectRef;
pub use grasp_functionality::{FunctionalityAnswer, GraspFunctionality, Task};
pub use grasp_type::{GraspClass, GraspType, Opposition};
pub use hand_profile::{GraspTypeProfile, HandJoint, HandProfile};
pub use instruction::Instruction;
pub use joint_trajectory::JointTrajectory;
pub use observation::{CameraIntrinsics, Observation, RgbdImage};
pub use palm_pose::{HandSide, PalmPoseCandidate, ScoreTerm};
pub use reason::FailureReason;
pub use robot_state::{HandCommand, HandFeedback, RobotCommand, RobotState};
pub use run_report::{Outcome, PredicateResult, RunFailure, RunReport, SafetyReport, StageRecord};
pub use scene_inventory::{ColourName, ObjectCluster, RankedName, SceneInventory, ShapeClass};
pub use selection::{PlannedGrasp, Rejected, RejectionReason, Selection};
pub use synergy::SynergyCoordinates;
pub use task_key_point::TaskKeyPoint;
pub use tsdf::Tsdf;

/// A rigid transform: metres and a unit quaternion.
pub type Pose = nalgebra::Isometry3<f64>;
/// A point in metres; the variable's name carries the frame.
pub type Point = nalgebra::Point3<f64>;
/// A direction or displacement in metres; the variable's name carries the frame.
pub type Vector = nalgebra::Vector3<f64>;

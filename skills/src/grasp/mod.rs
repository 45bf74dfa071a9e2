//! From a sentence to a lifted object, one module a step.

pub mod close_hand;
pub mod generate_palm_poses;
pub mod ground_affordance;
pub mod infer_functionality;
pub mod lift;
pub mod list_scene;
pub mod observe_scene;
pub mod reach_palm_pose;
pub mod ready;
pub mod reconstruct_object;
pub mod select_palm_pose;
pub mod synthesize_grasp;
pub mod verify_grasp;

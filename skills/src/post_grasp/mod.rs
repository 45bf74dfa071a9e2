//! What is done with a held object.

pub mod fill;
pub mod held_pose;
pub mod pour;
pub mod pour_path;
pub mod pour_plan;

//! Skills in the order of the data path, each a pure function and a thin tree node.
//!
//! A node reads its ports, calls the function, writes its ports and says in one line what was decided. It sees what sensors
//! and drivers give, never the simulator's truth. [`register`] makes all of them known to a tree registry.

pub mod arm;
pub mod context;
pub mod grasp;
pub mod motion;
pub mod post_grasp;
pub mod robot;
pub mod saved;

pub use context::{Kept, Plugins, SkillContext, SkillFailure, StageLog, StageNote};
pub use robot::{Robot, RobotError};

use sfg_tree::Registry;

/// Registers every skill.
pub fn register(registry: &mut Registry<SkillContext>) {
    saved::register(registry);
    grasp::ready::register(registry);
    grasp::observe_scene::register(registry);
    grasp::list_scene::register(registry);
    grasp::infer_functionality::register(registry);
    grasp::ground_affordance::register(registry);
    grasp::reconstruct_object::register(registry);
    grasp::generate_palm_poses::register(registry);
    grasp::select_palm_pose::register(registry);
    grasp::synthesize_grasp::register(registry);
    grasp::reach_palm_pose::register(registry);
    grasp::close_hand::register(registry);
    grasp::verify_grasp::register(registry);
    grasp::lift::register(registry);
    post_grasp::pour::register(registry);
    motion::register(registry);
}

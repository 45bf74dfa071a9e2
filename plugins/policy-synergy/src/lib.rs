//! Closing along the synergy of the grasp type, stopped by motor current.
//!
//! The set point runs from the preshape to `c_tar` and, since a commanded posture alone presses on nothing, on along `c1` until
//! the motors draw the grip current. What the free hand would draw at the same set point is known from the hand profile, so the
//! stop answers to the object and not to the hand's own springs.

mod free_hand;
mod policy;
mod settings;

pub use free_hand::FreeHand;
pub use policy::SynergyPolicy;
pub use settings::{PLUGIN_NAME, SynergyPolicySettings};

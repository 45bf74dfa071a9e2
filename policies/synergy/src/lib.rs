//! Hand profiles: synergy matrix, joint order, grasp types to synergy coordinates.
//!
//! A profile is a file beside the robots; [`load_profile`] reads and checks it, [`SynergySpace`] does its arithmetic.

mod profile;
mod space;

pub use profile::{ProfileError, load_profile, validate};
pub use space::SynergySpace;

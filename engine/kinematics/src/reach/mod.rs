//! Reachability: which palm poses an arm reaches within its joint limits, told in microseconds.
//!
//! [`ReachBuild`] builds a [`ReachMap`] once for an arm; [`ReachMap::verdict`] answers for any palm pose. A map is a help: inverse
//! kinematics decides, and whoever uses a map must do without it as well.

mod build;
mod file;
mod map;
mod query;
mod rotations;

pub use build::{ReachBuild, ReachSettings};
pub use map::{ReachHeader, ReachMap, chain_sha256};
pub use query::{ReachCount, ReachVerdict, better_arm};

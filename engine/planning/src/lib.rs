//! Collision model, path planner, time parameterisation and command limits.
//!
//! The way of a motion: [`CollisionModel`] says what touches what, a [`Planner`] or [`cartesian_path`] finds a path of
//! configurations, [`retime`] rounds its corners and gives it time within the joints' limits, [`verify_exact`] looks at it once
//! more with exact shapes, and [`SafetyFilter`] stands between every command and the driver.

mod batch;
pub mod cartesian;
pub mod collision;
pub mod cover;
pub mod error;
pub mod exact;
pub mod keep;
mod lanes;
pub mod occupancy;
pub mod planner;
pub mod points;
pub mod qp;
pub mod safety;
pub mod scene;
pub mod shapes;
pub mod smooth;
pub mod timing;
#[cfg(test)]
mod verdict_tests;

pub use cartesian::{CartesianOutcome, CartesianSettings, CartesianStop, cartesian_path};
pub use collision::{BodyGroup, BodySphere, CollisionModel, CollisionSettings, Contact, Gap, SelfPairs};
pub use cover::{CoverQuality, Surface, cover_quality, fit_spheres};
pub use error::PlanningError;
pub use exact::{verify_exact, verify_tree_exact};
pub use keep::KeepAxis;
pub use occupancy::{Occupancy, Voxel};
pub use planner::{PlanOutcome, Planner, RawPath, RrtConnect, RrtSettings};
pub use points::PointObstacles;
pub use qp::{QpError, QpSolution, QuadraticProgram, solve_qp};
pub use safety::{FilterSettings, HandFilter, Intervention, Limit, PalmBox, SafetyFilter, Sent};
pub use scene::{Held, PlanningScene, SceneError};
pub use shapes::Obstacle;
pub use smooth::SmoothPath;
pub use timing::{TimingSettings, TorqueLimits, retime};

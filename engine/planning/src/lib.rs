//! Collision model, path planner, time parameterisation and command limits.
//!
//! The way of a motion: [`CollisionModel`] says what touches what, a [`Planner`] or [`cartesian_path`] finds a path of
//! configurations, [`retime`] rounds its corners and gives it time within the joints' limits, [`verify_exact`] looks at it once
//! more with exact shapes, and [`CommandLimiter`] watches every command on its way to the driver.

mod batch;
pub mod cartesian;
pub mod collision;
pub mod error;
pub mod exact;
mod lanes;
pub mod limiter;
pub mod planner;
pub mod points;
pub mod shapes;
pub mod smooth;
pub mod timing;

pub use cartesian::{CartesianOutcome, CartesianSettings, CartesianStop, cartesian_path};
pub use collision::{BodyGroup, BodySphere, CollisionModel, CollisionSettings, Contact, SelfPairs};
pub use error::PlanningError;
pub use exact::verify_exact;
pub use limiter::{CommandLimiter, LimitViolation, LimiterSettings, PalmBox, stop_ramp};
pub use planner::{PlanOutcome, Planner, RawPath, RrtConnect, RrtSettings};
pub use points::PointObstacles;
pub use shapes::Obstacle;
pub use smooth::SmoothPath;
pub use timing::{TimingSettings, retime};

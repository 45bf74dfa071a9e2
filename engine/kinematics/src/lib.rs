//! URDF to compiled chain: forward kinematics, Jacobian, inverse kinematics.
//!
//! [`RobotModel::load`] reads a robot description (`scenarios/robots/curi.yaml`), its URDF and the hands that it names, and
//! compiles them to one tree. [`RobotModel::arm_chain`] cuts the seven joints of an arm out of it, [`RobotModel::group`] both
//! arms or arms with the torso; [`IkSolver`] inverts that chain.
//! The crate knows no obstacles and no time.

pub mod chain;
pub mod description;
pub mod dynamics;
pub mod error;
pub mod ik;
mod ik_batch;
pub mod reach;
pub mod robot;
pub mod shape;
pub mod srdf;
pub mod tree;
mod urdf;

pub use chain::{Chain, ChainJoint, JointLimits};
pub use description::{ArmDescription, CameraDescription, Mount, RobotDescription};
pub use dynamics::{Dynamics, GRAVITY, Payload};
pub use error::KinematicsError;
pub use ik::{IkOutcome, IkSettings, IkSolver};
pub use ik_batch::joints_at_limit;
pub use robot::{Arm, Camera, GROUPS, JointGroup, RobotModel};
pub use shape::{Primitive, Shape};
pub use srdf::Srdf;
pub use tree::{Inertial, Joint, JointKind, JointSource, Link, Tree};

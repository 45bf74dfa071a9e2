//! Simulated scene: arm and hand multibody, objects, grains, cameras and the judge.
//!
//! | module | what |
//! |---|---|
//! | [`scene`] | what a world is built from: table, objects, numbers of the simulation |
//! | [`world`] | the scene in motion, one control period a step |
//! | [`multibody`], [`hand`], [`settings`] | arm and hand as one rapier multibody, tendon drive, integration parameters |
//! | [`share`] | the driver's handle (sensors, commands) and the judge's (truth) |
//! | [`judge`] | physics invariants, holds, grasp reports, predicates |
//! | [`cameras`] | depth cameras and pictures |
//!
//! Only [`JudgeHandle`] tells the truth about poses, labels and finger joints; [`RobotPort`] has no way to it.

mod bodies;
pub mod cameras;
mod convert;
mod error;
pub mod hand;
mod hash;
pub mod judge;
pub mod multibody;
mod robot;
pub mod scene;
pub mod settings;
pub mod share;
mod truth;
pub mod world;

pub use cameras::{Cameras, Viewpoint};
pub use error::WorldError;
pub use judge::{ArgKind, GraspAsked, JudgeReport, PREDICATES, Predicate, PredicateSpec, Verdict};
pub use scene::{ObjectSpec, SceneSpec, TableSpec, WorldSettings, load_object_model};
pub use share::{JudgeHandle, ProprioceptiveState, RobotPort};
pub use truth::{ContactTruth, ObjectTruth, Truth, TruthPoison};
pub use world::{FrictionPair, World};

//! CPU renderer: meshes to RGB-D images and pictures.
//!
//! In go meshes with poses, colours and identities, and balls for grains; out come colour, exact depth and identity buffers
//! ([`Frame`]), the same with the errors of a depth camera ([`SensorNoise`]), or an annotated PNG ([`Picture`]).
//! The crate knows no robot, no object model and no physics.

pub mod camera;
mod error;
pub mod noise;
pub mod picture;
mod raster;
pub mod scene;

pub use error::RenderError;
pub use noise::SensorNoise;
pub use picture::Picture;
pub use scene::{Finish, Frame, Item, NO_ID, RenderMesh, Scene, Sphere, render, render_smooth};

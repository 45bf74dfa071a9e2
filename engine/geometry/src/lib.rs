//! Cameras, depth to TSDF, key points, signed distance fields, object models and meshes.
//!
//! | module | in | out |
//! |---|---|---|
//! | [`cloud`] | depth image, mask | points in base |
//! | [`key_point`] | masks, views | task key point, affordance region of the grid |
//! | [`tsdf`] | depth views, object masks | fused grid, its samples, gradients and surface points |
//! | [`object`] | declarative model or scan | exact signed distance, labels, meshes, collision pieces, mass |
//! | [`oval`] | points of an outline | the ellipse through them, distances to ovals |
//! | [`mesh`] | triangles, OBJ text | volume, watertightness, OBJ text |
//!
//! The crate reads no configuration and knows no robot; all lengths are metres.

pub mod cloud;
mod error;
pub mod key_point;
pub mod mesh;
pub mod object;
pub mod oval;
pub mod tsdf;

pub use error::GeometryError;
pub use key_point::{affordance_region, task_key_point};
pub use mesh::TriMesh;
pub use object::{
    Hollow, Interior, LabelledPiece, MassProperties, ObjectInstance, ObjectModel, ObjectParams, Part, Piece, ScannedObject,
    Touches,
};
pub use oval::{Oval, fit_ellipse};
pub use tsdf::{SurfacePoint, TsdfView, fuse_views, surface_points};

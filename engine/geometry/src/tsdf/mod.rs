//! Depth views fused into the object grid, and what can be read from it.

mod fuse;
mod surface;

pub use fuse::{TsdfView, fuse_views};
pub use surface::{SurfacePoint, distance_at, normal_at, surface_points};

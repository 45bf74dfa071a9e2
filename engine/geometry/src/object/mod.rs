//! Objects: declarative models of labelled parts, and scans, behind one [`ObjectInstance`].
//!
//! The object frame has +Z up and its origin at the centre of the base footprint: `z = 0` stands on the table.

mod foot;
mod hollow;
mod instance;
mod mass;
mod model;
mod piece;
mod primitive;
mod profile;
mod scanned;

pub use hollow::Hollow;
pub use instance::{DisplayMesh, Interior, ObjectInstance, Part};
pub use mass::MassProperties;
pub use model::{ObjectModel, ObjectParams, PartModel, ScaleRanges, Shape};
pub use piece::{LabelledPiece, Piece, Touches};
pub use scanned::ScannedObject;

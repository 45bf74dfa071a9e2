//! Everything that can go wrong in this crate.

use std::path::PathBuf;

/// Why a geometric result does not exist.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum GeometryError {
    /// No mask selects a pixel: the part is not visible. An ordinary outcome, the caller asks again or gives up.
    #[error("the affordance masks select no pixel in any of {n_views} views")]
    EmptyMask {
        /// How many views were searched.
        n_views: usize,
    },
    /// Pixels are selected but none has a depth. An ordinary outcome.
    #[error("none of the {n_masked} masked pixels has a depth")]
    NoDepth {
        /// How many pixels the masks select.
        n_masked: usize,
    },
    /// A declarative object model contradicts itself: the author mends the file.
    #[error("object {category:?}, part {part:?}: {message}")]
    BadModel {
        /// Category of the model.
        category: String,
        /// Label of the part, or `*` for the model as a whole.
        part: String,
        /// What is wrong, with values and units.
        message: String,
    },
    /// A mesh file cannot be used: the author mends it.
    #[error("{}:{line}: {message}", file.display())]
    BadMesh {
        /// The file.
        file: PathBuf,
        /// Line from 1; 0 when the file as a whole is meant.
        line: usize,
        /// What is wrong.
        message: String,
    },
    /// A file cannot be read or written.
    #[error("cannot access {}", file.display())]
    Io {
        /// The file.
        file: PathBuf,
        /// The cause.
        source: std::io::Error,
    },
}

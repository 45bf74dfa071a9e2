//! Recording of a run: the MCAP file, the report and its page.
//!
//! What goes in are artefacts of the run and finished PNGs; what comes out are files that are either whole or readable up to
//! the last second. The crate decides nothing and measures nothing.

pub mod journal;
pub mod page;
pub mod recording;
pub mod report;

pub use journal::{RecordedRun, json_of, literal_of, read_run};
pub use page::Picture;
pub use recording::{Recording, RobotSample, TransitionSample};
pub use report::{write_page, write_report};

use std::path::PathBuf;

/// Why something could not be recorded.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RecordError {
    /// A file could not be written; check free space and permissions, or give another folder with `--out`.
    #[error("cannot write {path}: {source}; check free space and permissions, or choose another folder with --out", path = .path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        source: std::io::Error,
    },
    /// The recording library refused a record.
    #[error("cannot record to {path}: {source}; check free space, or choose another folder with --out", path = .path.display())]
    Mcap {
        /// The file.
        path: PathBuf,
        /// Its reason.
        source: mcap::McapError,
    },
    /// A recording cannot be read.
    #[error("cannot read {path}: {message}", path = .path.display())]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// Why.
        message: String,
    },
    /// A value cannot be written as JSON.
    #[error("cannot encode {what}: {source}")]
    Encode {
        /// Which value.
        what: &'static str,
        /// Why.
        source: serde_json::Error,
    },
}

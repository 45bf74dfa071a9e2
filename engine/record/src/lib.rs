//! Recording of a run: the MCAP file, the report and its page.
//!
//! What goes in are artefacts of the run and finished PNGs; what comes out are files that are either whole or readable up to
//! the last second. The crate decides nothing and measures nothing.

mod cloud;
pub mod diff;
mod edit;
mod frames;
pub mod journal;
mod log_file;
pub mod messages;
pub mod page;
pub mod recording;
pub mod report;
mod scan;
mod scene;
mod sink;
mod tap;
pub mod views;

pub use edit::{Cut, Recovered, cut, recover};
pub use journal::{RecordedRun, json_of, literal_of, read_run};
pub use log_file::{ChannelInfo, LogFile, LoggedMessage, recording_path};
pub use page::{PageParts, Picture, TreeOutcome};
pub use recording::{Detail, Recording};
pub use report::{write_page, write_report};
pub use tap::{Recorded, Tap};

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
        source: Box<foxglove::FoxgloveError>,
    },
    /// A port of this machine cannot be used.
    #[error("cannot serve Foxglove at port {port}: {source}; another program uses it: choose another with --foxglove PORT")]
    Port {
        /// The port.
        port: u16,
        /// The system's reason.
        source: Box<foxglove::FoxgloveError>,
    },
    /// An image cannot be encoded.
    #[error("cannot encode an image of camera {camera:?}: {source}")]
    Image {
        /// Name of the camera.
        camera: String,
        /// Why.
        source: image::ImageError,
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

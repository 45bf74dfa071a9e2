//! What is recorded, handed on while it is recorded.

use crate::views::ImageKind;
use std::sync::Arc;

/// Something that was just recorded.
#[derive(Clone, Copy, Debug)]
pub enum Recorded<'a> {
    /// A message of one of our own channels.
    Message {
        /// The channel: `/tree`.
        topic: &'a str,
        /// Name and version of its layout: `sfg.Transition.v1`.
        schema: &'a str,
        /// Driver's clock, nanoseconds.
        log_time_ns: u64,
        /// JSON.
        bytes: &'a [u8],
    },
    /// An image of a camera.
    Image {
        /// Name of the camera.
        camera: &'a str,
        /// Which of its images.
        kind: ImageKind,
        /// Time of exposure on the driver's clock, nanoseconds.
        log_time_ns: u64,
        /// Encoded: JPEG for colour, 16-bit PNG in millimetres for depth.
        bytes: &'a [u8],
    },
}

/// Listens to a recording; called in the thread of the run, so it must not wait.
pub type Tap = Arc<dyn Fn(&Recorded<'_>) + Send + Sync>;

//! Everything that can go wrong in this crate.

/// Why a picture does not exist.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RenderError {
    /// The picture cannot be written as PNG.
    #[error("cannot encode a picture of {width} x {height} pixels as PNG")]
    Encode {
        /// Width in pixels.
        width: usize,
        /// Height in pixels.
        height: usize,
        /// The cause.
        source: image::ImageError,
    },
}

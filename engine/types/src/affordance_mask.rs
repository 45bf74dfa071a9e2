//! Which pixels show the part to hold.

use serde::{Deserialize, Serialize};

/// The functional region in one view: `m_ij` of the paper (equation 5).
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct AffordanceMask {
    /// Name of the camera, as in [`crate::RgbdImage::camera`].
    pub camera: String,
    /// Image width in pixels.
    pub width: usize,
    /// Image height in pixels.
    pub height: usize,
    /// `height * width`, row-major: 1 on the part, 0 elsewhere.
    #[serde(skip)]
    pub pixels: Vec<u8>,
}

impl AffordanceMask {
    /// A mask that selects nothing.
    #[must_use]
    pub fn empty(camera: &str, width: usize, height: usize) -> Self {
        Self { camera: camera.to_owned(), width, height, pixels: vec![0; width * height] }
    }

    /// How many pixels are selected.
    #[must_use]
    pub fn n_selected(&self) -> usize {
        self.pixels.iter().filter(|&&pixel| pixel != 0).count()
    }
}

//! Annotated pictures for people: images side by side, masks, lines, markers and labels, as PNG.

mod font;

use crate::{Frame, RenderError};
use image::ImageEncoder;
use image::codecs::png::PngEncoder;

/// An RGB picture; row-major, 3 bytes a pixel. Drawing outside it is cut off.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Picture {
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// `height * width * 3` bytes.
    pub rgb: Vec<u8>,
}

impl Picture {
    /// A picture of one colour.
    #[must_use]
    pub fn new(width: usize, height: usize, colour: [u8; 3]) -> Self {
        Self { width, height, rgb: colour.repeat(width * height) }
    }

    /// A picture of existing pixels.
    ///
    /// # Panics
    /// If `rgb` is not `height * width * 3` bytes.
    #[must_use]
    pub fn from_rgb(width: usize, height: usize, rgb: &[u8]) -> Self {
        assert_eq!(rgb.len(), width * height * 3, "a picture has three bytes a pixel");
        Self { width, height, rgb: rgb.to_vec() }
    }

    /// The colours of a rendered frame.
    #[must_use]
    pub fn from_frame(frame: &Frame) -> Self {
        Self::from_rgb(frame.width, frame.height, &frame.rgb)
    }

    /// Depth as colour, near = yellow, far = dark blue, no return = black.
    ///
    /// # Panics
    /// If `depth_m` is not `height * width` values.
    #[must_use]
    pub fn from_depth(width: usize, height: usize, depth_m: &[f32], near_m: f32, far_m: f32) -> Self {
        assert_eq!(depth_m.len(), width * height, "one depth a pixel");
        const RAMP: [[f32; 3]; 5] =
            [[253.0, 231.0, 37.0], [94.0, 201.0, 98.0], [33.0, 145.0, 140.0], [59.0, 82.0, 139.0], [68.0, 1.0, 84.0]];
        let colour = |&depth: &f32| {
            if depth <= 0.0 {
                return [0; 3];
            }
            let x = ((depth - near_m) / (far_m - near_m)).clamp(0.0, 1.0) * 4.0;
            let i = (x as usize).min(3);
            std::array::from_fn(|c| (RAMP[i][c] + (RAMP[i + 1][c] - RAMP[i][c]) * (x - i as f32)) as u8)
        };
        Self { width, height, rgb: depth_m.iter().flat_map(colour).collect() }
    }

    /// Pictures in a row, `gap` pixels of white between them; smaller ones stand at the top.
    #[must_use]
    pub fn beside(pictures: &[Self], gap: usize) -> Self {
        let width = pictures.iter().map(|p| p.width + gap).sum::<usize>().saturating_sub(gap);
        let height = pictures.iter().map(|p| p.height).max().unwrap_or(0);
        let mut out = Self::new(width, height, [255; 3]);
        let mut left = 0;
        for picture in pictures {
            out.paste(picture, left, 0);
            left += picture.width + gap;
        }
        out
    }

    /// Pictures in a column, `gap` pixels of white between them.
    #[must_use]
    pub fn stacked(pictures: &[Self], gap: usize) -> Self {
        let height = pictures.iter().map(|p| p.height + gap).sum::<usize>().saturating_sub(gap);
        let width = pictures.iter().map(|p| p.width).max().unwrap_or(0);
        let mut out = Self::new(width, height, [255; 3]);
        let mut top = 0;
        for picture in pictures {
            out.paste(picture, 0, top);
            top += picture.height + gap;
        }
        out
    }

    /// Copies a picture so that its upper left corner comes to (`left`, `top`).
    pub fn paste(&mut self, picture: &Self, left: usize, top: usize) {
        let n = picture.width.min(self.width.saturating_sub(left)) * 3;
        for row in 0..picture.height.min(self.height.saturating_sub(top)) {
            let to = ((top + row) * self.width + left) * 3;
            let from = row * picture.width * 3;
            self.rgb[to..to + n].copy_from_slice(&picture.rgb[from..from + n]);
        }
    }

    /// Half the width and height, each pixel the mean of four: smooths what was drawn at twice the size.
    #[must_use]
    pub fn halved(&self) -> Self {
        let (width, height) = (self.width / 2, self.height / 2);
        let mut rgb = Vec::with_capacity(width * height * 3);
        for row in 0..height {
            for column in 0..width {
                for channel in 0..3 {
                    let at =
                        |r: usize, c: usize| u16::from(self.rgb[((2 * row + r) * self.width + 2 * column + c) * 3 + channel]);
                    rgb.push(((at(0, 0) + at(0, 1) + at(1, 0) + at(1, 1) + 2) / 4) as u8);
                }
            }
        }
        Self { width, height, rgb }
    }

    /// Tints the pixels that `mask` selects, `alpha` from 0 (nothing) to 1 (opaque), and draws their border opaque.
    ///
    /// # Panics
    /// If the mask is not `height * width`.
    pub fn overlay_mask(&mut self, mask: &[u8], colour: [u8; 3], alpha: f32) {
        assert_eq!(mask.len(), self.width * self.height, "the mask has the size of the picture");
        let (width, height) = (self.width, self.height);
        for row in 0..height {
            for column in 0..width {
                let idx = row * width + column;
                if mask[idx] == 0 {
                    continue;
                }
                let is_border = (column > 0 && mask[idx - 1] == 0)
                    || (column + 1 < width && mask[idx + 1] == 0)
                    || (row > 0 && mask[idx - width] == 0)
                    || (row + 1 < height && mask[idx + width] == 0);
                self.blend(column as i64, row as i64, colour, if is_border { 1.0 } else { alpha });
            }
        }
    }

    /// Mixes a colour into one pixel.
    pub fn blend(&mut self, column: i64, row: i64, colour: [u8; 3], alpha: f32) {
        if column < 0 || row < 0 || column >= self.width as i64 || row >= self.height as i64 {
            return;
        }
        let start = (row as usize * self.width + column as usize) * 3;
        for (value, new) in self.rgb[start..start + 3].iter_mut().zip(colour) {
            *value = (f32::from(*value) + (f32::from(new) - f32::from(*value)) * alpha.clamp(0.0, 1.0) + 0.5) as u8;
        }
    }

    /// A straight line with smooth edges, `thickness` pixels wide.
    pub fn line(&mut self, from: [f64; 2], to: [f64; 2], thickness: f64, colour: [u8; 3]) {
        let reach = thickness / 2.0 + 1.0;
        let (dx, dy) = (to[0] - from[0], to[1] - from[1]);
        let length_squared = (dx * dx + dy * dy).max(1e-12);
        let limit = |a: f64, b: f64, n: usize| {
            let low = (a.min(b) - reach).floor().clamp(0.0, n as f64) as i64;
            let high = (a.max(b) + reach).ceil().clamp(-1.0, n as f64 - 1.0) as i64;
            low..=high
        };
        for row in limit(from[1], to[1], self.height) {
            for column in limit(from[0], to[0], self.width) {
                let (px, py) = (column as f64 - from[0], row as f64 - from[1]);
                let t = ((px * dx + py * dy) / length_squared).clamp(0.0, 1.0);
                let distance = (px - t * dx).hypot(py - t * dy);
                let cover = (thickness / 2.0 + 0.5 - distance).clamp(0.0, 1.0);
                if cover > 0.0 {
                    self.blend(column, row, colour, cover as f32);
                }
            }
        }
    }

    /// Connected lines.
    pub fn polyline(&mut self, points: &[[f64; 2]], thickness: f64, colour: [u8; 3]) {
        for pair in points.windows(2) {
            self.line(pair[0], pair[1], thickness, colour);
        }
    }

    /// A cross with a white halo, so that it shows on any ground.
    pub fn cross(&mut self, centre: [f64; 2], arm: f64, colour: [u8; 3]) {
        for (thickness, colour) in [(5.0, [255; 3]), (2.5, colour)] {
            self.line([centre[0] - arm, centre[1]], [centre[0] + arm, centre[1]], thickness, colour);
            self.line([centre[0], centre[1] - arm], [centre[0], centre[1] + arm], thickness, colour);
        }
    }

    /// A filled disk with smooth edge.
    pub fn disk(&mut self, centre: [f64; 2], radius: f64, colour: [u8; 3]) {
        self.line(centre, centre, 2.0 * radius, colour);
    }

    /// A filled rectangle.
    pub fn fill_rectangle(&mut self, left: i64, top: i64, width: i64, height: i64, colour: [u8; 3]) {
        for row in top.max(0)..(top + height).min(self.height as i64) {
            for column in left.max(0)..(left + width).min(self.width as i64) {
                self.blend(column, row, colour, 1.0);
            }
        }
    }

    /// Text with its upper left corner at (`left`, `top`); letters are `5 * scale` by `7 * scale` pixels, others than printable
    /// ASCII show as a box.
    pub fn text(&mut self, left: i64, top: i64, scale: i64, colour: [u8; 3], text: &str) {
        for (position, letter) in text.chars().enumerate() {
            for (column, bits) in font::glyph(letter).into_iter().enumerate() {
                for row in 0..7 {
                    if bits >> row & 1 == 1 {
                        let x = left + (position as i64 * 6 + column as i64) * scale;
                        self.fill_rectangle(x, top + row * scale, scale, scale, colour);
                    }
                }
            }
        }
    }

    /// Text on a filled box of its own, `scale` as in [`Picture::text`].
    pub fn label(&mut self, left: i64, top: i64, scale: i64, colour: [u8; 3], ground: [u8; 3], text: &str) {
        let (width, height) = Self::text_size(scale, text);
        self.fill_rectangle(left, top, width + 4 * scale, height + 4 * scale, ground);
        self.text(left + 2 * scale, top + 2 * scale, scale, colour, text);
    }

    /// Width and height of a text in pixels.
    #[must_use]
    pub fn text_size(scale: i64, text: &str) -> (i64, i64) {
        let n_letters = text.chars().count() as i64;
        ((n_letters * 6 - 1).max(0) * scale, 7 * scale)
    }

    /// The picture as a PNG file.
    ///
    /// # Errors
    /// [`RenderError::Encode`] when the encoder refuses, which only a size of zero makes it do.
    pub fn png(&self) -> Result<Vec<u8>, RenderError> {
        let mut bytes = Vec::new();
        PngEncoder::new(&mut bytes)
            .write_image(&self.rgb, self.width as u32, self.height as u32, image::ExtendedColorType::Rgb8)
            .map_err(|source| RenderError::Encode { width: self.width, height: self.height, source })?;
        Ok(bytes)
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "tests fail by panicking")]
    use super::*;

    #[test]
    fn png_keeps_every_pixel() {
        let mut picture = Picture::new(7, 5, [10, 20, 30]);
        picture.blend(3, 2, [200, 100, 50], 1.0);
        let decoded = image::load_from_memory(&picture.png().unwrap()).unwrap().to_rgb8();
        assert_eq!((decoded.width(), decoded.height()), (7, 5));
        assert_eq!(decoded.into_raw(), picture.rgb);
    }

    #[test]
    fn pictures_stand_side_by_side() {
        let row = Picture::beside(&[Picture::new(2, 3, [1; 3]), Picture::new(4, 1, [2; 3])], 1);
        assert_eq!((row.width, row.height), (7, 3));
        let red: Vec<u8> = row.rgb.iter().step_by(3).copied().collect();
        assert_eq!(red[..7], [1, 1, 255, 2, 2, 2, 2]);
        assert_eq!(red[14..], [1, 1, 255, 255, 255, 255, 255]);
    }

    #[test]
    fn drawing_outside_is_cut_off() {
        let mut picture = Picture::new(4, 4, [0; 3]);
        picture.line([-10.0, -10.0], [20.0, 20.0], 1.0, [255; 3]);
        picture.text(-3, -3, 2, [9; 3], "W\u{e9}");
        picture.fill_rectangle(2, 2, 100, 100, [7; 3]);
        assert_eq!(picture.rgb[(3 * 4 + 3) * 3], 7);
    }

    #[test]
    fn a_mask_has_an_opaque_border_and_a_tinted_inside() {
        let mut picture = Picture::new(5, 5, [0; 3]);
        let mask: Vec<u8> = (0..25).map(|i| u8::from((1..4).contains(&(i % 5)) && (1..4).contains(&(i / 5)))).collect();
        picture.overlay_mask(&mask, [200; 3], 0.5);
        let red: Vec<u8> = picture.rgb.iter().step_by(3).copied().collect();
        assert_eq!((red[0], red[6], red[12]), (0, 200, 100));
    }

    #[test]
    fn letters_differ() {
        let glyphs: Vec<_> = (' '..='~').map(font::glyph).collect();
        for (i, a) in glyphs.iter().enumerate() {
            assert!(glyphs[..i].iter().all(|b| a != b), "{:?}", char::from(b' ' + i as u8));
        }
    }
}

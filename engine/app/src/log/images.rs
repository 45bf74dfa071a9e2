//! The camera images of recordings as PNG, and as one animated picture.

use crate::check::BadInput;
use crate::files::write_whole;
use anyhow::{Context as _, Result};
use image::codecs::gif::{GifEncoder, Repeat};
use image::{Delay, Frame, RgbImage, RgbaImage};
use sfg_record::LogFile;
use sfg_record::views::ImageKind;
use std::io::Cursor;
use std::path::Path;
use std::time::Duration;

/// Width of one camera in the animated picture.
const GIF_WIDTH_PX: u32 = 320;
/// More pictures make a file that no README wants.
const MAX_FRAMES: usize = 120;
/// A long wait between two looks is shortened.
const MAX_WAIT_SECS: f64 = 1.0;
/// The last picture stays.
const LAST_SECS: f64 = 2.0;
/// 1 is the best and slowest choice of colours, 30 the fastest.
const GIF_SPEED: i32 = 10;

fn no_images(file: &LogFile) -> BadInput {
    BadInput(format!("{} has no camera images", file.path().display()))
}

/// Writes every image as `[<run>_]<camera>_<kind>_<seconds>.png`; how many.
pub(super) fn write_stills(files: &[LogFile], folder: &Path) -> Result<usize> {
    let mut n_images = 0;
    for (nth, file) in files.iter().enumerate() {
        let run = if files.len() > 1 { format!("{nth}_") } else { String::new() };
        for camera in file.cameras() {
            for (kind, word) in [(ImageKind::Colour, "image"), (ImageKind::Depth, "depth")] {
                for (secs, bytes) in file.images(&camera, kind)? {
                    let png = if kind == ImageKind::Depth { bytes } else { to_png(&decoded(&bytes)?)? };
                    write_whole(&folder.join(format!("{run}{camera}_{word}_{secs:08.3}.png")), &png)?;
                    n_images += 1;
                }
            }
        }
    }
    if n_images == 0 {
        return Err(files.first().map_or_else(|| BadInput("no run is given".to_owned()), no_images).into());
    }
    Ok(n_images)
}

fn decoded(bytes: &[u8]) -> Result<RgbImage> {
    Ok(image::load_from_memory(bytes).context("an image of the recording cannot be read")?.into_rgb8())
}

fn to_png(image: &RgbImage) -> Result<Vec<u8>> {
    let mut bytes = Cursor::new(Vec::new());
    image.write_to(&mut bytes, image::ImageFormat::Png)?;
    Ok(bytes.into_inner())
}

/// Writes the cameras side by side, every look a picture; how many.
pub(super) fn write_gif(file: &LogFile, path: &Path) -> Result<usize> {
    let mut cameras = Vec::new();
    for camera in file.cameras() {
        cameras.push(file.images(&camera, ImageKind::Colour)?);
    }
    let first = cameras.first().filter(|images| !images.is_empty()).ok_or_else(|| no_images(file))?;
    let stamps: Vec<f64> = first.iter().map(|(secs, _)| *secs).collect();
    let step = stamps.len().div_ceil(MAX_FRAMES);
    let shown: Vec<usize> = (0..stamps.len()).step_by(step.max(1)).collect();
    let mut bytes = Vec::new();
    let mut encoder = GifEncoder::new_with_speed(&mut bytes, GIF_SPEED);
    encoder.set_repeat(Repeat::Infinite)?;
    for (nth, idx) in shown.iter().enumerate() {
        let wait_secs = shown.get(nth + 1).map_or(LAST_SECS, |next| (stamps[*next] - stamps[*idx]).clamp(0.1, MAX_WAIT_SECS));
        let mut views = Vec::new();
        for images in &cameras {
            if let Some((_, bytes)) = images.get(*idx) {
                views.push(decoded(bytes)?);
            }
        }
        let delay = Delay::from_saturating_duration(Duration::from_secs_f64(wait_secs));
        encoder.encode_frame(Frame::from_parts(beside(&views), 0, 0, delay))?;
    }
    drop(encoder);
    write_whole(path, &bytes)?;
    Ok(shown.len())
}

/// The views in a row, made smaller.
fn beside(views: &[RgbImage]) -> RgbaImage {
    let small: Vec<RgbImage> = views
        .iter()
        .map(|view| {
            let height = (view.height() * GIF_WIDTH_PX).div_ceil(view.width().max(1)).max(1);
            image::imageops::thumbnail(view, GIF_WIDTH_PX, height)
        })
        .collect();
    let height = small.iter().map(RgbImage::height).max().unwrap_or(1);
    let mut row = RgbaImage::from_pixel(GIF_WIDTH_PX * small.len().max(1) as u32, height, image::Rgba([0, 0, 0, 255]));
    for (nth, view) in small.iter().enumerate() {
        let view = image::DynamicImage::from(view.clone()).into_rgba8();
        image::imageops::replace(&mut row, &view, i64::from(GIF_WIDTH_PX) * nth as i64, 0);
    }
    row
}

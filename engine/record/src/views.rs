//! What the cameras saw: `/camera/<name>/image`, `depth`, `calibration`, `annotations`.

use crate::RecordError;
use crate::frames::camera_frame;
use crate::messages::MaskView;
use crate::recording::{Detail, timestamp, typed};
use foxglove::messages::{
    CameraCalibration, CircleAnnotation, Color, CompressedImage, ImageAnnotations, Point2, PointsAnnotation, TextAnnotation,
    points_annotation,
};
use foxglove::{Channel, Context};
use image::codecs::jpeg::JpegEncoder;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder as _};
use sfg_types::{CameraIntrinsics, RgbdImage};
use std::sync::Arc;

/// Which image of a camera.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ImageKind {
    /// JPEG.
    Colour,
    /// 16-bit PNG in millimetres, 0 where nothing came back.
    Depth,
}

/// Of a look that a decision was taken on, and of a glance.
const JPEG_QUALITY: [u8; 2] = [85, 70];
/// A glance has every fourth pixel of every fourth row of the depths.
const GLANCE_STEP_PX: usize = 4;
const MASK: Color = Color { r: 1.0, g: 0.55, b: 0.0, a: 0.9 };
const KEY_POINT: Color = Color { r: 0.86, g: 0.08, b: 0.24, a: 1.0 };

pub(crate) struct CameraChannels {
    frame: String,
    image: Channel<CompressedImage>,
    depth: Channel<CompressedImage>,
    calibration: Channel<CameraCalibration>,
    annotations: Channel<ImageAnnotations>,
}

impl CameraChannels {
    pub(crate) fn new(context: &Arc<Context>, name: &str) -> Self {
        let topic = |what: &str| format!("/camera/{name}/{what}");
        Self {
            frame: camera_frame(name),
            image: typed(context, &topic("image")),
            depth: typed(context, &topic("depth")),
            calibration: typed(context, &topic("calibration")),
            annotations: typed(context, &topic("annotations")),
        }
    }

    pub(crate) fn images(&self, log_time_ns: u64, colour: &[u8], depth: &[u8]) {
        let message = |data: &[u8], format: &str| CompressedImage {
            timestamp: Some(timestamp(log_time_ns)),
            frame_id: self.frame.clone(),
            data: data.to_vec().into(),
            format: format.to_owned(),
        };
        self.image.log_with_time(&message(colour, "jpeg"), log_time_ns);
        self.depth.log_with_time(&message(depth, "png"), log_time_ns);
    }

    pub(crate) fn calibration(&self, log_time_ns: u64, intrinsics: &CameraIntrinsics) {
        let CameraIntrinsics { width, height, fx, fy, cx, cy } = *intrinsics;
        let message = CameraCalibration {
            timestamp: Some(timestamp(log_time_ns)),
            frame_id: self.frame.clone(),
            width: u32::try_from(width).unwrap_or(u32::MAX),
            height: u32::try_from(height).unwrap_or(u32::MAX),
            distortion_model: String::new(),
            d: Vec::new(),
            k: vec![fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0],
            r: vec![1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
            p: vec![fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0],
        };
        self.calibration.log_with_time(&message, log_time_ns);
    }

    /// The outline of the part, its box and the key point.
    pub(crate) fn annotations(&self, log_time_ns: u64, view: &MaskView) {
        let at = Some(timestamp(log_time_ns));
        let outline = PointsAnnotation {
            timestamp: at,
            r#type: points_annotation::Type::Points as i32,
            points: outline(view).into_iter().map(|[x, y]| Point2 { x: x as f64, y: y as f64 }).collect(),
            outline_color: Some(MASK),
            thickness: 1.5,
            ..PointsAnnotation::default()
        };
        let mut message = ImageAnnotations { timestamp: at, points: vec![outline], ..ImageAnnotations::default() };
        if let Some(bounds) = view.bounds {
            let [x0, y0, x1, y1] = bounds.map(|pixel| pixel as f64);
            let corners = [(x0, y0), (x1, y0), (x1, y1), (x0, y1)];
            message.points.push(PointsAnnotation {
                timestamp: at,
                r#type: points_annotation::Type::LineLoop as i32,
                points: corners.map(|(x, y)| Point2 { x, y }).to_vec(),
                outline_color: Some(MASK),
                thickness: 2.0,
                ..PointsAnnotation::default()
            });
            message.texts.push(TextAnnotation {
                timestamp: at,
                position: Some(Point2 { x: x0, y: y0 - 4.0 }),
                text: "part to hold".to_owned(),
                font_size: 14.0,
                text_color: Some(MASK),
                background_color: Some(Color { r: 0.0, g: 0.0, b: 0.0, a: 0.5 }),
                metadata: Vec::new(),
            });
        }
        if let Some([x, y]) = view.key_point_px {
            message.circles.push(CircleAnnotation {
                timestamp: at,
                position: Some(Point2 { x, y }),
                diameter: 12.0,
                thickness: 3.0,
                fill_color: None,
                outline_color: Some(KEY_POINT),
                metadata: Vec::new(),
            });
        }
        self.annotations.log_with_time(&message, log_time_ns);
    }
}

/// The pixels (column, row) of a mask that have a neighbour outside it, in rows from the top.
fn outline(view: &MaskView) -> Vec<[usize; 2]> {
    let (width, height) = (view.width.max(1), view.height);
    let mut inside = vec![false; width * height];
    for [start, length] in &view.runs {
        if let Some(stretch) = inside.get_mut(*start..start + length) {
            stretch.fill(true);
        }
    }
    let is_inside = |x: usize, y: usize| x < width && y < height && inside[y * width + x];
    let is_edge = |x: usize, y: usize| {
        !(x > 0 && y > 0 && is_inside(x - 1, y) && is_inside(x + 1, y) && is_inside(x, y - 1) && is_inside(x, y + 1))
    };
    let all = (0..inside.len()).filter(|idx| inside[*idx]).map(|idx| [idx % width, idx / width]);
    all.filter(|[x, y]| is_edge(*x, *y)).collect()
}

fn size(view: &RgbdImage) -> Option<(u32, u32)> {
    Some((u32::try_from(view.intrinsics.width).ok()?, u32::try_from(view.intrinsics.height).ok()?))
}

fn failed(view: &RgbdImage) -> impl Fn(image::ImageError) -> RecordError {
    let camera = view.camera.clone();
    move |source| RecordError::Image { camera: camera.clone(), source }
}

/// The pixels are not as many as the calibration says.
fn misshapen(view: &RgbdImage) -> RecordError {
    use image::error::{ParameterError, ParameterErrorKind};
    failed(view)(image::ImageError::Parameter(ParameterError::from_kind(ParameterErrorKind::DimensionMismatch)))
}

/// The colours as JPEG.
pub(crate) fn jpeg(view: &RgbdImage, detail: Detail) -> Result<Vec<u8>, RecordError> {
    let (width, height) = size(view).ok_or_else(|| misshapen(view))?;
    if view.rgb.len() != 3 * view.intrinsics.width * view.intrinsics.height {
        return Err(misshapen(view));
    }
    let mut bytes = Vec::new();
    let encoder = JpegEncoder::new_with_quality(&mut bytes, JPEG_QUALITY[usize::from(detail == Detail::Glance)]);
    encoder.write_image(&view.rgb, width, height, ExtendedColorType::Rgb8).map_err(failed(view))?;
    Ok(bytes)
}

/// The depths in millimetres as 16-bit PNG; a glance is smaller.
pub(crate) fn depth_png(view: &RgbdImage, detail: Detail) -> Result<Vec<u8>, RecordError> {
    let (width, height) = (view.intrinsics.width, view.intrinsics.height);
    if view.depth_m.len() != width * height || width == 0 {
        return Err(misshapen(view));
    }
    let step = if detail == Detail::Full { 1 } else { GLANCE_STEP_PX };
    let millimetres = |metres: &f32| (1000.0 * metres).round().clamp(0.0, 65_535.0) as u16;
    let rows = view.depth_m.chunks(width).step_by(step);
    let pixels: Vec<u8> = rows.flat_map(|row| row.iter().step_by(step).map(millimetres)).flat_map(u16::to_ne_bytes).collect();
    let [width, height] = [width, height].map(|size| u32::try_from(size.div_ceil(step)));
    let (Ok(width), Ok(height)) = (width, height) else { return Err(misshapen(view)) };
    let mut bytes = Vec::new();
    let encoder = PngEncoder::new_with_quality(&mut bytes, CompressionType::Fast, FilterType::Sub);
    encoder.write_image(&pixels, width, height, ExtendedColorType::L16).map_err(failed(view))?;
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    #![expect(clippy::unwrap_used, reason = "tests fail by panicking")]
    use super::*;
    use sfg_types::Pose;

    fn view() -> RgbdImage {
        let intrinsics = CameraIntrinsics { width: 8, height: 6, fx: 8.0, fy: 8.0, cx: 3.5, cy: 2.5 };
        let depth_m = (0..48).map(|idx| if idx == 5 { 0.0 } else { 0.5 + 0.001 * idx as f32 }).collect();
        let rgb = (0..48).flat_map(|_| [200, 100, 50]).collect();
        RgbdImage { camera: "left".to_owned(), intrinsics, base_from_camera: Pose::identity(), rgb, depth_m }
    }

    #[test]
    fn depth_comes_back_in_millimetres() {
        let full = image::load_from_memory(&depth_png(&view(), Detail::Full).unwrap()).unwrap().into_luma16();
        assert_eq!((full.width(), full.height()), (8, 6));
        assert_eq!([full.get_pixel(0, 0).0[0], full.get_pixel(5, 0).0[0], full.get_pixel(7, 5).0[0]], [500, 0, 547]);
        let glance = image::load_from_memory(&depth_png(&view(), Detail::Glance).unwrap()).unwrap().into_luma16();
        assert_eq!((glance.width(), glance.height(), glance.get_pixel(1, 1).0[0]), (2, 2, 536));
    }

    #[test]
    fn colours_come_back_nearly_and_a_wrong_size_is_an_error() {
        let image = image::load_from_memory(&jpeg(&view(), Detail::Full).unwrap()).unwrap().into_rgb8();
        let [r, g, b] = image.get_pixel(4, 3).0;
        assert!(r.abs_diff(200) < 6 && g.abs_diff(100) < 6 && b.abs_diff(50) < 6, "{r} {g} {b}");
        let broken = RgbdImage { rgb: vec![0; 5], depth_m: vec![0.0; 5], ..view() };
        assert!(jpeg(&broken, Detail::Full).unwrap_err().to_string().contains("left"));
        assert!(depth_png(&broken, Detail::Full).is_err());
    }

    #[test]
    fn an_outline_has_the_edge_alone() {
        let mut pixels = vec![0; 25];
        for (x, y) in (1..4).flat_map(|x| (1..4).map(move |y| (x, y))) {
            pixels[y * 5 + x] = 1;
        }
        let mask = sfg_types::AffordanceMask { camera: "left".to_owned(), width: 5, height: 5, pixels };
        let edge = outline(&MaskView::new(&mask, None));
        assert_eq!(edge.len(), 8);
        assert!(!edge.contains(&[2, 2]));
    }
}

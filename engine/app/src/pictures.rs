//! The pictures of a run: what was seen, what was chosen, what came of it.

use anyhow::Result;
use sfg_render::Picture;
use sfg_skills::Kept;
use sfg_types::{AffordanceMask, CameraIntrinsics, Point, Pose, RgbdImage};

const MASK: [u8; 3] = [255, 140, 0];
const KEY_POINT: [u8; 3] = [220, 20, 60];
const CHOSEN: [u8; 3] = [0, 170, 90];
const REJECTED: [u8; 3] = [90, 90, 200];
const GROUND: [u8; 3] = [20, 24, 32];
const INK: [u8; 3] = [240, 240, 240];

fn pixel(intrinsics: &CameraIntrinsics, base_from_camera: &Pose, point_in_base: &Point) -> Option<[f64; 2]> {
    intrinsics.project(&(base_from_camera.inverse() * point_in_base)).map(|pixel| [pixel.x, pixel.y])
}

fn view_of(image: &RgbdImage) -> Picture {
    Picture::from_rgb(image.intrinsics.width, image.intrinsics.height, &image.rgb)
}

/// Draws a palm: a short bar along the fingers and an arrow of approach.
fn draw_palm(picture: &mut Picture, image: &RgbdImage, base_from_palm: &Pose, colour: [u8; 3], thickness: f64) {
    let at = |x: f64, y: f64, z: f64| pixel(&image.intrinsics, &image.base_from_camera, &(base_from_palm * Point::new(x, y, z)));
    let strokes =
        [[(-0.04, 0.0, 0.0), (0.07, 0.0, 0.0)], [(0.0, -0.035, 0.0), (0.0, 0.035, 0.0)], [(0.0, 0.0, -0.07), (0.0, 0.0, 0.0)]];
    for [(ax, ay, az), (bx, by, bz)] in strokes {
        if let (Some(a), Some(b)) = (at(ax, ay, az), at(bx, by, bz)) {
            picture.line(a, b, thickness, colour);
        }
    }
}

/// Both views with the part's mask and the key point: the grounding.
pub(crate) fn grounding(kept: &Kept) -> Result<Option<Vec<u8>>> {
    let Some(observation) = &kept.observation else { return Ok(None) };
    let mut views = Vec::new();
    for image in &observation.views {
        let mut picture = view_of(image);
        let mask: Option<&AffordanceMask> =
            kept.masks.as_ref().and_then(|masks| masks.iter().find(|mask| mask.camera == image.camera));
        if let Some(mask) = mask {
            picture.overlay_mask(&mask.pixels, MASK, 0.45);
        }
        if let Some(key_point) = &kept.key_point
            && let Some(at) = pixel(&image.intrinsics, &image.base_from_camera, &key_point.point_in_base)
        {
            picture.cross(at, 10.0, KEY_POINT);
        }
        picture.label(8, 8, 2, INK, GROUND, &format!("{} camera: part and key point", image.camera));
        views.push(picture);
    }
    Ok(Some(Picture::beside(&views, 6).png()?))
}

/// Both views with the candidates and the chosen palm pose.
pub(crate) fn palm_poses(kept: &Kept) -> Result<Option<Vec<u8>>> {
    let (Some(observation), Some(candidates)) = (&kept.observation, &kept.candidates) else { return Ok(None) };
    let chosen_idx = kept.selection.as_ref().map(|selection| selection.chosen.candidate_idx);
    let mut views = Vec::new();
    for image in &observation.views {
        let mut picture = view_of(image);
        for (idx, candidate) in candidates.iter().enumerate() {
            if Some(idx) != chosen_idx {
                draw_palm(&mut picture, image, &candidate.base_from_palm, REJECTED, 1.5);
            }
        }
        if let Some(candidate) = chosen_idx.and_then(|idx| candidates.get(idx)) {
            draw_palm(&mut picture, image, &candidate.base_from_palm, CHOSEN, 4.0);
        }
        picture.label(8, 8, 2, INK, GROUND, &format!("{} palm poses, the chosen one in green", candidates.len()));
        views.push(picture);
    }
    Ok(Some(Picture::beside(&views, 6).png()?))
}

/// A simulator picture as PNG, said to be one.
pub(crate) fn labelled(width: usize, height: usize, rgb: &[u8], text: &str) -> Result<Vec<u8>> {
    let mut picture = Picture::from_rgb(width, height, rgb);
    picture.label(8, 8, 2, INK, GROUND, text);
    Ok(picture.png()?)
}

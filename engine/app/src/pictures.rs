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

/// The pictures of a run in the order in which its page shows them.
///
/// `result` is the scene at the end, `at_grasp` the hand when it had closed; both are simulator pictures.
pub(crate) fn of_run(kept: &Kept, result: Vec<u8>, at_grasp: Option<Vec<u8>>) -> Result<Vec<sfg_record::Picture>> {
    let mut shown = grounding(kept)?;
    if let Some(png) = palm_poses(kept)? {
        shown.push(sfg_record::Picture::new("palm_poses", "Candidate palm poses; the chosen one in green.", png));
    }
    if let Some(png) = at_grasp {
        shown.push(sfg_record::Picture::new("grasp", "The hand when it had closed (simulator picture).", png));
    }
    shown.push(sfg_record::Picture::new("result", "The scene when the judge looked (simulator picture).", result));
    Ok(shown)
}

/// The pictures of the grounding: colour, depth and mask of each view, the mask with its box and the key point.
fn grounding(kept: &Kept) -> Result<Vec<sfg_record::Picture>> {
    let mut shown = Vec::new();
    let Some(observation) = &kept.observation else { return Ok(shown) };
    for image in &observation.views {
        let name = |what: &str| format!("{}{}_{what}", sfg_record::Picture::GROUNDING, image.camera);
        let camera = &image.camera;
        shown.push(sfg_record::Picture::new(&name("colour"), &format!("{camera} camera: colour"), view_of(image).png()?));
        let (near_m, far_m) = depth_range(image);
        let depth = Picture::from_depth(image.intrinsics.width, image.intrinsics.height, &image.depth_m, near_m, far_m);
        let caption = format!("{camera} camera: depth from {near_m:.2} m to {far_m:.2} m");
        shown.push(sfg_record::Picture::new(&name("depth"), &caption, depth.png()?));
        let mask = kept.masks.as_ref().and_then(|masks| masks.iter().find(|mask| mask.camera == image.camera));
        let caption = match mask {
            Some(mask) => format!("{camera} camera: part to hold, {} pixels, and the task key point", mask.n_selected()),
            None if kept.masks.is_none() => format!("{camera} camera: no part was looked for"),
            None => format!("{camera} camera: no part was found"),
        };
        shown.push(sfg_record::Picture::new(&name("mask"), &caption, mask_view(kept, image, mask).png()?));
    }
    Ok(shown)
}

/// The depths that all but the nearest and farthest hundredth of the pixels lie between, metres.
fn depth_range(image: &RgbdImage) -> (f32, f32) {
    let mut depths: Vec<f32> = image.depth_m.iter().copied().filter(|depth| *depth > 0.0).collect();
    depths.sort_by(f32::total_cmp);
    match depths.len() {
        0 => (0.3, 2.5),
        n => (depths[n / 100], depths[n - 1 - n / 100].max(depths[n / 100] + 0.01)),
    }
}

fn mask_view(kept: &Kept, image: &RgbdImage, mask: Option<&AffordanceMask>) -> Picture {
    let mut picture = view_of(image);
    if let Some(mask) = mask {
        picture.overlay_mask(&mask.pixels, MASK, 0.5);
        if let Some([left, top, right, bottom]) = box_of(mask) {
            let corners = [[left, top], [right, top], [right, bottom], [left, bottom], [left, top]];
            picture.polyline(&corners, 2.0, MASK);
        }
    }
    if let Some(key_point) = &kept.key_point
        && let Some(at) = pixel(&image.intrinsics, &image.base_from_camera, &key_point.point_in_base)
    {
        picture.cross(at, 10.0, KEY_POINT);
    }
    picture
}

/// Left, top, right and bottom of the selected pixels.
fn box_of(mask: &AffordanceMask) -> Option<[f64; 4]> {
    let mut bounds: Option<[usize; 4]> = None;
    for (idx, _) in mask.pixels.iter().enumerate().filter(|(_, pixel)| **pixel != 0) {
        let (column, row) = (idx % mask.width, idx / mask.width);
        let [left, top, right, bottom] = bounds.get_or_insert([column, row, column, row]);
        (*left, *top, *right, *bottom) = ((*left).min(column), (*top).min(row), (*right).max(column), (*bottom).max(row));
    }
    bounds.map(|bounds| bounds.map(|bound| bound as f64))
}

/// Both views with the candidates and the chosen palm pose.
fn palm_poses(kept: &Kept) -> Result<Option<Vec<u8>>> {
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

//! Which points of a thing belong to a named part, decided by shape.

use crate::round::Revolution;
use crate::shape::{HANDLE_GAP_M, RIM_M, Shape};
use crate::vocabulary::HandleEnd;
use nalgebra::Point3;
use sfg_types::ShapeClass;

/// Points this far outside the radius still belong to the body: three sigmas of the noise across the view.
const BODY_MARGIN_M: f32 = 0.005;

/// A region of a thing, as a test on points.
#[derive(Clone, Debug)]
pub(crate) enum Part {
    /// All of it.
    Whole,
    /// Heights of a round thing, within the body (true) or with whatever sticks out.
    Band { low_z_m: f32, high_z_m: f32, body_only: bool },
    /// What sticks out of the round body.
    Handle,
    /// One end of a lying thing: from the split towards the positive (true) or negative end of the long side.
    End { positive: bool },
    /// A disk around the axis near the top.
    Knob { low_z_m: f32, radius_m: f32 },
}

/// The region that `word` names on a thing of this shape; `None` when the thing shows no such part.
///
/// | word | round thing | lying thing | box, blob |
/// |---|---|---|---|
/// | body | the wide section up to the shoulder, without handle | the section that is not held | all |
/// | neck | the narrow section above the shoulder | the thin section | - |
/// | cap, nozzle, trigger, lid, top | the top, at most 3 cm (a quarter for wide things) | the wide section | upper third |
/// | rim, edge | the top 12 mm of an open thing | - | all |
/// | handle, grip, stem | what sticks out; the narrow section of a stemmed glass | the section that is held | all |
/// | head, blade, bowl, tip and so on | the body | the section that is not held | all |
/// | knob | the narrow top of a wide thing | - | upper third |
pub(crate) fn part(shape: &Shape, word: &str, handle_end: Option<HandleEnd>) -> Option<Part> {
    let word = word.trim().to_lowercase();
    if matches!(word.as_str(), "whole" | "object" | "any" | "") {
        return Some(Part::Whole);
    }
    if let Some(round) = &shape.round {
        return round_part(shape, round, &word);
    }
    if shape.class == ShapeClass::Elongated {
        return lying_part(shape, &word, handle_end);
    }
    match word.as_str() {
        "top" | "lid" | "cap" | "knob" | "nozzle" | "trigger" => {
            Some(Part::Band { low_z_m: shape.top_z_m - shape.height_m() / 3.0, high_z_m: f32::MAX, body_only: false })
        }
        "neck" => None,
        _ => Some(Part::Whole),
    }
}

fn round_part(shape: &Shape, round: &Revolution, word: &str) -> Option<Part> {
    let (low, high) = (shape.bottom_z_m, shape.top_z_m);
    let height = high - low;
    let band = |low_z_m: f32, high_z_m: f32| Part::Band { low_z_m, high_z_m, body_only: true };
    let narrow_top = shape.top_ratio() < 0.80;
    match word {
        "body" | "side" | "wall" | "barrel" => Some(band(low, shoulder(round, high))),
        "base" | "bottom" | "foot" => Some(band(low, low + 0.3 * height)),
        "neck" if narrow_top => Some(band(shoulder(round, high) + 0.010, high)),
        "neck" => None,
        "cap" | "lid" | "top" | "nozzle" | "trigger" | "shoulder" => Some(band(high - 0.03_f32.min(height / 4.0), f32::MAX)),
        "knob" if narrow_top => {
            Some(Part::Knob { low_z_m: high - 0.03_f32.min(height / 2.0), radius_m: 0.6 * round.max_radius_m() })
        }
        "knob" => None,
        "rim" | "edge" | "lip" | "mouth" => Some(band(high - RIM_M, f32::MAX)),
        "handle" | "grip" if shape.handle_reach_m > 0.0 => Some(Part::Handle),
        "handle" | "grip" => None,
        "stem" => stem(round, low, high),
        "bowl" | "head" => Some(band(low + 0.4 * height, high)),
        _ => None,
    }
}

/// Height up to which the radius stays near its largest value, from below; the whole height for straight things.
fn shoulder(round: &Revolution, top_z_m: f32) -> f32 {
    let widest = round.max_radius_m();
    let mut last = None;
    for slice in &round.slices {
        if slice.radius_m > 0.85 * widest {
            last = Some(slice.z_m + crate::round::SLICE_M / 2.0);
        }
    }
    last.map_or(top_z_m, |z| if top_z_m - z < 0.012 { f32::MAX } else { z })
}

/// The narrow section of a stemmed glass: slices well below half the widest radius, away from top and bottom.
fn stem(round: &Revolution, low: f32, high: f32) -> Option<Part> {
    let limit = 0.45 * round.max_radius_m();
    let inner = |z: f32| z > low + 0.1 * (high - low) && z < low + 0.7 * (high - low);
    let narrow: Vec<f32> = round.slices.iter().filter(|s| s.radius_m < limit && inner(s.z_m)).map(|s| s.z_m).collect();
    let (first, last) = (narrow.first()?, narrow.last()?);
    Some(Part::Band { low_z_m: first - 0.004, high_z_m: last + 0.004, body_only: true })
}

fn lying_part(shape: &Shape, word: &str, handle_end: Option<HandleEnd>) -> Option<Part> {
    let form = shape.lengthwise?;
    if form.wide_m < 1.25 * form.thin_m {
        // Evenly thick, like a pen: one part for every word.
        return Some(Part::Whole);
    }
    // Most tools carry a wider head on a thinner handle.
    let held_is_wide = handle_end == Some(HandleEnd::Thick);
    let held_positive = form.wide_at_end == held_is_wide;
    match word {
        "handle" | "grip" | "stem" => Some(Part::End { positive: held_positive }),
        "neck" | "shaft" => Some(Part::End { positive: !form.wide_at_end }),
        "top" | "cap" | "lid" => Some(Part::End { positive: form.wide_at_end }),
        "rim" | "knob" | "nozzle" | "trigger" => None,
        _ => Some(Part::End { positive: !held_positive }),
    }
}

impl Part {
    /// True when `point` of the thing belongs to the part.
    pub(crate) fn contains(&self, shape: &Shape, point: &Point3<f32>) -> bool {
        match self {
            Self::Whole => true,
            Self::Band { low_z_m, high_z_m, body_only } => {
                let within = point.z >= *low_z_m && point.z <= *high_z_m;
                let on_body = || {
                    shape.round.as_ref().is_none_or(|round| {
                        round.distance(point.x, point.y)
                            < round.radius_at(point.z).max(0.5 * round.max_radius_m()) + BODY_MARGIN_M
                    })
                };
                within && (!body_only || on_body())
            }
            Self::Handle => shape.round.as_ref().is_some_and(|round| {
                let distance = round.distance(point.x, point.y);
                distance > round.radius_at(point.z) + HANDLE_GAP_M && distance > 0.8 * round.max_radius_m() + HANDLE_GAP_M
            }),
            Self::End { positive } => shape.lengthwise.is_some_and(|form| {
                let [u, _] = shape.rectangle.local(point.x, point.y);
                (u > form.split_m) == *positive
            }),
            Self::Knob { low_z_m, radius_m } => {
                point.z >= *low_z_m && shape.round.as_ref().is_some_and(|round| round.distance(point.x, point.y) < *radius_m)
            }
        }
    }
}

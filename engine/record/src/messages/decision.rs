//! What was decided, on what, and how it was judged.

use schemars::JsonSchema;
use serde::Serialize;
use serde_json::Value;
use sfg_types::{
    AffordanceMask, FunctionalityAnswer, Outcome, PalmPoseCandidate, PredicateResult, Rejected, SceneInventory, StageRecord,
};

/// `/stages`: a stage of the data path ended.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
#[serde(transparent)]
pub struct Stage<'a>(pub &'a StageRecord);

/// `/functionality`: what the language backend answered.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct Functionality<'a> {
    /// Time on the driver's clock.
    pub stamp_secs: f64,
    /// `act`, `ask` or `refuse`.
    pub answer: &'a FunctionalityAnswer,
}

/// `/inventory`: what stands on the table, as far as the sensors tell.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct Inventory<'a> {
    /// Time on the driver's clock.
    pub stamp_secs: f64,
    /// The things and the table's height.
    #[serde(flatten)]
    pub inventory: &'a SceneInventory,
}

/// `/masks`: the part to hold in each view.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct Masks {
    /// Time on the driver's clock.
    pub stamp_secs: f64,
    /// One a camera.
    pub views: Vec<MaskView>,
}

/// The part to hold in one view.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct MaskView {
    /// Name of the camera.
    pub camera: String,
    /// Image width, pixels.
    pub width: usize,
    /// Image height, pixels.
    pub height: usize,
    /// `[start, length]` of the selected stretches, row-major pixel numbers.
    pub runs: Vec<[usize; 2]>,
    /// Columns and rows of the smallest box around them: `[x0, y0, x1, y1]`, ends included.
    #[serde(rename = "box")]
    pub bounds: Option<[usize; 4]>,
    /// Where the key point is seen: column, row.
    pub key_point_px: Option<[f64; 2]>,
}

impl MaskView {
    /// The mask with the key point seen at `key_point_px`.
    #[must_use]
    pub fn new(mask: &AffordanceMask, key_point_px: Option<[f64; 2]>) -> Self {
        let runs = runs_of(&mask.pixels);
        let mut bounds: Option<[usize; 4]> = None;
        for pixel in runs.iter().flat_map(|[start, length]| [*start, start + length - 1, start + length / 2]) {
            let (x, y) = (pixel % mask.width.max(1), pixel / mask.width.max(1));
            let found = bounds.get_or_insert([x, y, x, y]);
            *found = [found[0].min(x), found[1].min(y), found[2].max(x), found[3].max(y)];
        }
        // A stretch over the end of a row covers both edges.
        if let Some(bounds) = &mut bounds
            && runs.iter().any(|[start, length]| start / mask.width.max(1) != (start + length - 1) / mask.width.max(1))
        {
            (bounds[0], bounds[2]) = (0, mask.width.saturating_sub(1));
        }
        Self { camera: mask.camera.clone(), width: mask.width, height: mask.height, runs, bounds, key_point_px }
    }
}

/// `[start, length]` of each stretch of set pixels.
#[must_use]
pub fn runs_of(pixels: &[u8]) -> Vec<[usize; 2]> {
    let mut runs: Vec<[usize; 2]> = Vec::new();
    for (idx, _) in pixels.iter().enumerate().filter(|(_, pixel)| **pixel != 0) {
        match runs.last_mut() {
            Some([start, length]) if *start + *length == idx => *length += 1,
            _ => runs.push([idx, 1]),
        }
    }
    runs
}

/// `/key_point`: the point that the grasp should be near.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, JsonSchema)]
pub struct KeyPoint {
    /// Time on the driver's clock.
    pub stamp_secs: f64,
    /// The point, metres.
    pub point_in_base: [f64; 3],
    /// Masked pixels with a depth, over all views.
    pub n_pixels: usize,
}

/// `/candidates`: palm poses, once as generated and again when one was selected or none could be.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct Candidates<'a> {
    /// Time on the driver's clock.
    pub stamp_secs: f64,
    /// In the order of the generator, best first.
    pub candidates: Vec<CandidateEntry<'a>>,
    /// The one to execute.
    pub chosen: Option<usize>,
    /// Positions of the palm along transit and approach of the chosen one, metres.
    pub path: Vec<[f64; 3]>,
}

/// One palm pose.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct CandidateEntry<'a> {
    /// Its number.
    pub idx: usize,
    /// Pose, score and terms.
    #[serde(flatten)]
    pub candidate: &'a PalmPoseCandidate,
    /// Why it is not executed.
    pub rejected: Option<Rejection>,
}

/// Why a candidate is not executed.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct Rejection {
    /// `table_clearance`, `no_inverse_kinematics`, `collision`, `no_path`, `far_from_key_point` or `ranked_lower`.
    pub why: String,
    /// The same in a sentence, with the nearest miss.
    pub text: String,
}

impl<'a> Candidates<'a> {
    /// The candidates with the rejections that are known so far.
    #[must_use]
    pub fn new(stamp_secs: f64, candidates: &'a [PalmPoseCandidate], rejected: &[Rejected]) -> Self {
        let rejection = |idx| {
            let found = rejected.iter().find(|rejected| rejected.candidate_idx == idx)?;
            let tag = serde_json::to_value(&found.reason).ok()?;
            Some(Rejection { why: tag["why"].as_str().unwrap_or_default().to_owned(), text: found.reason.to_string() })
        };
        let entry = |(idx, candidate)| CandidateEntry { idx, candidate, rejected: rejection(idx) };
        Self { stamp_secs, candidates: candidates.iter().enumerate().map(entry).collect(), chosen: None, path: Vec::new() }
    }
}

/// `/verdict`: how the run was judged. Once, at the end.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct Verdict<'a> {
    /// How it ended.
    pub outcome: Outcome,
    /// The scenario's success predicates.
    pub predicates: &'a [PredicateResult],
    /// What the judge saw beyond them.
    pub judge: &'a Value,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mask_becomes_stretches_and_a_box() {
        let mask =
            AffordanceMask { camera: "left".to_owned(), width: 4, height: 3, pixels: vec![0, 1, 1, 0, 0, 0, 1, 0, 0, 0, 0, 0] };
        let view = MaskView::new(&mask, None);
        assert_eq!(view.runs, [[1, 2], [6, 1]]);
        assert_eq!(view.bounds, Some([1, 0, 2, 1]));
        let wrapped = AffordanceMask { pixels: vec![0, 0, 0, 1, 1, 0, 0, 0, 0, 0, 0, 0], ..mask.clone() };
        assert_eq!(MaskView::new(&wrapped, None).bounds, Some([0, 0, 3, 1]));
        assert_eq!(MaskView::new(&AffordanceMask::empty("left", 4, 3), None).bounds, None);
    }
}

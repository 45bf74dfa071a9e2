//! Laws of a pose generator.

use super::{Laws, PoseScene};
use crate::{PoseGenerator, PoseRequest, views};
use sfg_types::{GraspType, HandProfile, HandSide, PalmPoseCandidate, Pose, SynergyCoordinates};

/// Most candidates asked for at once.
const CAPACITY: usize = 8;

/// Every law that `generator` breaks with `hand`: at most as many candidates as there is room for, finite poses with unit
/// quaternions, stability in [0, 1] and falling, synergy in range, the side asked for, terms that cross the C boundary, the same
/// answer to the same question, and no panic on a grid in which nothing was seen.
///
/// # Errors
/// The broken laws, a sentence each.
pub fn pose_generator_suite(generator: &mut dyn PoseGenerator, hand: &HandProfile) -> Result<(), Vec<String>> {
    let mut laws = Laws::default();
    let scenes = [("cylinder", PoseScene::cylinder()), ("ball", PoseScene::ball())];
    for (name, scene) in &scenes {
        for side in [HandSide::Left, HandSide::Right] {
            for kind in [GraspType::MediumWrap, GraspType::PalmarPinch] {
                let case = format!("{name}, {} hand, {kind}", side.name());
                let request = scene.request(hand, side, kind);
                let first = ask(generator, &request, CAPACITY, &case, &mut laws);
                let again = ask(generator, &request, CAPACITY, &case, &mut laws);
                laws.check(first == again, || format!("{case}: the same question got two different answers"));
                for (i, candidate) in first.iter().flatten().enumerate() {
                    check_candidate(candidate, side, &format!("{case}, candidate {i}"), &mut laws);
                }
                let falling = first.iter().all(|list| list.windows(2).all(|pair| pair[0].stability >= pair[1].stability));
                laws.check(falling, || format!("{case}: candidates are not sorted best first"));
            }
        }
    }
    let request = scenes[0].1.request(hand, HandSide::Left, GraspType::MediumWrap);
    for capacity in [0, 1] {
        ask(generator, &request, capacity, &format!("room for {capacity}"), &mut laws);
    }
    // An error and no candidate are both ordinary here; a candidate would be invented.
    let nothing = PoseScene::unobserved();
    for side in [HandSide::Left, HandSide::Right] {
        let found = generator.generate(&nothing.request(hand, side, GraspType::MediumWrap), &mut blank(CAPACITY)).unwrap_or(0);
        laws.check(found == 0, || format!("nothing seen, {} hand: {found} candidates were invented", side.name()));
    }
    laws.into_result()
}

/// The candidates, or `None` after an error, which is no answer to an ordinary question.
fn ask(
    generator: &mut dyn PoseGenerator,
    request: &PoseRequest<'_>,
    capacity: usize,
    case: &str,
    laws: &mut Laws,
) -> Option<Vec<PalmPoseCandidate>> {
    let mut out = blank(capacity);
    match generator.generate(request, &mut out) {
        Ok(n) if n <= capacity => {
            out.truncate(n);
            Some(out)
        }
        Ok(n) => {
            laws.check(false, || format!("{case}: {n} candidates were claimed, there was room for {capacity}"));
            None
        }
        Err(error) => {
            laws.check(false, || format!("{case}: {error}"));
            None
        }
    }
}

fn check_candidate(candidate: &PalmPoseCandidate, side: HandSide, case: &str, laws: &mut Laws) {
    laws.check(candidate.hand_side == side, || format!("{case}: for the {} hand", candidate.hand_side.name()));
    // The boundary's own checks are the laws of a value: finite, unit quaternion, ranges, terms that fit.
    match views::palm_pose_view(candidate).and_then(|view| views::candidate(&view)) {
        Ok(_) => {}
        Err(error) => laws.check(false, || format!("{case}: {error}")),
    }
}

fn blank(capacity: usize) -> Vec<PalmPoseCandidate> {
    let candidate = PalmPoseCandidate {
        base_from_palm: Pose::identity(),
        hand_side: HandSide::Left,
        stability: 0.0,
        synergy: SynergyCoordinates::OPEN,
        terms: Vec::new(),
    };
    vec![candidate; capacity]
}

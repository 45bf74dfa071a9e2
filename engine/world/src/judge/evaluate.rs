//! Answers: predicates against truth, and the report on a grasp.

use super::predicate::{Check, Predicate, Verdict};
use super::{GraspRecord, HoldPhase, Judge, Tampering};
use crate::WorldError;
use crate::bodies::Bodies;
use serde::{Deserialize, Serialize};
use sfg_types::GraspType;

/// Speed against its surroundings under which a grain lies at rest, m/s.
pub const AT_REST_MPS: f64 = 0.1;
/// A grasp counts when the object was lifted this high, metres,
pub const LIFTED_M: f64 = 0.10;
/// held this long, seconds,
pub const HELD_SECS: f64 = 2.0;
/// and at least this share of the contacts is on the asked part.
pub const PART_SHARE: f64 = 0.5;

/// What a run set out to do; the judge compares.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct GraspAsked {
    /// Object name.
    pub object: String,
    /// Label of the part to hold.
    pub part: String,
    /// The grasp type.
    pub grasp_type: GraspType,
}

/// What the judge says about a grasp, whatever the scenario asks.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct JudgeReport {
    /// Object name.
    pub object: String,
    /// Largest rise of its centre while held, metres.
    pub lifted_m: f64,
    /// It rose by [`LIFTED_M`].
    pub lifted: bool,
    /// Longest uninterrupted hold, seconds.
    pub held_secs: f64,
    /// It was held for [`HELD_SECS`].
    pub held: bool,
    /// It is in the hand now.
    pub held_now: bool,
    /// Share of the contacts on the asked part.
    pub part_share: Option<f64>,
    /// Type shown by the hand.
    pub recognised_type: Option<GraspType>,
    /// It is the asked one.
    pub type_right: bool,
    /// Displacement in the palm since closing ended, metres.
    pub slip_m: Option<f64>,
    /// Rotation in the palm since closing ended, degrees.
    pub slip_deg: Option<f64>,
    /// Penetration on the exact signed distance field, metres.
    pub penetration_m: Option<f64>,
    /// Contacts and part shares behind these numbers.
    pub grasp: Option<GraspRecord>,
    /// Lifted, held, on the part, of the right type.
    pub functional_success: bool,
    /// The broken physics invariant, if any.
    pub physics_tampered: Option<Tampering>,
    /// Hash of the named bodies, 16 hexadecimal digits.
    pub state_hash: String,
}

pub(crate) fn object_idx(bodies: &Bodies, name: &str) -> Result<usize, WorldError> {
    bodies.objects.iter().position(|o| o.name == name).ok_or_else(|| WorldError::UnknownObject {
        name: name.to_owned(),
        known: bodies.objects.iter().map(|o| o.name.clone()).collect(),
    })
}

/// Judges all predicates at once.
pub(crate) fn verdict(
    judge: &Judge,
    bodies: &Bodies,
    predicates: &[Predicate],
    physics_tampered: Option<Tampering>,
) -> Result<Verdict, WorldError> {
    let mut checks = Vec::new();
    for predicate in predicates {
        evaluate(judge, bodies, predicate, &mut checks)?;
    }
    let success = physics_tampered.is_none() && !checks.is_empty() && checks.iter().all(|check| check.pass);
    Ok(Verdict { checks, physics_tampered, success })
}

fn evaluate(judge: &Judge, bodies: &Bodies, predicate: &Predicate, out: &mut Vec<Check>) -> Result<(), WorldError> {
    let mut push = |name: &str, value: Option<f64>, threshold: f64, pass: bool, detail: String| {
        out.push(Check { name: name.to_owned(), value, threshold, pass, detail });
    };
    let n_grains = bodies.grains.len();
    let share = |n: usize| (n_grains > 0).then(|| n as f64 / n_grains as f64);
    match predicate {
        Predicate::GrainsIn { container, at_least } => {
            let vessel_idx = object_idx(bodies, container)?;
            let inside = (0..n_grains).filter(|&grain_idx| is_inside(bodies, grain_idx, vessel_idx)).count();
            let resting = (0..n_grains)
                .filter(|&grain_idx| is_inside(bodies, grain_idx, vessel_idx) && is_at_rest(bodies, grain_idx, vessel_idx))
                .count();
            let value = share(resting);
            let detail = format!("{resting} of {n_grains} grains lie in {container}, {} more move there", inside - resting);
            push("grains_in", value, *at_least, value.is_some_and(|v| v >= *at_least), detail);
        }
        Predicate::SpilledAtMost { fraction, container } => {
            let target = container.as_ref().map(|name| object_idx(bodies, name)).transpose()?;
            let targets: Vec<usize> = target.map_or_else(|| (0..bodies.objects.len()).collect(), |idx| vec![idx]);
            let is_kept = |grain_idx: usize| {
                let own = bodies.grains[grain_idx].vessel_idx;
                is_inside(bodies, grain_idx, own) || targets.iter().any(|&idx| is_inside(bodies, grain_idx, idx))
            };
            let n_spilled = (0..n_grains).filter(|&grain_idx| !is_kept(grain_idx)).count();
            let value = share(n_spilled);
            let detail = format!("{n_spilled} of {n_grains} grains lie elsewhere");
            push("spilled_at_most", value, *fraction, value.is_some_and(|v| v <= *fraction), detail);
        }
        Predicate::StillHeld { object, within_m, within_deg } => {
            let tracker = &judge.trackers[object_idx(bodies, object)?];
            let slip = tracker.latest.as_ref().filter(|_| tracker.is_held()).map(super::Hold::slip);
            let detail = match (tracker.phase, &tracker.latest) {
                (HoldPhase::Held, _) => {
                    let (metres, radians) = slip.unwrap_or_default();
                    format!("{object} moved {:.0} mm and {:.1} deg in the hand", 1000.0 * metres, radians.to_degrees())
                }
                (_, Some(hold)) => format!("{object} left the hand at {:.2} s", hold.until_secs),
                (_, None) => format!("{object} was never lifted by the hand"),
            };
            let (metres, degrees) = (slip.map(|s| s.0), slip.map(|s| s.1.to_degrees()));
            push("still_held.within_m", metres, *within_m, metres.is_some_and(|v| v <= *within_m), detail.clone());
            push("still_held.within_deg", degrees, *within_deg, degrees.is_some_and(|v| v <= *within_deg), detail);
        }
        Predicate::Lifted { object, at_least_m } => {
            let value = judge.trackers[object_idx(bodies, object)?].max_rise_m;
            let detail = format!("the hand raised {object} by {value:.3} m");
            push("lifted", Some(value), *at_least_m, value >= *at_least_m, detail);
        }
        Predicate::HeldSecs { object, at_least_secs } => {
            let value = judge.trackers[object_idx(bodies, object)?].longest_secs;
            let detail = format!("the hand carried {object} for {value:.2} s");
            push("held_secs", Some(value), *at_least_secs, value >= *at_least_secs, detail);
        }
    }
    Ok(())
}

/// The report on one grasp.
pub(crate) fn report(
    judge: &Judge,
    bodies: &Bodies,
    asked: &GraspAsked,
    state_hash: u64,
    physics_tampered: Option<Tampering>,
) -> Result<JudgeReport, WorldError> {
    let idx = object_idx(bodies, &asked.object)?;
    let (tracker, record) = (&judge.trackers[idx], judge.records[idx].clone());
    let lifted = tracker.max_rise_m >= LIFTED_M;
    let held = tracker.longest_secs >= HELD_SECS;
    let part_share = record.as_ref().map(|record| record.share_on(&asked.part));
    let recognised_type = record.as_ref().and_then(|record| record.grasp_type);
    let type_right = recognised_type == Some(asked.grasp_type);
    let slip = tracker.latest.as_ref().map(super::Hold::slip);
    Ok(JudgeReport {
        object: asked.object.clone(),
        lifted_m: tracker.max_rise_m,
        lifted,
        held_secs: tracker.longest_secs,
        held,
        held_now: tracker.is_held(),
        part_share,
        recognised_type,
        type_right,
        slip_m: slip.map(|s| s.0),
        slip_deg: slip.map(|s| s.1.to_degrees()),
        penetration_m: record.as_ref().map(|record| record.penetration_m),
        grasp: record,
        functional_success: lifted
            && held
            && type_right
            && part_share.is_some_and(|share| share >= PART_SHARE)
            && physics_tampered.is_none(),
        physics_tampered,
        state_hash: format!("{state_hash:016x}"),
    })
}

pub(crate) fn is_inside(bodies: &Bodies, grain_idx: usize, vessel_idx: usize) -> bool {
    let vessel = &bodies.objects[vessel_idx];
    let Some(interior) = &vessel.instance.interior else { return false };
    interior.contains(&(bodies.pose(vessel.body).inverse() * bodies.centre(bodies.grains[grain_idx].body)))
}

fn is_at_rest(bodies: &Bodies, grain_idx: usize, vessel_idx: usize) -> bool {
    let grain = bodies.grains[grain_idx].body;
    let centre = bodies.centre(grain);
    let relative = bodies.velocity_at(grain, &centre) - bodies.velocity_at(bodies.objects[vessel_idx].body, &centre);
    relative.norm() < AT_REST_MPS
}

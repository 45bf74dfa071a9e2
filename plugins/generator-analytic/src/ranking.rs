//! What makes one closed hand better than another, and which candidates are too much alike.

use crate::closing::{Closed, LinkContact};
use crate::hand::Hand;
use sfg_types::{GraspType, HandSide, Opposition, Point, Pose, ScoreTerm, Vector};
use std::collections::BTreeMap;

/// Margin that counts as half held, weights of the assumed mass.
const HALF_HELD_WEIGHTS: f64 = 2.0;
/// How much of the stability of a wrap rests on the wrench margin. Quasi-static closing finds fewer contacts than the hand makes in the
/// end: in simulated lifts of development bottles a quarter of the wraps without a margin held, and a third of those with one.
const WRAP_HOLD_SHARE: f64 = 0.4;
/// How much of the stability of the others rests on the fit to the request: pads and balls are held by what the margin tells.
const FIT_SHARE: f64 = 0.7;
/// Contacts of a wrap that oppose each other less than this hold nothing.
const MIN_OPPOSITION: f64 = 0.3;
/// Lean of the thing's axis towards the finger tips from which thumb and fingers are in balance, and the one at which they surely turn what
/// they lift, radians. The thumb stands beside the index finger, so its push and the fingers' are no pair unless the thing leans;
/// the tendon shares its tension among the fingers whatever they meet, so that none of them takes up the couple.
const BALANCED_AT_RAD: f64 = 0.3;
const TURNS_AT_RAD: f64 = -0.4;
/// Distance from the key point at which proximity falls to 1/e, metres: half a palm.
const PROXIMITY_M: f64 = 0.04;
/// Gap to the table beyond which more is no better, metres.
const AMPLE_CLEARANCE_M: f64 = 0.03;
/// Candidates nearer than this in both respects are one grasp, metres and radians.
const ALIKE: (f64, f64) = (0.025, 0.35);
/// Most candidates of one approach sector in the first pass: the arm may reach only some sectors.
const PER_SECTOR: usize = 2;
/// Ratio between two levels of stability.
const LEVEL: f64 = 1.2;
/// Step of the ease of the wrist.
const EASE_STEP: f64 = 0.02;
/// Number of sectors of the approach azimuth.
const N_SECTORS: f64 = 12.0;

/// A closed hand with everything its score is made of.
#[derive(Clone, Debug, PartialEq)]
pub struct Scored {
    /// Palm pose.
    pub base_from_palm: Pose,
    /// Number of the way of grasping.
    pub style: usize,
    /// Those of one group are one grasp from places that look alike.
    pub group: Option<usize>,
    /// Contacts of the closed hand.
    pub contacts: Vec<LinkContact>,
    /// Wrench margin, weights of the assumed mass.
    pub margin_weights: f64,
    /// Fingers and thumb go around a standing or lying thing.
    pub is_wrap: bool,
    /// Terms in [0, 1] apart from the margin.
    pub terms: Terms,
}

/// Parts of the score, each in [0, 1].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Terms {
    /// Share of the fingers that touch.
    pub fingers: f64,
    /// How well the surfaces that the type names press against each other.
    pub opposition: f64,
    /// Nearness of the held place to the key point.
    pub proximity: f64,
    /// Fit of the thickness to the type.
    pub type_fit: f64,
    /// The forearm points back and up to the shoulder.
    pub wrist_ease: f64,
    /// Gap of the closed hand to the table.
    pub table_clearance: f64,
    /// How surely a push of the closing fingers shifts the thing rather than tipping it over.
    pub steadiness: f64,
    /// How little the thumb's push and the fingers' turn the thing about the palm's normal.
    pub balance: f64,
}

/// What the terms are measured against.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wanted<'a> {
    /// The hand.
    pub hand: &'a Hand,
    /// The type.
    pub grasp_type: GraspType,
    /// Where to hold, base frame.
    pub key_point: Point,
    /// Height of the table, metres.
    pub table_height_m: f64,
    /// Friction coefficient between the thing and the table.
    pub friction: f64,
    /// Direction of what the hand goes around.
    pub axis: Option<Vector>,
}

impl Scored {
    /// Share of the margin that counts, in [0, 1).
    #[must_use]
    pub fn hold(&self) -> f64 {
        self.margin_weights / (self.margin_weights + HALF_HELD_WEIGHTS)
    }

    /// Predicted stability in steps of a fifth: what differs by less is equally good, as far as two noisy views can tell.
    #[must_use]
    pub fn stability(&self) -> f64 {
        stability_level(self.exact_stability())
    }

    /// The prediction, in [0, 1]: the fit to hand, thing and request, less what the margin leaves open.
    /// That of a wrap also falls with its steadiness, since what tips over is not held.
    fn exact_stability(&self) -> f64 {
        let t = &self.terms;
        let fit = 0.3 * t.fingers + 0.3 * t.opposition + 0.3 * t.proximity + 0.05 * t.type_fit + 0.05 * t.table_clearance;
        if self.is_wrap {
            fit * t.steadiness * t.balance * (1.0 - WRAP_HOLD_SHARE + WRAP_HOLD_SHARE * self.hold())
        } else {
            self.hold() * (1.0 - FIT_SHARE + FIT_SHARE * fit)
        }
    }

    /// Whether the contacts can hold anything: a wrap's must oppose each other, those of others have a wrench margin.
    #[must_use]
    pub fn may_hold(&self) -> bool {
        if self.is_wrap { self.terms.opposition > MIN_OPPOSITION } else { self.margin_weights > 0.0 }
    }

    /// The terms for the report.
    #[must_use]
    pub fn report(&self) -> Vec<ScoreTerm> {
        let t = &self.terms;
        let term = |name: &str, value: f64| ScoreTerm { name: name.to_owned(), value };
        vec![
            term("hold", self.hold()),
            term("wrench_margin_weights", self.margin_weights),
            term("fingers", t.fingers),
            term("opposition", t.opposition),
            term("proximity", t.proximity),
            term("type_fit", t.type_fit),
            term("wrist_ease", t.wrist_ease),
            term("table_clearance", t.table_clearance),
            term("steadiness", t.steadiness),
            term("balance", t.balance),
        ]
    }
}

/// Members of each group, as indices into `scored`.
#[must_use]
pub fn groups(scored: &[Scored]) -> Vec<Vec<usize>> {
    let mut members: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for (idx, one) in scored.iter().enumerate() {
        if let Some(group) = one.group {
            members.entry(group).or_default().push(idx);
        }
    }
    members.into_values().collect()
}

/// Gives all of one group the mean of what is felt there. The same grasp from the other side of a round thing holds it as well, and what
/// single closings differ by is the noise of the surface.
pub fn share_in_groups(scored: &mut [Scored]) {
    for indices in groups(scored) {
        let mean = |of: &dyn Fn(&Scored) -> f64| indices.iter().map(|i| of(&scored[*i])).sum::<f64>() / indices.len() as f64;
        let margin_weights = mean(&|s| s.margin_weights);
        let shared = Terms {
            fingers: mean(&|s| s.terms.fingers),
            opposition: mean(&|s| s.terms.opposition),
            proximity: mean(&|s| s.terms.proximity),
            type_fit: mean(&|s| s.terms.type_fit),
            table_clearance: mean(&|s| s.terms.table_clearance),
            steadiness: mean(&|s| s.terms.steadiness),
            balance: mean(&|s| s.terms.balance),
            wrist_ease: 0.0,
        };
        for idx in indices {
            scored[idx].margin_weights = margin_weights;
            scored[idx].terms = Terms { wrist_ease: scored[idx].terms.wrist_ease, ..shared };
        }
    }
}

fn stability_level(stability: f64) -> f64 {
    let step = LEVEL.ln();
    if stability > 0.0 { ((stability.ln() / step).round() * step).exp() } else { 0.0 }
}

/// The most stable first, of equally stable ones the easiest for the wrist, of equally easy ones the first that was proposed. So the choice
/// follows a thing that was moved instead of jumping to another side of it.
pub fn sort_best_first(scored: &mut [Scored]) {
    let ease = |s: &Scored| (s.terms.wrist_ease / EASE_STEP).round();
    scored.sort_by(|a, b| b.stability().total_cmp(&a.stability()).then(ease(b).total_cmp(&ease(a))));
}

/// Terms of a closed hand; `radius_m` is the thickness of what it holds.
#[must_use]
pub fn terms(closed: &Closed, base_from_palm: &Pose, facing: &Point, radius_m: f64, wanted: &Wanted<'_>) -> Terms {
    let n_fingers = wanted.hand.fingers.len();
    let touching = (0..n_fingers).filter(|&i| closed.contacts.iter().any(|c| c.finger_idx == Some(i))).count();
    let needed = match wanted.grasp_type {
        GraspType::PalmarPinch | GraspType::Lateral => 2,
        GraspType::Tripod => 3,
        _ => n_fingers,
    };
    let held = centre_of(closed, |_| true).unwrap_or(*facing);
    // An opposed thumb closes first, with nothing behind the thing yet.
    let is_thumb = |c: &LinkContact| c.finger_idx.is_some_and(|i| wanted.hand.fingers[i].is_thumb);
    let pushed = centre_of(closed, is_thumb).filter(|_| thumb_is_opposed(wanted.grasp_type)).unwrap_or(held);
    let lean_rad = match wanted.axis {
        Some(axis) if thumb_is_opposed(wanted.grasp_type) => lean_rad(base_from_palm, &axis, wanted.hand.side),
        _ => BALANCED_AT_RAD,
    };
    // The shoulder is behind, above and on the hand's own side; base frame only, so that a moved object changes nothing.
    let aside = match wanted.hand.side {
        HandSide::Left => 0.4,
        HandSide::Right => -0.4,
    };
    let to_shoulder = Vector::new(-1.0, aside, 0.6).normalize();
    let forearm = base_from_palm * -Vector::x();
    Terms {
        fingers: (touching as f64 / needed as f64).min(1.0),
        opposition: opposition(&closed.contacts, wanted),
        proximity: (-(held - wanted.key_point).norm() / PROXIMITY_M).exp(),
        type_fit: type_fit(wanted.grasp_type, radius_m),
        wrist_ease: 0.5 + 0.5 * forearm.dot(&to_shoulder),
        table_clearance: (closed.table_clearance_m / AMPLE_CLEARANCE_M).clamp(0.0, 1.0),
        // A level push at height h tips a thing of half width b over its edge when friction > b / h, else it slides.
        steadiness: (radius_m / (wanted.friction * (pushed.z - wanted.table_height_m).max(1e-3))).min(1.0),
        balance: ((lean_rad - TURNS_AT_RAD) / (BALANCED_AT_RAD - TURNS_AT_RAD)).clamp(0.0, 1.0),
    }
}

/// Angle in the palm's plane from the direction of the thumb to the thing's axis, positive when the axis leans towards the finger tips.
fn lean_rad(base_from_palm: &Pose, axis: &Vector, side: HandSide) -> f64 {
    let in_palm = base_from_palm.inverse() * axis;
    let to_thumb = match side {
        HandSide::Left => in_palm.y,
        HandSide::Right => -in_palm.y,
    };
    (in_palm.x * to_thumb.signum()).atan2(to_thumb.abs())
}

/// Mean of the contact points of which `counts`.
fn centre_of(closed: &Closed, counts: impl Fn(&LinkContact) -> bool) -> Option<Point> {
    let points: Vec<Vector> = closed.contacts.iter().filter(|c| counts(c)).map(|c| c.contact.point_in_base.coords).collect();
    (!points.is_empty()).then(|| Point::from(points.iter().sum::<Vector>() / points.len() as f64))
}

/// Largest opposition of normals between the two sides that the type names, 0 when one of them does not touch.
fn opposition(contacts: &[LinkContact], wanted: &Wanted<'_>) -> f64 {
    let is_thumb = |c: &&LinkContact| c.finger_idx.is_some_and(|i| wanted.hand.fingers[i].is_thumb);
    let is_finger = |c: &&LinkContact| c.finger_idx.is_some_and(|i| !wanted.hand.fingers[i].is_thumb);
    let is_palm = |c: &&LinkContact| c.finger_idx.is_none();
    let between = |a: &dyn Fn(&&LinkContact) -> bool, b: &dyn Fn(&&LinkContact) -> bool| {
        let mut best = 0.0_f64;
        for first in contacts.iter().filter(|c| a(c)) {
            for second in contacts.iter().filter(|c| b(c)) {
                best = best.max(-first.contact.inward_normal.dot(&second.contact.inward_normal));
            }
        }
        best
    };
    match wanted.grasp_type.opposition() {
        // A wrap needs its thumb too: without it the fingers push the thing along the palm.
        Opposition::Palm if thumb_is_opposed(wanted.grasp_type) => {
            0.4 * between(&is_palm, &is_finger) + 0.6 * between(&is_thumb, &is_finger)
        }
        Opposition::Palm => between(&is_palm, &is_finger).max(between(&is_thumb, &is_finger)),
        Opposition::Pad | Opposition::Side => between(&is_thumb, &is_finger),
    }
}

/// Wraps whose thumb closes against the fingers (abducted in the taxonomy).
#[must_use]
pub fn thumb_is_opposed(grasp_type: GraspType) -> bool {
    matches!(grasp_type, GraspType::LargeDiameter | GraspType::MediumWrap | GraspType::SmallDiameter | GraspType::PowerSphere)
}

/// 1 inside the radii that a type suits, falling to 0 over a further centimetre.
fn type_fit(grasp_type: GraspType, radius_m: f64) -> f64 {
    let (low_m, high_m) = match grasp_type {
        GraspType::LargeDiameter => (0.025, 0.050),
        GraspType::MediumWrap => (0.014, 0.032),
        GraspType::SmallDiameter => (0.004, 0.018),
        GraspType::AdductedThumb => (0.006, 0.022),
        GraspType::FixedHook | GraspType::IndexFingerExtension => (0.004, 0.020),
        GraspType::PowerSphere => (0.022, 0.050),
        GraspType::PrecisionDisk => (0.020, 0.055),
        GraspType::PrismaticFourFinger => (0.008, 0.040),
        GraspType::Tripod => (0.002, 0.020),
        GraspType::PalmarPinch => (0.001, 0.015),
        GraspType::Lateral => (0.001, 0.012),
    };
    let outside_m = (low_m - radius_m).max(radius_m - high_m).max(0.0);
    (1.0 - outside_m / 0.01).max(0.0)
}

/// Indices of at most `n` of `sorted` (best first): first the best of each approach sector, then what is left.
#[must_use]
pub fn diverse(sorted: &[Scored], n: usize) -> Vec<usize> {
    let mut chosen: Vec<usize> = Vec::new();
    let mut in_sector = [0_usize; N_SECTORS as usize];
    for limit in [PER_SECTOR, usize::MAX] {
        for (idx, candidate) in sorted.iter().enumerate() {
            if chosen.len() >= n {
                break;
            }
            if chosen.iter().any(|&other| is_alike(&sorted[other].base_from_palm, &candidate.base_from_palm)) {
                continue;
            }
            let sector = sector(&candidate.base_from_palm);
            if in_sector[sector] >= limit {
                continue;
            }
            in_sector[sector] += 1;
            chosen.push(idx);
        }
    }
    chosen.sort_unstable();
    chosen
}

fn is_alike(a: &Pose, b: &Pose) -> bool {
    (a.translation.vector - b.translation.vector).norm() < ALIKE.0 && a.rotation.angle_to(&b.rotation) < ALIKE.1
}

/// Sector of the azimuth of the forearm, which is defined for approaches from the side and from above.
fn sector(base_from_palm: &Pose) -> usize {
    let forearm = base_from_palm * -Vector::x();
    let z = base_from_palm * Vector::z();
    let along = if forearm.xy().norm() > 0.5 { forearm } else { z };
    let turn = along.y.atan2(along.x) / std::f64::consts::TAU + 0.5;
    // Sector limits lie between the sampled azimuths, so that rounding cannot move a pose across.
    ((turn * N_SECTORS + 0.25).floor() as usize) % N_SECTORS as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scored(group: Option<usize>, opposition: f64, wrist_ease: f64) -> Scored {
        let terms = Terms {
            fingers: 1.0,
            opposition,
            proximity: 0.5,
            type_fit: 1.0,
            wrist_ease,
            table_clearance: 1.0,
            steadiness: 1.0,
            balance: 1.0,
        };
        let margin_weights = 2.0 * opposition;
        Scored { base_from_palm: Pose::identity(), style: 0, group, contacts: Vec::new(), margin_weights, is_wrap: true, terms }
    }

    #[test]
    fn a_group_shares_what_is_felt_but_not_the_wrist() {
        let mut all =
            vec![scored(Some(7), 0.4, 0.1), scored(None, 0.4, 0.5), scored(Some(7), 0.8, 0.9), scored(Some(8), 0.2, 0.5)];
        let (alone, other) = (all[1].clone(), all[3].clone());
        share_in_groups(&mut all);
        for one in [&all[0], &all[2]] {
            assert!((one.terms.opposition - 0.6).abs() < 1e-12 && (one.margin_weights - 1.2).abs() < 1e-12, "{one:?}");
        }
        assert_eq!((all[0].terms.wrist_ease, all[2].terms.wrist_ease), (0.1, 0.9));
        assert_eq!((&all[1], &all[3]), (&alone, &other));
        // Of a group the easiest for the wrist comes first, whatever its own closing felt.
        sort_best_first(&mut all);
        assert_eq!(all[0].terms.wrist_ease, 0.9);
    }
}

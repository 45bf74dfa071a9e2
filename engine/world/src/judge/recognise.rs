//! Which of the twelve grasp types does a hand show? One fixed rule over contacts and posture.
//!
//! The rule reads, in this order: which surfaces oppose each other (palm, pads, side of the index), how many fingers share,
//! and how wide and how round the grasped part is. It follows the branches of the GRASP taxonomy (Feix et al., IEEE THMS
//! 2016); thresholds are ours and hold for a hand of human size.

use nalgebra::{Matrix3, SymmetricEigen};
use serde::{Deserialize, Serialize};
use sfg_types::{GraspType, Point, Vector};

/// Which surface of the hand touches.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[expect(missing_docs, reason = "each variant is its own word")]
pub enum Finger {
    Palm,
    Thumb,
    Index,
    Middle,
    Ring,
    Little,
}

impl Finger {
    /// The four fingers without the thumb.
    pub const LONG: [Self; 4] = [Self::Index, Self::Middle, Self::Ring, Self::Little];

    /// The finger a link or joint name speaks of: `left_index_distal` is the index finger.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        [
            ("palm", Self::Palm),
            ("thumb", Self::Thumb),
            ("index", Self::Index),
            ("middle", Self::Middle),
            ("ring", Self::Ring),
            ("little", Self::Little),
            ("pinky", Self::Little),
        ]
        .into_iter()
        .find_map(|(word, finger)| name.contains(word).then_some(finger))
    }
}

/// One contact of the hand with the object.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TypedContact {
    /// Which finger, or the palm.
    pub finger: Finger,
    /// The link is the finger's last one.
    pub is_tip: bool,
    /// Contact point in the palm frame.
    pub point_in_palm: Point,
    /// Unit normal out of the object, palm frame.
    pub normal_in_palm: Vector,
    /// The same normal's share along the side of the finger, 0 (pad) to 1 (side).
    pub side_share: f64,
}

/// What the rule reads besides the contacts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Posture {
    /// Mean flexion of index, middle, ring and little finger, as shares of their range.
    pub flexion: [f64; 4],
    /// Thumb opposition as a share of its range: 0 beside the palm, 1 opposite the fingers.
    pub thumb_opposition: f64,
}

/// Index flexion below this share of the other fingers' mean: the index finger is stretched.
const STRETCHED_SHARE: f64 = 0.45;
/// Thumb opposition under which the thumb lies along the handle.
const ADDUCTED_OPPOSITION: f64 = 0.35;
/// Smallest eigenvalue of the normals' scatter above which the part is round in all directions.
const ROUND_SCATTER: f64 = 0.12;
/// Widths between small, medium and large wraps, metres (handles under 25 mm, bottles over 50 mm).
const SMALL_WIDTH_M: f64 = 0.025;
const LARGE_WIDTH_M: f64 = 0.050;
/// Normal share along the side of the index finger above which the thumb presses on its side.
const SIDE_SHARE: f64 = 0.7;

/// The grasp type shown; `None` when fewer than two surfaces of the hand touch.
#[must_use]
pub fn recognise_grasp_type(contacts: &[TypedContact], posture: &Posture) -> Option<GraspType> {
    let touches = |finger: Finger| contacts.iter().any(|contact| contact.finger == finger);
    let n_long = Finger::LONG.into_iter().filter(|&finger| touches(finger)).count();
    let thumb = touches(Finger::Thumb);
    if n_long + usize::from(thumb) + usize::from(touches(Finger::Palm)) < 2 {
        return None;
    }
    let enclosed = touches(Finger::Palm) || contacts.iter().any(|c| !c.is_tip && Finger::LONG.contains(&c.finger));
    if !thumb {
        return Some(GraspType::FixedHook);
    }
    if !enclosed {
        return Some(match n_long {
            0 | 1 if presses_on_the_side(contacts) => GraspType::Lateral,
            0 | 1 => GraspType::PalmarPinch,
            2 => GraspType::Tripod,
            _ if normal_scatter(contacts) > ROUND_SCATTER => GraspType::PrecisionDisk,
            _ => GraspType::PrismaticFourFinger,
        });
    }
    if n_long <= 1 && presses_on_the_side(contacts) {
        return Some(GraspType::Lateral);
    }
    let others = (posture.flexion[1] + posture.flexion[2] + posture.flexion[3]) / 3.0;
    if posture.flexion[0] < STRETCHED_SHARE * others {
        return Some(GraspType::IndexFingerExtension);
    }
    if posture.thumb_opposition < ADDUCTED_OPPOSITION {
        return Some(GraspType::AdductedThumb);
    }
    if normal_scatter(contacts) > ROUND_SCATTER {
        return Some(GraspType::PowerSphere);
    }
    Some(match grasped_width_m(contacts) {
        width if width < SMALL_WIDTH_M => GraspType::SmallDiameter,
        width if width < LARGE_WIDTH_M => GraspType::MediumWrap,
        _ => GraspType::LargeDiameter,
    })
}

fn presses_on_the_side(contacts: &[TypedContact]) -> bool {
    contacts.iter().any(|contact| contact.finger == Finger::Index && contact.side_share > SIDE_SHARE)
}

/// Smallest eigenvalue of the mean outer product of the normals: 0 when they lie in a plane (a cylinder), 1/3 on a ball.
fn normal_scatter(contacts: &[TypedContact]) -> f64 {
    if contacts.is_empty() {
        return 0.0;
    }
    let scatter: Matrix3<f64> = contacts.iter().map(|c| c.normal_in_palm * c.normal_in_palm.transpose()).sum();
    SymmetricEigen::new(scatter / contacts.len() as f64).eigenvalues.min()
}

/// Largest distance between two contacts along the normal of one of them, metres: the diameter of a round part.
fn grasped_width_m(contacts: &[TypedContact]) -> f64 {
    let pairs = contacts.iter().flat_map(|a| contacts.iter().map(move |b| (a, b)));
    pairs.map(|(a, b)| (a.point_in_palm - b.point_in_palm).dot(&a.normal_in_palm)).fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;

    const WRAPPED: Posture = Posture { flexion: [0.6; 4], thumb_opposition: 0.8 };

    /// Contacts `finger@angle` on a cylinder about the palm's Y axis (or a ball with `polar`), `tip` marked by `'`.
    fn contacts(text: &str, radius_m: f64) -> Vec<TypedContact> {
        let one = |word: &str| {
            let (name, rest) = word.split_once('@').unwrap_or((word, "0"));
            let (azimuth, polar) =
                rest.trim_end_matches(['\'', '|']).split_once('/').unwrap_or((rest.trim_end_matches(['\'', '|']), "0"));
            let azimuth = azimuth.parse::<f64>().unwrap_or(0.0).to_radians();
            let polar = polar.parse::<f64>().unwrap_or(0.0).to_radians();
            let normal = Vector::new(azimuth.sin() * polar.cos(), polar.sin(), azimuth.cos() * polar.cos());
            TypedContact {
                finger: Finger::from_name(name).unwrap_or(Finger::Palm),
                is_tip: word.contains('\''),
                point_in_palm: Point::from(normal * radius_m),
                normal_in_palm: normal,
                side_share: if word.contains('|') { 1.0 } else { 0.0 },
            }
        };
        text.split_whitespace().map(one).collect()
    }

    #[track_caller]
    fn check(text: &str, radius_m: f64, posture: Posture, expected: Option<GraspType>) {
        assert_eq!(recognise_grasp_type(&contacts(text, radius_m), &posture), expected);
    }

    #[test]
    fn each_branch_of_the_rule() {
        let wrap = "palm@180 thumb@-60 index@60 middle@60 ring@60 little@0";
        let pads = "thumb@180' index@0' middle@0' ring@0' little@0'";
        let stretched = Posture { flexion: [0.1, 0.6, 0.6, 0.6], ..WRAPPED };
        check("", 0.03, WRAPPED, None);
        check("index@0", 0.03, WRAPPED, None);
        check(wrap, 0.035, WRAPPED, Some(GraspType::LargeDiameter));
        check(wrap, 0.020, WRAPPED, Some(GraspType::MediumWrap));
        check(wrap, 0.010, WRAPPED, Some(GraspType::SmallDiameter));
        check(wrap, 0.020, Posture { thumb_opposition: 0.1, ..WRAPPED }, Some(GraspType::AdductedThumb));
        check(wrap, 0.020, stretched, Some(GraspType::IndexFingerExtension));
        check("palm@180 index@60 middle@60", 0.01, WRAPPED, Some(GraspType::FixedHook));
        check(
            "palm@180 thumb@-80/-30 index@80/30 middle@0/60 ring@90/-10 little@0/-60",
            0.035,
            WRAPPED,
            Some(GraspType::PowerSphere),
        );
        check(pads, 0.02, WRAPPED, Some(GraspType::PrismaticFourFinger));
        check("thumb@180' index@0/50' ring@90' little@0/-50'", 0.03, WRAPPED, Some(GraspType::PrecisionDisk));
        check("thumb@180' index@10' middle@-10'", 0.02, WRAPPED, Some(GraspType::Tripod));
        check("thumb@180' index@0'", 0.01, WRAPPED, Some(GraspType::PalmarPinch));
        check("thumb@180' index@0|", 0.01, WRAPPED, Some(GraspType::Lateral));
    }

    #[test]
    fn names_of_links_tell_the_finger() {
        assert_eq!(Finger::from_name("left_little_distal"), Some(Finger::Little));
        assert_eq!(Finger::from_name("left_arm_link7"), None);
    }
}

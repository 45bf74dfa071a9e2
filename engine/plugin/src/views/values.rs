//! Poses, candidates and numbered words, checked on the way in.

use super::ViewError;
use nalgebra::{Quaternion, Translation3, UnitQuaternion};
use sfg_plugin_abi as abi;
use sfg_types::{GraspType, HandSide, PalmPoseCandidate, Pose, ScoreTerm, SynergyCoordinates};

/// How far the norm of a quaternion from the other side may be from 1. Farther is a mistake, not rounding.
pub const UNIT_TOLERANCE: f64 = 1e-6;

/// `candidate` as it crosses the boundary.
///
/// # Errors
/// [`ViewError::TermDoesNotFit`] when it has too many terms or a name is too long.
pub fn palm_pose_view(candidate: &PalmPoseCandidate) -> Result<abi::PalmPose, ViewError> {
    let mut view = abi::PalmPose {
        base_from_palm: pose_view(&candidate.base_from_palm),
        stability: candidate.stability,
        synergy: [candidate.synergy.c1, candidate.synergy.c2],
        hand_side: hand_side_number(candidate.hand_side),
        n_terms: 0,
        ..abi::PalmPose::UNSET
    };
    for (i, term) in candidate.terms.iter().enumerate() {
        if i == abi::TERMS_CAPACITY || term.name.len() > abi::TERM_NAME_BYTES || term.name.contains('\0') {
            return Err(ViewError::TermDoesNotFit { name: term.name.clone() });
        }
        view.terms[i] = abi::ScoreTerm::new(&term.name, term.value);
        view.n_terms += 1;
    }
    Ok(view)
}

/// The candidate in `view`, with every value checked.
///
/// # Errors
/// [`ViewError`] when a number is not finite or outside its range, the quaternion is not of unit length (within
/// [`UNIT_TOLERANCE`]), or an integer is unknown.
pub fn candidate(view: &abi::PalmPose) -> Result<PalmPoseCandidate, ViewError> {
    let n_terms = view.n_terms as usize;
    if n_terms > abi::TERMS_CAPACITY {
        return Err(ViewError::UnknownValue { what: "number of score terms", value: view.n_terms });
    }
    let term = |term: &abi::ScoreTerm| {
        let length = term.name.iter().position(|&byte| byte == 0).unwrap_or(abi::TERM_NAME_BYTES);
        let name = std::str::from_utf8(&term.name[..length]).map_err(|_not_utf8| ViewError::NotText { what: "a score term" })?;
        if !term.value.is_finite() {
            return Err(ViewError::NotFinite { what: "a score term" });
        }
        Ok(ScoreTerm { name: name.to_owned(), value: term.value })
    };
    Ok(PalmPoseCandidate {
        base_from_palm: pose(&view.base_from_palm, "the palm pose")?,
        hand_side: hand_side(view.hand_side)?,
        stability: in_range(view.stability, "the stability", 0.0, 1.0)?,
        synergy: SynergyCoordinates::new(in_range(view.synergy[0], "c1", 0.0, 1.0)?, in_range(view.synergy[1], "c2", -1.0, 1.0)?),
        terms: view.terms[..n_terms].iter().map(term).collect::<Result<_, _>>()?,
    })
}

/// `pose` as it crosses the boundary.
#[must_use]
pub fn pose_view(pose: &Pose) -> abi::Pose {
    let q = pose.rotation;
    abi::Pose { translation_m: pose.translation.vector.into(), rotation_wxyz: [q.w, q.i, q.j, q.k] }
}

/// The pose in `view`; its bits are kept, nothing is normalised.
///
/// # Errors
/// [`ViewError::NotFinite`], or [`ViewError::NotUnit`] beyond [`UNIT_TOLERANCE`]. `what` names the pose in the message.
pub fn pose(view: &abi::Pose, what: &'static str) -> Result<Pose, ViewError> {
    let [w, i, j, k] = view.rotation_wxyz;
    if !view.translation_m.iter().chain(&view.rotation_wxyz).all(|value| value.is_finite()) {
        return Err(ViewError::NotFinite { what });
    }
    let q = Quaternion::new(w, i, j, k);
    if (q.norm() - 1.0).abs() > UNIT_TOLERANCE {
        return Err(ViewError::NotUnit { what, norm: q.norm() });
    }
    Ok(Pose::from_parts(Translation3::from(view.translation_m), UnitQuaternion::new_unchecked(q)))
}

/// The number of `side` on the boundary.
#[must_use]
pub fn hand_side_number(side: HandSide) -> u32 {
    match side {
        HandSide::Left => abi::hand_side::LEFT,
        HandSide::Right => abi::hand_side::RIGHT,
    }
}

/// The side with number `value`.
///
/// # Errors
/// [`ViewError::UnknownValue`].
pub fn hand_side(value: u32) -> Result<HandSide, ViewError> {
    match value {
        abi::hand_side::LEFT => Ok(HandSide::Left),
        abi::hand_side::RIGHT => Ok(HandSide::Right),
        _ => Err(ViewError::UnknownValue { what: "hand side", value }),
    }
}

/// The number of `kind` on the boundary, `t1..t12`. Written out, so that a reordered enum does not change the boundary.
#[must_use]
pub fn grasp_type_number(kind: GraspType) -> u32 {
    match kind {
        GraspType::LargeDiameter => abi::grasp_type::LARGE_DIAMETER,
        GraspType::MediumWrap => abi::grasp_type::MEDIUM_WRAP,
        GraspType::SmallDiameter => abi::grasp_type::SMALL_DIAMETER,
        GraspType::AdductedThumb => abi::grasp_type::ADDUCTED_THUMB,
        GraspType::FixedHook => abi::grasp_type::FIXED_HOOK,
        GraspType::IndexFingerExtension => abi::grasp_type::INDEX_FINGER_EXTENSION,
        GraspType::PowerSphere => abi::grasp_type::POWER_SPHERE,
        GraspType::PrecisionDisk => abi::grasp_type::PRECISION_DISK,
        GraspType::PrismaticFourFinger => abi::grasp_type::PRISMATIC_FOUR_FINGER,
        GraspType::Tripod => abi::grasp_type::TRIPOD,
        GraspType::PalmarPinch => abi::grasp_type::PALMAR_PINCH,
        GraspType::Lateral => abi::grasp_type::LATERAL,
    }
}

/// The grasp type with number `value`.
///
/// # Errors
/// [`ViewError::UnknownValue`].
pub fn grasp_type(value: u32) -> Result<GraspType, ViewError> {
    let known = GraspType::ALL.into_iter().find(|&kind| grasp_type_number(kind) == value);
    known.ok_or(ViewError::UnknownValue { what: "grasp type", value })
}

fn in_range(value: f64, what: &'static str, low: f64, high: f64) -> Result<f64, ViewError> {
    if !value.is_finite() {
        return Err(ViewError::NotFinite { what });
    }
    if !(low..=high).contains(&value) {
        return Err(ViewError::OutOfRange { what, value, low, high });
    }
    Ok(value)
}

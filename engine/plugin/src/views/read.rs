//! Views from the other side, copied.

#![expect(unsafe_code, reason = "pointers from the other side of the C boundary are read here")]

use super::{ViewError, grasp_type, hand_side, pose};
use crate::PoseRequest;
use sfg_plugin_abi as abi;
use sfg_types::tsdf::EDGE;
use sfg_types::{GraspType, GraspTypeProfile, HandJoint, HandProfile, HandSide, Point, SynergyCoordinates, TaskKeyPoint, Tsdf};
use std::slice;

/// A request copied from a view.
#[derive(Clone, Debug, PartialEq)]
pub struct OwnedPoseRequest {
    /// See [`PoseRequest::tsdf`].
    pub tsdf: Tsdf,
    /// See [`PoseRequest::affordance_region`].
    pub affordance_region: Vec<u8>,
    /// See [`PoseRequest::key_point`].
    pub key_point: TaskKeyPoint,
    /// See [`PoseRequest::hand`].
    pub hand: HandProfile,
    /// See [`PoseRequest::hand_side`].
    pub hand_side: HandSide,
    /// See [`PoseRequest::grasp_type`].
    pub grasp_type: GraspType,
    /// See [`PoseRequest::table_height_m`].
    pub table_height_m: f64,
}

impl OwnedPoseRequest {
    /// The request that `view` lends.
    ///
    /// # Errors
    /// [`ViewError`] when the view is of another version, has a null pointer, an unknown value or another grid size.
    ///
    /// # Safety
    /// 1. `view` is null or points to at least `struct_size` readable bytes.
    /// 2. Its pointers are null or readable for the shapes it states.
    pub unsafe fn read(view: *const abi::PoseRequest) -> Result<Self, ViewError> {
        // SAFETY: obligations 1 and 2 of this function, for each of the pointers.
        unsafe {
            let view = read_sized(view, "the request")?;
            let tsdf = read_sized(view.tsdf, "the TSDF")?;
            if tsdf.edge as usize != EDGE {
                return Err(ViewError::UnknownValue { what: "grid edge", value: tsdf.edge });
            }
            let n = EDGE * EDGE * EDGE;
            Ok(Self {
                tsdf: Tsdf {
                    distances: lent(tsdf.distances, n, "the distances")?.to_vec(),
                    weights: lent(tsdf.weights, n, "the weights")?.to_vec(),
                    base_from_grid: pose(&tsdf.base_from_grid, "the grid")?,
                },
                affordance_region: lent(view.affordance_region, n, "the affordance region")?.to_vec(),
                key_point: TaskKeyPoint {
                    point_in_base: Point::from(view.key_point_in_base),
                    part_points_in_base: lent(view.part_points_in_base, view.n_part_points, "the part points")?
                        .iter()
                        .map(|&point| Point::from(point))
                        .collect(),
                    n_pixels: view.n_pixels,
                },
                hand: hand_profile(view.hand)?,
                hand_side: hand_side(view.hand_side)?,
                grasp_type: grasp_type(view.grasp_type)?,
                table_height_m: view.table_height_m,
            })
        }
    }

    /// As the contract takes it.
    #[must_use]
    pub fn as_request(&self) -> PoseRequest<'_> {
        PoseRequest {
            tsdf: &self.tsdf,
            affordance_region: &self.affordance_region,
            key_point: &self.key_point,
            hand: &self.hand,
            hand_side: self.hand_side,
            grasp_type: self.grasp_type,
            table_height_m: self.table_height_m,
        }
    }
}

/// The hand that `view` lends.
///
/// # Errors
/// [`ViewError`] when the view is of another version, has a null pointer, a text that is not UTF-8 or an unknown grasp type.
///
/// # Safety
/// 1. `view` is null or points to at least `struct_size` readable bytes.
/// 2. Its pointers are null or readable for the shapes it states.
pub unsafe fn hand_profile(view: *const abi::HandProfile) -> Result<HandProfile, ViewError> {
    // SAFETY: obligations 1 and 2 of this function, for each of the pointers.
    unsafe {
        let view = read_sized(view, "the hand profile")?;
        let joint = |joint: &abi::HandJoint| {
            Ok(HandJoint {
                name: text(joint.name, "the name of a joint")?,
                lower_rad: joint.lower_rad,
                upper_rad: joint.upper_rad,
                stiffness_nm_per_rad: joint.stiffness_nm_per_rad,
                damping_nms_per_rad: joint.damping_nms_per_rad,
                closing_ratio: joint.closing_ratio,
                shifting_ratio: joint.shifting_ratio,
                max_torque_nm: joint.max_torque_nm,
            })
        };
        let grasp_type_profile = |profile: &abi::GraspTypeProfile| {
            let profile_here = GraspTypeProfile {
                c_tar: SynergyCoordinates::new(profile.c_tar[0], profile.c_tar[1]),
                standoff_min_m: profile.standoff_min_m,
                standoff_max_m: profile.standoff_max_m,
            };
            Ok((grasp_type(profile.grasp_type)?, profile_here))
        };
        Ok(HandProfile {
            name: text(view.name, "the name of the hand")?,
            urdf_left: text(view.urdf_left, "the left URDF")?,
            urdf_right: text(view.urdf_right, "the right URDF")?,
            palm_link: text(view.palm_link, "the palm link")?,
            joints: lent(view.joints, view.n_joints, "the joints")?.iter().map(joint).collect::<Result<_, ViewError>>()?,
            synergy_joints: lent(view.synergy_joints, view.n_synergy_joints, "the synergy joints")?
                .iter()
                .map(|&name| text(name, "the name of a synergy joint"))
                .collect::<Result<_, ViewError>>()?,
            synergy_matrix: lent(view.synergy_matrix, view.n_synergy_joints, "the synergy matrix")?.to_vec(),
            grasp_types: lent(view.grasp_types, view.n_grasp_types, "the grasp types")?
                .iter()
                .map(grasp_type_profile)
                .collect::<Result<_, ViewError>>()?,
            max_tension_nm: view.max_tension_nm,
            tendon_stiffness_nm_per_rad: view.tendon_stiffness_nm_per_rad,
            max_current_amps: view.max_current_amps,
            max_closing_speed_per_sec: view.max_closing_speed_per_sec,
        })
    }
}

/// An owned copy of `view`. `what` names it in the message.
///
/// # Errors
/// [`ViewError::NotText`].
///
/// # Safety
/// 1. `view.pointer` is null with length 0, or points to `view.length` readable bytes.
pub unsafe fn text(view: abi::Text, what: &'static str) -> Result<String, ViewError> {
    // SAFETY: obligation 1; the text is copied before return.
    unsafe { view.as_str() }.map(str::to_owned).ok_or(ViewError::NotText { what })
}

/// Structs that state their size first.
///
/// # Safety
/// 1. The type is `repr(C)` and begins with its `struct_size: u32`.
pub unsafe trait SizeFirst: Copy {}
// SAFETY: each is `repr(C)` and begins with `struct_size: u32`.
unsafe impl SizeFirst for abi::PoseRequest {}
// SAFETY: as above.
unsafe impl SizeFirst for abi::TsdfView {}
// SAFETY: as above.
unsafe impl SizeFirst for abi::HandProfile {}
// SAFETY: as above.
unsafe impl SizeFirst for abi::PoseGeneratorConfig {}
// SAFETY: as above.
unsafe impl SizeFirst for abi::PoseGeneratorTable {}

/// A copy of the struct behind `pointer`, after its size was checked: a shorter one is never read beyond its end.
///
/// # Errors
/// [`ViewError::Null`] or [`ViewError::TooShort`]. `what` names the struct in the message.
///
/// # Safety
/// 1. `pointer` is null or points to at least as many readable bytes as its `struct_size` states.
pub unsafe fn read_sized<T: SizeFirst>(pointer: *const T, what: &'static str) -> Result<T, ViewError> {
    if pointer.is_null() {
        return Err(ViewError::Null { what });
    }
    // SAFETY: obligation 1 of `SizeFirst`: the struct begins with its size.
    let size = unsafe { pointer.cast::<u32>().read() };
    let expected = abi::struct_size::<T>();
    if size < expected {
        return Err(ViewError::TooShort { what, size, expected });
    }
    // SAFETY: obligation 1, and `size` covers `T`.
    Ok(unsafe { pointer.read() })
}

/// `length` values at `pointer`, which may be null when there are none.
///
/// # Safety
/// 1. `pointer` is null or points to `length` readable values that stay unchanged for `'a`.
unsafe fn lent<'a, T>(pointer: *const T, length: usize, what: &'static str) -> Result<&'a [T], ViewError> {
    if length == 0 {
        return Ok(&[]);
    }
    if pointer.is_null() {
        return Err(ViewError::Null { what });
    }
    // SAFETY: obligation 1, and the pointer is not null.
    Ok(unsafe { slice::from_raw_parts(pointer, length) })
}

//! Why a planning request could not be worked on at all; "no path" is an outcome, not an error.

/// Errors of this crate.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PlanningError {
    /// A link has a mesh as collision shape.
    #[error(
        "link {link:?} has mesh {file:?} as collision shape; planning needs boxes, spheres, cylinders or capsules: \
             `sfg robot spheres` writes a URDF with balls that cover it"
    )]
    MeshShape {
        /// The link.
        link: String,
        /// The mesh.
        file: String,
    },
    /// A chain of more joints than the collision model is compiled for.
    #[error("the chain has {n_joints} joints, mimicking ones included; at most {most} can be planned for: freeze some of them")]
    TooManyJoints {
        /// Joints of the chain.
        n_joints: usize,
        /// Most joints.
        most: usize,
    },
    /// A path of fewer than two configurations, or of configurations of another length.
    #[error("a path needs at least two configurations of {n_joints} joints: {found}")]
    BadPath {
        /// Joints of the chain.
        n_joints: usize,
        /// What was given.
        found: String,
    },
    /// Rounding the corners of a free path led into an obstacle or out of the limits, even with the smallest radius.
    #[error("the corners of the path cannot be rounded: {reason}")]
    NoRoom {
        /// What is in the way.
        reason: String,
    },
    /// The speed profile could not be made.
    #[error("no speed profile over {length_rad:.4} rad: {message}")]
    Profile {
        /// Length of the path.
        length_rad: f64,
        /// Why.
        message: String,
    },
    /// Holding still somewhere on the path takes what a motor gives.
    #[error(
        "joint {joint:?} needs {torque_nm:.1} Nm to hold still at {along_rad:.2} rad of the path with a payload of \
         {payload_kg:.2} kg, and it may use {limit_nm:.1} Nm, of which at most 98 % for holding; \
         carry less, or choose a path nearer to the body"
    )]
    TooHeavy {
        /// The joint.
        joint: String,
        /// Torque against gravity, Nm; N at a sliding joint.
        torque_nm: f64,
        /// What the joint may use.
        limit_nm: f64,
        /// What the arm carries.
        payload_kg: f64,
        /// Where, arc length from the path's start.
        along_rad: f64,
    },
}

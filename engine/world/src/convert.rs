//! Conversions between nalgebra at the API boundary (f64) and glam inside rapier (f32).

use rapier3d::math as phys;
use sfg_types::{Point, Pose, Vector};

/// A pose for rapier.
pub(crate) fn to_physics(pose: &Pose) -> phys::Pose {
    let r = pose.rotation.quaternion();
    phys::Pose::from_parts(
        vector_to_physics(&pose.translation.vector),
        phys::Rotation::from_xyzw(r.i as f32, r.j as f32, r.k as f32, r.w as f32).normalize(),
    )
}

/// A pose from rapier.
pub(crate) fn from_physics(pose: &phys::Pose) -> Pose {
    let r = pose.rotation;
    Pose::from_parts(
        vector_from_physics(pose.translation).into(),
        nalgebra::UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(
            f64::from(r.w),
            f64::from(r.x),
            f64::from(r.y),
            f64::from(r.z),
        )),
    )
}

/// A vector for rapier.
pub(crate) fn vector_to_physics(v: &Vector) -> phys::Vector {
    phys::Vector::new(v.x as f32, v.y as f32, v.z as f32)
}

/// A vector from rapier.
pub(crate) fn vector_from_physics(v: phys::Vector) -> Vector {
    Vector::new(f64::from(v.x), f64::from(v.y), f64::from(v.z))
}

/// A point from rapier.
pub(crate) fn point_from_physics(v: phys::Vector) -> Point {
    Point::from(vector_from_physics(v))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pose_survives_the_round_trip() {
        let pose = Pose::new(Vector::new(0.1, -0.2, 0.3), Vector::new(0.4, -1.5, 0.6));
        let back = from_physics(&to_physics(&pose));
        assert!((back.translation.vector - pose.translation.vector).norm() < 1e-7);
        assert!(back.rotation.angle_to(&pose.rotation) < 1e-6);
    }
}

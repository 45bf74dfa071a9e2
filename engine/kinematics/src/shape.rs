//! Collision shapes of a link.

use nalgebra::{Translation3, Vector3};
use serde::{Deserialize, Serialize};
use sfg_types::{Pose, Vector};
use urdf_rs::Geometry;

/// A shape in its own frame; cylinders and capsules lie along Z. Metres.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Shape {
    /// A box.
    Cuboid {
        /// Half of each edge.
        half_extents_m: Vector,
    },
    /// A ball.
    Sphere {
        /// Radius.
        radius_m: f64,
    },
    /// A cylinder with flat ends.
    Cylinder {
        /// Radius.
        radius_m: f64,
        /// Half of its height.
        half_length_m: f64,
    },
    /// A cylinder with round ends.
    Capsule {
        /// Radius.
        radius_m: f64,
        /// Half of the distance between the centres of the round ends.
        half_length_m: f64,
    },
    /// A mesh file; kept by name, not loaded.
    Mesh {
        /// As written in the URDF.
        file: String,
        /// Factor of each axis of the file's coordinates to metres.
        scale: Vector,
    },
}

/// A shape fixed to a link.
#[derive(Clone, Debug, PartialEq)]
pub struct Primitive {
    /// What.
    pub shape: Shape,
    /// Where.
    pub link_from_shape: Pose,
}

/// Translates URDF collision elements; a cylinder with an equal sphere at each end becomes a capsule, since URDF 1.0 has none.
pub(crate) fn primitives(collisions: &[urdf_rs::Collision]) -> Vec<Primitive> {
    let mut all: Vec<Primitive> =
        collisions.iter().map(|c| Primitive { shape: shape(&c.geometry), link_from_shape: pose(&c.origin) }).collect();
    let mut idx = 0;
    while idx < all.len() {
        if let Shape::Cylinder { radius_m, half_length_m } = all[idx].shape {
            let axis = all[idx].link_from_shape.rotation * Vector3::z();
            let centre = all[idx].link_from_shape.translation.vector;
            let cap = |end: f64| {
                all.iter().position(|p| {
                    matches!(p.shape, Shape::Sphere { radius_m: r } if (r - radius_m).abs() < 1e-6)
                        && (p.link_from_shape.translation.vector - centre - axis * end).norm() < 1e-6
                })
            };
            if let (Some(a), Some(b)) = (cap(-half_length_m), cap(half_length_m)) {
                all[idx].shape = Shape::Capsule { radius_m, half_length_m };
                let mut nth = 0;
                all.retain(|_| {
                    nth += 1;
                    nth - 1 != a && nth - 1 != b
                });
                idx = 0;
                continue;
            }
        }
        idx += 1;
    }
    all
}

pub(crate) fn pose(origin: &urdf_rs::Pose) -> Pose {
    let [x, y, z] = *origin.xyz;
    let [roll, pitch, yaw] = *origin.rpy;
    Pose::from_parts(Translation3::new(x, y, z), nalgebra::UnitQuaternion::from_euler_angles(roll, pitch, yaw))
}

fn shape(geometry: &Geometry) -> Shape {
    match geometry {
        Geometry::Box { size } => Shape::Cuboid { half_extents_m: Vector::new(size[0], size[1], size[2]) / 2.0 },
        Geometry::Cylinder { radius, length } => Shape::Cylinder { radius_m: *radius, half_length_m: length / 2.0 },
        Geometry::Capsule { radius, length } => Shape::Capsule { radius_m: *radius, half_length_m: length / 2.0 },
        Geometry::Sphere { radius } => Shape::Sphere { radius_m: *radius },
        Geometry::Mesh { filename, scale } => {
            Shape::Mesh { file: filename.clone(), scale: scale.as_ref().map_or(Vector::repeat(1.0), |s| Vector::from(**s)) }
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "tests fail by panicking")]
    use super::*;

    fn collisions(xml: &str) -> Vec<Primitive> {
        let text = format!("<robot name='r'><link name='a'>{xml}</link></robot>");
        primitives(&urdf_rs::read_from_string(&text).unwrap().links[0].collision)
    }

    #[test]
    fn a_cylinder_between_two_equal_spheres_is_a_capsule() {
        let cylinder = "<collision><origin xyz='0 0 1' rpy='0 1.5707963267948966 0'/><geometry><cylinder radius='0.1' length='0.4'/></geometry></collision>";
        let ball =
            |x: f64, r: f64| format!("<collision><origin xyz='{x} 0 1'/><geometry><sphere radius='{r}'/></geometry></collision>");
        let capsule = Shape::Capsule { radius_m: 0.1, half_length_m: 0.2 };
        let merged = collisions(&format!("{}{cylinder}{}", ball(0.2, 0.1), ball(-0.2, 0.1)));
        assert_eq!(merged.iter().map(|p| &p.shape).collect::<Vec<_>>(), [&capsule]);
        assert_eq!(collisions(&format!("{cylinder}{}{}", ball(0.2, 0.1), ball(-0.2, 0.11))).len(), 3);
        assert_eq!(collisions(&format!("{cylinder}{}", ball(0.2, 0.1))).len(), 2);
    }
}

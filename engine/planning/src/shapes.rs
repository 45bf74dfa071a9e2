//! Distances of points to shapes, and balls that cover a shape.

use nalgebra::Point3;
use sfg_kinematics::{Primitive, Shape};
use sfg_types::{Point, Pose, Vector};

/// Something in the robot's world.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Obstacle {
    /// Name for reports and for [`crate::CollisionModel::allow`], for example `table`.
    pub name: String,
    /// What; no mesh.
    pub shape: Shape,
    /// Where; cylinders and capsules lie along its Z.
    pub pose_in_base: Pose,
}

/// Distance of `p` (in the shape's frame) to the surface, negative inside, metres; infinite for a mesh.
#[must_use]
pub fn signed_distance_m(shape: &Shape, p: &Point) -> f64 {
    match shape {
        Shape::Cuboid { half_extents_m } => {
            let q = p.coords.abs() - half_extents_m;
            q.sup(&Vector::zeros()).norm() + q.max().min(0.0)
        }
        Shape::Sphere { radius_m } => p.coords.norm() - radius_m,
        Shape::Cylinder { radius_m, half_length_m } => {
            let (across, along) = (p.coords.xy().norm() - radius_m, p.z.abs() - half_length_m);
            across.max(0.0).hypot(along.max(0.0)) + across.max(along).min(0.0)
        }
        Shape::Capsule { radius_m, half_length_m } => {
            let z = p.z - p.z.clamp(-half_length_m, *half_length_m);
            p.x.hypot(p.y).hypot(z) - radius_m
        }
        Shape::Mesh { .. } => f64::INFINITY,
    }
}

/// Radius of the ball about the shape's origin that holds it.
#[must_use]
pub fn bounding_radius_m(shape: &Shape) -> f64 {
    match shape {
        Shape::Cuboid { half_extents_m } => half_extents_m.norm(),
        Shape::Sphere { radius_m } => *radius_m,
        Shape::Cylinder { radius_m, half_length_m } => radius_m.hypot(*half_length_m),
        Shape::Capsule { radius_m, half_length_m } => radius_m + half_length_m,
        Shape::Mesh { .. } => 0.0,
    }
}

/// Balls in the link frame that cover a primitive and stand out of it by at most about `excess_m`.
///
/// Rows of balls along capsules and cylinders (the flat ends of a cylinder are exceeded by up to `excess_m` more), a grid in boxes.
#[must_use]
pub fn covering_spheres(primitive: &Primitive, excess_m: f64) -> Vec<(Point, f64)> {
    let place = |x, y, z| primitive.link_from_shape * Point3::new(x, y, z);
    let row = |radius_m: f64, half: f64| -> Vec<(Point, f64)> {
        // A row of balls of radius r + e, spaced d apart, covers radius r when (r + e)^2 = r^2 + (d / 2)^2.
        let spacing = 2.0 * (2.0 * radius_m * excess_m + excess_m * excess_m).sqrt();
        let n_gaps = (2.0 * half / spacing).ceil().max(0.0) as usize;
        if n_gaps == 0 {
            return vec![(place(0.0, 0.0, 0.0), radius_m)];
        }
        let step = 2.0 * half / n_gaps as f64;
        let radius = radius_m.hypot(step / 2.0);
        (0..=n_gaps).map(|i| (place(0.0, 0.0, step * i as f64 - half), radius)).collect()
    };
    match &primitive.shape {
        Shape::Sphere { radius_m } => row(*radius_m, 0.0),
        Shape::Capsule { radius_m, half_length_m } => row(*radius_m, *half_length_m),
        Shape::Cylinder { radius_m, half_length_m } => {
            // Slices: each ball covers the slice of the cylinder about its centre.
            let slice = 2.0 * (2.0 * radius_m * excess_m + excess_m * excess_m).sqrt();
            let n = (2.0 * half_length_m / slice).ceil().max(1.0);
            let height = 2.0 * half_length_m / n;
            let radius = radius_m.hypot(height / 2.0);
            (0..n as usize).map(|i| (place(0.0, 0.0, height * (i as f64 + 0.5) - half_length_m), radius)).collect()
        }
        Shape::Cuboid { half_extents_m } => {
            // A cube of edge c is covered by a ball that stands out of its faces by (sqrt(3) - 1) / 2 c.
            let edge = excess_m / ((3.0_f64.sqrt() - 1.0) / 2.0);
            let n = half_extents_m.map(|h| (2.0 * h / edge).ceil().max(1.0));
            let cell = (half_extents_m * 2.0).component_div(&n);
            let at = |axis: usize, i: usize| cell[axis] * (i as f64 + 0.5) - half_extents_m[axis];
            let mut all = Vec::new();
            for x in 0..n.x as usize {
                for y in 0..n.y as usize {
                    for z in 0..n.z as usize {
                        all.push((place(at(0, x), at(1, y), at(2, z)), cell.norm() / 2.0));
                    }
                }
            }
            all
        }
        Shape::Mesh { .. } => Vec::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    fn shapes() -> Vec<Shape> {
        vec![
            Shape::Cuboid { half_extents_m: Vector::new(0.05, 0.03, 0.015) },
            Shape::Sphere { radius_m: 0.04 },
            Shape::Cylinder { radius_m: 0.035, half_length_m: 0.06 },
            Shape::Cylinder { radius_m: 0.035, half_length_m: 0.01 },
            Shape::Capsule { radius_m: 0.02, half_length_m: 0.1 },
        ]
    }

    #[test]
    fn distances_have_slope_one_and_vanish_on_the_surface() {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        for shape in shapes() {
            for _ in 0..1000 {
                let p = Point3::from(Vector::from_fn(|_, _| rng.random_range(-0.3..0.3)));
                let d = signed_distance_m(&shape, &p);
                let h = 1e-6;
                let slope = Vector::from_fn(|i, _| {
                    let mut moved = p;
                    moved[i] += h;
                    (signed_distance_m(&shape, &moved) - d) / h
                });
                if d > 1e-3 {
                    assert!((slope.norm() - 1.0).abs() < 1e-3, "{shape:?} {p}: {}", slope.norm());
                    let foot = p - slope * d;
                    assert!(signed_distance_m(&shape, &foot).abs() < 1e-4, "{shape:?} {p}");
                }
            }
        }
    }

    #[test]
    fn balls_cover_the_shape_and_stand_out_little() {
        let mut rng = ChaCha8Rng::seed_from_u64(2);
        let excess = 0.008;
        for shape in shapes() {
            let link_from_shape = Pose::new(Vector::new(0.1, 0.2, -0.3), Vector::new(0.3, 1.0, -0.4));
            let balls = covering_spheres(&Primitive { shape: shape.clone(), link_from_shape }, excess);
            for _ in 0..20_000 {
                let p = Point3::from(Vector::from_fn(|_, _| rng.random_range(-0.15..0.15)));
                let d = signed_distance_m(&shape, &p);
                let in_link = link_from_shape * p;
                let to_balls = balls.iter().map(|(c, r)| (in_link - c).norm() - r).fold(f64::INFINITY, f64::min);
                assert!(d > 0.0 || to_balls < 1e-9, "{shape:?}: {p} is not covered");
                let bound = if matches!(shape, Shape::Cylinder { half_length_m, radius_m } if half_length_m < radius_m) {
                    0.03
                } else {
                    0.02
                };
                assert!(d < bound || to_balls > 0.0, "{shape:?}: the balls stand out by {d} m at {p}");
            }
        }
    }
}

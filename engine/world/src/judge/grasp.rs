//! What a grasp looks like: contacts within 2 mm, the parts they are on, the type they show, penetration.

use super::RobotTruth;
use super::recognise::{Finger, TypedContact, recognise_grasp_type};
use crate::bodies::{Bodies, HandLink};
use crate::convert::{from_physics, point_from_physics, vector_from_physics};
use rapier3d::parry::query;
use rapier3d::parry::shape::{Shape, TypedShape};
use rapier3d::prelude::ColliderHandle;
use serde::Serialize;
use sfg_types::{GraspType, Point, Vector};
use std::collections::BTreeMap;

/// A hand link nearer than this touches, metres (the rule of DexGraspBench).
pub const CONTACT_WITHIN_M: f64 = 0.002;

/// One link of the hand on the object.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct HandContact {
    /// Name of the link.
    pub link: String,
    /// Finger or palm.
    pub finger: Finger,
    /// Label of the object's part.
    pub part: String,
    /// Where, base frame, metres.
    pub point_in_base: Point,
    /// Gap, metres; negative when the shapes overlap.
    pub gap_m: f64,
}

/// A grasp at one moment.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct GraspRecord {
    /// When, seconds.
    pub stamp_secs: f64,
    /// The nearest contact of each collision shape of the hand that touches.
    pub contacts: Vec<HandContact>,
    /// Share of the contacts on each part, by label.
    pub part_shares: BTreeMap<String, f64>,
    /// The type shown; none when fewer than two surfaces of the hand touch.
    pub grasp_type: Option<GraspType>,
    /// Deepest point of the hand inside the object's exact signed distance field, metres; 0 when there is none.
    pub penetration_m: f64,
}

impl GraspRecord {
    /// Share of the contacts on the part `label`, 0 to 1.
    #[must_use]
    pub fn share_on(&self, label: &str) -> f64 {
        self.part_shares.get(label).copied().unwrap_or(0.0)
    }
}

/// The grasp on an object now.
pub(crate) fn record(bodies: &Bodies, object_idx: usize, robot: &RobotTruth, stamp_secs: f64) -> GraspRecord {
    let palm_from_base = robot.base_from_palm.inverse();
    let mut contacts = Vec::new();
    let mut typed = Vec::new();
    for link in &bodies.hand {
        for collider in &link.colliders {
            let Some(touch) = nearest_touch(bodies, object_idx, *collider) else { continue };
            let link_from_base = bodies.pose(link.body).inverse();
            typed.push(TypedContact {
                finger: link.finger,
                is_tip: link.is_tip,
                point_in_palm: palm_from_base * touch.point,
                normal_in_palm: palm_from_base * touch.normal,
                // Fingers lie along X and flex about Y: Y is the side.
                side_share: (link_from_base * touch.normal).y.abs(),
            });
            contacts.push(HandContact {
                link: link.name.clone(),
                finger: link.finger,
                part: touch.part,
                point_in_base: touch.point,
                gap_m: touch.gap_m,
            });
        }
    }
    let mut part_shares = BTreeMap::new();
    for contact in &contacts {
        *part_shares.entry(contact.part.clone()).or_insert(0.0) += 1.0 / contacts.len() as f64;
    }
    GraspRecord {
        stamp_secs,
        grasp_type: recognise_grasp_type(&typed, &robot.posture),
        penetration_m: penetration_m(bodies, object_idx),
        contacts,
        part_shares,
    }
}

struct Touch {
    point: Point,
    normal: Vector,
    part: String,
    gap_m: f64,
}

/// The nearest contact of one hand collider with any piece of the object that it can touch; the normal points out of the object.
fn nearest_touch(bodies: &Bodies, object_idx: usize, hand: ColliderHandle) -> Option<Touch> {
    let colliders = &bodies.physics.colliders;
    let hand = &colliders[hand];
    let mut best: Option<Touch> = None;
    for (piece, part) in bodies.objects[object_idx].tangible_pieces() {
        let piece = &colliders[*piece];
        let found = query::contact(piece.position(), piece.shape(), hand.position(), hand.shape(), CONTACT_WITHIN_M as f32);
        let Ok(Some(contact)) = found else { continue };
        let gap_m = f64::from(contact.dist);
        // parry answers some pairs beyond the distance asked for.
        if gap_m > CONTACT_WITHIN_M {
            continue;
        }
        if best.as_ref().is_none_or(|b| gap_m < b.gap_m) {
            best = Some(Touch {
                point: point_from_physics(contact.point1),
                normal: vector_from_physics(contact.normal1),
                part: part.clone(),
                gap_m,
            });
        }
    }
    best
}

/// Deepest sample of the hand's surface inside the object, metres.
fn penetration_m(bodies: &Bodies, object_idx: usize) -> f64 {
    let object = &bodies.objects[object_idx];
    let object_from_base = bodies.pose(object.body).inverse();
    let depth = |link: &HandLink| {
        link.colliders
            .iter()
            .flat_map(|collider| {
                let collider = &bodies.physics.colliders[*collider];
                let base_from_shape = from_physics(collider.position());
                surface_samples(collider.shape()).into_iter().map(move |p| base_from_shape * p)
            })
            .map(|p| -object.instance.signed_distance(&(object_from_base * p)))
            .fold(0.0, f64::max)
    };
    bodies.hand.iter().map(depth).fold(0.0, f64::max)
}

/// Points on the surface of a hand link's shape, about 3 mm apart on a finger.
fn surface_samples(shape: &dyn Shape) -> Vec<Point> {
    const N_AROUND: usize = 16;
    const N_ALONG: usize = 9;
    let mut points = Vec::new();
    let at = |v: rapier3d::math::Vector| point_from_physics(v);
    match shape.as_typed_shape() {
        TypedShape::Capsule(capsule) => {
            let (a, b, radius) = (at(capsule.segment.a), at(capsule.segment.b), f64::from(capsule.radius));
            let axis = (b - a).try_normalize(1e-9).unwrap_or_else(Vector::z);
            let u = axis.cross(&if axis.x.abs() < 0.9 { Vector::x() } else { Vector::y() }).normalize();
            let w = axis.cross(&u);
            // Along the axis, then over the round ends.
            let rings = (0..N_ALONG).map(|i| (a + (b - a) * (i as f64 / (N_ALONG - 1) as f64), 0.0_f64)).chain([
                (a, -0.6),
                (a, -1.1),
                (a, -1.5),
                (b, 0.6),
                (b, 1.1),
                (b, 1.5),
            ]);
            for (centre, latitude) in rings {
                for j in 0..N_AROUND {
                    let angle = j as f64 / N_AROUND as f64 * std::f64::consts::TAU;
                    let outward = (u * angle.cos() + w * angle.sin()) * latitude.cos() + axis * latitude.sin();
                    points.push(centre + outward * radius);
                }
            }
        }
        TypedShape::Cuboid(cuboid) => {
            let half = vector_from_physics(cuboid.half_extents);
            let steps = || (0..N_ALONG).map(|i| 2.0 * i as f64 / (N_ALONG - 1) as f64 - 1.0);
            for s in steps() {
                for t in steps() {
                    for face in [-1.0, 1.0] {
                        points.push(Point::new(face * half.x, s * half.y, t * half.z));
                        points.push(Point::new(s * half.x, face * half.y, t * half.z));
                        points.push(Point::new(s * half.x, t * half.y, face * half.z));
                    }
                }
            }
        }
        _ => {
            // Balls, cylinders and hulls of other hands: support points in evenly spread directions.
            for i in 0..200 {
                let z = 1.0 - (2.0 * f64::from(i) + 1.0) / 200.0;
                let angle = f64::from(i) * 2.399_963;
                let r = (1.0 - z * z).sqrt();
                let direction = rapier3d::math::Vector::new((r * angle.cos()) as f32, (r * angle.sin()) as f32, z as f32);
                if let Some(support) = shape.as_support_map() {
                    points.push(at(support.local_support_point(direction)));
                }
            }
        }
    }
    points
}

#[cfg(test)]
mod tests {
    use super::*;
    use rapier3d::parry::shape::{Ball, Capsule, Cuboid};

    #[track_caller]
    fn check(shape: &dyn Shape, distance: impl Fn(&Point) -> f64) {
        let samples = surface_samples(shape);
        assert!(samples.len() >= 150);
        for p in samples {
            assert!(distance(&p).abs() < 1e-6, "{p} is {} off", distance(&p));
        }
    }

    #[test]
    fn samples_lie_on_the_surface() {
        check(&Capsule::new_x(0.01, 0.007), |p| (p - Point::new(p.x.clamp(-0.01, 0.01), 0.0, 0.0)).norm() - 0.007);
        check(&Cuboid::new(rapier3d::math::Vector::new(0.05, 0.04, 0.01)), |p| {
            (p.x.abs() - 0.05).max(p.y.abs() - 0.04).max(p.z.abs() - 0.01)
        });
        check(&Ball::new(0.02), |p| p.coords.norm() - 0.02);
    }
}

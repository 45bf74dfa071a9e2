//! A second opinion on a finished path: the arm's true shapes against the obstacles, by parry3d.

use crate::collision::{BodyGroup, CollisionModel, Contact, distance, mix};
use parry3d::math as parry;
use parry3d::shape::{Ball, Capsule, Cuboid, Cylinder, SharedShape};
use sfg_kinematics::{RobotModel, Shape};
use sfg_types::{HandSide, Pose};
use std::sync::Arc;

/// The first contact along `path` between the arm or hand and an obstacle, checked every `step_rad`; permissions count.
///
/// The path, the arm's and hand's shapes and the distance formulas are independent of the planner's balls. Self-collision and the
/// point cloud are not looked at again. Configurations between are those of the straight way.
///
/// # Panics
/// If the path's configurations do not fit the arm.
#[must_use]
pub fn verify_exact(
    model: &RobotModel,
    side: HandSide,
    robot_q: &[f64],
    collision: &CollisionModel,
    path: &[Vec<f64>],
    step_rad: f64,
) -> Option<Contact> {
    let arm = model.arm(side);
    let obstacles: Vec<(&str, SharedShape, parry::Pose)> = collision
        .obstacle_shapes()
        .filter_map(|(name, shape, pose)| Some((name, to_parry(shape)?, parry_pose(&turned(shape, &pose)))))
        .collect();
    let tree = &model.tree;
    let first_moving = tree.links.iter().position(|l| l.name == arm.chain.link_names[0])?;
    let is_below = |mut idx: usize, root: usize| {
        while idx != root {
            match tree.links[idx].joint_idx {
                Some(joint) => idx = tree.joints[joint].parent_idx,
                None => return false,
            }
        }
        true
    };
    let hand_root = arm.hand_root_link.as_ref().and_then(|name| tree.links.iter().position(|l| l.name == *name));
    let shapes: Vec<(usize, BodyGroup, SharedShape, Pose)> = (0..tree.links.len())
        .filter(|idx| is_below(*idx, first_moving))
        .flat_map(|idx| {
            let group = if hand_root.is_some_and(|root| is_below(idx, root)) { BodyGroup::Hand } else { BodyGroup::Arm };
            tree.links[idx]
                .collision
                .iter()
                .filter_map(move |p| Some((idx, group, to_parry(&p.shape)?, turned(&p.shape, &p.link_from_shape))))
        })
        .collect();
    let mut whole_q = robot_q.to_vec();
    let check = |whole_q: &[f64]| {
        let poses = model.link_poses(whole_q);
        for (link_idx, group, shape, link_from_shape) in &shapes {
            let pose = parry_pose(&(poses[*link_idx] * link_from_shape));
            for (name, obstacle, obstacle_pose) in &obstacles {
                if collision.allows(*group, name) {
                    continue;
                }
                if let Ok(Some(found)) = parry3d::query::contact(&pose, &*shape.0, obstacle_pose, &*obstacle.0, 0.0)
                    && found.dist < 0.0
                {
                    let link = tree.links[*link_idx].name.clone();
                    return Some(Contact { link, with: (*name).to_owned(), depth_m: f64::from(-found.dist) });
                }
            }
        }
        None
    };
    for pair in path.windows(2) {
        let n = (distance(&pair[0], &pair[1]) / step_rad).ceil().max(1.0) as usize;
        for i in 0..=n {
            for (idx, value) in arm.q_idx.iter().zip(mix(&pair[0], &pair[1], i as f64 / n as f64)) {
                whole_q[*idx] = value;
            }
            let contact = check(&whole_q);
            if contact.is_some() {
                return contact;
            }
        }
    }
    None
}

/// parry's cylinders lie along Y, ours along Z.
fn turned(shape: &Shape, pose: &Pose) -> Pose {
    match shape {
        Shape::Cylinder { .. } => {
            pose * nalgebra::UnitQuaternion::from_axis_angle(&sfg_types::Vector::x_axis(), std::f64::consts::FRAC_PI_2)
        }
        _ => *pose,
    }
}

fn to_parry(shape: &Shape) -> Option<SharedShape> {
    Some(match shape {
        Shape::Cuboid { half_extents_m: h } => {
            SharedShape(Arc::new(Cuboid::new(parry::Vector::new(h.x as f32, h.y as f32, h.z as f32))))
        }
        Shape::Sphere { radius_m } => SharedShape(Arc::new(Ball::new(*radius_m as f32))),
        Shape::Cylinder { radius_m, half_length_m } => {
            SharedShape(Arc::new(Cylinder::new(*half_length_m as f32, *radius_m as f32)))
        }
        Shape::Capsule { radius_m, half_length_m } => {
            SharedShape(Arc::new(Capsule::new_z(*half_length_m as f32, *radius_m as f32)))
        }
        Shape::Mesh { .. } => return None,
    })
}

fn parry_pose(pose: &Pose) -> parry::Pose {
    let (t, r) = (pose.translation.vector, pose.rotation.quaternion());
    let rotation = parry::Rotation::from_xyzw(r.i as f32, r.j as f32, r.k as f32, r.w as f32).normalize();
    parry::Pose::from_parts(parry::Vector::new(t.x as f32, t.y as f32, t.z as f32), rotation)
}

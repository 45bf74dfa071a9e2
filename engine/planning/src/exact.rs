//! A second opinion on a finished path: the robot's true shapes against the obstacles and each other, by parry3d.

use crate::collision::{BodyGroup, CollisionModel, Contact, distance, mix};
use crate::shapes::bounding_radius_m;
use parry3d::math as parry;
use parry3d::shape::{Ball, Capsule, Cuboid, Cylinder, SharedShape};
use sfg_kinematics::{RobotModel, Shape, Tree};
use sfg_types::{HandSide, Pose, Vector};
use std::collections::BTreeSet;
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
    let hand_root = model.arm(side).hand_root_link.as_deref();
    verify_tree_exact(&model.tree, hand_root, robot_q, collision, None, path, step_rad)
}

/// As [`verify_exact`] for any robot: what hangs on the chain of `collision` moves, all else stays as in the whole configuration
/// `robot_q`. Links from `hand_root` on are the hand. With `disabled_pairs`, all other pairs of links are looked at, too.
///
/// Contacts shallower than single precision can tell (a micrometre for an arm) may go either way. Mesh shapes are passed over.
///
/// # Panics
/// If the path's configurations do not fit the chain, or the chain or `robot_q` the tree.
#[must_use]
pub fn verify_tree_exact(
    tree: &Tree,
    hand_root: Option<&str>,
    robot_q: &[f64],
    collision: &CollisionModel,
    disabled_pairs: Option<&BTreeSet<(String, String)>>,
    path: &[Vec<f64>],
    step_rad: f64,
) -> Option<Contact> {
    let chain = collision.chain();
    let q_idx = chain.joint_names.iter().map(|name| tree.q_idx(name)).collect::<Result<Vec<_>, _>>();
    let q_idx = q_idx.expect("the chain was cut out of the tree");
    let obstacles: Vec<(&str, Solid)> =
        collision.obstacle_shapes().filter_map(|(name, shape, pose)| Some((name, Solid::new(shape, &pose)?))).collect();
    let is_below = |idx: usize, is_root: &dyn Fn(&str) -> bool| {
        let mut at = Some(idx);
        while let Some(idx) = at {
            let link = &tree.links[idx];
            if is_root(&link.name) {
                return true;
            }
            at = link.joint_idx.map(|joint| tree.joints[joint].parent_idx);
        }
        false
    };
    let (mut moving, mut still) = (Vec::new(), Vec::new());
    for (idx, link) in tree.links.iter().enumerate() {
        let solids = link.collision.iter().filter_map(|p| Some((idx, Solid::new(&p.shape, &p.link_from_shape)?)));
        if is_below(idx, &|name| chain.link_names.iter().any(|moved| moved == name)) {
            let group = if is_below(idx, &|name| Some(name) == hand_root) { BodyGroup::Hand } else { BodyGroup::Arm };
            moving.extend(solids.map(|(idx, solid)| (idx, group, solid)));
        } else if disabled_pairs.is_some() {
            still.extend(solids);
        }
    }
    let name = |idx: usize| tree.links[idx].name.as_str();
    let is_disabled = |a: usize, b: usize| {
        let listed =
            |a: usize, b: usize| disabled_pairs.is_none_or(|pairs| pairs.contains(&(name(a).to_owned(), name(b).to_owned())));
        a == b || listed(a, b) || listed(b, a)
    };
    // Moving with still, moving with moving.
    let mut own_pairs = Vec::new();
    let mut moving_pairs = Vec::new();
    for (nth, (a, ..)) in moving.iter().enumerate() {
        own_pairs.extend((0..still.len()).filter(|other| !is_disabled(*a, still[*other].0)).map(|other| (nth, other)));
        moving_pairs.extend((0..nth).filter(|other| !is_disabled(*a, moving[*other].0)).map(|other| (nth, other)));
    }
    let found = |a: usize, with: &str, depth_m: f64| Contact { link: name(a).to_owned(), with: with.to_owned(), depth_m };
    let mut whole_q = robot_q.to_vec();
    let mut check = |q: &[f64]| {
        for (idx, value) in q_idx.iter().zip(q) {
            whole_q[*idx] = *value;
        }
        let poses = tree.link_poses(&whole_q);
        let placed: Vec<Placed> = moving.iter().map(|(idx, _, solid)| solid.placed(&poses[*idx])).collect();
        for ((idx, group, _), body) in moving.iter().zip(&placed) {
            for (name, obstacle) in obstacles.iter().filter(|(name, _)| !collision.allows(*group, name)) {
                if let Some(depth_m) = body.depth_m(&obstacle.placed(&Pose::identity())) {
                    return Some(found(*idx, name, depth_m));
                }
            }
        }
        for (nth, other) in &own_pairs {
            let (other_idx, solid) = &still[*other];
            if let Some(depth_m) = placed[*nth].depth_m(&solid.placed(&poses[*other_idx])) {
                return Some(found(moving[*nth].0, name(*other_idx), depth_m));
            }
        }
        moving_pairs.iter().find_map(|(nth, other)| {
            let depth_m = placed[*nth].depth_m(&placed[*other])?;
            Some(found(moving[*nth].0, name(moving[*other].0), depth_m))
        })
    };
    for pair in path.windows(2) {
        let n = (distance(&pair[0], &pair[1]) / step_rad).ceil().max(1.0) as usize;
        for i in 0..=n {
            let contact = check(&mix(&pair[0], &pair[1], i as f64 / n as f64));
            if contact.is_some() {
                return contact;
            }
        }
    }
    None
}

/// A shape of a link or of the world.
struct Solid {
    shape: SharedShape,
    pose: Pose,
    bound_m: f64,
}

/// A shape where it is in one configuration.
struct Placed<'a> {
    solid: &'a Solid,
    base_from_shape: Pose,
}

impl Solid {
    fn new(shape: &Shape, pose: &Pose) -> Option<Self> {
        Some(Self { shape: to_parry(shape)?, pose: turned(shape, pose), bound_m: bounding_radius_m(shape) })
    }

    fn placed(&self, base_from_link: &Pose) -> Placed<'_> {
        Placed { solid: self, base_from_shape: base_from_link * self.pose }
    }
}

impl Placed<'_> {
    /// How deep two shapes are in each other, metres; `None` when they are apart.
    fn depth_m(&self, other: &Self) -> Option<f64> {
        let gap: Vector = self.base_from_shape.translation.vector - other.base_from_shape.translation.vector;
        if gap.norm() > self.solid.bound_m + other.solid.bound_m {
            return None;
        }
        let (a, b) = (parry_pose(&self.base_from_shape), parry_pose(&other.base_from_shape));
        let found = parry3d::query::contact(&a, &*self.solid.shape.0, &b, &*other.solid.shape.0, 0.0).ok()??;
        // In single precision parry now and then finds a contact of shapes that are millimetres apart; its distance is right then.
        let touches = || {
            parry3d::query::distance(&a, &*self.solid.shape.0, &b, &*other.solid.shape.0).map_or(true, |gap| gap.distance <= 0.0)
        };
        (found.dist < 0.0 && touches()).then(|| f64::from(-found.dist))
    }
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

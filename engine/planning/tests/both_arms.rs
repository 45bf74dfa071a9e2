//! Both arms, and arms with the torso, planned for at once.
#![allow(clippy::unwrap_used, clippy::print_stderr, reason = "tests fail by panicking and tell what they measured")]

use nalgebra::{UnitQuaternion, Vector3};
use parry3d::math as parry;
use parry3d::shape::SharedShape;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use sfg_kinematics::ik::random_q;
use sfg_kinematics::robot::GROUPS;
use sfg_kinematics::{Chain, Primitive, RobotModel, Shape};
use sfg_planning::{BodyGroup, CollisionModel, CollisionSettings, Obstacle, PlanOutcome, Planner, RrtConnect, SelfPairs};
use sfg_types::{HandSide, Point, Pose};
use std::path::Path;

fn curi() -> RobotModel {
    RobotModel::load(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenarios/robots/curi.yaml")).unwrap()
}

fn collision(model: &RobotModel, group: &str) -> CollisionModel {
    let group = model.group(group).unwrap();
    CollisionModel::of_group(model, &group, &model.home_q, CollisionSettings::default()).unwrap()
}

fn table() -> Obstacle {
    let shape = Shape::Cuboid { half_extents_m: Vector3::new(0.35, 0.7, 0.02) };
    Obstacle { name: "table".to_owned(), shape, pose_in_base: Pose::translation(0.8, 0.0, 0.73) }
}

#[test]
fn every_group_is_free_at_home() {
    let model = curi();
    for name in GROUPS {
        let mut collision = collision(&model, name);
        collision.set_world(&[table()], None);
        let contact = collision.contact(&model.group(name).unwrap().home_q);
        assert_eq!(contact.map(|c| c.to_string()), None, "{name}");
    }
}

#[test]
fn eight_at_once_give_the_verdict_of_one_by_one() {
    let model = curi();
    for name in ["both", "torso_left", "torso_both"] {
        let mut collision = collision(&model, name);
        collision.set_world(&[table()], None);
        let last_tip = collision.chain().n_tips() - 1;
        collision.attach_to(last_tip, "cup", &[(Point::new(0.05, 0.0, 0.05), 0.04)]);
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let (mut n_free, mut n_between_arms, mut n_cup) = (0, 0, 0);
        for _ in 0..1500 {
            let q = random_q(collision.chain(), &mut rng);
            let exact = collision.contact(&q);
            let is_free = collision.is_free_between(&q, &q, 1.0);
            n_free += usize::from(is_free);
            let links = exact.iter().flat_map(|c| [&c.link, &c.with]);
            n_cup += links.clone().filter(|link| *link == "cup").count();
            let arms = |side: &str| links.clone().any(|link| link.contains(side));
            n_between_arms += usize::from(arms("left") && arms("right"));
            let is_clear_cut = exact.as_ref().is_none_or(|contact| contact.depth_m > 1e-6);
            assert!(is_free == exact.is_none() || !is_clear_cut, "{name} {q:?}: {exact:?} and free {is_free}");
        }
        eprintln!(
            "{name}: of 1500 {n_free} free, {n_between_arms} with one arm deepest in the other, {n_cup} with the cup deepest"
        );
        assert!(n_free > 60 && n_between_arms > 2 && n_cup > 2);
    }
}

/// The other arm is balls here and exact shapes there, which the balls cover.
#[test]
fn what_is_free_for_both_arms_is_free_for_one_with_the_other_at_rest() {
    let model = curi();
    let both = collision(&model, "both");
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    for (side, first) in [(HandSide::Left, 0), (HandSide::Right, 7)] {
        let alone = CollisionModel::new(&model, side, &model.home_q, CollisionSettings::default()).unwrap();
        let (mut n_same, mut n_free) = (0, 0);
        for _ in 0..1000 {
            let arm_q = random_q(alone.chain(), &mut rng);
            let mut q = model.group("both").unwrap().home_q;
            q[first..first + 7].copy_from_slice(&arm_q);
            let (one, two) = (alone.contact(&arm_q), both.contact(&q));
            assert!(two.is_some() || one.is_none(), "{arm_q:?}: {one:?}");
            n_free += usize::from(two.is_none());
            n_same += usize::from(one.is_none() == two.is_none());
        }
        assert!(n_same >= 990 && (400..950).contains(&n_free), "{n_same} of 1000 verdicts agree, {n_free} are free");
    }
}

#[test]
fn hands_keep_their_permissions_and_too_many_joints_are_refused() {
    let model = curi();
    let group = model.group("both").unwrap();
    let mut collision = collision(&model, "both");
    for tip in 0..2 {
        let pose_in_base = group.chain.fk_of(tip, &group.home_q);
        let ball = Obstacle { name: "ball".to_owned(), shape: Shape::Sphere { radius_m: 0.02 }, pose_in_base };
        collision.set_world(&[ball], None);
        let side = ["left_", "right_"][tip];
        assert!(collision.contact(&group.home_q).is_some_and(|c| c.with == "ball" && c.link.starts_with(side)));
        collision.allow(BodyGroup::Hand, "ball");
        assert_eq!(collision.contact(&group.home_q), None);
        collision.clear_allowed();
    }
    // Every joint of both hands as well.
    let tips: Vec<&str> = model.tree.links.iter().map(|link| link.name.as_str()).collect();
    let base = &model.tree.links[0].name;
    let chain = Chain::branching(&model.tree, base, &tips, &model.tree.q_names, &model.home_q).unwrap();
    let error =
        CollisionModel::of_tree(&model.tree, chain, None, &model.home_q, SelfPairs::Sampled, CollisionSettings::default());
    let message = error.unwrap_err().to_string();
    assert!(message.contains("at most 24 can be planned for"), "{message}");
}

#[test]
fn a_mesh_is_refused_by_name() {
    let mut model = curi();
    let idx = model.tree.link_idx("panda_left_link3").unwrap();
    let mesh = Shape::Mesh { file: "package://nowhere/arm.stl".to_owned(), scale: Vector3::repeat(1.0) };
    model.tree.links[idx].collision.push(Primitive { shape: mesh, link_from_shape: Pose::identity() });
    let group = model.group("both").unwrap();
    let error = CollisionModel::of_group(&model, &group, &model.home_q, CollisionSettings::default()).unwrap_err().to_string();
    assert!(error.contains("panda_left_link3") && error.contains("package://nowhere/arm.stl"), "{error}");
}

/// A free configuration with the palms in two boxes: low and high corner of each.
fn with_palms_in(collision: &CollisionModel, boxes: [[[f64; 3]; 2]; 2], rng: &mut ChaCha8Rng) -> Vec<f64> {
    let chain = collision.chain();
    loop {
        let mut q = random_q(chain, rng);
        for (tip, [low, high]) in boxes.iter().enumerate() {
            let is_inside = |q: &[f64]| {
                let at = chain.fk_of(tip, q).translation;
                [at.x, at.y, at.z].iter().zip(low.iter().zip(high)).all(|(v, (low, high))| (low..high).contains(&v))
            };
            while !is_inside(&q) {
                let other = random_q(chain, rng);
                (0..q.len()).filter(|idx| chain.moves_tip(*idx, tip)).for_each(|idx| q[idx] = other[idx]);
            }
        }
        if collision.is_free(&q) {
            return q;
        }
    }
}

/// The first links of the two arms whose exact shapes overlap, by parry3d.
fn arms_overlap(model: &RobotModel, q: &[f64]) -> Option<String> {
    let poses = model.link_poses(q);
    let carried_by = |mut idx: usize, link: &str| loop {
        if model.tree.links[idx].name == link {
            return true;
        }
        match model.tree.links[idx].joint_idx {
            Some(joint_idx) => idx = model.tree.joints[joint_idx].parent_idx,
            None => return false,
        }
    };
    let shapes = |link: &str| -> Vec<(&str, SharedShape, parry::Pose)> {
        let links = (0..poses.len()).filter(|idx| carried_by(*idx, link));
        links
            .flat_map(|idx| model.tree.links[idx].collision.iter().map(move |primitive| (idx, primitive)))
            .map(|(idx, primitive)| {
                let (shape, turned) = match primitive.shape {
                    Shape::Sphere { radius_m } => (SharedShape::ball(radius_m as f32), false),
                    Shape::Capsule { radius_m, half_length_m } => {
                        (SharedShape::capsule_z(half_length_m as f32, radius_m as f32), false)
                    }
                    Shape::Cylinder { radius_m, half_length_m } => {
                        (SharedShape::cylinder(half_length_m as f32, radius_m as f32), true)
                    }
                    Shape::Cuboid { half_extents_m: h } => (SharedShape::cuboid(h.x as f32, h.y as f32, h.z as f32), false),
                    Shape::Mesh { .. } => panic!("the robot has no mesh"),
                };
                // parry's cylinders lie along Y, ours along Z.
                let turn = Vector3::x() * if turned { std::f64::consts::FRAC_PI_2 } else { 0.0 };
                let pose = poses[idx] * primitive.link_from_shape * UnitQuaternion::from_scaled_axis(turn);
                let (t, r) = (pose.translation, pose.rotation.quaternion());
                let rotation = parry::Rotation::from_xyzw(r.i as f32, r.j as f32, r.k as f32, r.w as f32);
                let translation = parry::Vector::new(t.x as f32, t.y as f32, t.z as f32);
                (model.tree.links[idx].name.as_str(), shape, parry::Pose::from_parts(translation, rotation))
            })
            .collect()
    };
    let (left, right) = (shapes("panda_left_link1"), shapes("panda_right_link1"));
    left.iter().find_map(|(a, shape, pose)| {
        let hit = |(_, other, at): &&(&str, SharedShape, parry::Pose)| {
            parry3d::query::intersection_test(pose, &*shape.0, at, &*other.0).unwrap().intersecting
        };
        right.iter().find(hit).map(|(b, ..)| format!("{a} and {b}"))
    })
}

/// Crossed arms change which one is above: on the straight way they would meet.
#[test]
fn arms_pass_each_other_in_one_plan() {
    let model = curi();
    let group = model.group("both").unwrap();
    let mut collision = collision(&model, "both");
    collision.set_world(&[table()], None);
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let crossed = |left_z: f64, right_z: f64| {
        [[[0.5, -0.25, left_z], [0.8, -0.05, left_z + 0.15]], [[0.5, 0.05, right_z], [0.8, 0.25, right_z + 0.15]]]
    };
    let (mut n_blocked, mut n_arms_would_meet) = (0, 0);
    for seed in 0..8 {
        let start = with_palms_in(&collision, crossed(1.05, 0.85), &mut rng);
        let goal = with_palms_in(&collision, crossed(0.85, 1.05), &mut rng);
        let straight = [start.clone(), goal.clone()];
        n_blocked += usize::from(collision.contact_along(&straight, 1.0 / 32.0).is_some());
        let overlap_along = |path: &[Vec<f64>]| {
            path.windows(2).find_map(|pair| {
                let length = pair[0].iter().zip(&pair[1]).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
                let n = (length / 0.05).ceil().max(1.0) as usize;
                (0..=n).find_map(|i| {
                    let share = i as f64 / n as f64;
                    let q: Vec<f64> = pair[0].iter().zip(&pair[1]).map(|(a, b)| a + share * (b - a)).collect();
                    arms_overlap(&model, &model.q_with_group(&group, &q))
                })
            })
        };
        n_arms_would_meet += usize::from(overlap_along(&straight).is_some());
        let began = std::time::Instant::now();
        let path = match RrtConnect::default().plan(&collision, &start, std::slice::from_ref(&goal), seed) {
            PlanOutcome::Found(path) => path,
            other => panic!("seed {seed}: {other:?}"),
        };
        eprintln!("seed {seed}: {:?}, {} corners", began.elapsed(), path.len());
        assert_eq!((path.first(), path.last()), (Some(&start), Some(&goal)));
        assert_eq!(collision.contact_along(&path, 1.0 / 512.0), None);
        assert_eq!(overlap_along(&path), None);
    }
    eprintln!("{n_blocked} of 8 straight ways are blocked, on {n_arms_would_meet} the arms meet");
    assert!(n_arms_would_meet >= 4, "{n_arms_would_meet} of 8");
}

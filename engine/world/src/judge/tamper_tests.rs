//! Each rule of physics is broken once and must be noticed; an untouched run must not be accused.
#![allow(clippy::unwrap_used, reason = "tests fail by panicking")]

use super::{Invariant, Predicate};
use crate::bodies::Bodies;
use crate::{ObjectSpec, SceneSpec, World, load_object_model};
use rapier3d::prelude::*;
use sfg_kinematics::RobotModel;
use sfg_types::{HandCommand, HandSide, RobotCommand};
use std::path::Path;

fn world() -> (World, RobotCommand) {
    let scenarios = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenarios");
    let robot = RobotModel::load(&scenarios.join("robots/curi.yaml")).unwrap();
    let model = load_object_model(&scenarios.join("objects/mug.yaml")).unwrap();
    let mug = ObjectSpec::from_model("mug", &model, [0.5; 3], 0.9, -0.45, 0.0).unwrap().with_grains(4);
    let spec = SceneSpec { objects: vec![mug], seed: 5, ..SceneSpec::default() };
    let q = robot.left.home_q.clone();
    let command = RobotCommand { side: HandSide::Left, dq: vec![0.0; q.len()], q, hand: HandCommand::default() };
    (World::new(&spec, &robot, HandSide::Left).unwrap(), command)
}

fn palm(bodies: &Bodies) -> RigidBodyHandle {
    bodies.hand[0].body
}

#[track_caller]
fn check(tamper: impl Fn(&mut Bodies), expected: Option<Invariant>) {
    let (mut world, command) = world();
    world.step(&command).unwrap();
    tamper(&mut world.bodies);
    world.step(&command).unwrap();
    world.step(&command).unwrap();
    let found = world.tampered();
    assert_eq!(found.as_ref().map(|t| t.which), expected, "{found:?}");
    // A tampered run fails whatever its predicates say.
    let true_anyway = Predicate::Lifted { object: "mug".to_owned(), at_least_m: 0.0 };
    let verdict = world.verdict(&[true_anyway]).unwrap();
    assert!(verdict.checks[0].pass);
    assert_eq!(verdict.success, expected.is_none());
}

fn body(bodies: &mut Bodies, object_idx: usize) -> &mut RigidBody {
    let handle = bodies.objects[object_idx].body;
    &mut bodies.physics.bodies[handle]
}

#[test]
fn an_honest_run_is_not_accused() {
    check(|_| {}, None);
}

#[test]
fn joints_to_objects_are_noticed() {
    let weld = |bodies: &mut Bodies| {
        let (mug, palm) = (bodies.objects[0].body, palm(bodies));
        bodies.physics.insert_impulse_joint(palm, mug, FixedJointBuilder::new());
    };
    check(weld, Some(Invariant::Joint));
    let link = |bodies: &mut Bodies| {
        let mug = bodies.objects[0].body;
        let anchor = bodies.physics.insert_body(RigidBodyBuilder::fixed());
        bodies.physics.insert_multibody_joint(anchor, mug, FixedJointBuilder::new());
    };
    check(link, Some(Invariant::Joint));
}

#[test]
fn a_collider_on_another_body_is_noticed() {
    let move_collider = |bodies: &mut Bodies| {
        let (piece, palm) = (bodies.objects[0].pieces[0].0, palm(bodies));
        let PhysicsWorld { colliders, bodies: rigid, .. } = &mut bodies.physics;
        colliders.set_parent(piece, Some(palm), rigid);
    };
    check(move_collider, Some(Invariant::Parent));
    let add_collider = |bodies: &mut Bodies| {
        let mug = bodies.objects[0].body;
        bodies.physics.insert_collider(ColliderBuilder::ball(0.01).density(0.0), Some(mug));
    };
    check(add_collider, Some(Invariant::Parent));
}

#[test]
fn a_collider_that_touches_something_else_is_noticed() {
    let with = |change: fn(&mut Collider)| {
        move |bodies: &mut Bodies| {
            let piece = bodies.objects[0].pieces[0].0;
            change(&mut bodies.physics.colliders[piece]);
        }
    };
    check(with(|piece| piece.set_collision_groups(InteractionGroups::none())), Some(Invariant::Groups));
    check(with(|piece| piece.set_sensor(true)), Some(Invariant::Groups));
    check(with(|piece| piece.set_enabled(false)), Some(Invariant::Groups));
}

#[test]
fn too_much_friction_is_noticed() {
    let glue = |bodies: &mut Bodies| {
        let piece = bodies.objects[0].pieces[0].0;
        bodies.physics.colliders[piece].set_friction(0.9);
    };
    check(glue, Some(Invariant::Friction));
    let rule = |bodies: &mut Bodies| {
        let piece = bodies.objects[0].pieces[0].0;
        bodies.physics.colliders[piece].set_friction_combine_rule(CoefficientCombineRule::ClampedSum);
    };
    check(rule, Some(Invariant::Friction));
    let limit = |bodies: &mut Bodies| {
        let piece = bodies.objects[0].pieces[0].0;
        bodies.physics.colliders[piece].set_friction(0.8);
    };
    check(limit, None);
}

#[test]
fn damping_sleep_and_lost_freedom_are_noticed() {
    check(|bodies| body(bodies, 0).set_linear_damping(0.1), Some(Invariant::Damping));
    check(|bodies| body(bodies, 0).set_angular_damping(0.1), Some(Invariant::Damping));
    check(|bodies| body(bodies, 0).sleep(), Some(Invariant::Freedom));
    check(|bodies| body(bodies, 0).lock_rotations(true, true), Some(Invariant::Freedom));
    check(|bodies| body(bodies, 0).set_body_type(RigidBodyType::Fixed, true), Some(Invariant::Freedom));
}

#[test]
fn changed_gravity_is_noticed() {
    check(|bodies| bodies.physics.gravity.z = -4.9, Some(Invariant::Gravity));
    check(|bodies| body(bodies, 0).set_gravity_scale(0.1, true), Some(Invariant::Gravity));
}

#[test]
fn changed_masses_are_noticed() {
    let light = |bodies: &mut Bodies| {
        let light = MassProperties::from_ball(1.0, 0.01);
        body(bodies, 0).set_additional_mass_properties(light, true);
    };
    check(light, Some(Invariant::Mass));
    let grain = |bodies: &mut Bodies| {
        let grain = bodies.grains[0].body;
        bodies.physics.bodies[grain].set_additional_mass(0.01, true);
    };
    check(grain, Some(Invariant::Mass));
}

#[test]
fn pushing_and_carrying_by_hand_are_noticed() {
    check(|bodies| body(bodies, 0).add_force(Vector::new(0.0, 0.0, 1.0), true), Some(Invariant::Force));
    check(|bodies| body(bodies, 0).set_dominance_group(1), Some(Invariant::Force));
    check(
        |bodies| {
            let up = body(bodies, 0).translation() + Vector::new(0.0, 0.0, 0.05);
            body(bodies, 0).set_translation(up, true);
        },
        Some(Invariant::Teleport),
    );
    check(|bodies| body(bodies, 0).set_linvel(Vector::new(0.0, 0.0, 2.0), true), Some(Invariant::Teleport));
}

#[test]
fn motors_beyond_the_robot_are_noticed() {
    for nth in [3, 12] {
        let strengthen = |bodies: &mut Bodies| {
            let joints = &mut bodies.physics.multibody_joints;
            let (handle, ..) = joints.iter().nth(nth).unwrap();
            let (multibody, link_idx) = joints.get_mut(handle).unwrap();
            multibody.link_mut(link_idx).unwrap().joint.data.set_motor_max_force(JointAxis::AngX, 500.0);
        };
        let (mut world, command) = world();
        world.step(&command).unwrap();
        assert_eq!(world.tampered(), None);
        strengthen(&mut world.bodies);
        assert_eq!(world.tampered().map(|t| t.which), Some(Invariant::MotorTorque));
    }
}

#[test]
fn tendons_beyond_the_profile_are_noticed() {
    let (world, _) = world();
    let which = |tension: f64| world.judge.guard.check(&world.bodies.physics, &[tension], 0.0).err().map(|t| t.which);
    let most = world.robot.max_tension_nm();
    assert_eq!([which(0.0), which(most)], [None, None]);
    assert_eq!([which(1.01 * most), which(f64::NAN)], [Some(Invariant::TendonTension); 2]);
}

//! The simulated SoftHand2: its size and mirror image, its free motion, its adaptation, its feedback, and that it holds a bottle.

#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "tests fail by panicking and tell what they pass over")]

use rapier3d::prelude::{ColliderBuilder, InteractionGroups, PhysicsWorld, RigidBodyBuilder, RigidBodyHandle, Vector as Glam};
use sfg_kinematics::Tree;
use sfg_types::{HandCommand, HandProfile, Pose, SynergyCoordinates, Vector};
use sfg_world::hand::SimulatedHand;
use sfg_world::multibody::{Articulation, FRICTION_RULE, LinkSettings};
use sfg_world::settings::{DT_SECS, FINGER_ARMATURE_KG_M2, GRAVITY_MPS2, integration_parameters};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

const FINGERS: [&str; 5] = ["thumb", "index", "middle", "ring", "little"];

fn robots() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenarios/robots")
}

fn profile() -> HandProfile {
    serde_saphyr::from_str(&std::fs::read_to_string(robots().join("softhand2.yaml")).unwrap()).unwrap()
}

fn tree(side: &str) -> Tree {
    Tree::load(&robots().join(format!("softhand2_{side}.urdf"))).unwrap()
}

/// A hand in empty space with its palm at the origin.
struct Bench {
    world: PhysicsWorld,
    articulation: Articulation,
    hand: SimulatedHand,
}

impl Bench {
    fn new(side: &str, start: SynergyCoordinates) -> Self {
        let tree = tree(side);
        let q = vec![0.0; tree.n_q()];
        let root_from_palm = tree.link_poses(&q)[tree.link_idx("palm").unwrap()];
        let mut world =
            PhysicsWorld { integration_parameters: integration_parameters(), gravity: Glam::ZERO, ..PhysicsWorld::default() };
        let settings =
            LinkSettings { friction: 1.0, collision_groups: InteractionGroups::all(), armature: |_| FINGER_ARMATURE_KG_M2 };
        let articulation = Articulation::spawn(&mut world, &tree, "hand_base", &root_from_palm.inverse(), &q, &settings).unwrap();
        let mut hand = SimulatedHand::new(&profile(), &articulation, "").unwrap();
        hand.reset(&mut world, &articulation, start);
        Self { world, articulation, hand }
    }

    fn run(&mut self, synergy: f64, manipulation: f64, secs: f64) {
        for _ in 0..(secs / DT_SECS).round() as usize {
            self.hand.step(&mut self.world, &self.articulation, HandCommand { synergy, manipulation });
            self.world.step();
        }
    }

    fn joint(&self, name: &str) -> f64 {
        let idx = profile().joints.iter().position(|j| j.name == name).unwrap();
        self.hand.hand_q(&self.world, &self.articulation)[idx]
    }

    /// An upright bottle as the palm sees it: a cylinder along palm Y.
    fn add_cylinder(&mut self, radius_m: f32, x: f32, z: f32, mass_kg: f32, friction: f32) -> RigidBodyHandle {
        let body = RigidBodyBuilder::dynamic().translation(Glam::new(x, 0.0, z)).can_sleep(false);
        let shape =
            ColliderBuilder::cylinder(0.09, radius_m).mass(mass_kg).friction(friction).friction_combine_rule(FRICTION_RULE);
        self.world.insert(body, shape).0
    }
}

#[test]
fn physics_and_kinematics_agree_on_every_link() {
    let tree = tree("left");
    let mut bench = Bench::new("left", SynergyCoordinates::OPEN);
    let q: Vec<f64> = (0..tree.n_q()).map(|i| 0.1 + 0.05 * i as f64).collect();
    bench.articulation.teleport(&mut bench.world, &q);
    let palm_from_root = tree.link_poses(&q)[tree.link_idx("palm").unwrap()].inverse();
    for (link, root_from_link) in tree.links.iter().zip(tree.link_poses(&q)) {
        let (expected, found) =
            (palm_from_root * root_from_link, bench.articulation.world_from_link(&bench.world, &link.name).unwrap());
        let gap = (expected.translation.vector - found.translation.vector).norm();
        assert!(gap < 1e-5 && expected.rotation.angle_to(&found.rotation) < 1e-3, "{}: {gap} m", link.name);
    }
    let read = bench.articulation.q(&bench.world);
    assert!(q.iter().zip(&read).all(|(a, b)| (a - b).abs() < 1e-5));
}

#[test]
fn the_left_hand_is_the_mirror_image_of_the_right() {
    let (left, right) = (tree("left"), tree("right"));
    assert_eq!(left.q_names, right.q_names);
    let mirrored = |pose: &Pose| pose.translation.vector.component_mul(&Vector::new(-1.0, 1.0, 1.0));
    for seed in 0..5_i32 {
        let q: Vec<f64> = (0..19).map(|i| 0.7 + 0.6 * f64::from(seed * 19 + i).sin()).collect();
        for ((l, r), (a, b)) in left.links.iter().zip(&right.links).zip(left.link_poses(&q).iter().zip(&right.link_poses(&q))) {
            assert!((mirrored(a) - b.translation.vector).norm() < 2e-6, "{}", l.name);
            assert_eq!((l.inertial.mass_kg, l.collision.len()), (r.inertial.mass_kg, r.collision.len()));
            for (p, s) in l.collision.iter().zip(&r.collision) {
                assert_eq!(p.shape, s.shape);
                let (own, other) = (a * p.link_from_shape, b * s.link_from_shape);
                assert!((mirrored(&own) - other.translation.vector).norm() < 2e-6, "{}", l.name);
            }
        }
    }
}

#[test]
fn fingers_curl_out_of_the_palm_and_the_thumb_opposes_them() {
    for (side, thumb_side) in [("left", 1.0), ("right", -1.0)] {
        let tree = tree(side);
        let tip = |u: f64, finger: &str| {
            let q: Vec<f64> = tree.q_names.iter().map(|n| if is_knuckle(n) { 0.0 } else { u * 1.57 }).collect();
            let poses = tree.link_poses(&q);
            let palm = poses[tree.link_idx("palm").unwrap()];
            palm.inverse() * poses[tree.link_idx(&format!("{finger}_distal")).unwrap()] * sfg_types::Point::new(0.025, 0.0, 0.0)
        };
        assert!(tip(0.0, "thumb").y * thumb_side > 0.1, "{side}: an open thumb stands out on its side");
        for finger in &FINGERS[1..] {
            assert!(tip(0.0, finger).x > 0.1 && tip(0.5, finger).z > 0.04, "{side} {finger}");
        }
        assert!((tip(0.9, "thumb") - tip(0.9, "index")).norm() < 0.04, "{side}: thumb and index tips meet");
    }
}

/// Finger tips against the published 33-joint model (rolling pairs), which lives outside the repository.
#[test]
fn finger_tips_are_where_the_published_hand_has_them() {
    let shared = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data/robots");
    for side in ["left", "right"] {
        let path = shared.join(format!("softhand_v1_2_{side}/softhand_v1_2_{side}.urdf"));
        if !path.exists() {
            println!("skipped: {} is not here", path.display());
            continue;
        }
        let (ours, theirs) = (tree(side), Tree::load(&path).unwrap());
        for bend in [0.0, 0.3, 0.6, 0.9] {
            let our_q: Vec<f64> = ours.q_names.iter().map(|n| if is_knuckle(n) { 0.0 } else { bend }).collect();
            let pair = |n: &String| match n.as_str() {
                "thumb_knuckle_joint" => bend,
                n if n.contains("knuckle") => 0.0,
                _ => bend / 2.0,
            };
            let their_q: Vec<f64> = theirs.q_names.iter().map(pair).collect();
            let (a, b) = (ours.link_poses(&our_q), theirs.link_poses(&their_q));
            for finger in FINGERS {
                // 18 mm along the distal link; our joint lies 6.9 mm before the second half axis.
                let tip_a = a[ours.link_idx(&format!("{finger}_distal")).unwrap()] * sfg_types::Point::new(0.0249, 0.0, 0.0);
                let tip_b =
                    b[theirs.link_idx(&format!("{finger}_distal_link")).unwrap()] * sfg_types::Point::new(0.018, 0.0, 0.0);
                assert!((tip_a - tip_b).norm() < 0.003, "{side} {finger} at {bend} rad: {} m", (tip_a - tip_b).norm());
            }
        }
    }
}

#[test]
fn the_free_hand_reaches_the_commanded_closure_with_little_current() {
    let profile = profile();
    for (c1, c2) in [(1.0, 0.0), (0.45, 0.0), (0.44, 1.0), (0.7, -0.35)] {
        let mut bench = Bench::new("right", SynergyCoordinates::OPEN);
        bench.run(c1, c2, 2.0);
        for (name, [m1, m2]) in profile.synergy_joints.iter().zip(&profile.synergy_matrix) {
            let joint = profile.joints.iter().find(|j| j.name == *name).unwrap();
            let expected = (m1 * c1 + m2 * c2).clamp(0.0, 1.0) * joint.upper_rad;
            assert!((bench.joint(name) - expected).abs() < 0.03, "{name} at ({c1}, {c2}): {} rad", bench.joint(name));
        }
        let feedback = bench.hand.feedback();
        assert!((feedback.motor_positions[0] - (c1 + c2)).abs() < 1e-9, "m1 = c1 + c2");
        assert!((feedback.motor_positions[1] - (c1 - c2)).abs() < 1e-9, "m2 = c1 - c2");
        assert!(feedback.motor_currents_amps.iter().all(|amps| *amps < 0.7 * profile.max_current_amps), "{feedback:?}");
    }
}

#[test]
fn motors_keep_their_speed_limit() {
    let mut bench = Bench::new("right", SynergyCoordinates::OPEN);
    bench.run(1.0, 0.0, 0.2);
    let reached = bench.hand.feedback().motor_positions[0];
    assert!((reached - 0.2 * profile().max_closing_speed_per_sec).abs() < 1e-6, "{reached}");
}

#[test]
fn a_blocked_finger_lets_the_others_close() {
    let mut bench = Bench::new("right", SynergyCoordinates::OPEN);
    // A wall in front of the index finger's middle phalanges only.
    let wall = ColliderBuilder::cuboid(0.03, 0.008, 0.005).translation(Glam::new(0.095, -0.03, 0.012)).friction(0.5);
    bench.world.insert(RigidBodyBuilder::fixed(), wall);
    bench.run(0.6, 0.0, 2.0);
    let blocked: f64 = ["index_proximal", "index_middle"].iter().map(|n| bench.joint(n)).sum();
    let free: f64 = ["middle_proximal", "middle_middle"].iter().map(|n| bench.joint(n)).sum();
    assert!(blocked < 0.7 * free, "index {blocked} rad, middle {free} rad");
    for name in ["middle_proximal", "ring_middle", "little_distal"] {
        assert!(bench.joint(name) > 0.6 * 1.57, "{name} {}", bench.joint(name));
    }
}

#[test]
fn current_rises_when_the_hand_is_blocked() {
    let mut free = Bench::new("right", SynergyCoordinates::new(0.2, 0.2));
    let mut blocked = Bench::new("right", SynergyCoordinates::new(0.2, 0.2));
    blocked.add_cylinder(0.030, 0.045, 0.033, 0.3, 0.6);
    let amps = |bench: &mut Bench| {
        bench.run(0.9, 0.3, 1.2);
        bench.hand.feedback().motor_currents_amps
    };
    let (free, blocked) = (amps(&mut free), amps(&mut blocked));
    assert!(blocked[0] > 0.95 && blocked[0] > free[0] + 0.3, "free {free:?} A, blocked {blocked:?} A");
}

#[test]
fn a_wrapped_cylinder_stays_under_gravity_from_every_side() {
    let profile = profile();
    let limits: BTreeMap<&str, f64> = profile.joints.iter().map(|j| (j.name.as_str(), j.max_torque_nm)).collect();
    for side in ["left", "right"] {
        for direction in [[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]
        {
            let mut bench = Bench::new(side, SynergyCoordinates::new(0.2, 0.2));
            let object = bench.add_cylinder(0.030, 0.050, 0.033, 0.3, 0.6);
            bench.run(0.9, 0.3, 1.2);
            let closed = *bench.world.bodies[object].position();
            bench.world.gravity = Glam::from_array(direction) * GRAVITY_MPS2 as f32;
            bench.run(0.9, 0.3, 2.0);
            let now = bench.world.bodies[object].position();
            let (shift, turn) = ((now.translation - closed.translation).length(), closed.rotation.angle_between(now.rotation));
            assert!(shift < 0.01 && turn < 0.2, "{side}, gravity {direction:?}: moved {shift} m, turned {turn} rad");
            let torques = bench.hand.joint_torques_nm(&bench.world, &bench.articulation);
            for (joint, torque) in profile.joints.iter().zip(torques) {
                assert!(torque.abs() <= limits[joint.name.as_str()] + 1e-9, "{} {torque} Nm", joint.name);
            }
        }
    }
}

#[test]
fn nothing_holds_without_friction() {
    let mut bench = Bench::new("left", SynergyCoordinates::new(0.2, 0.2));
    let object = bench.add_cylinder(0.030, 0.050, 0.033, 0.3, 0.02);
    bench.run(0.9, 0.3, 1.2);
    let closed = *bench.world.bodies[object].position();
    bench.world.gravity = Glam::new(0.0, -GRAVITY_MPS2 as f32, 0.0);
    bench.run(0.9, 0.3, 2.0);
    assert!((bench.world.bodies[object].position().translation - closed.translation).length() > 0.05);
}

/// The finger abductions, which stay straight in these postures; the thumb's moves with the closure.
fn is_knuckle(joint: &str) -> bool {
    joint.ends_with("_abduction") && !joint.starts_with("thumb")
}

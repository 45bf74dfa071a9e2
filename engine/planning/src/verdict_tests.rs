//! The eight-lane verdicts against parry in double precision, and the instruction sets against each other.
//!
//! What moves is placed by the tree's forward kinematics, not the chain's; distances are parry's; pairs are listed anew here. So
//! the two sides share the balls and the URDF, and nothing that computes.
#![allow(clippy::unwrap_used, clippy::print_stderr, reason = "tests fail by panicking and tell what they measured")]

use crate::batch::levels;
use crate::collision::{CollisionModel, CollisionSettings, SelfPairs};
use crate::lanes::{Lanes, N_LANES};
use crate::shapes::{Obstacle, bounding_radius_m, covering_spheres};
use nalgebra::{UnitQuaternion, Vector3};
use parry3d_f64::math as parry;
use parry3d_f64::query::PointQuery as _;
use parry3d_f64::shape::{Ball, Capsule, Cuboid, Cylinder, SharedShape};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use sfg_kinematics::ik::random_q;
use sfg_kinematics::{Chain, RobotModel, Shape, Srdf, Tree};
use sfg_types::{Point, Pose};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// Verdicts may differ where the gap is smaller.
const BAND_M: f64 = 1e-6;
/// Obstacles of a scene, and configurations that are judged in it.
const N_OBSTACLES: usize = 50;
const N_IN_SCENE: usize = 2000;

struct Robot {
    tree: Tree,
    chain: Chain,
    rest_q: Vec<f64>,
    settings: CollisionSettings,
    disabled: BTreeSet<(String, String)>,
}

/// A shape for parry with its place.
struct Exact {
    shape: SharedShape,
    bound_m: f64,
    base_from_shape: Pose,
}

impl Exact {
    fn new(shape: &Shape, base_from_shape: &Pose) -> Self {
        // parry's cylinders lie along Y, ours along Z.
        let turned = base_from_shape * UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::FRAC_PI_2);
        let (solid, base_from_shape) = match shape {
            Shape::Cuboid { half_extents_m: h } => {
                (SharedShape::new(Cuboid::new(parry::Vector::new(h.x, h.y, h.z))), *base_from_shape)
            }
            Shape::Sphere { radius_m } => (SharedShape::new(Ball::new(*radius_m)), *base_from_shape),
            Shape::Cylinder { radius_m, half_length_m } => (SharedShape::new(Cylinder::new(*half_length_m, *radius_m)), turned),
            Shape::Capsule { radius_m, half_length_m } => {
                (SharedShape::new(Capsule::new_z(*half_length_m, *radius_m)), *base_from_shape)
            }
            Shape::Mesh { .. } => panic!("the robots of this test have no meshes"),
        };
        Self { shape: solid, bound_m: bounding_radius_m(shape), base_from_shape }
    }

    /// How far the ball is from the shape, negative when it touches; `far` when it is farther than that.
    fn gap_m(&self, centre: &Point, radius_m: f64, far: f64) -> f64 {
        if (centre.coords - self.base_from_shape.translation.vector).norm() - self.bound_m - radius_m > far {
            return far;
        }
        let (t, r) = (self.base_from_shape.translation.vector, self.base_from_shape.rotation.quaternion());
        let rotation = parry::Rotation::from_xyzw(r.i, r.j, r.k, r.w).normalize();
        let pose = parry::Pose::from_parts(parry::Vector::new(t.x, t.y, t.z), rotation);
        self.shape.distance_to_point(&pose, parry::Vector::new(centre.x, centre.y, centre.z), true) - radius_m
    }
}

/// The robot with its links sorted into those that move with the chain and the others.
struct Judge<'a> {
    robot: &'a Robot,
    // Link, balls in the link frame.
    moving: Vec<(usize, Vec<(Point, f64)>)>,
    still: Vec<(usize, Exact)>,
    // Places of the chain's joints in a configuration of the tree.
    q_idx: Vec<usize>,
}

impl<'a> Judge<'a> {
    fn new(robot: &'a Robot) -> Self {
        let tree = &robot.tree;
        let poses = tree.link_poses(&robot.rest_q);
        let (mut moving, mut still) = (Vec::new(), Vec::new());
        for (idx, link) in tree.links.iter().enumerate() {
            if carrier(robot, idx).is_some() {
                let balls = |p| covering_spheres(p, robot.settings.arm_excess_m);
                moving.push((idx, link.collision.iter().flat_map(balls).collect()));
            } else {
                still.extend(link.collision.iter().map(|p| (idx, Exact::new(&p.shape, &(poses[idx] * p.link_from_shape)))));
            }
        }
        let q_idx = robot.chain.joint_names.iter().map(|name| tree.q_idx(name).unwrap()).collect();
        Self { robot, moving, still, q_idx }
    }

    fn may_touch(&self, a: usize, b: usize) -> bool {
        let name = |idx: usize| self.robot.tree.links[idx].name.clone();
        let disabled = &self.robot.disabled;
        a == b || disabled.contains(&(name(a), name(b))) || disabled.contains(&(name(b), name(a)))
    }

    /// Balls of the moving links in the base frame.
    fn placed(&self, q: &[f64]) -> Vec<(usize, Vec<(Point, f64)>)> {
        let mut whole_q = self.robot.rest_q.clone();
        for (idx, value) in self.q_idx.iter().zip(q) {
            // The very numbers that the lanes get.
            whole_q[*idx] = f64::from(*value as f32);
        }
        let poses = self.robot.tree.link_poses(&whole_q);
        let place = |idx: usize, balls: &[(Point, f64)]| balls.iter().map(|(c, r)| (poses[idx] * c, *r)).collect();
        self.moving.iter().map(|(idx, balls)| (*idx, place(*idx, balls))).collect()
    }

    /// The smallest gap between things that must not touch, metres; 1 mm when it is larger.
    fn gap_m(&self, q: &[f64], obstacles: &[Exact]) -> f64 {
        let placed = self.placed(q);
        let mut least = 1e-3;
        for (nth, (link_idx, balls)) in placed.iter().enumerate() {
            for (centre, radius) in balls {
                let kept = radius + self.robot.settings.clearance_m;
                for obstacle in obstacles {
                    least = obstacle.gap_m(centre, kept, least).min(least);
                }
                for (_, own) in self.still.iter().filter(|(own_idx, _)| !self.may_touch(*link_idx, *own_idx)) {
                    least = own.gap_m(centre, *radius, least).min(least);
                }
            }
            for (other_idx, others) in placed[..nth].iter().filter(|(other_idx, _)| !self.may_touch(*link_idx, *other_idx)) {
                debug_assert_ne!(link_idx, other_idx);
                for (centre, radius) in balls {
                    for (other, other_radius) in others {
                        let ball = Ball::new(*radius + other_radius);
                        let apart = parry::Vector::new(centre.x - other.x, centre.y - other.y, centre.z - other.z);
                        least = least.min(ball.distance_to_local_point(apart, false));
                    }
                }
            }
        }
        least
    }
}

/// The joint of the chain that moves a link.
fn carrier(robot: &Robot, mut idx: usize) -> Option<usize> {
    loop {
        let link = &robot.tree.links[idx];
        if let Some(joint) = robot.chain.link_names.iter().position(|name| *name == link.name) {
            return Some(joint);
        }
        idx = robot.tree.joints[link.joint_idx?].parent_idx;
    }
}

fn panda() -> Option<Robot> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data/robots/panda");
    let urdf = folder.join("panda_spherized.urdf");
    if !urdf.exists() {
        return None;
    }
    let tree = Tree::load(&urdf).unwrap();
    let srdf = Srdf::load(&folder.join("panda.srdf")).unwrap();
    let rest_q = vec![0.0; tree.n_q()];
    let chain = Chain::between(&tree, "panda_link0", "panda_link8", &rest_q).unwrap();
    assert_eq!(tree.links.iter().map(|link| link.collision.len()).sum::<usize>(), 59, "the hand-made balls");
    let settings = CollisionSettings { arm_excess_m: 0.0, hand_excess_m: 0.0, clearance_m: 0.0, self_clearance_m: 0.0 };
    Some(Robot { tree, chain, rest_q, settings, disabled: srdf.disabled_pairs })
}

/// The left arm of the shipped robot. Pairs that move together or touch in most configurations are disabled.
fn curi() -> Robot {
    let path: PathBuf = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenarios/robots/curi.yaml");
    let model = RobotModel::load(&path).unwrap();
    let settings = CollisionSettings { arm_excess_m: 0.008, hand_excess_m: 0.008, clearance_m: 0.005, self_clearance_m: 0.0 };
    let (tree, chain, rest_q) = (model.tree, model.left.chain, model.home_q);
    let mut robot = Robot { tree, chain, rest_q, settings, disabled: BTreeSet::new() };
    let n_links = robot.tree.links.len();
    let mut disabled = BTreeSet::new();
    let name = |idx: usize| robot.tree.links[idx].name.clone();
    for a in 0..n_links {
        for b in (0..a).filter(|b| carrier(&robot, *b) == carrier(&robot, a)) {
            disabled.insert((name(a), name(b)));
        }
    }
    let n_samples = 40;
    let mut rng = ChaCha8Rng::seed_from_u64(0);
    let judge = Judge::new(&robot);
    let mut counts = vec![vec![0; n_links]; n_links];
    for _ in 0..n_samples {
        let placed = judge.placed(&random_q(&robot.chain, &mut rng));
        for (nth, (a, balls)) in placed.iter().enumerate() {
            let mut touched = BTreeSet::new();
            for (centre, radius) in balls {
                touched.extend(judge.still.iter().filter(|(_, own)| own.gap_m(centre, *radius, 1.0) < 0.0).map(|(b, _)| *b));
                let meets = |others: &[(Point, f64)]| others.iter().any(|(other, r)| (centre - other).norm() < radius + r);
                touched.extend(placed[..nth].iter().filter(|(_, others)| meets(others)).map(|(b, _)| *b));
            }
            touched.into_iter().for_each(|b| counts[*a][b] += 1);
        }
    }
    for (a, row) in counts.iter().enumerate() {
        disabled.extend(row.iter().enumerate().filter(|(_, n)| 2 * **n > n_samples).map(|(b, _)| (name(a), name(b))));
    }
    robot.disabled = disabled;
    robot
}

/// Boxes, cylinders, capsules and balls anywhere in reach.
fn obstacles(rng: &mut ChaCha8Rng) -> Vec<Obstacle> {
    let one = |idx: usize| {
        let mut size = |low: f64, high: f64| rng.random_range(low..high);
        let shape = match idx % 4 {
            0 => Shape::Cuboid { half_extents_m: Vector3::new(size(0.005, 0.08), size(0.005, 0.08), size(0.005, 0.08)) },
            1 => Shape::Cylinder { radius_m: size(0.01, 0.05), half_length_m: size(0.01, 0.1) },
            2 => Shape::Capsule { radius_m: size(0.01, 0.05), half_length_m: size(0.01, 0.1) },
            _ => Shape::Sphere { radius_m: size(0.01, 0.06) },
        };
        let at = Vector3::new(size(-0.9, 0.9), size(-0.9, 0.9), size(-0.1, 1.5));
        let turn = Vector3::new(size(-3.0, 3.0), size(-3.0, 3.0), size(-3.0, 3.0));
        Obstacle { name: format!("obstacle {idx}"), shape, pose_in_base: Pose::new(at, turn) }
    };
    (0..N_OBSTACLES).map(one).collect()
}

fn check(name: &str, robot: &Robot, n: usize, seed: u64) {
    let judge = Judge::new(robot);
    let pairs = SelfPairs::AllBut(robot.disabled.clone());
    let empty =
        CollisionModel::of_tree(&robot.tree, robot.chain.clone(), None, &robot.rest_q, pairs, robot.settings.clone()).unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let all_levels = levels::all();
    let (mut n_free, mut n_close, mut n_in_band, mut n_band_differ, mut n_levels_differ) = (0, 0, 0, 0, 0);
    let mut judged = 0;
    while judged < n {
        let world = obstacles(&mut rng);
        let mut collision = empty.clone();
        collision.set_world(&world, None);
        let exact: Vec<Exact> = world.iter().map(|o| Exact::new(&o.shape, &o.pose_in_base)).collect();
        for _ in 0..(N_IN_SCENE.min(n - judged)).div_ceil(N_LANES) {
            let eight: [Vec<f64>; N_LANES] = std::array::from_fn(|_| random_q(&robot.chain, &mut rng));
            let mut touches = [false; N_LANES];
            for (q, touches) in eight.iter().zip(&mut touches) {
                let gap_m = judge.gap_m(q, &exact);
                let lanes: Vec<Lanes> = q.iter().map(|value| Lanes::splat(*value as f32)).collect();
                let verdicts = all_levels.map(|(_, _, level)| level(collision.batch(), &lanes));
                *touches = verdicts[0];
                n_levels_differ += usize::from(verdicts.iter().any(|verdict| *verdict != verdicts[0]));
                let agrees = verdicts.iter().all(|verdict| *verdict == (gap_m < 0.0));
                assert!(agrees || gap_m.abs() <= BAND_M, "{name} at {q:?}: gap {gap_m:e} m by parry, {verdicts:?} by lanes");
                n_free += usize::from(gap_m > 0.0);
                n_close += usize::from(gap_m.abs() < 1e-4);
                n_in_band += usize::from(gap_m.abs() <= BAND_M);
                n_band_differ += usize::from(!agrees);
            }
            // Eight different ones together: any of them.
            for (level, _, verdict) in all_levels {
                let together = verdict(collision.batch(), &levels::lanes(&eight));
                assert_eq!(together, touches.contains(&true), "{name}, {level}: eight together at {eight:?}");
            }
            judged += N_LANES;
        }
    }
    let present: Vec<&str> = all_levels.iter().filter(|level| level.1).map(|level| level.0).collect();
    eprintln!(
        "{name}, seed {seed}: {judged} configurations, {n_free} free, {n_close} with a gap below 0.1 mm; none differs from parry \
         beyond {BAND_M:e} m ({n_in_band} nearer, {n_band_differ} of them differ); levels {}: {n_levels_differ} differ",
        present.join(", ")
    );
    assert!(n_free * 10 > judged && n_free * 10 < judged * 9, "{n_free} of {judged} free: a test of both verdicts");
}

#[test]
fn lanes_and_parry_give_the_same_verdicts() {
    check("shipped robot", &curi(), 400, 1);
    if let Some(panda) = panda() {
        check("Panda", &panda, 4000, 1);
    }
}

#[test]
#[ignore = "minutes: the full count"]
fn lanes_and_parry_give_the_same_verdicts_100_000_times() {
    check("shipped robot", &curi(), 100_000, 2);
    if let Some(panda) = panda() {
        check("Panda", &panda, 100_000, 2);
    }
}

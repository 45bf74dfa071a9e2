//! Whole motions of the shipped robot: around obstacles, on straight ways, within limits.
#![allow(clippy::unwrap_used, clippy::print_stderr, reason = "tests fail by panicking and tell what they measured")]

use nalgebra::{Translation3, UnitQuaternion, Vector3};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use sfg_kinematics::ik::random_q;
use sfg_kinematics::{IkSettings, IkSolver, RobotModel, Shape};
use sfg_planning::{
    BodyGroup, CartesianOutcome, CartesianSettings, CartesianStop, CollisionModel, CollisionSettings, Obstacle, PlanOutcome,
    Planner, PointObstacles, RrtConnect, RrtSettings, TimingSettings, cartesian_path, retime, verify_exact,
};
use sfg_types::{HandSide, JointTrajectory, Point, Pose};
use std::path::Path;

const ACCEPTANCE: f64 = 1.0 / 512.0;

fn curi() -> RobotModel {
    RobotModel::load(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenarios/robots/curi.yaml")).unwrap()
}

fn collision(model: &RobotModel, side: HandSide) -> CollisionModel {
    CollisionModel::new(model, side, &model.home_q, CollisionSettings::default()).unwrap()
}

fn table() -> Obstacle {
    let shape = Shape::Cuboid { half_extents_m: Vector3::new(0.35, 0.7, 0.02) };
    Obstacle { name: "table".to_owned(), shape, pose_in_base: Pose::translation(0.8, 0.0, 0.73) }
}

fn post(name: &str, x: f64, y: f64) -> Obstacle {
    let shape = Shape::Cylinder { radius_m: 0.03, half_length_m: 0.15 };
    Obstacle { name: name.to_owned(), shape, pose_in_base: Pose::translation(x, y, 0.9) }
}

/// Palm facing direction `yaw` in the horizontal plane, left thumb up: palm X is that direction turned by a quarter turn.
fn side_grasp(x: f64, y: f64, z: f64, yaw: f64) -> Pose {
    let facing = Vector3::new(yaw.cos(), yaw.sin(), 0.0);
    let fingers = Vector3::new(-yaw.sin(), yaw.cos(), 0.0);
    let columns = nalgebra::Matrix3::from_columns(&[fingers, facing.cross(&fingers), facing]);
    Pose::from_parts(Translation3::new(x, y, z), UnitQuaternion::from_matrix(&columns))
}

/// Free configurations whose palm is at `target`.
fn goals(model: &RobotModel, collision: &CollisionModel, target: &Pose) -> Vec<Vec<f64>> {
    let arm = &model.left;
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut all = IkSolver::solve_several(&arm.chain, target, &arm.home_q, 12, &IkSettings::default(), &mut rng);
    all.retain(|q| collision.is_free(q));
    all
}

#[test]
fn both_arms_are_free_at_home_and_the_hands_are_mirrored() {
    let model = curi();
    for side in [HandSide::Left, HandSide::Right] {
        let mut collision = collision(&model, side);
        collision.set_world(&[table()], None);
        let contact = collision.contact(&model.arm(side).home_q);
        assert_eq!(contact.map(|c| c.to_string()), None);
    }
    let [l, r] = [&model.left, &model.right].map(|arm| arm.chain.fk(&arm.home_q));
    assert!((l.translation.x - r.translation.x).abs() < 1e-5 && (l.translation.y + r.translation.y).abs() < 1e-5);
    assert!((l.translation.z - r.translation.z).abs() < 1e-5);
    let (l, r) = (l.rotation * Vector3::z(), r.rotation * Vector3::z());
    assert!((l.x - r.x).abs() + (l.y + r.y).abs() + (l.z - r.z).abs() < 1e-4, "palms {l} {r}");
}

#[test]
fn contacts_name_both_things_and_permissions_silence_them() {
    let model = curi();
    let mut collision = collision(&model, HandSide::Left);
    let q = model.left.home_q.clone();
    let palm = model.left.chain.fk(&q);
    let ball = Obstacle { name: "ball".to_owned(), shape: Shape::Sphere { radius_m: 0.02 }, pose_in_base: palm };
    collision.set_world(&[ball], None);
    let contact = collision.contact(&q).unwrap();
    assert!(contact.link.starts_with("left_") && contact.with == "ball" && contact.depth_m > 0.01, "{contact}");
    collision.allow(BodyGroup::Hand, "ball");
    assert_eq!(collision.contact(&q), None);
    collision.clear_allowed();
    assert!(!collision.is_free(&q));
    collision.set_world(&[], Some(PointObstacles::new(vec![palm.translation.vector.into()], 0.005)));
    assert_eq!(collision.contact(&q).unwrap().with, "points");
    // A held rod reaches what the hand does not.
    collision.set_world(&[Obstacle { pose_in_base: palm * Translation3::new(0.0, 0.0, 0.3), ..post("post", 0.0, 0.0) }], None);
    let alone = collision.is_free(&q);
    collision.attach("rod", &[(Point::new(0.0, 0.0, 0.05), 0.02), (Point::new(0.0, 0.0, 0.29), 0.02)]);
    let contact = collision.contact(&q).unwrap();
    assert!(alone && contact.link == "rod" && contact.with == "post", "{contact}");
    collision.detach();
    assert!(collision.is_free(&q));
}

#[test]
fn folded_arms_touch_themselves_and_the_torso() {
    let model = curi();
    let collision = collision(&model, HandSide::Left);
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    let (mut own, mut body, mut free) = (0, 0, 0);
    for _ in 0..500 {
        match collision.contact(&random_q(collision.chain(), &mut rng)) {
            None => free += 1,
            Some(c) if c.with.starts_with("panda_left") => own += 1,
            Some(_) => body += 1,
        }
    }
    eprintln!("of 500 random configurations {free} are free, {own} touch themselves, {body} touch the rest of the robot");
    assert!(own > 5 && body > 20 && free > 150);
}

#[test]
fn plans_go_around_posts_and_pass_every_check() {
    let model = curi();
    let mut collision = collision(&model, HandSide::Left);
    collision.set_world(&[table(), post("near post", 0.5, 0.35), post("far post", 0.72, -0.1)], None);
    let target = side_grasp(0.62, 0.17, 0.9, -1.2);
    let goals = goals(&model, &collision, &target);
    assert!(!goals.is_empty(), "the grasp is reachable");
    let start = &model.left.home_q;
    let mut n_bent = 0;
    for seed in 0..5 {
        let began = std::time::Instant::now();
        let path = match RrtConnect::default().plan(&collision, start, &goals, seed) {
            PlanOutcome::Found(path) => path,
            other => panic!("{other:?}"),
        };
        let planned = began.elapsed();
        assert_eq!(&path[0], start);
        assert!(goals.contains(path.last().unwrap()));
        assert_eq!(collision.contact_along(&path, ACCEPTANCE), None);
        assert_eq!(verify_exact(&model, HandSide::Left, &model.home_q, &collision, &path, 0.02), None);
        n_bent += usize::from(path.len() > 2);
        let settings = TimingSettings { speed_fraction: 1.0, sample_period_secs: 0.001, ..TimingSettings::default() };
        let trajectory = retime(&path, collision.chain(), &settings, Some(&collision)).unwrap();
        eprintln!(
            "seed {seed}: plan {planned:?}, all {:?}, {} corners, {:.2} s",
            began.elapsed(),
            path.len(),
            trajectory.duration_secs()
        );
        assert_within_limits(&model, &trajectory, 1.0);
        assert!(trajectory.q.iter().all(|q| collision.is_free(q)), "rounded corners stay free");
        // Same seed, same bytes.
        assert_eq!(RrtConnect::default().plan(&collision, start, &goals, seed), PlanOutcome::Found(path));
    }
    assert!(n_bent > 0, "the direct way is blocked");
}

#[test]
fn hopeless_requests_say_why() {
    let model = curi();
    let mut collision = collision(&model, HandSide::Left);
    let home = model.left.home_q.clone();
    let at = |q: &[f64]| Obstacle {
        name: "ball".to_owned(),
        shape: Shape::Sphere { radius_m: 0.05 },
        pose_in_base: model.left.chain.fk(q),
    };
    let mut goal = home.clone();
    goal[0] -= 0.8;
    let planner = RrtConnect { settings: RrtSettings { max_iterations: 50, ..RrtSettings::default() } };
    collision.set_world(&[at(&home)], None);
    assert!(
        matches!(planner.plan(&collision, &home, &[goal.clone()], 0), PlanOutcome::StartInCollision { contact } if contact.with == "ball")
    );
    collision.set_world(&[at(&goal)], None);
    assert!(matches!(planner.plan(&collision, &home, &[goal.clone()], 0), PlanOutcome::GoalInCollision { goal_idx: 0, .. }));
    let mut outside = home.clone();
    outside[3] = 0.5;
    let outcome = planner.plan(&collision, &home, &[outside], 0);
    assert!(
        matches!(&outcome, PlanOutcome::OutsideLimits { joint, value, .. } if joint == "panda_left_joint4" && *value == 0.5),
        "{outcome:?}"
    );
    assert_eq!(planner.plan(&collision, &home, &[], 0), PlanOutcome::NotFound { iterations: 0 });
    // A cage about the hand: the way out is closed.
    let palm = model.left.chain.fk(&home).translation;
    let walls = (0..6).map(|i| {
        let mut half = Vector3::repeat(0.35);
        half[i / 2] = 0.005;
        let mut offset = Vector3::zeros();
        offset[i / 2] = if i % 2 == 0 { 0.35 } else { -0.35 };
        Obstacle {
            name: format!("wall {i}"),
            shape: Shape::Cuboid { half_extents_m: half },
            pose_in_base: Pose::from_parts((palm.vector + offset).into(), UnitQuaternion::identity()),
        }
    });
    collision.set_world(&walls.collect::<Vec<_>>(), None);
    for i in 0..6 {
        collision.allow(BodyGroup::Arm, &format!("wall {i}"));
    }
    let mut far = home.clone();
    far[0] -= 1.6;
    assert_eq!((collision.contact(&home), collision.contact(&far)), (None, None), "the cage touches nothing at either end");
    assert!(matches!(planner.plan(&collision, &home, &[far], 0), PlanOutcome::NotFound { iterations: 50 }));
}

#[test]
fn straight_motions_stay_on_their_line() {
    let model = curi();
    let mut collision = collision(&model, HandSide::Left);
    collision.set_world(&[table()], None);
    let chain = collision.chain().clone();
    let pregrasp = side_grasp(0.55, 0.3, 0.9, -1.2);
    let start = goals(&model, &collision, &pregrasp).into_iter().next().unwrap();
    let from = chain.fk(&start);
    let approach = from * Translation3::new(0.0, 0.0, 0.08);
    let lift = Pose::from_parts((approach.translation.vector + Vector3::z() * 0.12).into(), approach.rotation);
    let path = match cartesian_path(&chain, &start, &[approach, lift], &CartesianSettings::default(), Some(&collision)) {
        CartesianOutcome::Found(path) => path,
        other => panic!("{other:?}"),
    };
    let end = chain.fk(path.last().unwrap());
    assert!((end.translation.vector - lift.translation.vector).norm() < 2e-5 && end.rotation.angle_to(&lift.rotation) < 2e-5);
    let settings = TimingSettings { sample_period_secs: 0.001, ..TimingSettings::cartesian(0.3) };
    let trajectory = retime(&path, &chain, &settings, Some(&collision)).unwrap();
    assert_within_limits(&model, &trajectory, 0.3);
    let off_line = |p: Vector3<f64>, a: Vector3<f64>, b: Vector3<f64>| {
        let t = ((p - a).dot(&(b - a)) / (b - a).norm_squared()).clamp(0.0, 1.0);
        (p - a - (b - a) * t).norm()
    };
    let [a, b, c] = [from, approach, lift].map(|p| p.translation.vector);
    for q in &trajectory.q {
        let p = chain.fk(q).translation.vector;
        let off = off_line(p, a, b).min(off_line(p, b, c));
        assert!(off < 0.002, "{off} m beside the line");
    }
}

#[test]
fn straight_motions_that_end_early_say_where_and_why() {
    let model = curi();
    let mut collision = collision(&model, HandSide::Left);
    collision.set_world(&[table()], None);
    let chain = collision.chain().clone();
    let start = goals(&model, &collision, &side_grasp(0.55, 0.3, 0.95, -1.2)).into_iter().next().unwrap();
    let from = chain.fk(&start);
    let down = Pose::from_parts((from.translation.vector - Vector3::z() * 0.3).into(), from.rotation);
    match cartesian_path(&chain, &start, &[down], &CartesianSettings::default(), Some(&collision)) {
        CartesianOutcome::Stopped { waypoint_idx: 0, share, stop: CartesianStop::Collision(contact), path } => {
            assert!(contact.with == "table" && share > 0.1 && share < 0.9, "{contact} at {share}");
            assert!(path.len() > 1 && collision.contact_along(&path, ACCEPTANCE).is_none());
        }
        other => panic!("{other:?}"),
    }
    let away = Pose::from_parts((from.translation.vector + Vector3::x() * 3.0).into(), from.rotation);
    match cartesian_path(&chain, &start, &[from, away], &CartesianSettings::default(), None) {
        CartesianOutcome::Stopped { waypoint_idx: 1, share, stop, .. } => {
            assert!(share > 0.0 && share < 0.5);
            assert!(!matches!(stop, CartesianStop::Collision(_)), "{stop:?}");
        }
        other => panic!("{other:?}"),
    }
}

#[test]
fn no_random_path_breaks_a_limit_at_one_kilohertz() {
    let model = curi();
    let chain = &model.left.chain;
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let mut share: f64 = 0.0;
    for case in 0..40 {
        let n = 2 + case % 5;
        let path: Vec<Vec<f64>> = (0..n).map(|_| random_q(chain, &mut rng)).collect();
        let fraction = if case % 2 == 0 { 1.0 } else { 0.4 };
        let settings = TimingSettings { speed_fraction: fraction, sample_period_secs: 0.001, ..TimingSettings::default() };
        let trajectory = retime(&path, chain, &settings, None).unwrap();
        share = share.max(assert_within_limits(&model, &trajectory, fraction));
        let ends = [(trajectory.q.first(), path.first()), (trajectory.q.last(), path.last())];
        for (a, b) in ends {
            assert!(a.unwrap().iter().zip(b.unwrap()).all(|(a, b)| (a - b).abs() < 1e-9));
        }
    }
    assert!(share > 0.9, "the limits are used: at most {share}");
    // No motion is a trajectory of one sample.
    let rest = retime(&[chain.middle(), chain.middle()], chain, &TimingSettings::default(), None).unwrap();
    assert_eq!((rest.duration_secs(), rest.q), (0.0, vec![chain.middle()]));
}

/// Differences at the samples' spacing against the limits; returns the largest share of a velocity or acceleration limit used.
#[track_caller]
fn assert_within_limits(model: &RobotModel, trajectory: &JointTrajectory, fraction: f64) -> f64 {
    let limits = &model.left.chain.limits;
    let mut share: f64 = 0.0;
    for i in 0..trajectory.q.len() {
        for (j, l) in limits.iter().enumerate() {
            let q = trajectory.q[i][j];
            assert!(q >= l.lower - 1e-6 && q <= l.upper + 1e-6, "joint {j} at {q}");
            let dq = trajectory.dq[i][j].abs() / (l.velocity * fraction);
            assert!(dq <= 1.0 + 1e-9, "joint {j}: {dq} of the velocity limit");
            share = share.max(dq);
            if i > 0 {
                let dt = trajectory.stamps_secs[i] - trajectory.stamps_secs[i - 1];
                let ddq = (trajectory.dq[i][j] - trajectory.dq[i - 1][j]).abs() / dt / (l.acceleration * fraction);
                assert!(ddq <= 1.0 + 1e-6, "joint {j}: {ddq} of the acceleration limit at sample {i} of {}", trajectory.q.len());
                share = share.max(ddq);
                let step = (trajectory.q[i][j] - trajectory.q[i - 1][j]) / dt;
                let mean = 0.5 * (trajectory.dq[i][j] + trajectory.dq[i - 1][j]);
                assert!((step - mean).abs() < 0.01 * l.velocity, "joint {j}: velocities are not the positions' derivative");
            }
            if i > 1 {
                let dt = 0.001;
                let dddq = trajectory.dq[i][j] - 2.0 * trajectory.dq[i - 1][j] + trajectory.dq[i - 2][j];
                assert!(
                    dddq.abs() / dt / dt <= l.jerk * fraction * 1.001 + 1e-6,
                    "joint {j}: jerk {} at sample {i}",
                    dddq / dt / dt
                );
            }
        }
    }
    assert!(trajectory.dq.last().unwrap().iter().all(|v| *v == 0.0), "ends at rest");
    share
}

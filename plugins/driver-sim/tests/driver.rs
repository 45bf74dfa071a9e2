//! Rules of a run that the driver must keep: sensors in, commands out; rest from any state.
#![allow(clippy::unwrap_used, reason = "tests fail by panicking")]

use nalgebra::Vector3;
use sfg_driver_sim::{JudgeHandle, SimDriver, SimOptions};
use sfg_kinematics::RobotModel;
use sfg_plugin::Driver;
use sfg_types::{HandCommand, HandSide, Observation, RobotCommand, RobotState};
use sfg_world::{ObjectSpec, SceneSpec, TruthPoison, load_object_model};
use std::path::{Path, PathBuf};

fn scenarios() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenarios")
}

fn driver(options: SimOptions) -> (SimDriver, JudgeHandle, Vec<f64>) {
    let robot = RobotModel::load(&scenarios().join("robots/curi.yaml")).unwrap();
    let model = load_object_model(&scenarios().join("objects/mug.yaml")).unwrap();
    let scene = SceneSpec {
        objects: vec![ObjectSpec::from_model("mug", &model, [0.5; 3], 0.65, 0.1, 0.4).unwrap()],
        seed: 11,
        ..SceneSpec::default()
    };
    let (driver, judge) = SimDriver::new(&scene, &robot, HandSide::Left, options).unwrap();
    (driver, judge, robot.left.home_q)
}

/// Moves all joints at `dq` and the hand towards half closed, one period.
fn drive(driver: &mut SimDriver, q: &mut [f64], dq: f64) {
    q.iter_mut().for_each(|q| *q += dq * 0.004);
    let hand = HandCommand { synergy: 0.5, manipulation: 0.1 };
    driver.command(&RobotCommand { side: HandSide::Left, q: q.to_vec(), dq: vec![dq; q.len()], hand }).unwrap();
    driver.advance().unwrap();
}

fn sensors(poison: Option<TruthPoison>) -> (Vec<RobotState>, Observation) {
    let (mut driver, judge, mut q) = driver(SimOptions::default());
    let view = poison.map(|poison| judge.clone().poisoned(poison));
    let honest = judge.truth();
    let states = (0..40).map(|_| {
        drive(&mut driver, &mut q, 0.1);
        if let Some(view) = &view {
            assert_ne!(view.truth(), judge.truth());
        }
        driver.state().unwrap()
    });
    let states = states.collect();
    assert!(
        view.is_none_or(|view| view.truth().objects[0].base_from_object.translation.x
            > honest.objects[0].base_from_object.translation.x + 0.9)
    );
    (states, driver.observe().unwrap())
}

#[test]
fn a_poisoned_truth_view_changes_nothing_that_the_driver_tells() {
    let poison = TruthPoison { shift_m: Vector3::new(1.0, 0.0, 0.0), rotate_labels: 1 };
    assert_eq!(sensors(None), sensors(Some(poison)));
}

#[test]
fn cut_cameras_fail() {
    let (mut driver, ..) = driver(SimOptions { cut_cameras: true, ..SimOptions::default() });
    assert!(driver.observe().unwrap_err().to_string().contains("camera"));
    driver.state().unwrap();
}

#[test]
fn an_object_moved_after_loading_is_seen_elsewhere() {
    let (mut driver, judge, _) = driver(SimOptions::default());
    let before = driver.observe().unwrap();
    judge.displace_object("mug", 0.05, 0.0, 0.0).unwrap();
    driver.advance().unwrap();
    assert_eq!(judge.tampered(), None);
    let after = driver.observe().unwrap();
    // The mug alone stands high above the table: the mean of its points moves with it.
    let mean_x = |observation: &Observation| {
        let view = &observation.views[0];
        let width = view.intrinsics.width;
        let points: Vec<f64> = (0..view.depth_m.len())
            .filter(|&idx| view.depth_m[idx] > 0.0)
            .map(|idx| {
                let seen = view.intrinsics.deproject((idx % width) as f64, (idx / width) as f64, f64::from(view.depth_m[idx]));
                view.base_from_camera * seen
            })
            .filter(|p| p.z > 0.78 && p.z < 0.95 && p.x > 0.45 && p.x < 0.9 && p.y > -0.1 && p.y < 0.3)
            .map(|p| p.x)
            .collect();
        assert!(points.len() > 200, "the mug is seen in {} pixels", points.len());
        points.iter().sum::<f64>() / points.len() as f64
    };
    let moved = mean_x(&after) - mean_x(&before);
    assert!((moved - 0.05).abs() < 0.01, "seen to move by {moved} m");
}

#[test]
fn time_passes_only_when_advanced() {
    let (mut driver, ..) = driver(SimOptions::default());
    let before = driver.state().unwrap();
    driver.observe().unwrap();
    driver.stop().unwrap();
    assert_eq!(driver.state().unwrap(), before);
    driver.advance().unwrap();
    assert!((driver.state().unwrap().stamp_secs - before.stamp_secs - driver.info().period_secs).abs() < 1e-12);
}

#[test]
fn stop_brings_a_moving_arm_to_rest_and_holds_from_any_state() {
    let (mut driver, _, mut q) = driver(SimOptions::default());
    let speed = |driver: &mut SimDriver| driver.state().unwrap().dq.iter().fold(0.0, |worst: f64, v| worst.max(v.abs()));
    // At rest: nothing moves.
    driver.stop().unwrap();
    driver.advance().unwrap();
    assert!(speed(&mut driver) < 0.01);
    // Moving: a ramp, not a jerk, twice asked for.
    for _ in 0..100 {
        drive(&mut driver, &mut q, 0.3);
    }
    assert!(speed(&mut driver) > 0.25);
    driver.stop().unwrap();
    driver.advance().unwrap();
    let first = driver.state().unwrap();
    assert!(first.dq.iter().all(|v| *v > 0.1), "no joint stands still after one period: {:?}", first.dq);
    driver.stop().unwrap();
    for _ in 0..50 {
        driver.advance().unwrap();
    }
    let rest = driver.state().unwrap();
    assert!(speed(&mut driver) < 0.005, "{:?}", rest.dq);
    for _ in 0..100 {
        driver.advance().unwrap();
    }
    let drift = driver.state().unwrap().q.iter().zip(&rest.q).fold(0.0, |worst: f64, (a, b)| worst.max((a - b).abs()));
    assert!(drift < 1e-3, "drifts by {drift} rad");
    // A new motion may begin where the arm stands.
    q = rest.q;
    drive(&mut driver, &mut q, 0.0);
    drive(&mut driver, &mut q, 0.1);
}

#[test]
fn a_moving_arm_without_new_commands_comes_to_rest() {
    let (mut driver, _, mut q) = driver(SimOptions::default());
    for _ in 0..50 {
        drive(&mut driver, &mut q, 0.3);
    }
    for _ in 0..50 {
        driver.advance().unwrap();
    }
    assert!(driver.state().unwrap().dq.iter().all(|v| v.abs() < 0.005));
}

#[track_caller]
fn check_refused(mend: impl Fn(&mut RobotCommand), expected: &str) {
    let (mut driver, _, q) = driver(SimOptions::default());
    let mut command = RobotCommand { side: HandSide::Left, dq: vec![0.0; q.len()], q, hand: HandCommand::default() };
    driver.command(&command).unwrap();
    mend(&mut command);
    let message = driver.command(&command).unwrap_err().to_string();
    assert!(message.contains(expected), "{message}");
}

#[test]
fn impossible_commands_are_refused() {
    check_refused(|c| c.side = HandSide::Right, "right arm");
    check_refused(|c| c.q.truncate(6), "6 positions");
    check_refused(|c| c.q[3] = f64::NAN, "joint 3");
    check_refused(|c| c.q[1] = 9.0, "leaves its limits");
    check_refused(|c| c.dq[0] = -40.0, "exceeds its limit");
    check_refused(|c| c.q[0] += 0.2, "would jump");
    check_refused(|c| c.hand.synergy = f64::INFINITY, "hand command");
}

//! Torques of timed motions, and motions through waypoints.
#![allow(clippy::unwrap_used, clippy::print_stderr, reason = "tests fail by panicking and tell what they measured")]

use nalgebra::Vector3;
use sfg_kinematics::{Dynamics, GRAVITY, Payload, RobotModel};
use sfg_planning::{PlanningError, TimingSettings, TorqueLimits, retime};
use sfg_types::{HandSide, JointTrajectory, Pose, Vector};
use std::path::Path;

const SIDE: HandSide = HandSide::Left;
const PERIOD_SECS: f64 = 0.001;

fn curi() -> RobotModel {
    RobotModel::load(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenarios/robots/curi.yaml")).unwrap()
}

fn settings(model: &RobotModel, payload_kg: f64, fraction: f64) -> TimingSettings {
    let dynamics = Dynamics::new(&model.tree, model.arm_chain(SIDE), &model.home_q).unwrap();
    let dynamics = dynamics.with_payload(&Payload { mass_kg: payload_kg, centre_in_tip_m: CENTRE });
    let torque = Some(TorqueLimits { dynamics, fraction });
    TimingSettings { speed_fraction: 1.0, sample_period_secs: PERIOD_SECS, torque, ..TimingSettings::default() }
}

/// Centre of the payload in the palm frame.
const CENTRE: Vector = Vector::new(0.0, 0.0, 0.05);

/// A swing to the side, as fast as the arm may.
fn path(model: &RobotModel) -> Vec<Vec<f64>> {
    let home = model.left.home_q.clone();
    let mut there = home.clone();
    there[0] -= 0.9;
    vec![home, there]
}

/// Every body with a mass that the arm may move: mass, inertia about its centre, and its frame in a configuration of the arm.
fn bodies(model: &RobotModel, q: &[f64], payload_kg: f64) -> Vec<(f64, nalgebra::Matrix3<f64>, Pose)> {
    let poses = model.link_poses(&model.q_with_arm(SIDE, q));
    let of_link = |(link, pose): (&sfg_kinematics::Link, &Pose)| {
        (link.inertial.mass_kg, link.inertial.inertia, pose * link.inertial.link_from_inertia)
    };
    let mut all: Vec<_> = model.tree.links.iter().zip(&poses).map(of_link).collect();
    let palm = model.arm_chain(SIDE).fk(q);
    all.push((payload_kg, nalgebra::Matrix3::zeros(), palm * nalgebra::Translation3::from(CENTRE)));
    all
}

/// Largest share of a joint's effort limit in the executed log, every `stride` samples.
///
/// By virtual work: accelerations of all bodies are differences of the log, their directions differences of the tree's kinematics.
/// Shares no formula with `Dynamics`.
fn largest_share(model: &RobotModel, log: &JointTrajectory, payload_kg: f64, stride: usize) -> f64 {
    let chain = model.arm_chain(SIDE);
    let turn = |a: &Pose, b: &Pose| (b.rotation * a.rotation.inverse()).scaled_axis();
    let mut largest = 0.0_f64;
    for i in (1..log.q.len() - 1).step_by(stride) {
        let [before, now, after] = [i - 1, i, i + 1].map(|i| bodies(model, &log.q[i], payload_kg));
        // Force and moment on each body.
        let loads: Vec<(Vector, Vector)> = before
            .iter()
            .zip(&now)
            .zip(&after)
            .map(|((a, b), c)| {
                let acceleration =
                    (c.2.translation.vector - 2.0 * b.2.translation.vector + a.2.translation.vector) / PERIOD_SECS.powi(2);
                let (first, second) = (turn(&a.2, &b.2), turn(&b.2, &c.2));
                let (omega, alpha) = ((first + second) / (2.0 * PERIOD_SECS), (second - first) / PERIOD_SECS.powi(2));
                let rotation = b.2.rotation.to_rotation_matrix().into_inner();
                let inertia = rotation * b.1 * rotation.transpose();
                (b.0 * (acceleration + Vector3::z() * GRAVITY), inertia * alpha + omega.cross(&(inertia * omega)))
            })
            .collect();
        for (joint, limits) in chain.limits.iter().enumerate() {
            let h = 1e-5;
            let (mut low, mut high) = (log.q[i].clone(), log.q[i].clone());
            low[joint] -= h;
            high[joint] += h;
            let (low, high) = (bodies(model, &low, payload_kg), bodies(model, &high, payload_kg));
            let work: f64 = low
                .iter()
                .zip(&high)
                .zip(&loads)
                .map(|((a, b), (force, moment))| {
                    (b.2.translation.vector - a.2.translation.vector).dot(force) + turn(&a.2, &b.2).dot(moment)
                })
                .sum();
            largest = largest.max((work / (2.0 * h)).abs() / limits.effort);
        }
    }
    largest
}

#[test]
fn a_heavy_payload_slows_the_motion_and_torques_stay_within_the_limits() {
    let model = curi();
    let (path, chain) = (path(&model), model.arm_chain(SIDE));
    let fraction = 0.95;
    let mut durations = Vec::new();
    for payload_kg in [0.0, 2.0, 4.0] {
        let within = retime(&path, chain, &settings(&model, payload_kg, fraction), None).unwrap();
        let free =
            retime(&path, chain, &TimingSettings { torque: None, ..settings(&model, payload_kg, fraction) }, None).unwrap();
        let share = largest_share(&model, &within, payload_kg, 7);
        let unlimited = largest_share(&model, &free, payload_kg, 7);
        eprintln!(
            "{payload_kg} kg: {:.3} s with at most {:.1} % of the effort; {:.3} s and {:.1} % without the limit",
            within.duration_secs(),
            100.0 * share,
            free.duration_secs(),
            100.0 * unlimited
        );
        assert!(share <= fraction * 1.001, "{payload_kg} kg: {share}");
        // A motion that is slowed by its torques uses them.
        if within.duration_secs() > free.duration_secs() + 2.0 * PERIOD_SECS {
            assert!(unlimited > fraction && share > 0.9 * fraction, "{payload_kg} kg: slowed to {share} for {unlimited}");
        } else {
            assert!(unlimited <= fraction * 1.02, "{payload_kg} kg: {unlimited} and not slowed");
        }
        durations.push(within.duration_secs());
    }
    assert!(durations[2] > 1.1 * durations[0], "{durations:?}");
}

#[test]
fn a_weight_that_no_motor_holds_is_refused_with_the_joint() {
    let model = curi();
    let error = retime(&path(&model), model.arm_chain(SIDE), &settings(&model, 30.0, 1.0), None).unwrap_err();
    let PlanningError::TooHeavy { joint, torque_nm, limit_nm, payload_kg, .. } = &error else { panic!("{error}") };
    assert!(joint.starts_with("panda_left_joint") && *torque_nm > *limit_nm && *payload_kg == 30.0, "{error}");
    let text = error.to_string();
    assert!(text.contains(joint.as_str()) && text.contains("30.00 kg") && text.contains("carry less"), "{text}");
}

#[test]
fn a_motion_through_waypoints_keeps_moving_and_passes_them_closely() {
    let model = curi();
    let home = model.left.home_q.clone();
    // Five waypoints, right angles and a sharp turn among them.
    let steps: [[f64; 7]; 6] = [
        [0.5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        [0.0, -0.4, 0.3, 0.0, 0.0, 0.0, 0.0],
        [0.0, 0.0, 0.0, 0.5, 0.3, 0.0, 0.0],
        [-0.3, 0.0, 0.0, -0.5, 0.0, 0.2, 0.0],
        [0.0, 0.3, 0.0, 0.0, -0.4, 0.0, 0.5],
        [0.2, 0.0, -0.3, 0.4, 0.0, 0.0, 0.0],
    ];
    let mut path = vec![home];
    for step in steps {
        let last = path[path.len() - 1].clone();
        path.push(last.iter().zip(step).map(|(q, d)| q + d).collect());
    }
    let norm = |a: &[f64]| a.iter().map(|v| v * v).sum::<f64>().sqrt();
    for half_width in [0.3, 0.1, 0.02] {
        let base = TimingSettings { speed_fraction: 1.0, sample_period_secs: PERIOD_SECS, ..TimingSettings::default() };
        let settings = TimingSettings { corner_half_width_rad: half_width, ..base };
        let motion = retime(&path, model.arm_chain(SIDE), &settings, None).unwrap();
        let (mut farthest, mut slowest) = (0.0_f64, f64::INFINITY);
        for via in &path[1..path.len() - 1] {
            let gap = |q: &[f64]| norm(&q.iter().zip(via).map(|(a, b)| a - b).collect::<Vec<f64>>());
            farthest = farthest.max(motion.q.iter().map(|q| gap(q)).fold(f64::INFINITY, f64::min));
        }
        // Between the first and the last waypoint.
        let near = |via: &[f64]| {
            let gap = |q: &[f64]| q.iter().zip(via).map(|(a, b)| (a - b) * (a - b)).sum::<f64>();
            (0..motion.q.len()).min_by(|a, b| gap(&motion.q[*a]).total_cmp(&gap(&motion.q[*b]))).unwrap()
        };
        let (first, last) = (near(&path[1]), near(&path[path.len() - 2]));
        for dq in &motion.dq[first..=last] {
            slowest = slowest.min(norm(dq));
        }
        eprintln!(
            "half width {half_width} rad: {:.2} s, at most {farthest:.4} rad from a waypoint, {slowest:.3} rad/s or more between",
            motion.duration_secs()
        );
        assert!(farthest <= 0.3125 * half_width + 1e-3, "{farthest} rad from a waypoint");
        assert!(slowest > 0.05, "{slowest} rad/s");
    }
}

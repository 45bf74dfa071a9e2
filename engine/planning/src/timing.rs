//! Gives a path time: as fast as velocity, acceleration and jerk limits of every joint allow with one jerk-limited speed profile.

use crate::collision::CollisionModel;
use crate::error::PlanningError;
use crate::smooth::SmoothPath;
use rsruckig::prelude::*;
use sfg_kinematics::{Chain, Dynamics, JointLimits};
use sfg_types::JointTrajectory;

/// How fast, how round, how dense.
#[derive(Clone, Debug, PartialEq)]
pub struct TimingSettings {
    /// Share of the velocity, acceleration and jerk limits that may be used, above 0, at most 1. Default 0.5.
    pub speed_fraction: f64,
    /// Half width of a rounded corner, joint-space arc length. Default 0.3 rad; 0.02 rad keeps the line of a Cartesian path.
    ///
    /// The motion does not stop at a corner. It passes the corner's configuration at a distance of at most 0.3125 times this (where
    /// the path turns back; 0.22 times at a right angle).
    pub corner_half_width_rad: f64,
    /// Distance of the trajectory's samples. Default 0.004 s, a simulator's control period.
    pub sample_period_secs: f64,
    /// Torques that the motion may need. Default none: torques are not looked at.
    pub torque: Option<TorqueLimits>,
}

/// The arm with what it holds, and what its motors give.
#[derive(Clone, Debug, PartialEq)]
pub struct TorqueLimits {
    /// Masses of the chain that is timed, payload included ([`Dynamics::with_payload`]).
    pub dynamics: Dynamics,
    /// Share of each joint's effort limit that may be used, above 0, at most 1. Joints whose URDF gives no effort are not limited.
    pub fraction: f64,
}

impl Default for TimingSettings {
    fn default() -> Self {
        Self { speed_fraction: 0.5, corner_half_width_rad: 0.3, sample_period_secs: 0.004, torque: None }
    }
}

impl TimingSettings {
    /// For Cartesian paths, whose line matters.
    #[must_use]
    pub fn cartesian(speed_fraction: f64) -> Self {
        Self { speed_fraction, corner_half_width_rad: 0.02, ..Self::default() }
    }
}

/// Limits of the path parameter `u`: rad/s, rad/s^2, rad/s^3.
#[derive(Clone, Copy, Debug)]
struct ProfileLimits {
    velocity: f64,
    acceleration: f64,
    jerk: f64,
}

/// Rounds the corners of a path and times it, from rest to rest.
///
/// A rest-to-rest jerk-limited profile runs over the whole curve. It is made twice, once with its speed bounded by the sharpest
/// corner and once not; each is then stretched in time by the exact factor that brings every joint within its limits, and the
/// shorter one wins. The curve is checked again with `collision`, if given, as rounding leaves the straight ways.
///
/// With [`TimingSettings::torque`] the stretch also keeps the torques within the motors' limits: slower motion needs less torque,
/// but for the weight.
///
/// # Errors
/// [`PlanningError::BadPath`], [`PlanningError::NoRoom`], [`PlanningError::Profile`], and [`PlanningError::TooHeavy`] when the
/// weight alone takes what the motors give.
///
/// # Panics
/// If a fraction or the sample period are out of range, or the torques belong to another chain.
pub fn retime(
    path: &[Vec<f64>],
    chain: &Chain,
    settings: &TimingSettings,
    collision: Option<&CollisionModel>,
) -> Result<JointTrajectory, PlanningError> {
    assert!(settings.speed_fraction > 0.0 && settings.speed_fraction <= 1.0, "the speed fraction lies above 0 and at most at 1");
    assert!(settings.sample_period_secs > 0.0, "the sample period is positive");
    assert!(
        settings.torque.as_ref().is_none_or(|torque| torque.fraction > 0.0 && torque.fraction <= 1.0),
        "the torque fraction lies above 0 and at most at 1"
    );
    let curve = SmoothPath::fitted(path, settings.corner_half_width_rad, chain, collision)?;
    let n_joints = path[0].len();
    if n_joints != chain.n_joints() {
        return Err(PlanningError::BadPath { n_joints: chain.n_joints(), found: format!("configurations of {n_joints}") });
    }
    if curve.length_rad() < 1e-6 {
        let rest = vec![0.0; n_joints];
        return Ok(JointTrajectory { stamps_secs: vec![0.0], q: vec![path[path.len() - 1].clone()], dq: vec![rest] });
    }
    let limits: Vec<JointLimits> = chain.limits.iter().map(|l| scaled(l, settings.speed_fraction)).collect();
    let (straight, bounded) = profile_limits(&curve, &limits);
    let mut best: Option<(Trajectory<1>, f64)> = None;
    for candidate in [straight, bounded] {
        let profile = speed_profile(curve.length_rad(), candidate)?;
        let mut stretch = needed_stretch(&curve, &profile, &limits);
        if let Some(torque) = &settings.torque {
            stretch = stretch.max(stretch_for_torque(&curve, &profile, chain, torque)?);
        }
        if best.as_ref().is_none_or(|(b, s)| profile.get_duration() * stretch < b.get_duration() * s) {
            best = Some((profile, stretch));
        }
    }
    let Some((profile, stretch)) = best else { unreachable!("two candidates were tried") };
    Ok(sample(&curve, &profile, stretch, settings.sample_period_secs))
}

fn scaled(limits: &JointLimits, fraction: f64) -> JointLimits {
    JointLimits {
        velocity: limits.velocity * fraction,
        acceleration: limits.acceleration * fraction,
        jerk: limits.jerk * fraction,
        ..*limits
    }
}

/// Limits on `u` from the direction alone, and from direction and curvature (half of each budget for the corner).
fn profile_limits(curve: &SmoothPath, limits: &[JointLimits]) -> (ProfileLimits, ProfileLimits) {
    let none = ProfileLimits { velocity: f64::INFINITY, acceleration: f64::INFINITY, jerk: f64::INFINITY };
    let (mut straight, mut corner_velocity) = (none, f64::INFINITY);
    let n = (curve.length_rad() / 0.005).ceil().clamp(50.0, 5000.0) as usize;
    for i in 0..=n {
        let point = curve.at(curve.length_rad() * i as f64 / n as f64);
        for (joint, l) in limits.iter().enumerate() {
            let (d1, d2, d3) = (point.d1[joint].abs(), point.d2[joint].abs(), point.d3[joint].abs());
            straight.velocity = straight.velocity.min(l.velocity / d1.max(1e-9));
            straight.acceleration = straight.acceleration.min(l.acceleration / d1.max(1e-9));
            straight.jerk = straight.jerk.min(l.jerk / d1.max(1e-9));
            corner_velocity = corner_velocity.min((0.5 * l.acceleration / d2.max(1e-9)).sqrt());
            corner_velocity = corner_velocity.min((0.5 * l.jerk / d3.max(1e-9)).cbrt());
        }
    }
    // URDF-only chains have no acceleration or jerk limit: an arm is then as brisk as one that reaches full speed in 0.1 s.
    straight.acceleration = straight.acceleration.min(10.0 * straight.velocity);
    straight.jerk = straight.jerk.min(100.0 * straight.acceleration);
    let bounded = ProfileLimits {
        velocity: straight.velocity.min(corner_velocity),
        acceleration: 0.6 * straight.acceleration,
        jerk: 0.6 * straight.jerk,
    };
    (straight, bounded)
}

fn speed_profile(length_rad: f64, limits: ProfileLimits) -> Result<Trajectory<1>, PlanningError> {
    let failed = |message: String| PlanningError::Profile { length_rad, message };
    let mut input = InputParameter::<1>::new(None);
    input.current_position[0] = 0.0;
    input.target_position[0] = length_rad;
    input.max_velocity[0] = limits.velocity;
    input.max_acceleration[0] = limits.acceleration;
    input.max_jerk[0] = limits.jerk;
    let mut profile = Trajectory::new(None);
    Ruckig::<1, ThrowErrorHandler>::new(None, 0.001)
        .calculate(&input, &mut profile)
        .map_err(|error| failed(format!("{error:?}")))?;
    Ok(profile)
}

/// Position on the curve, speed and acceleration at a time of the unstretched profile.
fn state(profile: &Trajectory<1>, t_secs: f64, jerk: &mut f64) -> (f64, f64, f64) {
    let (mut u, mut du, mut ddu, mut dddu) = (
        DataArrayOrVec::new(None, 0.0),
        DataArrayOrVec::new(None, 0.0),
        DataArrayOrVec::new(None, 0.0),
        DataArrayOrVec::new(None, 0.0),
    );
    profile.at_time(t_secs, &mut Some(&mut u), &mut Some(&mut du), &mut Some(&mut ddu), &mut Some(&mut dddu), &mut None);
    *jerk = dddu[0];
    (u[0], du[0], ddu[0])
}

/// Share of a joint's torque that holding the weight may take; with more, motions would last for ever.
const MOST_FOR_WEIGHT: f64 = 0.98;

/// By how much time must be stretched so that no joint needs more torque than it has: all but the weight falls by k^2.
fn stretch_for_torque(
    curve: &SmoothPath,
    profile: &Trajectory<1>,
    chain: &Chain,
    torque: &TorqueLimits,
) -> Result<f64, PlanningError> {
    let duration = profile.get_duration();
    let n = (duration / 0.002).ceil().clamp(200.0, 10_000.0) as usize;
    let rest = vec![0.0; chain.n_joints()];
    let mut stretch2: f64 = 0.0;
    for i in 0..=n {
        let (u, du, ddu) = state(profile, duration * i as f64 / n as f64, &mut 0.0);
        let point = curve.at(u.clamp(0.0, curve.length_rad()));
        let (dq, ddq) = (&point.d1 * du, &point.d2 * (du * du) + &point.d1 * ddu);
        let weight = torque.dynamics.torques(point.q.as_slice(), &rest, &rest);
        let whole = torque.dynamics.torques(point.q.as_slice(), dq.as_slice(), ddq.as_slice());
        for (joint, limits) in chain.limits.iter().enumerate().filter(|(_, limits)| limits.effort > 0.0) {
            let most = limits.effort * torque.fraction;
            if weight[joint].is_nan() || weight[joint].abs() > MOST_FOR_WEIGHT * most {
                return Err(PlanningError::TooHeavy {
                    joint: chain.joint_names[joint].clone(),
                    torque_nm: weight[joint].abs(),
                    limit_nm: most,
                    payload_kg: torque.dynamics.payload_kg(),
                    along_rad: u,
                });
            }
            let motion = whole[joint] - weight[joint];
            // What the weight leaves on the side to which the motion pushes.
            stretch2 = stretch2.max(motion.abs() / (most - weight[joint] * motion.signum()));
        }
    }
    Ok(stretch2.sqrt() * 1.005)
}

/// By how much time must be stretched so that no joint exceeds a limit: speeds fall by k, accelerations by k^2, jerks by k^3.
fn needed_stretch(curve: &SmoothPath, profile: &Trajectory<1>, limits: &[JointLimits]) -> f64 {
    let duration = profile.get_duration();
    let n = (duration / 0.001).ceil().clamp(200.0, 20_000.0) as usize;
    let mut stretch: f64 = 0.0;
    for i in 0..=n {
        let mut dddu = 0.0;
        let (u, du, ddu) = state(profile, duration * i as f64 / n as f64, &mut dddu);
        let point = curve.at(u.clamp(0.0, curve.length_rad()));
        for (joint, l) in limits.iter().enumerate() {
            let (d1, d2, d3) = (point.d1[joint], point.d2[joint], point.d3[joint]);
            let velocity = (d1 * du).abs();
            let acceleration = (d2 * du * du + d1 * ddu).abs();
            let jerk = (d3 * du * du * du + 3.0 * d2 * du * ddu + d1 * dddu).abs();
            stretch = stretch.max(velocity / l.velocity).max((acceleration / l.acceleration).sqrt()).max((jerk / l.jerk).cbrt());
        }
    }
    // The check is discrete; half a percent covers what lies between two points of it.
    stretch * 1.005
}

fn sample(curve: &SmoothPath, profile: &Trajectory<1>, stretch: f64, period_secs: f64) -> JointTrajectory {
    let duration = profile.get_duration() * stretch;
    let n = (duration / period_secs).ceil() as usize;
    let mut trajectory = JointTrajectory::default();
    let mut dddu = 0.0;
    for i in 0..=n {
        let t = period_secs * i as f64;
        let (u, du, _) = state(profile, (t / stretch).min(profile.get_duration()), &mut dddu);
        let point = curve.at(u.clamp(0.0, curve.length_rad()));
        let speed = if t >= duration { 0.0 } else { du / stretch };
        trajectory.stamps_secs.push(t);
        trajectory.q.push(point.q.as_slice().to_vec());
        trajectory.dq.push((point.d1 * speed).as_slice().to_vec());
    }
    trajectory
}

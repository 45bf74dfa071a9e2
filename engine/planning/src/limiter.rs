//! The engine's own check of every command on its way to the driver, and the ramp that ends a motion when one fails it.

use sfg_kinematics::{Chain, JointLimits};
use sfg_types::{JointTrajectory, RobotCommand};
use std::fmt;

/// Where the palm may be, base frame, metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PalmBox {
    /// Smallest x, y, z.
    pub low_m: [f64; 3],
    /// Largest x, y, z.
    pub high_m: [f64; 3],
}

/// What the limiter lets pass.
#[derive(Clone, Debug, PartialEq)]
pub struct LimiterSettings {
    /// Where the palm may be.
    pub palm_box: PalmBox,
    /// Beyond a position limit, radians. Default 1e-6.
    pub position_tolerance_rad: f64,
    /// Share beyond a velocity or acceleration limit. Default 0.02: commands are rounded and sampled.
    pub rate_tolerance: f64,
    /// Largest change of a hand command, full strokes for each second. Default 4.
    pub max_hand_speed_per_sec: f64,
}

impl Default for LimiterSettings {
    fn default() -> Self {
        Self {
            // In front of and beside the robot, above the floor.
            palm_box: PalmBox { low_m: [-0.3, -1.2, 0.3], high_m: [1.4, 1.2, 2.1] },
            position_tolerance_rad: 1e-6,
            rate_tolerance: 0.02,
            max_hand_speed_per_sec: 4.0,
        }
    }
}

/// A command that must not reach the driver.
#[derive(Clone, Debug, PartialEq)]
pub struct LimitViolation {
    /// What broke the limit: a joint's name, `palm x`, `hand synergy`, ...
    pub subject: String,
    /// Which quantity: `position`, `velocity`, `acceleration`, `length`.
    pub quantity: &'static str,
    /// Its value; NaN when the command was not a number.
    pub value: f64,
    /// The limit that it broke.
    pub limit: f64,
    /// Unit of both.
    pub unit: &'static str,
}

impl fmt::Display for LimitViolation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { subject, quantity, value, limit, unit } = self;
        write!(f, "{subject}: {quantity} {value:.4} {unit} breaks the limit {limit:.4} {unit}")
    }
}

impl std::error::Error for LimitViolation {}

/// Stands between every source of commands and the driver.
#[derive(Clone, Debug)]
pub struct CommandLimiter {
    chain: Chain,
    settings: LimiterSettings,
}

impl CommandLimiter {
    /// For one arm: its chain from base to palm with limits.
    #[must_use]
    pub fn new(chain: Chain, settings: LimiterSettings) -> Self {
        Self { chain, settings }
    }

    /// Whether `command` may follow `previous` after `period_secs`.
    ///
    /// Checked are: number of joints and finiteness, joint positions, velocities (commanded, and implied by the positions),
    /// accelerations (implied by the velocities), the palm's place, ranges and speed of the hand.
    ///
    /// # Errors
    /// The first [`LimitViolation`]; the caller stops the arm with [`stop_ramp`].
    ///
    /// # Panics
    /// If `previous` does not fit the arm: it passed this check before it was sent.
    pub fn check(&self, previous: &RobotCommand, command: &RobotCommand, period_secs: f64) -> Result<(), LimitViolation> {
        let n = self.chain.n_joints();
        for (what, len) in [("joint positions", command.q.len()), ("joint velocities", command.dq.len())] {
            if len != n {
                return Err(violation(what, "length", len as f64, n as f64, "joints"));
            }
        }
        assert!(previous.q.len() == n && previous.dq.len() == n, "the previous command was checked before it was sent");
        let grace = 1.0 + self.settings.rate_tolerance;
        for (idx, (name, limits)) in self.chain.joint_names.iter().zip(&self.chain.limits).enumerate() {
            let (q, dq) = (command.q[idx], command.dq[idx]);
            let slack = self.settings.position_tolerance_rad;
            within(name, "position", q, limits.lower - slack, limits.upper + slack, "rad")?;
            // Rounding of stored positions shows in their difference quotient.
            let fastest = limits.velocity * grace + 1e-9 / period_secs;
            within(name, "velocity", dq, -fastest, fastest, "rad/s")?;
            within(name, "velocity", (q - previous.q[idx]) / period_secs, -fastest, fastest, "rad/s")?;
            let sharpest = limits.acceleration * grace + 1e-9 / period_secs;
            within(name, "acceleration", (dq - previous.dq[idx]) / period_secs, -sharpest, sharpest, "rad/s^2")?;
        }
        let palm = self.chain.fk(&command.q).translation.vector;
        for (axis, name) in ["palm x", "palm y", "palm z"].into_iter().enumerate() {
            let PalmBox { low_m, high_m } = &self.settings.palm_box;
            within(name, "position", palm[axis], low_m[axis], high_m[axis], "m")?;
        }
        let (hand, before) = (&command.hand, &previous.hand);
        let fastest = self.settings.max_hand_speed_per_sec * grace + 1e-9 / period_secs;
        for (name, value, old, low) in [
            ("hand synergy", hand.synergy, before.synergy, 0.0),
            ("hand manipulation", hand.manipulation, before.manipulation, -1.0),
        ] {
            within(name, "position", value, low - 1e-9, 1.0 + 1e-9, "strokes")?;
            within(name, "velocity", (value - old) / period_secs, -fastest, fastest, "strokes/s")?;
        }
        Ok(())
    }
}

fn within(
    subject: &str,
    quantity: &'static str,
    value: f64,
    low: f64,
    high: f64,
    unit: &'static str,
) -> Result<(), LimitViolation> {
    if value >= low && value <= high {
        return Ok(());
    }
    // NaN comes here too, as it is neither above nor below.
    Err(violation(subject, quantity, value, if value < low { low } else { high }, unit))
}

fn violation(subject: &str, quantity: &'static str, value: f64, limit: f64, unit: &'static str) -> LimitViolation {
    LimitViolation { subject: subject.to_owned(), quantity, value, limit, unit }
}

/// Brings an arm from `q`, `dq` to rest along its present direction as fast as the acceleration limits allow.
///
/// All joints brake for the same time, so that the arm stays on the tangent of its path. A joint that would run into its position
/// limit brakes at its own limit of acceleration instead, and is held at the position limit in the last resort.
/// Samples are `period_secs` apart and end at rest.
///
/// # Panics
/// If the lengths differ, a value is not finite or a joint has no finite acceleration limit.
#[must_use]
pub fn stop_ramp(q: &[f64], dq: &[f64], limits: &[JointLimits], period_secs: f64) -> JointTrajectory {
    assert!(q.len() == dq.len() && q.len() == limits.len(), "one value for each joint");
    assert!(q.iter().chain(dq).all(|v| v.is_finite()), "positions and velocities are numbers");
    assert!(limits.iter().all(|l| l.acceleration > 0.0 && l.acceleration.is_finite()), "accelerations are limited");
    let own: Vec<f64> = dq.iter().zip(limits).map(|(v, l)| v.abs() / l.acceleration).collect();
    let together = own.iter().copied().fold(0.0, f64::max);
    let braking: Vec<f64> = (0..q.len())
        .map(|i| {
            let end = q[i] + 0.5 * dq[i] * together;
            if end < limits[i].lower || end > limits[i].upper { own[i] } else { together }
        })
        .collect();
    let n = (together / period_secs).ceil() as usize;
    let mut ramp = JointTrajectory::default();
    for i in 0..=n {
        let t = period_secs * i as f64;
        let (mut at, mut speed) = (Vec::new(), Vec::new());
        for j in 0..q.len() {
            let left = (1.0 - t / braking[j].max(1e-12)).max(0.0);
            let value = q[j] + 0.5 * dq[j] * braking[j] * (1.0 - left * left);
            // A start outside the limits is not pulled back in by the ramp.
            let (low, high) = (limits[j].lower.min(q[j]), limits[j].upper.max(q[j]));
            let held = !(low..=high).contains(&value);
            at.push(value.clamp(low, high));
            speed.push(if held || braking[j] == 0.0 { 0.0 } else { dq[j] * left });
        }
        ramp.stamps_secs.push(t);
        ramp.q.push(at);
        ramp.dq.push(speed);
    }
    ramp
}

//! The built-in simulator behind the driver contract.
//!
//! [`SimDriver`] shows what a real robot shows: encoders of the arm, positions and currents of the two hand motors, two depth
//! cameras. It holds a [`RobotPort`], which has no way to object poses, part labels or finger joints; the truth lies in the
//! [`JudgeHandle`] that [`SimDriver::new`] returns beside it. Time passes in [`Driver::advance`] only.

mod ramp;

pub use sfg_world as world;
pub use sfg_world::JudgeHandle;

use sfg_kinematics::{JointLimits, RobotModel};
use sfg_plugin::{Driver, DriverInfo, PluginError};
use sfg_types::{HandCommand, HandSide, Observation, RobotCommand, RobotState};
use sfg_world::{RobotPort, SceneSpec, World, WorldError};

/// Name of the plugin.
const NAME: &str = "sim";
/// A set point may leave the position limits by this much: rounding of planners, radians.
const POSITION_SLACK_RAD: f64 = 1e-3;
/// and exceed the velocity limits by this factor.
const VELOCITY_SLACK: f64 = 1.01;
/// A motion may begin this far from the last set point, radians: it starts from the measured position.
const START_SLACK_RAD: f64 = 0.02;

/// What a scenario may choose about the driver.
#[derive(Clone, Debug, PartialEq)]
pub struct SimOptions {
    /// Smallest step of the arm's encoders, radians; 0 = none.
    pub encoder_step_rad: f64,
    /// The cameras' cable is cut: every observation fails. For tests.
    pub cut_cameras: bool,
}

impl Default for SimOptions {
    /// 20-bit encoders.
    fn default() -> Self {
        Self { encoder_step_rad: std::f64::consts::TAU / f64::from(1 << 20), cut_cameras: false }
    }
}

/// The simulated robot as a driver.
#[derive(Debug)]
pub struct SimDriver {
    port: RobotPort,
    side: HandSide,
    limits: Vec<JointLimits>,
    options: SimOptions,
    set_point: RobotCommand,
    /// A set point came since the last period.
    is_fresh: bool,
    is_stopping: bool,
}

impl SimDriver {
    /// Builds the scene and splits it into a driver and the judge's handle.
    ///
    /// # Errors
    /// As [`World::new`].
    pub fn new(
        scene: &SceneSpec,
        robot: &RobotModel,
        side: HandSide,
        options: SimOptions,
    ) -> Result<(Self, JudgeHandle), WorldError> {
        let (port, judge) = World::new(scene, robot, side)?.share();
        let arm = robot.arm(side);
        let (limits, q) = (arm.chain.limits.clone(), arm.home_q.clone());
        let set_point = RobotCommand { side, dq: vec![0.0; q.len()], q, hand: HandCommand::default() };
        Ok((Self { port, side, limits, options, set_point, is_fresh: false, is_stopping: false }, judge))
    }

    fn check(&self, command: &RobotCommand) -> Result<(), String> {
        if command.side != self.side {
            return Err(format!("the {} arm was commanded, the acting one is {}", command.side.name(), self.side.name()));
        }
        let n = self.limits.len();
        if command.q.len() != n || command.dq.len() != n {
            let (n_q, n_dq) = (command.q.len(), command.dq.len());
            return Err(format!("{n_q} positions and {n_dq} velocities were commanded, the arm has {n} joints"));
        }
        if !(command.hand.synergy.is_finite() && command.hand.manipulation.is_finite()) {
            return Err("the hand command is not finite".to_owned());
        }
        for (idx, limits) in self.limits.iter().enumerate() {
            let (q, dq, last) = (command.q[idx], command.dq[idx], self.set_point.q[idx]);
            let JointLimits { lower, upper, velocity, .. } = *limits;
            // Ranges do not contain NaN.
            if !(lower - POSITION_SLACK_RAD..=upper + POSITION_SLACK_RAD).contains(&q) {
                return Err(format!("joint {idx} at {q:.4} rad leaves its limits {lower:.4} to {upper:.4} rad"));
            }
            if !(0.0..=velocity * VELOCITY_SLACK).contains(&dq.abs()) {
                return Err(format!("joint {idx} at {dq:.3} rad/s exceeds its limit of {velocity:.3} rad/s"));
            }
            let reach = velocity * VELOCITY_SLACK * World::PERIOD_SECS + START_SLACK_RAD;
            if !(0.0..=reach).contains(&(q - last).abs()) {
                return Err(format!("joint {idx} would jump by {:.4} rad in one period", q - last));
            }
        }
        Ok(())
    }
}

impl Driver for SimDriver {
    fn info(&self) -> DriverInfo {
        DriverInfo { name: NAME.to_owned(), period_secs: World::PERIOD_SECS, side: self.side }
    }

    fn observe(&mut self) -> Result<Observation, PluginError> {
        if self.options.cut_cameras {
            return Err(failed("no image arrives from the cameras; check their cable".to_owned()));
        }
        Ok(self.port.observe())
    }

    fn state(&mut self) -> Result<RobotState, PluginError> {
        let truth = self.port.proprioception();
        let step = self.options.encoder_step_rad;
        // Velocities come from differences of positions over one period, so they have a step as well.
        let quantised = |values: Vec<f64>, step: f64| match step > 0.0 {
            true => values.into_iter().map(|value| (value / step).round() * step).collect(),
            false => values,
        };
        Ok(RobotState {
            stamp_secs: truth.stamp_secs,
            side: self.side,
            q: quantised(truth.q, step),
            dq: quantised(truth.dq, step / World::PERIOD_SECS),
            hand: truth.hand,
        })
    }

    fn command(&mut self, command: &RobotCommand) -> Result<(), PluginError> {
        self.check(command).map_err(failed)?;
        self.set_point = command.clone();
        self.is_fresh = true;
        self.is_stopping = false;
        Ok(())
    }

    fn advance(&mut self) -> Result<(), PluginError> {
        // A moving arm whose commands stop coming is brought to rest, as the controller of the real arm does.
        if self.is_stopping || !self.is_fresh {
            let accelerations = self.limits.iter().map(|limits| limits.acceleration);
            ramp::slow_down(&mut self.set_point.q, &mut self.set_point.dq, accelerations, World::PERIOD_SECS);
            for (q, limits) in self.set_point.q.iter_mut().zip(&self.limits) {
                *q = q.clamp(limits.lower, limits.upper);
            }
        }
        self.is_fresh = false;
        self.port.step(&self.set_point).map_err(|error| failed(error.to_string()))
    }

    /// Ramps the arm down at its largest acceleration over the next periods; the hand keeps its grip.
    fn stop(&mut self) -> Result<(), PluginError> {
        self.is_stopping = true;
        Ok(())
    }
}

fn failed(message: String) -> PluginError {
    PluginError::Failed { plugin: NAME.to_owned(), message }
}

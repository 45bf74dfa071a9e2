//! The robot as skills see it: the driver behind the engine's limits.
//!
//! Skills set the coming set point; [`Robot::advance`] checks it and sends it. A skill that sets nothing brings the arm to
//! rest along a ramp, so that a halted node needs no clean-up to be safe.

use crate::context::SkillFailure;
use sfg_kinematics::{Chain, RobotModel};
use sfg_planning::{CommandLimiter, stop_ramp};
use sfg_plugin::{Driver, PluginError, SelfSphere};
use sfg_synergy::SynergySpace;
use sfg_types::{
    FailureReason, HandCommand, HandSide, JointTrajectory, Observation, Point, Pose, RobotCommand, RobotState, SynergyCoordinates,
};

/// Why the robot did not take a step.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum RobotError {
    /// The command was outside the limits; the robot was stopped instead.
    #[error("{0}; the robot was stopped")]
    Limit(String),
    /// The driver failed.
    #[error(transparent)]
    Driver(#[from] PluginError),
}

/// The acting arm and hand.
pub struct Robot {
    driver: Box<dyn Driver>,
    model: RobotModel,
    synergy: SynergySpace,
    side: HandSide,
    period_secs: f64,
    limiter: CommandLimiter,
    state: RobotState,
    sent: RobotCommand,
    arm_next: Option<(Vec<f64>, Vec<f64>)>,
    hand_target: HandCommand,
    ramp: Option<(JointTrajectory, f64)>,
    is_stopped: bool,
    max_speed_fraction: f64,
    n_held: u64,
}

/// Points this far outside the body still count as the robot's own: calibration and depth noise.
const SELF_MARGIN_M: f64 = 0.015;
/// Balls may reach this far beyond the body they cover.
const SPHERE_EXCESS_M: f64 = 0.01;
/// Fingers have no joint sensors, so their balls are larger.
const FINGER_MARGIN_M: f64 = 0.025;

impl Robot {
    /// Takes over `driver`, holding still.
    ///
    /// # Errors
    /// [`RobotError::Driver`] when the first state cannot be read.
    pub fn new(
        mut driver: Box<dyn Driver>,
        model: RobotModel,
        synergy: SynergySpace,
        limiter: CommandLimiter,
    ) -> Result<Self, RobotError> {
        let info = driver.info();
        let state = driver.state()?;
        let sent =
            RobotCommand { side: info.side, q: state.q.clone(), dq: vec![0.0; state.q.len()], hand: HandCommand::default() };
        Ok(Self {
            driver,
            model,
            synergy,
            side: info.side,
            period_secs: info.period_secs,
            limiter,
            state,
            sent,
            arm_next: None,
            hand_target: HandCommand::default(),
            ramp: None,
            is_stopped: false,
            max_speed_fraction: 1.0,
            n_held: 0,
        })
    }

    /// Lets no planned motion use more than this share of the joint speed limits.
    #[must_use]
    pub fn with_max_speed_fraction(mut self, fraction: f64) -> Self {
        self.max_speed_fraction = fraction;
        self
    }

    /// Largest share of the joint speed limits that a planned motion may use.
    #[must_use]
    pub fn max_speed_fraction(&self) -> f64 {
        self.max_speed_fraction
    }

    /// Time on the driver's clock.
    #[must_use]
    pub fn now_secs(&self) -> f64 {
        self.state.stamp_secs
    }

    /// Time that skills had for acting: that of the driver's clock without the periods in which the robot was held.
    #[must_use]
    pub fn active_secs(&self) -> f64 {
        self.state.stamp_secs - self.n_held as f64 * self.period_secs
    }

    /// Control periods in which the robot was held. A motion that finds another number than before goes on from rest.
    #[must_use]
    pub fn n_held(&self) -> u64 {
        self.n_held
    }

    /// Whether the arm's set point stands.
    #[must_use]
    pub fn is_at_rest(&self) -> bool {
        self.sent.dq.iter().all(|velocity| *velocity == 0.0)
    }

    /// Length of a control period.
    #[must_use]
    pub fn period_secs(&self) -> f64 {
        self.period_secs
    }

    /// Which arm and hand acts.
    #[must_use]
    pub fn side(&self) -> HandSide {
        self.side
    }

    /// The robot's description and kinematics.
    #[must_use]
    pub fn model(&self) -> &RobotModel {
        &self.model
    }

    /// Base link to palm frame of the acting arm.
    #[must_use]
    pub fn chain(&self) -> &Chain {
        self.model.arm_chain(self.side)
    }

    /// Newest measurement.
    #[must_use]
    pub fn state(&self) -> &RobotState {
        &self.state
    }

    /// Last set point sent.
    #[must_use]
    pub fn sent(&self) -> &RobotCommand {
        &self.sent
    }

    /// Measured palm pose.
    #[must_use]
    pub fn base_from_palm(&self) -> Pose {
        self.chain().fk(&self.state.q)
    }

    /// Last synergy set point.
    #[must_use]
    pub fn synergy(&self) -> SynergyCoordinates {
        SynergyCoordinates::new(self.sent.hand.synergy, self.sent.hand.manipulation)
    }

    /// Sets the arm's coming set point.
    pub fn set_arm(&mut self, q: Vec<f64>, dq: Vec<f64>) {
        self.arm_next = Some((q, dq));
    }

    /// Sets where the hand goes, at its own speed at most; held until set again.
    pub fn set_hand(&mut self, target: HandCommand) {
        self.hand_target = target;
    }

    /// One image of each camera.
    ///
    /// # Errors
    /// [`FailureReason::NoView`] when the driver has none.
    pub fn observe(&mut self) -> Result<Observation, SkillFailure> {
        self.driver.observe().map_err(|error| SkillFailure::new(FailureReason::NoView, error.to_string()))
    }

    /// Both arms and hands as balls, for leaving their points out of the views.
    #[must_use]
    pub fn self_spheres(&self) -> Vec<SelfSphere> {
        let poses = self.model.link_poses(&self.whole_q(&self.state.q, self.synergy()));
        let prefixes = [HandSide::Left, HandSide::Right].map(|side| format!("{}_", side.name()));
        let mut spheres = Vec::new();
        for (link, base_from_link) in self.model.tree.links.iter().zip(poses) {
            let is_hand = prefixes.iter().any(|prefix| link.name.starts_with(prefix.as_str()));
            let is_arm = [&self.model.left, &self.model.right].iter().any(|arm| arm.chain.link_names.contains(&link.name));
            let margin_m = match (is_hand, is_arm) {
                (true, _) => FINGER_MARGIN_M,
                (false, true) => SELF_MARGIN_M,
                (false, false) => continue,
            };
            for primitive in &link.collision {
                for (centre, radius_m) in sfg_planning::shapes::covering_spheres(primitive, SPHERE_EXCESS_M) {
                    let centre_in_base: Point = base_from_link * centre;
                    spheres.push(SelfSphere { centre_in_base, radius_m: radius_m + margin_m });
                }
            }
        }
        spheres
    }

    /// Configuration of the whole robot with the arm at `arm_q` and the free hand at `hand`.
    #[must_use]
    pub fn whole_q(&self, arm_q: &[f64], hand: SynergyCoordinates) -> Vec<f64> {
        let mut q = self.model.q_with_arm(self.side, arm_q);
        let hand_joints = self.synergy.joints_from_synergy(hand);
        for (joint, value) in self.synergy.profile().joints.iter().zip(hand_joints) {
            if let Ok(idx) = self.model.tree.q_idx(&format!("{}_{}", self.side.name(), joint.name)) {
                q[idx] = value;
            }
        }
        q
    }

    /// Sends the set point and lets one control period pass.
    ///
    /// # Errors
    /// [`RobotError::Limit`] when the set point is outside the limits: the robot is then stopped and takes no further motion.
    /// [`RobotError::Driver`] when the driver fails.
    pub fn advance(&mut self) -> Result<(), RobotError> {
        let (q, dq) = self.next_arm();
        let hand = self.next_hand();
        let command = RobotCommand { side: self.side, q, dq, hand };
        if self.is_stopped {
            self.driver.advance()?;
        } else {
            if let Err(violation) = self.limiter.check(&self.sent, &command, self.period_secs) {
                self.stop()?;
                return Err(RobotError::Limit(violation.to_string()));
            }
            self.driver.command(&command)?;
            self.sent = command;
            self.driver.advance()?;
        }
        self.state = self.driver.state()?;
        Ok(())
    }

    /// Lets one control period pass in which no skill acts: the arm comes to rest along a ramp and then stands, the hand stays
    /// as it is.
    ///
    /// # Errors
    /// As [`Robot::advance`].
    pub fn hold(&mut self) -> Result<(), RobotError> {
        self.n_held += 1;
        let target = std::mem::replace(&mut self.hand_target, self.sent.hand);
        let advanced = self.advance();
        self.hand_target = target;
        advanced
    }

    /// Sends a set point that was sent before, within the same limits: brings a simulated robot to where an earlier run stopped.
    ///
    /// # Errors
    /// [`RobotError::Limit`] when the set point is outside the limits, as one out of a changed file may be: the robot is then stopped.
    /// [`RobotError::Driver`] when the driver fails.
    pub fn repeat(&mut self, command: &RobotCommand) -> Result<(), RobotError> {
        if let Err(violation) = self.limiter.check(&self.sent, command, self.period_secs) {
            self.stop()?;
            return Err(RobotError::Limit(violation.to_string()));
        }
        self.driver.command(command)?;
        self.sent = command.clone();
        self.hand_target = command.hand;
        self.driver.advance()?;
        self.state = self.driver.state()?;
        Ok(())
    }

    /// Stops the arm at once, from any state; no motion is taken afterwards.
    ///
    /// # Errors
    /// [`RobotError::Driver`] when the driver cannot be reached.
    pub fn stop(&mut self) -> Result<(), RobotError> {
        self.is_stopped = true;
        self.driver.stop()?;
        Ok(())
    }

    /// One period's step towards where the hand goes.
    fn next_hand(&self) -> HandCommand {
        let step = self.synergy.profile().max_closing_speed_per_sec * self.period_secs;
        let towards = |from: f64, to: f64| from + (to - from).clamp(-step, step);
        HandCommand {
            synergy: towards(self.sent.hand.synergy, self.hand_target.synergy),
            manipulation: towards(self.sent.hand.manipulation, self.hand_target.manipulation),
        }
    }

    /// The skill's set point, or the next point of a ramp to rest.
    fn next_arm(&mut self) -> (Vec<f64>, Vec<f64>) {
        if let Some(next) = self.arm_next.take() {
            self.ramp = None;
            return next;
        }
        let now_secs = self.state.stamp_secs;
        if self.sent.dq.iter().all(|velocity| *velocity == 0.0) && self.ramp.is_none() {
            return (self.sent.q.clone(), self.sent.dq.clone());
        }
        let (ramp, start_secs) = self.ramp.get_or_insert_with(|| {
            let limits = &self.model.arm_chain(self.side).limits;
            (stop_ramp(&self.sent.q, &self.sent.dq, limits, self.period_secs), now_secs)
        });
        let t_secs = now_secs - *start_secs + self.period_secs;
        let next = ramp.sample(t_secs);
        if t_secs >= ramp.duration_secs() {
            self.ramp = None;
        }
        next
    }
}

//! The robot as skills see it: the driver behind the engine's limits.
//!
//! Skills set the coming set point; [`Robot::advance`] sends it through the safety filter. A skill that sets nothing brings the arm to
//! rest along a ramp, so that a halted node needs no clean-up to be safe.

use crate::context::SkillFailure;
use sfg_kinematics::reach::ReachMap;
use sfg_kinematics::{Chain, RobotModel};
use sfg_planning::{CollisionModel, CollisionSettings, FilterSettings, HandFilter, Intervention, Limit, SafetyFilter};
use sfg_plugin::{Driver, PluginError, SelfSphere};
use sfg_synergy::SynergySpace;
use sfg_types::{
    FailureReason, HandCommand, HandSide, JointTrajectory, Observation, Point, Pose, RobotCommand, RobotState, SynergyCoordinates,
};
use std::sync::Arc;

/// Why the robot did not take a step.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum RobotError {
    /// The command was so far outside the limits that what the filter left of it was another motion; the robot was stopped instead.
    #[error("{0}; the robot was stopped")]
    Limit(Intervention),
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
    arm_filter: SafetyFilter,
    hand_filter: HandFilter,
    settings: FilterSettings,
    interventions: Vec<(f64, Intervention)>,
    state: RobotState,
    sent: RobotCommand,
    arm_next: Option<(Vec<f64>, Vec<f64>)>,
    hand_target: HandCommand,
    is_driver_stopped: bool,
    max_speed_fraction: f64,
    n_held: u64,
    reach: Option<Arc<ReachMap>>,
}

/// Points this far outside the body still count as the robot's own: calibration and depth noise.
const SELF_MARGIN_M: f64 = 0.015;
/// Balls may reach this far beyond the body they cover.
const SPHERE_EXCESS_M: f64 = 0.01;
/// Fingers have no joint sensors, so their balls are larger.
const FINGER_MARGIN_M: f64 = 0.025;

/// A set point that is farther than this from what was asked for belongs to another motion, radians.
const MAX_DEPARTURE_RAD: f64 = 0.05;

impl Robot {
    /// Takes over `driver`, holding still. No motion uses more than `max_speed_fraction` of the joint speed limits.
    ///
    /// # Errors
    /// [`RobotError::Driver`] when the first state cannot be read.
    ///
    /// # Panics
    /// If the model is broken: it was checked when it was loaded.
    pub fn new(
        mut driver: Box<dyn Driver>,
        model: RobotModel,
        synergy: SynergySpace,
        settings: FilterSettings,
        max_speed_fraction: f64,
    ) -> Result<Self, RobotError> {
        let info = driver.info();
        let state = driver.state()?;
        let sent =
            RobotCommand { side: info.side, q: state.q.clone(), dq: vec![0.0; state.q.len()], hand: HandCommand::default() };
        let mut chain = model.arm_chain(info.side).clone();
        for limits in &mut chain.limits {
            limits.velocity *= max_speed_fraction;
        }
        let profile = synergy.profile();
        let hand_filter = HandFilter::new(sent.hand, profile.max_closing_speed_per_sec, profile.max_current_amps);
        let arm_filter = SafetyFilter::new(chain, &sent.q, info.period_secs, settings.clone());
        let mut robot = Self {
            driver,
            model,
            synergy,
            side: info.side,
            period_secs: info.period_secs,
            arm_filter,
            hand_filter,
            settings,
            interventions: Vec::new(),
            state,
            sent,
            arm_next: None,
            hand_target: HandCommand::default(),
            is_driver_stopped: false,
            max_speed_fraction,
            n_held: 0,
            reach: None,
        };
        let alone = CollisionModel::new(&robot.model, robot.side, &robot.whole_q(&robot.sent.q, robot.synergy()), guarding())
            .unwrap_or_else(|error| panic!("the loaded robot has a collision model: {error}"));
        robot.guard(alone);
        Ok(robot)
    }

    /// What the arm must not touch from now on: the filter stops before it. At first the robot itself.
    pub fn guard(&mut self, mut world: CollisionModel) {
        world.set_clearance(0.0, 0.0);
        self.arm_filter.set_world(Some(world));
    }

    /// What the safety filter would change in `trajectory` among the things of `world`; none when it passes as it is.
    ///
    /// # Panics
    /// If the trajectory is not one of this arm.
    #[must_use]
    pub fn rehearse(&self, trajectory: &JointTrajectory, mut world: CollisionModel) -> Option<Intervention> {
        world.set_clearance(0.0, 0.0);
        let start = trajectory.sample(0.0).0;
        let mut filter = SafetyFilter::new(self.arm_filter.chain().clone(), &start, self.period_secs, self.settings.clone());
        filter.set_world(Some(world));
        let n = (trajectory.duration_secs() / self.period_secs).ceil() as usize;
        (1..=n).find_map(|period| {
            let (q, dq) = trajectory.sample(period as f64 * self.period_secs);
            filter.step(Some((&q, &dq))).intervention
        })
    }

    /// What the safety filter changed since this was asked last, each with the driver's time.
    pub fn take_interventions(&mut self) -> Vec<(f64, Intervention)> {
        std::mem::take(&mut self.interventions)
    }

    /// Tells hopeless palm poses by this map of the acting arm; without one every pose is tried.
    #[must_use]
    pub fn with_reach(mut self, reach: Option<Arc<ReachMap>>) -> Self {
        self.reach = reach;
        self
    }

    /// The acting arm's reachability map, if there is one.
    #[must_use]
    pub fn reach(&self) -> Option<&ReachMap> {
        self.reach.as_deref()
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
        self.arm_filter.is_at_rest()
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

    /// Sends the set point through the safety filter and lets one control period pass.
    ///
    /// # Errors
    /// [`RobotError::Limit`] when little of the set point is within the limits: the arm then comes to rest and takes no further motion.
    /// [`RobotError::Driver`] when the driver fails.
    pub fn advance(&mut self) -> Result<(), RobotError> {
        let hand = self.next_hand();
        let arm = self.arm_next.take();
        let arm = arm.as_ref().map(|(q, dq)| (q.as_slice(), dq.as_slice()));
        // An arm that stands needs no command to stand on.
        let arm = arm.or_else(|| self.is_at_rest().then_some((self.sent.q.as_slice(), self.sent.dq.as_slice())));
        let arm = arm.map(|(q, dq)| (q.to_vec(), dq.to_vec()));
        self.send(arm, hand)
    }

    /// A driver that fails is stopped by its own means: it may not take the ramp either.
    fn send(&mut self, arm: Option<(Vec<f64>, Vec<f64>)>, hand: HandCommand) -> Result<(), RobotError> {
        let sent = self.send_filtered(arm, hand);
        if matches!(sent, Err(RobotError::Driver(_))) && !self.is_driver_stopped {
            self.arm_filter.stop();
            self.is_driver_stopped = true;
            // Its first failure is what is told.
            drop(self.driver.stop());
        }
        sent
    }

    fn send_filtered(&mut self, arm: Option<(Vec<f64>, Vec<f64>)>, hand: HandCommand) -> Result<(), RobotError> {
        if self.is_driver_stopped {
            self.driver.advance()?;
            self.state = self.driver.state()?;
            return Ok(());
        }
        let was_stopped = self.arm_filter.is_stopped();
        let sent = self.arm_filter.step(arm.as_ref().map(|(q, dq)| (q.as_slice(), dq.as_slice())));
        let hand = if was_stopped { self.sent.hand } else { hand };
        let (hand, hand_changed) = self.hand_filter.step(hand, &self.state.hand, self.period_secs);
        let command = RobotCommand { side: self.side, q: sent.q, dq: sent.dq, hand };
        self.driver.command(&command)?;
        self.sent = command;
        self.driver.advance()?;
        self.state = self.driver.state()?;
        let now_secs = self.state.stamp_secs;
        let mut departed = None;
        for found in sent.intervention.into_iter().chain(hand_changed) {
            // A skill that was halted says nothing more: its arm comes to rest as it should.
            if matches!(found.limit, Limit::Silence | Limit::Stopped) {
                continue;
            }
            let is_unreadable = matches!(found.limit, Limit::Length | Limit::NotANumber);
            if is_unreadable || found.by > MAX_DEPARTURE_RAD {
                departed.get_or_insert_with(|| found.clone());
            }
            self.interventions.push((now_secs, found));
        }
        if was_stopped && self.arm_filter.is_at_rest() {
            self.is_driver_stopped = true;
            self.driver.stop()?;
        } else if let Some(found) = departed.filter(|_| !was_stopped) {
            self.stop()?;
            return Err(RobotError::Limit(found));
        }
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
        self.hand_target = command.hand;
        self.send(Some((command.q.clone(), command.dq.clone())), command.hand)
    }

    /// Brings the arm to rest along a ramp, from any state; no motion is taken afterwards. The ramp goes on with each period.
    ///
    /// # Errors
    /// [`RobotError::Driver`] when the driver cannot be reached.
    pub fn stop(&mut self) -> Result<(), RobotError> {
        self.arm_filter.stop();
        if self.arm_filter.is_at_rest() && !self.is_driver_stopped {
            self.is_driver_stopped = true;
            self.driver.stop()?;
        }
        Ok(())
    }

    /// Stops the arm and waits until it rests; a driver that does not take the ramp is stopped at once.
    ///
    /// # Errors
    /// [`RobotError::Driver`] when the driver cannot be reached.
    pub fn stop_and_wait(&mut self) -> Result<(), RobotError> {
        self.stop()?;
        while !self.is_driver_stopped {
            self.advance()?;
        }
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
}

/// Distances that the filter keeps: those of the planner but for its clearance, so that what was planned passes.
fn guarding() -> CollisionSettings {
    CollisionSettings { clearance_m: 0.0, self_clearance_m: 0.0, ..CollisionSettings::default() }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "tests fail by panicking")]
    use super::*;
    use sfg_plugin::DriverInfo;
    use sfg_types::HandFeedback;
    use std::path::Path;
    use std::sync::{Arc, Mutex};

    /// What reached the driver, and after how many commands it fails.
    #[derive(Default)]
    struct Seen {
        commands: Vec<RobotCommand>,
        n_stops: usize,
        fails_after: Option<usize>,
    }

    /// An arm that is where it was sent.
    struct Perfect {
        seen: Arc<Mutex<Seen>>,
        state: RobotState,
    }

    impl Driver for Perfect {
        fn info(&self) -> DriverInfo {
            DriverInfo { name: "perfect".to_owned(), period_secs: 0.004, side: HandSide::Left }
        }
        fn observe(&mut self) -> Result<Observation, PluginError> {
            Ok(Observation::default())
        }
        fn state(&mut self) -> Result<RobotState, PluginError> {
            Ok(self.state.clone())
        }
        fn command(&mut self, command: &RobotCommand) -> Result<(), PluginError> {
            let mut seen = self.seen.lock().unwrap();
            if seen.fails_after.is_some_and(|n| seen.commands.len() >= n) {
                return Err(PluginError::Failed { plugin: "perfect".to_owned(), message: "no answer".to_owned() });
            }
            seen.commands.push(command.clone());
            self.state.q.clone_from(&command.q);
            Ok(())
        }
        fn advance(&mut self) -> Result<(), PluginError> {
            self.state.stamp_secs += 0.004;
            Ok(())
        }
        fn stop(&mut self) -> Result<(), PluginError> {
            self.seen.lock().unwrap().n_stops += 1;
            Ok(())
        }
    }

    /// A robot whose first joint has moved for 50 periods, up to 0.4 rad/s.
    fn moving() -> (Robot, Arc<Mutex<Seen>>, Vec<f64>) {
        let model = RobotModel::load(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../scenarios/robots/curi.yaml")).unwrap();
        let home = model.left.home_q.clone();
        let seen = Arc::new(Mutex::new(Seen::default()));
        let state = RobotState { q: home.clone(), dq: vec![0.0; 7], hand: HandFeedback::default(), ..RobotState::default() };
        let state = RobotState { side: HandSide::Left, ..state };
        let driver = Perfect { seen: Arc::clone(&seen), state };
        let synergy = SynergySpace::new(model.hand_profile.as_ref().unwrap()).unwrap();
        let mut robot = Robot::new(Box::new(driver), model, synergy, FilterSettings::default(), 1.0).unwrap();
        for period in 1..=50 {
            let t = 0.004 * f64::from(period);
            let mut q = home.clone();
            q[0] -= t * t;
            robot.set_arm(q, vec![0.0; 7]);
            robot.advance().unwrap();
        }
        (robot, seen, home)
    }

    #[test]
    fn a_stop_ramps_down_and_then_stops_the_driver_once() {
        let (mut robot, seen, _) = moving();
        robot.stop().unwrap();
        assert_eq!(seen.lock().unwrap().n_stops, 0, "it moves");
        robot.stop_and_wait().unwrap();
        robot.stop().unwrap();
        let seen = seen.lock().unwrap();
        assert!(seen.n_stops == 1 && (52..100).contains(&seen.commands.len()), "{}", seen.commands.len());
        assert!(robot.is_at_rest() && robot.take_interventions().is_empty());
    }

    #[test]
    fn a_driver_that_fails_is_stopped_at_once() {
        let (mut robot, seen, _) = moving();
        seen.lock().unwrap().fails_after = Some(50);
        assert!(matches!(robot.stop_and_wait(), Err(RobotError::Driver(_))));
        assert_eq!(seen.lock().unwrap().n_stops, 1);
    }

    #[test]
    fn a_command_that_is_another_motion_stops_the_arm_on_a_ramp() {
        for far in [0.5, f64::NAN] {
            let (mut robot, seen, mut q) = moving();
            q[0] += far;
            robot.set_arm(q, vec![0.0; 7]);
            let error = robot.advance().unwrap_err();
            assert!(matches!(error, RobotError::Limit(_)) && error.to_string().contains("panda_left_joint1"), "{error}");
            assert_eq!(robot.take_interventions().len(), 1);
            robot.stop_and_wait().unwrap();
            let seen = seen.lock().unwrap();
            let steps = seen.commands.windows(2).map(|w| (w[1].q[0] - w[0].q[0]).abs());
            assert!(steps.fold(0.0, f64::max) < 0.004 * 0.5 && seen.n_stops == 1);
        }
    }
}

//! The policy as a state machine: close, press, hold.

use crate::free_hand::FreeHand;
use crate::settings::{PLUGIN_NAME, SynergyPolicySettings};
use sfg_plugin::{ClosingPlan, GraspPolicy, GraspPolicyState, PluginContext, PluginError, PolicyStep};
use sfg_types::{GraspClass, HandFeedback, HandProfile, SynergyCoordinates};

/// How far `c1` may go beyond `c_tar` for grasps that hold with the pads: more would curl the fingers past the object.
const PAD_PRESS: f64 = 0.3;
/// A motor that stays within this band is at rest, strokes.
const REST_BAND: f64 = 0.01;
/// A set point this close to its goal has arrived, strokes.
const END_BAND: f64 = 1e-6;

/// Closes from the preshape to `c_tar` and on until the grip current is reached, then holds. The palm is not corrected.
#[derive(Clone, Debug)]
pub struct SynergyPolicy {
    settings: SynergyPolicySettings,
    run: Option<Run>,
}

/// One closing.
#[derive(Clone, Debug)]
struct Run {
    free_hand: FreeHand,
    target: SynergyCoordinates,
    /// Where pressing ends at the latest.
    end: SynergyCoordinates,
    speed_limit: f64,
    set_point: SynergyCoordinates,
    /// Largest speed of each coordinate on the way to `target`, strokes per second.
    closing_speed: [f64; 2],
    /// `c_tar` was reached.
    is_pressing: bool,
    /// How long the grip current has lasted, seconds.
    gripping_secs: f64,
    /// Held since the grip or the end of the stroke was reached.
    is_holding: bool,
    /// Motor positions when they were last seen to move, and how long ago.
    rest_at: [f64; 2],
    rest_secs: f64,
    elapsed_secs: f64,
}

impl SynergyPolicy {
    /// A policy with the parameters of `context`.
    ///
    /// # Errors
    /// [`PluginError::BadParameter`] for a wrong parameter.
    pub fn new(context: &PluginContext<'_>) -> Result<Self, PluginError> {
        Ok(Self { settings: SynergyPolicySettings::from_params(context.params)?, run: None })
    }
}

impl GraspPolicy for SynergyPolicy {
    fn start(&mut self, plan: &ClosingPlan, hand: &HandProfile) -> Result<(), PluginError> {
        self.run = None;
        let (preshape, target) = (plan.preshape, plan.target);
        if ![preshape.c1, preshape.c2, target.c1, target.c2].iter().all(|c| c.is_finite()) {
            return Err(failed("the closing plan has coordinates that are no numbers".to_owned()));
        }
        let free_hand = FreeHand::new(hand)
            .ok_or_else(|| failed(format!("hand {:?} states no positive largest tension and current", hand.name)))?;
        let speed_limit = hand.max_closing_speed_per_sec;
        if !(speed_limit.is_finite() && speed_limit > 0.0) {
            return Err(failed(format!(
                "hand {:?} has closing speed {speed_limit} strokes/s, which must be positive",
                hand.name
            )));
        }
        let (preshape, target) = (preshape.clamped(), target.clamped());
        let end_c1 = match plan.grasp_type.class() {
            GraspClass::Power => 1.0,
            GraspClass::Precision | GraspClass::Intermediate => (target.c1 + PAD_PRESS).min(1.0),
        };
        let speed = |from: f64, to: f64| ((to - from).abs() / self.settings.closing_secs).min(speed_limit);
        self.run = Some(Run {
            free_hand,
            target,
            end: SynergyCoordinates::new(end_c1, target.c2),
            speed_limit,
            set_point: preshape,
            closing_speed: [speed(preshape.c1, target.c1), speed(preshape.c2, target.c2)],
            is_pressing: false,
            gripping_secs: 0.0,
            is_holding: false,
            rest_at: [f64::NAN; 2],
            rest_secs: 0.0,
            elapsed_secs: 0.0,
        });
        Ok(())
    }

    fn step(&mut self, state: &GraspPolicyState, feedback: &HandFeedback) -> Result<PolicyStep, PluginError> {
        let settings = self.settings;
        let run = self.run.as_mut().ok_or_else(|| failed("step was called before start".to_owned()))?;
        let period_secs = state.period_secs;
        if !(period_secs.is_finite() && period_secs > 0.0) {
            return Err(failed(format!("the control period is {period_secs} s, it must be positive")));
        }
        run.elapsed_secs += period_secs;
        run.watch_grip(feedback, period_secs, &settings);
        run.watch_rest(feedback, period_secs);
        if !run.is_holding {
            run.advance(period_secs, &settings);
        }
        let is_late = run.elapsed_secs >= settings.timeout_secs;
        let done = is_late || (run.is_holding && run.rest_secs >= settings.rest_secs);
        Ok(PolicyStep { synergy: run.set_point, palm_correction: [0.0; 6], done })
    }
}

impl Run {
    /// Stops the set point once the grip current has lasted long enough.
    fn watch_grip(&mut self, feedback: &HandFeedback, period_secs: f64, settings: &SynergyPolicySettings) {
        if self.free_hand.grip(feedback) >= settings.grip_current_fraction {
            self.gripping_secs += period_secs;
        } else {
            self.gripping_secs = 0.0;
        }
        if self.gripping_secs > settings.debounce_secs {
            self.is_holding = true;
        }
    }

    fn watch_rest(&mut self, feedback: &HandFeedback, period_secs: f64) {
        let positions = feedback.motor_positions;
        // Written so that a position that is no number counts as moving.
        let rests = positions.iter().zip(&self.rest_at).all(|(now, then)| (now - then).abs() <= REST_BAND);
        if rests {
            self.rest_secs += period_secs;
        } else {
            self.rest_at = positions;
            self.rest_secs = 0.0;
        }
    }

    /// Moves the set point along preshape -> `c_tar` -> `end`; `is_holding` at the end of the stroke.
    fn advance(&mut self, period_secs: f64, settings: &SynergyPolicySettings) {
        if self.is_pressing {
            let speed = settings.pressing_speed_per_sec.min(self.speed_limit);
            self.set_point.c1 = towards(self.set_point.c1, self.end.c1, speed * period_secs);
            self.is_holding = (self.set_point.c1 - self.end.c1).abs() < END_BAND;
        } else {
            self.set_point.c1 = towards(self.set_point.c1, self.target.c1, self.closing_speed[0] * period_secs);
            self.set_point.c2 = towards(self.set_point.c2, self.target.c2, self.closing_speed[1] * period_secs);
            let gap = (self.set_point.c1 - self.target.c1).abs().max((self.set_point.c2 - self.target.c2).abs());
            self.is_pressing = gap < END_BAND;
        }
        self.set_point = self.set_point.clamped();
    }
}

fn towards(from: f64, to: f64, largest_step: f64) -> f64 {
    from + (to - from).clamp(-largest_step, largest_step)
}

fn failed(message: String) -> PluginError {
    PluginError::Failed { plugin: PLUGIN_NAME.to_owned(), message }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "tests fail by panicking")]
    use super::*;
    use serde_json::json;
    use sfg_types::{GraspType, HandJoint, HandSide, Pose};
    use std::path::Path;

    const PERIOD_SECS: f64 = 0.004;

    /// One finger joint behind each motor; an object stops the fingers at `blocked_at` of their closure.
    struct FakeHand {
        profile: HandProfile,
        motors: SynergyCoordinates,
        blocked_at: f64,
    }

    impl FakeHand {
        fn new(blocked_at: f64) -> Self {
            let joint = HandJoint {
                name: "flexion".to_owned(),
                lower_rad: 0.0,
                upper_rad: 1.57,
                stiffness_nm_per_rad: 0.3,
                damping_nms_per_rad: 0.03,
                closing_ratio: 1.0,
                shifting_ratio: 0.0,
                max_torque_nm: 0.6,
            };
            let profile = HandProfile {
                name: "one_joint".to_owned(),
                urdf_left: String::new(),
                urdf_right: String::new(),
                palm_link: "palm".to_owned(),
                joints: vec![joint],
                synergy_joints: vec!["flexion".to_owned()],
                synergy_matrix: vec![[1.0, 0.0]],
                grasp_types: std::collections::BTreeMap::new(),
                max_tension_nm: 1.0,
                tendon_stiffness_nm_per_rad: 2.0,
                max_current_amps: 1.0,
                max_closing_speed_per_sec: 1.5,
            };
            Self { profile, motors: SynergyCoordinates::OPEN, blocked_at }
        }

        fn load(&self, c: SynergyCoordinates) -> [f64; 2] {
            let stretch = 2.0 * 1.57 * (c.c1 - self.blocked_at).max(0.0);
            [c.c1 + c.c2, c.c1 - c.c2].map(|m| 0.3 * 1.57 * m.abs() + stretch)
        }

        fn follow(&mut self, goal: SynergyCoordinates) -> HandFeedback {
            let reach = 1.5 * PERIOD_SECS;
            let next = SynergyCoordinates::new(towards(self.motors.c1, goal.c1, reach), towards(self.motors.c2, goal.c2, reach));
            if self.load(next).iter().all(|load| *load <= 1.0) {
                self.motors = next;
            }
            let (a, b) = (self.motors.c1 + self.motors.c2, self.motors.c1 - self.motors.c2);
            HandFeedback { motor_positions: [a, b], motor_currents_amps: self.load(self.motors) }
        }
    }

    fn policy(params: &serde_json::Value, profile: &HandProfile) -> Result<SynergyPolicy, PluginError> {
        let context = PluginContext { params, scenarios_dir: Path::new("."), hand: profile, hand_side: HandSide::Left, seed: 0 };
        SynergyPolicy::new(&context)
    }

    fn plan(kind: GraspType, target: SynergyCoordinates) -> ClosingPlan {
        ClosingPlan { preshape: SynergyCoordinates::OPEN, target, grasp_type: kind, base_from_palm: Pose::identity() }
    }

    /// Set points until the policy is done, and the last feedback.
    fn close(kind: GraspType, target: [f64; 2], mut hand: FakeHand) -> (Vec<SynergyCoordinates>, HandFeedback) {
        let mut policy = policy(&json!({}), &hand.profile).unwrap();
        policy.start(&plan(kind, SynergyCoordinates::new(target[0], target[1])), &hand.profile).unwrap();
        let mut feedback = HandFeedback::default();
        let mut path = vec![SynergyCoordinates::OPEN];
        loop {
            let state = GraspPolicyState {
                elapsed_secs: path.len() as f64 * PERIOD_SECS,
                period_secs: PERIOD_SECS,
                synergy: path[path.len() - 1],
                base_from_palm: Pose::identity(),
            };
            let step = policy.step(&state, &feedback).unwrap();
            assert_eq!(step.palm_correction, [0.0; 6]);
            path.push(step.synergy);
            feedback = hand.follow(step.synergy);
            if step.done {
                return (path, feedback);
            }
            assert!(path.len() < 800, "the policy never ends");
        }
    }

    #[track_caller]
    fn check(kind: GraspType, target: [f64; 2], blocked_at: f64, grip: std::ops::Range<f64>, secs: std::ops::Range<f64>) {
        let hand = FakeHand::new(blocked_at);
        let free_hand = FreeHand::new(&hand.profile).unwrap();
        let (path, feedback) = close(kind, target, hand);
        let duration = path.len() as f64 * PERIOD_SECS;
        assert!(secs.contains(&duration), "took {duration:.2} s");
        let reached = free_hand.grip(&feedback);
        assert!(grip.contains(&reached), "grip {reached:.2} at {:?}", path.last());
        for pair in path.windows(2) {
            let step = (pair[1].c1 - pair[0].c1).abs().max((pair[1].c2 - pair[0].c2).abs());
            assert!(step <= 1.5 * PERIOD_SECS + 1e-12, "set point jumps by {step}");
            assert_eq!(pair[1], pair[1].clamped());
        }
    }

    #[test]
    fn a_power_grasp_presses_beyond_its_target_until_the_grip_current() {
        check(GraspType::LargeDiameter, [0.45, 0.0], 0.40, 0.40..0.65, 1.0..2.0);
    }

    #[test]
    fn a_hand_that_meets_nothing_ends_its_stroke_without_grip() {
        check(GraspType::LargeDiameter, [0.45, 0.0], 2.0, 0.0..0.01, 1.9..2.3);
    }

    #[test]
    fn a_thick_object_stops_the_hand_before_its_target() {
        check(GraspType::SmallDiameter, [1.0, 0.0], 0.2, 0.40..0.65, 0.3..0.9);
    }

    #[test]
    fn pads_press_no_further_than_their_allowance() {
        check(GraspType::PalmarPinch, [0.44, 1.0], 2.0, 0.0..0.01, 1.4..2.0);
    }

    #[test]
    fn broken_sensors_end_in_time_with_a_finite_set_point() {
        let hand = FakeHand::new(2.0);
        let mut policy = policy(&json!({}), &hand.profile).unwrap();
        policy.start(&plan(GraspType::MediumWrap, SynergyCoordinates::new(0.7, 0.0)), &hand.profile).unwrap();
        let broken = HandFeedback { motor_positions: [f64::NAN; 2], motor_currents_amps: [f64::NAN, f64::INFINITY] };
        let state = GraspPolicyState {
            elapsed_secs: 0.0,
            period_secs: PERIOD_SECS,
            synergy: SynergyCoordinates::OPEN,
            base_from_palm: Pose::identity(),
        };
        let n_steps = (1..=760).find(|_| {
            let step = policy.step(&state, &broken).unwrap();
            assert!(step.synergy.c1.is_finite() && step.synergy.c2.is_finite());
            step.done
        });
        assert!(n_steps.is_some_and(|n| n as f64 * PERIOD_SECS <= 3.01));
    }

    #[test]
    fn a_short_peak_of_current_does_not_stop_the_hand() {
        let hand = FakeHand::new(2.0);
        let mut policy = policy(&json!({}), &hand.profile).unwrap();
        policy.start(&plan(GraspType::MediumWrap, SynergyCoordinates::new(0.7, 0.0)), &hand.profile).unwrap();
        let mut c = SynergyCoordinates::OPEN;
        for i in 0..200 {
            let amps = if i % 20 < 5 { 1.0 } else { 0.0 };
            let feedback = HandFeedback { motor_positions: [c.c1; 2], motor_currents_amps: [amps; 2] };
            let state =
                GraspPolicyState { elapsed_secs: 0.0, period_secs: PERIOD_SECS, synergy: c, base_from_palm: Pose::identity() };
            c = policy.step(&state, &feedback).unwrap().synergy;
        }
        assert!((c.c1 - 0.56).abs() < 0.01, "stopped at {c:?}");
    }

    #[test]
    fn wrong_parameters_and_plans_are_refused() {
        let hand = FakeHand::new(1.0);
        for params in [json!({"grip": 1}), json!({"closing_secs": "slow"}), json!({"timeout_secs": -1}), json!([1])] {
            assert!(matches!(policy(&params, &hand.profile), Err(PluginError::BadParameter { .. })), "{params}");
        }
        let mut policy = policy(&json!({}), &hand.profile).unwrap();
        assert!(policy.start(&plan(GraspType::Tripod, SynergyCoordinates::new(f64::NAN, 0.0)), &hand.profile).is_err());
    }
}

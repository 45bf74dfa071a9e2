//! What the motors draw when nothing is in the hand.

use sfg_types::{HandFeedback, HandProfile, SynergyCoordinates};

/// The springs of a free hand as motor load, from the hand profile alone.
///
/// At motor positions `m1 = c1 + c2`, `m2 = c1 - c2` the tendons hold the springs with `unit * |m|` each, `unit` being the mean
/// of `E (upper - lower) / R1` over the driven joints. Anything above is pressed on an object.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FreeHand {
    /// Current of one motor for each unit of its position, amperes.
    amps_per_stroke: f64,
    /// Current at which a motor stalls, amperes.
    max_amps: f64,
}

impl FreeHand {
    /// The free hand of a profile; `None` when the profile has no usable drive limits.
    #[must_use]
    pub fn new(profile: &HandProfile) -> Option<Self> {
        let usable = |x: f64| x.is_finite() && x > 0.0;
        if !usable(profile.max_tension_nm) || !usable(profile.max_current_amps) {
            return None;
        }
        let driven = profile.joints.iter().filter(|j| profile.synergy_joints.contains(&j.name) && j.closing_ratio > 0.0);
        let (sum, n) = driven
            .map(|j| j.stiffness_nm_per_rad * (j.upper_rad - j.lower_rad) / j.closing_ratio)
            .fold((0.0, 0.0), |(sum, n), x| (sum + x, n + 1.0));
        let unit_nm: f64 = if n > 0.0 { sum / n } else { 0.0 };
        Some(Self {
            amps_per_stroke: unit_nm / profile.max_tension_nm * profile.max_current_amps,
            max_amps: profile.max_current_amps,
        })
    }

    /// How far the motors are from free running to stalled, in [0, 1]: the larger of the two.
    ///
    /// 0 = the currents are those of a hand that holds nothing; 1 = a motor stalls. Currents that are no numbers count as 0.
    #[must_use]
    pub fn grip(&self, feedback: &HandFeedback) -> f64 {
        let of = |position: f64, amps: f64| {
            let free = (self.amps_per_stroke * position.abs()).min(0.95 * self.max_amps);
            let grip = (amps - free) / (self.max_amps - free);
            if grip.is_finite() { grip.clamp(0.0, 1.0) } else { 0.0 }
        };
        let [a, b] = feedback.motor_positions;
        let [i, j] = feedback.motor_currents_amps;
        of(a, i).max(of(b, j))
    }

    /// Synergy coordinates of the motor positions.
    #[must_use]
    pub fn synergy(feedback: &HandFeedback) -> SynergyCoordinates {
        let [a, b] = feedback.motor_positions;
        SynergyCoordinates::new(0.5 * (a + b), 0.5 * (a - b))
    }
}

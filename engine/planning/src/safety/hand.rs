//! The hand's set points: range, speed and force.

use super::{Intervention, Limit};
use sfg_types::{HandCommand, HandFeedback};

/// Keeps a two-motor hand within its range, its speed and the current that its tendons bear.
#[derive(Clone, Debug, PartialEq)]
pub struct HandFilter {
    sent: HandCommand,
    max_speed_per_sec: f64,
    max_current_amps: f64,
}

impl HandFilter {
    /// For a hand that stands at `sent`: largest change of a set point in full strokes for each second, and the motor current above
    /// which the hand is not closed further.
    #[must_use]
    pub fn new(sent: HandCommand, max_speed_per_sec: f64, max_current_amps: f64) -> Self {
        Self { sent, max_speed_per_sec, max_current_amps }
    }

    /// The last set point that passed.
    #[must_use]
    pub fn sent(&self) -> HandCommand {
        self.sent
    }

    /// The set point to send: `wanted`, or what is nearest to it within the limits; and what was changed.
    pub fn step(
        &mut self,
        wanted: HandCommand,
        measured: &HandFeedback,
        period_secs: f64,
    ) -> (HandCommand, Option<Intervention>) {
        let before = self.sent;
        let mut found = None;
        let mut note = |subject: &str, limit, value, bound, unit| {
            found.get_or_insert(Intervention { subject: subject.to_owned(), limit, value, bound, unit, by: 0.0 });
        };
        let step = self.max_speed_per_sec * period_secs;
        let mut axis = |name: &str, wanted: f64, before: f64, low: f64| {
            if !wanted.is_finite() {
                note(name, Limit::NotANumber, wanted, 0.0, "strokes");
                return before;
            }
            let inside = wanted.clamp(low, 1.0);
            if inside != wanted {
                note(name, Limit::Position, wanted, inside, "strokes");
            }
            let change = inside - before;
            // Rounding of stored positions shows in their difference.
            if change.abs() > step * (1.0 + 1e-6) + 1e-9 {
                note(name, Limit::Velocity, change / period_secs, self.max_speed_per_sec, "strokes/s");
                return before + step.copysign(change);
            }
            inside
        };
        let mut next = HandCommand {
            synergy: axis("hand synergy", wanted.synergy, before.synergy, 0.0),
            manipulation: axis("hand manipulation", wanted.manipulation, before.manipulation, -1.0),
        };
        let current = measured.motor_currents_amps.iter().fold(0.0_f64, |most, amps| most.max(amps.abs()));
        if next.synergy > before.synergy && (current > self.max_current_amps || current.is_nan()) {
            note("hand", Limit::Force, current, self.max_current_amps, "A");
            next.synergy = before.synergy;
        }
        self.sent = next;
        if let Some(found) = &mut found {
            found.by = (next.synergy - wanted.synergy).abs().max((next.manipulation - wanted.manipulation).abs());
        }
        (next, found)
    }

    /// Takes over a set point that the hand was brought to by other means.
    pub fn reset(&mut self, sent: HandCommand) {
        self.sent = sent;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn step(wanted: HandCommand, amps: f64) -> (HandCommand, Option<Limit>) {
        let mut filter = HandFilter::new(HandCommand { synergy: 0.5, manipulation: 0.0 }, 4.0, 1.5);
        let measured = HandFeedback { motor_positions: [0.5, 0.5], motor_currents_amps: [amps, 0.0] };
        let (sent, found) = filter.step(wanted, &measured, 0.01);
        assert_eq!(filter.sent(), sent);
        (sent, found.map(|found| found.limit))
    }

    #[test]
    fn the_hand_stays_within_range_speed_and_force() {
        let at = |synergy, manipulation| HandCommand { synergy, manipulation };
        assert_eq!(step(at(0.54, -0.04), 0.2), (at(0.54, -0.04), None));
        assert_eq!(step(at(0.9, 0.0), 0.2), (at(0.54, 0.0), Some(Limit::Velocity)));
        assert_eq!(step(at(0.5, f64::NAN), 0.2), (at(0.5, 0.0), Some(Limit::NotANumber)));
        assert_eq!(step(at(0.52, 0.0), 1.6), (at(0.5, 0.0), Some(Limit::Force)));
        assert_eq!(step(at(0.48, 0.0), 1.6), (at(0.48, 0.0), None), "opening relieves the hand");
        let mut filter = HandFilter::new(at(0.99, 0.0), 4.0, 1.5);
        let (sent, found) = filter.step(at(1.02, 0.0), &HandFeedback::default(), 0.01);
        assert_eq!((sent.synergy, found.map(|found| found.limit)), (1.0, Some(Limit::Position)));
    }
}

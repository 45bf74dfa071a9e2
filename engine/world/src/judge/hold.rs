//! When is an object held? A small state machine over the contacts of every step.
//!
//! The driver never tells the judge that the hand has closed. A hold begins at the first step in which the object is more than
//! 5 mm above the table and nothing but the hand carries it. Closing fingers may raise it that far: the pose from which slip is
//! measured is the one in which the motors have stood for 0.1 s, or that after 2 s if they do not stop. A hold ends when the
//! hand has not touched the object for 0.1 s or the object is back on its support; the next one can only begin from the
//! support, so an object that slides through the fingers never gets a fresh reference pose in mid-air.

use serde::Serialize;
use sfg_types::Pose;

/// Height above the table at which an object counts as lifted off, metres.
pub const LIFT_OFF_M: f64 = 0.005;
/// Height above the table under which it counts as put down, metres.
pub const PUT_DOWN_M: f64 = 0.001;
/// Time without hand contact after which a hold is lost, seconds.
pub const LOST_AFTER_SECS: f64 = 0.1;
/// Time without motion of the motors after which closing has ended, seconds.
const CLOSED_AFTER_SECS: f64 = 0.1;
/// Longest part of a hold that counts as closing, seconds.
const CLOSING_AT_MOST_SECS: f64 = 2.0;
/// Motors that move less in a step stand still, synergy coordinates.
const MOTORS_STILL: f64 = 1e-6;

/// What one step shows about one object.
#[derive(Clone, Copy, Debug)]
pub(crate) struct HoldSample {
    /// End of the step.
    pub(crate) stamp_secs: f64,
    /// Lowest point of the object above the table top, metres.
    pub(crate) clearance_m: f64,
    /// Height of the object's centre, metres.
    pub(crate) centre_m: f64,
    /// The acting hand touches it.
    pub(crate) touched_by_hand: bool,
    /// Something other than the hand and grains touches it: table, another object, the arm.
    pub(crate) supported: bool,
    /// Object in the palm.
    pub(crate) palm_from_object: Pose,
    /// Where the motors of the hand are, as synergy coordinates.
    pub(crate) motors: [f64; 2],
}

/// Where an object is in its life.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum HoldPhase {
    /// On the table, or on something that is.
    Supported,
    /// Carried by the hand alone.
    Held,
    /// Was held, is neither held nor supported.
    Lost,
}

/// One hold, present or past.
#[derive(Clone, Debug, PartialEq)]
pub struct Hold {
    /// When the hand alone carried the object.
    pub since_secs: f64,
    /// Last step of the hold.
    pub until_secs: f64,
    /// Object in the palm when closing had ended.
    pub palm_from_object_at_closing: Pose,
    /// Object in the palm at the last step of the hold.
    pub palm_from_object: Pose,
    /// Closing has ended: `palm_from_object_at_closing` stays.
    pub is_closed: bool,
    /// Largest displacement in the palm frame so far, metres.
    pub max_slip_m: f64,
    /// Largest rotation in the palm frame so far, radians.
    pub max_slip_rad: f64,
    /// Largest rise of the centre during the hold, metres.
    pub max_rise_m: f64,
}

impl Hold {
    /// Length in seconds.
    #[must_use]
    pub fn duration_secs(&self) -> f64 {
        self.until_secs - self.since_secs
    }

    /// Displacement (metres) and rotation (radians) in the palm frame since closing ended.
    #[must_use]
    pub fn slip(&self) -> (f64, f64) {
        slip_between(&self.palm_from_object_at_closing, &self.palm_from_object)
    }
}

/// Follows one object.
#[derive(Clone, Debug)]
pub(crate) struct HoldTracker {
    /// Phase after the newest step.
    pub(crate) phase: HoldPhase,
    /// The present hold, or the last one.
    pub(crate) latest: Option<Hold>,
    /// Longest hold so far, seconds.
    pub(crate) longest_secs: f64,
    /// Largest rise of the centre while held, metres.
    pub(crate) max_rise_m: f64,
    /// Height of the centre when it last rested untouched, metres.
    rest_m: Option<f64>,
    untouched_since_secs: Option<f64>,
    /// Where the motors stand, and since when.
    motors: Option<([f64; 2], f64)>,
}

impl Default for HoldTracker {
    fn default() -> Self {
        Self {
            phase: HoldPhase::Supported,
            latest: None,
            longest_secs: 0.0,
            max_rise_m: 0.0,
            rest_m: None,
            untouched_since_secs: None,
            motors: None,
        }
    }
}

impl HoldTracker {
    /// The object lies on its support and nobody touches it: a thing that was knocked over is raised from where it lies.
    pub(crate) fn rests(&mut self, centre_m: f64) {
        self.rest_m = Some(centre_m);
    }

    fn rise_m(&self, sample: &HoldSample) -> f64 {
        self.rest_m.map_or(0.0, |rest_m| sample.centre_m - rest_m)
    }

    /// Takes one step into account; true in the step in which a hold begins.
    pub(crate) fn update(&mut self, sample: &HoldSample) -> bool {
        let rise_m = self.rise_m(sample);
        let is_closed = self.motors_stand(sample);
        match self.phase {
            HoldPhase::Supported => {
                let begins = sample.touched_by_hand && !sample.supported && sample.clearance_m > LIFT_OFF_M;
                if begins {
                    self.phase = HoldPhase::Held;
                    self.untouched_since_secs = None;
                    self.latest = Some(Hold {
                        since_secs: sample.stamp_secs,
                        until_secs: sample.stamp_secs,
                        palm_from_object_at_closing: sample.palm_from_object,
                        palm_from_object: sample.palm_from_object,
                        is_closed,
                        max_slip_m: 0.0,
                        max_slip_rad: 0.0,
                        max_rise_m: rise_m,
                    });
                    self.max_rise_m = self.max_rise_m.max(rise_m);
                }
                return begins;
            }
            HoldPhase::Held => self.follow(sample, is_closed),
            HoldPhase::Lost => {
                if sample.clearance_m < PUT_DOWN_M || (sample.supported && !sample.touched_by_hand) {
                    self.phase = HoldPhase::Supported;
                }
            }
        }
        false
    }

    /// Whether the object is in the hand now.
    #[must_use]
    pub(crate) fn is_held(&self) -> bool {
        self.phase == HoldPhase::Held
    }

    /// Whether the motors have stood where they are for long enough.
    fn motors_stand(&mut self, sample: &HoldSample) -> bool {
        let stood = self.motors.filter(|(at, _)| (0..2).all(|k| (at[k] - sample.motors[k]).abs() < MOTORS_STILL));
        let since_secs = stood.map_or(sample.stamp_secs, |(_, since_secs)| since_secs);
        self.motors = Some((sample.motors, since_secs));
        sample.stamp_secs - since_secs >= CLOSED_AFTER_SECS - 5e-7
    }

    fn follow(&mut self, sample: &HoldSample, is_closed: bool) {
        if sample.clearance_m < PUT_DOWN_M {
            self.phase = HoldPhase::Supported;
            return;
        }
        if sample.touched_by_hand {
            self.untouched_since_secs = None;
        } else {
            let since = *self.untouched_since_secs.get_or_insert(sample.stamp_secs);
            // Half a microsecond of slack: stamps are sums of periods.
            if sample.stamp_secs - since >= LOST_AFTER_SECS - 5e-7 {
                self.phase = HoldPhase::Lost;
            }
            return;
        }
        let rise_m = self.rise_m(sample);
        let Some(hold) = &mut self.latest else { return };
        hold.until_secs = sample.stamp_secs;
        hold.palm_from_object = sample.palm_from_object;
        if !hold.is_closed {
            hold.palm_from_object_at_closing = sample.palm_from_object;
            hold.is_closed = is_closed || hold.duration_secs() >= CLOSING_AT_MOST_SECS;
        }
        let (slip_m, slip_rad) = hold.slip();
        hold.max_slip_m = hold.max_slip_m.max(slip_m);
        hold.max_slip_rad = hold.max_slip_rad.max(slip_rad);
        hold.max_rise_m = hold.max_rise_m.max(rise_m);
        self.max_rise_m = self.max_rise_m.max(rise_m);
        self.longest_secs = self.longest_secs.max(hold.duration_secs());
    }
}

/// Displacement of the object's origin (metres) and rotation (radians) between two poses in the palm.
#[must_use]
pub fn slip_between(before: &Pose, after: &Pose) -> (f64, f64) {
    let moved = (after.translation.vector - before.translation.vector).norm();
    (moved, before.rotation.angle_to(&after.rotation))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Steps of 0.05 s: clearance in mm, then `h` for hand contact, `s` for support, `d` for a displaced object, `m` for moving motors.
    fn run(steps: &str) -> HoldTracker {
        let mut tracker = HoldTracker::default();
        tracker.rests(0.0);
        for (i, step) in steps.split_whitespace().enumerate() {
            let digits: String = step.chars().take_while(char::is_ascii_digit).collect();
            let height_m = digits.parse::<f64>().unwrap_or(0.0) * 1e-3;
            tracker.update(&HoldSample {
                stamp_secs: i as f64 * 0.05,
                clearance_m: height_m,
                centre_m: height_m,
                touched_by_hand: step.contains('h'),
                supported: step.contains('s'),
                palm_from_object: Pose::translation(0.0, 0.0, if step.contains('d') { -0.01 } else { 0.0 }),
                motors: [if step.contains('m') { i as f64 } else { 0.0 }, 0.0],
            });
        }
        tracker
    }

    #[track_caller]
    fn check(steps: &str, phase: HoldPhase, longest_secs: f64, max_rise_mm: f64) {
        let tracker = run(steps);
        assert_eq!(tracker.phase, phase);
        assert!((tracker.longest_secs - longest_secs).abs() < 1e-9, "longest {}", tracker.longest_secs);
        assert!((tracker.max_rise_m * 1e3 - max_rise_mm).abs() < 1e-9, "rise {}", tracker.max_rise_m);
    }

    #[test]
    fn a_rise_begins_where_the_thing_last_rested() {
        let mut fallen = HoldTracker::default();
        fallen.rests(0.10);
        fallen.rests(0.03);
        let sample = HoldSample {
            stamp_secs: 0.0,
            clearance_m: 0.01,
            centre_m: 0.15,
            touched_by_hand: true,
            supported: false,
            palm_from_object: Pose::identity(),
            motors: [0.0; 2],
        };
        assert!(fallen.update(&sample));
        assert!((fallen.max_rise_m - 0.12).abs() < 1e-12);
    }

    #[test]
    fn phases() {
        check("0s 0s 0hs", HoldPhase::Supported, 0.0, 0.0); // nothing lifted
        check("0s 4h 4h", HoldPhase::Supported, 0.0, 0.0); // under the threshold
        check("0s 80 80", HoldPhase::Supported, 0.0, 0.0); // flies without the hand
        check("0hs 20hs 30hs", HoldPhase::Supported, 0.0, 0.0); // leans on something else
        check("0hs 6h 50h 120h", HoldPhase::Held, 0.10, 120.0);
        check("0hs 6h 50h 50 50h", HoldPhase::Held, 0.15, 50.0); // a short gap is bridged
        check("0hs 6h 50h 40 30 20 0s 0s", HoldPhase::Supported, 0.05, 50.0); // dropped
        check("0hs 6h 50h 40 30 20 30h 60h", HoldPhase::Lost, 0.05, 50.0); // caught in the air: no new hold
        check("0hs 6h 50h 0s 6h 30h 30h", HoldPhase::Held, 0.10, 50.0); // grasped again
    }

    #[track_caller]
    fn check_slip(steps: &str, slip_m: f64, max_slip_m: f64) {
        assert_eq!(run(steps).latest.map(|hold| (hold.slip().0, hold.max_slip_m)), Some((slip_m, max_slip_m)), "{steps}");
    }

    #[test]
    fn slip_is_measured_from_the_closed_hand() {
        // Closed on the table: from lift-off.
        check_slip("0hs 0hs 0hs 6h 50h 50hd 50h", 0.0, 0.01);
        // Raised by the closing fingers: from where the motors have stood for two steps.
        check_slip("0hsm 6hm 8hmd 8hd 8hd 50hd", 0.0, 0.0);
        check_slip("0hsm 6hm 8hm 8h 8h 8h 8hd 50hd", 0.01, 0.01);
        // Motors that start again later change nothing.
        check_slip("0hs 0hs 0hs 6h 50h 50hmd 50hmd", 0.01, 0.01);
    }

    #[test]
    fn motors_that_never_stop_close_for_two_seconds_at_most() {
        let creeping = |n: usize| format!("0hsm 6hm {}", (0..n).map(|_| "8hm ").collect::<String>() + "8hmd 8hmd");
        assert_eq!(run(&creeping(30)).latest.map(|hold| hold.max_slip_m), Some(0.0));
        assert_eq!(run(&creeping(60)).latest.map(|hold| hold.max_slip_m), Some(0.01));
    }
}

//! One joint in control periods: how it comes to rest, and which next accelerations leave it room to do so.
//!
//! Position, velocity and acceleration are tied by differences over one period `T`: `v = (q - q_before) / T`,
//! `a = (v - v_before) / T`. So what holds here holds for the finite differences of the positions that are sent, whoever takes them.

use sfg_kinematics::JointLimits;

/// Where a joint is at the end of a period, rad (or m) and seconds.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Moving {
    pub(crate) q: f64,
    pub(crate) v: f64,
    pub(crate) a: f64,
}

impl Moving {
    /// One period further with the acceleration `a`.
    pub(crate) fn next(&self, a: f64, period_secs: f64) -> Self {
        let v = self.v + a * period_secs;
        Self { q: self.q + v * period_secs, v, a }
    }

    /// The acceleration that leads to `q` in one period.
    pub(crate) fn acceleration_to(&self, q: f64, period_secs: f64) -> f64 {
        ((q - self.q) / period_secs - self.v) / period_secs
    }

    fn mirrored(&self) -> Self {
        Self { q: -self.q, v: -self.v, a: -self.a }
    }

    pub(crate) fn is_at_rest(&self) -> bool {
        self.v == 0.0 && self.a == 0.0
    }
}

/// The limits of one joint in control periods.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Brake {
    period_secs: f64,
    v_max: f64,
    a_max: f64,
    /// Largest change of the acceleration in a period.
    a_step: f64,
}

/// Next accelerations that keep the limits, now and while braking.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Window {
    pub(crate) low: f64,
    pub(crate) high: f64,
}

/// A place of rest this near to the one asked for is that one, radians.
const REST_TOLERANCE: f64 = 1e-11;
const MOST_CUTS: usize = 40;

impl Brake {
    pub(crate) fn new(limits: &JointLimits, period_secs: f64) -> Self {
        Self { period_secs, v_max: limits.velocity, a_max: limits.acceleration, a_step: limits.jerk * period_secs }
    }

    /// The `x` for which accelerations `x, x - step, x - 2 step, ... > 0` add up to `sum`.
    fn first_of(&self, sum: f64) -> f64 {
        let n = (0.5 * ((1.0 + 8.0 * sum / self.a_step).sqrt() - 1.0)).ceil().max(1.0);
        (sum + self.a_step * n * (n - 1.0) / 2.0) / n
    }

    /// The sum of accelerations `x, x - step, x - 2 step, ... > 0`.
    fn sum_from(&self, x: f64) -> f64 {
        let n = (x / self.a_step).ceil().max(0.0);
        n * x - self.a_step * n * (n - 1.0) / 2.0
    }

    /// Velocity when the acceleration `a` and all after it have been let go as fast as the jerk allows.
    fn let_go(&self, v: f64, a: f64) -> f64 {
        v + self.period_secs * self.sum_from(a.abs()).copysign(a)
    }

    /// The next acceleration on the way to rest: the strongest braking after which velocity and acceleration still vanish together.
    pub(crate) fn braking(&self, at: &Moving) -> f64 {
        let landing = -self.first_of(at.v.abs() / self.period_secs).copysign(at.v);
        let landing = if at.v == 0.0 { 0.0 } else { landing };
        let (low, high) = self.reach(at.a);
        landing.clamp(low, high)
    }

    /// Next accelerations that the limits of acceleration and jerk leave.
    fn reach(&self, a: f64) -> (f64, f64) {
        ((a - self.a_step).max(-self.a_max), (a + self.a_step).min(self.a_max))
    }

    /// How far the joint still moves until it rests when it brakes from now on.
    pub(crate) fn way_to_rest(&self, at: &Moving) -> f64 {
        let w = self.let_go(at.v, (at.a.abs() - self.a_step).max(0.0).copysign(at.a));
        if w < 0.0 { -self.way_forward(&at.mirrored()) } else { self.way_forward(at) }
    }

    /// [`Self::way_to_rest`] of a joint that brakes by lowering its acceleration.
    fn way_forward(&self, at: &Moving) -> f64 {
        let (t, h) = (self.period_secs, self.a_step);
        // Full steps down to the limit of acceleration; one more reaches it exactly.
        let n_down = ((at.a + self.a_max) / h).floor().max(0.0);
        let after = |k: f64| -> (f64, f64, f64) {
            let d = k.min(n_down);
            // Sums over 1..=d of a - i h and of their sums.
            let v = at.v + t * (d * at.a - h * d * (d + 1.0) / 2.0);
            let q = t * (d * at.v + t * (at.a * d * (d + 1.0) / 2.0 - h * d * (d + 1.0) * (d + 2.0) / 6.0));
            let r = k - d;
            let a = if r > 0.0 { -self.a_max } else { at.a - d * h };
            (q + t * (r * v - t * self.a_max * r * (r + 1.0) / 2.0), v - t * self.a_max * r, a)
        };
        let lands = |k: f64| {
            let (_, v, a) = after(k);
            self.let_go(v, (a - h).max(-self.a_max)) <= 0.0
        };
        let (mut least, mut most) = (-1.0, 0.0);
        while !lands(most) {
            (least, most) = (most, 2.0 * most + 1.0);
        }
        while most - least > 1.0 {
            let middle = (0.5 * (least + most)).floor();
            if lands(middle) { most = middle } else { least = middle }
        }
        let (q, v, _) = after(most);
        let x = self.first_of(v.max(0.0) / t);
        let n = (x / h).ceil();
        q + t * (n * v - t * (x * n * (n + 1.0) / 2.0 - h * (n - 1.0) * n * (n + 1.0) / 6.0))
    }

    /// Place of rest after one period with the acceleration `a`, braking from then on.
    pub(crate) fn rest_after(&self, at: &Moving, a: f64) -> f64 {
        let next = at.next(a, self.period_secs);
        next.q + self.way_to_rest(&next)
    }

    /// Next accelerations after which the joint can brake within velocity, acceleration, jerk and `lower..=upper`.
    ///
    /// Braking itself is always among them, also where a limit is broken already.
    pub(crate) fn window(&self, at: &Moving, lower: f64, upper: f64) -> Window {
        let braking = self.braking(at);
        let (mut low, mut high) = self.reach(at.a);
        let speed_left = |v: f64| if self.v_max > v { self.first_of((self.v_max - v) / self.period_secs) } else { 0.0 };
        high = high.min(speed_left(at.v)).max(braking);
        low = low.max(-speed_left(-at.v)).min(braking);
        if self.rest_after(at, high) > upper {
            high = self.last_before(at, upper, braking, high);
        }
        if self.rest_after(at, low) < lower {
            low = self.last_before(at, lower, braking, low);
        }
        Window { low, high }
    }

    /// The acceleration within `window` whose place of rest is nearest to `rest`.
    pub(crate) fn towards(&self, at: &Moving, rest: f64, window: &Window) -> f64 {
        if self.rest_after(at, window.high) <= rest {
            window.high
        } else if self.rest_after(at, window.low) >= rest {
            window.low
        } else {
            self.last_before(at, rest, window.low, window.high)
        }
    }

    /// The acceleration between `good` and `bad` that is nearest to `bad` and does not bring the place of rest beyond `rest`.
    fn last_before(&self, at: &Moving, rest: f64, good: f64, bad: f64) -> f64 {
        let sign = (bad - good).signum();
        let beyond = |a: f64| sign * (self.rest_after(at, a) - rest);
        let (mut good, mut bad) = ((good, beyond(good)), (bad, beyond(bad)));
        // The place of rest moves with the acceleration: regula falsi, halving weights that stay (Dowell and Jarratt's Illinois).
        for _ in 0..MOST_CUTS {
            if good.1 > -REST_TOLERANCE || (bad.0 - good.0).abs() < 1e-9 * self.a_step {
                break;
            }
            let cut = good.0 - good.1 * (bad.0 - good.0) / (bad.1 - good.1);
            // Just on the good side, so that this end moves too.
            let cut = cut + 1e-3 * (good.0 - cut);
            let value = beyond(cut);
            if value <= 0.0 {
                good = (cut, value);
                bad.1 *= 0.5;
            } else {
                bad = (cut, value);
                good.1 *= 0.5;
            }
        }
        good.0
    }

    /// Period of control.
    pub(crate) fn period_secs(&self) -> f64 {
        self.period_secs
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    fn joint(period_secs: f64, jerk: f64) -> Brake {
        let limits = JointLimits { lower: -2.0, upper: 2.0, velocity: 2.175, acceleration: 15.0, jerk, effort: 87.0 };
        Brake::new(&limits, period_secs)
    }

    /// Brakes step by step; the way, and the largest velocity, acceleration and jerk met.
    fn brake(joint: &Brake, start: Moving) -> (f64, [f64; 3]) {
        let (mut at, mut most) = (start, [0.0; 3]);
        for _ in 0..100_000 {
            if at.is_at_rest() {
                return (at.q - start.q, most);
            }
            let next = at.next(joint.braking(&at), joint.period_secs);
            for (most, value) in most.iter_mut().zip([next.v, next.a, (next.a - at.a) / joint.period_secs]) {
                *most = f64::max(*most, value.abs());
            }
            at = next;
            if at.v.abs() < 1e-12 && at.a.abs() < 1e-9 {
                at = Moving { v: 0.0, a: 0.0, ..at };
            }
        }
        panic!("{start:?} does not come to rest: {at:?}");
    }

    #[test]
    fn the_way_to_rest_is_that_of_braking_step_by_step() {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        for (period_secs, jerk) in [(0.001, 7500.0), (0.001, 300.0), (0.004, 7500.0), (0.004, 200.0)] {
            let joint = joint(period_secs, jerk);
            for _ in 0..300 {
                let a = rng.random_range(-15.0..15.0);
                let at = Moving { q: rng.random_range(-1.0..1.0), v: rng.random_range(-2.175..2.175), a };
                let (way, [_, a_most, jerk_most]) = brake(&joint, at);
                assert!((way - joint.way_to_rest(&at)).abs() < 1e-9, "{at:?}: {way} and {}", joint.way_to_rest(&at));
                assert!(a_most <= 15.0 * (1.0 + 1e-9) && jerk_most <= jerk * (1.0 + 1e-9), "{at:?}: {a_most}, {jerk_most}");
            }
        }
    }

    #[test]
    fn whatever_is_chosen_in_the_window_keeps_every_limit() {
        let mut rng = ChaCha8Rng::seed_from_u64(2);
        for (period_secs, jerk) in [(0.001, 7500.0), (0.001, 300.0), (0.004, 7500.0)] {
            let joint = joint(period_secs, jerk);
            let mut at = Moving::default();
            for step in 0..20_000 {
                let window = joint.window(&at, -0.5, 0.7);
                let braking = joint.braking(&at);
                assert!(window.low <= braking + 1e-12 && braking <= window.high + 1e-12, "{window:?} without {braking}");
                let a = match step / 2000 % 3 {
                    0 => window.high,
                    1 => window.low,
                    _ => rng.random_range(window.low..=window.high),
                };
                let next = at.next(a, period_secs);
                assert!(next.v.abs() <= 2.175 + 1e-9 && next.a.abs() <= 15.0 + 1e-9, "{next:?}");
                assert!((next.a - at.a).abs() <= jerk * period_secs + 1e-9);
                assert!((-0.5 - 1e-9..=0.7 + 1e-9).contains(&next.q), "{next:?}");
                at = next;
            }
        }
    }

    #[test]
    fn full_speed_is_reached_and_kept_until_the_joint_must_brake() {
        let joint = joint(0.001, 7500.0);
        let mut at = Moving::default();
        let (mut n_fast, mut n) = (0, 0);
        while n < 3000 {
            at = at.next(joint.window(&at, -2.0, 2.0).high, 0.001);
            n_fast += u32::from(at.v > 0.99 * 2.175);
            n += 1;
        }
        assert!(n_fast > 700, "{n_fast}");
        assert!((at.q - 2.0).abs() < 1e-6, "stands at its limit: {at:?}");
    }

    #[test]
    fn a_place_to_rest_is_met_exactly() {
        let joint = joint(0.001, 7500.0);
        let mut at = Moving::default();
        for _ in 0..2000 {
            let window = joint.window(&at, -2.0, 2.0);
            at = at.next(joint.towards(&at, 0.3, &window), 0.001);
        }
        assert!((at.q - 0.3).abs() < 1e-6, "{at:?}");
    }
}

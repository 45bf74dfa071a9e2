//! The way to rest: every joint slows down at its largest acceleration.

/// Acceleration where a robot names none, rad/s^2.
const DEFAULT_ACCELERATION: f64 = 10.0;

/// Moves a set point by one period of the ramp.
pub(crate) fn slow_down(q: &mut [f64], dq: &mut [f64], accelerations: impl Iterator<Item = f64>, period_secs: f64) {
    for ((q, dq), acceleration) in q.iter_mut().zip(dq.iter_mut()).zip(accelerations) {
        let acceleration = if acceleration.is_finite() { acceleration } else { DEFAULT_ACCELERATION };
        let change = dq.abs().min(acceleration * period_secs);
        let after = *dq - change * dq.signum();
        *q += (*dq + after) / 2.0 * period_secs;
        *dq = after;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn check(dq: f64, acceleration: f64, stops_after: usize) {
        let (mut q, mut v) = ([1.0], [dq]);
        for step in 0..stops_after {
            assert!(v[0].abs() > 1e-12, "stands after {step} steps");
            slow_down(&mut q, &mut v, [acceleration].into_iter(), 0.01);
        }
        assert!(v[0].abs() < 1e-12, "still moves at {}", v[0]);
        let way = 0.5 * dq * dq.abs() / acceleration;
        assert!((q[0] - 1.0 - way).abs() <= 0.01 * dq.abs(), "went {} instead of {way}", q[0] - 1.0);
    }

    #[test]
    fn rest_is_reached_on_time_and_on_the_way_of_a_parabola() {
        check(1.0, 10.0, 10);
        check(-1.0, 10.0, 10);
        check(0.05, 10.0, 1);
        check(0.0, 10.0, 0);
    }

    #[test]
    fn a_missing_limit_still_stops() {
        let (mut q, mut dq) = ([0.0], [2.0]);
        for _ in 0..100 {
            slow_down(&mut q, &mut dq, [f64::INFINITY].into_iter(), 0.004);
        }
        assert_eq!(dq, [0.0]);
    }
}

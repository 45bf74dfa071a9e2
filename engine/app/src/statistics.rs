//! Intervals for success rates.

/// Wilson's 95 % interval of a proportion (Wilson 1927): stays inside [0, 1] and is honest at the ends.
#[must_use]
pub(crate) fn wilson_interval(n_successes: usize, n_trials: usize) -> (f64, f64) {
    const Z: f64 = 1.959_963_984_540_054;
    if n_trials == 0 {
        return (0.0, 1.0);
    }
    let n = n_trials as f64;
    let p = n_successes as f64 / n;
    let centre = p + Z * Z / (2.0 * n);
    let half = Z * (p * (1.0 - p) / n + Z * Z / (4.0 * n * n)).sqrt();
    let scale = 1.0 + Z * Z / n;
    (((centre - half) / scale).max(0.0), ((centre + half) / scale).min(1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn check(n_successes: usize, n_trials: usize, expected: (f64, f64)) {
        let (low, high) = wilson_interval(n_successes, n_trials);
        assert!((low - expected.0).abs() < 0.005 && (high - expected.1).abs() < 0.005, "{low} {high}");
    }

    #[test]
    fn known_intervals() {
        check(92, 100, (0.85, 0.96)); // Table I of the paper, as its requirements recompute it
        check(85, 100, (0.77, 0.91));
        check(0, 10, (0.0, 0.28));
        check(0, 0, (0.0, 1.0));
    }
}

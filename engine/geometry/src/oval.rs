//! Oval cross-sections: a circle stretched along one direction, and the ellipse through half-seen outlines.
//!
//! Bottles are often flat. Squeezed along its long direction an oval becomes a circle again, so that what is known about
//! bodies of revolution serves for them as well.

use nalgebra::{Matrix2, Matrix3, Vector2, Vector3};

/// The form of a horizontal cross-section; round when `aspect` is 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Oval {
    /// Unit vector along the long direction.
    pub long: Vector2<f64>,
    /// Long over short diameter, at least 1.
    pub aspect: f64,
}

impl Oval {
    /// A circle.
    pub const ROUND: Self = Self { long: Vector2::new(1.0, 0.0), aspect: 1.0 };

    /// An oval whose long direction lies at an angle from +X.
    #[must_use]
    pub fn new(yaw_rad: f64, aspect: f64) -> Self {
        Self { long: Vector2::new(yaw_rad.cos(), yaw_rad.sin()), aspect }
    }

    /// Angle of the long direction, [-pi/2, pi/2).
    #[must_use]
    pub fn yaw_rad(&self) -> f64 {
        let pi = std::f64::consts::PI;
        (self.long.y.atan2(self.long.x) + pi / 2.0).rem_euclid(pi) - pi / 2.0
    }

    /// The map, of determinant 1, that turns ovals of this form into circles.
    #[must_use]
    pub fn squeeze(&self) -> Matrix2<f64> {
        self.stretched(1.0 / self.aspect.sqrt())
    }

    /// The inverse of [`Self::squeeze`].
    #[must_use]
    pub fn stretch(&self) -> Matrix2<f64> {
        self.stretched(self.aspect.sqrt())
    }

    fn stretched(&self, factor: f64) -> Matrix2<f64> {
        let long = self.long * self.long.transpose();
        long * factor + (Matrix2::identity() - long) / factor
    }

    /// Radius of the circle that the oval through `offset` (from the centre, metres) becomes: its geometric mean radius.
    #[must_use]
    pub fn radius_through_m(&self, offset: &Vector2<f64>) -> f64 {
        let along = offset.dot(&self.long);
        let across = offset.norm_squared() - along * along;
        (along * along / self.aspect + across.max(0.0) * self.aspect).sqrt()
    }

    /// Signed distance, to first order, of `offset` from the oval of mean radius `radius_m`; positive outside.
    #[must_use]
    pub fn distance_m(&self, offset: &Vector2<f64>, radius_m: f64) -> f64 {
        let through_m = self.radius_through_m(offset);
        if self.aspect <= 1.0 || through_m < 1e-9 {
            return through_m - radius_m;
        }
        let squeeze = self.squeeze();
        let slope = (squeeze * (squeeze * offset)).norm() / through_m;
        (through_m - radius_m) / slope
    }

    /// Point of the oval of mean radius 1 where the outward normal is `normal` (unit).
    #[must_use]
    pub fn support(&self, normal: &Vector2<f64>) -> Vector2<f64> {
        let stretched = self.stretch() * normal;
        self.stretch() * stretched / stretched.norm().max(1e-12)
    }

    /// Half the long and half the short diameter at mean radius `radius_m`.
    #[must_use]
    pub fn half_axes_m(&self, radius_m: f64) -> [f64; 2] {
        [radius_m * self.aspect.sqrt(), radius_m / self.aspect.sqrt()]
    }
}

/// The ellipse that fits points best, as centre, form and mean radius; `None` for fewer than six points or no ellipse.
///
/// Direct least squares with the ellipse constraint, partitioned as by R. Halir and J. Flusser, "Numerically stable direct least squares
/// fitting of ellipses", WSCG 1998. Noise on a short arc makes the ellipse too small.
#[must_use]
pub fn fit_ellipse(points: &[Vector2<f64>]) -> Option<(Vector2<f64>, Oval, f64)> {
    if points.len() < 6 {
        return None;
    }
    let n = points.len() as f64;
    let mean = points.iter().sum::<Vector2<f64>>() / n;
    let scale = (points.iter().map(|p| (p - mean).norm_squared()).sum::<f64>() / n).sqrt();
    if scale < 1e-9 {
        return None;
    }
    let (mut s1, mut s2, mut s3) = (Matrix3::zeros(), Matrix3::zeros(), Matrix3::zeros());
    for p in points {
        let q = (p - mean) / scale;
        let square = Vector3::new(q.x * q.x, q.x * q.y, q.y * q.y);
        let plain = Vector3::new(q.x, q.y, 1.0);
        s1 += square * square.transpose();
        s2 += square * plain.transpose();
        s3 += plain * plain.transpose();
    }
    let t = -s3.try_inverse()? * s2.transpose();
    let reduced = s1 + s2 * t;
    let constrained = Matrix3::from_rows(&[reduced.row(2) / 2.0, -reduced.row(1), reduced.row(0) / 2.0]);
    let conic =
        constrained.complex_eigenvalues().iter().filter(|value| value.im.abs() < 1e-9 * (1.0 + value.re.abs())).find_map(
            |value| {
                let a = null_vector(&(constrained - Matrix3::identity() * value.re))?;
                (4.0 * a.x * a.z - a.y * a.y > 0.0).then_some(a)
            },
        )?;
    let linear = t * conic;
    // (p - c)' A (p - c) = k
    let a = Matrix2::new(conic.x, conic.y / 2.0, conic.y / 2.0, conic.z);
    let centre = -a.try_inverse()? * Vector2::new(linear.x, linear.y) / 2.0;
    let k = centre.dot(&(a * centre)) - linear.z;
    let form = nalgebra::SymmetricEigen::new(a / k);
    if !form.eigenvalues.iter().all(|value| *value > 0.0) {
        return None;
    }
    let (long_idx, short_idx) = if form.eigenvalues[0] < form.eigenvalues[1] { (0, 1) } else { (1, 0) };
    let half = |idx: usize| scale / form.eigenvalues[idx].sqrt();
    let long = form.eigenvectors.column(long_idx).into_owned();
    let oval = Oval { long, aspect: (half(long_idx) / half(short_idx)).max(1.0) };
    Some((mean + centre * scale, oval, (half(long_idx) * half(short_idx)).sqrt()))
}

/// The direction that a matrix of rank 2 maps to zero.
fn null_vector(m: &Matrix3<f64>) -> Option<Vector3<f64>> {
    let rows = [0, 1, 2].map(|i| m.row(i).transpose());
    let crosses = [rows[0].cross(&rows[1]), rows[1].cross(&rows[2]), rows[2].cross(&rows[0])];
    crosses.into_iter().max_by(|a, b| a.norm_squared().total_cmp(&b.norm_squared()))?.try_normalize(1e-30)
}

#[cfg(test)]
mod tests {
    #![expect(clippy::unwrap_used, reason = "tests fail by panicking")]
    use super::*;
    use std::f64::consts::TAU;

    /// Points of an ellipse over an arc, moved by a pattern of `noise_m`.
    fn arc(centre: [f64; 2], oval: &Oval, radius_m: f64, from_turn: f64, to_turn: f64, noise_m: f64) -> Vec<Vector2<f64>> {
        (0..600)
            .map(|i| {
                let angle = TAU * (from_turn + (to_turn - from_turn) * f64::from(i) / 599.0);
                let circle = Vector2::new(angle.cos(), angle.sin()) * (radius_m + noise_m * (f64::from(i) * 2.399).sin());
                Vector2::from(centre) + oval.stretch() * circle
            })
            .collect()
    }

    #[track_caller]
    fn check(yaw_deg: f64, aspect: f64, arc_turns: f64, noise_m: f64, tolerance_m: f64) {
        let oval = Oval::new(yaw_deg.to_radians(), aspect);
        let points = arc([0.8, 0.3], &oval, 0.035, 0.2, 0.2 + arc_turns, noise_m);
        let (centre, found, radius_m) = fit_ellipse(&points).unwrap();
        assert!((centre - Vector2::new(0.8, 0.3)).norm() < tolerance_m, "{centre}");
        assert!((radius_m - 0.035).abs() < tolerance_m, "{radius_m}");
        assert!((found.aspect - aspect).abs() < 100.0 * tolerance_m, "{}", found.aspect);
        if aspect > 1.2 {
            let turn = (found.yaw_rad() - oval.yaw_rad()).sin().abs();
            assert!(turn < 20.0 * tolerance_m, "{} {}", found.yaw_rad(), oval.yaw_rad());
        }
    }

    #[test]
    fn ellipses_are_found_from_a_part_of_their_outline() {
        check(0.0, 1.0, 1.0, 0.0, 1e-6);
        check(30.0, 1.7, 1.0, 0.0, 1e-6);
        check(-70.0, 2.0, 0.5, 0.0, 1e-6);
        check(100.0, 1.5, 0.6, 0.001, 0.003);
        check(20.0, 1.9, 0.6, 0.001, 0.003);
    }

    #[test]
    fn few_points_or_a_line_are_no_ellipse() {
        assert!(fit_ellipse(&[Vector2::zeros(); 5]).is_none());
        assert!(fit_ellipse(&[Vector2::new(0.1, 0.2); 20]).is_none());
        let line: Vec<Vector2<f64>> = (0..40).map(|i| Vector2::new(f64::from(i), 2.0 * f64::from(i))).collect();
        assert!(fit_ellipse(&line).is_none_or(|(_, oval, _)| oval.aspect > 20.0));
    }

    #[test]
    fn distances_and_supports_fit_the_oval() {
        let oval = Oval::new(0.5, 1.8);
        for i in 0..12 {
            let angle = TAU * f64::from(i) / 12.0;
            let on = oval.stretch() * Vector2::new(angle.cos(), angle.sin()) * 0.04;
            assert!(oval.distance_m(&on, 0.04).abs() < 1e-12);
            let normal = Vector2::new(angle.cos(), angle.sin());
            let touch = oval.support(&normal) * 0.04;
            assert!(oval.distance_m(&touch, 0.04).abs() < 1e-12);
            assert!((oval.distance_m(&(touch + normal * 0.002), 0.04) - 0.002).abs() < 2e-4);
        }
        assert_eq!(Oval::ROUND.distance_m(&Vector2::new(0.03, 0.04), 0.02), 0.030000000000000002);
    }
}

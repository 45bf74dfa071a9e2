//! A path of straight ways with its corners rounded: three continuous derivatives, so that accelerations and jerks stay finite.

use crate::collision::{CollisionModel, distance};
use crate::error::PlanningError;
use nalgebra::DVector;
use sfg_kinematics::Chain;

/// A smooth curve over the arc length `u` of the straight-line path, 0 to [`Self::length_rad`].
///
/// The direction of travel does not jump at a corner but turns over an interval of half width `h` by the bump
/// `k(x) = 15/(16 h) (1 - (x/h)^2)^2`. Position is the bump's double integral, so ends and straight stretches are kept exactly.
#[derive(Clone, Debug)]
pub struct SmoothPath {
    start: DVector<f64>,
    direction: DVector<f64>,
    corners: Vec<Corner>,
    // turns[i], moments[i]: sums of turn and turn * at over corners[..i].
    turns: Vec<DVector<f64>>,
    moments: Vec<DVector<f64>>,
    widest: f64,
    length_rad: f64,
}

#[derive(Clone, Debug)]
struct Corner {
    at: f64,
    half_width: f64,
    turn: DVector<f64>,
}

/// Position and its derivatives by arc length.
#[derive(Clone, Debug, PartialEq)]
pub struct CurvePoint {
    /// Configuration.
    pub q: DVector<f64>,
    /// First derivative.
    pub d1: DVector<f64>,
    /// Second derivative.
    pub d2: DVector<f64>,
    /// Third derivative.
    pub d3: DVector<f64>,
}

impl SmoothPath {
    /// Rounds the corners of `path` with half width `half_width_rad`, less near the ends.
    ///
    /// # Errors
    /// [`PlanningError::BadPath`].
    pub fn new(path: &[Vec<f64>], half_width_rad: f64) -> Result<Self, PlanningError> {
        let n_joints = path.first().map_or(0, Vec::len);
        let bad = |found: String| PlanningError::BadPath { n_joints, found };
        if path.len() < 2 || n_joints == 0 {
            return Err(bad(format!("{} configurations", path.len())));
        }
        if let Some(odd) = path.iter().find(|q| q.len() != n_joints || !q.iter().all(|v| v.is_finite())) {
            return Err(bad(format!("{odd:?}")));
        }
        let start = DVector::from_column_slice(&path[0]);
        let pieces: Vec<(f64, DVector<f64>)> = path
            .windows(2)
            .map(|w| (distance(&w[0], &w[1]), DVector::from_column_slice(&w[1]) - DVector::from_column_slice(&w[0])))
            .filter(|(length, _)| *length > 1e-9)
            .map(|(length, step)| (length, step / length))
            .collect();
        let length_rad: f64 = pieces.iter().map(|(length, _)| length).sum();
        let mut corners = Vec::new();
        let mut at = 0.0;
        for pair in pieces.windows(2) {
            at += pair[0].0;
            let half_width = half_width_rad.min(at).min(length_rad - at).max(1e-9);
            corners.push(Corner { at, half_width, turn: &pair[1].1 - &pair[0].1 });
        }
        let zero = DVector::zeros(n_joints);
        let (mut turns, mut moments) = (vec![zero.clone()], vec![zero.clone()]);
        for (idx, corner) in corners.iter().enumerate() {
            turns.push(&turns[idx] + &corner.turn);
            moments.push(&moments[idx] + &corner.turn * corner.at);
        }
        let direction = pieces.first().map_or(zero, |(_, d)| d.clone());
        let widest = corners.iter().map(|c| c.half_width).fold(0.0, f64::max);
        Ok(Self { start, direction, corners, turns, moments, widest, length_rad })
    }

    /// Rounds as widely as obstacles and position limits allow: halves the width until the curve is free.
    ///
    /// # Errors
    /// [`PlanningError::BadPath`], or [`PlanningError::NoRoom`] when even 2 mrad is too wide.
    pub fn fitted(
        path: &[Vec<f64>],
        half_width_rad: f64,
        chain: &Chain,
        collision: Option<&CollisionModel>,
    ) -> Result<Self, PlanningError> {
        let mut width = half_width_rad;
        loop {
            let curve = Self::new(path, width)?;
            match curve.trouble(chain, collision) {
                None => return Ok(curve),
                Some(reason) if width <= 0.002 => return Err(PlanningError::NoRoom { reason }),
                Some(_) => width = (width / 2.0).max(0.002),
            }
        }
    }

    /// Arc length of the straight-line path, radians.
    #[must_use]
    pub fn length_rad(&self) -> f64 {
        self.length_rad
    }

    /// Position and derivatives at `u`.
    #[must_use]
    pub fn at(&self, u: f64) -> CurvePoint {
        // Corners before `done` have turned fully; those from `ahead` on have not begun.
        let done = self.corners.partition_point(|c| c.at < u - self.widest);
        let ahead = self.corners.partition_point(|c| c.at <= u + self.widest);
        let mut point = CurvePoint {
            q: &self.start + &self.direction * u + &self.turns[done] * u - &self.moments[done],
            d1: &self.direction + &self.turns[done],
            d2: DVector::zeros(self.start.len()),
            d3: DVector::zeros(self.start.len()),
        };
        for corner in &self.corners[done..ahead] {
            let h = corner.half_width;
            let y = (u - corner.at) / h;
            if y <= -1.0 {
                continue;
            }
            if y >= 1.0 {
                point.q.axpy(u - corner.at, &corner.turn, 1.0);
                point.d1 += &corner.turn;
                continue;
            }
            let (y2, w) = (y * y, 1.0 - y * y);
            let twice = (y + 1.0) / 2.0 + 0.9375 * ((y2 - 1.0) / 2.0 - (y2 * y2 - 1.0) / 6.0 + (y2 * y2 * y2 - 1.0) / 30.0);
            point.q.axpy(h * twice, &corner.turn, 1.0);
            point.d1.axpy(0.5 + 0.9375 * y * (1.0 - y2 * (2.0 / 3.0 - y2 / 5.0)), &corner.turn, 1.0);
            point.d2.axpy(0.9375 / h * w * w, &corner.turn, 1.0);
            point.d3.axpy(-3.75 / (h * h) * y * w, &corner.turn, 1.0);
        }
        point
    }

    /// Configurations every `step_rad` of arc length, ends included.
    #[must_use]
    pub fn samples(&self, step_rad: f64) -> Vec<Vec<f64>> {
        let n = (self.length_rad / step_rad).ceil().max(1.0) as usize;
        (0..=n).map(|i| self.at(self.length_rad * i as f64 / n as f64).q.as_slice().to_vec()).collect()
    }

    fn trouble(&self, chain: &Chain, collision: Option<&CollisionModel>) -> Option<String> {
        for q in self.samples(1.0 / 512.0) {
            if !chain.is_inside_limits(&q, 1e-9) {
                return Some("the curve leaves the position limits".to_owned());
            }
            if let Some(contact) = collision.filter(|c| !c.is_free(&q)).and_then(|c| c.contact(&q)) {
                return Some(contact.to_string());
            }
        }
        None
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "tests fail by panicking")]
    use super::*;

    fn curve() -> SmoothPath {
        let path = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [1.1, 1.05], [0.5, 0.2]].map(|q| q.to_vec());
        SmoothPath::new(&path, 0.3).unwrap()
    }

    #[test]
    fn ends_and_straight_stretches_are_kept() {
        let curve = curve();
        assert!((curve.at(0.0).q - DVector::from_vec(vec![0.0, 0.0])).norm() < 1e-12);
        assert!((curve.at(curve.length_rad()).q - DVector::from_vec(vec![0.5, 0.2])).norm() < 1e-12);
        assert!((curve.at(0.4).q - DVector::from_vec(vec![0.4, 0.0])).norm() < 1e-12);
        // A right angle is cut by 0.15625 h sqrt(2).
        let cut = (curve.at(1.0).q - DVector::from_vec(vec![1.0, 0.0])).norm();
        assert!((cut - 0.15625 * 0.3 * 2.0_f64.sqrt()).abs() < 1e-9, "{cut}");
    }

    #[test]
    fn derivatives_match_finite_differences() {
        let curve = curve();
        let h = 1e-5;
        for i in 1..400 {
            let u = curve.length_rad() * f64::from(i) / 400.0;
            let (a, b, p) = (curve.at(u - h), curve.at(u + h), curve.at(u));
            assert!(((&b.q - &a.q) / (2.0 * h) - &p.d1).norm() < 1e-6, "{u}");
            assert!(((&b.d1 - &a.d1) / (2.0 * h) - &p.d2).norm() < 1e-4, "{u}");
            // d3 has kinks at the rims of the bumps.
            assert!(((&b.d2 - &a.d2) / (2.0 * h) - &p.d3).norm() < 0.02 * (1.0 + p.d3.norm()), "{u}");
        }
    }

    #[test]
    fn a_path_without_motion_or_with_nan_is_judged() {
        assert_eq!(SmoothPath::new(&[vec![0.1], vec![0.1]], 0.3).unwrap().length_rad(), 0.0);
        assert!(SmoothPath::new(&[vec![0.1]], 0.3).is_err());
        assert!(SmoothPath::new(&[vec![0.1], vec![f64::NAN]], 0.3).is_err());
        assert!(SmoothPath::new(&[vec![0.1], vec![0.1, 0.2]], 0.3).is_err());
    }
}

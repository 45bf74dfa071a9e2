//! An axis of a tip that stays within an angle of a direction: a full cup is carried upright.

use crate::collision::{distance, mix};
use nalgebra::{Unit, Vector3};
use sfg_kinematics::Chain;
use sfg_types::Vector;

/// The angle between an axis of a tip and a direction is at most so large.
///
/// Planners keep it on the straight ways between corners. [`crate::retime`] rounds the corners afterwards and does not look at
/// it: ask for a little less than what spills (in nine plans of one and two arms the default rounding added at most 0.6 mrad).
#[derive(Clone, Debug, PartialEq)]
pub struct KeepAxis {
    /// Which tip of the chain.
    pub tip_idx: usize,
    /// The axis, in the tip's frame.
    pub axis_in_tip: Unit<Vector>,
    /// The direction, in the base frame.
    pub direction_in_base: Unit<Vector>,
    /// Largest angle between them, radians; above 0.
    pub max_angle_rad: f64,
}

/// Steps of a projection.
const MAX_STEPS: usize = 10;
/// A projection aims this share of the angle inside, so that ways between two projected configurations bulge less often out.
const AIM: f64 = 0.8;

impl KeepAxis {
    /// The angle in configuration `q`, radians.
    #[must_use]
    pub fn angle_rad(&self, chain: &Chain, q: &[f64]) -> f64 {
        (chain.fk_of(self.tip_idx, q).rotation * self.axis_in_tip).angle(&self.direction_in_base)
    }

    /// Whether it is small enough in configuration `q`.
    #[must_use]
    pub fn holds(&self, chain: &Chain, q: &[f64]) -> bool {
        self.angle_rad(chain, q) <= self.max_angle_rad
    }

    /// Whether it is on the straight way between two configurations, looked at every `step_rad` or closer, ends included.
    #[must_use]
    pub fn holds_between(&self, chain: &Chain, a: &[f64], b: &[f64], step_rad: f64) -> bool {
        let n = (distance(a, b) / step_rad).ceil().max(1.0) as usize;
        (0..=n).all(|i| self.holds(chain, &mix(a, b, i as f64 / n as f64)))
    }
}

/// Moves `q` to a near configuration inside the position limits in which all hold; false when none was found.
///
/// # Source
/// Newton's method on the excess of the angle, as in CBiRRT (Berenson et al., 2009).
pub(crate) fn project(all: &[KeepAxis], chain: &Chain, q: &mut [f64]) -> bool {
    for _ in 0..MAX_STEPS {
        let mut hold = true;
        for keep in all {
            let axis: Vector3<f64> = (chain.fk_of(keep.tip_idx, q).rotation * keep.axis_in_tip).into_inner();
            let angle = axis.angle(&keep.direction_in_base);
            if angle <= keep.max_angle_rad {
                continue;
            }
            hold = false;
            // Opposite directions are brought together about any axis across them.
            let about = axis.cross(&keep.direction_in_base).try_normalize(1e-9);
            let about = about.unwrap_or_else(|| axis.cross(&axis.map(|v| 1.0 - v.abs())).normalize());
            let jacobian = chain.jacobian_of(keep.tip_idx, q);
            let rates: Vec<f64> = jacobian.column_iter().map(|column| about.dot(&column.fixed_rows::<3>(3))).collect();
            let scale = (angle - AIM * keep.max_angle_rad) / (rates.iter().map(|rate| rate * rate).sum::<f64>() + 1e-6);
            q.iter_mut().zip(&rates).for_each(|(value, rate)| *value += scale * rate);
            chain.clamp(q);
        }
        if hold {
            return true;
        }
    }
    false
}

//! An independent look at what was sent: finite differences of the positions, the palm's place, and distances, sample by sample.

use super::PalmBox;
use crate::collision::CollisionModel;
use sfg_kinematics::Chain;

/// A limit that was broken by what was sent.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Breach {
    /// Sample.
    pub at: usize,
    /// A joint's name, `palm`, or what touches what.
    pub subject: String,
    /// `position`, `velocity`, `acceleration`, `jerk`, `workspace` or `distance`.
    pub quantity: &'static str,
    /// Its value; for distances how deep, metres.
    pub value: f64,
    /// The limit.
    pub bound: f64,
}

/// Share of a limit that rounding may add: positions of 3 rad divided thrice by a millisecond.
const ROUNDING: f64 = 1e-5;

/// Looks at positions sent every `period_secs`, the first three of them at rest; all breaches, the first of each quantity and subject.
///
/// Nothing of the filter is used: differences are taken from the positions alone, and contacts are those of the one-by-one collision
/// check in double precision, clearance included.
///
/// # Panics
/// If a sample does not fit the chain.
#[must_use]
pub fn audit(
    log: &[Vec<f64>],
    chain: &Chain,
    period_secs: f64,
    palm_box: &PalmBox,
    world: Option<&CollisionModel>,
) -> Vec<Breach> {
    let mut found: Vec<Breach> = Vec::new();
    let mut note = |at: usize, subject: &str, quantity: &'static str, value: f64, bound: f64| {
        if !found.iter().any(|breach| breach.subject == subject && breach.quantity == quantity) {
            found.push(Breach { at, subject: subject.to_owned(), quantity, value, bound });
        }
    };
    for (at, q) in log.iter().enumerate() {
        assert_eq!(q.len(), chain.n_joints(), "one value for each joint");
        for (joint, (name, limits)) in chain.joint_names.iter().zip(&chain.limits).enumerate() {
            if !(limits.lower - 1e-9..=limits.upper + 1e-9).contains(&q[joint]) {
                note(at, name, "position", q[joint], if q[joint] < limits.lower { limits.lower } else { limits.upper });
            }
            let back = |n: usize| log[at.saturating_sub(n)][joint];
            let (q0, q1, q2, q3) = (back(0), back(1), back(2), back(3));
            let rates = [
                ("velocity", (q0 - q1) / period_secs, limits.velocity),
                ("acceleration", (q0 - 2.0 * q1 + q2) / period_secs.powi(2), limits.acceleration),
                ("jerk", (q0 - 3.0 * q1 + 3.0 * q2 - q3) / period_secs.powi(3), limits.jerk),
            ];
            for (quantity, value, bound) in rates {
                if value.is_nan() || value.abs() > bound * (1.0 + ROUNDING) {
                    note(at, name, quantity, value, bound);
                }
            }
        }
        for tip in 0..chain.n_tips() {
            let palm = chain.fk_of(tip, q).translation.vector;
            for axis in 0..3 {
                let (low, high) = (palm_box.low_m[axis], palm_box.high_m[axis]);
                if !(low..=high).contains(&palm[axis]) {
                    note(at, &chain.tip_names[tip], "workspace", palm[axis], if palm[axis] < low { low } else { high });
                }
            }
        }
        if let Some(contact) = world.and_then(|world| world.contact(q)) {
            note(at, &format!("{} and {}", contact.link, contact.with), "distance", contact.depth_m, 0.0);
        }
    }
    found
}

//! The two-dimensional hand synergy space.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// `c = [c1, c2]` of the paper (equation 12): `c1` in [0, 1] closes, `c2` in [-1, 1] shifts closure from the little finger to the thumb.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct SynergyCoordinates {
    /// Dominant closure.
    pub c1: f64,
    /// Refinement.
    pub c2: f64,
}

impl SynergyCoordinates {
    /// The open hand.
    pub const OPEN: Self = Self { c1: 0.0, c2: 0.0 };

    /// Coordinates as given; [`Self::clamped`] keeps them in range.
    #[must_use]
    pub const fn new(c1: f64, c2: f64) -> Self {
        Self { c1, c2 }
    }

    /// The nearest coordinates inside [0, 1] x [-1, 1].
    #[must_use]
    pub fn clamped(self) -> Self {
        Self { c1: self.c1.clamp(0.0, 1.0), c2: self.c2.clamp(-1.0, 1.0) }
    }

    /// The point a fraction `t` of the way to `other`.
    #[must_use]
    pub fn lerp(self, other: Self, t: f64) -> Self {
        Self { c1: self.c1 + t * (other.c1 - self.c1), c2: self.c2 + t * (other.c2 - self.c2) }
    }
}

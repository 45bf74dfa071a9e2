//! Eight numbers at once.
//!
//! Plain arrays with loops over them: compiled for a wider instruction set, each operation is one or two instructions.

#![allow(
    clippy::needless_range_loop,
    reason = "the same index in several arrays is what the compiler turns into one instruction"
)]

use std::ops::{Add, Mul, Sub};

/// Configurations that are looked at together.
pub(crate) const N_LANES: usize = 8;

/// One number for each of eight configurations.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(align(32))]
pub(crate) struct Lanes(pub(crate) [f32; N_LANES]);

/// A vector for each of eight configurations.
pub(crate) type Lanes3 = [Lanes; 3];

macro_rules! operator {
    ($trait:ident, $method:ident, $op:tt) => {
        impl $trait for Lanes {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                let mut out = [0.0; N_LANES];
                for i in 0..N_LANES {
                    out[i] = self.0[i] $op other.0[i];
                }
                Self(out)
            }
        }
        impl $trait<f32> for Lanes {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: f32) -> Self {
                let mut out = [0.0; N_LANES];
                for i in 0..N_LANES {
                    out[i] = self.0[i] $op other;
                }
                Self(out)
            }
        }
    };
}

operator!(Add, add, +);
operator!(Sub, sub, -);
operator!(Mul, mul, *);

impl Lanes {
    #[inline(always)]
    pub(crate) fn splat(value: f32) -> Self {
        Self([value; N_LANES])
    }

    #[inline(always)]
    fn map(self, f: impl Fn(f32) -> f32) -> Self {
        let mut out = [0.0; N_LANES];
        for i in 0..N_LANES {
            out[i] = f(self.0[i]);
        }
        Self(out)
    }

    #[inline(always)]
    pub(crate) fn abs(self) -> Self {
        self.map(f32::abs)
    }

    #[inline(always)]
    pub(crate) fn sqrt(self) -> Self {
        self.map(f32::sqrt)
    }

    /// Negative numbers become 0.
    #[inline(always)]
    pub(crate) fn positive(self) -> Self {
        self.map(|v| if v > 0.0 { v } else { 0.0 })
    }

    /// Whether any of the eight is below `limit`.
    #[inline(always)]
    pub(crate) fn any_below(self, limit: f32) -> bool {
        let mut hit = 0_u32;
        for i in 0..N_LANES {
            hit |= (self.0[i] - limit).to_bits();
        }
        hit >> 31 == 1
    }

    /// Sine and cosine to 2e-7 for angles of a few turns.
    #[inline(always)]
    pub(crate) fn sin_cos(self) -> (Self, Self) {
        // Adding this rounds to whole numbers, which stand in the lowest bits.
        const ROUND: f32 = 12_582_912.0;
        let (mut sin, mut cos) = ([0.0; N_LANES], [0.0; N_LANES]);
        for i in 0..N_LANES {
            let shifted = self.0[i] * std::f32::consts::FRAC_2_PI + ROUND;
            let quarter = shifted.to_bits();
            let turns = shifted - ROUND;
            // A quarter turn in three parts, so that the difference stays exact.
            let x = self.0[i] - turns * 1.570_312_5 - turns * 4.837_513e-4 - turns * 7.549_79e-8;
            let x2 = x * x;
            let s = x + x * x2 * (-0.166_666_55 + x2 * (8.332_161e-3 - x2 * 1.951_529_6e-4));
            let c = 1.0 - 0.5 * x2 + x2 * x2 * (4.166_664_6e-2 + x2 * (-1.388_731_6e-3 + x2 * 2.443_315_7e-5));
            let swap = 0_u32.wrapping_sub(quarter & 1);
            let (s_bits, c_bits) = (s.to_bits(), c.to_bits());
            let (first, second) = ((s_bits & !swap) | (c_bits & swap), (c_bits & !swap) | (s_bits & swap));
            sin[i] = f32::from_bits(first ^ ((quarter & 2) << 30));
            cos[i] = f32::from_bits(second ^ ((quarter.wrapping_add(1) & 2) << 30));
        }
        (Self(sin), Self(cos))
    }
}

/// Squared length.
#[inline(always)]
pub(crate) fn norm2(v: &Lanes3) -> Lanes {
    v[0] * v[0] + v[1] * v[1] + v[2] * v[2]
}

#[inline(always)]
pub(crate) fn minus(a: &Lanes3, b: &Lanes3) -> Lanes3 {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sines_are_right_to_the_last_digits() {
        let mut worst = 0.0_f64;
        for i in -40_000..40_000_i32 {
            let x = i as f32 * 2.5e-4;
            let (sin, cos) = Lanes::splat(x).sin_cos();
            worst = worst.max((f64::from(sin.0[3]) - f64::from(x).sin()).abs());
            worst = worst.max((f64::from(cos.0[5]) - f64::from(x).cos()).abs());
        }
        assert!(worst < 2e-7, "{worst}");
    }

    #[test]
    fn one_lane_below_is_enough() {
        let mut values = [1.0; N_LANES];
        assert!(!Lanes(values).any_below(1.0));
        values[6] = 0.999;
        assert!(Lanes(values).any_below(1.0));
    }
}

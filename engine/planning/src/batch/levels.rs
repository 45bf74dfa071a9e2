//! The verdict on eight configurations, compiled for one instruction set each: those that `batch` chooses from.

use super::{Batch, Lanes, MAX_JOINTS, N_LANES, touches};
use multiversion::multiversion;

/// Name, whether this machine has it, whether anything touches in any of the eight.
pub(crate) type Level = (&'static str, bool, fn(&Batch, &[Lanes]) -> bool);

/// All levels; one that the machine lacks falls back to the baseline.
pub(crate) fn all() -> [Level; 3] {
    let (has_avx2, has_avx512) = detected();
    [("baseline", true, baseline), ("AVX2 and FMA", has_avx2, avx2), ("AVX-512", has_avx512, avx512)]
}

/// One configuration in each lane.
pub(crate) fn lanes(q: &[Vec<f64>; N_LANES]) -> Vec<Lanes> {
    assert!(q[0].len() <= MAX_JOINTS, "a chain that is compiled");
    (0..q[0].len()).map(|joint| Lanes(std::array::from_fn(|lane| q[lane][joint] as f32))).collect()
}

#[cfg(target_arch = "x86_64")]
fn detected() -> (bool, bool) {
    let has_avx2 = is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma");
    // `multiversion` takes AVX-512 only from Ice Lake on.
    (has_avx2, has_avx2 && is_x86_feature_detected!("avx512vl") && is_x86_feature_detected!("avx512vbmi2"))
}

#[cfg(not(target_arch = "x86_64"))]
fn detected() -> (bool, bool) {
    (false, false)
}

fn baseline(batch: &Batch, q: &[Lanes]) -> bool {
    touches(batch, q, super::STILL)
}

#[multiversion(targets("x86_64+avx2+fma"))]
fn avx2(batch: &Batch, q: &[Lanes]) -> bool {
    touches(batch, q, super::STILL)
}

#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx2+fma"))]
fn avx512(batch: &Batch, q: &[Lanes]) -> bool {
    touches(batch, q, super::STILL)
}

//! CPU time from a half-seen TSDF to at most 15 ranked candidates, one core, varied things, hands and types.
//!
//! `cargo bench -p sfg-generator-analytic` prints median, p95 and a checksum and writes `target/bench/generator.json`.
#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "a bench stops by panicking and prints its result")]

#[path = "../tests/support/mod.rs"]
mod support;

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use sfg_types::{GraspType, HandSide};
use std::path::Path;
use support::{ball, candidates, cuboid, generator, observe, softhand, standing};

/// Scenes; each is asked for both hands and two types.
const N_SCENES: usize = 250;

fn main() {
    // `cargo test --benches` calls with no `--bench`: one scene shows that it runs.
    let n_scenes = if std::env::args().any(|arg| arg == "--bench") { N_SCENES } else { 1 };
    let profile = softhand();
    let mut generator = generator(&profile, HandSide::Left);
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let mut times_ms = Vec::new();
    let (mut checksum, mut n_found) = (0.0, 0);
    for i in 0..n_scenes {
        let (x, y) = (rng.random_range(0.5..0.75), rng.random_range(-0.2..0.3));
        let r = rng.random_range(0.025..0.04);
        let (solid, types) = match i % 4 {
            0 | 1 => (standing(x, y, r, rng.random_range(0.12..0.24)), [GraspType::LargeDiameter, GraspType::MediumWrap]),
            2 => {
                let size = [2.0 * r, rng.random_range(0.03..0.06), rng.random_range(0.08..0.2)];
                (cuboid(x, y, rng.random_range(0.0..1.5), size), [GraspType::MediumWrap, GraspType::PrismaticFourFinger])
            }
            _ => (ball(x, y, r), [GraspType::PowerSphere, GraspType::Tripod]),
        };
        let seen = observe(&solid, 2);
        for kind in types {
            for side in [HandSide::Left, HandSide::Right] {
                let start_ms = cpu_ms();
                let found = candidates(&mut generator, &profile, &seen, side, kind);
                times_ms.push(cpu_ms() - start_ms);
                n_found += usize::from(!found.is_empty());
                checksum += found.iter().map(|c| c.stability + c.base_from_palm.translation.vector.sum()).sum::<f64>();
            }
        }
    }
    times_ms.sort_by(f64::total_cmp);
    let n = times_ms.len();
    let (median, p95) = (times_ms[n / 2], times_ms[(n * 95 / 100).min(n - 1)]);
    println!("generator: median {median:.1} ms, p95 {p95:.1} ms, n {n}, answered {n_found}, checksum {checksum:.6}");
    let report = serde_json::json!([{
        "bench": "pose_generation_analytic", "unit": "ms", "median": median, "p95": p95, "n": n, "peer": null,
        "answered": n_found, "checksum": checksum,
    }]);
    let target =
        std::env::var("CARGO_TARGET_DIR").map_or_else(|_| Path::new(env!("CARGO_MANIFEST_DIR")).join("../../target"), Into::into);
    std::fs::create_dir_all(target.join("bench")).unwrap();
    std::fs::write(target.join("bench/generator.json"), report.to_string()).unwrap();
}

/// Time that this thread has run, so that other work on the machine does not count.
fn cpu_ms() -> f64 {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap();
    text.split_whitespace().next().unwrap().parse::<f64>().unwrap() * 1e-6
}

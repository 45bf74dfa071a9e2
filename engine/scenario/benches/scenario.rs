//! Reading scenarios with large trees: YAML to a checked scenario, and from there to a tree that can be ticked.
//!
//! `cargo bench -p sfg-scenario` prints median, p95 and what 10,000 nodes cost, and writes `target/bench/scenario.json`.
#![allow(clippy::print_stdout, clippy::unwrap_used, reason = "a program for developers")]

use sfg_scenario::{Scenario, Settings, Vocabulary};
use sfg_tree::{PortSpec, Registry};
use std::fmt::Write as _;
use std::hint::black_box;
use std::path::Path;
use std::time::{Duration, Instant};

/// Texts with other numbers and keys take turns.
const N_VARIANTS: usize = 2;
/// How often each size has its turn.
const N_TURNS: usize = 20;
/// For 10,000 nodes.
const TARGET_MS: f64 = 150.0;

/// What 10,000 nodes cost in the largest tree may be this many times what they cost in the middle one: linear, but for caches.
const MAX_GROWTH: f64 = 1.25;

/// One size of tree.
struct Size {
    name: &'static str,
    texts: Vec<String>,
    n_nodes: usize,
    /// Samples of it for each sample of the largest.
    n_a_turn: usize,
    parse_times: Vec<Duration>,
    build_times: Vec<Duration>,
}

impl Size {
    fn new(name: &'static str, n_rows: usize, n_a_turn: usize) -> Self {
        let texts = (0..N_VARIANTS).map(|variant| text(n_rows, variant)).collect();
        Self { name, texts, n_nodes: 10 * n_rows + 1, n_a_turn, parse_times: Vec::new(), build_times: Vec::new() }
    }

    /// Reads and builds once; how many nodes came out.
    fn sample(&mut self, registry: &Registry<()>, vocabulary: &Vocabulary) -> usize {
        let text = self.texts[self.parse_times.len() % N_VARIANTS].clone();
        let path = Path::new("bench.yaml");
        let (scenario, parse_time) = timed(|| Scenario::parse(path, text, &Settings::default(), registry, vocabulary).unwrap());
        let (tree, build_time) = timed(|| scenario.build_tree(registry).unwrap());
        self.parse_times.push(parse_time);
        self.build_times.push(build_time);
        tree.n_nodes()
    }
}

fn main() {
    let (registry, vocabulary) = (registry(), Vocabulary::default());
    // The sizes take turns, so that all see the same load of the machine. Large texts take long: fewer samples of them.
    let mut sizes = [Size::new("1,001", 100, 50), Size::new("10,001", 1_000, 10), Size::new("100,001", 10_000, 1)];
    let mut n_built = 0;
    for turn in 0..=N_TURNS {
        for size in &mut sizes {
            for _ in 0..size.n_a_turn {
                n_built += size.sample(&registry, &vocabulary);
            }
            // The first turn is to warm up.
            if turn == 0 {
                size.parse_times.clear();
                size.build_times.clear();
            }
        }
    }
    println!("{:28} {:>10} {:>10} {:>10} {:>16} {:>6}", "bench, ms", "median", "p95", "least", "10,000 nodes", "n");
    let mut rows = Vec::new();
    let [_, parse_middle, parse_largest] = sizes.each_mut().map(|size| {
        let (parse_times, build_times) = (std::mem::take(&mut size.parse_times), std::mem::take(&mut size.build_times));
        let (parse_row, parse_ms) = row(format!("parse and check {} nodes", size.name), parse_times, size.n_nodes);
        let (build_row, _) = row(format!("build {} nodes", size.name), build_times, size.n_nodes);
        rows.extend([parse_row, build_row]);
        parse_ms
    });
    let verdict = |is_met: bool| if is_met { "PASS" } else { "MISSED" };
    let growth = parse_largest / parse_middle;
    println!("10,000 nodes: {parse_middle:.1} ms, target {TARGET_MS} ms: {}", verdict(parse_middle <= TARGET_MS));
    println!("linear: {growth:.2} times as much a node at 100,000, target {MAX_GROWTH}: {}", verdict(growth <= MAX_GROWTH));
    println!("checksum {n_built}");
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../target/bench");
    std::fs::create_dir_all(&folder).unwrap();
    std::fs::write(folder.join("scenario.json"), serde_json::to_string_pretty(&rows).unwrap()).unwrap();
}

fn registry() -> Registry<()> {
    let mut registry = Registry::new();
    registry.step("lift", [PortSpec::setting::<f64>("height_m").default_value(0.1).range(0.0, 0.5)], |_| Ok(()));
    registry.condition("is_held", [], |_| Ok(true));
    registry.step("count", [PortSpec::setting::<u64>("from"), PortSpec::output::<u64>("to")], |_| Ok(()));
    for counter_idx in 0..16 {
        registry.entry::<u64>(format!("counter_{counter_idx}"));
    }
    registry
}

/// A scenario whose tree has `n_rows` sequences of nine leaves: with a number, without ports, with two keys.
fn text(n_rows: usize, variant: usize) -> String {
    let mut text = "version: 1
robot: curi
scene:
  objects:
    - bottle: {model: bottle, at: {x_m: 0.7, y_m: 0.05, yaw_deg: any}}
tree:
  sequence:
"
    .to_owned();
    for row_idx in 0..n_rows {
        text.push_str("    - sequence:\n");
        for column in 0..3 {
            let number = row_idx * 3 + column + variant;
            let (height_m, from, to) = (0.1 + (number % 100) as f64 * 0.001, number % 16, (number + 1) % 16);
            let _infallible = write!(
                text,
                "        - lift: {{height_m: {height_m:.3}}}
        - is_held
        - count: {{from: \"{{counter_{from}}}\", to: \"{{counter_{to}}}\"}}
"
            );
        }
    }
    text
}

/// What a call gives, and its time.
fn timed<R>(call: impl FnOnce() -> R) -> (R, Duration) {
    let begun = Instant::now();
    let result = black_box(call());
    (result, begun.elapsed())
}

/// The row for the file, and the median for 10,000 nodes.
fn row(bench: String, times: Vec<Duration>, n_nodes: usize) -> (serde_json::Value, f64) {
    let mut times_ms: Vec<f64> = times.iter().map(|time| time.as_secs_f64() * 1e3).collect();
    times_ms.sort_by(f64::total_cmp);
    let at = |share: f64| times_ms[((times_ms.len() - 1) as f64 * share).round() as usize];
    let (median, p95, n) = (at(0.5), at(0.95), times_ms.len());
    let per_10_000 = median * 1e4 / n_nodes as f64;
    println!("{bench:28} {median:10.2} {p95:10.2} {:10.2} {per_10_000:16.2} {n:6}", at(0.0));
    let round = |number: f64| (number * 1e3).round() / 1e3;
    let json =
        serde_json::json!({"bench": bench, "unit": "ms", "median": round(median), "p95": round(p95), "n": n, "peer": null});
    (json, per_10_000)
}

//! Samples, and the table and the file made of them.

use std::fmt::Write as _;
use std::hint::black_box;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// How many samples of ours are taken before it is the peer's turn: both see the same load of the machine.
const BLOCK: usize = 50;

/// What a bench is called, and how one sample of it becomes a number.
#[derive(Clone, Copy)]
pub(crate) struct Bench {
    pub(crate) name: &'static str,
    pub(crate) unit: &'static str,
    /// Turns seconds into the unit.
    pub(crate) scale: f64,
    pub(crate) n: usize,
    /// The median must not be above.
    pub(crate) target: Option<f64>,
}

impl Bench {
    pub(crate) fn new(name: &'static str, unit: &'static str, scale: f64) -> Self {
        Self { name, unit, scale, n: 2_000, target: None }
    }

    /// Cost of one of the `n_items` things that a sample does.
    pub(crate) fn each(name: &'static str, unit: &'static str, n_items: usize) -> Self {
        Self::new(name, unit, 1e9 / n_items as f64)
    }

    pub(crate) fn n(self, n: usize) -> Self {
        Self { n, ..self }
    }

    pub(crate) fn target(self, target: f64) -> Self {
        Self { target: Some(target), ..self }
    }
}

struct Row {
    bench: Bench,
    median: f64,
    p95: f64,
    peer: Option<f64>,
    /// More about the distribution.
    note: String,
}

/// The results so far.
pub(crate) struct Report {
    words: Vec<String>,
    rows: Vec<Row>,
    checksum: u64,
}

impl Report {
    /// With the words after `--` that choose benches.
    pub(crate) fn from_args() -> Self {
        // Cargo itself adds `--bench`.
        let words = std::env::args().skip(1).filter(|word| !word.starts_with('-')).collect();
        Self { words, rows: Vec::new(), checksum: 0 }
    }

    pub(crate) fn wants(&self, name: &str) -> bool {
        self.words.is_empty() || self.words.iter().any(|word| name.contains(word))
    }

    /// Results go in here, so that the work cannot be left out.
    pub(crate) fn mix(&mut self, result: u64) {
        self.checksum = self.checksum.wrapping_mul(0x0100_0000_01B3).wrapping_add(result);
    }

    /// Adds `n` samples; `sample` is given their number and gives the time of what is measured.
    pub(crate) fn run(&mut self, bench: Bench, sample: impl FnMut(usize) -> Duration) {
        self.run_both(bench, sample, None::<fn(usize) -> Duration>);
    }

    /// Adds `n` samples of ours and as many of the peer's, in turns.
    pub(crate) fn run_beside(&mut self, bench: Bench, ours: impl FnMut(usize) -> Duration, peer: impl FnMut(usize) -> Duration) {
        self.run_both(bench, ours, Some(peer));
    }

    fn run_both(
        &mut self,
        bench: Bench,
        mut ours: impl FnMut(usize) -> Duration,
        mut peer: Option<impl FnMut(usize) -> Duration>,
    ) {
        let n_warm_up = (bench.n / 10).clamp(1, 200);
        for sample_idx in 0..n_warm_up {
            black_box(ours(sample_idx));
            if let Some(peer) = &mut peer {
                black_box(peer(sample_idx));
            }
        }
        let (mut our_times, mut peer_times) = (Vec::with_capacity(bench.n), Vec::with_capacity(bench.n));
        for block in (0..bench.n).step_by(BLOCK) {
            let block = n_warm_up + block..n_warm_up + bench.n.min(block + BLOCK);
            our_times.extend(block.clone().map(&mut ours));
            if let Some(peer) = &mut peer {
                peer_times.extend(block.map(peer));
            }
        }
        let peer = peer.is_some().then(|| at(&sorted(bench, peer_times), 0.5));
        let times = sorted(bench, our_times);
        self.add(Row { bench, median: at(&times, 0.5), p95: at(&times, 0.95), peer, note: String::new() });
    }

    /// Adds samples that were taken elsewhere, with their tail.
    pub(crate) fn add_with_tail(&mut self, bench: Bench, times: Vec<Duration>) {
        let times = sorted(bench, times);
        let note = format!("p99 {:.1}, max {:.1} {}", at(&times, 0.99), at(&times, 1.0), bench.unit);
        self.add(Row { bench, median: at(&times, 0.5), p95: at(&times, 0.95), peer: None, note });
    }

    /// Adds a number that is the same every time.
    pub(crate) fn add_number(&mut self, bench: Bench, ours: f64, peer: Option<f64>) {
        self.add(Row { bench: bench.n(1), median: ours, p95: ours, peer, note: String::new() });
    }

    fn add(&mut self, row: Row) {
        println!("{:46} {:10.2} {}", row.bench.name, row.median, row.bench.unit);
        self.rows.push(row);
    }

    /// Prints the table; writes it to `file_name` when every bench ran.
    pub(crate) fn finish(self, file_name: &str) {
        let mut table = format!(
            "\n{:46} {:>10} {:>10} {:9} {:>6} {:>10} {:>8}\n",
            "bench", "median", "p95", "unit", "n", "bonsai-bt", "target"
        );
        for Row { bench, median, p95, peer, note } in &self.rows {
            let optional =
                |number: Option<f64>, n_decimals: usize| number.map_or("-".to_owned(), |n| format!("{n:.n_decimals$}"));
            let verdict = match bench.target {
                Some(target) if *median <= target => "PASS",
                Some(_) => "MISSED",
                None => "",
            };
            let line = format!(
                "{:46} {median:10.2} {p95:10.2} {:9} {:6} {:>10} {:>8} {verdict:6} {note}",
                bench.name,
                bench.unit,
                bench.n,
                optional(*peer, 2),
                optional(bench.target, 0),
            );
            let _infallible = writeln!(table, "{}", line.trim_end());
        }
        println!("{table}checksum {:016x}", self.checksum);
        if self.words.is_empty() {
            let round = |number: f64| (number * 1e3).round() / 1e3;
            let rows: Vec<serde_json::Value> = self
                .rows
                .iter()
                .map(|row| {
                    let peer = row.peer.map(|median| serde_json::json!({"name": "bonsai-bt 0.14", "median": round(median)}));
                    serde_json::json!({
                        "bench": row.bench.name,
                        "unit": row.bench.unit,
                        "median": round(row.median),
                        "p95": round(row.p95),
                        "n": row.bench.n,
                        "peer": peer,
                    })
                })
                .collect();
            std::fs::write(folder().join(file_name), serde_json::to_string_pretty(&rows).unwrap()).unwrap();
        }
    }
}

/// The time of one call; what it gives is dropped outside of it.
pub(crate) fn timed<R>(call: impl FnOnce() -> R) -> Duration {
    let begun = Instant::now();
    let result = black_box(call());
    let time = begun.elapsed();
    drop(result);
    time
}

/// Where results go.
pub(crate) fn folder() -> PathBuf {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../target/bench");
    std::fs::create_dir_all(&folder).unwrap();
    folder
}

fn sorted(bench: Bench, times: Vec<Duration>) -> Vec<f64> {
    let mut times: Vec<f64> = times.into_iter().map(|time| time.as_secs_f64() * bench.scale).collect();
    times.sort_by(f64::total_cmp);
    times
}

fn at(sorted: &[f64], share: f64) -> f64 {
    sorted[((sorted.len() - 1) as f64 * share).round() as usize]
}

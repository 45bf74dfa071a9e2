//! G: from a wake-up by another thread to the first line of the leaf that waited for it.
//!
//! In every other block of samples the owner only waits: what is left there is the operating system's part.

use crate::report::{Bench, Report};
use sfg_tree::{Action, NodeSpec, Outcome, Progress, Registry, Status, Tick, TreeSpec};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::thread;
use std::time::{Duration, Instant};

const N_SAMPLES: usize = 2_000;
/// Samples before it is the other kind's turn.
const BLOCK: usize = 50;
/// Long enough for the owner to be asleep again; differs from sample to sample.
const MIN_PAUSE_US: u64 = 150;

struct Context {
    begun: Instant,
    /// When the other thread woke the tree, nanoseconds from `begun`; 0 once it was seen.
    woken_ns: Arc<AtomicU64>,
    times: Vec<Duration>,
}

impl Context {
    /// The time since the wake-up that was not seen yet.
    fn since_wake_up(&self) -> Option<Duration> {
        let now = self.begun.elapsed();
        let woken_ns = self.woken_ns.swap(0, Ordering::Acquire);
        (woken_ns != 0).then(|| now.saturating_sub(Duration::from_nanos(woken_ns)))
    }
}

struct Listen;

impl Action<Context> for Listen {
    fn start(&mut self, _tick: &mut Tick<'_, Context>) -> Outcome {
        Ok(Progress::Running)
    }
    fn poll(&mut self, tick: &mut Tick<'_, Context>) -> Outcome {
        if let Some(time) = tick.context.since_wake_up() {
            tick.context.times.push(time);
        }
        Ok(Progress::Running)
    }
}

pub(crate) fn run(report: &mut Report) {
    let bench = Bench::new("G wake-up to re-tick", "us", 1e6).n(N_SAMPLES).target(10.0);
    if !report.wants(bench.name) {
        return;
    }
    let mut registry = Registry::<Context>::new();
    registry.action("listen", [], || Listen);
    let mut tree = registry.build(&TreeSpec::new(NodeSpec::new("sequence").child(NodeSpec::new("listen")))).unwrap();
    let (begun, woken_ns) = (Instant::now(), Arc::new(AtomicU64::new(0)));
    let mut context = Context { begun, woken_ns: Arc::clone(&woken_ns), times: Vec::with_capacity(N_SAMPLES) };
    let mut bare_times = Vec::with_capacity(N_SAMPLES);
    let (waker, waking, n_handled) = (tree.waker(), tree.waker(), AtomicUsize::new(0));
    assert_eq!(tree.tick(0.0, &mut context), Status::Running);
    thread::scope(|scope| {
        let n_handled = &n_handled;
        scope.spawn(move || {
            for sample_idx in 0..2 * N_SAMPLES {
                while n_handled.load(Ordering::Acquire) < sample_idx {
                    thread::yield_now();
                }
                thread::sleep(Duration::from_micros(MIN_PAUSE_US + (sample_idx as u64 * 37) % 200));
                woken_ns.store(begun.elapsed().as_nanos() as u64, Ordering::Release);
                waking.wake();
            }
        });
        for sample_idx in 0..2 * N_SAMPLES {
            assert!(waker.wait(Duration::from_secs(10)), "nobody woke the tree");
            if (sample_idx / BLOCK).is_multiple_of(2) {
                assert_eq!(tree.tick(sample_idx as f64 * 0.01, &mut context), Status::Running);
            } else {
                bare_times.extend(context.since_wake_up());
            }
            n_handled.store(sample_idx + 1, Ordering::Release);
        }
    });
    assert_eq!((context.times.len(), bare_times.len()), (N_SAMPLES, N_SAMPLES));
    report.mix(context.times.len() as u64);
    report.add_with_tail(bench, context.times);
    report.add_with_tail(Bench::new("G wake-up to the end of the wait", "us", 1e6).n(N_SAMPLES), bare_times);
}

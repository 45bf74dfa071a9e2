//! Lesson 10, observing: the journal of a tree, and how often each node did what.

use sfg_tree::nodes::{always_success, fallback, node, retry, sequence, sleep};
use sfg_tree::{Failure, JournalLevel, Registry, Statistics, Status};
use std::error::Error;
use std::io::{self, Write};

pub(crate) fn run(out: &mut impl Write) -> Result<(), Box<dyn Error>> {
    let mut registry = Registry::<u32>::new();
    registry.step("grasp", [], |tick| {
        *tick.context += 1;
        if *tick.context < 3 { Err(Failure::new("slipped", format!("attempt {}", tick.context))) } else { Ok(()) }
    });
    let root = sequence([
        fallback([retry(5, node("grasp")).title("insist"), always_success().title("give up")]),
        sleep(0.5).title("settle"),
    ]);
    let mut tree = registry.tree(root)?;
    tree.set_journal_level(JournalLevel::Transitions);

    let (mut statistics, mut n_grasps, mut now_secs, mut n_records) = (Statistics::default(), 0, 0.0, 0);
    while tree.tick(now_secs, &mut n_grasps) == Status::Running {
        now_secs += 0.25;
        // Once a tick, so that a long run stays small.
        for record in tree.drain_journal() {
            statistics.observe(&record);
            n_records += 1;
        }
    }
    for record in tree.drain_journal() {
        statistics.observe(&record);
        n_records += 1;
    }
    writeln!(out, "{n_records} records in {now_secs} s")?;
    for node in tree.definition() {
        let counts = statistics.of(node.id);
        writeln!(
            out,
            "{:30} started {} succeeded {} failed {} running {} s",
            tree.path(node.id),
            counts.n_started,
            counts.n_succeeded,
            counts.n_failed,
            counts.running_secs
        )?;
    }
    Ok(())
}

fn main() -> Result<(), Box<dyn Error>> {
    run(&mut io::stdout())
}

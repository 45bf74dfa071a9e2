//! What trees cost: ticks, ports, journal, scripts, building and waking, beside the crate `bonsai-bt` in the same run.
//!
//! `cargo bench -p sfg-tree` prints a table with the target of each bench and writes `target/bench/tree.json`.
//! `cargo bench -p sfg-tree -- script wake` runs the benches whose name has one of the words and writes nothing.
//!
//! BehaviorTree.CPP 4.10 on a 2-core Xeon: A 229-271 ns a node, B 19.9-32.6 us, B2 32.8-50.6 us, C 510-726 ns, D 14.6-18.1 ms
//! for 10,000 nodes from XML and 1052 bytes a node, E1 874-1096 ns a node, F 779-909 ns, G 7.6-10.2 us (median).
#![allow(clippy::print_stdout, clippy::unwrap_used, reason = "a program for developers")]

mod building;
mod heap;
mod journal;
mod peer;
mod report;
mod ticking;
mod trees;
mod waking;
mod xml;

fn main() {
    let mut report = report::Report::from_args();
    ticking::run(&mut report);
    journal::run(&mut report);
    building::run(&mut report);
    xml::run(&mut report);
    waking::run(&mut report);
    report.finish("tree.json");
}

//! Cost of ticking, of ports and of building. Writes `target/bench/tree.json`; run with `cargo bench -p sfg-tree`.
//!
//! BehaviorTree.CPP 4.10 on the same kind of machine: 229-271 ns a node, 874-1096 with its journal, 510-726 for a read and a
//! write, 14.6-18.1 ms for 10,000 nodes from XML.
#![allow(clippy::print_stdout, clippy::unwrap_used, reason = "a program for developers")]

use sfg_tree::{JournalLevel, NodeSpec, PortSpec, Registry, Status, TreeSpec};
use std::time::Instant;

struct Context {
    sum: u64,
}

fn registry() -> Registry<Context> {
    let mut registry = Registry::<Context>::new();
    registry.step("work", [], |tick| {
        tick.context.sum = tick.context.sum.wrapping_mul(31).wrapping_add(tick.tick_idx());
        Ok(())
    });
    registry.condition("holds", [], |tick| {
        tick.context.sum = tick.context.sum.wrapping_add(1);
        Ok(tick.context.sum != 0)
    });
    registry.step("add", [PortSpec::setting::<u64>("from"), PortSpec::output::<u64>("to")], |tick| {
        let sum = tick.get::<u64>("from")?.wrapping_add(1);
        tick.set("to", sum);
        tick.context.sum = tick.context.sum.wrapping_add(sum);
        Ok(())
    });
    registry.step("look", [PortSpec::input::<Vec<u8>>("cloud")], |tick| {
        let cloud = tick.input::<Vec<u8>>("cloud")?;
        tick.context.sum = tick.context.sum.wrapping_add(cloud.len() as u64);
        Ok(())
    });
    registry.entry::<u64>("counter");
    registry.entry::<Vec<u8>>("cloud");
    registry
}

/// A sequence of `n_rows` sequences of nine leaves; a tenth of the nodes are controls.
fn rows(n_rows: usize, leaf: impl Fn(usize) -> NodeSpec) -> TreeSpec {
    let row = |row_idx: usize| NodeSpec::new("sequence").children((0..9).map(|column| leaf(row_idx * 9 + column)));
    TreeSpec::new(NodeSpec::new("sequence").children((0..n_rows).map(row)))
}

fn mixed(leaf_idx: usize) -> NodeSpec {
    NodeSpec::new(if leaf_idx.is_multiple_of(2) { "work" } else { "holds" })
}

fn counting(_leaf_idx: usize) -> NodeSpec {
    NodeSpec::new("add").with_key("from", "counter").with_key("to", "counter")
}

struct Row {
    bench: &'static str,
    unit: &'static str,
    median: f64,
    p95: f64,
    n: usize,
}

/// Times `n` calls; `scale` turns seconds into the unit.
fn measure(bench: &'static str, unit: &'static str, n: usize, scale: f64, mut call: impl FnMut(usize)) -> Row {
    for warm_up in 0..n / 10 + 1 {
        call(warm_up);
    }
    let mut samples: Vec<f64> = (0..n)
        .map(|sample_idx| {
            let start = Instant::now();
            call(sample_idx);
            start.elapsed().as_secs_f64() * scale
        })
        .collect();
    samples.sort_by(f64::total_cmp);
    let row = Row { bench, unit, median: samples[n / 2], p95: samples[n * 95 / 100], n };
    println!("{bench:32} {:10.1} {unit} (p95 {:.1}, n {n})", row.median, row.p95);
    row
}

fn main() {
    let registry = registry();
    let mut context = Context { sum: 1 };
    let mut table = Vec::new();

    for (bench, level) in [("tick, no journal", JournalLevel::Off), ("tick, journal of transitions", JournalLevel::Transitions)] {
        let mut tree = registry.build(&rows(100, mixed)).unwrap();
        tree.set_journal_level(level);
        let scale = 1e9 / 1001.0;
        table.push(measure(bench, "ns/node", 2_000, scale, |_| {
            assert_eq!(tree.tick(0.0, &mut context), Status::Success);
            context.sum = context.sum.wrapping_add(tree.drain_journal().len() as u64);
        }));
    }

    let mut tree = registry.build(&rows(100, counting)).unwrap();
    tree.set_entry("counter", 0_u64).unwrap();
    table.push(measure("node with a port read and a write", "ns/node", 2_000, 1e9 / 1001.0, |_| {
        assert_eq!(tree.tick(0.0, &mut context), Status::Success);
    }));

    let mut tree = registry.build(&rows(100, |_| NodeSpec::new("look"))).unwrap();
    tree.set_entry("cloud", vec![1_u8; 4_900_000]).unwrap();
    table.push(measure("node reading a 4.9 MB value", "ns/node", 2_000, 1e9 / 1001.0, |_| {
        assert_eq!(tree.tick(0.0, &mut context), Status::Success);
    }));

    let spec = rows(1_000, counting);
    table.push(measure("build and check 10,000 nodes", "ms", 1_000, 1e3, |_| {
        context.sum = context.sum.wrapping_add(registry.build(&spec).unwrap().n_nodes() as u64);
    }));

    println!("checksum {}", context.sum);
    let rows: Vec<String> = table
        .iter()
        .map(|row| {
            format!(
                "{{\"bench\": \"{}\", \"unit\": \"{}\", \"median\": {:.2}, \"p95\": {:.2}, \"n\": {}, \"peer\": null}}",
                row.bench, row.unit, row.median, row.p95, row.n
            )
        })
        .collect();
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../target/bench");
    std::fs::create_dir_all(&folder).unwrap();
    std::fs::write(folder.join("tree.json"), format!("[{}]\n", rows.join(",\n "))).unwrap();
}

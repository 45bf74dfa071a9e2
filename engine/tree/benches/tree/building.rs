//! D: from a tree as data to a tree that can be ticked, and what it holds on the heap.

use crate::heap::live_bytes;
use crate::peer;
use crate::report::{Bench, Report, timed};
use crate::trees::{Context, N_COUNTERS, counting, mixed, registry, rows};
use bonsai_bt::BT;
use sfg_tree::{NodeSpec, Tree, TreeSpec};

/// Trees with other keys take turns.
const N_VARIANTS: usize = 2;

pub(crate) fn run(report: &mut Report) {
    // Large builds take long: fewer of them.
    let benches = [
        ("D build 10,001 nodes", "D heap, 10,001 nodes", 1_000, 1_000, Some((3.0, 400.0))),
        ("D build 60,001 nodes", "D heap, 60,001 nodes", 6_000, 100, None),
        ("D build 100,001 nodes", "D heap, 100,001 nodes", 10_000, 60, None),
    ];
    for (build_name, heap_name, n_rows, n_samples, targets) in benches {
        let (mut build, mut heap) = (Bench::new(build_name, "ms", 1e3).n(n_samples), Bench::new(heap_name, "B/node", 1.0));
        if let Some((build_target, heap_target)) = targets {
            (build, heap) = (build.target(build_target), heap.target(heap_target));
        }
        if report.wants(build_name) || report.wants(heap_name) {
            with_ports(report, build, heap, n_rows);
        }
    }
    without_ports(report);
}

fn with_ports(report: &mut Report, build: Bench, heap: Bench, n_rows: usize) {
    let names = peer::names("counter", N_COUNTERS);
    let registry = registry();
    let specs: Vec<TreeSpec> =
        (0..N_VARIANTS).map(|variant| rows(n_rows, |leaf_idx| counting(leaf_idx * (variant + 1) + variant))).collect();
    let behaviors: Vec<_> = (0..N_VARIANTS)
        .map(|variant| peer::rows(n_rows, |leaf_idx| peer::counting(&names)(leaf_idx * (variant + 1) + variant)))
        .collect();
    let mut n_built = 0;
    report.run_beside(
        build,
        |sample_idx| {
            timed(|| {
                let tree = registry.build(&specs[sample_idx % N_VARIANTS]).unwrap();
                n_built += tree.n_nodes();
                tree
            })
        },
        |sample_idx| {
            // It takes the behaviour away; ours only reads its own.
            let behavior = behaviors[sample_idx % N_VARIANTS].clone();
            timed(|| BT::new(behavior, peer::Board::new()))
        },
    );
    report.mix(n_built as u64);

    let (tree, n_bytes) = live_bytes(|| registry.build(&specs[0]).unwrap());
    let (_peer_tree, n_peer_bytes) = live_bytes(|| BT::new(behaviors[0].clone(), peer::Board::new()));
    let n_nodes = tree.n_nodes() as f64;
    report.add_number(heap, n_bytes / n_nodes, Some(n_peer_bytes / n_nodes));
    assert_ids(&tree, 10 * n_rows + 1);
}

fn without_ports(report: &mut Report) {
    let build = Bench::new("D build 10,001 nodes without ports", "ms", 1e3).n(1_000);
    let heap = Bench::new("D heap, 10,001 nodes without ports", "B/node", 1.0);
    if !report.wants(build.name) && !report.wants(heap.name) {
        return;
    }
    let registry = registry();
    let leaves: [fn(usize) -> NodeSpec; N_VARIANTS] = [mixed, |leaf_idx| mixed(leaf_idx + 1)];
    let (specs, behavior) = (leaves.map(|leaf| rows(1_000, leaf)), peer::rows(1_000, peer::mixed));
    let mut n_built = 0;
    report.run_beside(
        build,
        |sample_idx| {
            timed(|| {
                let tree = registry.build(&specs[sample_idx % N_VARIANTS]).unwrap();
                n_built += tree.n_nodes();
                tree
            })
        },
        |_| {
            let behavior = behavior.clone();
            timed(|| BT::new(behavior, peer::Board::new()))
        },
    );
    report.mix(n_built as u64);
    let (tree, n_bytes) = live_bytes(|| registry.build(&specs[0]).unwrap());
    let (_peer_tree, n_peer_bytes) = live_bytes(|| BT::new(behavior.clone(), peer::Board::new()));
    let n_nodes = tree.n_nodes() as f64;
    report.add_number(heap, n_bytes / n_nodes, Some(n_peer_bytes / n_nodes));
}

/// Every node has a number of its own, also beyond 16 bits, and a parent with a smaller one.
fn assert_ids(tree: &Tree<Context>, n_nodes: usize) {
    let mut ids: Vec<u32> = tree.definition().map(|node| node.id).collect();
    assert!(tree.definition().all(|node| node.parent.is_none_or(|parent| parent < node.id)));
    ids.sort_unstable();
    ids.dedup();
    assert_eq!(ids.len(), n_nodes, "numbers of nodes are not unique");
    println!("{:46} {n_nodes} unique numbers of 32 bits", "");
}

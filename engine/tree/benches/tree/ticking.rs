//! Ticks without a journal: A plain leaves, B and B2 reactive, C ports, F scripts, H large values.

use crate::peer;
use crate::report::{Bench, Report, timed};
use crate::trees::{
    CLOUD_BYTES, Context, N_CONDITIONS, N_COUNTERS, N_LEAVES, N_NODES, counting, flat, mixed, reactive, registry, rows,
    start_counters,
};
use bonsai_bt::BT;
use sfg_tree::{Literal, NodeSpec, Status, TreeSpec};
use std::sync::Arc;

/// The period of a control loop.
const PERIOD_SECS: f64 = 0.01;

pub(crate) fn run(report: &mut Report) {
    plain(report);
    reactive_sequence(report);
    reactive_sequence_with_ports(report);
    ports(report);
    scripts(report);
    large_values(report);
}

fn plain(report: &mut Report) {
    let bench = Bench::each("A tick of 1001 nodes", "ns/node", N_NODES).target(60.0);
    if !report.wants(bench.name) {
        return;
    }
    let mut tree = registry().build(&rows(100, mixed)).unwrap();
    let mut peer_tree = BT::new(peer::rows(100, peer::mixed), peer::Board::new());
    let (mut context, mut peer_context) = (Context::new(), Context::new());
    report.run_beside(
        bench,
        |sample_idx| timed(|| assert_eq!(tree.tick(sample_idx as f64 * PERIOD_SECS, &mut context), Status::Success)),
        |_| timed(|| assert_eq!(peer::tick(&mut peer_tree, &mut peer_context), bonsai_bt::Success)),
    );
    report.mix(same_sum(&context, &peer_context));
}

fn reactive_sequence(report: &mut Report) {
    let bench = Bench::new("B reactive, 100 conditions", "us/tick", 1e6);
    if !report.wants(bench.name) {
        return;
    }
    let mut tree = registry().build(&reactive(|_| NodeSpec::new("holds"))).unwrap();
    let mut peer_tree = BT::new(peer::reactive(|_| peer::Leaf::Holds), peer::Board::new());
    let (mut context, mut peer_context) = (Context::new(), Context::new());
    report.run_beside(
        bench,
        |sample_idx| timed(|| assert_eq!(tree.tick(sample_idx as f64 * PERIOD_SECS, &mut context), Status::Running)),
        |_| timed(|| assert_eq!(peer::tick(&mut peer_tree, &mut peer_context), bonsai_bt::Running)),
    );
    report.mix(same_sum(&context, &peer_context));
}

fn reactive_sequence_with_ports(report: &mut Report) {
    let bench = Bench::new("B2 the same, a bool port read each", "us/tick", 1e6);
    if !report.wants(bench.name) {
        return;
    }
    let names = peer::names("flag", N_CONDITIONS);
    let spec = reactive(|condition_idx| NodeSpec::new("agrees").with_key("flag", names[condition_idx]));
    let mut tree = registry().build(&spec).unwrap();
    let behavior = peer::reactive(|condition_idx| peer::Leaf::Agrees(names[condition_idx]));
    let mut peer_tree = BT::new(behavior, peer::Board::new());
    let (mut context, mut peer_context) = (Context::new(), Context::new());
    // Every flag changes before every tick, and so does what the conditions want.
    report.run_beside(
        bench,
        |sample_idx| {
            context.flag = sample_idx.is_multiple_of(3);
            for name in &names {
                tree.set_entry(name, context.flag).unwrap();
            }
            timed(|| assert_eq!(tree.tick(sample_idx as f64 * PERIOD_SECS, &mut context), Status::Running))
        },
        |sample_idx| {
            peer_context.flag = sample_idx.is_multiple_of(3);
            for name in &names {
                peer_tree.blackboard_mut().insert(name, peer::Entry::Flag(peer_context.flag));
            }
            timed(|| assert_eq!(peer::tick(&mut peer_tree, &mut peer_context), bonsai_bt::Running))
        },
    );
    report.mix(same_sum(&context, &peer_context));
}

fn ports(report: &mut Report) {
    let bench = Bench::each("C node with a port read and a write", "ns/node", N_LEAVES).target(150.0);
    if !report.wants(bench.name) {
        return;
    }
    let mut tree = registry().build(&flat(counting)).unwrap();
    start_counters(&mut tree);
    let names = peer::names("counter", N_COUNTERS);
    let board = names.iter().zip(0..).map(|(name, counter)| (*name, peer::Entry::Counter(counter))).collect();
    let mut peer_tree = BT::new(peer::flat(peer::counting(&names)), board);
    let (mut context, mut peer_context) = (Context::new(), Context::new());
    report.run_beside(
        bench,
        |sample_idx| timed(|| assert_eq!(tree.tick(sample_idx as f64 * PERIOD_SECS, &mut context), Status::Success)),
        |_| timed(|| assert_eq!(peer::tick(&mut peer_tree, &mut peer_context), bonsai_bt::Success)),
    );
    report.mix(same_sum(&context, &peer_context));
}

fn scripts(report: &mut Report) {
    let script = |code: &'static str| flat(move |_| NodeSpec::new("script").with("code", code));
    let condition = flat(|_| NodeSpec::new("script_condition").with("code", "x > 3 && y < 2"));
    let benches = [
        ("F script x := x + 1", script("x := x + 1")),
        // An entry that only scripts use has no type of its own.
        ("F script n := n + 1, untyped", script("n := n + 1").entry("n", 0)),
        ("F script_condition x > 3 && y < 2", condition),
    ];
    for (name, spec) in benches {
        if report.wants(name) {
            script_tree(report, name, &spec);
        }
    }
}

fn script_tree(report: &mut Report, name: &'static str, spec: &TreeSpec) {
    let mut tree = registry().build(spec).unwrap();
    let mut context = Context::new();
    report.run(Bench::each(name, "ns/node", N_LEAVES), |sample_idx| {
        tree.set_entry("x", 4.0 + sample_idx as f64).unwrap();
        tree.set_entry("y", 1.0 - sample_idx as f64).unwrap();
        timed(|| assert_eq!(tree.tick(sample_idx as f64 * PERIOD_SECS, &mut context), Status::Success))
    });
    let results = ["x", "n"].map(|key| tree.literal(key));
    report.mix(match results {
        [_, Some(Literal::Int(n))] => n.cast_unsigned(),
        [Some(Literal::Int(x)), _] => x.cast_unsigned(),
        _ => panic!("the script wrote {results:?}"),
    });
}

fn large_values(report: &mut Report) {
    let bench = Bench::each("H 4.9 MB written and read", "ns/pair", N_LEAVES / 2).target(200.0);
    if !report.wants(bench.name) {
        return;
    }
    let spec = flat(|leaf_idx| NodeSpec::new(if leaf_idx.is_multiple_of(2) { "see" } else { "look" }));
    let mut tree = registry().build(&spec).unwrap();
    let behavior =
        peer::flat(|leaf_idx| if leaf_idx.is_multiple_of(2) { peer::Leaf::See("cloud") } else { peer::Leaf::Look("cloud") });
    let mut peer_tree = BT::new(behavior, peer::Board::new());
    let clouds: Vec<_> = (0..4).map(|cloud_idx| Arc::new(vec![1_u8; CLOUD_BYTES + cloud_idx])).collect();
    let mut context = Context { clouds: clouds.clone(), ..Context::new() };
    let mut peer_context = Context { clouds, ..Context::new() };
    report.run_beside(
        bench,
        |sample_idx| timed(|| assert_eq!(tree.tick(sample_idx as f64 * PERIOD_SECS, &mut context), Status::Success)),
        |_| timed(|| assert_eq!(peer::tick(&mut peer_tree, &mut peer_context), bonsai_bt::Success)),
    );
    report.mix(same_sum(&context, &peer_context));
}

/// What the leaves of both trees came to: the same, so they did the same.
fn same_sum(context: &Context, peer_context: &Context) -> u64 {
    assert_eq!(context.sum, peer_context.sum, "the trees have done different things");
    context.sum
}

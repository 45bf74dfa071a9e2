//! D from XML: a text of BehaviorTree.CPP's format 4 to a tree that can be ticked.

use crate::report::{Bench, Report, timed};
use crate::trees::{N_COUNTERS, registry};
use sfg_tree::xml::{ImportOptions, import};
use std::fmt::Write as _;

/// Texts with other keys take turns.
const N_VARIANTS: usize = 2;

pub(crate) fn run(report: &mut Report) {
    let benches = [
        (Bench::new("D from XML, 10,001 nodes", "ms", 1e3).n(1_000).target(15.0), 1_000),
        (Bench::new("D from XML, 100,001 nodes", "ms", 1e3).n(60), 10_000),
    ];
    for (bench, n_rows) in benches {
        if report.wants(bench.name) {
            import_and_build(report, bench, n_rows);
        }
    }
}

fn import_and_build(report: &mut Report, bench: Bench, n_rows: usize) {
    let registry = registry();
    let texts: Vec<String> = (0..N_VARIANTS).map(|variant| text(n_rows, variant)).collect();
    let mut n_built = 0;
    report.run(bench, |sample_idx| {
        timed(|| {
            let imported = import(&texts[sample_idx % N_VARIANTS], &ImportOptions::default()).unwrap();
            let tree = registry.build(&imported.spec).unwrap();
            n_built += tree.n_nodes();
            tree
        })
    });
    report.mix(n_built as u64);
}

/// The tree of `rows(n_rows, counting)` as a file.
fn text(n_rows: usize, variant: usize) -> String {
    let mut text = "<root BTCPP_format=\"4\">\n  <BehaviorTree ID=\"Main\">\n    <Sequence>\n".to_owned();
    for row_idx in 0..n_rows {
        text.push_str("      <Sequence>\n");
        for leaf_idx in row_idx * 9..row_idx * 9 + 9 {
            let (from, to) = ((leaf_idx + variant) % N_COUNTERS, (leaf_idx + variant + 1) % N_COUNTERS);
            let _infallible = writeln!(text, "        <add from=\"{{counter_{from}}}\" to=\"{{counter_{to}}}\"/>");
        }
        text.push_str("      </Sequence>\n");
    }
    text.push_str("    </Sequence>\n  </BehaviorTree>\n</root>\n");
    text
}

//! Lesson 22, replay: a recorded run is decided again without its leaves, by the same tree or by a changed one.

use sfg_tree::nodes::{fallback, node, script_condition, sequence};
use sfg_tree::{JournalLevel, NamedRecord, Out, Ports, Registry, TreeSpec, replay};
use std::error::Error;
use std::io::{self, Write};

#[derive(Ports)]
struct MeasurePorts {
    #[port(output)]
    width_m: Out<f64>,
}

fn tree_of(limit: &str) -> TreeSpec {
    sequence([
        node("measure"),
        fallback([sequence([script_condition(format!("width_m < {limit}")), node("pinch")]), node("scoop")]),
    ])
    .into()
}

pub(crate) fn run(out: &mut impl Write) -> Result<(), Box<dyn Error>> {
    let mut registry = Registry::<Vec<f64>>::new();
    registry.step_with::<MeasurePorts>("measure", |tick, ports| {
        let width_m = tick.context.pop().unwrap_or(0.0);
        ports.width_m.set(tick, width_m);
        Ok(())
    });
    registry.step("pinch", [], |_tick| Ok(()));
    registry.step("scoop", [], |_tick| Ok(()));
    let mut tree = registry.tree(tree_of("0.08"))?;
    tree.set_journal_level(JournalLevel::Values);
    let (names, mut widths_m) = (tree.names(), vec![0.09, 0.07, 0.04]);
    for second in 0..3 {
        tree.tick(f64::from(second), &mut widths_m);
    }
    let records: Vec<NamedRecord> = tree.drain_journal().into_iter().map(|record| names.of(record)).collect();

    // No leaf is called: each gives what it gave then. Everything else is decided anew.
    for limit in ["0.08", "0.06"] {
        let replayed = replay(&registry, &tree_of(limit), &records).map_err(|errors| errors[0].clone())?;
        match replayed.divergence {
            None => writeln!(out, "limit {limit}: {} ticks, the same", replayed.n_ticks)?,
            Some(first) => {
                writeln!(out, "limit {limit}: differs in tick {} at {} s", first.tick_idx, first.now_secs)?;
                writeln!(out, "  then {}\n  now  {}", first.recorded, first.replayed)?;
            }
        }
    }
    Ok(())
}

fn main() -> Result<(), Box<dyn Error>> {
    run(&mut io::stdout())
}

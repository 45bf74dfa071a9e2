//! Lesson 11, values in the journal: a type that says how it is written down is seen in monitors and kept with a run.

use sfg_tree::nodes::{node, sequence};
use sfg_tree::{FromLiteral as _, JournalLevel, Literal, NamedChange, Out, Ports, Registry};
use std::error::Error;
use std::io::{self, Write};
use std::sync::Arc;

/// A place in the plane, m.
struct Place {
    x_m: f64,
    y_m: f64,
}

#[derive(Ports)]
struct LookPorts {
    #[port(output)]
    cup: Out<Place>,
}

#[derive(Ports)]
struct ReachPorts {
    #[port(input)]
    cup: Arc<Place>,
    #[port(output)]
    distance_m: Out<f64>,
}

pub(crate) fn run(out: &mut impl Write) -> Result<(), Box<dyn Error>> {
    let mut registry = Registry::<()>::new();
    registry.step_with::<LookPorts>("look", |tick, ports| {
        ports.cup.set(tick, Place { x_m: 0.3, y_m: 0.4 });
        Ok(())
    });
    registry.step_with::<ReachPorts>("reach", |tick, ports| {
        ports.distance_m.set(tick, ports.cup.x_m.hypot(ports.cup.y_m));
        Ok(())
    });
    registry.literal_form::<Place>(
        |place| Some(Literal::from(vec![place.x_m, place.y_m])),
        |literal| <[f64; 2]>::from_literal(literal).map(|[x_m, y_m]| Place { x_m, y_m }),
    );
    let mut tree = registry.tree(sequence(["look", "reach"].map(node)))?;
    tree.set_journal_level(JournalLevel::Values);
    // Numbers of nodes become names here, so that the record outlives the tree.
    let names = tree.names();
    tree.tick(0.25, &mut ());
    for record in tree.drain_journal().into_iter().map(|record| names.of(record)) {
        let what = match record.change {
            NamedChange::Ticked => format!("tick {}", record.tick_idx),
            NamedChange::Status { from, to } => format!("  {}: {from} -> {to}", record.path),
            NamedChange::Write { key, value: Some(Literal::List(items)) } => {
                format!("  {} writes {key} = {items:?}", record.path)
            }
            NamedChange::Write { key, value } => format!("  {} writes {key} = {value:?}", record.path),
            other => format!("  {other:?}"),
        };
        writeln!(out, "{what}")?;
    }
    Ok(())
}

fn main() -> Result<(), Box<dyn Error>> {
    run(&mut io::stdout())
}

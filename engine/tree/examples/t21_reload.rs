//! Lesson 21, edits: a tree is changed between two ticks, and what runs runs on.

use sfg_tree::nodes::{node, sequence, sleep};
use sfg_tree::{Registry, Status, TreeSpec};
use std::error::Error;
use std::io::{self, Write};

pub(crate) fn run(out: &mut impl Write) -> Result<(), Box<dyn Error>> {
    let mut registry = Registry::<Vec<String>>::new();
    for name in ["fill", "pour", "wipe"] {
        registry.step(name, [], move |tick| {
            tick.context.push(name.to_owned());
            Ok(())
        });
    }
    let mut spec = TreeSpec::from(sequence([node("fill"), sleep(2).title("settle"), node("pour")]));
    let mut tree = registry.tree(spec.clone())?;
    let mut said = Vec::new();
    writeln!(out, "0 s: {}", tree.tick(0.0, &mut said))?;

    // A node that runs cannot be lost by accident.
    let mut without = spec.clone();
    without.remove("sequence/settle")?;
    if let Err(error) = tree.reload(&registry, &without) {
        writeln!(out, "refused: {error}")?;
    }
    // A tree with mistakes is not taken.
    let mut wrong = spec.clone();
    wrong.replace("sequence/pour", node("puor"))?;
    if let Err(error) = tree.reload(&registry, &wrong) {
        writeln!(out, "refused: {error}")?;
    }
    spec.insert("sequence", 9, node("wipe"))?;
    let reloaded = tree.reload(&registry, &spec)?;
    writeln!(out, "added {:?}, removed {:?}", reloaded.added, reloaded.removed)?;

    // The sleep goes on where it was: it ends two seconds after it began.
    for second in 1..=2 {
        let status = tree.tick(f64::from(second), &mut said);
        writeln!(out, "{second} s: {status}, {}", said.join(", "))?;
        if status != Status::Running {
            break;
        }
    }
    Ok(())
}

fn main() -> Result<(), Box<dyn Error>> {
    run(&mut io::stdout())
}

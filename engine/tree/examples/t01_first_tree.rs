//! Lesson 1, the first tree: leaves are closures in a registry, a tree says in which order they are ticked.

use sfg_tree::nodes::{fallback, node, sequence};
use sfg_tree::{Failure, Registry};
use std::error::Error;
use std::io::{self, Write};

/// What the leaves share. Every tick lends it to them.
#[derive(Default)]
struct Kitchen {
    is_door_open: bool,
    said: Vec<String>,
}

pub(crate) fn run(out: &mut impl Write) -> Result<(), Box<dyn Error>> {
    let mut registry = Registry::<Kitchen>::new();
    // A condition changes nothing and holds or not.
    registry.condition("is_door_open", [], |tick| Ok(tick.context.is_door_open));
    // A step is done in one call. Where it cannot be done it says why.
    registry.step("push_door", [], |tick| {
        tick.context.said.push("push".to_owned());
        Err(Failure::new("stuck", "the door does not move"))
    });
    registry.step("turn_handle", [], |tick| {
        tick.context.said.push("turn the handle and pull".to_owned());
        tick.context.is_door_open = true;
        Ok(())
    });
    registry.step("enter", [], |tick| {
        tick.context.said.push("enter".to_owned());
        Ok(())
    });
    let open_door = fallback([node("is_door_open"), node("push_door"), node("turn_handle")]);
    let mut tree = registry.tree(sequence([open_door, node("enter")]))?;

    let mut kitchen = Kitchen::default();
    for tick in [1, 2] {
        let status = tree.tick(f64::from(tick), &mut kitchen);
        writeln!(out, "tick {tick}: {status}, {}", kitchen.said.join(", "))?;
        kitchen.said.clear();
    }
    // A failure that a fallback made good is not lost.
    for at in tree.failures() {
        writeln!(out, "{} failed with {}", tree.path(at.node), at.failure)?;
    }
    Ok(())
}

fn main() -> Result<(), Box<dyn Error>> {
    run(&mut io::stdout())
}

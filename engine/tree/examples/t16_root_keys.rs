//! Lesson 16, the root scope: `@key` is the same entry in every subtree, and the application sets it from outside.

use sfg_tree::nodes::{node, script, sequence, subtree};
use sfg_tree::{Literal, Ports, Registry, SubtreeSpec, TreeSpec};
use std::error::Error;
use std::io::{self, Write};

#[derive(Ports)]
struct SayPorts {
    #[port(input)]
    value: f64,
}

pub(crate) fn run(out: &mut impl Write) -> Result<(), Box<dyn Error>> {
    let mut registry = Registry::<Vec<String>>::new();
    // Declared, so that a tree that reads it is right, and of which type it is.
    registry.entry::<f64>("battery");
    registry.step_with::<SayPorts>("say", |tick, ports| {
        tick.context.push(format!("say {}", ports.value));
        Ok(())
    });
    let inner = SubtreeSpec::new("inner", sequence([script("@half := @battery / 2"), node("say").with_key("value", "@battery")]));
    let outer = SubtreeSpec::new("outer", subtree("inner"));
    let main = sequence([subtree("outer"), script("seen := half + 1")]);
    let spec = TreeSpec::new(main).subtree(inner).subtree(outer).entry("half", 0);
    let mut tree = registry.tree(spec)?;
    for battery in [0.8, 0.6] {
        tree.set_entry("battery", battery)?;
        let mut said = Vec::new();
        let status = tree.tick(0.0, &mut said);
        writeln!(out, "{status}: {}; half {:?}, seen {:?}", said.join(", "), tree.literal("half"), tree.literal("seen"))?;
    }
    // Another type is refused; the entry keeps its value.
    if let Err(error) = tree.set_entry("battery", "full".to_owned()) {
        writeln!(out, "{error}; still {:?}", tree.literal("battery").unwrap_or(Literal::Bool(false)))?;
    }
    Ok(())
}

fn main() -> Result<(), Box<dyn Error>> {
    run(&mut io::stdout())
}

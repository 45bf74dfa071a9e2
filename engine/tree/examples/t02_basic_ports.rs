//! Lesson 2, ports: a node declares what it reads and writes, a tree connects that by blackboard keys.

use sfg_tree::nodes::{node, sequence};
use sfg_tree::{Out, Ports, Registry};
use std::error::Error;
use std::io::{self, Write};

#[derive(Ports)]
struct ThinkPorts {
    /// What is to be said.
    #[port(output)]
    text: Out<String>,
}

#[derive(Ports)]
struct SayPorts {
    /// What is said.
    #[port(setting)]
    text: String,
    /// How loudly, 0 to 10.
    #[port(setting, default = 5, min = 0, max = 10)]
    volume: u32,
}

pub(crate) fn run(out: &mut impl Write) -> Result<(), Box<dyn Error>> {
    let mut registry = Registry::<Vec<String>>::new();
    registry.step_with::<ThinkPorts>("think", |tick, ports| {
        ports.text.set(tick, "the answer is 42".to_owned());
        Ok(())
    });
    registry.step_with::<SayPorts>("say", |tick, ports| {
        tick.context.push(format!("{} (volume {})", ports.text, ports.volume));
        Ok(())
    });
    let mut tree = registry.tree(sequence([
        // A setting takes a constant ...
        node("say").with("text", "hello"),
        // ... or a key. An output uses the key that has its name unless the tree says otherwise.
        node("think").with_key("text", "answer"),
        node("say").with_key("text", "answer").with("volume", 9),
    ]))?;
    let mut said = Vec::new();
    let status = tree.tick(0.0, &mut said);
    writeln!(out, "{}\n{status}", said.join("\n"))?;

    // What does not fit is found before anything moves, all of it at once.
    let wrong =
        registry.tree(sequence([node("say").with_key("text", "answer"), node("say").with("txet", "hello").with("volume", 11)]));
    if let Err(mistakes) = wrong {
        writeln!(out, "{mistakes}")?;
    }
    Ok(())
}

fn main() -> Result<(), Box<dyn Error>> {
    run(&mut io::stdout())
}

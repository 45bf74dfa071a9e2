//! Lesson 7, several trees: subtrees are data; functions make them, and any of them can be the main tree.

use sfg_tree::nodes::{node, repeat, sequence, subtree};
use sfg_tree::{NodeSpec, Ports, Registry, SubtreeSpec, TreeSpec};
use std::error::Error;
use std::io::{self, Write};

#[derive(Ports)]
struct SayPorts {
    #[port(setting)]
    text: String,
}

fn say(text: &str) -> NodeSpec {
    node("say").with("text", text)
}

/// What in another library would be a file of trees.
fn library() -> Vec<SubtreeSpec> {
    let greetings = ["morning", "evening"];
    let greet = |time: &str| SubtreeSpec::new(format!("greet in the {time}"), say(&format!("good {time}")));
    let day = greetings.map(|time| subtree(format!("greet in the {time}")));
    greetings.map(greet).into_iter().chain([SubtreeSpec::new("day", sequence(day))]).collect()
}

pub(crate) fn run(out: &mut impl Write) -> Result<(), Box<dyn Error>> {
    let mut registry = Registry::<Vec<String>>::new();
    registry.step_with::<SayPorts>("say", |tick, ports| {
        tick.context.push(ports.text);
        Ok(())
    });
    let mains = [subtree("greet in the evening"), subtree("day"), repeat(2, subtree("day"))];
    for root in mains {
        let mut tree = registry.tree(TreeSpec { root, subtrees: library(), ..TreeSpec::default() })?;
        let mut said = Vec::new();
        while tree.tick(0.0, &mut said) == sfg_tree::Status::Running {}
        writeln!(out, "{} nodes: {}", tree.n_nodes(), said.join(", "))?;
    }
    Ok(())
}

fn main() -> Result<(), Box<dyn Error>> {
    run(&mut io::stdout())
}

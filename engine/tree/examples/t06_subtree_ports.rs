//! Lesson 6, ports of subtrees: a subtree has keys of its own; its user connects them to other keys or gives constants.

use sfg_tree::nodes::{node, script, sequence, set_blackboard, subtree};
use sfg_tree::{Ports, Registry, SubtreeSpec, TreeSpec};
use std::error::Error;
use std::io::{self, Write};

#[derive(Ports)]
struct SayPorts {
    #[port(setting)]
    text: String,
}

pub(crate) fn run(out: &mut impl Write) -> Result<(), Box<dyn Error>> {
    let mut registry = Registry::<Vec<String>>::new();
    registry.step_with::<SayPorts>("say", |tick, ports| {
        tick.context.push(ports.text);
        Ok(())
    });
    let go = SubtreeSpec::new(
        "go",
        sequence([
            node("say").with_key("text", "target"),
            script("result := 'arrived at ' + target"),
            // A key that is no port stays inside.
            script("n_steps := 7"),
        ]),
    )
    .input("target")
    .output("result");
    let main = sequence([
        set_blackboard("goal", "the table"),
        subtree("go").with_key("target", "goal").with_key("result", "first"),
        subtree("go").with("target", "the door").with_key("result", "second"),
        node("say").with_key("text", "first"),
        node("say").with_key("text", "second"),
    ]);
    let spec = TreeSpec::new(main).subtree(go);
    let mut tree = registry.tree(spec.clone())?;
    let mut said = Vec::new();
    let status = tree.tick(0.0, &mut said);
    writeln!(out, "{status}\n{}", said.join("\n"))?;
    writeln!(out, "n_steps outside: {:?}", tree.literal("n_steps"))?;

    let mut wrong = spec;
    wrong.root.children.push(node("say").with_key("text", "result"));
    wrong.subtrees[0].root.children.push(set_blackboard("target", "elsewhere"));
    if let Err(mistakes) = registry.tree(wrong) {
        writeln!(out, "{mistakes}")?;
    }
    Ok(())
}

fn main() -> Result<(), Box<dyn Error>> {
    run(&mut io::stdout())
}

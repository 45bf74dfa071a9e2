//! Lesson 14, the signature of a subtree: what it declares is checked where it is used, with defaults where nothing is given.

use sfg_tree::nodes::{script, sequence, set_blackboard, subtree};
use sfg_tree::{NodeSpec, Registry, SubtreeSpec, TreeSpec};
use std::error::Error;
use std::io::{self, Write};

fn pour() -> SubtreeSpec {
    SubtreeSpec::new("pour", script("poured_ml := amount_ml * factor; total_ml := total_ml + poured_ml"))
        .input("amount_ml")
        .input_or("factor", 1.5)
        .output("poured_ml")
        .inout("total_ml")
}

fn spec(root: NodeSpec) -> TreeSpec {
    TreeSpec::new(root).subtree(pour()).entry("total_ml", 0)
}

pub(crate) fn run(out: &mut impl Write) -> Result<(), Box<dyn Error>> {
    let registry = Registry::<()>::new();
    let mut tree = registry.tree(spec(sequence([
        // What is not connected is the key of the same name outside.
        set_blackboard("amount_ml", 100),
        subtree("pour"),
        subtree("pour").with("amount_ml", 10).with("factor", 2).with_key("poured_ml", "second_ml"),
    ])))?;
    tree.tick(0.0, &mut ());
    for key in ["poured_ml", "second_ml", "total_ml"] {
        writeln!(out, "{key} = {}", tree.literal(key).map(|value| value.to_string()).unwrap_or_default())?;
    }
    let wrong = sequence([
        // Nobody has written `amount_ml` here.
        subtree("pour"),
        subtree("pour").with("amuont_ml", 10),
        subtree("pour").with("amount_ml", 1).with("poured_ml", 5),
        subtree("puor"),
    ]);
    if let Err(mistakes) = registry.tree(spec(wrong)) {
        writeln!(out, "{mistakes}")?;
    }
    Ok(())
}

fn main() -> Result<(), Box<dyn Error>> {
    run(&mut io::stdout())
}

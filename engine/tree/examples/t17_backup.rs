//! Lesson 17, backups: the blackboard is taken aside and put back, or the whole tree is written down and read again.

use sfg_tree::nodes::script;
use sfg_tree::{Registry, TreeSpec, TreeState};
use std::error::Error;
use std::io::{self, Write};

pub(crate) fn run(out: &mut impl Write) -> Result<(), Box<dyn Error>> {
    let registry = Registry::<()>::new();
    let spec = TreeSpec::from(script("n := n + 1; word := word + 'a'")).entry("n", 0).entry("word", "");
    let mut tree = registry.tree(spec.clone())?;
    tree.tick(0.0, &mut ());
    // Values are shared, not copied: this is cheap however large they are.
    let backup = tree.backup();
    tree.tick(1.0, &mut ());
    writeln!(out, "before: n {:?}, word {:?}", tree.literal("n"), tree.literal("word"))?;
    tree.restore(&backup);
    writeln!(out, "after:  n {:?}, word {:?}", tree.literal("n"), tree.literal("word"))?;

    // As plain data it goes to a file in any format, and into another process.
    let literal = tree.save().to_literal();
    let state = TreeState::from_literal(&literal)?;
    let mut other = registry.tree(spec)?;
    other.resume(&state, &mut ()).map_err(|errors| errors[0].clone())?;
    other.tick(2.0, &mut ());
    writeln!(out, "other:  n {:?}, word {:?}", other.literal("n"), other.literal("word"))?;
    Ok(())
}

fn main() -> Result<(), Box<dyn Error>> {
    run(&mut io::stdout())
}

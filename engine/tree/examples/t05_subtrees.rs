//! Lesson 5, subtrees: a tree with a name is used like a node.

use sfg_tree::nodes::{fallback, node, retry, sequence, subtree};
use sfg_tree::{Failure, Registry, Status, SubtreeSpec, TreeSpec};
use std::error::Error;
use std::io::{self, Write};

#[derive(Default)]
struct Door {
    is_open: bool,
    n_picks: u32,
    said: Vec<String>,
}

pub(crate) fn run(out: &mut impl Write) -> Result<(), Box<dyn Error>> {
    let mut registry = Registry::<Door>::new();
    registry.condition("is_door_open", [], |tick| Ok(tick.context.is_open));
    registry.step("pass_door", [], |tick| {
        tick.context.said.push("pass".to_owned());
        if tick.context.is_open { Ok(()) } else { Err(Failure::new("blocked", "the door is closed")) }
    });
    registry.step("open_door", [], |_tick| Err(Failure::new("locked", "the door is locked")));
    registry.step("pick_lock", [], |tick| {
        let door = &mut *tick.context;
        door.n_picks += 1;
        door.said.push(format!("pick {}", door.n_picks));
        door.is_open = door.n_picks == 3;
        if door.is_open { Ok(()) } else { Err(Failure::new("no_luck", "the lock does not turn")) }
    });
    registry.step("smash_door", [], |tick| {
        tick.context.is_open = true;
        Ok(())
    });

    let open = fallback([node("open_door"), retry(5, node("pick_lock")), node("smash_door")]);
    let main = sequence([fallback([node("is_door_open"), subtree("open the door")]), node("pass_door")]);
    let mut tree = registry.tree(TreeSpec::new(main).subtree(SubtreeSpec::new("open the door", open)))?;

    for node in tree.definition() {
        writeln!(out, "{} {}", node.kind, tree.path(node.id))?;
    }
    let mut door = Door::default();
    let mut status = Status::Running;
    while status == Status::Running {
        status = tree.tick(0.0, &mut door);
        writeln!(out, "{status}: {}", door.said.join(", "))?;
    }
    for at in tree.failures() {
        writeln!(out, "tick {}: {}: {}", at.tick_idx, tree.path(at.node), at.failure)?;
    }
    Ok(())
}

fn main() -> Result<(), Box<dyn Error>> {
    run(&mut io::stdout())
}

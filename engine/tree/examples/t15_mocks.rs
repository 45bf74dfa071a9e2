//! Lesson 15, mocks: the same tree is built from another registry whose leaves only pretend.

use sfg_tree::nodes::{fallback, node, retry, sequence};
use sfg_tree::{Action, Failure, NodeSpec, Outcome, PortSpec, Progress, Registry, Status, Tick};
use std::error::Error;
use std::io::{self, Write};

const NAMES: [&str; 3] = ["move_to_cup", "grasp", "ask_for_help"];

/// Does what a text says, a letter a tick: R running, S success, F failure. The last letter repeats.
struct Mock {
    name: &'static str,
    script: &'static str,
    letter_idx: usize,
}

impl Mock {
    fn next(&mut self) -> Outcome {
        let letters = self.script.as_bytes();
        let letter = letters[self.letter_idx.min(letters.len() - 1)];
        self.letter_idx += 1;
        match letter {
            b'R' => Ok(Progress::Running),
            b'S' => Ok(Progress::Success),
            _ => Err(Failure::new("mocked", self.name)),
        }
    }
}

impl Action<Vec<String>> for Mock {
    fn start(&mut self, tick: &mut Tick<'_, Vec<String>>) -> Outcome {
        tick.context.push(self.name.to_owned());
        self.next()
    }
    fn poll(&mut self, _tick: &mut Tick<'_, Vec<String>>) -> Outcome {
        self.next()
    }
}

/// Every leaf of the application with the ports of the real one, so that the tree is checked as ever.
fn mocks(scripts: [&'static str; 3]) -> Registry<Vec<String>> {
    let mut registry = Registry::new();
    for (name, script) in NAMES.into_iter().zip(scripts) {
        let ports = [PortSpec::setting::<String>("object").default_value("cup")];
        registry.action(name, ports, move || Mock { name, script, letter_idx: 0 });
    }
    registry
}

fn tree_under_test() -> NodeSpec {
    sequence([node("move_to_cup"), fallback([retry(2, node("grasp").with("object", "mug")), node("ask_for_help")])])
}

pub(crate) fn run(out: &mut impl Write) -> Result<(), Box<dyn Error>> {
    for scripts in [["RRS", "S", "F"], ["S", "FS", "F"], ["S", "F", "S"], ["RF", "S", "S"], ["S", "F", "F"]] {
        let mut tree = mocks(scripts).tree(tree_under_test())?;
        let (mut said, mut status) = (Vec::new(), Status::Running);
        while status == Status::Running {
            status = tree.tick(0.0, &mut said);
        }
        writeln!(out, "{scripts:?}: {status} after {}", said.join(", "))?;
    }
    Ok(())
}

fn main() -> Result<(), Box<dyn Error>> {
    run(&mut io::stdout())
}

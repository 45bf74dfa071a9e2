//! Lesson 8, arguments of nodes: what is known before the tree is built is captured where the node is registered, not a port.

use sfg_tree::nodes::{node, sequence};
use sfg_tree::{Action, Outcome, Progress, Registry, Status, Tick};
use std::error::Error;
use std::io::{self, Write};
use std::sync::Arc;

/// A connection that nodes share and that cannot be copied.
struct Driver {
    name: &'static str,
}

/// Moves one joint.
struct MoveJoint {
    driver: Arc<Driver>,
    joint_idx: usize,
    n_ticks_left: u32,
}

impl Action<Vec<String>> for MoveJoint {
    fn start(&mut self, tick: &mut Tick<'_, Vec<String>>) -> Outcome {
        tick.context.push(format!("{} moves joint {}", self.driver.name, self.joint_idx));
        self.n_ticks_left = 2;
        Ok(Progress::Running)
    }
    fn poll(&mut self, _tick: &mut Tick<'_, Vec<String>>) -> Outcome {
        self.n_ticks_left -= 1;
        Ok(if self.n_ticks_left == 0 { Progress::Success } else { Progress::Running })
    }
}

pub(crate) fn run(out: &mut impl Write) -> Result<(), Box<dyn Error>> {
    let mut registry = Registry::<Vec<String>>::new();
    for (name, driver) in [("left", Driver { name: "left arm" }), ("right", Driver { name: "right arm" })] {
        let driver = Arc::new(driver);
        for joint_idx in 0..2 {
            let driver = Arc::clone(&driver);
            // Called once for each node of a tree, so nodes of one kind share nothing but what they are given here.
            registry
                .action(format!("move_{name}_{joint_idx}"), [], move || MoveJoint {
                    driver: Arc::clone(&driver),
                    joint_idx,
                    n_ticks_left: 0,
                })
                .doc("Moves one joint.")
                .takes_secs(0.2)
                .occupies([format!("{name}_arm")]);
        }
    }
    let mut tree = registry.tree(sequence(["move_left_0", "move_right_1"].map(node)))?;
    for step in tree.preview().steps {
        writeln!(out, "{} takes {} s", step.path, step.expected_secs.unwrap_or(0.0))?;
    }
    let (mut said, mut n_ticks) = (Vec::new(), 1);
    while tree.tick(0.1 * f64::from(n_ticks), &mut said) == Status::Running {
        n_ticks += 1;
    }
    writeln!(out, "{} in {n_ticks} ticks", said.join(", "))?;
    Ok(())
}

fn main() -> Result<(), Box<dyn Error>> {
    run(&mut io::stdout())
}

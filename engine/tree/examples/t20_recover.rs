//! Lesson 20, reasons: a failure says why, and the tree chooses by it what to do.

use sfg_tree::nodes::{node, recover, retry, timeout};
use sfg_tree::{Failure, NodeSpec, Outcome, Progress, Registry, Status, Tick};
use std::error::Error;
use std::io::{self, Write};

/// What goes wrong, attempt by attempt, and what was done.
struct World {
    troubles: Vec<&'static str>,
    said: Vec<String>,
}

struct Grasp;

impl sfg_tree::Action<World> for Grasp {
    fn start(&mut self, tick: &mut Tick<'_, World>) -> Outcome {
        tick.context.said.push("grasp".to_owned());
        match tick.context.troubles.pop() {
            None => Ok(Progress::Success),
            Some("too slow") => Ok(Progress::Running),
            Some("bug") => panic!("index out of range"),
            Some(trouble) => Err(Failure::new(trouble, "the hand is empty")),
        }
    }
    fn poll(&mut self, _tick: &mut Tick<'_, World>) -> Outcome {
        Ok(Progress::Running)
    }
}

pub(crate) fn run(out: &mut impl Write) -> Result<(), Box<dyn Error>> {
    let mut registry = Registry::<World>::new();
    registry.action("grasp", [], || Grasp).fails_with(["slipped", "no_view"]);
    for name in ["open_hand", "move_camera", "rest"] {
        registry.step(name, [], move |tick| {
            tick.context.said.push(name.to_owned());
            Ok(())
        });
    }
    let grasp = || timeout(2, node("grasp"));
    let by_reason =
        || recover(3, grasp(), [("slipped", node("open_hand")), ("no_view", node("move_camera")), ("timeout", node("rest"))]);
    let mut show = |root: NodeSpec, troubles: &[&'static str]| -> Result<(), Box<dyn Error>> {
        let mut tree = registry.tree(root)?;
        let mut world = World { troubles: troubles.iter().rev().copied().collect(), said: Vec::new() };
        let (mut now_secs, mut status) = (0.0, Status::Running);
        while status == Status::Running {
            status = tree.tick(now_secs, &mut world);
            now_secs += 1.0;
        }
        writeln!(out, "{}: {status}", world.said.join(", "))?;
        if let Some(at) = tree.failure().filter(|_| status == Status::Failure) {
            writeln!(out, "  {}: {}", tree.path(at.node), at.failure)?;
        }
        Ok(())
    };
    show(by_reason(), &["slipped", "no_view"])?;
    show(by_reason(), &["too slow"])?;
    show(by_reason(), &["slipped", "slipped", "slipped"])?;
    // A panic is a failure like any other, with the reason `panicked`.
    show(by_reason(), &["bug"])?;
    show(retry(3, grasp()).with("on", vec!["slipped"]), &["slipped", "no_view"])
}

fn main() -> Result<(), Box<dyn Error>> {
    // The panic of the lesson is caught by the tree; what the default hook prints would only distract.
    std::panic::set_hook(Box::new(|_panic| {}));
    run(&mut io::stdout())
}

//! Lesson 4, actions and reactions: an action takes several ticks; a reactive node looks at its first children on every one.

use sfg_tree::nodes::{node, reactive_sequence, sequence};
use sfg_tree::{Halt, NodeSpec, Outcome, PortAction, Ports, Progress, Registry, Status, Tick};
use std::error::Error;
use std::io::{self, Write};

#[derive(Ports)]
struct MovePorts {
    /// Time for the way, seconds.
    #[port(setting, min = 0)]
    secs: f64,
}

/// Moves without waiting: every call returns at once.
#[derive(Default)]
struct Move {
    begun_secs: f64,
}

impl PortAction<Vec<String>> for Move {
    type Ports = MovePorts;

    fn start(&mut self, tick: &mut Tick<'_, Vec<String>>, _ports: &MovePorts) -> Outcome {
        self.begun_secs = tick.now_secs();
        tick.context.push("move".to_owned());
        Ok(Progress::Running)
    }

    fn poll(&mut self, tick: &mut Tick<'_, Vec<String>>, ports: &MovePorts) -> Outcome {
        if tick.now_secs() - self.begun_secs < ports.secs {
            return Ok(Progress::Running);
        }
        tick.context.push("arrived".to_owned());
        Ok(Progress::Success)
    }

    fn halt(&mut self, tick: &mut Tick<'_, Vec<String>>, _ports: &MovePorts) -> Halt {
        tick.context.push("stopped".to_owned());
        Halt::Done
    }
}

pub(crate) fn run(out: &mut impl Write) -> Result<(), Box<dyn Error>> {
    let mut registry = Registry::<Vec<String>>::new();
    registry.condition("is_battery_ok", [], |tick| {
        tick.context.push("battery?".to_owned());
        Ok(tick.tick_idx() < 3)
    });
    registry.action_with("move", Move::default);
    let children = || [node("is_battery_ok"), node("move").with("secs", 3)];
    let mut show = |name: &str, root: NodeSpec| -> Result<(), Box<dyn Error>> {
        let mut tree = registry.tree(root)?;
        writeln!(out, "{name}")?;
        for second in 0..5 {
            let mut said = Vec::new();
            let status = tree.tick(f64::from(second), &mut said);
            said.push(status.to_string());
            writeln!(out, "  {second} s: {}", said.join(", "))?;
            if status != Status::Running {
                break;
            }
        }
        Ok(())
    };
    show("sequence", sequence(children()))?;
    show("reactive_sequence", reactive_sequence(children()))
}

fn main() -> Result<(), Box<dyn Error>> {
    run(&mut io::stdout())
}

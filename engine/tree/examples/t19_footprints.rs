//! Lesson 19, footprints: two actions that need the same arm never overlap, even when stopping takes several ticks.

use sfg_tree::nodes::{node, parallel, reactive_fallback, sequence};
use sfg_tree::{Action, Halt, NodeSpec, Outcome, Progress, Registry, Tick};
use std::error::Error;
use std::io::{self, Write};

/// Moves a part of the robot and needs two ticks to come to rest.
struct Move {
    name: &'static str,
    n_braking: u32,
}

impl Action<Vec<String>> for Move {
    fn start(&mut self, tick: &mut Tick<'_, Vec<String>>) -> Outcome {
        self.n_braking = 2;
        tick.context.push(format!("{} starts", self.name));
        Ok(Progress::Running)
    }
    fn poll(&mut self, _tick: &mut Tick<'_, Vec<String>>) -> Outcome {
        Ok(Progress::Running)
    }
    fn halt(&mut self, tick: &mut Tick<'_, Vec<String>>) -> Halt {
        if self.n_braking == 0 {
            tick.context.push(format!("{} rests", self.name));
            return Halt::Done;
        }
        self.n_braking -= 1;
        tick.context.push(format!("{} brakes", self.name));
        Halt::Pending { within_secs: 5.0 }
    }
}

pub(crate) fn run(out: &mut impl Write) -> Result<(), Box<dyn Error>> {
    let mut registry = Registry::<Vec<String>>::new();
    registry.condition("is_person_near", [], |tick| Ok(tick.tick_idx() >= 2));
    for (name, part) in [("work", "arm"), ("retreat", "arm"), ("look_around", "head")] {
        registry.action(name, [], move || Move { name, n_braking: 0 }).occupies([part]);
    }
    let mut show = |name: &str, root: NodeSpec| -> Result<(), Box<dyn Error>> {
        let mut tree = registry.tree(root)?;
        writeln!(out, "{name}")?;
        for conflict in tree.preview().conflicts {
            writeln!(out, "  beforehand: {} and {} need the {}", conflict.first, conflict.second, conflict.part)?;
        }
        for tick in 1..=5 {
            let mut said = Vec::new();
            let status = tree.tick(f64::from(tick), &mut said);
            said.push(status.to_string());
            writeln!(out, "  tick {tick}: {}", said.join(", "))?;
        }
        Ok(())
    };
    // What takes the place of the running child waits until the arm rests ...
    show("same part", reactive_fallback([sequence([node("is_person_near"), node("retreat")]), node("work")]))?;
    // ... and begins at once when it needs another part.
    show("other part", reactive_fallback([sequence([node("is_person_near"), node("look_around")]), node("work")]))?;
    // Branches of a parallel are held back, too.
    show("parallel", parallel([node("work"), node("retreat"), node("look_around")]))
}

fn main() -> Result<(), Box<dyn Error>> {
    run(&mut io::stdout())
}

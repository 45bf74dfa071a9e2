//! Lesson 3, own types: any type goes through a port; one that implements `FromLiteral` can also be written in a tree.

use sfg_tree::nodes::{node, sequence};
use sfg_tree::{FromLiteral, Literal, Out, PortWord, Ports, Registry, Shape};
use std::error::Error;
use std::io::{self, Write};
use std::sync::Arc;

/// A place in the plane, m. Written `[1.5, 2.0]`.
#[derive(Debug)]
struct Place {
    x_m: f64,
    y_m: f64,
}

impl FromLiteral for Place {
    fn shape() -> Shape {
        <[f64; 2]>::shape()
    }
    fn from_literal(literal: &Literal) -> Result<Self, String> {
        let [x_m, y_m] = <[f64; 2]>::from_literal(literal)?;
        Ok(Self { x_m, y_m })
    }
}

/// Written `slow` or `at_once`.
#[derive(Clone, Copy, Debug, PortWord)]
enum Pace {
    Slow,
    AtOnce,
}

#[derive(Ports)]
struct FindPorts {
    #[port(output)]
    goal: Out<Place>,
}

#[derive(Ports)]
struct GoPorts {
    #[port(setting)]
    goal: Arc<Place>,
    #[port(setting, default = Pace::Slow)]
    pace: Pace,
}

pub(crate) fn run(out: &mut impl Write) -> Result<(), Box<dyn Error>> {
    let mut registry = Registry::<Vec<String>>::new();
    registry.step_with::<FindPorts>("find", |tick, ports| {
        ports.goal.set(tick, Place { x_m: 1.1, y_m: 2.3 });
        Ok(())
    });
    registry.step_with::<GoPorts>("go", |tick, ports| {
        tick.context.push(format!("to {} m, {} m: {:?}", ports.goal.x_m, ports.goal.y_m, ports.pace));
        Ok(())
    });
    let mut tree = registry.tree(sequence([
        node("find"),
        node("go").with_key("goal", "goal").with("pace", Pace::AtOnce),
        node("go").with("goal", vec![-1.0, 3.0]),
    ]))?;
    let mut said = Vec::new();
    tree.tick(0.0, &mut said);
    writeln!(out, "{}", said.join("\n"))?;
    if let Err(mistakes) = registry.tree(node("go").with("goal", vec![1.0]).with("pace", "fast")) {
        writeln!(out, "{mistakes}")?;
    }
    Ok(())
}

fn main() -> Result<(), Box<dyn Error>> {
    run(&mut io::stdout())
}

//! Lesson 18, loops: the same is done for each item of a list, or of a queue that others fill meanwhile.

use sfg_tree::nodes::{fallback, key, loop_over, node, sequence};
use sfg_tree::{Failure, Out, Ports, Queue, Registry, Status};
use std::error::Error;
use std::io::{self, Write};
use std::sync::Arc;

#[derive(Clone, Debug)]
struct Waypoint {
    name: &'static str,
}

#[derive(Ports)]
struct PlanPorts {
    #[port(output)]
    waypoints: Out<Queue<Waypoint>>,
}

#[derive(Ports)]
struct GoPorts {
    #[port(input)]
    waypoint: Waypoint,
    #[port(input)]
    waypoints: Arc<Queue<Waypoint>>,
}

pub(crate) fn run(out: &mut impl Write) -> Result<(), Box<dyn Error>> {
    let mut registry = Registry::<Vec<String>>::new();
    registry.list::<Waypoint>();
    registry.step_with::<PlanPorts>("plan", |tick, ports| {
        ports.waypoints.set(tick, ["table", "door"].map(|name| Waypoint { name }).into_iter().collect());
        Ok(())
    });
    registry.step_with::<GoPorts>("go", |tick, ports| {
        tick.context.push(format!("go to the {}", ports.waypoint.name));
        if ports.waypoint.name == "door" {
            ports.waypoints.push(Waypoint { name: "garden" });
            return Err(Failure::new("closed", "the door is closed"));
        }
        Ok(())
    });
    registry.step("wait", [], |tick| {
        tick.context.push("wait".to_owned());
        Ok(())
    });
    let visit = fallback([node("go"), node("wait")]);
    let mut tree = registry.tree(sequence([node("plan"), loop_over(key("waypoints"), "waypoint", visit)]))?;
    let (mut said, mut status) = (Vec::new(), Status::Running);
    while status == Status::Running {
        status = tree.tick(0.0, &mut said);
    }
    writeln!(out, "{}\n{status}", said.join("\n"))?;
    Ok(())
}

fn main() -> Result<(), Box<dyn Error>> {
    run(&mut io::stdout())
}

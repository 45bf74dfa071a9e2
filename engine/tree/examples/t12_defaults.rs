//! Lesson 12, defaults: what a port holds when the tree says nothing.

use sfg_tree::nodes::{node, sequence};
use sfg_tree::{PortWord, Ports, Registry};
use std::error::Error;
use std::io::{self, Write};
use std::sync::Arc;

#[derive(Clone, Copy, Debug, PartialEq, PortWord)]
enum Grip {
    Power,
    Precision,
}

#[derive(Ports)]
struct GraspPorts {
    /// How the hand closes.
    #[port(setting, default = Grip::Power)]
    grip: Grip,
    /// Force, newtons.
    #[port(setting, default = 10, min = 1, max = 40)]
    force_newtons: f64,
    /// Where to touch.
    #[port(setting, default = [0.0, 0.0])]
    touch_m: [f64; 2],
    /// Nothing unless given.
    #[port(setting, optional)]
    comment: Option<String>,
    /// The entry `cup` unless the tree names another.
    #[port(input, key = "cup")]
    object: Arc<String>,
    /// The entry `mass_kg` if anybody has written it.
    #[port(input, optional)]
    mass_kg: Option<f64>,
}

pub(crate) fn run(out: &mut impl Write) -> Result<(), Box<dyn Error>> {
    let mut registry = Registry::<Vec<String>>::new();
    registry.entry::<String>("cup");
    registry.entry::<String>("spare");
    registry.step_with::<GraspPorts>("grasp", |tick, ports| {
        let GraspPorts { grip, force_newtons, touch_m, comment, object, mass_kg } = ports;
        tick.context.push(format!("{object}: {grip:?} {force_newtons} N at {touch_m:?}, {comment:?}, {mass_kg:?}"));
        Ok(())
    });
    let mut tree = registry.tree(sequence([
        node("grasp"),
        node("grasp")
            .with("grip", Grip::Precision)
            .with("force_newtons", 2.5)
            .with("comment", "gently")
            .with_key("object", "spare"),
    ]))?;
    tree.set_entry("cup", "blue cup".to_owned())?;
    tree.set_entry("spare", "red cup".to_owned())?;
    let mut said = Vec::new();
    tree.tick(0.0, &mut said);
    writeln!(out, "{}", said.join("\n"))?;
    // What a node takes can be asked; this is what editors and schemas are made from.
    for port in GraspPorts::specs() {
        let default = port.default_literal().map(ToString::to_string).unwrap_or_default();
        writeln!(out, "{:14} {:8} {default:12} {}", port.name(), port.port_type().name(), port.doc_text())?;
    }
    Ok(())
}

fn main() -> Result<(), Box<dyn Error>> {
    run(&mut io::stdout())
}

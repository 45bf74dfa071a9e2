//! Lesson 13, large values: a port lends a shared handle, so an image of megabytes is never copied.

use sfg_tree::nodes::{node, sequence};
use sfg_tree::{InOut, Out, Ports, Registry};
use std::error::Error;
use std::io::{self, Write};
use std::sync::Arc;

/// A point cloud. It cannot even be cloned.
struct Cloud(Vec<[f32; 3]>);

#[derive(Ports)]
struct ScanPorts {
    #[port(output)]
    cloud: Out<Cloud>,
}

#[derive(Ports)]
struct LookPorts {
    #[port(input)]
    cloud: Arc<Cloud>,
    /// The same cloud under another key.
    #[port(output)]
    seen: Out<Cloud>,
}

#[derive(Ports)]
struct CountPorts {
    #[port(inout)]
    n_points: InOut<usize>,
    #[port(input)]
    cloud: Arc<Cloud>,
}

pub(crate) fn run(out: &mut impl Write) -> Result<(), Box<dyn Error>> {
    let mut registry = Registry::<()>::new();
    registry.entry::<usize>("n_points");
    registry.step_with::<ScanPorts>("scan", |tick, ports| {
        ports.cloud.set(tick, Cloud(vec![[0.0; 3]; 400_000]));
        Ok(())
    });
    registry.step_with::<LookPorts>("look", |tick, ports| {
        ports.seen.set_shared(tick, ports.cloud);
        Ok(())
    });
    registry.step_with::<CountPorts>("count", |tick, ports| {
        // An inout port is read when asked and written after.
        let n_points = ports.n_points.get(tick)? + ports.cloud.0.len();
        ports.n_points.set(tick, n_points);
        Ok(())
    });
    let mut tree = registry.tree(sequence(["scan", "look", "count", "count"].map(node)))?;
    tree.set_entry("n_points", 0_usize)?;
    tree.tick(0.0, &mut ());
    let (cloud, seen) = (tree.entry::<Cloud>("cloud"), tree.entry::<Cloud>("seen"));
    let is_same = matches!((&cloud, &seen), (Some(cloud), Some(seen)) if Arc::ptr_eq(cloud, seen));
    writeln!(out, "{} points, one cloud under two keys: {is_same}", cloud.map_or(0, |cloud| cloud.0.len()))?;
    writeln!(out, "counted {}", tree.entry::<usize>("n_points").as_deref().unwrap_or(&0))?;
    Ok(())
}

fn main() -> Result<(), Box<dyn Error>> {
    run(&mut io::stdout())
}

//! The leaves and trees that are measured. [`crate::peer`] has the same for the other crate.

use sfg_tree::{Action, NodeSpec, Outcome, PortSpec, Progress, Registry, Tick, Tree, TreeSpec};
use std::sync::Arc;

/// Keys of the trees with ports: `counter_0`, ...
pub(crate) const N_COUNTERS: usize = 16;
/// Conditions above the action of the reactive trees.
pub(crate) const N_CONDITIONS: usize = 100;
/// Nodes of a tree of 100 rows: the root, and a control and nine leaves each.
pub(crate) const N_NODES: usize = 1_001;
/// Leaves of a flat tree.
pub(crate) const N_LEAVES: usize = 1_000;

/// A point cloud as large as a depth camera's.
pub(crate) type Cloud = Vec<u8>;
pub(crate) const CLOUD_BYTES: usize = 4_900_000;

pub(crate) struct Context {
    /// What every leaf adds to.
    pub(crate) sum: u64,
    /// What the flags say in this tick.
    pub(crate) flag: bool,
    /// What the camera saw last.
    pub(crate) clouds: Vec<Arc<Cloud>>,
}

impl Context {
    pub(crate) fn new() -> Self {
        Self { sum: 1, flag: true, clouds: Vec::new() }
    }
}

struct Wait;

impl Action<Context> for Wait {
    fn start(&mut self, tick: &mut Tick<'_, Context>) -> Outcome {
        self.poll(tick)
    }
    fn poll(&mut self, tick: &mut Tick<'_, Context>) -> Outcome {
        tick.context.sum = tick.context.sum.wrapping_add(tick.tick_idx());
        Ok(Progress::Running)
    }
}

pub(crate) fn registry() -> Registry<Context> {
    let mut registry = Registry::<Context>::new();
    registry.step("work", [], |tick| {
        tick.context.sum = tick.context.sum.wrapping_mul(31).wrapping_add(tick.tick_idx());
        Ok(())
    });
    registry.condition("holds", [], |tick| {
        tick.context.sum = tick.context.sum.wrapping_add(1);
        Ok(tick.context.sum != 0)
    });
    registry.condition("agrees", [PortSpec::input::<bool>("flag")], |tick| {
        let flag = tick.get::<bool>("flag")?;
        tick.context.sum = tick.context.sum.wrapping_add(u64::from(flag));
        Ok(flag == tick.context.flag)
    });
    registry.action("wait", [], || Wait);
    registry.step("add", [PortSpec::setting::<u64>("from"), PortSpec::output::<u64>("to")], |tick| {
        let sum = tick.get::<u64>("from")?.wrapping_add(1);
        tick.set("to", sum);
        tick.context.sum = tick.context.sum.wrapping_add(sum);
        Ok(())
    });
    registry.step("see", [PortSpec::output::<Cloud>("cloud")], |tick| {
        let cloud_idx = tick.context.sum as usize % tick.context.clouds.len();
        let cloud = Arc::clone(&tick.context.clouds[cloud_idx]);
        tick.set_shared("cloud", cloud);
        Ok(())
    });
    registry.step("look", [PortSpec::input::<Cloud>("cloud")], |tick| {
        let cloud = tick.input::<Cloud>("cloud")?;
        tick.context.sum = tick.context.sum.wrapping_add(cloud.len() as u64);
        Ok(())
    });
    for counter_idx in 0..N_COUNTERS {
        registry.entry::<u64>(format!("counter_{counter_idx}"));
    }
    for flag_idx in 0..N_CONDITIONS {
        registry.entry::<bool>(format!("flag_{flag_idx}"));
    }
    registry.entry::<f64>("x");
    registry.entry::<f64>("y");
    registry
}

/// A sequence of `n_rows` sequences of nine leaves; a tenth of the nodes are controls.
pub(crate) fn rows(n_rows: usize, leaf: impl Fn(usize) -> NodeSpec) -> TreeSpec {
    let row = |row_idx: usize| NodeSpec::new("sequence").children((0..9).map(|column| leaf(row_idx * 9 + column)));
    TreeSpec::new(NodeSpec::new("sequence").children((0..n_rows).map(row)))
}

/// One sequence of leaves, so that a node costs what its leaf costs.
pub(crate) fn flat(leaf: impl Fn(usize) -> NodeSpec) -> TreeSpec {
    TreeSpec::new(NodeSpec::new("sequence").children((0..N_LEAVES).map(leaf)))
}

/// Conditions that are asked on every tick, then an action that runs.
pub(crate) fn reactive(condition: impl Fn(usize) -> NodeSpec) -> TreeSpec {
    let conditions = (0..N_CONDITIONS).map(condition);
    TreeSpec::new(NodeSpec::new("reactive_sequence").children(conditions).child(NodeSpec::new("wait")))
}

/// A leaf without ports.
pub(crate) fn mixed(leaf_idx: usize) -> NodeSpec {
    NodeSpec::new(if leaf_idx.is_multiple_of(2) { "work" } else { "holds" })
}

/// A leaf that reads one key and writes the next one.
pub(crate) fn counting(leaf_idx: usize) -> NodeSpec {
    let key = |counter_idx: usize| format!("counter_{}", counter_idx % N_COUNTERS);
    NodeSpec::new("add").with_key("from", key(leaf_idx)).with_key("to", key(leaf_idx + 1))
}

/// Gives every counter of a new tree its value.
pub(crate) fn start_counters(tree: &mut Tree<Context>) {
    for counter_idx in 0..N_COUNTERS {
        tree.set_entry(&format!("counter_{counter_idx}"), counter_idx as u64).unwrap();
    }
}

//! Writes small trees as BehaviorTree.CPP files, and what this engine makes of them, for a comparison with other engines.
//!
//! `cargo run -p sfg-tree --example export_traces -- FOLDER [N] [SEED]`: `0000.xml`, `0001.xml`, ... and `traces.json`.
//!
//! | family | nodes beside the leaves | share |
//! |---|---|---|
//! | `core` | Sequence, Fallback, Inverter, SubTree with remapped keys | 5 of 10 |
//! | `parallel` | also Parallel, for which `py_trees` has policies | 1 of 10 |
//! | `shared` | also what `py_trees` has under other names | 3 of 10 |
//! | `defaults` | as `core`, and users of a subtree leave ports out that have a default | 1 of 10 |
//!
//! A leaf `Scripted` has a `label` for its events and a `script` with a letter for each tick: R running, S success, F failure.
//! `|` separates activations; the last letter of an activation and the last activation repeat. `Write` writes `text` to the key `to`.
//! A key that is still empty is a failure of the leaf that reads it.
#![expect(clippy::print_stdout, reason = "an example talks to its reader")]

use serde_json::{Value, json};
use sfg_tree::xml::{ImportOptions, export, import};
use sfg_tree::{
    Action, Direction, Failure, Halt, Literal, NodeSpec, Outcome, PortSpec, Progress, Registry, Status, SubtreePort, SubtreeSpec,
    Tick, TreeSpec,
};
use std::error::Error;
use std::path::Path;

/// What happened to leaves: `a start`, `a tick`, `a halt`.
type Events = Vec<String>;

const N_STEPS: usize = 12;

#[derive(Default)]
struct Scripted {
    n_starts: usize,
    n_letters: usize,
}

impl Scripted {
    fn step(&mut self, tick: &mut Tick<'_, Events>, event: &str) -> Outcome {
        let label = tick.get::<String>("label")?;
        tick.context.push(format!("{label} {event}"));
        let script = tick.get::<String>("script")?;
        let activations: Vec<&str> = script.split('|').collect();
        let letters = activations[(self.n_starts - 1).min(activations.len() - 1)].as_bytes();
        let letter = letters.get(self.n_letters.min(letters.len().saturating_sub(1)));
        self.n_letters += 1;
        match letter {
            Some(b'R') => Ok(Progress::Running),
            Some(b'S') => Ok(Progress::Success),
            _ => Err(Failure::new("scripted", "")),
        }
    }
}

impl Action<Events> for Scripted {
    fn start(&mut self, tick: &mut Tick<'_, Events>) -> Outcome {
        self.n_starts += 1;
        self.n_letters = 0;
        self.step(tick, "start")
    }
    fn poll(&mut self, tick: &mut Tick<'_, Events>) -> Outcome {
        self.step(tick, "tick")
    }
    fn halt(&mut self, tick: &mut Tick<'_, Events>) -> Halt {
        if let Ok(label) = tick.get::<String>("label") {
            tick.context.push(format!("{label} halt"));
        }
        Halt::Done
    }
}

fn registry() -> Registry<Events> {
    let mut registry = Registry::new();
    // Leaves that share nothing may overlap for a moment when a reactive node changes from one to another, as elsewhere.
    let text = PortSpec::setting::<String>;
    registry.action("Scripted", [text("label"), text("script")], Scripted::default).occupies(Vec::<String>::new());
    registry
        .step("Write", [text("label"), text("text"), PortSpec::output::<String>("to")], |tick| {
            let label = tick.get::<String>("label")?;
            tick.context.push(format!("{label} start"));
            let text = tick.get::<String>("text")?;
            tick.set("to", text);
            Ok(())
        })
        .occupies(Vec::<String>::new());
    registry
}

/// `SplitMix64`: the same trees on every machine.
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut mixed = self.0;
        mixed = (mixed ^ (mixed >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        mixed ^ (mixed >> 31)
    }

    /// A number below `n`.
    fn below(&mut self, n: usize) -> usize {
        usize::try_from(self.next() % n as u64).unwrap_or(0)
    }

    fn one_in(&mut self, n: usize) -> bool {
        self.below(n) == 0
    }

    fn pick<T: Copy>(&mut self, of: &[T]) -> T {
        of[self.below(of.len())]
    }
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Family {
    Core,
    Parallel,
    Shared,
    Defaults,
}

impl Family {
    fn of(tree_idx: usize) -> Self {
        match tree_idx % 10 {
            0..5 => Self::Core,
            5 => Self::Parallel,
            6..9 => Self::Shared,
            _ => Self::Defaults,
        }
    }

    fn name(self) -> &'static str {
        match self {
            Self::Core => "core",
            Self::Parallel => "parallel",
            Self::Shared => "shared",
            Self::Defaults => "defaults",
        }
    }

    /// Controls, then decorators, then leaves other than the scripted ones.
    fn nodes(self) -> [&'static [&'static str]; 3] {
        match self {
            Self::Core | Self::Defaults => [&["sequence", "fallback"], &["inverter"], &[]],
            Self::Parallel => [&["sequence", "fallback", "parallel"], &["inverter"], &[]],
            Self::Shared => [
                &["sequence", "fallback", "reactive_sequence", "reactive_fallback", "parallel"],
                &["inverter", "force_success", "force_failure", "retry", "repeat", "keep_running_until_failure"],
                &["always_success", "always_failure"],
            ],
        }
    }
}

/// What a tree under construction can use.
struct Maker {
    random: Random,
    family: Family,
    n_labels: usize,
    n_titles: usize,
    /// Subtrees that are complete, so that none uses itself.
    subtrees: Vec<SubtreeSpec>,
}

/// Of the tree that is made now.
#[derive(Default)]
struct Scope {
    /// Keys with scripts.
    keys: Vec<String>,
    /// Connections; none in the main tree.
    ports: Vec<SubtreePort>,
    is_main: bool,
}

impl Maker {
    fn tree(mut self) -> TreeSpec {
        for subtree_idx in 0..self.random.below(3) {
            let mut scope = Scope::default();
            let root = self.node(&mut scope, 2);
            let name = format!("Part{subtree_idx}");
            self.subtrees.push(SubtreeSpec { name, ports: scope.ports, is_open: true, root, location: 0 });
        }
        if self.random.one_in(2) {
            let ports = ["label", "out"].map(|name| SubtreePort {
                name: name.to_owned(),
                direction: if name == "out" { Direction::Out } else { Direction::In },
                default: None,
                location: 0,
            });
            let root = NodeSpec::new("Write").with_key("label", "label").with("text", self.script()).with_key("to", "out");
            self.subtrees.push(SubtreeSpec { name: "Planner".to_owned(), ports: ports.into(), is_open: true, root, location: 0 });
        }
        let mut scope = Scope { is_main: true, ..Scope::default() };
        let mut first = Vec::new();
        for key_idx in 0..self.random.below(3) {
            let key = format!("plan_{key_idx}");
            let label = self.label();
            let is_planned = self.random.one_in(2) && self.subtrees.iter().any(|subtree| subtree.name == "Planner");
            first.push(if is_planned {
                let planner = NodeSpec::subtree("Planner").with("label", label).with_key("out", &*key);
                if self.random.one_in(2) { planner.title(self.title()) } else { planner }
            } else {
                NodeSpec::new("Write").with("label", label).with("text", self.script()).with_key("to", &*key)
            });
            scope.keys.push(key);
        }
        let body = self.node(&mut scope, 3);
        let root = if first.is_empty() { body } else { NodeSpec::new("sequence").children(first).child(body) };
        let mut spec = TreeSpec::new(root);
        spec.subtrees = self.subtrees;
        spec
    }

    fn label(&mut self) -> String {
        self.n_labels += 1;
        format!("leaf_{}", self.n_labels)
    }

    fn title(&mut self) -> String {
        self.n_titles += 1;
        format!("title {}", self.n_titles)
    }

    fn script(&mut self) -> String {
        let mut script = String::new();
        for activation_idx in 0..=self.random.below(3) {
            if activation_idx > 0 {
                script.push('|');
            }
            let n_running = self.random.pick(&[0, 0, 1, 2]);
            script.push_str(&"R".repeat(n_running));
            script.push(self.random.pick(&['S', 'S', 'F']));
        }
        script
    }

    fn node(&mut self, scope: &mut Scope, depth: usize) -> NodeSpec {
        let [controls, decorators, leaves] = self.family.nodes();
        let spec = match self.random.below(8) {
            0..4 if depth > 0 => {
                let kind = self.random.pick(controls);
                let n_children = 2 + self.random.below(3);
                let node = NodeSpec::new(kind).children((0..n_children).map(|_| self.node(scope, depth - 1)));
                if kind == "parallel" { self.thresholds(node) } else { node }
            }
            4..6 if depth > 0 => {
                let kind = self.random.pick(decorators);
                let child = self.node(scope, depth - 1);
                let node = NodeSpec::new(kind).child(child);
                let n_rounds = self.random.pick(&[1, 2, 2, 3, 3, -1]);
                match kind {
                    "retry" => node.with("attempts", n_rounds),
                    "repeat" => node.with("times", n_rounds),
                    _ => node,
                }
            }
            6 => {
                let is_usable = |subtree: &&SubtreeSpec| subtree.name != "Planner";
                let usable: Vec<String> = self.subtrees.iter().filter(is_usable).map(|subtree| subtree.name.clone()).collect();
                if usable.is_empty() {
                    self.scripted(scope)
                } else {
                    let used_idx = self.random.below(usable.len());
                    self.subtree_use(usable[used_idx].clone(), scope)
                }
            }
            _ if !leaves.is_empty() && self.random.one_in(6) => NodeSpec::new(self.random.pick(leaves)),
            _ => self.scripted(scope),
        };
        if self.random.one_in(4) { spec.title(self.title()) } else { spec }
    }

    /// Thresholds that a policy of `py_trees` can say: all children or one, and any failure is enough.
    fn thresholds(&mut self, node: NodeSpec) -> NodeSpec {
        match self.random.below(3) {
            0 => node,
            1 => node.with("success", -1).with("failure", 1),
            _ => node.with("success", 1).with("failure", 1),
        }
    }

    fn scripted(&mut self, scope: &mut Scope) -> NodeSpec {
        let node = NodeSpec::new("Scripted");
        if scope.is_main {
            let node = node.with("label", self.label());
            return if !scope.keys.is_empty() && self.random.one_in(2) {
                let key_idx = self.random.below(scope.keys.len());
                node.with_key("script", &*scope.keys[key_idx])
            } else {
                node.with("script", self.script())
            };
        }
        let port = |name: &str, default| SubtreePort { name: name.to_owned(), direction: Direction::In, default, location: 0 };
        let label_key = format!("label_{}", scope.ports.len());
        scope.ports.push(port(&label_key, None));
        let node = node.with_key("label", label_key);
        if self.random.one_in(2) {
            return node.with("script", self.script());
        }
        let script_key = format!("script_{}", scope.ports.len());
        let default = (self.family == Family::Defaults).then(|| Literal::Text(self.script()));
        scope.ports.push(port(&script_key, default));
        node.with_key("script", script_key)
    }

    fn subtree_use(&mut self, name: String, scope: &mut Scope) -> NodeSpec {
        let ports = self.subtrees.iter().find(|subtree| subtree.name == name).map(|subtree| subtree.ports.clone());
        let mut node = NodeSpec::subtree(name);
        for port in ports.unwrap_or_default() {
            let is_label = port.name.starts_with("label");
            if port.default.is_some() && self.random.one_in(2) {
                continue;
            }
            node = if scope.is_main && is_label {
                node.with(port.name, self.label())
            } else if scope.is_main {
                let n_keys = scope.keys.len();
                match self.random.below(n_keys + 2) {
                    key_idx if key_idx < n_keys => node.with_key(port.name, &*scope.keys[key_idx]),
                    _ => node.with(port.name, self.script()),
                }
            } else {
                // Handed on through another subtree, under another name.
                let kind = if is_label { "label" } else { "script" };
                let key = format!("{kind}_{}", scope.ports.len());
                scope.ports.push(SubtreePort { name: key.clone(), direction: Direction::In, default: None, location: 0 });
                node.with_key(port.name, key)
            };
        }
        node
    }
}

/// Results and events of ticks, and of a halt in between.
fn trace(spec: &TreeSpec, halt_idx: usize) -> Result<Vec<Value>, Box<dyn Error>> {
    let mut tree = registry().build(spec).map_err(|errors| errors[0].to_string())?;
    let (mut now_secs, mut steps) = (0.0, Vec::new());
    for step_idx in 0..N_STEPS {
        let mut events = Events::new();
        let (op, status) = if step_idx == halt_idx {
            tree.halt(&mut events);
            ("halt", Status::Idle)
        } else {
            ("tick", tree.tick(now_secs, &mut events))
        };
        now_secs += 1.0;
        steps.push(json!({ "op": op, "root": status.name(), "events": events }));
    }
    Ok(steps)
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut args = std::env::args().skip(1);
    let folder = args.next().ok_or("expected a folder, then a number of trees and a seed")?;
    let n_trees: usize = args.next().map_or(Ok(1000), |text| text.parse())?;
    let seed: u64 = args.next().map_or(Ok(1), |text| text.parse())?;
    let folder = Path::new(&folder);
    std::fs::create_dir_all(folder)?;
    let models = registry();
    let mut traces = Vec::new();
    for tree_idx in 0..n_trees {
        let mut random = Random(seed.wrapping_mul(1_000_003).wrapping_add(tree_idx as u64));
        let family = Family::of(tree_idx);
        // Half of the trees are halted midway, some of them while nothing runs.
        let halt_idx = random.below(2 * N_STEPS);
        let spec = Maker { random, family, n_labels: 0, n_titles: 0, subtrees: Vec::new() }.tree();
        let xml = export(&spec, models.models()).map_err(|problems| problems[0].to_string())?;
        let steps = trace(&spec, halt_idx)?;
        let imported = import(&xml, &ImportOptions::default()).map_err(|problems| problems[0].to_string())?;
        if trace(&imported.spec, halt_idx)? != steps {
            return Err(format!("tree {tree_idx} behaves differently once it was written and read").into());
        }
        let file = format!("{tree_idx:04}.xml");
        std::fs::write(folder.join(&file), xml)?;
        traces.push(json!({ "file": file, "family": family.name(), "steps": steps }));
    }
    std::fs::write(folder.join("traces.json"), serde_json::to_string_pretty(&traces)? + "\n")?;
    println!("{n_trees} trees from seed {seed} in {}", folder.display());
    Ok(())
}

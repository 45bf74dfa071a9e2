//! Traces recorded from BehaviorTree.CPP 4.10.0, read through the XML importer.
//!
//! Every case is run. Where this crate differs, a rule with a name says so, and the cases it holds for are counted:
//!
//! | rule | BehaviorTree.CPP | here |
//! |---|---|---|
//! | `error_becomes_failure` | an error leaves the tick; nodes stay RUNNING | the node fails with a reason; compared up to the error, afterwards a halt must leave every node idle |
//! | `refused_when_built` | the tree cannot be created | the importer or the builder refuses it |
//! | `no_rounds_of_zero` | `num_cycles="0"` succeeds and `num_attempts="0"` fails without a tick | refused when built |
//! | `skipped_is_idle` | a node that gave SKIPPED keeps the stored status RUNNING | it is idle; compared whole but for that status, or until the node is halted or called again there without a start |
//! | `no_stale_result` | a leaf that was not reset gives its last result again, and pre-conditions of a node that was not reset are not asked | it is started anew, and they are asked |
//! | `only_running_nodes_are_halted` | `_onHalted` also runs for idle nodes, and twice for running ones | once, for nodes that ran; compared without those halts, or until something asks for what their scripts wrote |
//! | `ended_nodes_have_idle_children` | IfThenElse and SequenceWithMemory leave the statuses of children that are done when they fail | they are idle; only those statuses differ, the case is compared whole |
//! | `precondition_asks_again` | the Precondition decorator does not ask again after a halt | it does |
//! | `halt_before_start` | a reactive node starts a child and then halts the one that ran | the same where actions say that they share nothing (compared here); otherwise the other way round (second test) |
#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "tests fail by panicking and say what they leave out")]

mod support;

use serde_json::Value;
use sfg_tree::xml::{ImportOptions, import};
use sfg_tree::{
    Action, Failure, Halt, Literal, NodeKind, NodeSpec, Outcome, PortSpec, Progress, Registry, Status, Tick, Tree, TreeSpec, When,
};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use support::Events;

/// Rules that a label of the record tells.
const LABELLED: [(&str, &str); 4] = [
    ("skipped_keeps_running", "skipped_is_idle"),
    ("stale_result", "no_stale_result"),
    ("onhalted_on_idle_node", "only_running_nodes_are_halted"),
    ("precondition_latch", "precondition_asks_again"),
];

/// A leaf that follows its script. A condition (`activations` joined) takes the next letter on every tick and is never reset.
struct Scripted {
    is_condition: bool,
    n_starts: usize,
    n_letters: usize,
}

impl Scripted {
    fn step(&mut self, tick: &mut Tick<'_, Events>, event: &str) -> Outcome {
        let (name, script) = (tick.get::<String>("name_")?, tick.get::<String>("script")?);
        tick.context.push(format!("{name} {event}"));
        let letters: Vec<char> = if self.is_condition {
            script.chars().filter(|letter| letter.is_ascii_alphabetic()).collect()
        } else {
            let activations: Vec<&str> = script.split('|').collect();
            let activation = activations[(self.n_starts - 1).min(activations.len() - 1)];
            activation.chars().filter(|letter| letter.is_ascii_alphabetic()).collect()
        };
        let letter = letters[self.n_letters.min(letters.len() - 1)];
        self.n_letters += 1;
        match letter {
            'R' => Ok(Progress::Running),
            'S' => Ok(Progress::Success),
            'K' => Ok(Progress::Skipped),
            'F' => Err(Failure::new("scripted", "")),
            _ => Err(Failure::new("error", "")),
        }
    }
}

impl Action<Events> for Scripted {
    fn start(&mut self, tick: &mut Tick<'_, Events>) -> Outcome {
        if self.is_condition {
            return self.step(tick, "tick");
        }
        self.n_starts += 1;
        self.n_letters = 0;
        self.step(tick, "start")
    }
    fn poll(&mut self, tick: &mut Tick<'_, Events>) -> Outcome {
        self.step(tick, "tick")
    }
    fn halt(&mut self, tick: &mut Tick<'_, Events>) -> Halt {
        if !self.is_condition {
            let name = tick.get::<String>("name_").unwrap();
            tick.context.push(format!("{name} halt"));
        }
        Halt::Done
    }
}

fn registry(parts: &[&'static str]) -> Registry<Events> {
    let mut registry = Registry::new();
    let ports = || [PortSpec::setting::<String>("name_"), PortSpec::setting::<String>("script")];
    registry
        .action("Scripted", ports(), || Scripted { is_condition: false, n_starts: 0, n_letters: 0 })
        .occupies(parts.iter().copied());
    let condition = || Scripted { is_condition: true, n_starts: 0, n_letters: 0 };
    registry.action("ScriptedCondition", ports(), condition).occupies(Vec::<String>::new());
    registry
}

/// Gives the scripted leaves their scripts.
fn complete(node: &mut NodeSpec, scripts: &Value) {
    if matches!(&node.kind, NodeKind::Named(name) if name.starts_with("Scripted")) {
        let name = node.title.clone().unwrap();
        let script = scripts.get(&name).and_then(Value::as_str).unwrap_or("S").to_owned();
        *node = std::mem::take(node).with("name_", name).with("script", script);
    }
    node.children.iter_mut().for_each(|child| complete(child, scripts));
}

fn spec_of(case: &Value) -> Result<TreeSpec, String> {
    let xml = case["xml"].as_str().unwrap();
    let mut spec = import(xml, &ImportOptions::default()).map_err(|problems| problems[0].to_string())?.spec;
    complete(&mut spec.root, &case["leaf_scripts"]);
    spec.subtrees.iter_mut().for_each(|subtree| complete(&mut subtree.root, &case["leaf_scripts"]));
    if let Some(init) = case.get("init").and_then(Value::as_object) {
        for (key, value) in init {
            let literal = match value {
                Value::String(text) => Literal::Text(text.clone()),
                value => Literal::Float(value.as_f64().unwrap()),
            };
            spec.entries.push((key.clone(), literal, 0));
        }
    }
    Ok(spec)
}

fn titles_of(tree: &Tree<Events>) -> Vec<(u32, String)> {
    tree.definition().map(|node| (node.id, node.title)).collect()
}

/// The first difference, if any; else how the case was compared. Under a rule, what the rule tells is left out of the comparison.
fn compare(case: &Value, tree: &mut Tree<Events>, rule: Option<&'static str>) -> Result<&'static str, String> {
    let titles = titles_of(tree);
    let mut compared = rule.unwrap_or("equal");
    let keeps_running = rule == Some("skipped_is_idle");
    let halts_idle = rule == Some("only_running_nodes_are_halted");
    // From here on a node that gave SKIPPED is RUNNING there: it is halted, or called again without a start.
    let mut has_skipped = false;
    // From here on the blackboards differ, as a script ran once more there.
    let mut has_written = false;
    let parents: BTreeMap<u32, (String, String)> = tree
        .definition()
        .filter_map(|node| {
            let parent = tree.definition().nth(node.parent? as usize)?;
            Some((node.id, (parent.kind, parent.title)))
        })
        .collect();
    for (step_idx, step) in case["steps"].as_array().unwrap().iter().enumerate() {
        let mut events = Events::new();
        let is_halt = step["op"] == "halt";
        let mut running: BTreeSet<String> =
            titles.iter().filter(|(id, _)| tree.status(*id) == Status::Running).map(|(_, title)| title.clone()).collect();
        let root = if is_halt {
            tree.halt(&mut events);
            tree.status(0)
        } else {
            tree.tick(f64::from(u32::try_from(step_idx).unwrap()), &mut events)
        };
        if step.get("error").is_some() {
            tree.halt(&mut events);
            let running: Vec<&String> =
                titles.iter().filter(|(id, _)| tree.status(*id) != Status::Idle).map(|(_, title)| title).collect();
            return if running.is_empty() {
                Ok("error_becomes_failure")
            } else {
                Err(format!("not idle after an error: {running:?}"))
            };
        }
        let expected: Vec<String> = step["events"]
            .as_array()
            .unwrap()
            .iter()
            .map(|event| (event[0].as_str().unwrap(), event[1].as_str().unwrap()))
            .filter(|(name, what)| {
                let was_running = if *what == "halt" { running.remove(*name) } else { running.insert((*name).to_owned()) };
                !halts_idle || *what != "halt" || was_running
            })
            .map(|(name, what)| format!("{name} {what}"))
            .collect();
        let skips = |event: &String| event.split_once(' ').is_some_and(|(name, _)| gives_skipped(&case["leaf_scripts"][name]));
        has_skipped |= expected.iter().any(skips);
        if keeps_running && has_skipped && (events != expected || root.name().to_uppercase() != step["root"].as_str().unwrap()) {
            return Ok("skipped_is_idle, until it shows in an event");
        }
        if has_written && events != expected {
            return Ok("only_running_nodes_are_halted, until what a script wrote is asked");
        }
        if events != expected {
            return Err(format!("step {step_idx}: events {events:?}, expected {expected:?}"));
        }
        if root.name().to_uppercase() != step["root"].as_str().unwrap() {
            return Err(format!("step {step_idx}: root {root}, expected {}", step["root"]));
        }
        for (id, title) in &titles {
            let expected = step["nodes"][title].as_str().ok_or_else(|| format!("no node {title:?} in the record"))?;
            if keeps_running && tree.status(*id) == Status::Idle && expected == "RUNNING" {
                continue;
            }
            if tree.status(*id) == Status::Idle
                && ["SUCCESS", "FAILURE"].contains(&expected)
                && parents.get(id).is_some_and(|(kind, parent)| {
                    kind == "sequence_with_memory" || (kind == "if_then_else" && step["nodes"][parent] != "RUNNING")
                })
            {
                compared = rule.unwrap_or("ended_nodes_have_idle_children");
                continue;
            }
            if tree.status(*id).name().to_uppercase() != expected {
                return Err(format!("step {step_idx}: {title} is {}, expected {expected}", tree.status(*id)));
            }
        }
        for (key, expected) in step.get("bb").and_then(Value::as_object).into_iter().flatten() {
            let found = match tree.literal(key) {
                #[allow(clippy::cast_precision_loss, reason = "small numbers")]
                Some(Literal::Int(number)) => Some(number as f64),
                Some(Literal::Float(number)) => Some(number),
                _ => None,
            };
            if found != expected.as_f64() {
                if halts_idle || keeps_running {
                    has_written = true;
                    continue;
                }
                return Err(format!("step {step_idx}: {key} is {found:?}, expected {expected}"));
            }
        }
    }
    Ok(compared)
}

fn gives_skipped(script: &Value) -> bool {
    script.as_str().is_some_and(|script| script.contains('K'))
}

fn folder() -> Option<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data/tree-traces");
    if folder.is_dir() {
        return Some(folder);
    }
    println!("passed over: {} is absent", folder.display());
    None
}

fn cases(folder: &Path) -> BTreeMap<String, Vec<Value>> {
    let files = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    files
        .filter(|path| path.extension().is_some_and(|extension| extension == "json"))
        .map(|path| {
            let family = path.file_stem().unwrap().to_string_lossy().into_owned();
            (family, serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap())
        })
        .collect()
}

fn labels(case: &Value) -> BTreeSet<&str> {
    case.get("quirks").and_then(Value::as_array).into_iter().flatten().filter_map(Value::as_str).collect()
}

/// The rule by which a case is not compared as it was recorded.
fn rule_of(case: &Value, built: &Result<Tree<Events>, String>) -> Option<&'static str> {
    let spec = spec_of(case);
    let xml = case["xml"].as_str().unwrap();
    if case.get("load_error").is_some() {
        assert!(built.is_err(), "{} is refused there and not here: {xml}", case["id"]);
        return Some("refused_when_built");
    }
    if xml.contains("num_cycles=\"0\"") || xml.contains("num_attempts=\"0\"") {
        assert!(built.is_err(), "{}: {xml}", case["id"]);
        return Some("no_rounds_of_zero");
    }
    if spec.is_ok_and(|spec| asks_a_guarded_child(&spec.root)) {
        return Some("no_stale_result");
    }
    LABELLED.iter().find(|(label, _)| labels(case).contains(label)).map(|(_, rule)| *rule)
}

/// Whether a node chooses by a first child that has pre-conditions: it is not reset between two questions.
fn asks_a_guarded_child(node: &NodeSpec) -> bool {
    let chooses = matches!(&node.kind, NodeKind::Named(name) if name == "if_then_else" || name == "while_do_else");
    let is_guarded = |child: &NodeSpec| child.conditions.iter().any(|condition| condition.when < When::While);
    (chooses && node.children.first().is_some_and(is_guarded)) || node.children.iter().any(asks_a_guarded_child)
}

#[test]
fn every_node_that_both_engines_have_gives_the_same_traces() {
    let Some(folder) = folder() else { return };
    let (mut differences, mut totals) = (Vec::new(), BTreeMap::<&str, u32>::new());
    for (family, cases) in cases(&folder) {
        let mut counts = BTreeMap::<&str, u32>::new();
        for case in &cases {
            let spec = spec_of(case);
            let built = spec.and_then(|spec| registry(&[]).build(&spec).map_err(|errors| errors[0].to_string()));
            let counted = match (rule_of(case, &built), built) {
                (rule @ (None | Some("skipped_is_idle" | "only_running_nodes_are_halted")), Ok(mut tree)) => {
                    compare(case, &mut tree, rule).unwrap_or_else(|difference| {
                        differences
                            .push(format!("{family} {}: {difference}\n  {} {}", case["id"], case["xml"], case["leaf_scripts"]));
                        "different"
                    })
                }
                (Some(rule), _) => rule,
                (None, Err(error)) => {
                    // An error that is found before the first tick.
                    let first_is_error = case["steps"][0].get("error").is_some();
                    if !first_is_error {
                        differences.push(format!("{family} {}: not built: {error}\n  {}", case["id"], case["xml"]));
                    }
                    "refused_when_built"
                }
            };
            *counts.entry(counted).or_default() += 1;
            *totals.entry(counted).or_default() += 1;
        }
        println!("{family}: {counts:?}");
    }
    println!("all: {totals:?}");
    assert!(
        differences.is_empty(),
        "{} differences:\n{}",
        differences.len(),
        differences[..differences.len().min(12)].join("\n")
    );
    let whole = ["equal", "ended_nodes_have_idle_children", "skipped_is_idle", "only_running_nodes_are_halted"];
    let n_whole: u32 = whole.iter().map(|how| totals[how]).sum();
    assert!(n_whole > 3_500, "only {n_whole} of 3978 cases are compared whole");
}

/// With actions that share something, none starts while another one that a reactive node replaces still runs.
#[test]
fn no_child_of_a_reactive_node_starts_while_another_runs() {
    let Some(folder) = folder() else { return };
    let mut n_compared = 0;
    for (family, cases) in cases(&folder) {
        let overlaps =
            |case: &&Value| labels(case).contains("reactive_overlap") && !case["xml"].as_str().unwrap().contains("Parallel");
        for case in cases.iter().filter(overlaps) {
            let mut tree = registry(&["arm"]).build(&spec_of(case).unwrap()).unwrap();
            let titles = titles_of(&tree);
            n_compared += 1;
            let is_leaf = |title: &str| case["leaf_scripts"].get(title).is_some();
            let mut running = BTreeSet::<String>::new();
            for (step_idx, step) in case["steps"].as_array().unwrap().iter().enumerate() {
                let mut events = Events::new();
                if step["op"] == "halt" {
                    tree.halt(&mut events);
                } else {
                    tree.tick(f64::from(u32::try_from(step_idx).unwrap()), &mut events);
                }
                for event in &events {
                    let (name, what) = event.split_once(' ').unwrap();
                    // A call may be the last of an activation: only what was not called in this tick surely still runs.
                    if what == "start" {
                        let overlapping: Vec<&String> = running.iter().filter(|other| *other != name).collect();
                        assert!(
                            overlapping.is_empty(),
                            "{family} {} step {step_idx}: {name} starts while {overlapping:?} run",
                            case["id"]
                        );
                    }
                    running.remove(name);
                }
                running = titles
                    .iter()
                    .filter(|(id, title)| is_leaf(title) && tree.status(*id) == Status::Running)
                    .map(|(_, title)| title.clone())
                    .collect();
            }
        }
    }
    println!("{n_compared} cases in which BehaviorTree.CPP starts the new child first");
    assert!(n_compared > 80);
}

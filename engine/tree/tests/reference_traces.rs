//! Traces recorded from BehaviorTree.CPP 4.10, for the rules that both engines share.
//!
//! Left out by rule: labelled quirks of that library, exceptions, nodes that this crate does not have, thresholds and counts
//! that it refuses, and reactive nodes, where this crate halts the running child before it starts another.
#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "tests fail by panicking and say what they leave out")]

mod support;

use serde_json::Value;
use sfg_tree::{Action, Failure, Halt, NodeSpec, Outcome, PortSpec, Progress, Registry, Tick, TreeSpec};
use std::path::Path;
use support::{Events, letter};

const FAMILIES: [&str; 7] = ["sequence", "fallback", "parallel", "inverter_force", "retry", "repeat", "nested"];

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
            _ => Err(Failure::new("scripted", "")),
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
        let name = tick.get::<String>("name_").unwrap();
        tick.context.push(format!("{name} halt"));
        Halt::Done
    }
}

fn registry() -> Registry<Events> {
    let mut registry = Registry::new();
    let ports = || [PortSpec::setting::<String>("name_"), PortSpec::setting::<String>("script")];
    registry.action("scripted", ports(), || Scripted { is_condition: false, n_starts: 0, n_letters: 0 });
    registry.action("scripted_condition", ports(), || Scripted { is_condition: true, n_starts: 0, n_letters: 0 });
    registry
}

/// The tree of a case, or the rule by which it is left out.
fn convert(xml: &str, scripts: &Value) -> Result<NodeSpec, String> {
    let body = xml.split_once("<BehaviorTree ID=\"Main\">").ok_or("no main tree")?.1;
    let body = body.split_once("</BehaviorTree>").ok_or("no main tree")?.0;
    let mut open: Vec<NodeSpec> = Vec::new();
    for tag in body.split('<').skip(1) {
        let tag = tag.trim_end().strip_suffix('>').ok_or("text in the tree")?;
        let is_end = tag.starts_with('/');
        if !is_end {
            let words = tag.trim_end_matches('/');
            open.push(node(words, scripts)?);
        }
        if is_end || tag.ends_with('/') {
            let done = open.pop().ok_or("unbalanced")?;
            match open.last_mut() {
                Some(parent) => parent.children.push(done),
                None => return Ok(done),
            }
        }
    }
    Err("unbalanced".to_owned())
}

fn node(tag: &str, scripts: &Value) -> Result<NodeSpec, String> {
    let (kind, mut rest) = tag.split_once(' ').ok_or("a node without name")?;
    let mut attributes = Vec::new();
    while let Some((key, after)) = rest.trim_start().split_once("=\"") {
        let (value, after) = after.split_once('"').ok_or("no end of attribute")?;
        attributes.push((key, value));
        rest = after;
    }
    let kind = match kind {
        "Sequence" => "sequence",
        "Fallback" => "fallback",
        "Parallel" => "parallel",
        "Inverter" => "inverter",
        "ForceSuccess" => "force_success",
        "ForceFailure" => "force_failure",
        "RetryUntilSuccessful" => "retry",
        "Repeat" => "repeat",
        "Scripted" => "scripted",
        "ScriptedCondition" => "scripted_condition",
        other => return Err(format!("node {other}")),
    };
    let mut spec = NodeSpec::new(kind);
    for (key, value) in attributes {
        let number = value.parse::<i64>();
        spec = match (key, number) {
            ("name", _) => {
                spec.title = Some(value.to_owned());
                if kind.starts_with("scripted") {
                    let script = scripts.get(value).and_then(Value::as_str).ok_or("no script")?;
                    if script.contains(['X', 'I']) {
                        return Err("exception".to_owned());
                    }
                    spec = spec.with("name_", value).with("script", script);
                }
                spec
            }
            ("num_attempts", Ok(n)) if n >= 1 => spec.with("attempts", n),
            ("num_cycles", Ok(-1)) | ("success_count", Ok(-1)) => spec,
            ("num_cycles", Ok(n)) if n >= 1 => spec.with("times", n),
            ("success_count", Ok(n)) if n >= 1 => spec.with("success", n),
            ("failure_count", Ok(n)) if n >= 1 => spec.with("failure", n),
            (key, _) => return Err(format!("{key}={value}")),
        };
    }
    Ok(spec)
}

/// The first difference, if any.
fn compare(case: &Value, spec: NodeSpec) -> Result<(), String> {
    let mut tree = registry().build(&TreeSpec::new(spec)).map_err(|errors| format!("not built: {}", errors[0]))?;
    for (step_idx, step) in case["steps"].as_array().unwrap().iter().enumerate() {
        let mut events = Events::new();
        let is_halt = step["op"] == "halt";
        let root = if is_halt {
            tree.halt(&mut events);
            tree.status(0)
        } else {
            tree.tick(0.0, &mut events)
        };
        let expected: Vec<String> = step["events"]
            .as_array()
            .unwrap()
            .iter()
            .map(|event| format!("{} {}", event[0].as_str().unwrap(), event[1].as_str().unwrap()))
            .collect();
        if events != expected {
            return Err(format!("step {step_idx}: events {events:?}, expected {expected:?}"));
        }
        if root.name().to_uppercase() != step["root"].as_str().unwrap() {
            return Err(format!("step {step_idx}: root {root}, expected {}", step["root"]));
        }
        for node in tree.definition() {
            let expected = step["nodes"][&node.title].as_str().unwrap();
            if tree.status(node.id).name().to_uppercase() != expected {
                return Err(format!("step {step_idx}: {} is {}, expected {expected}", node.title, letter(tree.status(node.id))));
            }
        }
    }
    Ok(())
}

#[test]
fn shared_rules_give_the_same_traces() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data/tree-traces");
    if !folder.is_dir() {
        println!("passed over: {} is absent", folder.display());
        return;
    }
    let mut differences = Vec::new();
    for family in FAMILIES {
        let text = std::fs::read_to_string(folder.join(format!("{family}.json"))).unwrap();
        let cases: Value = serde_json::from_str(&text).unwrap();
        let (mut n_equal, mut n_left_out) = (0, std::collections::BTreeMap::<String, u32>::new());
        for case in cases.as_array().unwrap() {
            let has_error = case.get("load_error").is_some()
                || case["steps"].as_array().unwrap().iter().any(|step| step.get("error").is_some());
            let has_quirk = case.get("quirks").is_some_and(|quirks| !quirks.as_array().unwrap().is_empty());
            let spec = if has_error {
                Err("exception".to_owned())
            } else if has_quirk {
                Err("quirk".to_owned())
            } else {
                convert(case["xml"].as_str().unwrap(), &case["leaf_scripts"])
            };
            match spec {
                Err(rule) => *n_left_out.entry(rule).or_default() += 1,
                Ok(spec) => match compare(case, spec) {
                    Ok(()) => n_equal += 1,
                    Err(difference) => differences.push(format!("{family} {}: {difference}\n  {}", case["id"], case["xml"])),
                },
            }
        }
        println!("{family}: {n_equal} equal, left out {n_left_out:?}");
        assert!(n_equal > 0, "no case of {family} was compared");
    }
    assert!(differences.is_empty(), "{} differences:\n{}", differences.len(), differences[..differences.len().min(8)].join("\n"));
}

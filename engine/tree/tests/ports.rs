//! Ports: what is checked when a tree is built, and how values travel.
#![allow(clippy::unwrap_used, clippy::float_cmp, reason = "tests fail by panicking; the numbers are copied, not computed")]

use sfg_tree::{
    Change, Direction, EntryError, Failure, JournalLevel, NodeSpec, PortSpec, Registry, Shape, Status, SubtreePort, SubtreeSpec,
    TreeSpec,
};
use std::sync::Arc;

/// A value that cannot be copied.
#[derive(Debug)]
struct Cloud(Vec<f32>);
#[derive(Clone, Debug, PartialEq)]
struct Side(&'static str);

fn registry() -> Registry<Vec<String>> {
    let mut registry = Registry::<Vec<String>>::new();
    registry.step("scan", [PortSpec::output::<Cloud>("cloud")], |tick| {
        tick.set("cloud", Cloud(vec![1.0; 3]));
        Ok(())
    });
    registry.step("count", [PortSpec::input::<Cloud>("cloud"), PortSpec::output::<u32>("n_points")], |tick| {
        let n_points = u32::try_from(tick.input::<Cloud>("cloud")?.0.len()).unwrap();
        tick.set("n_points", n_points);
        Ok(())
    });
    registry.step("add", [PortSpec::inout::<u32>("n_points"), PortSpec::setting::<u32>("more").default_value(1)], |tick| {
        let n_points = tick.get::<u32>("n_points")? + tick.get::<u32>("more")?;
        tick.set("n_points", n_points);
        Ok(())
    });
    let side = |literal: &sfg_tree::Literal| match literal {
        sfg_tree::Literal::Text(text) if text == "left" => Ok(Side("left")),
        other => Err(format!("expected left, found {other}")),
    };
    registry.step("turn", [PortSpec::setting_with::<Side>("side", Shape::OneOf(vec!["left".to_owned()]), side)], |tick| {
        let side = tick.get::<Side>("side")?;
        tick.context.push(format!("turn {}", side.0));
        Ok(())
    });
    registry.step(
        "say",
        [PortSpec::input::<u32>("n_points").optional(), PortSpec::setting::<String>("text").optional()],
        |tick| {
            let n_points = tick.optional::<u32>("n_points")?;
            let text = tick.optional::<String>("text")?;
            tick.context.push(format!("{n_points:?} {text:?}"));
            Ok(())
        },
    );
    registry.condition("is_large", [PortSpec::input::<u32>("n_points"), PortSpec::setting::<u32>("least")], |tick| {
        Ok(tick.get::<u32>("n_points")? >= tick.get::<u32>("least")?)
    });
    registry.field::<Cloud, u32>("size", |cloud| {
        u32::try_from(cloud.0.len()).map_err(|error| Failure::new("too_large", error.to_string()))
    });
    registry.entry::<u32>("given");
    registry
}

fn sequence(children: impl IntoIterator<Item = NodeSpec>) -> NodeSpec {
    NodeSpec::new("sequence").children(children)
}

#[track_caller]
fn check_errors(spec: &TreeSpec, expected: &[&str]) {
    let errors = registry().build(spec).expect_err("the tree is accepted");
    let found: Vec<String> = errors
        .iter()
        .map(|error| match &error.help {
            Some(help) => format!("{error} | {help}"),
            None => error.to_string(),
        })
        .collect();
    assert_eq!(found, expected);
}

#[track_caller]
fn check_runs(spec: &TreeSpec, expected: &[&str]) {
    let mut tree = registry().build(spec).unwrap();
    let mut said = Vec::new();
    assert_eq!(tree.tick(0.0, &mut said), Status::Success, "{:?}", tree.failure());
    assert_eq!(said, expected);
}

#[test]
fn artefacts_flow_by_the_names_of_their_ports() {
    let spec = TreeSpec::new(sequence(["scan", "count", "add", "say"].map(NodeSpec::new)));
    check_runs(&spec, &["Some(4) None"]);
}

#[test]
fn keys_and_literals_can_be_given() {
    let spec = TreeSpec::new(sequence([
        NodeSpec::new("scan").with_key("cloud", "first"),
        NodeSpec::new("count").with_key("cloud", "first").with_key("n_points", "n"),
        NodeSpec::new("add").with_key("n_points", "n").with("more", 10),
        NodeSpec::new("say").with_key("n_points", "n").with("text", "points"),
        NodeSpec::new("turn").with("side", "left"),
    ]));
    check_runs(&spec, &["Some(13) Some(\"points\")", "turn left"]);
}

#[test]
fn fields_can_be_read() {
    let spec = TreeSpec::new(sequence([NodeSpec::new("scan"), NodeSpec::new("say").with_key("n_points", "cloud.size")]));
    check_runs(&spec, &["Some(3) None"]);
}

#[test]
fn large_values_are_shared() {
    let mut registry = registry();
    registry.step("pass", [PortSpec::input::<Cloud>("cloud"), PortSpec::output::<Cloud>("copy")], |tick| {
        let cloud = tick.input::<Cloud>("cloud")?;
        tick.set_shared("copy", cloud);
        Ok(())
    });
    let mut tree = registry.build(&TreeSpec::new(sequence(["scan", "pass"].map(NodeSpec::new)))).unwrap();
    assert_eq!(tree.tick(0.0, &mut Vec::new()), Status::Success);
    assert!(Arc::ptr_eq(&tree.entry::<Cloud>("cloud").unwrap(), &tree.entry::<Cloud>("copy").unwrap()));
}

#[test]
fn entries_come_from_the_application() {
    let mut tree = registry().build(&TreeSpec::new(NodeSpec::new("say").with_key("n_points", "given"))).unwrap();
    tree.set_entry("given", 5_u32).unwrap();
    tree.set_entry("nobody_asks", 5_u32).unwrap();
    assert!(matches!(tree.set_entry("given", 5_u64), Err(EntryError::Type { .. })));
    let mut said = Vec::new();
    tree.tick(0.0, &mut said);
    assert_eq!(said, ["Some(5) None"]);
}

#[test]
fn an_entry_that_the_application_forgot_is_a_failure_with_a_reason() {
    let spec = TreeSpec::new(NodeSpec::new("is_large").with_key("n_points", "given").with("least", 2));
    let mut tree = registry().build(&spec).unwrap();
    assert_eq!(tree.tick(0.0, &mut Vec::new()), Status::Failure);
    let failure = &tree.failure().unwrap().failure;
    assert_eq!(failure.to_string(), "port_empty: port \"n_points\" has no value yet");
}

#[test]
fn entries_can_begin_with_literals() {
    let spec = TreeSpec::new(NodeSpec::new("is_large").with_key("n_points", "given").with_key("least", "least"));
    let spec = spec.entry("least", 3);
    let mut tree = registry().build(&spec).unwrap();
    tree.set_entry("given", 3_u32).unwrap();
    assert_eq!(tree.tick(0.0, &mut Vec::new()), Status::Success);
    check_errors(&spec.entry("least", "three"), &["least: port \"least\": expected a whole number, found \"three\""]);
}

#[test]
fn undeclared_ports_are_bugs_that_become_failures() {
    let mut registry = registry();
    registry.step("wrong", [PortSpec::output::<u32>("a")], |tick| {
        tick.set("b", 1_u32);
        Ok(())
    });
    let mut tree = registry.build(&TreeSpec::new(NodeSpec::new("wrong"))).unwrap();
    assert_eq!(tree.tick(0.0, &mut Vec::new()), Status::Failure);
    assert_eq!(tree.failure().unwrap().failure.to_string(), "panicked: port \"b\" is not declared");
}

#[test]
fn all_mistakes_at_once() {
    check_errors(
        &TreeSpec::new(sequence([
            NodeSpec::new("scn"),
            NodeSpec::new("is_large").with("least", "many").with_key("n_points", "count"),
            NodeSpec::new("turn").with("sid", "left"),
            NodeSpec::new("retry").with("attempts", 0),
        ])),
        &[
            "sequence/scn: unknown node \"scn\" | did you mean \"scan\"?",
            "sequence/is_large: port \"least\": expected a whole number, found \"many\"",
            "sequence/turn: \"turn\" has no port \"sid\" | did you mean \"side\"?",
            "sequence/turn: \"turn\" needs port \"side\": one of left",
            "sequence/retry: \"retry\" takes exactly one child, found 0",
            "sequence/retry: port \"attempts\": expected at least 1, or -1 for no end, found 0 | How often the child is tried; -1 without end.",
            "sequence/is_large: port \"n_points\" reads blackboard key \"count\", which no earlier node writes",
        ],
    );
}

#[test]
fn writer_and_reader_must_agree() {
    check_errors(
        &TreeSpec::new(sequence([NodeSpec::new("scan"), NodeSpec::new("add").with_key("n_points", "cloud")])),
        &["sequence/add: port \"n_points\" uses blackboard key \"cloud\" as u32, but sequence/scan writes it as Cloud"],
    );
    check_errors(
        &TreeSpec::new(NodeSpec::new("count").with_key("cloud", "given")),
        &["count: port \"cloud\" uses blackboard key \"given\" as Cloud, but the application provides it as u32"],
    );
    check_errors(
        &TreeSpec::new(sequence([NodeSpec::new("scan"), NodeSpec::new("count").with_key("cloud", "cloud.size")])),
        &["sequence/count: port \"cloud\" uses blackboard key \"cloud.size\" as Cloud, but the field provides it as u32"],
    );
}

#[test]
fn a_key_must_be_written_before_it_is_read() {
    check_errors(
        &TreeSpec::new(sequence(["count", "scan"].map(NodeSpec::new))),
        &[
            "sequence/count: port \"cloud\" reads blackboard key \"cloud\", which no earlier node writes | it is written later, by sequence/scan",
        ],
    );
    check_errors(
        &TreeSpec::new(NodeSpec::new("add")),
        &["add: port \"n_points\" reads blackboard key \"n_points\", which no earlier node writes"],
    );
}

#[test]
fn outputs_need_keys() {
    check_errors(
        &TreeSpec::new(NodeSpec::new("scan").with("cloud", 3)),
        &["scan: port \"cloud\" is written by the node and needs a blackboard key such as \"{cloud}\""],
    );
}

fn subtree(name: &str, ports: &[(&str, Direction)], root: NodeSpec) -> SubtreeSpec {
    let ports = ports
        .iter()
        .map(|(name, direction)| SubtreePort { name: (*name).to_owned(), direction: *direction, default: None, location: 0 })
        .collect();
    SubtreeSpec { name: name.to_owned(), ports, is_open: false, root, location: 0 }
}

#[test]
fn subtrees_see_their_ports_only() {
    let counting = sequence(["count", "add"].map(NodeSpec::new));
    let open = subtree("counting", &[("cloud", Direction::In), ("n_points", Direction::Out)], counting.clone());
    let use_it = sequence([NodeSpec::new("scan"), NodeSpec::subtree("counting"), NodeSpec::new("say")]);
    check_runs(&TreeSpec::new(use_it.clone()).subtree(open), &["Some(4) None"]);
    // Not declared as an output: the key inside is another one than the key outside.
    let silent = subtree("counting", &[("cloud", Direction::In)], counting.clone());
    check_runs(&TreeSpec::new(use_it.clone()).subtree(silent), &["None None"]);
    check_errors(
        &TreeSpec::new(use_it).subtree(subtree("counting", &[], counting)),
        &[
            "sequence/counting/sequence/count: port \"cloud\" reads blackboard key \"cloud\", which no earlier node writes | a subtree has its own keys; declare \"cloud\" under its `in`",
        ],
    );
}

#[test]
fn ports_of_subtrees_can_be_given_other_keys_and_values() {
    let body = NodeSpec::new("is_large").with_key("least", "limit");
    let large = || subtree("large", &[("n_points", Direction::In), ("limit", Direction::In)], body.clone());
    let spec = |limit: u32| {
        TreeSpec::new(sequence([
            NodeSpec::new("scan"),
            NodeSpec::new("count").with_key("n_points", "n"),
            NodeSpec::subtree("large").with_key("n_points", "n").with("limit", limit),
        ]))
        .subtree(large())
    };
    check_runs(&spec(3), &[]);
    let mut tree = registry().build(&spec(4)).unwrap();
    assert_eq!(tree.tick(0.0, &mut Vec::new()), Status::Failure);
    assert_eq!(tree.path(tree.failure().unwrap().node), "sequence/large/is_large");
}

#[test]
fn a_subtree_writes_only_its_outputs() {
    let root = sequence([NodeSpec::new("add")]);
    check_errors(
        &TreeSpec::new(NodeSpec::subtree("adding").with_key("n_points", "given")).subtree(subtree(
            "adding",
            &[("n_points", Direction::In)],
            root,
        )),
        &[
            "adding/sequence/add: port \"n_points\" writes blackboard key \"n_points\", which the subtree declares as an input | declare it under `out` or `inout`, or write another key",
        ],
    );
}

#[test]
fn subtrees_that_cannot_be_unfolded() {
    let spec = TreeSpec::new(NodeSpec::subtree("a")).subtree(subtree("a", &[], NodeSpec::subtree("b"))).subtree(subtree(
        "b",
        &[],
        NodeSpec::subtree("a"),
    ));
    check_errors(&spec, &["a/b/a: subtree \"a\" contains itself: a -> b -> a"]);
    // Ten levels of ten uses each.
    let mut spec = TreeSpec::new(NodeSpec::subtree("t0"));
    for level in 0..10 {
        let uses = sequence((0..10).map(|_| NodeSpec::subtree(format!("t{}", level + 1))));
        spec = spec.subtree(subtree(&format!("t{level}"), &[], uses));
    }
    let spec = spec.subtree(subtree("t10", &[], NodeSpec::new("say")));
    let errors = registry().build(&spec).unwrap_err();
    assert_eq!(errors[0].problem.to_string(), "the tree has more than 1000000 nodes once its subtrees are unfolded");
    let mut deep = NodeSpec::new("say");
    for _ in 0..1_000 {
        deep = NodeSpec::new("inverter").child(deep);
    }
    let errors = registry().build(&TreeSpec::new(deep)).unwrap_err();
    assert_eq!(errors[0].problem.to_string(), "the tree is nested deeper than 256 nodes");
}

#[test]
fn unused_subtrees_are_checked_too() {
    let spec = TreeSpec::new(NodeSpec::new("say"));
    check_errors(
        &spec.clone().subtree(subtree("later", &[("cloud", Direction::In)], sequence(["count", "cuont"].map(NodeSpec::new)))),
        &["sequence/cuont: unknown node \"cuont\" | did you mean \"count\"?"],
    );
    let spec = spec.subtree(subtree("later", &[("cloud", Direction::In)], NodeSpec::new("count")));
    assert_eq!(registry().build(&spec).unwrap().n_nodes(), 1);
}

#[test]
fn the_journal_tells_what_happened() {
    let mut tree =
        registry().build(&TreeSpec::new(sequence([NodeSpec::new("scan"), NodeSpec::new("turn").with("side", "left")]))).unwrap();
    tree.set_journal_level(JournalLevel::Writes);
    tree.tick(2.5, &mut Vec::new());
    let told: Vec<String> = tree
        .drain_journal()
        .into_iter()
        .map(|record| {
            assert_eq!((record.tick_idx, record.now_secs), (1, 2.5));
            let what = match record.change {
                Change::Status { from, to } => format!("{from} -> {to}"),
                Change::Failed(failure) => failure.to_string(),
                Change::Write { slot, .. } => format!("writes {}", tree.slot_key(slot).unwrap()),
                Change::Ticked | Change::HaltAsked | Change::Forced(_) | Change::Postponed { .. } => "a step".to_owned(),
            };
            format!("{}: {what}", tree.path(record.node))
        })
        .collect();
    assert_eq!(
        told,
        [
            "sequence: idle -> running",
            "sequence/scan: writes cloud",
            "sequence/scan: idle -> success",
            "sequence/turn: idle -> success",
            "sequence/scan: success -> idle",
            "sequence/turn: success -> idle",
            "sequence: running -> success",
            "sequence: success -> idle",
        ]
    );
    assert!(tree.drain_journal().is_empty());
}

#[test]
fn the_same_inputs_give_the_same_journal() {
    let journal = || {
        let spec = TreeSpec::new(NodeSpec::new("retry").with("attempts", 3).child(sequence([
            NodeSpec::new("scan"),
            NodeSpec::new("count"),
            NodeSpec::new("is_large").with("least", 9),
        ])));
        let mut tree = registry().build(&spec).unwrap();
        tree.set_journal_level(JournalLevel::Writes);
        for tick in 0..5 {
            tree.tick(f64::from(tick), &mut Vec::new());
        }
        tree.drain_journal()
    };
    assert_eq!(journal(), journal());
    assert!(journal().len() > 30);
}

//! Reasons that a node waits for and nothing below it gives.
#![allow(clippy::unwrap_used, reason = "tests fail by panicking")]

mod support;

use sfg_scenario::{Scenario, Settings};
use std::path::Path;
use support::{VALID, registry, vocabulary};

/// Line, column, message and help of each warning of a scenario whose tree is `tree`.
fn warnings(tree: &str) -> Vec<String> {
    let mut registry = registry();
    registry.step("grasp", [], |_| Ok(())).fails_with(["lift_failed"]);
    registry.step("hold", [], |_| Ok(())).fails_with(Vec::<&str>::new());
    let before = VALID.split("\ntree:").next().unwrap();
    let text = format!("{before}\n{tree}\nsuccess: {{truth: [{{still_held: {{object: bottle, within_m: 0.05}}}}]}}\n");
    let scenario = Scenario::parse(Path::new("test.yaml"), text, &Settings::default(), &registry, &vocabulary())
        .unwrap_or_else(|e| panic!("{e}"));
    let first_line = before.lines().count();
    let list = scenario.warnings.list().iter();
    list.map(|m| {
        format!(
            "{}:{} {} | {}",
            m.place.line as usize - first_line,
            m.place.column,
            m.message,
            m.help.clone().unwrap_or_default()
        )
    })
    .collect()
}

#[test]
fn a_reason_that_no_skill_below_gives_is_a_warning_where_it_stands() {
    let tree = "tree:\n  retry:\n    attempts: 2\n    on: [lift_failed, slipped, timeout]\n    do: {sequence: [hold, {subtree: again}]}\nsubtrees:\n  again: {do: grasp}";
    assert_eq!(warnings(tree), ["4:23 \"retry\" waits for \"slipped\", which nothing below it fails for | remove it"]);
    // What a recovery fails for is no reason of what it recovers from.
    let tree = "tree:\n  recover:\n    attempts: 2\n    on: [lift_failed, any]\n    do: [hold, grasp, hold]";
    assert_eq!(warnings(tree), ["4:10 \"recover\" waits for \"lift_failed\", which nothing below it fails for | remove it"]);
}

#[test]
fn where_a_skill_does_not_say_its_reasons_nothing_is_said() {
    let tree = "tree:\n  retry:\n    attempts: 2\n    on: [slipped]\n    do: {sequence: [grasp, observe_scene]}";
    assert_eq!(warnings(tree), Vec::<String>::new());
}

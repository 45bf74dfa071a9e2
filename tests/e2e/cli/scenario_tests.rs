//! `sfg test`: the shipped cases, cases that fail, and files with mistakes.

use crate::{folder, repository, sfg, text};
use std::fs;

const POUR: &str = include_str!("../../../scenarios/tests/01_pour.test.yaml");

/// The shipped cases with `to` for `from`, beside the shipped scenario.
#[track_caller]
fn changed(from: &str, to: &str) -> String {
    assert_eq!(POUR.matches(from).count(), 1, "{from:?} is not once in the tests");
    let scenario = repository("scenarios/01_pour.yaml");
    POUR.replace(from, to).replace("scenario: ../01_pour.yaml", &format!("scenario: {}", text(&scenario)))
}

#[test]
fn the_shipped_cases_hold() {
    let tests = repository("scenarios/tests/01_pour.test.yaml");
    let said = sfg(folder().path(), &["test", text(&tests)]).ended_with(0).stdout;
    let n_ok = said.lines().filter(|line| line.starts_with("ok      ")).count();
    assert!(n_ok >= 6 && said.ends_with(&format!("{n_ok} cases, all ok\n")), "{said}");
}

#[test]
fn a_case_that_does_not_hold_is_named_with_what_was_found() {
    let folder = folder();
    let check = |from: &str, to: &str, words: &[&str]| {
        fs::write(folder.path().join("a.test.yaml"), changed(from, to)).unwrap();
        let said = sfg(folder.path(), &["test", "a.test.yaml"]).ended_with(7).stdout;
        for word in words {
            assert!(said.contains(word), "{word:?} is not in:\n{said}");
        }
        assert!(said.ends_with("11 cases: 10 ok, 1 FAILED\n"), "{said}");
    };
    let name = "FAILED  it gives up after three attempts (a.test.yaml:34)";
    check("reason: grasp_empty", "reason: slipped", &[name, "reason: expected slipped, found failure: grasp_empty at "]);
    check(
        "calls: {ready: 3, verify_grasp: 3",
        "calls: {ready: 4, verify_grasp: 3",
        &[name, "calls of ready: expected 4, found 3"],
    );
    let traced = ["FAILED  a question is asked once", "trace, item 4: expected lift, found infer_functionality failure"];
    let trace = "list_scene success, infer_functionality failure]";
    check(
        trace,
        "list_scene success, lift]",
        &[&traced[..], &["the whole trace: [ready success, observe_scene success"]].concat(),
    );
}

#[test]
fn several_files_are_one_summary_and_one_bad_file_refuses_all() {
    let folder = folder();
    let tests = repository("scenarios/tests/01_pour.test.yaml");
    let said = sfg(folder.path(), &["test", text(&tests), text(&tests)]).ended_with(0).stdout;
    assert!(said.ends_with("22 cases, all ok\n"), "{said}");
    let ended = sfg(folder.path(), &["test", text(&tests), "nowhere.yaml"]);
    ended.refused(2, &["cannot read \"nowhere.yaml\""]);
    assert_eq!(ended.stdout, "");
}

#[test]
fn mistakes_have_a_place_and_the_nearest_word() {
    let folder = folder();
    let check = |from: &str, to: &str, words: &[&str]| {
        fs::write(folder.path().join("a.test.yaml"), changed(from, to)).unwrap();
        sfg(folder.path(), &["test", "a.test.yaml"]).refused(2, words);
    };
    check(
        "      lift: [{fails",
        "      lft: [{fails",
        &["the tree has no leaf \"lft\"", "did you mean \"lift\"?", "a.test.yaml:20:7"],
    );
    check("      lift: [{fails", "      move_joints: [{fails", &["\"move_joints\" can never run: it is not in the tree"]);
    check(
        "reason: grasp_empty",
        "reason: grasp_emty",
        &["unknown failure reason \"grasp_emty\"", "did you mean \"grasp_empty\"?"],
    );
    check("node: sequence/pour", "node: sequence/por", &["the tree has no node", "did you mean \"sequence/pour\"?"]);
    check("until_secs: 60", "until_secs: long", &["until_secs: expected a number, found \"long\""]);
    let ended = |cases: &str| {
        let scenario = repository("scenarios/01_pour.yaml");
        fs::write(folder.path().join("a.test.yaml"), format!("scenario: {}\n{cases}", text(&scenario))).unwrap();
        sfg(folder.path(), &["test", "a.test.yaml"])
    };
    ended("cases: []\n").refused(2, &["there are no cases", "a.test.yaml:2:8"]);
    ended("").refused(2, &["test file needs key \"cases\""]);
    ended("cases: [{name: a, expect: {}}]\n").refused(2, &["the case expects nothing"]);
    sfg(folder.path(), &["test"]).ended_with(2);
}

#[test]
fn mistakes_of_the_scenario_are_told_with_its_file() {
    let folder = folder();
    let scenario = fs::read_to_string(repository("scenarios/01_pour.yaml")).unwrap();
    fs::write(folder.path().join("01_pour.yaml"), scenario.replace("- list_scene", "- list_scen")).unwrap();
    fs::create_dir(folder.path().join("tests")).unwrap();
    fs::write(folder.path().join("tests/a.test.yaml"), POUR).unwrap();
    let words = ["unknown node \"list_scen\"", "did you mean \"list_scene\"?", "01_pour.yaml:34:11"];
    sfg(folder.path(), &["test", "tests/a.test.yaml"]).refused(2, &words);
}

#[test]
fn the_schema_of_tests_is_the_one_the_program_prints() {
    let printed = sfg(folder().path(), &["schema", "--tests"]).ended_with(0).stdout;
    let committed = fs::read_to_string(repository("scenarios").join("test.schema.json")).unwrap_or_default();
    assert_eq!(
        printed, committed,
        "scenarios/test.schema.json is stale; refresh it: cargo run -p sfg-app -- schema --tests > scenarios/test.schema.json"
    );
}

//! Parameters, included files and explanations, as the command offers them.

use crate::{folder, read_json, repository, sfg, text};
use std::fs;

const TWO_MOVES: &str = include_str!("../scenarios/two_moves.yaml");
const MOVES: &str = include_str!("../scenarios/parts/moves.yaml");

#[test]
fn a_parameter_is_set_on_the_command_line() {
    let folder = folder();
    let scenario = repository("tests/e2e/scenarios/two_moves.yaml");
    sfg(folder.path(), &["check", text(&scenario), "--set", "speed=0.2"]).ended_with(0);
    let check = |set: &str, words: &[&str]| sfg(folder.path(), &["check", text(&scenario), "--set", set]).refused(2, words);
    check("speed=2", &["port \"speed\": expected 0.01 to 1, found 2", "moves.yaml:14:"]);
    check("sped=1", &["--set sped: the scenario has no parameter \"sped\"", "did you mean \"speed\"?"]);
    check("speed", &["--set \"speed\" is no assignment; write NAME=VALUE"]);
    check("thing=boll", &["unknown object model \"boll\"", "did you mean \"ball\"?", "two_moves.yaml:10:"]);
    let ended =
        sfg(folder.path(), &["run", text(&scenario), "--set", "thing=box", "--set", "speed=0.6", "--out", "out"]).ended_with(0);
    assert!(ended.stdout.contains("Bend the elbow past the box and stretch it again."), "{ended:#?}");
    let plain = sfg(folder.path(), &["run", text(&scenario), "--out", "plain"]).ended_with(0);
    let report = |name: &str| read_json(&folder.path().join(name).join("report.json"));
    assert_ne!(report("out")["scenario_sha256"], report("plain")["scenario_sha256"], "{plain:#?}");
}

#[test]
fn a_sweep_remembers_its_parameters() {
    let folder = folder();
    let scenario = repository("tests/e2e/scenarios/two_moves.yaml");
    let plan = ["shard", "plan", text(&scenario), "--seeds", "1..1", "--work", "work", "--set", "speed=0.6"];
    sfg(folder.path(), &plan).ended_with(0);
    let job = folder.path().join("work/job.json");
    assert_eq!(read_json(&job)["set"], serde_json::json!(["speed=0.6"]));
    sfg(folder.path(), &["shard", "run-shard", "--job", text(&job), "--shard", "0", "--out", "work"]).ended_with(0);
    let sped = ["sweep", text(&scenario), "--seeds", "1..1", "--set", "speed=9"];
    sfg(folder.path(), &sped).refused(2, &["port \"speed\": expected 0.01 to 1, found 9"]);
}

#[test]
fn a_mistake_in_an_included_file_is_told_with_that_file() {
    let folder = folder();
    fs::create_dir(folder.path().join("parts")).unwrap();
    fs::write(folder.path().join("two_moves.yaml"), TWO_MOVES).unwrap();
    let check = |text: &str, words: &[&str]| {
        fs::write(folder.path().join("parts/moves.yaml"), text).unwrap();
        sfg(folder.path(), &["check", "two_moves.yaml"]).refused(2, words);
    };
    check(&MOVES.replace("name: bend, q_deg", "name: bend, q_dag"), &["has no port \"q_dag\"", "parts/moves.yaml:8:"]);
    check(&MOVES.replace("secs: 20", "secs: 40"), &["\"timeout\" of 40 s can never run out", "parts/moves.yaml:12:"]);
    fs::remove_file(folder.path().join("parts/moves.yaml")).unwrap();
    sfg(folder.path(), &["check", "two_moves.yaml"]).refused(2, &["cannot read \"parts/moves.yaml\"", "two_moves.yaml:3:11"]);
}

#[test]
fn warnings_are_printed_and_do_not_fail_a_check() {
    let folder = folder();
    fs::create_dir(folder.path().join("parts")).unwrap();
    fs::write(folder.path().join("parts/moves.yaml"), MOVES).unwrap();
    fs::write(folder.path().join("two_moves.yaml"), TWO_MOVES.replace("thing: ball", "thing: ball\n  other: 1")).unwrap();
    let said = sfg(folder.path(), &["check", "two_moves.yaml"]).ended_with(0).stdout;
    assert!(said.contains("warning: parameter \"other\" is not used") && said.contains("no mistakes, 1 warning, "), "{said}");
}

#[test]
fn a_failure_reason_is_explained() {
    let folder = folder();
    let said = sfg(folder.path(), &["explain", "no_path"]).ended_with(0).stdout;
    assert!(said.starts_with("no_path\n\nNo collision-free motion was found.\n") && said.contains("**Do:** "), "{said}");
    sfg(folder.path(), &["explain", "no_paht"]).refused(2, &["unknown failure reason \"no_paht\"; did you mean \"no_path\"?"]);
}

//! A past run looked at again, and a tree looked at before it runs.

use crate::{folder, repository, sfg, text};
use std::fs;

const SCRIPTED: &str = include_str!("../../../scenarios/00_move_joints.yaml");

#[test]
fn a_run_decides_the_same_again_and_a_changed_tree_says_where_not() {
    let folder = folder();
    let (scenario, run) = (folder.path().join("moves.yaml"), folder.path().join("run"));
    fs::write(&scenario, SCRIPTED).unwrap();
    sfg(folder.path(), &["run", text(&scenario), "--out", text(&run)]).ended_with(0);
    let replayed = sfg(folder.path(), &["replay", text(&run)]).ended_with(0).stdout;
    assert!(replayed.contains("success  sequence/bend") && replayed.contains("no divergence"), "{replayed}");

    let changed = folder.path().join("changed.yaml");
    fs::write(
        &changed,
        SCRIPTED.replace(
            "    - move_joints: {name: stretch",
            "    - timeout:\n        secs: 0.5\n        do:\n          move_joints: {name: stretch",
        ),
    )
    .unwrap();
    let replayed = sfg(folder.path(), &["replay", text(&run), "--scenario", text(&changed)]).ended_with(7).stdout;
    assert!(replayed.contains("is not the file that was run"), "{replayed}");
    assert!(replayed.contains("first divergence in tick"), "{replayed}");
    assert!(replayed.contains("replayed  sequence/timeout: idle -> running"), "{replayed}");
}

#[test]
fn what_is_no_run_is_named() {
    let folder = folder();
    let ended = sfg(folder.path(), &["replay", "nowhere"]).ended_with(2);
    assert!(ended.stderr.contains("cannot read nowhere"), "{}", ended.stderr);
}

#[test]
fn a_preview_moves_nothing_and_names_two_skills_on_one_arm() {
    let folder = folder();
    let scenario = folder.path().join("moves.yaml");
    fs::write(&scenario, SCRIPTED).unwrap();
    let shown = sfg(folder.path(), &["run", text(&scenario), "--preview"]).ended_with(0).stdout;
    assert!(shown.contains("left arm") && shown.contains("sequence/bend") && shown.contains("4 s"), "{shown}");
    fs::write(&scenario, SCRIPTED.replace("  sequence:", "  parallel:")).unwrap();
    let shown = sfg(folder.path(), &["run", text(&scenario), "--preview"]).ended_with(2).stdout;
    assert!(shown.contains("conflict in parallel: parallel/bend and parallel/stretch both occupy the left arm"), "{shown}");
    assert!(!folder.path().join("runs").exists());
}

#[test]
fn a_stopped_run_goes_on_where_it_stood() {
    let folder = folder();
    let (scenario, first, second) = (folder.path().join("moves.yaml"), folder.path().join("first"), folder.path().join("second"));
    fs::write(&scenario, SCRIPTED).unwrap();
    let stopped = sfg(folder.path(), &["run", text(&scenario), "--stop-after", "move_joints", "--out", text(&first)])
        .ended_with(130)
        .stdout;
    assert!(stopped.contains("go on with: sfg run --resume"), "{stopped}");
    let resumed = sfg(folder.path(), &["run", "--resume", text(&first), "--out", text(&second)]).ended_with(0).stdout;
    assert!(resumed.contains("resumed at"), "{resumed}");
    // The first motion goes on, the second one follows.
    assert_eq!(resumed.matches("move_joints").count(), 2, "{resumed}");

    // Set points out of a changed file pass the engine's limits like any others.
    let state = fs::read_to_string(first.join("state.json")).unwrap();
    let mut changed: serde_json::Value = serde_json::from_str(&state).unwrap();
    changed["sent"][0]["q"][3] = serde_json::json!(0.5);
    fs::write(first.join("state.json"), changed.to_string()).unwrap();
    let unsafe_ = sfg(folder.path(), &["run", "--resume", text(&first)]).ended_with(2).stderr;
    assert!(unsafe_.contains("the robot cannot be brought to where it was") && unsafe_.contains("joint4"), "{unsafe_}");
    fs::write(first.join("state.json"), state).unwrap();

    let replayed = sfg(folder.path(), &["replay", text(&second)]).ended_with(2).stderr;
    assert!(replayed.contains("the run was resumed"), "{replayed}");
    let misspelt = sfg(folder.path(), &["run", text(&scenario), "--stop-after", "move_joint"]).ended_with(2).stderr;
    assert!(misspelt.contains("did you mean \"move_joints\"?"), "{misspelt}");

    fs::write(&scenario, SCRIPTED.replace("speed: 0.3", "speed: 0.2")).unwrap();
    let changed = sfg(folder.path(), &["run", "--resume", text(&first)]).ended_with(2).stderr;
    assert!(changed.contains("is not the scenario of"), "{changed}");
    let nothing = sfg(folder.path(), &["run", "--resume", text(&second)]).ended_with(2).stderr;
    assert!(nothing.contains("state.json"), "{nothing}");
}

#[test]
fn a_pour_goes_on_after_the_lift() {
    let folder = folder();
    let scenario = repository("scenarios").join("01_pour.yaml");
    let (first, second) = (folder.path().join("first"), folder.path().join("second"));
    sfg(folder.path(), &["run", text(&scenario), "--seed", "3", "--stop-after", "lift", "--out", text(&first)]).ended_with(130);
    let resumed = sfg(folder.path(), &["run", "--resume", text(&first), "--out", text(&second)]).ended_with(0).stdout;
    assert!(!resumed.contains("close_hand") && resumed.contains("pour"), "{resumed}");
    let log = fs::read(second.join("run.btlog")).unwrap();
    assert!(log.starts_with(b"BTCPP4-FileLogger2"));

    // A robot that would not stand where the tree stopped.
    let state = fs::read_to_string(first.join("state.json")).unwrap();
    let mut changed: serde_json::Value = serde_json::from_str(&state).unwrap();
    changed["sent"] = serde_json::json!([]);
    fs::write(first.join("state.json"), changed.to_string()).unwrap();
    let refused = sfg(folder.path(), &["run", "--resume", text(&first)]).ended_with(2).stderr;
    assert!(refused.contains("the file is damaged"), "{refused}");
}

//! A past run looked at again, and a tree looked at before it runs.

use crate::{folder, sfg, text};
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

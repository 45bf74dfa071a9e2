//! Whole runs, judged by what they leave behind.

use crate::{folder, read_json, recording, repository, sfg, start, text, without};
use serde_json::Value;
use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};
#[cfg(unix)]
use std::time::Duration;

/// The stages of the default scenario, in the order of the data path.
const POUR_STAGES: [&str; 13] = [
    "observe_scene",
    "list_scene",
    "infer_functionality",
    "ground_affordance",
    "reconstruct_object",
    "generate_palm_poses",
    "select_palm_pose",
    "synthesize_grasp",
    "reach_palm_pose",
    "close_hand",
    "verify_grasp",
    "lift",
    "pour",
];

const SCRIPTED: &str = include_str!("../../../scenarios/00_move_joints.yaml");

#[test]
fn every_scenario_of_the_repository_is_right() {
    for scenarios in ["scenarios", "tests/e2e/scenarios"] {
        for entry in fs::read_dir(repository(scenarios)).unwrap() {
            let path = entry.unwrap().path();
            if path.extension().is_some_and(|extension| extension == "yaml") {
                sfg(folder().path(), &["check", text(&path)]).ended_with(0);
            }
        }
    }
}

#[test]
fn the_schema_is_the_one_the_program_prints() {
    let printed = sfg(folder().path(), &["schema"]).ended_with(0).stdout;
    let committed = fs::read_to_string(repository("scenarios").join("schema.json")).unwrap_or_default();
    assert!(
        printed == committed,
        "scenarios/schema.json is stale; refresh it: cargo run -p sfg-app -- schema > scenarios/schema.json"
    );
}

#[test]
fn a_scripted_motion_of_either_arm_arrives() {
    let folder = folder();
    // The right arm mirrors the left one; its hand is mounted half a turn away.
    let right = SCRIPTED
        .replace("arm: left", "arm: right")
        .replace("[1.6, 0.13, 0.1, -2.2, -0.03, 2.05, 1.6]", "[-1.6, 0.13, -0.1, -2.2, 0.03, 2.05, 1.541593]")
        .replace("[1.6, 0.13, 0.1, -1.88, -0.03, 1.73, 1.6]", "[-1.6, 0.13, -0.1, -1.88, 0.03, 1.73, 1.541593]");
    for (side, scenario) in [("left", SCRIPTED), ("right", right.as_str())] {
        let file = format!("{side}.yaml");
        fs::write(folder.path().join(&file), scenario).unwrap();
        sfg(folder.path(), &["run", &file, "--out", side]).ended_with(0);
        let report = read_json(&folder.path().join(side).join("report.json"));
        assert_eq!(report["outcome"], "success");
        assert_eq!(stages(&report), ["move_joints", "move_joints"]);
        let robot = &recording::messages(&folder.path().join(side).join("run.mcap"))["/robot"];
        let elbow = |sample: &Value| sample["q"][3].as_f64().unwrap();
        let bent = robot.iter().map(elbow).fold(f64::INFINITY, f64::min);
        assert!((bent + 2.2).abs() < 0.02, "the {side} elbow bends to {bent} rad");
        let end = robot.last().unwrap();
        assert_eq!(end["side"], side);
        assert!((elbow(end) + 1.88).abs() < 0.01, "the {side} elbow ends at {} rad", elbow(end));
    }
}

/// `sfg run … | head` closes the pipe at the first line.
#[test]
fn a_reader_that_leaves_does_not_end_the_run() {
    let folder = folder();
    let mut child = Command::new(env!("CARGO_BIN_EXE_sfg"))
        .args(["run", text(&repository("scenarios/00_move_joints.yaml")), "--out", "out"])
        .current_dir(folder.path())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    drop(child.stdout.take());
    assert_eq!(child.wait().unwrap().code(), Some(0));
    assert_eq!(read_json(&folder.path().join("out/report.json"))["outcome"], "success");
}

/// Slow motion without an end, so that a signal always meets the arm on its way.
#[cfg(unix)]
fn endless() -> String {
    let slow = SCRIPTED.replace("q_rad", "speed: 0.05, q_rad").replace(", speed: 0.3", "");
    let (head, tree) = slow.split_once("tree:\n").unwrap();
    let tree: String = tree.lines().map(|line| format!("      {line}\n")).collect();
    format!("{head}limits: {{timeout_secs: 3600}}\ntree:\n  repeat:\n    times: 1000\n    do:\n{tree}")
}

/// Length of a list of numbers.
#[cfg(unix)]
fn norm(values: &Value) -> f64 {
    values.as_array().unwrap().iter().map(|value| value.as_f64().unwrap().powi(2)).sum::<f64>().sqrt()
}

#[cfg(unix)]
#[test]
fn ctrl_c_halts_the_robot_and_leaves_a_whole_report_and_recording() {
    let folder = folder();
    fs::write(folder.path().join("endless.yaml"), endless()).unwrap();
    let mut run = start(folder.path(), &["run", "endless.yaml", "--out", "out"], &[]);
    run.wait_for("move_joints");
    std::thread::sleep(Duration::from_millis(400));
    // Twice, as `timeout -s INT` sends it to the process and to its group.
    run.signal("INT");
    run.signal("INT");
    run.wait().ended_with(130);

    let report = read_json(&folder.path().join("out/report.json"));
    assert_eq!(report["outcome"], "interrupted");
    assert!(fs::read_to_string(folder.path().join("out/report.html")).unwrap().ends_with("</html>\n"));
    let topics = recording::messages(&folder.path().join("out/run.mcap"));
    assert_eq!(topics["/verdict"].len(), 1);
    let robot = &topics["/robot"];
    assert!(robot.iter().any(|sample| norm(&sample["dq"]) > 0.02), "the arm never moved");
    let end = robot.last().unwrap();
    assert!(norm(&end["dq"]) < 0.01, "the arm still moves: {end}");
    assert_eq!(robot[robot.len() - 10]["q_command"], end["q_command"], "the arm is still driven");
    let halted = topics["/tree"].iter().filter(|change| change["to"] == "idle").count();
    assert!(halted > 0, "no node was halted: {:?}", topics["/tree"].last());
}

/// The arm goes to and fro for ever, a stage each time.
#[cfg(unix)]
fn to_and_fro() -> String {
    endless().replace("speed: 0.05", "speed: 0.5")
}

#[cfg(unix)]
#[test]
fn a_killed_run_misses_a_second_at_most_and_can_be_recovered() {
    // Ten moments: after some stages and a part of another.
    for n in 0..10_u64 {
        let n_stages = 1 + n as usize * 3 % 8;
        let folder = folder();
        fs::write(folder.path().join("endless.yaml"), to_and_fro()).unwrap();
        fs::create_dir(folder.path().join("out")).unwrap();
        fs::write(folder.path().join("out/report.json"), "of an earlier run").unwrap();
        let mut run = start(folder.path(), &["run", "endless.yaml", "--out", "out"], &[]);
        let stamps = run.wait_for_stages(n_stages);
        std::thread::sleep(Duration::from_millis(n * 619 % 1000));
        run.signal("KILL");
        let ended = run.wait();
        assert_eq!(ended.code, None);
        assert!(!folder.path().join("out/report.json").exists(), "an earlier report lies beside another run's recording");
        // What it has said was recorded.
        let stages = ended.stdout.lines().filter(|line| line.contains("move_joints"));
        let last = stages.filter_map(|line| line.split_whitespace().next()?.parse::<f64>().ok()).next_back().unwrap_or(stamps);
        let said = sfg(folder.path(), &["log", "recover", "out"]).ended_with(0).stdout;
        let topics = recording::messages(&folder.path().join("out/run.recovered.mcap"));
        // A run that was killed in its first second may have recorded nothing.
        let end = topics.get("/robot").map_or(0.0, |robot| robot.last().unwrap()["stamp_secs"].as_f64().unwrap());
        assert!(end >= last - 1.0, "recorded up to {end} s, the run said something at {last} s: {said}");
        let bytes = fs::read(folder.path().join("out/run.recovered.mcap")).unwrap();
        let summary = mcap::Summary::read(&bytes).unwrap().unwrap();
        assert!(!summary.chunk_indexes.is_empty(), "it can be sought in");
        sfg(folder.path(), &["replay", "out/run.recovered.mcap"]).ended_with(0);
    }
}

#[test]
fn the_demo_pours_and_shows_why() {
    let folder = folder();
    let scenario = repository("scenarios/01_pour.yaml");
    let ended = sfg(folder.path(), &["run", text(&scenario), "--seed", "1", "--out", "out"]);
    assert!(matches!(ended.code, Some(0 | 1)), "{ended:#?}");
    let out = folder.path().join("out");
    let report = read_json(&out.join("report.json"));
    assert_eq!(report["outcome"], if ended.code == Some(0) { "success" } else { "judged_failure" });
    // Earlier attempts, if any, begin with an observation too.
    let all = stages(&report);
    let last_try = all.iter().rposition(|stage| stage == "observe_scene").unwrap();
    assert_eq!(all[last_try..], POUR_STAGES);
    for stage in &report["stages"].as_array().unwrap()[last_try..] {
        let hash = stage["input_sha256"].as_str().unwrap();
        assert!(hash.len() == 64 && hash.bytes().all(|byte| byte.is_ascii_hexdigit()), "{} has input {hash:?}", stage["stage"]);
        assert!(stage["failure"].is_null() && !stage["summary"].as_str().unwrap().is_empty());
    }
    assert!(report["judge"]["physics_tampered"].is_null());
    let views = ["left", "right"].map(|camera| ["colour", "depth", "mask"].map(|what| format!("grounding_{camera}_{what}")));
    let others = ["palm_poses", "grasp", "result"].map(str::to_owned);
    for name in views.into_iter().flatten().chain(others) {
        let picture = fs::read(out.join(format!("{name}.png"))).unwrap();
        assert!(picture.starts_with(b"\x89PNG\r\n\x1a\n") && picture.len() > 20_000, "{name}.png has {} bytes", picture.len());
    }
    check_page(&out.join("report.html"), 9);
    let topics = recording::messages(&out.join("run.mcap"));
    assert_eq!(topics["/stages"].len(), all.len());
    assert_eq!(topics["/verdict"].len(), 1);
    for topic in crate::log::POUR_CHANNELS.split_whitespace() {
        assert!(topics.get(topic).is_some_and(|messages| !messages.is_empty()), "nothing on {topic}");
    }
    crate::log::check_artefacts(&topics);
    recording::check_with_python(&out.join("run.mcap"));
}

/// The page holds its pictures and asks for nothing from outside.
#[track_caller]
fn check_page(path: &Path, n_pictures: usize) {
    let page = fs::read_to_string(path).unwrap();
    assert_eq!(page.matches("src=\"data:image/png;base64,").count(), n_pictures);
    for outside in ["http:", "https:", "<script", "<link", "url("] {
        assert!(!page.contains(outside), "{} holds {outside}", path.display());
    }
    assert_eq!(page.matches("src=").count(), n_pictures);
}

#[test]
fn one_seed_gives_one_report_alone_and_beside_another_run() {
    let folder = folder();
    let scenario = repository("tests/e2e/scenarios/lift.yaml");
    let run = |name: &str, n_threads: &str| {
        let args = ["run", text(&scenario), "--seed", "7", "--out", name];
        start(folder.path(), &args, &[("RAYON_NUM_THREADS", n_threads)])
    };
    let report = |name: &str| without(read_json(&folder.path().join(name).join("report.json")), &["timings"]);
    run("alone", "1").wait().ended_with(0);
    let pair = [run("first", "2"), run("second", "2")];
    for started in pair {
        started.wait().ended_with(0);
    }
    let alone = report("alone");
    assert_eq!(stages(&alone), POUR_STAGES[..12]);
    assert_eq!(alone, report("first"), "two runs with one seed differ");
    assert_eq!(alone, report("second"), "two runs with one seed differ");
}

fn stages(report: &Value) -> Vec<String> {
    report["stages"].as_array().unwrap().iter().map(|stage| stage["stage"].as_str().unwrap().to_owned()).collect()
}

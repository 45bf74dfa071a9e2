//! `sfg log`: recordings after a kill, in parts, compared, exported; and files that are none.

use crate::{folder, read_json, recording, repository, sfg, text};
use serde_json::Value;
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

/// Every channel of a run that grasps and pours.
pub(crate) const POUR_CHANNELS: &str = "\
    /run /tree/definition /tree /journal /blackboard /stages /functionality /inventory /masks /key_point /candidates /robot \
    /synergy /motors /truth /verdict /tf_static /tf /scene /scene/grasp /cloud /joint_states /log \
    /camera/left/image /camera/left/depth /camera/left/calibration /camera/left/annotations \
    /camera/right/image /camera/right/depth /camera/right/calibration /camera/right/annotations";

/// A recording of the first version of the layouts; newer programs must open it too.
const FIRST: &str = "tests/e2e/recordings/v1.mcap";

/// What the messages of a run that grasps say about each other.
pub(crate) fn check_artefacts(topics: &BTreeMap<String, Vec<Value>>) {
    let header = &topics["/run"][0];
    let n_q = header["q_names"].as_array().unwrap().len();
    for link in header["links"].as_array().unwrap() {
        let source = &link["joint"]["source"];
        assert!(source.is_null() || source["q"].as_u64().unwrap() < n_q as u64, "{link}");
    }
    let n_hand = header["hand_q"].as_array().unwrap().len();
    let n_objects = header["objects"].as_array().unwrap().len();
    for truth in &topics["/truth"] {
        assert_eq!(truth["hand_q"].as_array().unwrap().len(), n_hand);
        assert_eq!(truth["objects"].as_array().unwrap().len(), n_objects);
    }
    let candidates = &topics["/candidates"];
    assert!(candidates[0]["chosen"].is_null() && candidates[0]["candidates"][0]["rejected"].is_null());
    let chosen = candidates.iter().rfind(|message| message["chosen"].is_u64()).unwrap();
    let idx = chosen["chosen"].as_u64().unwrap() as usize;
    for entry in chosen["candidates"].as_array().unwrap() {
        let is_chosen = entry["idx"].as_u64().unwrap() as usize == idx;
        assert_eq!(entry["rejected"].is_null(), is_chosen, "{entry}");
    }
    // The way of the palm ends where the candidate is.
    let number = |value: &Value| value.as_f64().unwrap();
    let end = chosen["path"].as_array().unwrap().last().unwrap();
    let goal = &chosen["candidates"][idx]["base_from_palm"]["translation"];
    for axis in 0..3 {
        assert!((number(&end[axis]) - number(&goal[axis])).abs() < 2e-3, "{end} is not {goal}");
    }
    let nodes = topics["/tree/definition"][0]["nodes"].as_array().unwrap();
    for change in &topics["/tree"] {
        assert!(nodes.iter().any(|node| node["path"] == change["node"]), "{change} is of no node");
    }
    for message in topics["/masks"].iter().flat_map(|message| message["views"].as_array().unwrap()) {
        let n_pixels: u64 = message["runs"].as_array().unwrap().iter().map(|run| run[1].as_u64().unwrap()).sum();
        assert!(n_pixels > 0 && message["box"].is_array(), "{message}");
    }
    assert!(topics["/masks"].iter().any(|message| message["views"][0]["key_point_px"].is_array()));
}

fn two_moves(folder: &Path, out: &str, more: &[&str]) {
    let scenario = repository("scenarios/00_move_joints.yaml");
    let mut args = vec!["run", text(&scenario), "--out", out];
    args.extend(more);
    sfg(folder, &args).ended_with(0);
}

#[test]
fn a_recording_says_what_it_holds() {
    let folder = folder();
    two_moves(folder.path(), "out", &[]);
    let said = sfg(folder.path(), &["log", "info", "out"]).ended_with(0).stdout;
    for word in [
        "/robot",
        "sfg.RobotSample.v1",
        "foxglove.FrameTransforms",
        "100.0",
        "seed",
        "scenario_sha256",
        "binary_sha256",
        "curi.urdf",
    ] {
        assert!(said.contains(word), "{word:?} is not in:\n{said}");
    }
    assert!(!said.contains("cut off"), "{said}");
    let nothing = sfg(folder.path(), &["log", "recover", "out"]).ended_with(0);
    assert!(nothing.stdout.contains("is whole"), "{nothing:#?}");
}

#[test]
fn recording_does_not_change_a_run() {
    let folder = folder();
    let scenario = repository("tests/e2e/scenarios/lift.yaml");
    let judge = |name: &str, more: &[&str]| {
        let mut args = vec!["run", text(&scenario), "--seed", "7", "--out", name];
        args.extend(more);
        sfg(folder.path(), &args).ended_with(0);
        read_json(&folder.path().join(name).join("report.json"))["judge"].clone()
    };
    let recorded = judge("recorded", &[]);
    assert!(recorded["state_hash"].is_string());
    assert_eq!(recorded, judge("unrecorded", &["--no-recording"]));
    assert_eq!(recorded, judge("watched", &["--foxglove", "0"]));
    assert!(!folder.path().join("unrecorded/run.mcap").exists());
    let said = sfg(folder.path(), &["log", "diff", "recorded", "watched"]).ended_with(0).stdout;
    assert!(said.contains("no difference"), "{said}");
}

#[test]
fn runs_that_went_another_way_are_told_apart() {
    let folder = folder();
    two_moves(folder.path(), "a", &[]);
    let text_of = fs::read_to_string(repository("scenarios/00_move_joints.yaml")).unwrap();
    let slower = text_of.replacen("speed: 0.3", "speed: 0.2", 1);
    assert_ne!(slower, text_of, "the scenario has a speed");
    fs::write(folder.path().join("slower.yaml"), slower).unwrap();
    sfg(folder.path(), &["run", "slower.yaml", "--out", "b"]).ended_with(0);
    let said = sfg(folder.path(), &["log", "diff", "a", "b"]).ended_with(7).stdout;
    assert!(said.contains("first difference in tick") && said.contains("stretch running -> success"), "{said}");
    assert!(said.contains("scenario_sha256"), "{said}");
}

#[test]
fn a_part_and_the_exports_can_be_read() {
    let folder = folder();
    two_moves(folder.path(), "out", &[]);
    sfg(folder.path(), &["log", "cut", "out", "--from", "0.5", "--to", "1.5", "--out", "part.mcap"]).ended_with(0);
    let part = recording::messages(&folder.path().join("part.mcap"));
    assert_eq!(part["/run"].len(), 1);
    let stamps: Vec<f64> = part["/robot"].iter().map(|sample| sample["stamp_secs"].as_f64().unwrap()).collect();
    assert!(stamps.iter().all(|secs| (0.499..=1.501).contains(secs)) && stamps.len() >= 99, "{stamps:?}");
    sfg(folder.path(), &["replay", "part.mcap"]).refused(2, &["is a part of another"]);
    sfg(folder.path(), &["log", "cut", "out", "--from", "900"]).refused(2, &["nothing lies between"]);
    sfg(folder.path(), &["log", "export", "out", "--lerobot", "set", "--parquet", "grasps.parquet"]).ended_with(0);
    let info = read_json(&folder.path().join("set/meta/info.json"));
    assert_eq!((&info["codebase_version"], &info["fps"]), (&Value::from("v3.0"), &Value::from(100)));
    assert_eq!(
        info["total_frames"].as_u64().unwrap() as usize,
        recording::messages(&folder.path().join("out/run.mcap"))["/robot"].len()
    );
    for file in ["grasps.parquet", "set/data/chunk-000/file-000.parquet", "set/meta/tasks.parquet"] {
        let bytes = fs::read(folder.path().join(file)).unwrap();
        assert!(bytes.starts_with(b"PAR1") && bytes.ends_with(b"PAR1"), "{file}");
    }
    // The arm moves without a look.
    sfg(folder.path(), &["log", "export", "out", "--gif", "run.gif"]).refused(2, &["has no camera images"]);
    sfg(folder.path(), &["log", "export", "out"]).refused(2, &["--parquet"]);
}

#[test]
fn what_is_no_recording_is_refused_by_name() {
    let folder = folder();
    let path = |name: &str| folder.path().join(name);
    fs::write(path("empty.mcap"), "").unwrap();
    fs::write(path("text.mcap"), "nothing of the kind").unwrap();
    let mut foreign = mcap::Writer::new(fs::File::create(path("foreign.mcap")).unwrap()).unwrap();
    write_one(&mut foreign, "/front", "sensor_msgs/Image");
    let mut newer = mcap::Writer::new(fs::File::create(path("newer.mcap")).unwrap()).unwrap();
    write_one(&mut newer, "/tree", "sfg.Transition.v2");
    for (file, word) in [
        ("missing.mcap", "missing.mcap"),
        ("empty.mcap", "it is empty"),
        ("text.mcap", "it is no recording"),
        ("foreign.mcap", "no recording of sfg"),
        ("newer.mcap", "newer program"),
    ] {
        for command in [&["log", "info"][..], &["log", "recover"], &["log", "cut"], &["replay"]] {
            sfg(folder.path(), &[command, &[file]].concat()).refused(2, &[word]);
        }
    }
}

fn write_one(writer: &mut mcap::Writer<fs::File>, topic: &str, schema: &str) {
    let schema = writer.add_schema(schema, "jsonschema", b"{}").unwrap();
    let channel = writer.add_channel(schema, topic, "json", &BTreeMap::new()).unwrap();
    let header = mcap::records::MessageHeader { channel_id: channel, sequence: 0, log_time: 0, publish_time: 0 };
    writer.write_to_known_channel(&header, b"{}").unwrap();
    writer.finish().unwrap();
}

#[test]
fn a_recording_of_the_first_version_still_opens() {
    let folder = folder();
    let file = repository(FIRST);
    let said = sfg(folder.path(), &["log", "info", text(&file)]).ended_with(0).stdout;
    for word in ["sfg.Run.v1", "sfg.RobotSample.v1", "sfg.TreeDefinition.v1", "sfg.Transition.v1", "sfg.Truth.v1"] {
        assert!(said.contains(word), "{word:?} is not in:\n{said}");
    }
    sfg(folder.path(), &["log", "export", text(&file), "--lerobot", "set"]).ended_with(0);
}

#[test]
fn a_port_in_use_is_named() {
    let folder = folder();
    let taken = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let port = taken.local_addr().unwrap().port().to_string();
    let scenario = repository("scenarios/00_move_joints.yaml");
    sfg(folder.path(), &["run", text(&scenario), "--foxglove", &port, "--out", "out"]).refused(5, &[&port, "choose another"]);
}

//! Whatever is wrong with the input: one clear message with place and remedy, its own exit code, and nothing left behind.

use crate::{folder, read_json, repository, sfg, text};
use std::fs;
use std::path::{Path, PathBuf};

const LIFT: &str = include_str!("../scenarios/lift.yaml");

/// `run` and `check` refuse the scenario `text`, say `words`, and make no run folder.
#[track_caller]
fn check_text(text: &str, words: &[&str]) {
    let folder = folder();
    fs::write(folder.path().join("bad.yaml"), text).unwrap();
    sfg(folder.path(), &["check", "bad.yaml"]).refused(2, words);
    sfg(folder.path(), &["run", "bad.yaml", "--out", "out"]).refused(2, words);
    assert!(!folder.path().join("out").exists(), "nothing ran, but there is a run folder");
}

fn changed(from: &str, to: &str) -> String {
    assert_eq!(LIFT.matches(from).count(), 1, "{from:?} is not once in the scenario");
    LIFT.replace(from, to)
}

/// The lift with `to` for `from` is refused at the line that differs, with `words`.
#[track_caller]
fn check(from: &str, to: &str, words: &[&str]) {
    let bad = changed(from, to);
    let line = 1 + bad.lines().zip(LIFT.lines()).position(|(a, b)| a != b).unwrap();
    check_text(&bad, &[&[format!("bad.yaml:{line}:").as_str()], words].concat());
}

#[test]
fn words_that_nobody_knows_get_the_nearest_one() {
    check("robot: curi", "robbot: curi", &["scenario has no key \"robbot\"", "did you mean \"robot\"?"]);
    check("robot: curi", "robot: cury", &["unknown robot \"cury\"", "did you mean \"curi\"?"]);
    check("- list_scene", "- list_scen", &["unknown node \"list_scen\"", "did you mean \"list_scene\"?"]);
    check("llm: knowledge", "llm: knowlege", &["unknown llm plugin \"knowlege\"", "did you mean \"knowledge\"?"]);
    check("llm: knowledge", "driver: simm", &["unknown driver plugin \"simm\"", "did you mean \"sim\"?"]);
    check("model: bottle", "model: botle", &["unknown object model \"botle\"", "did you mean \"bottle\"?"]);
    check("subtree: functional_grasp", "subtree: functional_gasp", &["functional_gasp", "did you mean \"functional_grasp\"?"]);
    check("grip_current_fraction", "grip_current", &["unknown parameter \"grip_current\"", "known are grip_current_fraction"]);
    check("lifted: {object: bottle", "lifted: {object: jug", &["object \"jug\" is not in the scene", "the scene has bottle"]);
    check("- lifted", "- liftet", &["liftet", "did you mean \"lifted\"?"]);
}

#[test]
fn values_of_the_wrong_kind_or_size_are_refused() {
    check("height_m: 0.75", "height_m: tall", &["height_m: expected a number", "found \"tall\""]);
    check("height_m: 0.75", "height_m: -0.75", &["expected a number from 0.2 to 1.5, found -0.75"]);
    check("x_m: 0.80", "x_m: .nan", &["expected a number from -3 to 3, found NaN"]);
    check("x_m: 0.80", "x_m: -.inf", &["x_m: expected a number", "found -inf"]);
    check("height_scale: 1.0", "height_scale: -1.0", &["expected a number from 0.2 to 5, found -1"]);
    check("height_scale: 1.0", "height_scale: .nan", &["height_scale", "found NaN"]);
    check("filled_grains: 10", "filled_grains: 4000000000", &["expected a whole number from 0 to 2000"]);
    check("grip_current_fraction: 0.6", "grip_current_fraction: .nan", &["finite"]);
    check("grip_current_fraction: 0.6", "grip_current_fraction: high", &["grip_current_fraction"]);
    check("friction: 0.6", "friction: [0.8, 0.4]", &["friction"]);
    check("at_least_m: 0.05", "at_least_m: deep", &["at_least_m", "deep"]);
    check("instruction: Pick up the bottle.", "instruction: \"\"", &["the instruction is empty; say what to do"]);
}

#[test]
fn ports_that_do_not_fit_are_refused() {
    check("- lift\n", "- move_joints\n", &["\"move_joints\" needs port \"q_rad\": a list, each item a number"]);
    check("- lift\n", "- lift: {hight: 1}\n", &["hight"]);
    check(
        "- ground_affordance",
        "- ground_affordance: {functionality: \"{observation}\"}",
        &["as GraspFunctionality, but", "writes it as Observation"],
    );
    let dangling = changed("        - observe_scene\n", "");
    check_text(
        &dangling,
        &["reads blackboard key \"observation\"", "observe_scene writes it; put it earlier in the tree", ":22:"],
    );
}

#[test]
fn all_mistakes_are_told_at_once() {
    let bad = changed("robot: curi", "robot: cury").replace("height_m: 0.75", "height_m: tall").replace("- list_scene", "- list");
    check_text(&bad, &["3 mistakes", "unknown robot", "bad.yaml:3:", "found \"tall\"", "bad.yaml:6:", "unknown node \"list\""]);
    let bad = changed("object: bottle,", "object: jug,").replace("grip_current_fraction", "grip");
    check_text(&bad, &["2 mistakes", "\"jug\"", "\"grip\""]);
}

#[test]
fn hostile_files_are_refused_at_once() {
    let list = |of: &str| format!("[{}]", [of; 10].join(", "));
    let bomb =
        format!("a: &a {}\nb: &b {}\nc: &c {}\nd: &d {}\ne: {}\n", list("x"), list("*a"), list("*b"), list("*c"), list("*d"));
    check_text(&bomb, &["aliases stand for more than 10000 values", "write the values out", "bad.yaml:4:"]);
    check_text(&format!("tree: {}{}", "[".repeat(100_000), "]".repeat(100_000)), &["nested deeper than 64", "bad.yaml:1:"]);
    let deep: String = (0..3000).map(|depth| format!("{}a:\n", " ".repeat(depth))).collect();
    check_text(&deep, &["nested deeper than 64 lists and maps", "bad.yaml:65:"]);
    check_text(&format!("# {}", "x".repeat(17 << 20)), &["larger than 16 MB"]);
    check_text("", &["the scenario is empty"]);
    check_text("version: 1\n---\nversion: 1\n", &["a scenario is one document"]);
}

#[test]
fn files_that_are_not_there_are_named() {
    let folder = folder();
    sfg(folder.path(), &["run", "nowhere.yaml", "--out", "out"]).refused(2, &["cannot read \"nowhere.yaml\""]);
    sfg(folder.path(), &["run", ".", "--out", "out"]).refused(2, &["cannot read \".\""]);
    fs::write(folder.path().join("bytes.yaml"), [0xff, 0xfe, 0x00]).unwrap();
    sfg(folder.path(), &["run", "bytes.yaml", "--out", "out"]).refused(2, &["bytes.yaml", "UTF-8"]);
    let lift = repository("tests/e2e/scenarios/lift.yaml");
    sfg(folder.path(), &["--assets", "nowhere", "check", text(&lift)]).refused(2, &["nowhere", "give --assets a folder"]);
    assert!(!folder.path().join("out").exists());
}

/// The lift with an asset folder that `damage` has been done to.
#[track_caller]
fn check_assets(damage: impl Fn(&Path), words: &[&str]) {
    let folder = folder();
    let assets = folder.path().join("assets");
    for part in ["robots", "objects"] {
        fs::create_dir_all(assets.join(part)).unwrap();
        for entry in fs::read_dir(repository("scenarios").join(part)).unwrap() {
            let path = entry.unwrap().path();
            if path.is_file() {
                fs::copy(&path, assets.join(part).join(path.file_name().unwrap())).unwrap();
            }
        }
    }
    let lift = repository("tests/e2e/scenarios/lift.yaml");
    sfg(folder.path(), &["--assets", "assets", "check", text(&lift)]).ended_with(0);
    damage(&assets);
    sfg(folder.path(), &["--assets", "assets", "run", text(&lift), "--out", "out"]).refused(2, words);
    assert!(!folder.path().join("out").exists());
}

fn replace(path: PathBuf, from: &str, to: &str) {
    let text = fs::read_to_string(&path).unwrap();
    assert!(text.contains(from), "{from:?} is not in {}", path.display());
    fs::write(path, text.replacen(from, to, 1)).unwrap();
}

#[test]
fn missing_and_broken_robots_hands_and_objects_are_named() {
    let remove = |file: &'static str| move |assets: &Path| fs::remove_file(assets.join(file)).unwrap();
    check_assets(remove("robots/curi.urdf"), &["cannot read assets/robots/curi.urdf", "check the path"]);
    check_assets(remove("robots/softhand2.yaml"), &["cannot read assets/robots/softhand2.yaml", "check the path"]);
    check_assets(remove("robots/softhand2_left.urdf"), &["softhand2_left.urdf", "check the path"]);
    check_assets(remove("robots/curi.yaml"), &["assets/robots holds no robot description"]);
    let truncate = |file: &'static str| {
        move |assets: &Path| {
            let text = fs::read(assets.join(file)).unwrap();
            fs::write(assets.join(file), &text[..text.len() / 2]).unwrap();
        }
    };
    check_assets(truncate("robots/curi.urdf"), &["URDF assets/robots/curi.urdf", "mend the file"]);
    check_assets(truncate("robots/softhand2.yaml"), &["assets/robots/softhand2.yaml"]);
    check_assets(truncate("objects/bottle.yaml"), &["assets/objects/bottle.yaml"]);
    let change =
        |file: &'static str, from: &'static str, to: &'static str| move |assets: &Path| replace(assets.join(file), from, to);
    check_assets(change("robots/curi.urdf", "</robot>", "</robots>"), &["URDF assets/robots/curi.urdf"]);
    check_assets(change("robots/curi.yaml", "panda_left_joint3, ", ""), &["assets/robots/curi.yaml", "arms.left"]);
    check_assets(change("robots/curi.yaml", "tip_link: panda_left_link7", "tip_link: panda_left_link9"), &["panda_left_link9"]);
    check_assets(
        change("robots/softhand2.yaml", "upper_rad: 1.570796", "upper_rad: .nan"),
        &["hand profile \"softhand2\"", "thumb_abduction", "NaN"],
    );
    check_assets(change("robots/softhand2.yaml", "max_current_amps", "max_curent_amps"), &["softhand2.yaml", "max_curent_amps"]);
    check_assets(
        change("objects/bottle.yaml", "mass_kg:", "mass: 1\nmass_kg:"),
        &["objects/bottle.yaml", "unknown field `mass`"],
    );
    check_assets(change("objects/bottle.yaml", "mass_kg: ", "mass_kg: -"), &["object \"bottle\"", "mass_kg -0.12 is outside"]);
}

#[test]
fn missing_and_broken_meshes_are_refused_where_the_scenario_names_them() {
    let folder = folder();
    let scenario = changed("model: bottle, filled_grains: 10,", "mesh: scan/a.obj, hulls: scan/b.obj, mass_kg: 0.3,");
    let scenario = scenario.replace(", height_scale: 1.0", "");
    fs::create_dir_all(folder.path().join("below/scan")).unwrap();
    fs::write(folder.path().join("below/bad.yaml"), &scenario).unwrap();
    let check = |mesh: &[u8], words: &[&str]| {
        for file in ["a.obj", "b.obj"] {
            fs::write(folder.path().join("below/scan").join(file), mesh).unwrap();
        }
        sfg(folder.path(), &["check", "below/bad.yaml"]).refused(2, words);
    };
    sfg(folder.path(), &["check", "below/bad.yaml"]).refused(2, &["below/scan/a.obj", "bad.yaml:9:"]);
    check(b"", &["below/scan/a.obj", "bad.yaml:9:"]);
    check(b"v 0 0 0\nv 1 0 0\nv 0 nan 0\nf 1 2 3\n", &["below/scan/a.obj", "bad.yaml:9:"]);
    check(b"v 0 0 0\nv 1 0 0\nf 1 2 9\n", &["below/scan/a.obj", "bad.yaml:9:"]);
    check(&[0x80; 4096], &["below/scan/a.obj", "bad.yaml:9:"]);
}

#[test]
fn an_object_off_the_table_is_refused_before_anything_moves() {
    let folder = folder();
    fs::write(folder.path().join("bad.yaml"), changed("x_m: 0.80", "x_m: 2.0")).unwrap();
    sfg(folder.path(), &["run", "bad.yaml", "--out", "out"]).refused(2, &["bottle: at (2, 0.3) m is not on the table"]);
    assert!(!folder.path().join("out").exists());
}

#[test]
fn an_object_out_of_reach_ends_the_tree_with_a_reason_for_each_candidate() {
    let folder = folder();
    let far = changed("arm: left", "arm: right").replace("x_m: 0.80, y_m: 0.30", "x_m: 0.62, y_m: 0.60");
    fs::write(folder.path().join("far.yaml"), far).unwrap();
    let ended = sfg(folder.path(), &["run", "far.yaml", "--out", "out"]).ended_with(3);
    assert!(ended.stdout.contains("failed: no_candidate_reachable at "), "{ended:#?}");
    assert!(ended.stdout.contains("\nsee scenarios/FAILURES.md#no_candidate_reachable\n"), "{ended:#?}");
    let report = read_json(&folder.path().join("out/report.json"));
    assert_eq!(report["outcome"], "tree_failure");
    assert_eq!(report["failure"]["reason"], "no_candidate_reachable");
    let why = report["failure"]["explanation"].as_str().unwrap();
    assert!(why.contains("1: ") && why.contains("2: "), "{why}");
}

#[test]
fn an_absent_object_is_refused_with_what_is_there() {
    let folder = folder();
    let lift = repository("tests/e2e/scenarios/lift.yaml");
    let args = ["run", text(&lift), "--instruction", "Hand me the scissors.", "--out", "out"];
    let ended = sfg(folder.path(), &args).ended_with(4);
    assert!(ended.stdout.contains("no scissors") && ended.stdout.contains("bottle"), "{ended:#?}");
    assert_eq!(read_json(&folder.path().join("out/report.json"))["outcome"], "not_attempted");
}

#[test]
fn an_empty_sentence_on_the_command_line_is_refused() {
    let folder = folder();
    let lift = repository("tests/e2e/scenarios/lift.yaml");
    let said = ["the instruction is empty; say what to do"];
    sfg(folder.path(), &["run", text(&lift), "--instruction", " \t", "--out", "out"]).refused(2, &said);
    sfg(folder.path(), &["say", "", "--out", "out"]).refused(2, &said);
    assert!(!folder.path().join("out").exists());
}

#[test]
fn an_output_folder_that_cannot_be_written_is_named() {
    let folder = folder();
    fs::write(folder.path().join("file"), "kept").unwrap();
    let scenario = repository("scenarios/00_move_joints.yaml");
    let said = ["cannot make the run folder file/out", "choose another with --out"];
    sfg(folder.path(), &["run", text(&scenario), "--out", "file/out"]).refused(5, &said);
    assert_eq!(fs::read_to_string(folder.path().join("file")).unwrap(), "kept");
    // A file of the run cannot be written, because a folder has its name.
    fs::create_dir_all(folder.path().join("out/run.mcap")).unwrap();
    sfg(folder.path(), &["run", text(&scenario), "--out", "out"])
        .refused(5, &["out/run.mcap", "choose another folder with --out"]);
    assert!(!folder.path().join("out/report.json").exists());
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_ends_the_run_without_a_report() {
    let folder = folder();
    let scenario = repository("scenarios/00_move_joints.yaml");
    fs::create_dir(folder.path().join("out")).unwrap();
    std::os::unix::fs::symlink("/dev/full", folder.path().join("out/run.mcap")).unwrap();
    let ended = sfg(folder.path(), &["run", text(&scenario), "--out", "out"]);
    ended.refused(5, &["cannot record to out/run.mcap", "No space left on device", "choose another folder with --out"]);
    assert_eq!(fs::read_dir(folder.path().join("out")).unwrap().count(), 1, "only the recording is there");
}

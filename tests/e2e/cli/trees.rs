//! Trees in the XML of BehaviorTree.CPP: export, import, palette, and a run.

use crate::{folder, read_json, repository, sfg, text};
use std::fs;

const POINT: &str = "\
<root BTCPP_format=\"4\">
  <BehaviorTree ID=\"Bend\">
    <Sequence>
      <move_joints name=\"bend\" q_rad=\"1.6;0.13;0.1;-2.2;-0.03;2.05;1.6\"/>
    </Sequence>
  </BehaviorTree>
</root>
";

#[test]
fn a_scenario_goes_to_xml_and_back_and_runs() {
    let folder = folder();
    let here = folder.path();
    let scenario = repository("scenarios/00_move_joints.yaml");
    let said = sfg(here, &["tree", "export", text(&scenario), "-o", "tree.xml"]).ended_with(0).stdout;
    assert_eq!(said, "wrote tree.xml\n");
    let printed = sfg(here, &["tree", "export", text(&scenario)]).ended_with(0).stdout;
    assert_eq!(printed, fs::read_to_string(here.join("tree.xml")).unwrap());
    assert!(printed.contains("<move_joints q_rad=\"1.6;0.13;") && printed.contains("<Action ID=\"pour\">"), "{printed}");

    let said = sfg(here, &["check", "tree.xml", "--scene", text(&scenario)]).ended_with(0).stdout;
    assert_eq!(said, "tree.xml: no mistakes, 3 nodes\n");
    sfg(here, &["run", "tree.xml", "--scene", text(&scenario), "--out", "xml"]).ended_with(0);
    sfg(here, &["run", text(&scenario), "--out", "yaml"]).ended_with(0);
    let stages = |name: &str| read_json(&here.join(name).join("report.json"))["stages"].clone();
    assert_eq!(stages("xml"), stages("yaml"), "the tree does something else as XML");

    // As YAML it takes the place of the scenario's own tree.
    sfg(here, &["tree", "import", "tree.xml", "-o", "parts/tree.yaml"]).ended_with(0);
    let yaml = fs::read_to_string(here.join("parts/tree.yaml")).unwrap();
    let text = fs::read_to_string(&scenario).unwrap();
    fs::write(here.join("again.yaml"), format!("{}{yaml}", text.split("tree:\n").next().unwrap())).unwrap();
    sfg(here, &["check", "again.yaml"]).ended_with(0);
    sfg(here, &["run", "again.yaml", "--out", "again"]).ended_with(0);
    assert_eq!(stages("again"), stages("yaml"), "the tree does something else after two conversions");
    let left: Vec<_> = fs::read_dir(here.join("parts")).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    assert_eq!(left, ["tree.yaml"], "a partial file is left");
}

#[test]
fn what_xml_cannot_say_is_refused_and_leaves_no_file() {
    let folder = folder();
    let scenario = repository("scenarios/01_pour.yaml");
    fs::write(folder.path().join("tree.xml"), "what was there").unwrap();
    let words = ["1 mistake", "\"on\": BehaviorTree.CPP has no port like this", "01_pour.yaml:24:9"];
    sfg(folder.path(), &["tree", "export", text(&scenario), "-o", "tree.xml"]).refused(2, &words);
    assert_eq!(fs::read_to_string(folder.path().join("tree.xml")).unwrap(), "what was there");
    sfg(folder.path(), &["tree", "export", "nowhere.yaml", "-o", "b.xml"]).refused(2, &["cannot read \"nowhere.yaml\""]);
    assert!(!folder.path().join("b.xml").exists());
    let scenario = repository("scenarios/00_move_joints.yaml");
    fs::create_dir(folder.path().join("taken")).unwrap();
    sfg(folder.path(), &["tree", "export", text(&scenario), "-o", "taken"]).refused(5, &["cannot write taken"]);
}

#[test]
fn the_palette_holds_every_skill() {
    let folder = folder();
    let printed = sfg(folder.path(), &["tree", "model"]).ended_with(0).stdout;
    for word in ["<TreeNodesModel>", "ID=\"observe_scene\"", "ID=\"lift\"", "name=\"height_m\"", "ID=\"move_joints\""] {
        assert!(printed.contains(word), "{word} is not in:\n{printed}");
    }
    sfg(folder.path(), &["tree", "model", "-o", "skills.xml"]).ended_with(0);
    assert_eq!(fs::read_to_string(folder.path().join("skills.xml")).unwrap(), printed);
}

#[test]
fn a_tree_of_unknown_nodes_can_be_imported_but_not_run() {
    let folder = folder();
    let xml = repository("engine/tree/tests/xml/t09_scripts.xml");
    let ended = sfg(folder.path(), &["tree", "import", text(&xml)]).ended_with(0);
    assert!(ended.stdout.starts_with("tree:\n  sequence:\n    - script:"), "{ended:#?}");
    assert!(
        ended.stderr.contains("warning: \"&\": XML wants &amp; here") && ended.stderr.contains("t09_scripts.xml:6:"),
        "{ended:#?}"
    );
    let scene = repository("scenarios/00_move_joints.yaml");
    sfg(folder.path(), &["check", text(&xml), "--scene", text(&scene)])
        .refused(2, &["unknown node \"Show\"", "t09_scripts.xml:8:"]);
}

#[test]
fn mistakes_are_shown_in_the_xml() {
    let folder = folder();
    let scene = repository("scenarios/00_move_joints.yaml");
    let check = |from: &str, to: &str, words: &[&str]| {
        assert_eq!(POINT.matches(from).count(), 1, "{from:?} is not once in the tree");
        fs::write(folder.path().join("bad.xml"), POINT.replace(from, to)).unwrap();
        sfg(folder.path(), &["check", "bad.xml", "--scene", text(&scene)]).refused(2, words);
        sfg(folder.path(), &["run", "bad.xml", "--scene", text(&scene), "--out", "out"]).refused(2, words);
        assert!(!folder.path().join("out").exists(), "nothing ran, but there is a run folder");
    };
    check("<move_joints", "<move_joins", &["unknown node \"move_joins\"", "did you mean \"move_joints\"?", "bad.xml:4:7"]);
    check("q_rad", "q_red", &["has no port \"q_red\"", "did you mean \"q_rad\"?", "bad.xml:4:32"]);
    check("1.6;0.13;0.1;-2.2;-0.03;2.05;1.6", "1.6;up", &["port \"q_rad\": expected a number, found \"up\"", "bad.xml:4:39"]);
    check("</Sequence>", "</Sequenz>", &["not well-formed XML", "bad.xml:5:"]);
    check("BTCPP_format=\"4\"", "BTCPP_format=\"3\"", &["this is of BehaviorTree.CPP 3", "bad.xml:1:"]);
    check("<Sequence>", "<Sequence><Timeout/>", &["bad.xml:3:"]);
}

#[test]
fn a_tree_needs_a_scene_and_a_scenario_takes_none() {
    let folder = folder();
    fs::write(folder.path().join("tree.xml"), POINT).unwrap();
    let scene = repository("scenarios/00_move_joints.yaml");
    for command in ["check", "run"] {
        sfg(folder.path(), &[command, "tree.xml"]).refused(2, &["tree.xml is only a tree", "--scene FILE"]);
        let with_scene = [command, text(&scene), "--scene", text(&scene)];
        sfg(folder.path(), &with_scene).refused(2, &["--scene goes with a tree in XML"]);
        sfg(folder.path(), &[command, "none.xml", "--scene", text(&scene)]).refused(2, &["cannot read \"none.xml\""]);
    }
    fs::write(folder.path().join("bad.xml"), "<root/>").unwrap();
    fs::write(folder.path().join("bad.yaml"), "robot: cury\n").unwrap();
    let both = sfg(folder.path(), &["check", "bad.xml", "--scene", "bad.yaml"]);
    both.refused(2, &["bad.xml:1:1", "unknown robot \"cury\""]);
    sfg(folder.path(), &["tree", "import", "bad.xml"]).refused(2, &["bad.xml:1:1"]);
    let ended = sfg(folder.path(), &["run", "tree.xml", "--scene", text(&scene), "--preview"]).ended_with(0);
    assert!(ended.stdout.contains("sequence/bend"), "{ended:#?}");
}

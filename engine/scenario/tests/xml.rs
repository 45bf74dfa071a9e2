//! Trees in XML: run in a scenario's scene, written down as YAML, and a scenario's tree as XML.
#![allow(clippy::unwrap_used, reason = "tests fail by panicking")]

mod support;

use sfg_scenario::{Scenario, ScenarioErrors, Settings, Severity, XmlTree};
use std::fs;
use std::path::Path;
use support::{listed, parse, registry, vocabulary};

const SCENE: &str = "\
version: 1
robot: curi
scene: {objects: []}
limits: {timeout_secs: 60}
blackboard: {share: 0.3}
tree: is_held
";

/// Writes the files and reads the tree of the first.
fn tree(files: &[(&str, &str)]) -> (tempfile::TempDir, Result<XmlTree, ScenarioErrors>) {
    let folder = tempfile::tempdir().unwrap();
    for (name, text) in files {
        fs::create_dir_all(folder.path().join(name).parent().unwrap()).unwrap();
        fs::write(folder.path().join(name), text).unwrap();
    }
    let tree = XmlTree::load(&folder.path().join(files[0].0));
    (folder, tree)
}

fn in_scene(files: &[(&str, &str)]) -> Result<Scenario, ScenarioErrors> {
    let (_folder, tree) = tree(files);
    parse(SCENE).unwrap().with_tree(tree?, &registry())
}

/// A tree with this body has these mistakes; the tree's file is number 1, after the scenario.
#[track_caller]
fn check(body: &str, expected: &[&str]) {
    let text = format!("<root BTCPP_format=\"4\">\n<BehaviorTree ID=\"A\">\n{body}\n</BehaviorTree>\n</root>\n");
    let found = match in_scene(&[("a.xml", &text)]) {
        Ok(scenario) => listed(scenario.warnings.list()),
        Err(errors) => listed(errors.list()),
    };
    assert_eq!(found, expected);
}

#[test]
fn constants_of_a_tree_are_read_as_what_their_ports_take() {
    check("<Sequence><observe_scene/><list_scene/><infer_functionality/><lift height_m=\"0.2\"/></Sequence>", &[]);
    check("<lift height_m=\"high\" functionality=\"{f}\"/>", &["1:3:17 port \"height_m\": expected a number, found \"high\""]);
    check("<lift height_m=\"{share}\" functionality=\"{f}\"/>", &[]);
}

#[test]
fn mistakes_are_shown_where_they_stand_in_the_xml() {
    check(
        "<Sequence>\n  <obsrve_scene/>\n</Sequence>",
        &["1:4:3 unknown node \"obsrve_scene\" | did you mean \"observe_scene\"?"],
    );
    check("<is_held hight=\"1\"/>", &["1:3:10 \"is_held\" has no port \"hight\" | it has no ports"]);
    check(
        "<Timeout msec=\"90000\"><is_held/></Timeout>",
        &[
            "1:3:1 \"timeout\" changes nothing: \"is_held\" is done within a tick | remove it",
            "1:3:16 \"timeout\" of 90 s can never run out: the whole run ends after 60 s | give `limits: {timeout_secs: ...}` more, or this less",
        ],
    );
}

#[test]
fn mistakes_of_an_included_file_are_shown_in_it() {
    let main = "<root BTCPP_format=\"4\" main_tree_to_execute=\"A\">\n<include path=\"parts/b.xml\"/>\n\
                <BehaviorTree ID=\"A\"><SubTree ID=\"B\"/></BehaviorTree>\n</root>";
    let part = |body: &str| format!("<root BTCPP_format=\"4\">\n<BehaviorTree ID=\"B\">\n{body}\n</BehaviorTree></root>");
    let scenario = in_scene(&[("a.xml", main), ("parts/b.xml", &part("<is_held/>"))]).unwrap();
    assert_eq!(scenario.sources.len(), 3);
    let errors = in_scene(&[("a.xml", main), ("parts/b.xml", &part("<is_hld/>"))]).unwrap_err();
    assert_eq!(listed(errors.list()), ["2:3:1 unknown node \"is_hld\" | did you mean \"is_held\"?"]);
    assert!(errors.to_string().contains("parts/b.xml:3:1"), "{errors}");
    let (_folder, read) = tree(&[("a.xml", main), ("parts/b.xml", &part("<is_held></is_hld>"))]);
    let errors = read.unwrap_err();
    assert!(
        errors.list().iter().any(|mistake| mistake.place.file == 1) && errors.to_string().contains("parts/b.xml:3:10"),
        "{errors}"
    );
    let (_folder, read) = tree(&[("a.xml", main)]);
    assert!(read.unwrap_err().to_string().contains("a.xml:2:"));
}

#[test]
fn files_that_cannot_be_read_are_named() {
    let errors = XmlTree::load(Path::new("nowhere.xml")).unwrap_err();
    assert!(errors.to_string().starts_with("cannot read \"nowhere.xml\""), "{errors}");
}

#[test]
fn a_tree_becomes_yaml_that_a_scenario_can_hold() {
    let xml = "<root BTCPP_format=\"4\" main_tree_to_execute=\"A\">\n<BehaviorTree ID=\"A\"><Sequence><observe_scene/><list_scene/>\
               <infer_functionality/><Delay delay_msec=\"1500\"><SubTree ID=\"B\" up=\"0.2\" functionality=\"{functionality}\"/></Delay>\
               </Sequence></BehaviorTree>\n<BehaviorTree ID=\"B\"><lift height_m=\"{up}\" _skipIf=\"up &lt; 0.1\" name=\"a lift\"/>\
               </BehaviorTree></root>";
    let (_folder, tree) = tree(&[("a.xml", xml)]);
    let yaml = tree.unwrap().to_yaml(registry().models()).unwrap();
    let scene = SCENE.split("blackboard").next().unwrap();
    let scenario = parse(&format!("{scene}{yaml}")).unwrap_or_else(|errors| panic!("{yaml}\n{errors}"));
    assert_eq!(scenario.warnings.count(Severity::Warning), 0, "{}", scenario.warnings);
    assert_eq!(
        yaml,
        "\
tree:
  sequence:
    - observe_scene
    - list_scene
    - infer_functionality
    - delay:
        secs: 1.5
        do:
          subtree: {tree: B, up: 0.2, functionality: \"{functionality}\"}
subtrees:
  B:
    open: true
    do:
      lift: {name: \"a lift\", height_m: \"{up}\", skip_if: \"up < 0.1\"}
"
    );
}

#[test]
fn a_port_with_a_word_of_scenarios_is_refused_where_it_stands() {
    let xml = "<root BTCPP_format=\"4\"><BehaviorTree ID=\"A\">\n<turn do=\"1\"/></BehaviorTree></root>";
    let (_folder, tree) = tree(&[("a.xml", xml)]);
    let errors = tree.unwrap().to_yaml(registry().models()).unwrap_err();
    assert_eq!(listed(errors.list()), ["2:7 port \"do\" means something else in a scenario; rename the port"]);
}

#[test]
fn what_xml_cannot_say_is_refused_where_the_scenario_says_it() {
    let scenario =
        parse(&SCENE.replace("tree: is_held", "tree:\n  retry:\n    attempts: 2\n    on: [slipped]\n    do: is_held")).unwrap();
    let errors = scenario.to_xml(registry().models()).unwrap_err();
    let listed = listed(errors.list());
    assert_eq!(listed.len(), 2, "{listed:?}");
    assert!(listed[0].starts_with("5:21 \"share\": BehaviorTree.CPP has no blackboard entries"), "{listed:?}");
    assert!(listed[1].starts_with("9:5 \"on\": BehaviorTree.CPP has no port like this"), "{listed:?}");
}

#[test]
fn a_scenario_comes_back_from_xml() {
    let text = SCENE.replace("blackboard: {share: 0.3}\n", "").replace(
        "tree: is_held",
        "tree:\n  sequence: [{inverter: is_held}, {retry: {attempts: 2, do: {timeout: {secs: 2, do: {delay: {secs: 1, do: is_held}}}}}}]",
    );
    let scenario = parse(&text).unwrap();
    let xml = scenario.to_xml(registry().models()).unwrap();
    let (_folder, tree) = tree(&[("a.xml", &xml)]);
    let tree = tree.unwrap();
    let yaml = tree.to_yaml(registry().models()).unwrap();
    assert!(yaml.contains("retry:\n        attempts: 2\n        do:\n          timeout:\n            secs: 2.0\n"), "{yaml}");
    let back = Scenario::parse(Path::new("a.yaml"), text.clone(), &Settings::default(), &registry(), &vocabulary());
    assert!(back.unwrap().with_tree(tree, &registry()).is_ok());
}

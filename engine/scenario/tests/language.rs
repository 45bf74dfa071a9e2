//! What the language offers beside plain values: included files, parameters, degrees, conditions, a blackboard that begins with
//! entries, and what a tree says against itself.
#![allow(clippy::unwrap_used, reason = "tests fail by panicking")]

mod support;

use sfg_scenario::{ObjectShape, Scenario, ScenarioErrors, Settings, Severity};
use sfg_tree::{Literal, PortSpec, PortValue, Registry, When};
use std::path::Path;
use support::{VALID, check_text, listed, parse, registry, vocabulary, with};

/// The scenario in `main.yaml` among these files: name and text.
fn load(files: &[(&str, &str)], set: &[&str], environment: &[(&str, &str)]) -> Result<Scenario, ScenarioErrors> {
    let folder = tempfile::tempdir().unwrap();
    for (name, text) in files {
        std::fs::create_dir_all(folder.path().join(name).parent().unwrap()).unwrap();
        std::fs::write(folder.path().join(name), text).unwrap();
    }
    let assignments: Vec<String> = set.iter().map(|text| (*text).to_owned()).collect();
    let environment = environment.iter().map(|(name, value)| ((*name).to_owned(), (*value).to_owned()));
    let settings = Settings::new(&assignments, environment).unwrap();
    Scenario::load(&folder.path().join("main.yaml"), &settings, &registry(), &vocabulary())
}

/// Mistakes of `main.yaml`; those of other files have the file's number before them.
#[track_caller]
fn check_files(files: &[(&str, &str)], expected: &[&str]) {
    let errors = load(files, &[], &[]).expect_err("the scenario is accepted");
    assert_eq!(listed(errors.list()), expected, "{errors}");
}

const MAIN: &str = "version: 1
robot: curi
include: [part.yaml]
scene: {objects: []}
tree: {subtree: look}
";
const PART: &str = "subtrees:
  look: {do: observe_scene}
";

#[test]
fn an_included_file_gives_what_the_including_one_does_not_say() {
    let part = "limits: {timeout_secs: 7, max_joint_speed_fraction: 0.2}
plugins: {llm: openai, driver: sim}
scene:
  friction: 0.3
  objects:
    - cup: {mesh: scan/cup.obj, hulls: cup_hulls.obj, mass_kg: 0.2, at: {x_m: 0.5, y_m: 0}}
    - bowl: {model: bowl, at: {x_m: 0.5, y_m: 0.4}}
subtrees:
  look: {do: observe_scene}
";
    let main = format!("{MAIN}limits: {{timeout_secs: 9}}\nplugins: {{llm: knowledge}}\n")
        .replace("part.yaml", "parts/part.yaml")
        .replace(
            "objects: []",
            "objects: [{mug: {model: mug, at: {x_m: 0.6, y_m: 0}}}, {bowl: {model: bowl, at: {x_m: 0.9, y_m: 0}}}]",
        );
    let scenario = load(&[("main.yaml", &main), ("parts/part.yaml", part)], &[], &[]).unwrap_or_else(|errors| panic!("{errors}"));
    assert_eq!((scenario.limits.timeout_secs, scenario.limits.max_joint_speed_fraction), (9.0, 0.2));
    assert_eq!(scenario.plugins.llm.as_ref().unwrap().name, "knowledge");
    assert_eq!(scenario.plugins.driver.as_ref().unwrap().name, "sim");
    assert_eq!(scenario.scene.friction.min, 0.3);
    let objects: Vec<(&str, f64)> =
        scenario.scene.objects.iter().map(|object| (object.name.value.as_str(), object.placement.x_m.min)).collect();
    assert_eq!(objects, [("cup", 0.5), ("mug", 0.6), ("bowl", 0.9)]);
    let ObjectShape::Scanned { mesh, .. } = &scenario.scene.objects[0].shape else { panic!("no scan") };
    assert!(scenario.resolve(mesh).ends_with("parts/scan/cup.obj"), "{:?}", scenario.resolve(mesh));
    assert!(scenario.build_tree(&registry()).is_ok());
    assert!(scenario.full_text().starts_with(&main) && scenario.full_text().ends_with(part));
}

#[test]
fn a_mistake_in_an_included_file_is_shown_there() {
    let errors = load(&[("main.yaml", MAIN), ("part.yaml", "subtrees:\n  look: {do: observ_scene}\n")], &[], &[]).unwrap_err();
    let shown = errors.to_string();
    assert!(shown.contains("part.yaml:2:14\n  |\n2 |   look: {do: observ_scene}\n  |              ^^^^^^^^^^^^\n"), "{shown}");
    check_files(&[("main.yaml", MAIN), ("part.yaml", "subtrees: [\n")], &["1:1:11 unclosed bracket '['"]);
}

#[test]
fn includes_that_cannot_be_followed() {
    check_files(
        &[("main.yaml", MAIN)],
        &[
            "3:11 cannot read \"part.yaml\": No such file or directory (os error 2) | the path is relative to the file that includes it",
        ],
    );
    let main = MAIN.replace("[part.yaml]", "[part.yaml, ./part.yaml, 3]");
    check_files(
        &[("main.yaml", &main), ("part.yaml", PART)],
        &["3:22 \"./part.yaml\" is included twice | it is first included in line 3", "3:35 include: expected a text, found 3"],
    );
    check_files(
        &[("main.yaml", MAIN), ("part.yaml", "include: [other.yaml]"), ("other.yaml", "include: [part.yaml]")],
        &["2:1:11 \"part.yaml\" includes itself: main.yaml -> part.yaml -> other.yaml -> part.yaml"],
    );
    check_files(
        &[("main.yaml", &format!("{MAIN}parts: []")), ("part.yaml", "include: [main.yaml]")],
        &["1:1:11 \"main.yaml\" includes itself: main.yaml -> part.yaml -> main.yaml"],
    );
    let chain: Vec<(String, String)> = (0..20)
        .map(|n| (format!("{n}.yaml"), format!("include: [{}.yaml]", n + 1)))
        .chain([("20.yaml".into(), PART.into())])
        .collect();
    let main = MAIN.replace("part.yaml", "0.yaml");
    let files: Vec<(&str, &str)> =
        chain.iter().map(|(name, text)| (name.as_str(), text.as_str())).chain([("main.yaml", main.as_str())]).collect();
    check_files(&files, &["16:1:11 files include each other more than 16 deep"]);
    check_files(&[("main.yaml", &MAIN.replace("part.yaml", ".")), ("part.yaml", "")], &["3:11 cannot read \".\": it is no file"]);
}

#[test]
fn an_included_file_holds_parts_and_no_scenario() {
    check_files(
        &[("main.yaml", MAIN), ("part.yaml", &format!("{PART}robot: curi\n"))],
        &[
            "1:3:1 an included file has no key \"robot\" | known here are version, description, include, parameters, plugins, limits, subtrees, scene",
        ],
    );
}

#[test]
fn two_included_files_must_not_contradict_each_other() {
    let main = MAIN.replace("[part.yaml]", "[part.yaml, other.yaml]");
    let help = "give it in the including file, or rename one of the two";
    check_files(
        &[("main.yaml", &main), ("part.yaml", PART), ("other.yaml", "subtrees:\n  look: {do: is_held}\n")],
        &[&format!("2:2:3 two included files give \"look\": part.yaml and other.yaml | {help}")],
    );
    // The same file by two ways says one thing.
    let files = [
        ("main.yaml", main.as_str()),
        ("part.yaml", "include: [third.yaml]"),
        ("other.yaml", "include: [third.yaml]"),
        ("third.yaml", PART),
    ];
    assert!(load(&files, &[], &[]).is_ok());
}

/// The valid scenario, where `lift` is given `value` and these parameters are declared.
fn with_parameters(parameters: &str, value: &str) -> String {
    with("{height_m: \"{height}\"}", value).replace("in: [functionality, {height: 0.2}]", "in: [functionality]") + parameters
}

/// The literal that `lift` gets.
#[track_caller]
fn check_value(parameters: &str, written: &str, set: &[&str], expected: impl Into<Literal>) {
    let text = with_parameters(parameters, &format!("{{height_m: {written}}}"));
    let scenario = load(&[("main.yaml", &text)], set, &[("FROM_OUTSIDE", "0.4")]).unwrap_or_else(|errors| panic!("{errors}"));
    let lift = &scenario.tree.subtrees[0].root.children[0];
    assert_eq!(lift.ports[0].value, PortValue::Literal(expected.into()));
}

#[test]
fn parameters_keep_their_type() {
    check_value("parameters: {up_m: 0.12}", "\"${up_m}\"", &[], 0.12);
    check_value("parameters: {up_m: 0.12}", "\"${up_m}\"", &["up_m=0.3"], 0.3);
    check_value("parameters: {up_m: 0.12}", "\"${up_m}\"", &["up_m=0"], 0_i64);
    check_value("parameters: {a: 0.2, up_m: \"${a}\"}", "\"${up_m}\"", &["a=0.3"], 0.3);
    check_value("", "\"${FROM_OUTSIDE:-0.2}\"", &[], 0.4);
    check_value("", "\"${FROM_ELSEWHERE:-0.2}\"", &[], 0.2);
    check_value("", "\"${FROM_OUTSIDE:-0.2}\"", &["FROM_OUTSIDE=0.1"], 0.1);
}

#[test]
fn parameters_become_part_of_texts() {
    let text =
        with("instruction: Pour the water from the bottle into the bowl.", "instruction: Pour ${n} ${what:-cup}s, $${n} and $")
            + "parameters: {n: 2}";
    let said = |set: &[&str]| load(&[("main.yaml", &text)], set, &[]).unwrap().instruction.unwrap().value.as_str().to_owned();
    assert_eq!(said(&[]), "Pour 2 cups, ${n} and $");
    assert_eq!(said(&["n=3", "what=jug"]), "Pour 3 jugs, ${n} and $");
    let scenario = load(&[("main.yaml", &text)], &["n=3"], &[]).unwrap();
    assert_eq!(scenario.settings.iter().collect::<Vec<_>>(), [(&"n".to_owned(), &"3".to_owned())]);
}

#[track_caller]
fn check_parameters(parameters: &str, value: &str, set: &[&str], expected: &[&str]) {
    let errors = load(&[("main.yaml", &with_parameters(parameters, value))], set, &[]).expect_err("the scenario is accepted");
    assert_eq!(listed(errors.list()), expected, "{errors}");
}

#[test]
fn mistakes_with_parameters() {
    let used = "{height_m: \"${up_m}\"}";
    check_parameters(
        "parameters: {upm: 0.1}",
        used,
        &[],
        &[
            "36:28 unknown parameter \"up_m\" | did you mean \"upm\"?",
            "45:14 parameter \"upm\" is not used | write `${upm}` where it is meant",
        ],
    );
    check_parameters(
        "",
        used,
        &[],
        &["36:28 unknown parameter \"up_m\" | declare it under `parameters`, or give a default: `${up_m:-value}`"],
    );
    check_parameters(
        "parameters: {up_m: 0.1}",
        used,
        &["upm=1"],
        &["45:13 --set upm: the scenario has no parameter \"upm\" | did you mean \"up_m\"?"],
    );
    check_parameters(
        "parameters: {up_m: 0.1, b: 1}",
        used,
        &["b=2"],
        &["45:25 --set b: the scenario does not use parameter \"b\" | write `${b}` where it is meant"],
    );
    check_parameters("parameters: {up_m: tall}", used, &[], &["45:20 port \"height_m\": expected a number, found \"tall\""]);
    check_parameters(
        "parameters: {up_m: 1}",
        used,
        &["up_m=tall"],
        &["36:28 port \"height_m\": expected a number, found \"tall\""],
    );
    check_parameters(
        "parameters: {up_m: 1}",
        used,
        &["up_m=a: b"],
        &["45:14 --set up_m: expected a value, found a map | quote a text: --set 'up_m=\"...\"'"],
    );
    check_parameters("parameters: {up_m:}", used, &[], &["45:14 parameter \"up_m\": expected a default value, found nothing"]);
    check_parameters(
        "parameters: {up m: 1, up_m: 0.1}",
        used,
        &[],
        &["45:14 \"up m\" is no name of a parameter | a name has letters, digits and underscores"],
    );
    check_parameters(
        "",
        "{height_m: \"${up_m\"}",
        &[],
        &["36:28 \"${up_m\" does not end with \"}\" | write `${name}`, or `$${` for the letters themselves"],
    );
    check_parameters(
        "parameters: {up_m: [1, 2]}",
        "{height_m: \"a ${up_m}\"}",
        &[],
        &["45:20 parameter \"up_m\" is a list of 2 and cannot stand inside a text"],
    );
}

#[test]
fn parameters_between_braces_need_quotes() {
    let check = |to: &str, expected: &str| check_text(&with("height_m: 0.75", to), &[expected]);
    let message = "a parameter between braces or brackets needs quotes";
    check("height_m: ${up_m}", &format!("6:21 {message} | write \"${{up_m}}\""));
    check("height_m: [0.7, ${up_m}]", &format!("6:27 {message} | write \"${{up_m}}\""));
}

#[test]
fn parameters_are_no_bombs() {
    let list = |of: &str| format!("[{}]", [of; 30].join(", "));
    let bomb = format!("parameters: {{a: {}, b: {}, c: {}}}", list("1"), list("\"${a}\""), list("\"${b}\""));
    let errors = load(&[("main.yaml", &with_parameters(&bomb, "{height_m: \"${c}\"}"))], &[], &[]).unwrap_err();
    assert!(errors.to_string().contains("parameters stand for more than 10000 values or 16 MB"), "{errors}");
    let bomb = format!("parameters: {{a: {}, b: \"{}\", c: \"{}\"}}", "x".repeat(5000), "${a}".repeat(5000), "${b}".repeat(5000));
    let errors = load(&[("main.yaml", &with_parameters(&bomb, "{height_m: \"${c}\"}"))], &[], &[]).unwrap_err();
    assert!(errors.to_string().contains("parameters stand for more than 10000 values or 16 MB"), "{errors}");
}

#[test]
fn assignments_that_are_none() {
    let said = |set: &[&str]| {
        let assignments: Vec<String> = set.iter().map(|text| (*text).to_owned()).collect();
        Settings::new(&assignments, []).unwrap_err().to_string()
    };
    assert_eq!(said(&["height"]), "--set \"height\" is no assignment; write NAME=VALUE, for example height_m=0.15");
    assert_eq!(said(&["a b=1"]), "--set \"a b=1\" is no assignment; write NAME=VALUE, for example height_m=0.15");
    assert_eq!(said(&["a=1", "a=2"]), "--set gives \"a\" twice");
}

#[test]
fn angles_are_given_in_either_unit() {
    let yaw = |text: &str| parse(&with("yaw_deg: 90", text)).unwrap().scene.objects[1].placement.yaw_rad;
    assert_eq!(yaw("yaw_deg: 90"), yaw("yaw_rad: 1.5707963267948966"));
    assert_eq!(yaw("yaw_rad: [-1, 1]").max, 1.0);
    let check = |to: &str, expected: &str| check_text(&with("yaw_deg: 90", to), &[expected]);
    check("yaw_rad: 90", "11:64 yaw_rad: expected a number from -6.283185307179586 to 6.283185307179586, found 90");
    check("yaw_deg: 90, yaw_rad: 1", "11:55 \"yaw_deg\" and \"yaw_rad\" are one angle, given twice | remove one of the two");
    check("yaw_dag: 90", "11:55 at has no key \"yaw_dag\" | did you mean \"yaw_deg\"?");
    let plugin =
        parse(&with("{sim: {rate_hz: 250}}", "{sim: {tilt_deg: [180, 0], rate_hz: 250}}")).unwrap().plugins.driver.unwrap();
    assert_eq!(plugin.params, serde_json::json!({"tilt_rad": [std::f64::consts::PI, 0.0], "rate_hz": 250}));
    let text = with("{sim: {rate_hz: 250}}", "{sim: {tilt_deg: flat}}");
    check_text(&text, &["19:28 tilt_deg: expected degrees: a number or a list of numbers, found \"flat\""]);
}

/// A registry with nodes that the small application has not.
fn more() -> Registry<()> {
    let mut registry = registry();
    registry.step("turn", [PortSpec::setting::<f64>("angle_rad").range(-4.0, 4.0)], |_| Ok(()));
    for name in ["always_success", "always_failure", "wait", "sleep"] {
        if registry.models().iter().all(|model| model.name != name) {
            registry.action(name, [PortSpec::setting::<f64>("secs").optional()], || Nothing);
        }
    }
    registry
}

struct Nothing;

impl sfg_tree::Action<()> for Nothing {
    fn start(&mut self, _: &mut sfg_tree::Tick<'_, ()>) -> sfg_tree::Outcome {
        Ok(sfg_tree::Progress::Success)
    }
}

/// A scenario with this tree, and what follows it.
fn tree(tree: &str) -> Result<Scenario, ScenarioErrors> {
    let text = format!("version: 1\nrobot: curi\nscene: {{objects: []}}\nlimits: {{timeout_secs: 60}}\ntree:\n{tree}\n");
    Scenario::parse(Path::new("test.yaml"), text, &Settings::default(), &more(), &vocabulary())
}

/// The mistakes of a tree; its first line is number 6. Warnings begin with `~`.
#[track_caller]
fn check_tree(text: &str, expected: &[&str]) {
    let found = match tree(text) {
        Ok(scenario) => scenario.warnings.list().to_vec(),
        Err(errors) => errors.list().to_vec(),
    };
    let marks = found.iter().map(|mistake| if mistake.severity == Severity::Warning { "~" } else { "" });
    let found: Vec<String> = marks.zip(listed(&found)).map(|(mark, line)| format!("{mark}{line}")).collect();
    assert_eq!(found, expected);
}

#[test]
fn a_port_takes_degrees() {
    let value = |text: &str| tree(text).unwrap_or_else(|errors| panic!("{errors}")).tree.root.ports[0].value.clone();
    assert_eq!(value("  turn: {angle_deg: 180}"), PortValue::Literal(std::f64::consts::PI.into()));
    let subtree =
        "  subtree: {tree: swing, by_deg: 180}\nsubtrees:\n  swing:\n    in: [by_rad]\n    do: {turn: {angle_rad: \"{by_rad}\"}}";
    assert_eq!(value(subtree), PortValue::Literal(std::f64::consts::PI.into()));
    check_tree(
        "  turn: {angle_deg: \"{a}\"}",
        &["6:21 angle_deg: a blackboard key cannot be converted from degrees | give it as \"angle_rad\""],
    );
    check_tree(
        "  turn: {angle_deg: 1, angle_rad: 1}",
        &["6:10 \"angle_deg\" and \"angle_rad\" are one angle, given twice | remove one of the two"],
    );
    check_tree("  turn: {angle_deg: 300}", &["6:21 port \"angle_rad\": expected -4 to 4, found 5.235987755982989"]);
}

#[test]
fn conditions_stand_beside_ports() {
    let scenario = tree(
        "  sequence:\n    do: [{turn: {angle_deg: 1, skip_if: \"n > 3\", post: \"n = 1\"}}]\n    while: true\nblackboard: {n: 0}",
    )
    .unwrap();
    let conditions = |node: &sfg_tree::NodeSpec| node.conditions.iter().map(|c| (c.when, c.script.clone())).collect::<Vec<_>>();
    assert_eq!(conditions(&scenario.tree.root), [(When::While, "true".to_owned())]);
    let turn = &scenario.tree.root.children[0];
    assert_eq!(conditions(turn), [(When::SkipIf, "n > 3".to_owned()), (When::Post, "n = 1".to_owned())]);
    assert_eq!(scenario.place(turn.conditions[0].location).unwrap().column, 41);
    for when in When::ALL {
        let text = format!("  inverter: {{{}: \"a\", do: is_held}}\nblackboard: {{a: true}}", when.name());
        assert_eq!(conditions(&tree(&text).unwrap().tree.root), [(when, "a".to_owned())]);
    }
    check_tree("  turn: {angle_deg: 1, skip_if: 3}", &["6:33 skip_if: expected a script such as \"n > 3\", found 3"]);
    check_tree("  inverter: {skip_if: \"true\"}", &["6:3 \"inverter\" takes exactly one child, found 0"]);
    check_tree("  turn: {angle_deg: 1, skipif: \"a\"}", &["6:24 \"turn\" has no port \"skipif\" | its ports are angle_rad"]);
}

#[test]
fn a_subtree_can_share_all_keys() {
    let subtrees = "\nsubtrees:\n  look: {do: observe_scene}";
    let scenario = tree(&format!("  subtree: {{tree: look, autoremap: true, skip_if: \"true\"}}{subtrees}")).unwrap();
    assert!(scenario.tree.root.is_autoremapped && scenario.tree.root.conditions.len() == 1);
    check_tree(
        &format!("  subtree: {{tree: look, autoremap: all}}{subtrees}"),
        &["6:36 autoremap: expected true or false, found \"all\""],
    );
    check_tree(&format!("  subtree: {{tre: look}}{subtrees}"), &["6:13 subtree has no key \"tre\" | did you mean \"tree\"?"]);
}

#[test]
fn the_blackboard_begins_with_entries() {
    let turn = "  turn: {angle_rad: \"{a}\"}\n";
    let scenario = tree(&format!("{turn}blackboard: {{a: 0.5}}")).unwrap_or_else(|errors| panic!("{errors}"));
    assert_eq!(scenario.tree.entries[0].1, Literal::Float(0.5));
    check_tree(&format!("{turn}blackboard: {{a: wide}}"), &["7:17 port \"a\": expected a number, found \"wide\""]);
    check_tree(
        &format!("{turn}blackboard: {{a: 0.5, b: 1}}"),
        &["~7:22 nobody reads blackboard key \"b\" | did you mean \"a\"?"],
    );
    check_tree(
        &format!("{turn}blackboard: {{a: 0.5, 1b: 1}}"),
        &["7:22 \"1b\" is no blackboard key | a key has letters, digits and underscores"],
    );
    check_tree(&format!("{turn}blackboard: {{a: }}"), &["7:14 blackboard entry \"a\": expected a value, found nothing"]);
}

#[test]
fn nodes_that_are_never_reached() {
    let wall = |before: &str, word: &str| {
        format!("is never reached: {before:?} before it can never {word} | remove it, or put it first")
    };
    check_tree(
        "  fallback: [is_held, always_success, observe_scene]",
        &[&format!("6:39 \"observe_scene\" {}", wall("always_success", "fail"))],
    );
    check_tree(
        "  fallback: [{force_success: is_held}, observe_scene]",
        &[&format!("6:40 \"observe_scene\" {}", wall("force_success", "fail"))],
    );
    check_tree(
        "  sequence: [always_failure, observe_scene, is_held]",
        &[&format!("6:30 \"observe_scene\" {}", wall("always_failure", "succeed"))],
    );
    check_tree(
        "  sequence: [{force_failure: is_held}, observe_scene]",
        &[&format!("6:40 \"observe_scene\" {}", wall("force_failure", "succeed"))],
    );
    check_tree(
        "  sequence: [{repeat: wait}, observe_scene]",
        &[&format!("6:30 \"observe_scene\" {}", wall("repeat", "succeed"))],
    );
    check_tree(
        "  sequence: [{subtree: stop}, observe_scene]\nsubtrees:\n  stop: {do: {fallback: [always_failure, always_failure]}}",
        &[&format!("6:31 \"observe_scene\" {}", wall("stop", "succeed"))],
    );
    check_tree("  fallback: [{force_success: {do: is_held, skip_if: \"a\"}}, observe_scene]\nblackboard: {a: true}", &[]);
    check_tree("  sequence: [{repeat: {times: 3, do: wait}}, observe_scene]", &[]);
    check_tree("  fallback: [{inverter: is_held}, {retry: {attempts: 2, do: is_held}}, observe_scene]", &[]);
}

#[test]
fn nodes_that_change_nothing() {
    check_tree(
        "  retry: {attempts: 3, do: always_success}",
        &["~6:3 \"retry\" changes nothing: \"always_success\" never fails | remove it"],
    );
    check_tree(
        "  repeat: {times: 1, do: wait}",
        &["~6:3 \"repeat\" changes nothing: \"wait\" is done once without it | remove it"],
    );
    check_tree(
        "  timeout: {secs: 3, do: observe_scene}",
        &["~6:3 \"timeout\" changes nothing: \"observe_scene\" is done within a tick | remove it"],
    );
    check_tree(
        "  lift:",
        &[
            "6:3 port \"functionality\" reads blackboard key \"functionality\", which no earlier node writes | infer_functionality writes it; put it earlier in the tree",
        ],
    );
    check_tree(
        "  observe_scene:",
        &["~6:3 nothing follows \"observe_scene\" and its colon | write `observe_scene` alone, or indent what belongs to it"],
    );
}

#[test]
fn times_that_never_run_out() {
    let whole = "the whole run ends after 60 s | give `limits: {timeout_secs: ...}` more, or this less";
    let inner = "the timeout around it, in line 6, ends after 5 s | give the timeout around it more, or this less";
    check_tree("  timeout: {secs: 90, do: wait}", &[&format!("6:19 \"timeout\" of 90 s can never run out: {whole}")]);
    check_tree("  sleep: {secs: 90}", &[&format!("6:17 \"sleep\" of 90 s can never end: {whole}")]);
    check_tree(
        "  timeout: {secs: 5, do: {retry: {attempts: 2, do: {timeout: {secs: 7, do: wait}}}}}",
        &[&format!("6:69 \"timeout\" of 7 s can never run out: {inner}")],
    );
    check_tree(
        "  timeout: {secs: 5, do: {subtree: calm}}\nsubtrees:\n  calm: {do: {sleep: {secs: 6}}}",
        &[&format!("8:29 \"sleep\" of 6 s can never end: {inner}")],
    );
    // One user leaves it enough.
    check_tree(
        "  sequence: [{timeout: {secs: 5, do: {subtree: calm}}}, {subtree: calm}]\nsubtrees:\n  calm: {do: {sleep: {secs: 6}}}",
        &[],
    );
    check_tree("  timeout: {secs: 5, do: {sleep: {secs: 5}}}", &[]);
}

#[test]
fn subtrees_and_keys_that_nobody_uses() {
    check_tree(
        "  observe_scene\nsubtrees:\n  look: {do: observe_scene}",
        &["~8:3 subtree \"look\" is not used | write `subtree: look` where it is meant, or remove it"],
    );
    check_tree("  observe_scene: {observation: \"{seen}\"}", &["~6:32 nobody reads blackboard key \"seen\" | remove it"]);
    check_tree("  observe_scene: {observation: \"{seen}\", on_success: \"last = seen\"}", &[]);
    check_tree("  wait: {secs: \"{pause}\"}", &["~6:16 nobody writes blackboard key \"pause\" | remove it"]);
    check_tree(
        "  subtree: look\nsubtrees:\n  look:\n    in: [speed]\n    out: [observatoin]\n    do: observe_scene",
        &[
            "~9:10 nothing in subtree \"look\" reads its port \"speed\" | remove it",
            "~10:11 nothing in subtree \"look\" writes its port \"observatoin\" | did you mean \"observation\"?",
        ],
    );
    check_tree(
        "  subtree: do\nsubtrees:\n  look:\n    in: []\n  do: observe_scene",
        &[
            "9:5 subtree \"look\" needs key \"do\"",
            "10:3 no subtree can be called \"do\" | indent it to make it a key of the subtree above",
        ],
    );
}

#[test]
fn warnings_are_shown_with_the_errors() {
    let errors = parse(&(VALID.replace("arm: left", "arm: both") + "parameters: {a: 1}\n")).unwrap_err();
    assert_eq!((errors.count(Severity::Error), errors.count(Severity::Warning)), (1, 1));
    assert!(errors.to_string().contains("\nwarning: parameter \"a\" is not used\n"), "{errors}");
}

#[test]
fn lines_that_do_not_fit_are_found_before_the_parser_stops() {
    let fit = "keys of one map, and items of one list, begin in one column";
    let check = |from: &str, to: &str, expected: &str| check_text(&with(from, to), &[expected]);
    check("  table:", " table:", &format!("6:2 the line begins in column 2, where column 3 fits | {fit}"));
    check("    - list_scene", "   - list_scene", &format!("23:4 the line begins in column 4, where column 5 fits | {fit}"));
    check("  grounder:", "   grounder:", &format!("16:4 the line begins in column 4, where column 3 fits | {fit}"));
    check("        attempts: 3", "      attempts: 3", &format!("26:7 the line begins in column 7, where column 9 fits | {fit}"));
    check("arm: left", "left", "4:1 the line has no key | write `key: value`");
}

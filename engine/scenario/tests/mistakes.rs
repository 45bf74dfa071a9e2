//! Every kind of bad input: one clear message with place and remedy, never a panic.
#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "tests fail by panicking and say what they leave out")]

mod support;

use rand::{Rng, SeedableRng};
use sfg_scenario::{Hollow, MAX_FILE_BYTES, ObjectShape, Scenario, Settings, Severity};
use std::path::Path;
use support::{VALID, check_text, parse, registry, vocabulary, with};

/// Line, column, message and help of each mistake of the valid scenario with `from` replaced by `to`.
#[track_caller]
fn check(from: &str, to: &str, expected: &[&str]) {
    check_text(&with(from, to), expected);
}

#[test]
fn the_valid_scenario_is_accepted_and_means_what_it_says() {
    let scenario = parse(VALID).unwrap_or_else(|errors| panic!("{errors}"));
    assert_eq!(scenario.scene.objects.len(), 3);
    assert!((scenario.scene.objects[0].placement.x_m.at(0.5) - 0.7).abs() < 1e-12);
    assert_eq!(scenario.scene.objects[1].placement.yaw_rad.min, std::f64::consts::FRAC_PI_2);
    assert_eq!(scenario.plugins.pose_generator.as_ref().unwrap().params, serde_json::json!({"n_candidates": 15}));
    assert_eq!(scenario.success.truth[1].args_json(), serde_json::json!({"object": "bottle", "within_m": 0.05}));
    let tree = scenario.build_tree(&registry()).unwrap();
    let paths: Vec<String> = tree.definition().map(|node| tree.path(node.id)).collect();
    assert_eq!(paths[7], "sequence/retry/grasp_and_lift/sequence/lift");
    assert_eq!(tree.n_nodes(), 11);
    let lift = tree.definition().nth(7).unwrap();
    assert_eq!(scenario.place(lift.location).unwrap().line, 36);
}

#[test]
fn an_error_is_shown_with_its_line() {
    let errors = parse(&with("- observe_scene", "- observ_scene")).unwrap_err();
    let expected = "error: unknown node \"observ_scene\"
  --> test.yaml:22:7
   |
22 |     - observ_scene
   |       ^^^^^^^^^^^^
   = help: did you mean \"observe_scene\"?
";
    assert!(errors.to_string().contains(expected), "{errors}");
}

#[test]
fn all_mistakes_are_reported_at_once() {
    let text = with("attempts: 3", "atempts: 3").replace("robot: curi", "robot: cury").replace("model: bowl", "model: bowel");
    check_text(
        &text,
        &[
            "3:8 unknown robot \"cury\" | did you mean \"curi\"?",
            "11:21 unknown object model \"bowel\" | did you mean \"bowl\"?",
            "25:7 \"retry\" needs port \"attempts\": a whole number",
            "26:9 \"retry\" has no port \"atempts\" | did you mean \"attempts\"?",
        ],
    );
}

#[test]
fn unknown_keys() {
    check("instruction:", "instrucion:", &["13:1 scenario has no key \"instrucion\" | did you mean \"instruction\"?"]);
    check(
        "filled_grains:",
        "filled_grain:",
        &["10:31 object \"bottle\" has no key \"filled_grain\" | did you mean \"filled_grains\"?"],
    );
    check(
        "timeout_secs: 60",
        "timeout: 60",
        &["44:10 limits has no key \"timeout\" | known here are timeout_secs, max_joint_speed_fraction, workspace"],
    );
    check(
        "height_scale",
        "width_scale",
        &[
            "10:51 object \"bottle\" has no key \"width_scale\" | known here are model, mesh, hulls, mass_kg, hollow, at, filled_grains, colour, height_scale, radius_scale, mass_scale",
        ],
    );
}

#[test]
fn a_scan_is_bored_as_asked() {
    let hollow = |value: &str| with("colour: yellow", &format!("hollow: {value}"));
    let scenario = parse(&hollow("{mouth_m: 0.15, wall_m: 0.004}")).unwrap_or_else(|errors| panic!("{errors}"));
    let ObjectShape::Scanned { hollow: Some(found), .. } = scenario.scene.objects[2].shape else { panic!("no hollow") };
    assert_eq!(found, Hollow { mouth_m: 0.15, wall_m: 0.004 });
    let check = |value: &str, expected: &str| check_text(&hollow(value), &[expected]);
    check("{mouth_m: 0.15}", "12:85 hollow needs key \"wall_m\"");
    check("{mouth_m: 3, wall_m: 0.004}", "12:94 mouth_m: expected a number from 0.023 to 1, found 3");
    check("{mouth_m: 0.15, wall_m: 0.001}", "12:108 wall_m: expected a number from 0.003 to 0.05, found 0.001");
    check("{mouth: 0.15, mouth_m: 0.15, wall_m: 0.004}", "12:85 hollow has no key \"mouth\" | known here are mouth_m, wall_m");
    check("yes", "12:84 hollow: expected a map, found \"yes\"");
}

#[test]
fn only_scans_are_bored() {
    check(
        "filled_grains: 150",
        "hollow: {mouth_m: 0.1, wall_m: 0.004}",
        &["10:31 object \"bottle\": \"hollow\" belongs to `mesh`, not to `model`"],
    );
}

#[test]
fn wrong_types() {
    check(
        "filled_grains: 150",
        "filled_grains: many",
        &["10:46 filled_grains: expected a whole number from 0 to 2000, found \"many\""],
    );
    check(
        "attempts: 3",
        "attempts: often",
        &["26:19 port \"attempts\": expected a whole number, found \"often\" | How often the child is tried; -1 without end."],
    );
    check("fraction: 0.8", "fraction: [1]", &["29:56 port \"fraction\": expected a number, found a list of 1"]);
    check("version: 1", "version: 2", &["2:10 version: expected 1, found 2"]);
    check("arm: left", "arm: both", &["4:6 arm: expected left or right, found \"both\""]);
    check("yaw_deg: any", "yaw_deg: some", &["10:123 yaw_deg: expected degrees, [min, max] or any, found \"some\""]);
    check(
        "on: [lift_failed, slipped]",
        "on: slipped",
        &["27:13 port \"on\": expected a list, each item a text, found \"slipped\" | Reasons to try again; any when empty."],
    );
    check(
        "- fill_seen",
        "- [fill_seen]",
        &["43:7 predicate: expected a name, or one name with its arguments: `- name: {argument: value}`, found a list of 1"],
    );
    check(
        "llm: knowledge",
        "llm: 3",
        &["15:8 llm plugin: expected a name, or one name with its parameters: `{name: {parameter: value}}`, found 3"],
    );
}

#[test]
fn unknown_names() {
    check("llm: knowledge", "llm: knowlege", &["15:8 unknown llm plugin \"knowlege\" | did you mean \"knowledge\"?"]);
    check("{analytic: {n", "{analitic: {n", &["17:20 unknown pose_generator plugin \"analitic\" | did you mean \"analytic\"?"]);
    check(
        "on: [lift_failed, slipped]",
        "on: [lift_faild, slipped]",
        &["27:14 unknown failure reason \"lift_faild\" | did you mean \"lift_failed\"?"],
    );
    check("- fill_seen", "- fil_seen", &["43:7 unknown predicate \"fil_seen\" | did you mean \"fill_seen\"?"]);
    check(
        "{subtree: grasp_and_lift}",
        "{subtree: grasp_and_lft}",
        &[
            "28:23 unknown subtree \"grasp_and_lft\" | did you mean \"grasp_and_lift\"?",
            "31:3 subtree \"grasp_and_lift\" is not used | write `subtree: grasp_and_lift` where it is meant, or remove it",
        ],
    );
    check("from: [mug]", "from: [mugg]", &["8:30 unknown object model \"mugg\" | did you mean \"mug\"?"]);
    check(
        "sequence:\n    - observe",
        "sequense:\n    - observe",
        &["21:3 unknown node \"sequense\" | did you mean \"sequence\"?"],
    );
}

#[test]
fn ports() {
    check(", fraction: 0.8}", "}", &["29:7 \"pour\" needs port \"fraction\": a number"]);
    check("fraction: 0.8", "fraction: 1.8", &["29:56 port \"fraction\": expected 0 to 1, found 1.8"]);
    check(
        "fraction: 0.8",
        "frction: 0.8",
        &[
            "29:7 \"pour\" needs port \"fraction\": a number",
            "29:46 \"pour\" has no port \"frction\" | did you mean \"fraction\"?",
        ],
    );
    check("fraction: 0.8", "fraction: .nan", &["29:56 port \"fraction\": expected a finite number, found NaN"]);
    check(
        "fraction: 0.8",
        "fraction: \"{inventory}\"",
        &["29:56 port \"fraction\" uses blackboard key \"inventory\" as f64, but sequence/list_scene writes it as Inventory"],
    );
    check(
        "fraction: 0.8",
        "fraction: \"{lifted}\"",
        &["29:56 port \"fraction\" reads blackboard key \"lifted\", which no earlier node writes | did you mean \"{lifted_m}\"?"],
    );
    check(
        "fraction: 0.8",
        "fraction: \"{lifted_m} \"",
        &["29:56 port \"fraction\": blanks around the key \"{lifted_m}\"; write it without them"],
    );
    check(
        "{functionality.target}",
        "{functionality.targt}",
        &["29:20 port \"into\": Functionality has no field \"targt\" | did you mean \"target\"?"],
    );
    check(
        "{functionality.target}",
        "{functionality}",
        &[
            "29:20 port \"into\" uses blackboard key \"functionality\" as ObjectRef, but sequence/infer_functionality writes it as Functionality",
        ],
    );
    check(
        "{functionality.target}",
        "bowl",
        &["29:20 port \"into\": expected a blackboard key such as \"{into}\", found \"bowl\""],
    );
    check(
        "{functionality.target}",
        "{function.target}",
        &["29:20 port \"into\" reads blackboard key \"function.target\", which no earlier node writes"],
    );
    check(
        "{height: 0.2}]\n    out: [lifted_m]",
        "{height: 0.2}, lifted_m]",
        &[
            "32:40 nothing in subtree \"grasp_and_lift\" reads its port \"lifted_m\" | remove it",
            "35:11 port \"lifted_m\" writes blackboard key \"lifted_m\", which the subtree declares as an input | declare it under `out` or `inout`, or write another key",
        ],
    );
    check(
        "- list_scene\n",
        "- is_held\n",
        &[
            "24:7 port \"inventory\" reads blackboard key \"inventory\", which no earlier node writes | list_scene writes it; put it earlier in the tree",
        ],
    );
}

#[test]
fn shapes_of_nodes() {
    check("- inverter: is_held", "- inverter: [is_held]", &["37:21 inverter: expected a node, found a list of 1"]);
    check("- inverter: is_held", "- inverter", &["37:11 \"inverter\" takes exactly one child, found 0"]);
    check(
        "- observe_scene",
        "- observe_scene:\n      list_scene:",
        &[
            "22:7 nothing follows \"observe_scene\" and its colon | write `observe_scene` alone, or indent what belongs to it",
            "23:7 node: expected one name, found \"list_scene\" beside \"observe_scene\" | begin it with `- ` to make it the next node, or indent it to make it a port",
        ],
    );
    check("- observe_scene", "- 3", &["22:7 node: expected the name of a node, found 3"]);
    check(
        "    - list_scene\n",
        "",
        &[
            "23:7 port \"inventory\" reads blackboard key \"inventory\", which no earlier node writes | list_scene writes it; put it earlier in the tree",
        ],
    );
    check(
        "    - list_scene\n    - infer_functionality\n",
        "    - infer_functionality\n    - list_scene\n",
        &[
            "23:7 port \"inventory\" reads blackboard key \"inventory\", which no earlier node writes | it is written later, by sequence/list_scene",
        ],
    );
    check(
        "- observe_scene",
        "- [observe_scene]",
        &["22:7 node: expected the name of a node, found a list | write `sequence:` before the list"],
    );
    check(
        "do: {subtree: grasp_and_lift}",
        "do: [is_held]",
        &["28:13 \"retry\" does one node, found a list | write `do: {sequence: [...]}`"],
    );
    check(
        "        do: {subtree: grasp_and_lift}\n",
        "",
        &[
            "25:7 \"retry\" takes exactly one child, found 0",
            "30:3 subtree \"grasp_and_lift\" is not used | write `subtree: grasp_and_lift` where it is meant, or remove it",
        ],
    );
    check("{subtree: grasp_and_lift}", "{subtree: {height: 1}}", &["28:24 subtree needs key \"tree\": the name of a subtree"]);
    check(
        "{subtree: grasp_and_lift}",
        "{subtree: {tree: grasp_and_lift, heigt: 1}}",
        &["28:46 \"grasp_and_lift\" has no port \"heigt\" | did you mean \"height\"?"],
    );
    check(
        "{subtree: grasp_and_lift}",
        "{subtree: {tree: grasp_and_lift, height: tall}}",
        &["28:54 port \"height\": expected a number, found \"tall\""],
    );
    check(
        "- inverter: is_held",
        "- subtree: grasp_and_lift",
        &["37:20 subtree \"grasp_and_lift\" contains itself: grasp_and_lift -> grasp_and_lift"],
    );
}

#[test]
fn sizes_and_numbers() {
    check("mass_kg: 0.6", "mass_kg: -0.6", &["12:71 mass_kg: expected a number from 0.001 to 10, found -0.6"]);
    check("mass_kg: 0.6", "mass_kg: .nan", &["12:71 mass_kg: expected a number from 0.001 to 10, found NaN"]);
    check(
        "height_scale: [0.85, 1.15]",
        "height_scale: [1.15, 0.85]",
        &["10:65 height_scale: the range ends at 0.85 before it begins at 1.15"],
    );
    check(
        "height_scale: [0.85, 1.15]",
        "height_scale: [-1, .inf]",
        &[
            "10:66 height_scale: expected a number from 0.2 to 5, found -1",
            "10:70 height_scale: expected a number from 0.2 to 5, found inf",
        ],
    );
    check("friction: [0.4, 0.8]", "friction: 1.2", &["7:13 friction: expected a number from 0.05 to 0.8, found 1.2"]);
    check("filled_grains: 150", "filled_grains: -1", &["10:46 filled_grains: expected a whole number from 0 to 2000, found -1"]);
    check(
        "timeout_secs: 60",
        "timeout_secs: 99999999999999999999999",
        &["44:24 timeout_secs: expected a number from 1 to 3600, found 100000000000000000000000"],
    );
    check("height_m: 0.75", "height_m: [0.7]", &["6:21 height_m: expected a number or [min, max], found a list of 1"]);
    check("n_candidates: 15", "n_candidates: .inf", &["17:45 parameter: expected a finite number, found inf"]);
}

#[test]
fn duplicates() {
    check("arm: left", "robot: curi", &["4:1 key \"robot\" is given twice | it is first given in line 3"]);
    check(
        "- bowl: {model: bowl,",
        "- bottle: {model: bowl,",
        &[
            "11:7 two objects are called \"bottle\" | give each a name of its own and say the model apart: `- mug_2: {model: mug}`",
        ],
    );
    check(
        "fraction: 0.8",
        "fraction: 0.8, fraction: 0.7",
        &["29:61 key \"fraction\" is given twice | it is first given in line 29"],
    );
    check("x_m: 0.70,", "x_m: 0.70, x_m: 0.71,", &["11:43 key \"x_m\" is given twice | it is first given in line 11"]);
}

#[test]
fn instructions() {
    check(
        "instruction: Pour the water from the bottle into the bowl.",
        "instruction: \"  \"",
        &["13:14 the instruction is empty; say what to do, for example \"pour the water into the bowl\""],
    );
    check(
        "instruction: Pour the water from the bottle into the bowl.",
        "instruction:",
        &["13:1 the instruction is empty; say what to do, for example \"pour the water into the bowl\""],
    );
}

#[test]
fn no_yaml() {
    check("  friction:", "\tfriction:", &["7:2 tabs disallowed within this context (block indentation)"]);
    check("on: [lift_failed, slipped]", "on: [lift_failed, slipped", &["28:11 illegal placement of ':' indicator"]);
    check_text("", &["1:1 the scenario is empty | it needs version, robot, scene, tree"]);
    check_text("- a", &["1:1 scenario: expected a map, found a list of 1"]);
    check_text(
        "version: 1\n---\nversion: 1\n",
        &["3:1 a second document begins here | a scenario is one document; remove the line `---`"],
    );
}

#[test]
fn bombs_and_depths() {
    let mut bomb = "a0: &a0 [x, x, x, x, x, x, x, x, x]\n".to_owned();
    for level in 1..10 {
        let last = format!("*a{}", level - 1);
        bomb.push_str(&format!("a{level}: &a{level} [{}]\n", [last.as_str(); 9].join(", ")));
    }
    check_text(&bomb, &["5:10 aliases stand for more than 10000 values | write the values out"]);
    for depth in [100, 5_000, 100_000] {
        let nested = format!("tree: {}{}", "[".repeat(depth), "]".repeat(depth));
        assert_eq!(parse(&nested).unwrap_err().count(Severity::Error), 1, "depth {depth}");
        let block: String = (0..depth.min(2_000)).map(|level| format!("{}a:\n", " ".repeat(level))).collect();
        assert_eq!(parse(&block).unwrap_err().count(Severity::Error), 1, "depth {depth}");
    }
}

#[test]
fn files_that_cannot_be_read() {
    let folder = tempfile::tempdir().unwrap();
    let load = |path: &Path| Scenario::load(path, &Settings::default(), &registry(), &vocabulary()).unwrap_err().to_string();
    assert!(load(&folder.path().join("absent.yaml")).starts_with("cannot read"));
    assert!(load(folder.path()).starts_with("cannot read"));
    let large = folder.path().join("large.yaml");
    std::fs::write(&large, vec![b' '; MAX_FILE_BYTES + 1]).unwrap();
    assert!(load(&large).ends_with("it is larger than 16 MB; split it, or name files instead of copying them"));
    let binary = folder.path().join("binary.yaml");
    std::fs::write(&binary, [b'a', 0xff, 0xfe]).unwrap();
    assert!(load(&binary).ends_with("byte 1 is no UTF-8 text"));
}

const SIGNS: &[u8] = b"{}[]:-&*!|>'\"%@` \n\t#,";

/// Damages bytes of the valid scenario at random: every outcome but a panic is fine, and an error has something to say.
#[test]
fn damaged_bytes_never_panic() {
    let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(2);
    let (registry, vocabulary) = (registry(), vocabulary());
    let (mut n_accepted, mut n_refused) = (0, 0);
    for _ in 0..2_000 {
        let mut bytes = VALID.as_bytes().to_vec();
        for _ in 0..random.random_range(1..4) {
            let at = random.random_range(0..bytes.len());
            match random.random_range(0..5) {
                0 => bytes[at] = random.random_range(0..128),
                1 => {
                    bytes.remove(at);
                }
                2 => bytes.insert(at, SIGNS[random.random_range(0..SIGNS.len())]),
                3 => {
                    let end = (at + random.random_range(1..40)).min(bytes.len());
                    bytes.drain(at..end);
                }
                _ => {
                    let end = (at + random.random_range(1..40)).min(bytes.len());
                    let copy = bytes[at..end].to_vec();
                    let to = random.random_range(0..bytes.len());
                    bytes.splice(to..to, copy);
                }
            }
        }
        let Ok(text) = String::from_utf8(bytes) else { continue };
        match Scenario::parse(Path::new("test.yaml"), text.clone(), &Settings::default(), &registry, &vocabulary) {
            Ok(scenario) => {
                n_accepted += 1;
                assert!(scenario.build_tree(&registry).is_ok(), "{text}");
            }
            Err(errors) => {
                n_refused += 1;
                assert!(errors.count(Severity::Error) > 0 && errors.to_string().contains("error: "), "{text}");
            }
        }
    }
    println!("{n_accepted} accepted, {n_refused} refused");
    assert!(n_refused > 1_000 && n_accepted > 50);
}

/// The part of JSON Schema that the schema uses, so that it is tested against the reader without another tool.
fn accepts(root: &serde_json::Value, schema: &serde_json::Value, value: &serde_json::Value) -> bool {
    let number = |key: &str| schema.get(key).and_then(serde_json::Value::as_f64);
    if let Some(name) = schema.get("$ref").and_then(serde_json::Value::as_str) {
        return accepts(root, root.pointer(&name[1..]).unwrap(), value);
    }
    let type_fits = |name: &str| match name {
        "object" => value.is_object(),
        "array" => value.is_array(),
        "string" => value.is_string(),
        "integer" => value.is_i64(),
        "number" => value.is_number(),
        "boolean" => value.is_boolean(),
        "null" => value.is_null(),
        other => panic!("type {other}"),
    };
    let types_fit = match schema.get("type") {
        None => true,
        Some(serde_json::Value::String(name)) => type_fits(name),
        Some(names) => names.as_array().unwrap().iter().any(|name| type_fits(name.as_str().unwrap())),
    };
    let any_fits = schema.get("anyOf").is_none_or(|any| any.as_array().unwrap().iter().any(|one| accepts(root, one, value)));
    let word_fits = schema.get("enum").is_none_or(|words| words.as_array().unwrap().contains(value));
    let constant_fits = schema.get("const").is_none_or(|constant| constant == value);
    // The two patterns in use are those of keys and of parameters.
    let pattern_fits = match schema.get("pattern").and_then(serde_json::Value::as_str) {
        None => true,
        Some(pattern) if pattern.starts_with('^') => {
            value.as_str().is_some_and(|text| text.starts_with('{') && text.ends_with('}'))
        }
        Some(_) => value.as_str().is_some_and(|text| text.contains("${")),
    };
    let all_fit = schema.get("allOf").is_none_or(|all| all.as_array().unwrap().iter().all(|one| accepts(root, one, value)));
    let number_fits = value
        .as_f64()
        .is_none_or(|value| number("minimum").is_none_or(|min| value >= min) && number("maximum").is_none_or(|max| value <= max));
    let items_fit = value.as_array().is_none_or(|items| {
        #[expect(clippy::cast_precision_loss, reason = "a handful of items")]
        let n_items = items.len() as f64;
        number("minItems").is_none_or(|min| n_items >= min)
            && number("maxItems").is_none_or(|max| n_items <= max)
            && schema.get("items").is_none_or(|schema| items.iter().all(|item| accepts(root, schema, item)))
    });
    let entries_fit = value.as_object().is_none_or(|entries| {
        #[expect(clippy::cast_precision_loss, reason = "a handful of entries")]
        let n_entries = entries.len() as f64;
        number("minProperties").is_none_or(|min| n_entries >= min)
            && number("maxProperties").is_none_or(|max| n_entries <= max)
            && schema
                .get("required")
                .is_none_or(|keys| keys.as_array().unwrap().iter().all(|key| entries.contains_key(key.as_str().unwrap())))
            && entries.iter().all(|(key, value)| {
                match schema.get("properties").and_then(|known| known.get(key)).or_else(|| schema.get("additionalProperties")) {
                    None => true,
                    Some(serde_json::Value::Bool(allowed)) => *allowed,
                    Some(schema) => accepts(root, schema, value),
                }
            })
    });
    types_fit && any_fits && all_fit && word_fits && constant_fits && pattern_fits && number_fits && items_fit && entries_fit
}

#[track_caller]
fn check_schema(text: &str, expected: bool) {
    let schema = sfg_scenario::schema(registry().models(), &vocabulary());
    let value: serde_json::Value = serde_saphyr::from_str(text).unwrap();
    assert_eq!(accepts(&schema, &schema, &value), expected);
}

#[test]
fn the_schema_accepts_the_valid_scenario() {
    check_schema(VALID, true);
}

#[test]
fn the_schema_accepts_what_the_language_offers() {
    check_schema(&with("arm: left", "include: [parts.yaml]\nparameters: {a: 1}\nblackboard: {b: 2}"), true);
    check_schema(&with("height_m: 0.75", "height_m: \"${table_m}\""), true);
    check_schema(&with("robot: curi", "robot: \"${robot:-curi}\""), true);
    check_schema(&with("attempts: 3", "attempts: \"${n}\""), true);
    check_schema(&with("on: [lift_failed, slipped]", "on: \"${reasons}\""), true);
    check_schema(&with("yaw_deg: 90", "yaw_rad: 1.5"), true);
    check_schema(&with("attempts: 3", "attempts: 3\n        skip_if: n > 3\n        post: n = 1"), true);
    check_schema(&with("{subtree: grasp_and_lift}", "{subtree: {tree: grasp_and_lift, autoremap: true, while: ok}}"), true);
    check_schema(&with("{subtree: grasp_and_lift}", "{subtree: {tree: grasp_and_lift, autoremap: often}}"), false);
    check_schema(&with("arm: left", "include: parts.yaml"), false);
    check_schema(&with("height_m: 0.75", "height_m: \"$table_m\""), false);
}

#[test]
fn the_schema_of_an_included_file_knows_parts_alone() {
    let schema = sfg_scenario::schema(registry().models(), &vocabulary());
    let check = |text: &str, expected: bool| {
        let value: serde_json::Value = serde_saphyr::from_str(text).unwrap();
        assert_eq!(accepts(&schema, &schema["$defs"]["included"], &value), expected, "{text}");
    };
    check("subtrees: {look: {do: observe_scene}}\nlimits: {timeout_secs: 7}\nscene: {friction: 0.5}", true);
    check("robot: curi", false);
}

#[test]
fn the_schema_refuses_what_it_can_see() {
    check_schema(&with("- observe_scene", "- observ_scene"), false);
    check_schema(&with("- observe_scene", "- lift: {height_m: 0.9}"), false);
    check_schema(&with(", fraction: 0.8}", "}"), false);
    check_schema(&with("fraction: 0.8", "fraction: much"), false);
    check_schema(&with("attempts: 3", "atempts: 3"), false);
    check_schema(&with("on: [lift_failed, slipped]", "on: [lift_faild]"), false);
    check_schema(&with("robot: curi", "robot: cury"), false);
    check_schema(&with("llm: knowledge", "llm: knowlege"), false);
    check_schema(&with("model: bowl", "model: bowel"), false);
    check_schema(&with("timeout_secs: 60", "timeout: 60"), false);
    check_schema(&with("- fill_seen", "- fil_seen"), false);
    check_schema(&with("- inverter: is_held", "- inverter: [is_held]"), false);
}

#[test]
fn the_schema_is_the_same_every_time() {
    let text = || serde_json::to_string(&sfg_scenario::schema(registry().models(), &vocabulary())).unwrap();
    assert_eq!(text(), text());
}

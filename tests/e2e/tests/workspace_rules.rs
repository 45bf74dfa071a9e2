//! Rules of the repository, as data: who may use whom, what lies at the top, what never appears in a file.

#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "tests fail by panicking and say what they pass over")]

use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::{env, fs};

/// Which crates of the workspace each crate may use (design: "Crates and direction"). A new line or word is a design decision.
const ALLOWED_USES: &[(&str, &str)] = &[
    ("types", ""),
    ("tree", "tree-derive"),
    ("tree-derive", ""),
    ("plugin-abi", ""),
    ("geometry", "types"),
    ("kinematics", "types"),
    ("synergy", "types"),
    ("plugin", "types plugin-abi"),
    ("render", "types geometry"),
    ("planning", "types geometry kinematics"),
    ("world", "types geometry kinematics render"),
    ("plugin-host", "types plugin plugin-abi"),
    ("scenario", "types tree"),
    ("record", "types tree render"),
    ("monitor", ""),
    ("skills", "types geometry kinematics planning tree plugin synergy"),
    ("llm-knowledge", "types plugin"),
    ("grounder-geometric", "types plugin geometry"),
    ("generator-analytic", "types plugin geometry kinematics synergy"),
    ("policy-synergy", "types plugin synergy"),
    ("driver-sim", "types plugin geometry kinematics world"),
    ("app", "*"),
    ("centre-pose", "plugin-abi"),
    ("e2e", ""),
    ("fuzz", "scenario tree"),
];

/// What may lie at the top of the repository: the user's folders, the papers, tool configuration.
const TOP_LEVEL: &[&str] = &[
    "Cargo.toml Cargo.lock engine skills plugins policies scenarios tests",
    "README.md LICENSE LICENSE-MIT LICENSE-APACHE ARCHITECTURE.md CHANGELOG.md",
    ".ci .cargo .gitattributes .gitignore clippy.toml deny.toml rust-toolchain.toml rustfmt.toml",
];

/// Larger files are built or fetched, never tracked.
const MAX_FILE_BYTES: u64 = 1_500_000;

/// The paper's novel objects (Table V): never in the data that a network, policy or threshold was fitted to.
const NOVEL: [&str; 10] =
    ["spoon", "soda can", "pan", "bottle", "spray detergent", "headset", "mouse", "stapler", "bowl lid", "whisk"];

#[test]
fn crates_use_only_what_the_design_allows() {
    let allowed: BTreeMap<&str, BTreeSet<&str>> =
        ALLOWED_USES.iter().map(|(name, uses)| (*name, uses.split_whitespace().collect())).collect();
    let mut members = BTreeSet::new();
    let mut wrong = Vec::new();
    for package in packages() {
        let name = short_name(&package["name"]);
        members.insert(name.clone());
        let Some(allowed) = allowed.get(name.as_str()) else {
            wrong.push(format!("{name} is not in the table"));
            continue;
        };
        for dependency in package["dependencies"].as_array().unwrap() {
            let is_dev = dependency["kind"].as_str() == Some("dev");
            let used = short_name(&dependency["name"]);
            if dependency["path"].is_null() || is_dev || allowed.contains("*") {
                continue;
            }
            if !allowed.contains(used.as_str()) {
                wrong.push(format!("{name} uses {used}"));
            }
        }
    }
    wrong.extend(allowed.keys().filter(|name| !members.contains(**name)).map(|name| format!("{name} is in the table only")));
    assert!(wrong.is_empty(), "not allowed by the table: {wrong:#?}");
}

#[test]
fn nothing_depends_on_the_application_and_only_it_names_concrete_plugins() {
    let plugins: BTreeSet<String> =
        packages().iter().filter(|package| is_below(package, "plugins")).map(|package| short_name(&package["name"])).collect();
    assert!(plugins.len() >= 5, "the five built-in plugins are members: {plugins:?}");
    for package in packages().iter().filter(|package| package["name"] != "sfg-app") {
        for dependency in package["dependencies"].as_array().unwrap() {
            let used = short_name(&dependency["name"]);
            let is_dev = dependency["kind"].as_str() == Some("dev");
            assert!(used != "app", "{} uses the application", package["name"]);
            assert!(is_dev || !plugins.contains(&used), "{} uses the concrete plugin {used}", package["name"]);
        }
    }
}

#[test]
fn every_manifest_states_the_licence_and_stays_private() {
    for package in packages() {
        assert_eq!(package["license"], "MIT OR Apache-2.0", "licence of {}", package["name"]);
        assert_eq!(package["publish"], Value::Array(Vec::new()), "{} can be published", package["name"]);
        assert!(package["description"].as_str().is_some_and(|text| !text.is_empty()), "{} has no description", package["name"]);
    }
}

#[test]
fn the_top_level_is_the_users() {
    let allowed: BTreeSet<&str> = TOP_LEVEL.iter().flat_map(|line| line.split_whitespace()).collect();
    let Some(files) = tracked_files() else { return };
    let top: BTreeSet<&str> = files.iter().map(|file| file.split('/').next().unwrap()).collect();
    let strangers: Vec<_> = top.difference(&allowed).collect();
    assert!(strangers.is_empty(), "not in the design's top level: {strangers:?}");
}

#[test]
fn tracked_files_are_small() {
    let Some(files) = tracked_files() else { return };
    for file in files {
        let size = fs::metadata(root().join(&file)).map_or(0, |metadata| metadata.len());
        assert!(size <= MAX_FILE_BYTES, "{file} has {size} bytes, at most {MAX_FILE_BYTES} are tracked");
    }
}

#[test]
fn no_tracked_file_names_a_machine() {
    let Some(files) = tracked_files() else { return };
    // Put together here, so that this file does not hold them.
    let mut needles: Vec<String> = ["work", "root", "home"].map(|folder| format!("/{folder}/")).into();
    needles.extend(registry_mirrors());
    let mut found = Vec::new();
    for file in files {
        let Ok(bytes) = fs::read(root().join(&file)) else { continue };
        let text = String::from_utf8_lossy(&bytes);
        for (line_idx, line) in text.lines().enumerate() {
            found.extend(
                needles.iter().filter(|needle| names(line, needle)).map(|needle| format!("{file}:{}: {needle}", line_idx + 1)),
            );
        }
    }
    assert!(found.is_empty(), "machine paths or registry hosts in tracked files: {found:#?}");
}

#[test]
fn a_path_inside_a_longer_one_is_not_a_machines() {
    let needle = format!("/{}/", "work");
    assert!(names(&format!("see {needle}x"), &needle) && names(&format!("\"{needle}x\""), &needle));
    assert!(
        !names(concat!("frame/wo", "rk/x"), &needle) && !names(concat!("../wo", "rk/x"), &needle) && !names("workshop", &needle)
    );
}

#[test]
fn dependencies_come_from_the_public_registry() {
    let lock = fs::read_to_string(root().join("Cargo.lock")).unwrap();
    let sources: BTreeSet<&str> = lock.lines().filter_map(|line| line.strip_prefix("source = ")).collect();
    assert_eq!(
        sources.into_iter().collect::<Vec<_>>(),
        [concat!("\"registry+https://github.com/rust-lang/crates", ".io-index\"")]
    );
}

#[test]
fn novel_objects_were_never_trained_or_tuned_on() {
    let Some(files) = tracked_files() else { return };
    let manifests: Vec<&String> = files.iter().filter(|file| is_data_manifest(file)).collect();
    if manifests.is_empty() {
        println!("no training or tuning manifest yet");
    }
    for file in manifests {
        let text = fs::read_to_string(root().join(file)).unwrap();
        let seen = novel_objects_in(&text);
        assert!(seen.is_empty(), "{file} names novel objects: {seen:?}");
    }
}

#[test]
fn the_object_index_marks_the_novel_ones() {
    let Ok(index) = fs::read_to_string(root().join("scenarios/objects/INDEX.md")) else {
        println!("no object index yet");
        return;
    };
    for object in NOVEL {
        let row = index.lines().find(|line| line.contains("novel") && novel_objects_in(line).contains(&object));
        assert!(row.is_some(), "scenarios/objects/INDEX.md does not mark {object:?} as novel");
    }
}

#[test]
fn novel_objects_are_recognised_as_words() {
    assert_eq!(novel_objects_in("objects: [mug, soda_can, Bowl-Lid]"), ["soda can", "bowl lid"]);
    assert_eq!(novel_objects_in("companion, spoonful, whisked: no; mouse: yes"), ["mouse"]);
    assert!(is_data_manifest("policies/weights/pose-net/card.toml") && is_data_manifest("policies/train/objects.manifest.json"));
    assert!(!is_data_manifest("policies/synergy/Cargo.toml") && !is_data_manifest("scenarios/objects/bottle.yaml"));
}

/// Cards of weights, and anything under `policies` or `tests/bench-runs` that says it lists training or tuning data.
fn is_data_manifest(file: &str) -> bool {
    let name = file.rsplit('/').next().unwrap();
    let listed = ["manifest", "training", "tuning"].iter().any(|word| name.contains(word));
    let is_text = [".toml", ".yaml", ".json", ".csv", ".txt"].iter().any(|end| name.ends_with(end));
    is_text && (name == "card.toml" || (listed && (file.starts_with("policies/") || file.starts_with("tests/bench-runs/"))))
}

fn novel_objects_in(text: &str) -> Vec<&'static str> {
    let lower = text.to_lowercase();
    let words: Vec<&str> = lower.split(|c: char| !c.is_alphanumeric()).filter(|word| !word.is_empty()).collect();
    let has = |object: &str| {
        let parts: Vec<&str> = object.split(' ').collect();
        words.windows(parts.len()).any(|window| window == parts)
    };
    NOVEL.into_iter().filter(|object| has(object)).collect()
}

/// Whether `line` holds `needle` as a path or host of its own, not inside a longer one.
fn names(line: &str, needle: &str) -> bool {
    line.match_indices(needle).any(|(at, _)| !line[..at].ends_with(|c: char| c.is_alphanumeric() || "._-~}".contains(c)))
}

/// Hosts that this machine's cargo takes crates from instead of the public registry, if any.
fn registry_mirrors() -> Vec<String> {
    let home = env::var_os("CARGO_HOME").map(PathBuf::from).or_else(|| Some(env::home_dir()?.join(".cargo")));
    let files = home.into_iter().flat_map(|home| ["config.toml", "config"].map(|name| home.join(name)));
    let settings: Vec<String> = files.filter_map(|file| fs::read_to_string(file).ok()).collect();
    let urls = settings.iter().flat_map(|text| text.split('"')).filter_map(|text| text.split_once("://"));
    let hosts = urls.filter_map(|(_, rest)| rest.split(['/', ':']).next()).map(str::to_owned);
    let public = |host: &String| {
        [concat!("crates", ".io"), "github.com"].iter().any(|name| host == name || host.ends_with(&format!(".{name}")))
    };
    hosts.filter(|host| host.contains('.') && !public(host)).collect()
}

/// The workspace's packages, as cargo reads their manifests.
fn packages() -> Vec<Value> {
    let output = Command::new(env!("CARGO"))
        .args(["metadata", "--no-deps", "--offline", "--format-version", "1"])
        .current_dir(root())
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let metadata: Value = serde_json::from_slice(&output.stdout).unwrap();
    metadata["packages"].as_array().unwrap().clone()
}

fn short_name(name: &Value) -> String {
    let name = name.as_str().unwrap();
    name.strip_prefix("sfg-").unwrap_or(name).to_owned()
}

fn is_below(package: &Value, folder: &str) -> bool {
    Path::new(package["manifest_path"].as_str().unwrap()).starts_with(root().join(folder))
}

/// Paths of the tracked files; `None` in a copy without its history.
fn tracked_files() -> Option<Vec<String>> {
    let output =
        Command::new("git").args(["ls-files", "-z"]).current_dir(root()).output().ok().filter(|output| output.status.success());
    let Some(output) = output else {
        println!("passed over: this is no git checkout");
        return None;
    };
    let text = String::from_utf8(output.stdout).unwrap();
    Some(text.split('\0').filter(|file| !file.is_empty()).map(str::to_owned).collect())
}

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").canonicalize().unwrap()
}

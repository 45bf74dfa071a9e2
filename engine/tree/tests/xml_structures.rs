//! Files with the structure of BehaviorTree.CPP's tutorials and of five Nav2 trees: imported, or refused by name.
#![cfg(feature = "xml")]
#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "tests fail by panicking, and show their table")]

use sfg_tree::xml::{ImportOptions, ImportedTree, XmlProblem, export, import};
use sfg_tree::{NodeKind, NodeSpec, PortValue, TreeSpec};
use std::fmt::Write;
use std::path::PathBuf;
use std::time::{Duration, Instant};

const FILES: [&str; 25] = [
    "t01_first_tree",
    "t02_ports",
    "t03_typed_ports",
    "t04_reactive",
    "t05_subtree",
    "t06_remapping",
    "t07_several_files",
    "t08_nameless_tree",
    "t09_scripts",
    "t10_nested_subtrees",
    "t11_editor",
    "t12_default_ports",
    "t13_by_reference",
    "t14_subtree_model",
    "t15_mocking",
    "t16_root_blackboard",
    "t17_autoremap",
    "t18_loops",
    "nav1_replanning_and_recovery",
    "nav2_through_poses",
    "nav3_follow_point",
    "nav4_distance",
    "nav5_plan_when_invalid",
    "old1_version_3",
    "old2_ros_package",
];

fn folder() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/xml")
}

fn text_of(path: &str) -> Result<String, String> {
    std::fs::read_to_string(folder().join(path)).map_err(|error| error.to_string())
}

/// The tree that the program names, as the tutorials do, where the file names none.
fn main_of(name: &str) -> Option<String> {
    let main = match name {
        "t05_subtree" => "FetchCup",
        "t06_remapping" => "Deliver",
        "t07_several_files" => "Breakfast",
        "t10_nested_subtrees" => "Outer",
        "t11_editor" => "Enter",
        "t15_mocking" => "Rehearse",
        "t16_root_blackboard" => "Weigh",
        "t17_autoremap" => "Resume",
        _ => return None,
    };
    Some(main.to_owned())
}

fn read(name: &str) -> Result<ImportedTree, Vec<XmlProblem>> {
    let options = ImportOptions { main_tree: main_of(name), load: &text_of, ..ImportOptions::default() };
    import(&text_of(&format!("{name}.xml")).unwrap(), &options)
}

fn n_nodes(node: &NodeSpec) -> usize {
    1 + node.children.iter().map(n_nodes).sum::<usize>()
}

fn nodes_of(spec: &TreeSpec) -> usize {
    n_nodes(&spec.root) + spec.subtrees.iter().map(|subtree| n_nodes(&subtree.root)).sum::<usize>()
}

const TABLE: &str = "\
t01_first_tree: imported, 5 nodes, 0 subtrees
t02_ports: imported, 5 nodes, 0 subtrees
t03_typed_ports: imported, 5 nodes, 0 subtrees
t04_reactive: imported, 6 nodes, 0 subtrees
t05_subtree: imported, 11 nodes, 1 subtrees
t06_remapping: imported, 10 nodes, 1 subtrees
t07_several_files: imported, 6 nodes, 2 subtrees
t08_nameless_tree: imported, 3 nodes, 0 subtrees
t09_scripts: imported, 9 nodes, 0 subtrees, 2 warnings
t10_nested_subtrees: imported, 10 nodes, 2 subtrees
t11_editor: imported, 13 nodes, 1 subtrees
t12_default_ports: imported, 1 nodes, 0 subtrees
t13_by_reference: imported, 4 nodes, 0 subtrees
t14_subtree_model: imported, 7 nodes, 1 subtrees, 4 warnings
t15_mocking: imported, 12 nodes, 1 subtrees
t16_root_blackboard: imported, 6 nodes, 1 subtrees
t17_autoremap: imported, 11 nodes, 1 subtrees
t18_loops: imported, 6 nodes, 0 subtrees
nav1_replanning_and_recovery: imported, 35 nodes, 0 subtrees
nav2_through_poses: imported, 16 nodes, 0 subtrees
nav3_follow_point: imported, 9 nodes, 0 subtrees
nav4_distance: imported, 4 nodes, 0 subtrees
nav5_plan_when_invalid: imported, 19 nodes, 0 subtrees
old1_version_3: refused
  3:5: \"SequenceStar\": this is of BehaviorTree.CPP 3
  4:26: \"__shared_blackboard\": this is of BehaviorTree.CPP 3
  5:7: \"BlackboardCheckInt\": this is of BehaviorTree.CPP 3
  11:5: \"RetryUntilSuccesful\": this is of BehaviorTree.CPP 3
old2_ros_package: refused
  2:21: \"tea_robot\": files of ROS packages cannot be included
";

#[test]
fn every_structure_is_imported_or_refused_by_name() {
    let mut table = String::new();
    for name in FILES {
        match read(name) {
            Ok(tree) => {
                let (n_nodes, n_subtrees) = (nodes_of(&tree.spec), tree.spec.subtrees.len());
                _ = write!(table, "{name}: imported, {n_nodes} nodes, {n_subtrees} subtrees");
                if !tree.warnings.is_empty() {
                    _ = write!(table, ", {} warnings", tree.warnings.len());
                }
                table.push('\n');
            }
            Err(problems) => {
                _ = writeln!(table, "{name}: refused");
                for problem in problems {
                    _ = writeln!(table, "  {problem}");
                }
            }
        }
    }
    println!("{table}");
    assert_eq!(table, TABLE);
}

#[test]
fn every_file_of_the_folder_is_in_the_table() {
    let mut found: Vec<String> = std::fs::read_dir(folder())
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.is_file())
        .map(|path| path.file_stem().unwrap().to_string_lossy().into_owned())
        .collect();
    let mut listed = FILES.map(str::to_owned).to_vec();
    found.sort();
    listed.sort();
    assert_eq!(found, listed);
}

/// Every location leads to the letters it is about.
#[test]
fn locations_lead_to_elements_and_attributes() {
    for name in FILES {
        let Ok(tree) = read(name) else { continue };
        let texts: Vec<String> = tree
            .files
            .iter()
            .map(|path| text_of(if path.is_empty() { format!("{name}.xml") } else { path.clone() }.as_str()).unwrap())
            .collect();
        let at = |location: u32| {
            let place = tree.places[location as usize];
            let line = texts[place.file as usize].lines().nth(place.line as usize - 1).unwrap();
            line.chars().skip(place.column as usize - 1).collect::<String>()
        };
        let mut n_checked = 0;
        check_node(&tree.spec.root, &at, &mut n_checked);
        for subtree in &tree.spec.subtrees {
            assert!(at(subtree.location).starts_with("<BehaviorTree"), "{name}: {}", at(subtree.location));
            check_node(&subtree.root, &at, &mut n_checked);
        }
        assert!(n_checked >= nodes_of(&tree.spec));
    }
}

fn check_node(node: &NodeSpec, at: &dyn Fn(u32) -> String, n_checked: &mut usize) {
    let here = at(node.location);
    match &node.kind {
        NodeKind::Subtree(_) => assert!(here.starts_with("<SubTree"), "{here}"),
        NodeKind::Named(name) => {
            let element: String = here[1..].chars().take_while(|letter| letter.is_alphanumeric() || *letter == '_').collect();
            let is_own =
                element == *name || element.to_lowercase().starts_with(&name[..4]) || name == "retry" || name == "rate_limit";
            assert!(here.starts_with('<') && is_own, "{name:?} at {here}");
        }
    }
    for setting in node.ports.iter().filter(|setting| setting.location != node.location) {
        if let PortValue::Key(key) = &setting.value {
            assert!(at(setting.location).starts_with(&format!("{{{key}}}\"")), "{}", at(setting.location));
        }
        assert!(at(setting.name_location).contains('='));
        *n_checked += 1;
    }
    for condition in &node.conditions {
        assert!(at(condition.location).starts_with(&condition.script));
    }
    *n_checked += 1;
    for child in &node.children {
        check_node(child, at, n_checked);
    }
}

/// A small generator of its own: the same numbers everywhere.
struct Numbers(u64);

impl Numbers {
    fn below(&mut self, end: usize) -> usize {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((self.0 >> 33) as usize) % end.max(1)
    }
}

const PIECES: [&str; 20] = [
    "<",
    ">",
    "/>",
    "\"",
    "'",
    "&",
    "&amp;",
    "{",
    "}",
    "{=}",
    "{@a.b}",
    "ID=\"x\"",
    " name=\"\"",
    "_skipIf=\"a\"",
    "<Switch3>",
    "</Sequence>",
    "<SubTree ID=\"Middle\"/>",
    "\u{0}",
    "\u{1f600}",
    "<![CDATA[",
];

/// One to four changes: letters or pieces put in, taken out, doubled, or moved between files.
fn mutated(text: &str, other: &str, numbers: &mut Numbers) -> String {
    let mut letters: Vec<char> = text.chars().collect();
    for _ in 0..=numbers.below(3) {
        let at = numbers.below(letters.len());
        let end = (at + numbers.below(30)).min(letters.len());
        match numbers.below(9) {
            0 => _ = letters.drain(at..end),
            1 => {
                let piece = PIECES[numbers.below(PIECES.len())];
                letters.splice(at..at, piece.chars());
            }
            2 => {
                let copy: Vec<char> = letters[at..end].to_vec();
                letters.splice(at..at, copy);
            }
            3 => {
                let from = numbers.below(other.len());
                letters.splice(at..at, other.chars().skip(from).take(30));
            }
            4 => {
                let to = numbers.below(letters.len());
                if at < letters.len() {
                    letters.swap(at, to);
                }
            }
            5 => letters.truncate(at.max(letters.len().saturating_sub(40))),
            // The file stays well-formed.
            _ => {
                if let Some(letter) =
                    letters[at..].iter_mut().find(|letter| letter.is_ascii_digit() || "{;.@ -".contains(**letter))
                {
                    *letter = ['0', '9', '-', ';', '.', ' ', 'x', '='][numbers.below(8)];
                }
            }
        }
        if letters.is_empty() {
            letters.push(' ');
        }
    }
    letters.into_iter().collect()
}

#[test]
fn changed_files_never_panic_and_take_no_time() {
    let texts: Vec<String> = FILES.map(|name| text_of(&format!("{name}.xml")).unwrap()).to_vec();
    let parts: Vec<(String, String)> = ["parts/toast.xml", "parts/juice.xml", "parts/checked.xml"]
        .map(|path| (path.to_owned(), text_of(path).unwrap()))
        .to_vec();
    let load = |path: &str| match parts.iter().find(|(name, _)| name == path) {
        Some((_, text)) => Ok(text.clone()),
        None => Err("no such file".to_owned()),
    };
    let (mut numbers, mut n_read, mut n_exported, mut longest) = (Numbers(7), 0, 0, Duration::ZERO);
    for round in 0..20_000 {
        let other = &texts[numbers.below(texts.len())];
        let text = mutated(&texts[round % texts.len()], other, &mut numbers);
        let main_tree = main_of(FILES[round % FILES.len()]);
        let options = ImportOptions { main_tree, load: &load, ..ImportOptions::default() };
        let start = Instant::now();
        match import(&text, &options) {
            Ok(tree) => {
                n_read += 1;
                n_exported += usize::from(export(&tree.spec, &[]).is_ok());
            }
            Err(problems) => assert!(!problems.is_empty(), "refused without a reason:\n{text}"),
        }
        longest = longest.max(start.elapsed());
    }
    println!("{n_read} of 20000 read, {n_exported} of them written; longest {longest:?}");
    assert!(longest < Duration::from_secs(1), "{longest:?}");
    assert!(n_read > 2_000 && n_exported > 1_000, "the changes are too rough to test much");
}

/// Everything imported comes back from its own export, except for nodes that are ours only.
#[test]
fn imported_files_survive_export() {
    let mut n_same = 0;
    for name in FILES {
        let Ok(tree) = read(name) else { continue };
        match export(&tree.spec, &[]) {
            Ok(text) => {
                let again =
                    import(&text, &ImportOptions::default()).unwrap_or_else(|problems| panic!("{name}: {}\n{text}", problems[0]));
                assert_eq!(export(&again.spec, &[]).as_deref(), Ok(text.as_str()), "{name}");
                n_same += 1;
            }
            Err(problems) => assert!(name.starts_with("nav"), "{name}: {}", problems[0]),
        }
    }
    assert_eq!(n_same, 19, "18 tutorials and the Nav2 tree without RateController");
}

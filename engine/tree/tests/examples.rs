//! Runs the numbered examples and compares what they print with `tests/examples`.
//!
//! `SFG_WRITE_EXAMPLES=1` writes the files anew; what changed is read as a diff.
#![allow(clippy::unwrap_used, reason = "tests fail by panicking")]

use std::fs;
use std::path::Path;

macro_rules! examples {
    ($($name:ident = $path:literal)*) => {
        $(
            #[path = $path]
            #[allow(dead_code, unreachable_pub, reason = "an example has its own main")]
            mod $name;

            #[test]
            fn $name() {
                let mut found = Vec::new();
                $name::run(&mut found).unwrap();
                check(stringify!($name), &String::from_utf8(found).unwrap());
            }
        )*

        const NAMES: &[&str] = &[$(stringify!($name)),*];
    };
}

examples! {
    t01_first_tree = "../examples/t01_first_tree.rs"
    t02_basic_ports = "../examples/t02_basic_ports.rs"
    t03_own_types = "../examples/t03_own_types.rs"
    t04_actions_and_reactions = "../examples/t04_actions_and_reactions.rs"
    t05_subtrees = "../examples/t05_subtrees.rs"
    t06_subtree_ports = "../examples/t06_subtree_ports.rs"
    t07_several_trees = "../examples/t07_several_trees.rs"
    t08_arguments = "../examples/t08_arguments.rs"
    t09_scripts = "../examples/t09_scripts.rs"
    t10_statistics = "../examples/t10_statistics.rs"
    t11_journal = "../examples/t11_journal.rs"
    t12_defaults = "../examples/t12_defaults.rs"
    t13_shared_values = "../examples/t13_shared_values.rs"
    t14_declared_subtrees = "../examples/t14_declared_subtrees.rs"
    t15_mocks = "../examples/t15_mocks.rs"
    t16_root_keys = "../examples/t16_root_keys.rs"
    t17_backup = "../examples/t17_backup.rs"
    t18_waypoints = "../examples/t18_waypoints.rs"
    t19_footprints = "../examples/t19_footprints.rs"
    t20_recover = "../examples/t20_recover.rs"
    t21_reload = "../examples/t21_reload.rs"
    t22_replay = "../examples/t22_replay.rs"
}

#[track_caller]
fn check(name: &str, found: &str) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/examples").join(format!("{name}.txt"));
    if std::env::var_os("SFG_WRITE_EXAMPLES").is_some() {
        return fs::write(path, found).unwrap();
    }
    assert_eq!(found, fs::read_to_string(&path).unwrap(), "{}", path.display());
}

#[test]
fn every_example_is_run_and_short() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples");
    let mut names: Vec<String> = fs::read_dir(&folder)
        .unwrap()
        .map(|file| file.unwrap().file_name().into_string().unwrap())
        .filter_map(|file| Some(file.strip_suffix(".rs")?.to_owned()))
        .filter(|name| name.starts_with('t') && name[1..3].bytes().all(|letter| letter.is_ascii_digit()))
        .collect();
    names.sort();
    assert_eq!(names, NAMES);
    for name in names {
        let text = fs::read_to_string(folder.join(format!("{name}.rs"))).unwrap();
        assert!(text.lines().count() <= 80, "{name} has {} lines", text.lines().count());
        assert!(text.starts_with("//! Lesson "), "{name} does not begin with its idea");
    }
}

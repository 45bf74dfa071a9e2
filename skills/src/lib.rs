//! Skills in the order of the data path, each a pure function and a thin tree node.
//!
//! A node reads its ports, calls the function, writes its ports and says in one line what was decided. It sees what sensors
//! and drivers give, never the simulator's truth. [`register`] makes all of them known to a tree registry.

pub mod arm;
pub mod context;
pub mod grasp;
pub mod motion;
pub mod post_grasp;
pub mod robot;
pub mod saved;

pub use context::{Kept, Plugins, SkillContext, SkillFailure, StageLog, StageNote};
pub use robot::{Robot, RobotError};

use sfg_tree::Registry;

/// Registers every skill.
pub fn register(registry: &mut Registry<SkillContext>) {
    saved::register(registry);
    grasp::ready::register(registry);
    grasp::observe_scene::register(registry);
    grasp::list_scene::register(registry);
    grasp::infer_functionality::register(registry);
    grasp::ground_affordance::register(registry);
    grasp::reconstruct_object::register(registry);
    grasp::generate_palm_poses::register(registry);
    grasp::select_palm_pose::register(registry);
    grasp::synthesize_grasp::register(registry);
    grasp::reach_palm_pose::register(registry);
    grasp::close_hand::register(registry);
    grasp::verify_grasp::register(registry);
    grasp::lift::register(registry);
    post_grasp::pour::register(registry);
    motion::register(registry);
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "tests fail by panicking")]
    use super::*;
    use std::collections::BTreeSet;
    use std::path::Path;

    /// Names of reasons that a source file makes failures of, and those that its skills declare.
    fn reasons_in(text: &str) -> (BTreeSet<String>, BTreeSet<String>) {
        let code = text.split("#[cfg(test)]").next().unwrap();
        let names = |text: &str| -> BTreeSet<String> {
            let found =
                text.split("FailureReason::").skip(1).map(|rest| rest.chars().take_while(char::is_ascii_alphanumeric).collect());
            found.filter(|name: &String| name.chars().next().is_some_and(char::is_uppercase)).collect()
        };
        let mut declared = BTreeSet::new();
        let mut used = code.to_owned();
        while let Some((before, rest)) = used.clone().split_once(".fails_with(") {
            let (list, after) = rest.split_once(')').unwrap();
            declared.extend(names(list));
            used = format!("{before}{after}");
        }
        let lines: Vec<&str> = used.lines().filter(|line| !line.trim_start().starts_with("///")).collect();
        (names(&lines.join("\n")), declared)
    }

    #[test]
    fn skills_declare_every_reason_that_their_files_give() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
        let (mut all_used, mut all_declared) = (BTreeSet::new(), BTreeSet::new());
        for sub in ["grasp", "post_grasp", "."] {
            for entry in std::fs::read_dir(folder.join(sub)).unwrap() {
                let path = entry.unwrap().path();
                if path.extension().is_none_or(|extension| extension != "rs") || path.ends_with("lib.rs") {
                    continue;
                }
                let text = std::fs::read_to_string(&path).unwrap();
                let (used, declared) = reasons_in(&text);
                if text.contains(".fails_with(") {
                    let missing: Vec<&String> = used.difference(&declared).collect();
                    assert!(missing.is_empty(), "{}: {missing:?} not declared", path.display());
                    let calls_plugin = text.contains("SkillFailure::plugin");
                    assert_eq!(calls_plugin, declared.contains("PluginFailed"), "{}", path.display());
                }
                all_used.extend(used);
                all_declared.extend(declared);
            }
        }
        let never: Vec<&String> = all_declared.difference(&all_used).collect();
        assert!(never.is_empty(), "{never:?} declared and given by nobody");
        let undeclared: Vec<&String> = all_used.difference(&all_declared).collect();
        assert!(undeclared.is_empty(), "{undeclared:?} given and declared by nobody");
    }

    #[test]
    fn every_skill_says_what_it_fails_for() {
        let mut registry = Registry::new();
        register(&mut registry);
        let silent: Vec<&str> =
            registry.models().iter().filter(|model| model.reasons.is_none()).map(|model| &*model.name).collect();
        let is_leaf = |name: &&&str| {
            registry
                .models()
                .iter()
                .any(|m| m.name == **name && !matches!(m.class, sfg_tree::NodeClass::Control | sfg_tree::NodeClass::Decorator))
        };
        assert_eq!(silent.iter().filter(is_leaf).count(), 0, "{silent:?}");
    }
}

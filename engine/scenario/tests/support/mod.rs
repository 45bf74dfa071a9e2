//! A small application whose scenarios the tests damage.
#![allow(dead_code, reason = "no test uses all of it")]

use sfg_scenario::{Mistake, Scenario, ScenarioErrors, Settings, Vocabulary};
use sfg_tree::{PortSpec, Registry};
use std::path::Path;

pub(crate) const VALID: &str = include_str!("../valid.yaml");

/// Artefacts of the small registry.
struct Observation;
struct Inventory;
#[derive(Clone)]
struct Functionality;
struct ObjectRef;

pub(crate) fn registry() -> Registry<()> {
    let mut registry = Registry::new();
    registry.step("observe_scene", [PortSpec::output::<Observation>("observation")], |_| Ok(()));
    let ports = [PortSpec::input::<Observation>("observation"), PortSpec::output::<Inventory>("inventory")];
    registry.step("list_scene", ports, |_| Ok(()));
    let ports = [PortSpec::input::<Inventory>("inventory"), PortSpec::output::<Functionality>("functionality")];
    registry.step("infer_functionality", ports, |_| Ok(()));
    registry.step(
        "lift",
        [
            PortSpec::input::<Functionality>("functionality"),
            PortSpec::setting::<f64>("height_m").default_value(0.1).range(0.0, 0.5),
            PortSpec::output::<f64>("lifted_m"),
        ],
        |_| Ok(()),
    );
    registry.step(
        "pour",
        [
            PortSpec::input::<ObjectRef>("into"),
            PortSpec::setting::<f64>("fraction").range(0.0, 1.0),
            PortSpec::setting::<f64>("timeout_secs").default_value(20.0),
        ],
        |_| Ok(()),
    );
    registry.condition("is_held", [], |_| Ok(true));
    registry.field::<Functionality, ObjectRef>("target", |_| Ok(ObjectRef));
    registry
}

pub(crate) fn vocabulary() -> Vocabulary {
    let words = |text: &str| text.split(' ').map(str::to_owned).collect::<Vec<_>>();
    Vocabulary {
        robots: words("curi"),
        object_models: words("bottle bowl mug"),
        llm: words("knowledge openai"),
        grounder: words("geometric"),
        pose_generator: words("analytic network"),
        grasp_policy: words("synergy"),
        driver: words("sim"),
        truth_predicates: words("grains_in still_held"),
        sensed_predicates: words("fill_seen"),
        reasons: words("lift_failed slipped no_candidate_reachable"),
    }
}

pub(crate) fn parse(text: &str) -> Result<Scenario, ScenarioErrors> {
    Scenario::parse(Path::new("test.yaml"), text.to_owned(), &Settings::default(), &registry(), &vocabulary())
}

/// The valid scenario with one text replaced by another.
#[track_caller]
pub(crate) fn with(from: &str, to: &str) -> String {
    assert_eq!(VALID.matches(from).count(), 1, "{from:?} must stand once in valid.yaml");
    VALID.replace(from, to)
}

#[track_caller]
pub(crate) fn check_text(text: &str, expected: &[&str]) {
    let errors = parse(text).expect_err("the scenario is accepted");
    assert_eq!(listed(errors.list()), expected, "{errors}");
}

/// Line, column, message and help of each mistake; lines of included files have the file's number before them.
pub(crate) fn listed(mistakes: &[Mistake]) -> Vec<String> {
    let line = |mistake: &Mistake| {
        let help = mistake.help.as_ref().map_or(String::new(), |help| format!(" | {help}"));
        let file = if mistake.place.file == 0 { String::new() } else { format!("{}:", mistake.place.file) };
        format!("{file}{}:{} {}{help}", mistake.place.line, mistake.place.column, mistake.message)
    };
    mistakes.iter().map(line).collect()
}

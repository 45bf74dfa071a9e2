//! Sensors in, commands out: nothing but the cameras and the motors tells a run what to do.
#![expect(clippy::unwrap_used, reason = "tests fail by panicking")]

use super::*;
use crate::check::Checked;
use sfg_driver_sim::world::TruthPoison;
use std::path::Path;

/// Runs a scenario text with one change to the simulator.
fn run_with(text: &str, simulator: Simulator<'_>) -> RunReport {
    run_watched(text, simulator, &|_| None)
}

/// Loads a scenario from a text.
pub(super) type Load<'a> = dyn Fn(&str) -> Checked + 'a;

/// Runs a scenario text; `watch` may give another scenario while it runs, and gets what loads one from a text.
pub(super) fn run_watched(text: &str, simulator: Simulator<'_>, watch: &dyn Fn(&Load<'_>) -> Option<Scenario>) -> RunReport {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scenario.yaml");
    let assets = Assets::open(Some(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenarios"))).unwrap();
    let load = |text: &str| {
        std::fs::write(&path, text).unwrap();
        Checked::load(&assets, &path, &[]).unwrap()
    };
    let checked = load(text);
    let never = AtomicBool::new(false);
    run(&RunRequest {
        scenario: &checked.scenario,
        registry: &checked.registry,
        assets: &assets,
        model: &checked.model,
        reach: checked.reach.clone(),
        instruction: checked.scenario.instruction.as_ref().unwrap().value.clone(),
        seed: 5,
        folder: None,
        interrupted: &never,
        simulator,
        resumed: None,
        stop_after: None,
        groot2: None,
        foxglove: None,
        is_recorded: true,
        tap: None,
        control: None,
        watch: &|| watch(&load),
        on_stage: &|_, _| {},
    })
    .unwrap()
}

const LIFT: &str = include_str!("../../../tests/e2e/scenarios/lift.yaml");

/// The scenario up to the choice of the palm pose: nothing moves.
fn decision_only() -> String {
    let (before, after) = LIFT.split_once("        - synthesize_grasp\n").unwrap();
    let (_, success) = after.split_once("success:").unwrap();
    format!("{before}success:{success}")
}

#[test]
fn a_lying_truth_changes_no_command() {
    let honest = run_with(LIFT, Simulator::default());
    let poison = |judge: JudgeHandle| judge.poisoned(TruthPoison { shift_m: sfg_types::Vector::x(), rotate_labels: 1 });
    let poisoned = run_with(LIFT, Simulator { prepare: &poison, ..Simulator::default() });
    assert!(honest.stages.iter().any(|stage| stage.stage == "lift" && stage.failure.is_none()), "{:?}", honest.failure);
    // Every stage hashes what it decided on, joint positions and motor feedback included.
    assert_eq!(
        serde_json::to_string(&honest.stages).unwrap(),
        serde_json::to_string(&poisoned.stages).unwrap(),
        "a stage read the truth"
    );
    assert_eq!(honest.duration_secs, poisoned.duration_secs);
}

#[test]
fn without_cameras_the_run_ends_at_its_first_look() {
    let options = SimOptions { cut_cameras: true, ..SimOptions::default() };
    let report = run_with(LIFT, Simulator { options, ..Simulator::default() });
    let failure = report.failure.unwrap();
    assert_eq!(failure.reason, FailureReason::NoView.name());
    assert!(failure.node.ends_with("observe_scene"), "{}", failure.node);
    assert_eq!(report.outcome, Outcome::TreeFailure);
}

/// The chosen palm pose.
fn chosen_palm(report: &RunReport) -> sfg_types::Pose {
    let stage = report.stages.iter().find(|stage| stage.stage == "select_palm_pose").unwrap();
    serde_json::from_value(stage.details["candidate"]["base_from_palm"].clone()).unwrap()
}

#[test]
fn a_palm_pose_moves_with_an_object_that_moved_after_loading() {
    let text = decision_only();
    let moved_by = |dx_m: f64, dy_m: f64| {
        let displace = |judge: JudgeHandle| {
            judge.displace_object("bottle", dx_m, dy_m, 0.0).unwrap();
            judge
        };
        chosen_palm(&run_with(&text, Simulator { prepare: &displace, ..Simulator::default() }))
    };
    let here = chosen_palm(&run_with(&text, Simulator::default()));
    for (dx_m, dy_m) in [(0.0, -0.05), (0.05, 0.0), (-0.05, 0.0), (0.0, 0.05)] {
        let there = moved_by(dx_m, dy_m);
        let followed = there.translation.vector - here.translation.vector;
        let miss_m = (followed - sfg_types::Vector::new(dx_m, dy_m, 0.0)).norm();
        assert!(miss_m < 0.01, "moved by ({dx_m}, {dy_m}), the palm missed that by {miss_m:.3} m");
        assert!(there.rotation.angle_to(&here.rotation) < 0.05);
    }
}

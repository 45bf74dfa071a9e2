//! Sensors in, commands out: nothing but the cameras and the motors tells a run what to do.
#![expect(clippy::unwrap_used, reason = "tests fail by panicking")]

use super::*;
use crate::check::Checked;
use sfg_driver_sim::world::TruthPoison;
use std::path::Path;

/// Runs a scenario text with one change to the simulator.
fn run_with(text: &str, simulator: Simulator<'_>) -> RunReport {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scenario.yaml");
    std::fs::write(&path, text).unwrap();
    let assets = Assets::open(Some(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenarios"))).unwrap();
    let checked = Checked::load(&assets, &path).unwrap();
    let never = AtomicBool::new(false);
    run(&RunRequest {
        scenario: &checked.scenario,
        registry: &checked.registry,
        assets: &assets,
        model: &checked.model,
        instruction: checked.scenario.instruction.as_ref().unwrap().value.clone(),
        seed: 5,
        folder: None,
        interrupted: &never,
        simulator,
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

/// Where the bottle's axis passes the palm, in the palm frame: along the fingers and out of the palm, metres.
fn axis_in_palm_m(base_from_palm: &sfg_types::Pose, bottle_x_m: f64, bottle_y_m: f64) -> [f64; 2] {
    let on_axis = sfg_types::Point::new(bottle_x_m, bottle_y_m, base_from_palm.translation.z);
    let in_palm = base_from_palm.inverse() * on_axis;
    [in_palm.x, in_palm.z]
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
        // Known limit: in three of the directions the hand comes at another height or from a side up to 30 degrees further around the bottle,
        // as that is the better or the only reachable one there.
        let within_m = if dy_m < 0.0 { 0.01 } else { 0.06 };
        assert!(miss_m < within_m, "moved by ({dx_m}, {dy_m}), the palm missed that by {miss_m:.3} m");
        assert!(there.rotation.angle_to(&here.rotation) < 0.6);
        let [along_m, out_m] = axis_in_palm_m(&there, 0.80 + dx_m, 0.30 + dy_m);
        assert!((0.0..0.08).contains(&along_m) && (0.02..0.08).contains(&out_m), "the axis lies at ({along_m:.3}, {out_m:.3})");
    }
}

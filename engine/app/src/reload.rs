//! A scenario that changes while it runs.
#![expect(clippy::unwrap_used, reason = "tests fail by panicking")]

use super::*;
use std::cell::Cell;

/// Runs a scenario text; at each look for changes, every 0.2 s of robot time, `change` may give another text.
fn run_with(text: &str, change: &dyn Fn(u32) -> Option<String>) -> RunReport {
    let n_looks = Cell::new(0);
    let watch = |load: &sensors_in::Load<'_>| {
        n_looks.set(n_looks.get() + 1);
        change(n_looks.get()).map(|text| load(&text).scenario)
    };
    sensors_in::run_watched(text, Simulator::default(), &watch)
}

const POUR: &str = include_str!("../../../scenarios/01_pour.yaml");

fn stamp_secs(report: &RunReport, stage: &str) -> f64 {
    report.stages.iter().rev().find(|record| record.stage == stage && record.failure.is_none()).unwrap().stamp_secs
}

#[test]
fn a_reload_during_the_pour_slows_it_down_and_cannot_remove_it() {
    let pour_secs = |report: &RunReport| stamp_secs(report, "pour") - stamp_secs(report, "lift");
    let usual = run_with(POUR, &|_| None);
    let n_lifted = (stamp_secs(&usual, "lift") / WATCH_EVERY_SECS).ceil() as u32;
    let slower = run_with(POUR, &|n_looks| match n_looks {
        // It is pouring: the running node cannot go, its pace can change.
        n if n == n_lifted + 5 => Some(POUR.replace("\n    - pour\n", "\n")),
        n if n == n_lifted + 10 => Some(POUR.replace("\n    - pour\n", "\n    - pour: {pace: 0.5}\n")),
        _ => None,
    });
    assert_eq!(slower.failure, None);
    assert!(pour_secs(&slower) > 1.3 * pour_secs(&usual), "{} s and {} s", pour_secs(&slower), pour_secs(&usual));
}

const MOVES: &str = include_str!("../../../scenarios/00_move_joints.yaml");

#[test]
fn a_node_that_comes_later_is_changed_before_it_begins() {
    let usual = run_with(MOVES, &|_| None);
    let slower = run_with(MOVES, &|n_looks| (n_looks == 2).then(|| MOVES.replace("speed: 0.3", "speed: 0.1")));
    assert_eq!(slower.stages.len(), 2);
    assert!(slower.duration_secs > usual.duration_secs + 0.5, "{} s and {} s", slower.duration_secs, usual.duration_secs);
}

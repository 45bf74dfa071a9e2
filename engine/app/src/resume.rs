//! A pour that is stopped in its middle and goes on.
#![expect(clippy::unwrap_used, reason = "tests fail by panicking")]

use super::*;
use crate::check::Checked;
use std::cell::Cell;
use std::path::Path;

const POUR: &str = include_str!("../../../scenarios/01_pour.yaml");

/// Runs the pour with seed 3 into `folder`; stops at the `stop_at`-th look of the watch, which is every 0.2 s of robot time.
fn pour(folder: &Path, stop_at: Option<u32>, resumed: Option<&Stopped>) -> RunReport {
    let path = folder.join("scenario.yaml");
    std::fs::write(&path, POUR).unwrap();
    let assets = Assets::open(Some(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenarios"))).unwrap();
    let checked = Checked::load(&assets, &path, &[]).unwrap();
    let interrupted = AtomicBool::new(false);
    let n_looks = Cell::new(0);
    let watch = || {
        n_looks.set(n_looks.get() + 1);
        interrupted.fetch_or(Some(n_looks.get()) == stop_at, Ordering::Relaxed);
        None
    };
    run(&RunRequest {
        scenario: &checked.scenario,
        registry: &checked.registry,
        assets: &assets,
        model: &checked.model,
        reach: checked.reach.clone(),
        instruction: checked.scenario.instruction.as_ref().unwrap().value.clone(),
        seed: 3,
        folder: Some(folder.to_owned()),
        interrupted: &interrupted,
        simulator: Simulator::default(),
        resumed,
        stop_after: None,
        groot2: None,
        foxglove: None,
        is_recorded: false,
        tap: None,
        control: None,
        watch: &watch,
        on_stage: &|_, _| {},
    })
    .unwrap()
}

#[test]
fn a_pour_that_is_stopped_in_its_tilt_goes_on_tilting() {
    let folder = tempfile::tempdir().unwrap();
    let stopped = pour(folder.path(), Some(100), None);
    assert_eq!(stopped.outcome, Outcome::Interrupted);
    let text = std::fs::read_to_string(folder.path().join(crate::stopped::FILE)).unwrap();
    assert!(text.contains(r#"phase\":\"tilt"#), "the pour was to be stopped in its tilt");
    let state = crate::stopped::read(folder.path()).unwrap();
    let resumed = pour(folder.path(), None, Some(&state.stopped));
    assert_eq!(resumed.outcome, Outcome::Success, "{:?}", resumed.failure);
    let stages: Vec<&str> = resumed.stages.iter().map(|stage| stage.stage.as_str()).collect();
    assert_eq!(stages, ["pour"], "nothing is done again");
}

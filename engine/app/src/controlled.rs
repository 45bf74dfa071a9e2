//! A run that somebody pauses, steps, forces and stops.
#![expect(clippy::unwrap_used, reason = "tests fail by panicking")]

use super::*;
use crate::check::Checked;
use serde_json::Value;
use sfg_monitor::{At, Command, Forcible};
use sfg_record::Recorded;
use std::path::Path;
use std::sync::{Arc, Mutex};

const MOVES: &str = include_str!("../../../scenarios/00_move_joints.yaml");
/// Longer than any of this takes.
const PATIENCE: Duration = Duration::from_secs(120);

type Messages = Mutex<Vec<(String, Value)>>;

/// What the user at the page does and sees.
struct User {
    control: Arc<Control>,
    messages: Arc<Messages>,
}

impl User {
    fn order(&self, command: &Command) {
        self.control.order(command).unwrap();
    }

    fn wait(&self, what: &str, is_so: impl Fn(&Self) -> bool) {
        let begun = Instant::now();
        while !is_so(self) {
            assert!(begun.elapsed() < PATIENCE, "never: {what}");
            std::thread::sleep(Duration::from_millis(2));
        }
    }

    fn wait_paused(&self) {
        // A run that has not begun stands, too, and knows no node yet.
        let is_held = |user: &Self| user.control.is_paused() && user.control.turn().go == Go::Hold;
        self.wait("paused", |user| !user.all("/robot").is_empty() && is_held(user));
    }

    fn all(&self, topic: &str) -> Vec<Value> {
        let messages = self.messages.lock().unwrap();
        messages.iter().filter(|(found, _)| found == topic).map(|(_, message)| message.clone()).collect()
    }

    fn n_ticks(&self) -> u64 {
        self.all("/journal").last().map_or(0, |message| message["tick"].as_u64().unwrap())
    }

    /// The newest joint speeds that were sent or measured.
    fn q(&self) -> Vec<f64> {
        self.all("/robot").last().map_or_else(Vec::new, |sample| serde_json::from_value(sample["q"].clone()).unwrap())
    }
}

/// Runs the scripted motion while `act` is at the page; the report and what the recording says on replay.
fn run_with(control: Control, act: impl FnOnce(&User)) -> (RunReport, Option<sfg_tree::Divergence>) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scenario.yaml");
    std::fs::write(&path, MOVES).unwrap();
    let user = User { control: Arc::new(control), messages: Arc::default() };
    let (control, messages) = (Arc::clone(&user.control), Arc::clone(&user.messages));
    let run_folder = folder.path().join("run");
    let tap: Tap = Arc::new(move |recorded: &Recorded<'_>| {
        if let Recorded::Message { topic, bytes, .. } = recorded
            && ["/robot", "/journal"].contains(topic)
        {
            messages.lock().unwrap().push(((*topic).to_owned(), serde_json::from_slice(bytes).unwrap()));
        }
    });
    std::thread::scope(|scope| {
        let run_folder = &run_folder;
        let running = scope.spawn(move || {
            let assets = Assets::open(Some(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenarios"))).unwrap();
            let checked = Checked::load(&assets, &path, &[]).unwrap();
            let never = AtomicBool::new(false);
            let report = run(&RunRequest {
                scenario: &checked.scenario,
                registry: &checked.registry,
                assets: &assets,
                model: &checked.model,
                reach: checked.reach.clone(),
                instruction: checked.scenario.instruction.as_ref().unwrap().value.clone(),
                seed: 5,
                folder: Some(run_folder.clone()),
                interrupted: &never,
                simulator: Simulator::default(),
                resumed: None,
                stop_after: None,
                groot2: None,
                foxglove: None,
                is_recorded: true,
                tap: Some(tap),
                control: Some(&control),
                watch: &|| None,
                on_stage: &|_, _| {},
            })
            .unwrap();
            let recorded = sfg_record::read_run(&run_folder.join("run.mcap")).unwrap();
            let replayed = sfg_tree::replay(&checked.registry, &checked.scenario.tree, &recorded.journal).unwrap();
            (report, replayed.divergence)
        });
        let acted = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| act(&user)));
        if let Err(panic) = acted {
            // Otherwise the run would wait for the user for ever.
            drop(user.control.order(&Command::Stop));
            std::panic::resume_unwind(panic);
        }
        running.join().unwrap()
    })
}

#[test]
fn a_paused_robot_stands_and_then_ends_its_motion() {
    let (report, divergence) = run_with(Control::new(), |user| {
        user.wait("in the middle of the motion", |user| user.n_ticks() > 200);
        user.order(&Command::Pause);
        user.wait_paused();
        let n_ticks = user.n_ticks();
        std::thread::sleep(Duration::from_secs(1));
        let (before, n_before) = (user.q(), user.all("/robot").len());
        std::thread::sleep(Duration::from_secs(1));
        assert!(user.all("/robot").len() > n_before + 10, "the robot is still commanded and recorded");
        let moved = before.iter().zip(user.q()).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(moved < 1e-3, "it moved by {moved} rad while paused");
        assert_eq!(user.n_ticks(), n_ticks, "the tree is not ticked");
        user.order(&Command::Continue);
        // Going on in the middle of the ramp to rest must not jerk.
        user.wait("under way again", |user| user.n_ticks() > n_ticks + 100);
        user.order(&Command::Pause);
        user.order(&Command::Continue);
    });
    assert_eq!(report.failure, None);
    assert_eq!(report.stages.len(), 2);
    assert_eq!(divergence, None);
}

#[test]
fn a_step_is_one_tick() {
    run_with(Control::paused(), |user| {
        for n in 1..=3 {
            user.wait_paused();
            user.order(&Command::Step);
            user.wait("the tick", |user| user.n_ticks() == n);
        }
        user.wait_paused();
        assert_eq!(user.n_ticks(), 3);
        user.order(&Command::Continue);
    });
}

#[test]
fn a_forced_failure_ends_the_node_and_says_so() {
    let (report, divergence) = run_with(Control::paused(), |user| {
        user.wait_paused();
        user.order(&Command::Continue);
        user.wait("the first motion", |user| user.n_ticks() > 20);
        user.order(&Command::Force { node: "sequence/bend".to_owned(), status: Forcible::Success });
        user.order(&Command::Force { node: "sequence/stretch".to_owned(), status: Forcible::Failure });
    });
    let failure = report.failure.unwrap();
    assert_eq!((failure.reason.as_str(), failure.node.as_str()), ("forced", "sequence/stretch"));
    assert_eq!(divergence, None);
}

#[test]
fn a_forced_success_in_mid_motion_lets_the_next_motion_begin_from_rest() {
    let (report, divergence) = run_with(Control::new(), |user| {
        user.wait("in the middle of the first motion", |user| user.n_ticks() > 200);
        user.order(&Command::Force { node: "sequence/bend".to_owned(), status: Forcible::Success });
    });
    assert_eq!(report.failure, None);
    assert_eq!(divergence, None);
}

#[test]
fn a_breakpoint_stops_before_its_node_and_the_emergency_stop_works_while_paused() {
    let (report, _) = run_with(Control::paused(), |user| {
        user.wait_paused();
        user.order(&Command::Break { node: "sequence/stretch".to_owned(), at: At::Start, on: true });
        user.order(&Command::Continue);
        user.wait("under way", |user| user.n_ticks() > 0);
        user.wait_paused();
        let has_bent =
            user.all("/journal").iter().any(|message| message.to_string().contains(r#""sequence/bend","running","success""#));
        assert!(has_bent, "the node before it has ended");
        user.order(&Command::Stop);
    });
    assert_eq!(report.outcome, Outcome::Interrupted);
    assert_eq!(report.failure.unwrap().reason, FailureReason::EmergencyStop.name());
}

//! Forced results, breaks and time that stands still.

#![allow(clippy::unwrap_used, reason = "tests fail by panicking")]

use sfg_tree::{
    Action, Break, BreakAt, Change, Failure, Halt, JournalLevel, NodeSpec, Outcome, Progress, Registry, Status, Tick, Tree,
    TreeSpec,
};

/// What was called, in order.
type Log = Vec<String>;

#[derive(Default)]
struct Work {
    n_polls: u32,
}

impl Action<Log> for Work {
    fn start(&mut self, tick: &mut Tick<'_, Log>) -> Outcome {
        self.n_polls = 0;
        tick.context.push("start".to_owned());
        Ok(Progress::Running)
    }
    fn poll(&mut self, tick: &mut Tick<'_, Log>) -> Outcome {
        self.n_polls += 1;
        tick.context.push("poll".to_owned());
        Ok(if self.n_polls == 2 { Progress::Success } else { Progress::Running })
    }
    fn halt(&mut self, tick: &mut Tick<'_, Log>) -> Halt {
        tick.context.push("halt".to_owned());
        Halt::Done
    }
}

fn registry() -> Registry<Log> {
    let mut registry = Registry::new();
    registry.action("work", [], Work::default);
    registry.condition("holds", [], |tick: &mut Tick<'_, Log>| {
        tick.context.push("asked".to_owned());
        Ok(true)
    });
    registry
}

fn named(kind: &str, children: Vec<NodeSpec>) -> NodeSpec {
    NodeSpec::new(kind.to_owned()).children(children)
}

fn spec(root: NodeSpec) -> TreeSpec {
    TreeSpec::new(root)
}

fn two() -> TreeSpec {
    spec(named("sequence", vec![named("work", Vec::new()), named("work", Vec::new())]))
}

fn built(spec: &TreeSpec) -> Tree<Log> {
    let mut tree = registry().build(spec).unwrap();
    tree.set_journal_level(JournalLevel::Values);
    tree
}

#[test]
fn a_running_node_is_halted_and_gives_the_forced_result() {
    let (mut tree, mut log) = (built(&two()), Log::new());
    assert_eq!(tree.tick(0.0, &mut log), Status::Running);
    let first = tree.node_at("sequence/work").unwrap();
    tree.force(first, Ok(()));
    // The first counts as done without another poll, so the second starts at once.
    assert_eq!(tree.tick(0.1, &mut log), Status::Running);
    assert_eq!(log, ["start", "halt", "start"]);
    assert_eq!(tree.status(first), Status::Success);
    let second = tree.node_at("sequence/work#2").unwrap();
    tree.force(second, Err(Failure::new("forced", "by a test")));
    assert_eq!(tree.tick(0.2, &mut log), Status::Failure);
    assert_eq!(log.last().unwrap(), "halt");
    let failure = tree.failure().unwrap();
    assert_eq!((failure.node, failure.failure.reason.as_ref()), (second, "forced"));
    let n_forced = tree.drain_journal().iter().filter(|record| matches!(record.change, Change::Forced(_))).count();
    assert_eq!(n_forced, 2);
}

#[test]
fn a_node_that_does_not_run_gives_it_the_next_time_and_only_once() {
    let spec = spec(named("sequence", vec![named("work", Vec::new())]));
    let (mut tree, mut log) = (built(&spec), Log::new());
    let work = tree.node_at("sequence/work").unwrap();
    tree.force(work, Err(Failure::new("forced", "")));
    tree.force(work, Ok(()));
    assert_eq!(tree.tick(0.0, &mut log), Status::Success);
    assert!(log.is_empty(), "it did not act: {log:?}");
    assert_eq!(tree.tick(0.1, &mut log), Status::Running);
    assert_eq!(log, ["start"]);
}

#[test]
fn a_forced_composite_halts_what_runs_below_it_once() {
    let spec = spec(named("fallback", vec![named("sequence", vec![named("work", Vec::new())]), named("work", Vec::new())]));
    let (mut tree, mut log) = (built(&spec), Log::new());
    tree.tick(0.0, &mut log);
    let sequence = tree.node_at("fallback/sequence").unwrap();
    tree.force(sequence, Err(Failure::new("forced", "")));
    assert_eq!(tree.tick(0.1, &mut log), Status::Running);
    assert_eq!(log, ["start", "halt", "start"]);
    assert_eq!(tree.status(tree.node_at("fallback/sequence/work").unwrap()), Status::Idle);
    tree.halt(&mut log);
    assert!((0..4).all(|id| tree.status(id) == Status::Idle));
}

#[test]
fn a_break_before_an_action_lets_it_start_in_the_next_tick() {
    let (mut tree, mut log) = (built(&two()), Log::new());
    let first = tree.node_at("sequence/work").unwrap();
    tree.set_breaks([(first, BreakAt { start: true, end: false })]);
    assert_eq!(tree.tick(0.0, &mut log), Status::Running);
    assert!(log.is_empty(), "it has not started: {log:?}");
    assert_eq!(tree.take_breaks(), [Break { node: first, is_end: false }]);
    tree.tick(0.1, &mut log);
    assert_eq!(log, ["start"]);
    assert!(tree.take_breaks().is_empty());
}

#[test]
fn a_break_at_the_end_keeps_the_next_action_from_starting() {
    let (mut tree, mut log) = (built(&two()), Log::new());
    let first = tree.node_at("sequence/work").unwrap();
    tree.set_breaks([(first, BreakAt { start: false, end: true })]);
    for tick in 0..3 {
        tree.tick(f64::from(tick), &mut log);
    }
    assert_eq!(log, ["start", "poll", "poll"]);
    assert_eq!(tree.take_breaks(), [Break { node: first, is_end: true }]);
    assert_eq!(tree.status(first), Status::Success);
    tree.tick(3.0, &mut log);
    assert_eq!(log, ["start", "poll", "poll", "start"]);
    // Halted while it waits, an action is not called at all.
    tree.set_breaks([(first, BreakAt { start: true, end: false })]);
    tree.halt(&mut log);
    log.clear();
    tree.tick(4.0, &mut log);
    tree.halt(&mut log);
    assert!(log.is_empty(), "{log:?}");
}

#[test]
fn breaks_leave_conditions_and_running_actions_as_they_are() {
    let spec = spec(named("reactive_sequence", vec![named("holds", Vec::new()), named("work", Vec::new())]));
    let (mut plain, mut log) = (built(&spec), Log::new());
    let (mut watched, mut watched_log) = (built(&spec), Log::new());
    plain.tick(0.0, &mut log);
    watched.tick(0.0, &mut watched_log);
    let holds = watched.node_at("reactive_sequence/holds").unwrap();
    watched.set_breaks([(holds, BreakAt { start: true, end: true })]);
    for tick in 1..4 {
        assert_eq!(plain.tick(f64::from(tick), &mut log), watched.tick(f64::from(tick), &mut watched_log));
    }
    assert_eq!(watched.take_breaks().len(), 6);
    // The last tick begins anew, so there its action waits.
    log.pop();
    assert_eq!(log, watched_log);
}

#[test]
fn time_that_stood_still_does_not_count() {
    let timeout = named("timeout", vec![named("work", Vec::new())]).with("secs", 1.0);
    let (mut tree, mut log) = (built(&spec(timeout)), Log::new());
    assert_eq!(tree.tick(0.0, &mut log), Status::Running);
    tree.postpone(10.0);
    assert_eq!(tree.tick(10.5, &mut log), Status::Running);
    assert_eq!(tree.tick(11.5, &mut log), Status::Failure);
    assert_eq!(tree.failure().unwrap().failure.reason, "timeout");
}

#[test]
fn interventions_replay() {
    let (mut tree, mut log) = (built(&two()), Log::new());
    tree.tick(0.0, &mut log);
    tree.force(tree.node_at("sequence/work").unwrap(), Ok(()));
    tree.postpone(5.0);
    for tick in 1..4 {
        tree.tick(5.0 + f64::from(tick), &mut log);
    }
    tree.force(0, Err(Failure::new("forced", "")));
    tree.tick(9.0, &mut log);
    let names = tree.names();
    let records: Vec<_> = tree.drain_journal().into_iter().map(|record| names.of(record)).collect();
    let replayed = sfg_tree::replay(&registry(), &two(), &records).unwrap();
    assert_eq!(replayed.divergence, None);
    assert_eq!(replayed.n_ticks, 5);
}

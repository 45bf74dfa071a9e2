//! Running a recorded run again: the tree decides anew, its leaves give what they gave then.

use crate::action::{Action, Halt, Tick};
use crate::blackboard;
use crate::journal::{JournalLevel, NamedChange, NamedRecord};
use crate::literal::Literal;
use crate::problem::BuildError;
use crate::registry::Registry;
use crate::spec::TreeSpec;
use crate::status::{Failure, Outcome, Progress, Status};
use crate::tree::{NONE, NodeId, Tree};
use std::collections::{HashMap, VecDeque};
use std::fmt::Write as _;

/// The first moment at which a tree decides otherwise than it did when it was recorded.
#[derive(Clone, Debug, PartialEq)]
pub struct Divergence {
    /// Number of the tick, from 1.
    pub tick_idx: u64,
    /// Time of that tick.
    pub now_secs: f64,
    /// What the record has: `sequence/lift: running -> success`, or nothing.
    pub recorded: String,
    /// What happens now.
    pub replayed: String,
}

/// How a replay went.
#[derive(Clone, Debug, PartialEq)]
pub struct Replayed {
    /// Ticks that were run again.
    pub n_ticks: u64,
    /// Result of the last tick.
    pub status: Status,
    /// The first difference, if any. The replay ends there.
    pub divergence: Option<Divergence>,
}

/// What a leaf did in one step of the record.
enum Did {
    Wrote { key: String, value: Option<Literal> },
    Became(Status, Option<Failure>),
    WasHalted,
}

/// The recorded results of leaves, and where the replay is.
struct Playback {
    /// By path, with the number of the step.
    calls: HashMap<String, VecDeque<(usize, Did)>>,
    last: HashMap<NodeId, (Status, Option<Failure>)>,
    paths: Vec<String>,
    slots: HashMap<String, u32>,
    step_idx: usize,
    /// A leaf was ticked that the record does not have.
    stray: Option<NodeId>,
}

/// One tick or halt of the record.
struct Step<'a> {
    tick_idx: u64,
    now_secs: f64,
    is_halt: bool,
    changes: Vec<(&'a str, Status, Status)>,
    /// What its owner did to the tree before it.
    interventions: Vec<&'a NamedRecord>,
    /// What the application wrote before it.
    entries: Vec<(&'a str, &'a Literal)>,
}

/// Runs `records`, made at [`JournalLevel::Values`], again with the tree of `spec`.
///
/// Actions, conditions and steps of the application are not called: each gives what it gave then and writes the values it
/// wrote, where these have the form of a literal. Everything else is decided anew, scripts and times included. A changed
/// tree shows where it first decides otherwise.
///
/// # Errors
/// The mistakes of `spec`.
pub fn replay<C>(registry: &Registry<C>, spec: &TreeSpec, records: &[NamedRecord]) -> Result<Replayed, Vec<BuildError>> {
    let registry = registry.with_leaves(|| Box::new(PlaybackAction), |tick| play(tick, true));
    let mut tree = registry.build(spec)?;
    tree.set_journal_level(JournalLevel::Transitions);
    let steps = steps_of(records);
    let slots = tree.slot_keys.iter().cloned().zip(0..).collect();
    let (calls, last, paths) = (calls_of(records), HashMap::new(), tree.unique_paths());
    let mut playback = Playback { calls, last, paths, slots, step_idx: 0, stray: None };
    let mut replayed = Replayed { n_ticks: 0, status: Status::Idle, divergence: None };
    for (step_idx, step) in steps.iter().enumerate() {
        playback.step_idx = step_idx;
        for (key, value) in &step.entries {
            if let Some(&slot) = playback.slots.get(*key) {
                put(&mut tree, slot, value);
            }
        }
        for record in &step.interventions {
            match (&record.change, playback.paths.iter().position(|path| *path == record.path)) {
                (NamedChange::Forced(result), Some(node)) => tree.force(node as NodeId, result.clone()),
                (NamedChange::Postponed { secs }, _) => tree.postpone(*secs),
                _ => {}
            }
        }
        if step.is_halt {
            tree.halt(&mut playback);
        } else {
            // A resumed run does not begin with tick 1.
            tree.run.tick_idx = step.tick_idx.saturating_sub(1);
            replayed.status = tree.tick(step.now_secs, &mut playback);
            replayed.n_ticks += 1;
        }
        let records = tree.drain_journal();
        let changes: Vec<(&str, Status, Status)> = records
            .iter()
            .filter_map(|record| match record.change {
                crate::Change::Status { from, to } => Some((playback.paths[record.node as usize].as_str(), from, to)),
                _ => None,
            })
            .collect();
        let n_same = changes.iter().zip(&step.changes).take_while(|(now, then)| now == then).count();
        let has_stray = playback.stray.is_some();
        if has_stray || n_same < changes.len() || n_same < step.changes.len() {
            let text = |change: Option<&(&str, Status, Status)>| {
                change
                    .map_or_else(|| "nothing more in this tick".to_owned(), |(path, from, to)| format!("{path}: {from} -> {to}"))
            };
            let mut now = text(changes.get(n_same));
            if let Some(stray) = playback.stray.filter(|_| n_same >= step.changes.len()) {
                let _infallible = write!(now, " ({} is ticked and was not then)", playback.paths[stray as usize]);
            }
            replayed.divergence = Some(Divergence {
                tick_idx: step.tick_idx,
                now_secs: step.now_secs,
                recorded: text(step.changes.get(n_same)),
                replayed: now,
            });
            return Ok(replayed);
        }
    }
    Ok(replayed)
}

fn put(tree: &mut Tree<Playback>, slot: u32, literal: &Literal) {
    if let Ok(value) = tree.value_of_literal(slot as usize, literal) {
        tree.run.put(NONE, slot, Some(value), None);
    }
}

fn steps_of(records: &[NamedRecord]) -> Vec<Step<'_>> {
    let mut steps: Vec<Step<'_>> = Vec::new();
    let (mut entries, mut interventions) = (Vec::new(), Vec::new());
    for record in records {
        match &record.change {
            NamedChange::Ticked | NamedChange::HaltAsked => steps.push(Step {
                tick_idx: record.tick_idx,
                now_secs: record.now_secs,
                is_halt: record.change == NamedChange::HaltAsked,
                changes: Vec::new(),
                interventions: std::mem::take(&mut interventions),
                entries: std::mem::take(&mut entries),
            }),
            NamedChange::Status { from, to } => {
                if let Some(step) = steps.last_mut() {
                    step.changes.push((&record.path, *from, *to));
                }
            }
            NamedChange::Write { key, value: Some(value) } if record.path.is_empty() => entries.push((key, value)),
            NamedChange::Forced(_) | NamedChange::Postponed { .. } => interventions.push(record),
            NamedChange::Write { .. } | NamedChange::Failed(_) => {}
        }
    }
    steps
}

fn calls_of(records: &[NamedRecord]) -> HashMap<String, VecDeque<(usize, Did)>> {
    let mut calls: HashMap<String, VecDeque<(usize, Did)>> = HashMap::new();
    let mut n_steps = 0_usize;
    let mut failures: HashMap<&str, Failure> = HashMap::new();
    for record in records {
        let did = match &record.change {
            NamedChange::Ticked | NamedChange::HaltAsked => {
                n_steps += 1;
                continue;
            }
            NamedChange::Forced(_) | NamedChange::Postponed { .. } => continue,
            NamedChange::Failed(failure) => {
                failures.insert(&record.path, failure.clone());
                continue;
            }
            NamedChange::Write { key, value } => Did::Wrote { key: key.clone(), value: value.clone() },
            NamedChange::Status { from: Status::Running, to: Status::Idle } => Did::WasHalted,
            // A parent made it idle.
            NamedChange::Status { to: Status::Idle, .. } => continue,
            NamedChange::Status { to, .. } => {
                let failure = failures.remove(record.path.as_str()).filter(|_| *to == Status::Failure);
                Did::Became(*to, failure)
            }
        };
        calls.entry(record.path.clone()).or_default().push_back((n_steps.saturating_sub(1), did));
    }
    calls
}

struct PlaybackAction;

impl Action<Playback> for PlaybackAction {
    fn start(&mut self, tick: &mut Tick<'_, Playback>) -> Outcome {
        play(tick, true)
    }
    fn poll(&mut self, tick: &mut Tick<'_, Playback>) -> Outcome {
        play(tick, false)
    }
    fn halt(&mut self, tick: &mut Tick<'_, Playback>) -> Halt {
        let (node, playback) = (tick.node as usize, &mut *tick.context);
        if let Some(calls) = playback.calls.get_mut(&playback.paths[node])
            && matches!(calls.front(), Some((step_idx, Did::WasHalted)) if *step_idx == playback.step_idx)
        {
            calls.pop_front();
        }
        Halt::Done
    }
}

/// What the leaf gave in this step of the record.
fn play(tick: &mut Tick<'_, Playback>, is_start: bool) -> Outcome {
    let node = tick.node;
    loop {
        let playback = &mut *tick.context;
        let step_idx = playback.step_idx;
        let mut calls = playback.calls.get_mut(&playback.paths[node as usize]);
        // What was forced upon the leaf it did not give itself.
        if let Some(calls) = &mut calls {
            while calls.front().is_some_and(|(at, _)| *at < step_idx) {
                calls.pop_front();
            }
        }
        let next = calls.filter(|calls| calls.front().is_some_and(|(at, _)| *at == step_idx)).and_then(VecDeque::pop_front);
        match next {
            Some((_, Did::Wrote { key, value })) => {
                let slot = playback.slots.get(&key).copied();
                if let (Some(slot), Some(value)) = (slot, value) {
                    let port_type = tick.slot_types[slot as usize].as_ref();
                    if let Ok(value) = blackboard::from_literal(&value, port_type, &tick.run.forms) {
                        tick.run.put(node, slot, Some(value), port_type);
                    }
                }
            }
            Some((_, Did::WasHalted)) => {}
            Some((_, Did::Became(status, failure))) => {
                playback.last.insert(node, (status, failure.clone()));
                return outcome(status, failure);
            }
            None if !is_start => return Ok(Progress::Running),
            // A result that is the same as the one before leaves no record.
            None => {
                return match playback.last.get(&node) {
                    Some((status @ (Status::Success | Status::Failure), failure)) => outcome(*status, failure.clone()),
                    _ => {
                        playback.stray.get_or_insert(node);
                        Err(Failure::new("not_recorded", "the record has no result of this node for this tick"))
                    }
                };
            }
        }
    }
}

fn outcome(status: Status, failure: Option<Failure>) -> Outcome {
    match status {
        Status::Running | Status::Idle => Ok(Progress::Running),
        Status::Success => Ok(Progress::Success),
        Status::Skipped => Ok(Progress::Skipped),
        Status::Failure => Err(failure.unwrap_or_else(|| Failure::new("not_recorded", "the record has no reason"))),
    }
}

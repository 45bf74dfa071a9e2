//! A runnable tree: ticking, halting, and what can be asked about it.

use crate::blackboard::{self, Blackboard, Form, Source, Stamp};
use crate::condition::{Conditions, Script};
use crate::intervene::Intervention;
use crate::journal::{Change, Journal, JournalLevel, Names, Record};
use crate::leaf::{Leaf, Stopping};
use crate::literal::Literal;
use crate::port::{PortType, Value};
use crate::problem::EntryError;
use crate::registry::{ListType, NodeClass, NodeModel};
use crate::status::{Failure, Status, reason};
use crate::waker::Waker;
use std::any::{Any, TypeId};
use std::collections::{BTreeMap, HashMap};
use std::fmt;
use std::sync::Arc;

/// Number of a node, in document order from 0.
pub type NodeId = u32;

/// What a node does when it is ticked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    /// An application's node.
    Leaf,
    Subtree,
    Sequence,
    AsyncSequence,
    SequenceWithMemory,
    Fallback,
    AsyncFallback,
    ReactiveSequence,
    ReactiveFallback,
    Parallel,
    ParallelAll,
    IfThenElse,
    WhileDoElse,
    Switch,
    TryCatch,
    Recover,
    Inverter,
    ForceSuccess,
    ForceFailure,
    Retry,
    Repeat,
    KeepRunning,
    Timeout,
    Delay,
    RateLimit,
    RunOnce,
    Loop,
    Precondition,
    SkipUnlessUpdated,
    WaitValueUpdate,
    WasEntryUpdated,
    SetBlackboard,
    UnsetBlackboard,
    Script,
    ScriptCondition,
    Sleep,
    AlwaysSuccess,
    AlwaysFailure,
}

impl Kind {
    /// Whether `count` stays when the node ends or is halted.
    fn has_memory(self) -> bool {
        matches!(
            self,
            Self::SequenceWithMemory
                | Self::RunOnce
                | Self::RateLimit
                | Self::SkipUnlessUpdated
                | Self::WaitValueUpdate
                | Self::WasEntryUpdated
        )
    }
}

/// Shape and state of one node.
#[derive(Clone, Debug)]
pub(crate) struct Node {
    pub(crate) kind: Kind,
    pub(crate) status: Status,
    /// [`crate::leaf::WAITING`].
    pub(crate) flags: u8,
    pub(crate) model: u32,
    pub(crate) parent: u32,
    pub(crate) first_child: u32,
    pub(crate) n_children: u32,
    pub(crate) first_source: u32,
    /// Number of the leaf, or of the script of a built-in node that has one.
    pub(crate) leaf: u32,
    /// Number of its conditions.
    pub(crate) conditions: u32,
    /// The child to go on with, or the running child of a node that chooses.
    pub(crate) cursor: u32,
    /// Rounds of a loop, successes of a parallel, children of a sequence that were not skipped.
    pub(crate) count: u32,
    /// Failures of a parallel.
    pub(crate) n_failed: u32,
    /// When it started, or when its time is over.
    pub(crate) deadline_secs: f64,
    /// Number of the write that it last saw.
    pub(crate) seen: u64,
}

/// No child, no parent, no script.
pub(crate) const NONE: u32 = u32::MAX;

/// A failure, its node and its time.
#[derive(Clone, Debug, PartialEq)]
pub struct FailureAt {
    /// The node that failed by itself: a leaf, or a decorator such as `timeout`.
    pub node: NodeId,
    /// Number of the tick, from 1.
    pub tick_idx: u64,
    /// Time handed to that tick.
    pub now_secs: f64,
    /// Why.
    pub failure: Failure,
}

/// One node as seen from outside.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NodeDefinition {
    /// Its number; a parent's is smaller than its children's.
    pub id: NodeId,
    /// Its parent.
    pub parent: Option<NodeId>,
    /// Its kind: `sequence`, `lift`, `subtree`.
    pub kind: String,
    /// Its own name, or the name of its subtree, or its kind.
    pub title: String,
    /// What it does with children.
    pub class: NodeClass,
    /// Where it was written.
    pub location: u32,
}

/// A blackboard as it was once; made by [`Tree::backup`].
#[derive(Clone)]
pub struct Backup(Blackboard);

impl fmt::Debug for Backup {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Backup").field("n_entries", &self.0.slots.len()).finish_non_exhaustive()
    }
}

/// Oldest failures are dropped beyond this number, so that an endless run stays small.
const MAX_FAILURE_HISTORY: usize = 1024;

/// The state that nodes share.
#[derive(Default)]
pub(crate) struct Runtime {
    pub(crate) board: Blackboard,
    pub(crate) journal: Journal,
    pub(crate) tick_idx: u64,
    pub(crate) now_secs: f64,
    pub(crate) failure: Option<FailureAt>,
    pub(crate) history: std::collections::VecDeque<FailureAt>,
    /// Running children of reactive nodes: halted before an action starts that clashes with them.
    pub(crate) preempted: Vec<NodeId>,
    /// Running actions that declared what they occupy.
    pub(crate) active: Vec<NodeId>,
    /// Actions that were halted and still stop.
    pub(crate) stopping: Vec<Stopping>,
    /// A node has work for another tick at once.
    pub(crate) wants_tick: bool,
    pub(crate) waker: Waker,
    pub(crate) intervention: Intervention,
    pub(crate) forms: Arc<HashMap<TypeId, Form>>,
}

impl Runtime {
    pub(crate) fn note(&mut self, node: NodeId, change: Change) {
        self.journal.records.push(Record { tick_idx: self.tick_idx, now_secs: self.now_secs, node, change });
    }

    /// Writes down a failure that decides nothing.
    pub(crate) fn note_failure(&mut self, node: NodeId, failure: Failure) {
        let decided = self.failure.take();
        self.fail(node, failure);
        self.failure = decided;
    }

    /// Makes `failure` the one that explains why the tree fails.
    pub(crate) fn fail(&mut self, node: NodeId, failure: Failure) -> Status {
        if self.journal.level != JournalLevel::Off {
            self.note(node, Change::Failed(Box::new(failure.clone())));
        }
        let failure = FailureAt { node, tick_idx: self.tick_idx, now_secs: self.now_secs, failure };
        // A false condition is an everyday answer, not an event worth keeping.
        if failure.failure.reason != reason::CONDITION_FALSE {
            if self.history.len() == MAX_FAILURE_HISTORY {
                self.history.pop_front();
            }
            self.history.push_back(failure.clone());
        }
        self.failure = Some(failure);
        Status::Failure
    }

    /// Writes a value that others hold too, or empties the entry.
    pub(crate) fn put(&mut self, node: NodeId, slot: u32, value: Option<Value>, port_type: Option<&PortType>) {
        self.board.put(slot, value, self.now_secs);
        self.note_write(node, slot, port_type);
    }

    #[inline]
    pub(crate) fn note_write(&mut self, node: NodeId, slot: u32, port_type: Option<&PortType>) {
        if self.journal.level >= JournalLevel::Writes {
            let value = match &self.board.slots[slot as usize].value {
                Some(value) if self.journal.level == JournalLevel::Values => {
                    blackboard::to_journal(value, port_type, &self.forms).map(Box::new)
                }
                _ => None,
            };
            self.note(node, Change::Write { slot, value });
        }
    }
}

/// A checked tree with its blackboard and state. Made by [`crate::Registry::build`].
pub struct Tree<C> {
    pub(crate) nodes: Vec<Node>,
    pub(crate) children: Vec<NodeId>,
    pub(crate) sources: Vec<Source>,
    pub(crate) leaves: Vec<Leaf<C>>,
    pub(crate) scripts: Vec<Script>,
    pub(crate) conditions: Vec<Conditions>,
    pub(crate) lists: Vec<ListType>,
    pub(crate) models: Arc<Vec<NodeModel>>,
    pub(crate) titles: BTreeMap<NodeId, String>,
    pub(crate) locations: Vec<u32>,
    pub(crate) slot_keys: Vec<String>,
    pub(crate) slot_types: Vec<Option<crate::port::PortType>>,
    pub(crate) root_keys: BTreeMap<String, u32>,
    /// Failures that nodes come back to: of a `run_once`, of what a `try_catch` tried.
    pub(crate) kept: BTreeMap<NodeId, FailureAt>,
    pub(crate) run: Runtime,
}

impl<C> Tree<C> {
    /// Ticks the tree once at time `now_secs`, which must not go back. A tree that has finished starts anew on the next tick.
    pub fn tick(&mut self, now_secs: f64, context: &mut C) -> Status {
        self.run.tick_idx += 1;
        self.run.now_secs = now_secs;
        self.run.wants_tick = false;
        self.run.intervention.is_breaking = false;
        self.note_step(Change::Ticked);
        if !self.run.stopping.is_empty() {
            self.poll_stopping(context);
        }
        if self.nodes[0].status != Status::Running {
            self.run.failure = None;
        }
        let status = self.tick_node(0, context);
        if status != Status::Running {
            self.set_status(0, Status::Idle);
        }
        status
    }

    /// Halts what runs. Afterwards every node is idle; blackboard entries stay. An action may need longer to stop:
    /// [`Tree::poll_halt`] tells when all have.
    pub fn halt(&mut self, context: &mut C) {
        self.note_step(Change::HaltAsked);
        self.run.intervention.forced.clear();
        self.halt_node(0, context);
    }

    fn note_step(&mut self, change: Change) {
        if self.run.journal.level == JournalLevel::Values {
            self.run.note(0, change);
        }
    }

    /// Names of nodes and entries, for journals that outlive the tree.
    #[must_use]
    pub fn names(&self) -> Names {
        Names { paths: self.unique_paths(), keys: self.slot_keys.clone() }
    }

    /// Whether every halted action has stopped; asks those that had not. For use after [`Tree::halt`], at the period of the ticks.
    pub fn poll_halt(&mut self, now_secs: f64, context: &mut C) -> bool {
        self.run.now_secs = now_secs;
        self.poll_stopping(context);
        self.run.stopping.is_empty()
    }

    /// The halted actions that have not stopped yet.
    pub fn stopping(&self) -> impl Iterator<Item = NodeId> + '_ {
        self.run.stopping.iter().map(|stopping| stopping.node)
    }

    /// The time handed to the last tick.
    #[must_use]
    pub fn now_secs(&self) -> f64 {
        self.run.now_secs
    }

    /// Ends a wait for the next tick, from any thread.
    #[must_use]
    pub fn waker(&self) -> Waker {
        self.run.waker.clone()
    }

    /// Whether a node has work for another tick at once, so that waiting for the period would waste time.
    #[must_use]
    pub fn wants_tick(&self) -> bool {
        self.run.wants_tick
    }

    /// Forgets what outlives a run: which `run_once` is done, where a `sequence_with_memory` stood, which writes were seen.
    pub fn reset(&mut self, context: &mut C) {
        self.halt(context);
        for node in &mut self.nodes {
            (node.cursor, node.count, node.n_failed, node.seen) = (0, 0, 0, 0);
        }
        self.kept.clear();
    }

    /// Status of a node between ticks.
    ///
    /// # Panics
    /// If the tree has no such node.
    #[must_use]
    pub fn status(&self, node: NodeId) -> Status {
        self.nodes[node as usize].status
    }

    /// How many nodes the tree has; their numbers are smaller.
    #[must_use]
    pub fn n_nodes(&self) -> usize {
        self.nodes.len()
    }

    /// Why the tree failed: the failure that decided its last result.
    #[must_use]
    pub fn failure(&self) -> Option<&FailureAt> {
        self.run.failure.as_ref()
    }

    /// The failures of the run in order, recovered ones too; false conditions and all but the newest 1024 left out.
    pub fn failures(&self) -> impl Iterator<Item = &FailureAt> {
        self.run.history.iter()
    }

    /// The way from the root to a node: `sequence/retry/lift`.
    ///
    /// # Panics
    /// If the tree has no such node.
    #[must_use]
    pub fn path(&self, node: NodeId) -> String {
        let mut names = Vec::new();
        let mut id = node;
        while id != NONE {
            names.push(self.title(id));
            id = self.nodes[id as usize].parent;
        }
        names.reverse();
        names.join("/")
    }

    /// The nodes in document order.
    pub fn definition(&self) -> impl Iterator<Item = NodeDefinition> + '_ {
        self.nodes.iter().zip(0..).map(|(node, id)| NodeDefinition {
            id,
            parent: (node.parent != NONE).then_some(node.parent),
            kind: self.kind_name(id).to_owned(),
            title: self.title(id).to_owned(),
            class: if node.model == NONE { NodeClass::Subtree } else { self.models[node.model as usize].class },
            location: self.locations[id as usize],
        })
    }

    /// Starts or stops the journal.
    pub fn set_journal_level(&mut self, level: JournalLevel) {
        self.run.journal.level = level;
    }

    /// Takes the events since the last call.
    pub fn drain_journal(&mut self) -> Vec<Record> {
        std::mem::take(&mut self.run.journal.records)
    }

    /// The key of a blackboard entry named in the journal; entries of subtrees begin with the path of the subtree.
    #[must_use]
    pub fn slot_key(&self, slot: u32) -> Option<&str> {
        self.slot_keys.get(slot as usize).map(String::as_str)
    }

    /// The value of a blackboard entry of the root scope.
    #[must_use]
    pub fn entry<T: Any + Send + Sync>(&self, key: &str) -> Option<Arc<T>> {
        let slot = *self.root_keys.get(key)?;
        self.run.board.slots[slot as usize].value.clone()?.downcast().ok()
    }

    /// Sets a blackboard entry of the root scope. A key that no node uses is ignored, so an application can offer what it has.
    ///
    /// # Errors
    /// [`EntryError::Type`] when the nodes use the key as another type.
    pub fn set_entry<T: Any + Send + Sync>(&mut self, key: &str, value: T) -> Result<(), EntryError> {
        let Some(&slot) = self.root_keys.get(key) else { return Ok(()) };
        if let Some(expected) = &self.slot_types[slot as usize] {
            let found = crate::PortType::shared::<T>();
            if expected.id != found.id {
                return Err(EntryError::Type { key: key.to_owned(), expected: expected.name.clone(), found: found.name });
            }
        }
        self.run.board.write(slot, value, self.run.now_secs);
        self.run.note_write(NONE, slot, self.slot_types[slot as usize].as_ref());
        Ok(())
    }

    /// When a blackboard entry of the root scope was last written.
    #[must_use]
    pub fn stamp(&self, key: &str) -> Option<Stamp> {
        self.root_keys.get(key).map(|slot| self.run.board.stamp(*slot))
    }

    /// A blackboard entry of the root scope as a literal, where its type has that form.
    #[must_use]
    pub fn literal(&self, key: &str) -> Option<Literal> {
        let slot = *self.root_keys.get(key)? as usize;
        blackboard::to_form(self.run.board.slots[slot].value.as_ref()?, self.slot_types[slot].as_ref(), &self.run.forms)
    }

    /// The blackboard as it is now. Values are shared, not copied.
    #[must_use]
    pub fn backup(&self) -> Backup {
        Backup(self.run.board.clone())
    }

    /// Makes the blackboard what it was.
    ///
    /// # Panics
    /// If the backup is of another tree.
    pub fn restore(&mut self, backup: &Backup) {
        assert_eq!(backup.0.slots.len(), self.run.board.slots.len(), "the backup is of another tree");
        self.run.board = backup.0.clone();
    }

    pub(crate) fn kind_name(&self, id: NodeId) -> &str {
        match self.nodes[id as usize].model {
            NONE => "subtree",
            model => &self.models[model as usize].name,
        }
    }

    pub(crate) fn title(&self, id: NodeId) -> &str {
        self.titles.get(&id).map_or_else(|| self.kind_name(id), String::as_str)
    }

    #[inline]
    pub(crate) fn tick_node(&mut self, id: NodeId, context: &mut C) -> Status {
        if self.run.intervention.is_watching() {
            return self.tick_watched(id, context);
        }
        self.tick_unwatched(id, context)
    }

    #[inline]
    pub(crate) fn tick_unwatched(&mut self, id: NodeId, context: &mut C) -> Status {
        if self.nodes[id as usize].conditions != NONE {
            return self.tick_conditioned(id, context);
        }
        self.tick_plain(id, context)
    }

    pub(crate) fn tick_plain(&mut self, id: NodeId, context: &mut C) -> Status {
        let Node { kind, status: before, .. } = self.nodes[id as usize];
        if kind == Kind::Leaf {
            return self.tick_leaf(id, context);
        }
        let is_start = before != Status::Running;
        if is_start {
            self.set_status(id, Status::Running);
            let now_secs = self.run.now_secs;
            let node = &mut self.nodes[id as usize];
            node.deadline_secs = now_secs;
            if kind != Kind::SequenceWithMemory {
                node.cursor = 0;
            }
            if !kind.has_memory() {
                node.count = 0;
                node.n_failed = 0;
            }
        }
        let status = match kind {
            Kind::Leaf | Kind::Sequence => self.tick_sequence(id, context, Status::Failure, false),
            Kind::AsyncSequence => self.tick_sequence(id, context, Status::Failure, true),
            Kind::SequenceWithMemory => self.tick_sequence_with_memory(id, is_start, context),
            Kind::Fallback => self.tick_sequence(id, context, Status::Success, false),
            Kind::AsyncFallback => self.tick_sequence(id, context, Status::Success, true),
            Kind::ReactiveSequence => self.tick_reactive(id, is_start, context, Status::Failure),
            Kind::ReactiveFallback => self.tick_reactive(id, is_start, context, Status::Success),
            Kind::Parallel => self.tick_parallel(id, context),
            Kind::ParallelAll => self.tick_parallel_all(id, context),
            Kind::IfThenElse => self.tick_if_then_else(id, context),
            Kind::WhileDoElse => self.tick_while_do_else(id, context),
            Kind::Switch => self.tick_switch(id, is_start, context),
            Kind::TryCatch => self.tick_try_catch(id, context),
            Kind::Recover => self.tick_recover(id, context),
            Kind::Retry => self.tick_retry(id, context),
            Kind::Repeat => self.tick_repeat(id, context),
            Kind::KeepRunning => self.tick_keep_running(id, context),
            Kind::Timeout => self.tick_timeout(id, is_start, context),
            Kind::Delay => self.tick_delay(id, is_start, context),
            Kind::RateLimit => self.tick_rate_limit(id, is_start, context),
            Kind::RunOnce => self.tick_run_once(id, context),
            Kind::Loop => self.tick_loop(id, context),
            Kind::Precondition => self.tick_precondition(id, context),
            Kind::SkipUnlessUpdated | Kind::WaitValueUpdate => self.tick_unless_updated(id, kind, context),
            Kind::Subtree | Kind::Inverter | Kind::ForceSuccess | Kind::ForceFailure => self.tick_mapped(id, kind, context),
            Kind::WasEntryUpdated
            | Kind::SetBlackboard
            | Kind::UnsetBlackboard
            | Kind::Script
            | Kind::ScriptCondition
            | Kind::Sleep
            | Kind::AlwaysSuccess
            | Kind::AlwaysFailure => self.tick_built_in_leaf(id, kind, is_start),
        };
        self.set_status(id, status);
        status
    }

    pub(crate) fn halt_node(&mut self, id: NodeId, context: &mut C) {
        let node = &self.nodes[id as usize];
        if node.status == Status::Running {
            match node.kind {
                Kind::Leaf => self.halt_leaf(id, context),
                Kind::TryCatch => self.halt_try_catch(id, context),
                _ => self.reset_children(id, context),
            }
            self.set_status(id, Status::Idle);
            if self.nodes[id as usize].conditions != NONE {
                self.after_halt(id);
            }
        } else {
            self.set_status(id, Status::Idle);
        }
    }

    /// Halts running children and makes all of them idle.
    pub(crate) fn reset_children(&mut self, id: NodeId, context: &mut C) {
        let Node { first_child, n_children, .. } = self.nodes[id as usize];
        for at in first_child..first_child + n_children {
            let child = self.children[at as usize];
            if self.nodes[child as usize].status != Status::Idle {
                self.halt_node(child, context);
            }
        }
    }

    #[inline]
    pub(crate) fn set_status(&mut self, id: NodeId, to: Status) {
        let stored = if to == Status::Skipped { Status::Idle } else { to };
        let from = std::mem::replace(&mut self.nodes[id as usize].status, stored);
        if from != to && self.run.journal.level != JournalLevel::Off {
            self.run.note(id, Change::Status { from, to });
        }
    }

    #[inline]
    pub(crate) fn child(&self, id: NodeId, child_idx: u32) -> NodeId {
        self.children[(self.nodes[id as usize].first_child + child_idx) as usize]
    }

    /// Where the value of a built-in node's port is.
    pub(crate) fn source(&self, id: NodeId, port_idx: usize) -> &Source {
        &self.sources[self.nodes[id as usize].first_source as usize + port_idx]
    }

    /// The value of a built-in node's port.
    pub(crate) fn built_in_port<T: Any + Send + Sync>(&self, id: NodeId, port_idx: usize) -> Result<Option<Arc<T>>, Failure> {
        let value = self.source(id, port_idx).read(&self.run.board.slots)?;
        Ok(value.and_then(|value| value.downcast().ok()))
    }
}

impl<C> fmt::Debug for Tree<C> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Tree").field("n_nodes", &self.nodes.len()).field("tick_idx", &self.run.tick_idx).finish_non_exhaustive()
    }
}

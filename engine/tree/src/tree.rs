//! A runnable tree: ticking, halting, and what can be asked about it.

use crate::action::{Action, Tick};
use crate::blackboard::{self, Slot, Source};
use crate::journal::{Change, Journal, JournalLevel, Record};
use crate::problem::EntryError;
use crate::registry::{NodeClass, NodeModel, Predicate, StepFn};
use crate::status::{Failure, Outcome, Progress, Status, reason};
use std::any::Any;
use std::collections::BTreeMap;
use std::fmt;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;

/// Number of a node, in document order from 0.
pub type NodeId = u32;

/// What a node does when it is ticked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    Leaf,
    Subtree,
    Sequence,
    Fallback,
    ReactiveSequence,
    ReactiveFallback,
    Parallel,
    Retry,
    Repeat,
    Timeout,
    Inverter,
    ForceSuccess,
    ForceFailure,
}

/// Shape and state of one node.
#[derive(Clone, Debug)]
pub(crate) struct Node {
    pub(crate) kind: Kind,
    pub(crate) status: Status,
    pub(crate) model: u32,
    pub(crate) parent: u32,
    pub(crate) first_child: u32,
    pub(crate) n_children: u32,
    pub(crate) first_source: u32,
    pub(crate) leaf: u32,
    /// The child to go on with, or the running child of a reactive node.
    pub(crate) cursor: u32,
    /// Rounds of a loop, successes of a parallel.
    pub(crate) count: u32,
    /// Failures of a parallel.
    pub(crate) n_failed: u32,
    /// Rounds allowed.
    pub(crate) limit: u32,
    pub(crate) deadline_secs: f64,
}

/// No child, no parent, no limit.
pub(crate) const NONE: u32 = u32::MAX;

pub(crate) enum Leaf<C> {
    Action(Box<dyn Action<C>>),
    Condition(Predicate<C>),
    Step(StepFn<C>),
}

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

/// Oldest failures are dropped beyond this number, so that an endless run stays small.
const MAX_FAILURE_HISTORY: usize = 1024;

/// The state that nodes share.
pub(crate) struct Runtime {
    pub(crate) slots: Vec<Slot>,
    pub(crate) journal: Journal,
    pub(crate) tick_idx: u64,
    pub(crate) now_secs: f64,
    pub(crate) failure: Option<FailureAt>,
    pub(crate) history: std::collections::VecDeque<FailureAt>,
    /// Running children of reactive nodes: halted before the next action starts.
    pub(crate) preempted: Vec<NodeId>,
}

impl Runtime {
    pub(crate) fn new(slots: Vec<Slot>) -> Self {
        let journal = Journal::default();
        let (history, preempted) = (std::collections::VecDeque::new(), Vec::new());
        Self { slots, journal, tick_idx: 0, now_secs: 0.0, failure: None, history, preempted }
    }

    pub(crate) fn note(&mut self, node: NodeId, change: Change) {
        self.journal.records.push(Record { tick_idx: self.tick_idx, now_secs: self.now_secs, node, change });
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
}

/// A checked tree with its blackboard and state. Made by [`crate::Registry::build`].
pub struct Tree<C> {
    pub(crate) nodes: Vec<Node>,
    pub(crate) children: Vec<NodeId>,
    pub(crate) sources: Vec<Source>,
    pub(crate) leaves: Vec<Leaf<C>>,
    pub(crate) models: Vec<NodeModel>,
    pub(crate) titles: BTreeMap<NodeId, String>,
    pub(crate) locations: Vec<u32>,
    pub(crate) slot_keys: Vec<String>,
    pub(crate) slot_types: Vec<Option<crate::port::PortType>>,
    pub(crate) root_keys: BTreeMap<String, u32>,
    pub(crate) run: Runtime,
}

impl<C> Tree<C> {
    /// Ticks the tree once at time `now_secs`, which must not go back. A tree that has finished starts anew on the next tick.
    pub fn tick(&mut self, now_secs: f64, context: &mut C) -> Status {
        self.run.tick_idx += 1;
        self.run.now_secs = now_secs;
        if self.nodes[0].status != Status::Running {
            self.run.failure = None;
        }
        let status = self.tick_node(0, context);
        if status != Status::Running {
            self.set_status(0, Status::Idle);
        }
        status
    }

    /// Halts what runs. Afterwards every node is idle; blackboard entries stay.
    pub fn halt(&mut self, context: &mut C) {
        self.halt_node(0, context);
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
        self.run.slots[slot as usize].value.clone()?.downcast().ok()
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
        blackboard::write(&mut self.run.slots[slot as usize], value);
        Ok(())
    }

    pub(crate) fn kind_name(&self, id: NodeId) -> &str {
        match self.nodes[id as usize].model {
            NONE => "subtree",
            model => &self.models[model as usize].name,
        }
    }

    fn title(&self, id: NodeId) -> &str {
        self.titles.get(&id).map_or_else(|| self.kind_name(id), String::as_str)
    }

    pub(crate) fn tick_node(&mut self, id: NodeId, context: &mut C) -> Status {
        let Node { kind, status: before, .. } = self.nodes[id as usize];
        if kind == Kind::Leaf {
            return self.tick_leaf(id, context);
        }
        let is_start = before != Status::Running;
        if is_start {
            self.set_status(id, Status::Running);
            let now_secs = self.run.now_secs;
            let node = &mut self.nodes[id as usize];
            node.cursor = 0;
            node.count = 0;
            node.n_failed = 0;
            node.deadline_secs = now_secs;
        }
        let status = match kind {
            Kind::Leaf | Kind::Sequence => self.tick_sequence(id, context, Status::Failure),
            Kind::Fallback => self.tick_sequence(id, context, Status::Success),
            Kind::ReactiveSequence => self.tick_reactive(id, is_start, context, Status::Failure),
            Kind::ReactiveFallback => self.tick_reactive(id, is_start, context, Status::Success),
            Kind::Parallel => self.tick_parallel(id, context),
            Kind::Retry => self.tick_retry(id, is_start, context),
            Kind::Repeat => self.tick_repeat(id, is_start, context),
            Kind::Timeout => self.tick_timeout(id, is_start, context),
            Kind::Subtree | Kind::Inverter | Kind::ForceSuccess | Kind::ForceFailure => self.tick_mapped(id, kind, context),
        };
        self.set_status(id, status);
        status
    }

    fn tick_leaf(&mut self, id: NodeId, context: &mut C) -> Status {
        let node = &self.nodes[id as usize];
        let (is_running, leaf) = (node.status == Status::Running, node.leaf as usize);
        // Two actions of a reactive node never overlap: the old one is halted before the new one starts.
        if !is_running && !self.run.preempted.is_empty() && matches!(self.leaves[leaf], Leaf::Action(_)) {
            for preempted in std::mem::take(&mut self.run.preempted) {
                self.halt_node(preempted, context);
            }
        }
        let status = match self.call_leaf(id, is_running, context) {
            Ok(Progress::Running) => Status::Running,
            Ok(Progress::Success) => Status::Success,
            Ok(Progress::Skipped) => Status::Skipped,
            Err(failure) => self.run.fail(id, failure),
        };
        self.set_status(id, status);
        status
    }

    fn call_leaf(&mut self, id: NodeId, is_running: bool, context: &mut C) -> Outcome {
        let node = &self.nodes[id as usize];
        let ports = &self.models[node.model as usize].ports;
        let sources = &self.sources[node.first_source as usize..][..ports.len()];
        let mut tick = Tick { context, node: id, ports, sources, run: &mut self.run };
        let leaf = &mut self.leaves[node.leaf as usize];
        let called = catch_unwind(AssertUnwindSafe(|| match leaf {
            Leaf::Action(action) if is_running => action.poll(&mut tick),
            Leaf::Action(action) => action.start(&mut tick),
            Leaf::Condition(holds) => match holds(&mut tick) {
                Ok(true) => Ok(Progress::Success),
                Ok(false) => Err(Failure { reason: reason::CONDITION_FALSE.into(), detail: String::new() }),
                Err(failure) => Err(failure),
            },
            Leaf::Step(run) => run(&mut tick).map(|()| Progress::Success),
        }));
        called.unwrap_or_else(|panic| {
            // Whatever it began must stop, even if it no longer knows what that was.
            if let Leaf::Action(action) = leaf {
                let _second_panic = catch_unwind(AssertUnwindSafe(|| action.halt(&mut tick)));
            }
            Err(Failure::new(reason::PANICKED, panic_text(panic.as_ref())))
        })
    }

    pub(crate) fn halt_node(&mut self, id: NodeId, context: &mut C) {
        let node = &self.nodes[id as usize];
        if node.status == Status::Running {
            if node.kind == Kind::Leaf {
                self.halt_leaf(id, context);
            } else {
                self.reset_children(id, context);
            }
        }
        self.set_status(id, Status::Idle);
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

    fn halt_leaf(&mut self, id: NodeId, context: &mut C) {
        let node = &self.nodes[id as usize];
        let ports = &self.models[node.model as usize].ports;
        let sources = &self.sources[node.first_source as usize..][..ports.len()];
        let mut tick = Tick { context, node: id, ports, sources, run: &mut self.run };
        if let Leaf::Action(action) = &mut self.leaves[node.leaf as usize]
            && let Err(panic) = catch_unwind(AssertUnwindSafe(|| action.halt(&mut tick)))
        {
            // The journal keeps it; what the tree decides must not depend on a node that is leaving.
            let decided = self.run.failure.take();
            self.run.fail(id, Failure::new(reason::PANICKED, format!("while halting: {}", panic_text(panic.as_ref()))));
            self.run.failure = decided;
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

    /// The value of a built-in node's port.
    pub(crate) fn built_in_port<T: Any + Send + Sync>(&self, id: NodeId, port_idx: usize) -> Result<Option<Arc<T>>, Failure> {
        let value = self.sources[self.nodes[id as usize].first_source as usize + port_idx].read(&self.run.slots)?;
        Ok(value.and_then(|value| value.downcast().ok()))
    }
}

impl<C> fmt::Debug for Tree<C> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Tree").field("n_nodes", &self.nodes.len()).field("tick_idx", &self.run.tick_idx).finish_non_exhaustive()
    }
}

fn panic_text(panic: &(dyn Any + Send)) -> String {
    if let Some(text) = panic.downcast_ref::<&str>() {
        (*text).to_owned()
    } else if let Some(text) = panic.downcast_ref::<String>() {
        text.clone()
    } else {
        "no message".to_owned()
    }
}

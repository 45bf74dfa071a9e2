//! What somebody who looks on can do to a running tree: stop it at a node, give a node its result, let time stand still.
//!
//! | what | when | effect |
//! |---|---|---|
//! | [`Tree::force`] | at the node's next tick: now if it runs | it is halted if it runs, does not act and gives the result; conditions of the node are not asked |
//! | break at the start of a node | before it starts | [`Tree::take_breaks`] tells; actions that would start in this tick wait for the next |
//! | break at the end of a node | when it has ended | the same |
//! | [`Tree::postpone`] | between two ticks | times that have begun to run end later |
//!
//! Steps and conditions are done in one call and never wait, at a break neither: the tree is as its owner made it, it only
//! starts its actions later.

use crate::journal::{Change, JournalLevel};
use crate::status::{Failure, Status};
use crate::tree::{NodeId, Tree};
use std::collections::BTreeMap;

/// Where a tree shall stop.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct BreakAt {
    /// Before the node starts.
    pub start: bool,
    /// When it has ended.
    pub end: bool,
}

/// A node at which the tree should stop, met in the last tick.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Break {
    /// The node.
    pub node: NodeId,
    /// It has ended; else it is about to start.
    pub is_end: bool,
}

/// What is asked of the nodes of a tree.
#[derive(Default)]
pub(crate) struct Intervention {
    pub(crate) forced: BTreeMap<NodeId, Result<(), Failure>>,
    pub(crate) breaks: BTreeMap<NodeId, BreakAt>,
    pub(crate) met: Vec<Break>,
    /// A break was met in this tick: actions wait.
    pub(crate) is_breaking: bool,
}

impl Intervention {
    pub(crate) fn is_watching(&self) -> bool {
        !self.forced.is_empty() || !self.breaks.is_empty()
    }

    /// The same after a reload, for the nodes that are still there.
    pub(crate) fn moved(self, moved: impl Fn(NodeId) -> Option<NodeId>) -> Self {
        Self {
            forced: self.forced.into_iter().filter_map(|(node, result)| Some((moved(node)?, result))).collect(),
            breaks: self.breaks.into_iter().filter_map(|(node, at)| Some((moved(node)?, at))).collect(),
            ..Self::default()
        }
    }

    fn meet(&mut self, node: NodeId, is_end: bool) {
        self.met.push(Break { node, is_end });
        self.is_breaking = true;
    }
}

impl<C> Tree<C> {
    /// The node with a path as in [`crate::Names::path`].
    #[must_use]
    pub fn node_at(&self, path: &str) -> Option<NodeId> {
        self.unique_paths().iter().position(|known| known == path).and_then(|id| NodeId::try_from(id).ok())
    }

    /// Lets a node give this result at its next tick instead of acting. A running node is halted first. Asked again, the newer
    /// result counts; [`Tree::halt`] forgets it.
    ///
    /// # Panics
    /// If the tree has no such node.
    pub fn force(&mut self, node: NodeId, result: Result<(), Failure>) {
        assert!((node as usize) < self.nodes.len(), "the tree has no node {node}");
        if self.run.journal.level != JournalLevel::Off {
            self.run.note(node, Change::Forced(result.clone().map_err(Box::new)));
        }
        self.run.intervention.forced.insert(node, result);
    }

    /// The nodes at which the tree shall stop, in place of those before.
    pub fn set_breaks(&mut self, breaks: impl IntoIterator<Item = (NodeId, BreakAt)>) {
        let asked = breaks.into_iter().filter(|(_, at)| at.start || at.end);
        self.run.intervention.breaks = asked.collect();
    }

    /// Where the last tick met a break, in order. The owner decides how long it waits before the next tick.
    pub fn take_breaks(&mut self) -> Vec<Break> {
        std::mem::take(&mut self.run.intervention.met)
    }

    /// Lets times that have begun to run (of `timeout`, `delay`, `sleep`, `rate_limit`) end `secs` later, for an owner that did
    /// not tick the tree meanwhile.
    pub fn postpone(&mut self, secs: f64) {
        if self.run.journal.level == JournalLevel::Values {
            self.run.note(0, Change::Postponed { secs });
        }
        for node in &mut self.nodes {
            node.deadline_secs += secs;
        }
        for stopping in &mut self.run.stopping {
            stopping.deadline_secs += secs;
        }
    }

    /// A tick of a node while somebody intervenes.
    #[cold]
    pub(crate) fn tick_watched(&mut self, id: NodeId, context: &mut C) -> Status {
        let at = self.run.intervention.breaks.get(&id).copied().unwrap_or_default();
        if at.start && self.nodes[id as usize].status != Status::Running {
            self.run.intervention.meet(id, false);
        }
        let status = match self.run.intervention.forced.remove(&id) {
            Some(result) => self.give(id, result, context),
            None => self.tick_unwatched(id, context),
        };
        if at.end && status != Status::Running {
            self.run.intervention.meet(id, true);
        }
        status
    }

    fn give(&mut self, id: NodeId, result: Result<(), Failure>, context: &mut C) -> Status {
        if self.nodes[id as usize].status == Status::Running {
            self.halt_node(id, context);
        }
        let status = match result {
            Ok(()) => Status::Success,
            Err(failure) => self.run.fail(id, failure),
        };
        self.set_status(id, status);
        status
    }
}

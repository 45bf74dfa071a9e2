//! Leaves: how actions are started, polled and halted, and what keeps two of them apart.
//!
//! | a leaf is about to start while | then |
//! |---|---|
//! | the running child of a reactive node above it occupies a part of its footprint | that child is halted first |
//! | an action that was halted still stops (its halt said [`Halt::Pending`]) and shares a part | it waits: its node runs, `start` comes later |
//! | the same, and the time to stop is over | it fails with reason `halt_overdue` |
//! | a break was met in this tick ([`Tree::set_breaks`]) | it waits for the next |
//! | an action in another branch of a `parallel` shares a declared part | it waits |
//!
//! Steps and conditions are done in one call and never wait.

use crate::action::{Action, Halt, Tick};
use crate::registry::{Predicate, StepFn};
use crate::status::{Failure, Outcome, Progress, Status, reason};
use crate::tree::{NONE, NodeId, Tree};
use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};

/// What an action occupies, one bit each.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Parts {
    /// Declared parts.
    named: u64,
    /// The same, or everything when nothing was declared.
    assumed: u64,
}

impl Parts {
    pub(crate) const UNDECLARED: Self = Self { named: 0, assumed: u64::MAX };

    pub(crate) fn named(bits: u64) -> Self {
        Self { named: bits, assumed: bits }
    }

    fn may_clash(self, other: Self) -> bool {
        self.assumed & other.assumed != 0
    }
}

pub(crate) enum LeafKind<C> {
    Action(Box<dyn Action<C>>),
    Condition(Predicate<C>),
    Step(StepFn<C>),
}

pub(crate) struct Leaf<C> {
    pub(crate) kind: LeafKind<C>,
    pub(crate) parts: Parts,
}

/// A running node whose leaf waits for others and has not been started.
pub(crate) const WAITING: u8 = 1;

/// An action that was halted and still stops.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Stopping {
    pub(crate) node: NodeId,
    pub(crate) deadline_secs: f64,
    pub(crate) is_overdue: bool,
}

impl<C> Tree<C> {
    pub(crate) fn tick_leaf(&mut self, id: NodeId, context: &mut C) -> Status {
        let node = &self.nodes[id as usize];
        let leaf = node.leaf as usize;
        let is_running = node.status == Status::Running && node.flags & WAITING == 0;
        let is_action = matches!(self.leaves[leaf].kind, LeafKind::Action(_));
        let outcome = if is_action && !is_running {
            match self.make_way(id, context) {
                Ok(true) => {
                    self.nodes[id as usize].flags &= !WAITING;
                    self.call_leaf(id, false, context)
                }
                Ok(false) => {
                    self.nodes[id as usize].flags |= WAITING;
                    Ok(Progress::Running)
                }
                Err(failure) => Err(failure),
            }
        } else {
            self.call_leaf(id, is_running, context)
        };
        let status = match outcome {
            Ok(Progress::Running) => Status::Running,
            Ok(Progress::Success) => Status::Success,
            Ok(Progress::Skipped) => Status::Skipped,
            Err(failure) => self.run.fail(id, failure),
        };
        if is_action && self.leaves[leaf].parts.named != 0 {
            self.occupy(id, status == Status::Running && self.nodes[id as usize].flags & WAITING == 0);
        }
        self.set_status(id, status);
        status
    }

    fn occupy(&mut self, id: NodeId, is_active: bool) {
        let known = self.run.active.iter().position(|active| *active == id);
        match (known, is_active) {
            (None, true) => self.run.active.push(id),
            (Some(at), false) => {
                self.run.active.swap_remove(at);
            }
            _ => {}
        }
    }

    /// Halts what must not overlap with the leaf; whether it can start now.
    fn make_way(&mut self, id: NodeId, context: &mut C) -> Result<bool, Failure> {
        if self.run.intervention.is_breaking {
            return Ok(false);
        }
        let parts = self.leaves[self.nodes[id as usize].leaf as usize].parts;
        if !self.run.preempted.is_empty() {
            let preempted = std::mem::take(&mut self.run.preempted);
            for node in &preempted {
                if self.has_clash(*node, parts) {
                    self.halt_node(*node, context);
                }
            }
            self.run.preempted = preempted;
        }
        for stopping in &self.run.stopping {
            if stopping.node == id || self.parts_of_leaf(stopping.node).may_clash(parts) {
                if stopping.is_overdue {
                    let path = self.path(stopping.node);
                    return Err(Failure::new(reason::HALT_OVERDUE, format!("{path} was halted and has not stopped in its time")));
                }
                return Ok(false);
            }
        }
        let is_taken = |active: &NodeId| *active != id && self.parts_of_leaf(*active).named & parts.named != 0;
        Ok(!self.run.active.iter().any(is_taken))
    }

    fn parts_of_leaf(&self, id: NodeId) -> Parts {
        self.leaves[self.nodes[id as usize].leaf as usize].parts
    }

    /// Whether an action that runs below the node may clash with `parts`.
    fn has_clash(&self, id: NodeId, parts: Parts) -> bool {
        let node = &self.nodes[id as usize];
        if node.status != Status::Running {
            return false;
        }
        if node.n_children == 0 {
            return node.leaf != NONE
                && (node.leaf as usize) < self.leaves.len()
                && node.kind == crate::tree::Kind::Leaf
                && node.flags & WAITING == 0
                && self.leaves[node.leaf as usize].parts.may_clash(parts);
        }
        (0..node.n_children).any(|child_idx| self.has_clash(self.child(id, child_idx), parts))
    }

    fn call_leaf(&mut self, id: NodeId, is_running: bool, context: &mut C) -> Outcome {
        let node = &self.nodes[id as usize];
        let ports = &self.models[node.model as usize].ports;
        let sources = &self.sources[node.first_source as usize..][..ports.len()];
        let mut tick = Tick { context, node: id, ports, sources, slot_types: &self.slot_types, run: &mut self.run };
        let leaf = &mut self.leaves[node.leaf as usize].kind;
        let called = catch_unwind(AssertUnwindSafe(|| match leaf {
            LeafKind::Action(action) if is_running => action.poll(&mut tick),
            LeafKind::Action(action) => action.start(&mut tick),
            LeafKind::Condition(holds) => match holds(&mut tick) {
                Ok(true) => Ok(Progress::Success),
                Ok(false) => Err(Failure { reason: reason::CONDITION_FALSE.into(), detail: String::new() }),
                Err(failure) => Err(failure),
            },
            LeafKind::Step(run) => run(&mut tick).map(|()| Progress::Success),
        }));
        called.unwrap_or_else(|panic| {
            // Whatever it began must stop, even if it no longer knows what that was.
            let failure = Failure::new(reason::PANICKED, panic_text(panic.as_ref()));
            self.halt_leaf(id, context);
            Err(failure)
        })
    }

    pub(crate) fn halt_leaf(&mut self, id: NodeId, context: &mut C) {
        self.occupy(id, false);
        let node = &mut self.nodes[id as usize];
        if node.flags & WAITING != 0 {
            node.flags &= !WAITING;
            return;
        }
        if let Halt::Pending { within_secs } = self.call_halt(id, context) {
            let deadline_secs = self.run.now_secs + within_secs.max(0.0);
            self.run.stopping.push(Stopping { node: id, deadline_secs, is_overdue: false });
        }
    }

    fn call_halt(&mut self, id: NodeId, context: &mut C) -> Halt {
        let node = &self.nodes[id as usize];
        let ports = &self.models[node.model as usize].ports;
        let sources = &self.sources[node.first_source as usize..][..ports.len()];
        let mut tick = Tick { context, node: id, ports, sources, slot_types: &self.slot_types, run: &mut self.run };
        let LeafKind::Action(action) = &mut self.leaves[node.leaf as usize].kind else { return Halt::Done };
        catch_unwind(AssertUnwindSafe(|| action.halt(&mut tick))).unwrap_or_else(|panic| {
            let text = format!("while halting: {}", panic_text(panic.as_ref()));
            self.run.note_failure(id, Failure::new(reason::PANICKED, text));
            Halt::Done
        })
    }

    /// Asks the actions that still stop whether they have.
    pub(crate) fn poll_stopping(&mut self, context: &mut C) {
        for mut stopping in std::mem::take(&mut self.run.stopping) {
            if self.call_halt(stopping.node, context) == Halt::Done {
                continue;
            }
            if !stopping.is_overdue && self.run.now_secs >= stopping.deadline_secs {
                stopping.is_overdue = true;
                let failure = Failure::new(reason::HALT_OVERDUE, "it was halted and has not stopped in its time");
                self.run.note_failure(stopping.node, failure);
            }
            self.run.stopping.push(stopping);
        }
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

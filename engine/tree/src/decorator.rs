//! Nodes with one child.
//!
//! | node | child succeeds | child fails | remembers | halts |
//! |---|---|---|---|---|
//! | `retry` {attempts, on} | Success | Running, and a new attempt begins in the next tick; Failure after `attempts`, or at once when the reason is not in `on` (empty: any) | attempts made | the child |
//! | `repeat` {times} | Running, and a new round begins in the next tick; Success after `times` (never when not given) | Failure | rounds made | the child |
//! | `timeout` {secs} | Success | Failure | when it started | the child, once `secs` have passed: Failure with reason `timeout` |
//! | `inverter` | Failure with reason `inverted` | Success | - | the child |
//! | `force_success` | Success | Success | - | the child |
//! | `force_failure` | Failure with reason `inverted` | Failure | - | the child |
//! | `subtree` | Success | Failure | - | the child |
//!
//! While the child runs the decorator runs, and a skipped child makes it skipped. A decorator that has ended has an idle child.
//! Time is the time handed to the tick; a `timeout` is tested before the child is ticked.

use crate::status::{Failure, Status, reason};
use crate::tree::{Kind, NONE, NodeId, Tree};

impl<C> Tree<C> {
    pub(crate) fn tick_retry(&mut self, id: NodeId, is_start: bool, context: &mut C) -> Status {
        if is_start && let Err(failure) = self.read_limit(id) {
            return self.run.fail(id, failure);
        }
        let status = self.tick_child(id, context);
        if status != Status::Failure {
            return status;
        }
        let node = &mut self.nodes[id as usize];
        node.count += 1;
        if node.count >= node.limit || !self.is_retried(id) { Status::Failure } else { Status::Running }
    }

    pub(crate) fn tick_repeat(&mut self, id: NodeId, is_start: bool, context: &mut C) -> Status {
        if is_start && let Err(failure) = self.read_limit(id) {
            return self.run.fail(id, failure);
        }
        let status = self.tick_child(id, context);
        if status != Status::Success {
            return status;
        }
        let node = &mut self.nodes[id as usize];
        node.count = node.count.saturating_add(1);
        if node.limit != NONE && node.count >= node.limit { Status::Success } else { Status::Running }
    }

    pub(crate) fn tick_timeout(&mut self, id: NodeId, is_start: bool, context: &mut C) -> Status {
        if is_start {
            match self.built_in_port::<f64>(id, 0) {
                Ok(secs) => self.nodes[id as usize].deadline_secs += secs.map_or(f64::INFINITY, |secs| *secs),
                Err(failure) => return self.run.fail(id, failure),
            }
        } else if self.run.now_secs >= self.nodes[id as usize].deadline_secs {
            self.reset_children(id, context);
            let secs = self.built_in_port::<f64>(id, 0).ok().flatten().map_or(0.0, |secs| *secs);
            return self.run.fail(id, Failure::new(reason::TIMEOUT, format!("not done within {secs} s")));
        }
        self.tick_child(id, context)
    }

    /// Decorators that only change the child's result.
    pub(crate) fn tick_mapped(&mut self, id: NodeId, kind: Kind, context: &mut C) -> Status {
        let status = self.tick_child(id, context);
        match (kind, status) {
            (Kind::Inverter, Status::Failure) | (Kind::ForceSuccess, Status::Failure) => Status::Success,
            (Kind::Inverter | Kind::ForceFailure, Status::Success) => {
                self.run.fail(id, Failure::new(reason::INVERTED, "the child succeeded"))
            }
            _ => status,
        }
    }

    fn tick_child(&mut self, id: NodeId, context: &mut C) -> Status {
        let child = self.child(id, 0);
        let status = self.tick_node(child, context);
        if status != Status::Running {
            self.set_status(child, Status::Idle);
        }
        status
    }

    /// Reads the number of rounds from port 0.
    fn read_limit(&mut self, id: NodeId) -> Result<(), Failure> {
        self.nodes[id as usize].limit = self.built_in_port::<u32>(id, 0)?.map_or(NONE, |limit| *limit);
        Ok(())
    }

    /// Whether the child's reason is one that `on` (port 1) names.
    fn is_retried(&self, id: NodeId) -> bool {
        let Ok(Some(on)) = self.built_in_port::<Vec<String>>(id, 1) else { return true };
        let reason = self.run.failure.as_ref().map_or("", |at| &at.failure.reason);
        on.is_empty() || on.iter().any(|name| name == reason)
    }
}

//! Nodes with several children.
//!
//! | node | ticks | ends with | remembers | halts |
//! |---|---|---|---|---|
//! | `sequence` | children in order within one tick, from the one it stopped at | Failure of the first that fails; Success after the last | the running child | the running child |
//! | `fallback` | the same | Success of the first that succeeds; Failure (of the last) after the last | the running child | the running child |
//! | `reactive_sequence` | all children from the first, every tick | as `sequence` | nothing | the running child, **before** an action above it starts |
//! | `reactive_fallback` | the same | as `fallback` | nothing | the same |
//! | `parallel` | every unfinished child, every tick, in order | Success at `success` successes (default all), Failure at `failure` failures (default 1) or when `success` is out of reach | results of finished children | the unfinished children when it ends |
//!
//! A skipped child counts as passed over; when all are skipped, so is the node (but a `parallel` that wants all succeeds). While a child runs the node runs. A node that
//! has ended has idle children. An action that stands above the running child of a reactive node halts it whenever it starts,
//! even if it ends within the tick: use a condition or a step there.

use crate::status::{Failure, Status, reason};
use crate::tree::{NONE, NodeId, Tree};

impl<C> Tree<C> {
    /// `sequence` (`ends_on` Failure) and `fallback` (`ends_on` Success).
    pub(crate) fn tick_sequence(&mut self, id: NodeId, context: &mut C, ends_on: Status) -> Status {
        while self.nodes[id as usize].cursor < self.nodes[id as usize].n_children {
            let child = self.child(id, self.nodes[id as usize].cursor);
            let status = self.tick_node(child, context);
            if status == Status::Running {
                return Status::Running;
            }
            if status == ends_on {
                self.reset_children(id, context);
                return ends_on;
            }
            let node = &mut self.nodes[id as usize];
            node.cursor += 1;
            node.count += u32::from(status != Status::Skipped);
        }
        self.reset_children(id, context);
        end_of_row(ends_on, self.nodes[id as usize].count == 0)
    }

    /// `reactive_sequence` (`ends_on` Failure) and `reactive_fallback` (`ends_on` Success).
    pub(crate) fn tick_reactive(&mut self, id: NodeId, is_start: bool, context: &mut C, ends_on: Status) -> Status {
        if is_start {
            self.nodes[id as usize].cursor = NONE;
        }
        let mut all_skipped = true;
        for child_idx in 0..self.nodes[id as usize].n_children {
            let child = self.child(id, child_idx);
            let running_idx = self.nodes[id as usize].cursor;
            let n_preempted = self.run.preempted.len();
            if running_idx != NONE && running_idx != child_idx {
                let running = self.child(id, running_idx);
                self.run.preempted.push(running);
            }
            let status = self.tick_node(child, context);
            self.run.preempted.truncate(n_preempted);
            if running_idx == child_idx {
                self.nodes[id as usize].cursor = NONE;
            }
            if status == Status::Running {
                // A decorator can run between two rounds without having started an action.
                if running_idx != NONE && running_idx != child_idx {
                    let running = self.child(id, running_idx);
                    self.halt_node(running, context);
                }
                self.nodes[id as usize].cursor = child_idx;
                return Status::Running;
            }
            if running_idx != NONE && self.nodes[self.child(id, running_idx) as usize].status == Status::Idle {
                self.nodes[id as usize].cursor = NONE;
            }
            if status == ends_on {
                self.reset_children(id, context);
                return ends_on;
            }
            all_skipped &= status == Status::Skipped;
        }
        self.reset_children(id, context);
        end_of_row(ends_on, all_skipped)
    }

    pub(crate) fn tick_parallel(&mut self, id: NodeId, context: &mut C) -> Status {
        let n_children = self.nodes[id as usize].n_children;
        let (n_success, n_failure) = match self.thresholds(id) {
            Ok(thresholds) => thresholds,
            Err(failure) => {
                self.reset_children(id, context);
                return self.run.fail(id, failure);
            }
        };
        let wants_all = n_success.is_none();
        let n_success = n_success.unwrap_or(n_children);
        let mut n_skipped = 0;
        for child_idx in 0..n_children {
            let child = self.child(id, child_idx);
            if !matches!(self.nodes[child as usize].status, Status::Success | Status::Failure) {
                match self.tick_node(child, context) {
                    Status::Skipped => n_skipped += 1,
                    Status::Success => self.nodes[id as usize].count += 1,
                    // Only a failing child can end the node in failure, so its reason is the node's.
                    Status::Failure => self.nodes[id as usize].n_failed += 1,
                    Status::Running | Status::Idle => {}
                }
            }
            let (n_succeeded, n_failed) = (self.nodes[id as usize].count, self.nodes[id as usize].n_failed);
            if n_succeeded >= n_success || (wants_all && n_succeeded + n_skipped >= n_success) {
                self.reset_children(id, context);
                return Status::Success;
            }
            if n_children - n_failed < n_success || n_failed >= n_failure {
                self.reset_children(id, context);
                return Status::Failure;
            }
        }
        if n_skipped == n_children { Status::Skipped } else { Status::Running }
    }

    fn thresholds(&self, id: NodeId) -> Result<(Option<u32>, u32), Failure> {
        let n_children = self.nodes[id as usize].n_children;
        let success = self.built_in_port::<u32>(id, 0)?.map(|n| *n);
        let failure = self.built_in_port::<u32>(id, 1)?.map_or(1, |n| *n);
        match success {
            Some(n) if n > n_children => {
                let detail = format!("{n} successes are asked of {n_children} children");
                Err(Failure::new(reason::OUT_OF_REACH, detail))
            }
            _ => Ok((success, failure)),
        }
    }
}

fn end_of_row(ends_on: Status, all_skipped: bool) -> Status {
    match (all_skipped, ends_on) {
        (true, _) => Status::Skipped,
        (false, Status::Failure) => Status::Success,
        (false, _) => Status::Failure,
    }
}

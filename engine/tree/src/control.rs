//! Nodes with several children.
//!
//! | node | ticks | ends with | remembers | halts |
//! |---|---|---|---|---|
//! | `sequence` | children in order within one tick, from the one it stopped at | Failure of the first that fails; Success after the last | the running child | the running child |
//! | `async_sequence` | the same, but runs for a tick after each child that was done in one call | the same | the same | the same |
//! | `sequence_with_memory` | as `async_sequence` | the same | the child it failed or was halted at, until it succeeds as a whole | the same |
//! | `fallback`, `async_fallback` | as the sequences | Success of the first that succeeds; Failure (of the last) after the last | the running child | the running child |
//! | `reactive_sequence` | all children from the first, every tick | as `sequence` | nothing | the running child, when another takes its place: **before** an action starts whose footprint it shares |
//! | `reactive_fallback` | the same | as `fallback` | nothing | the same |
//! | `parallel` | every unfinished child, every tick, in order | Success at `success` successes (default all), Failure at `failure` failures (default 1) or when `success` is out of reach | results of finished children | the unfinished children when it ends |
//! | `parallel_all` | the same | when every child is done: Failure if `max_failures` failed (default 1), else Success | the same | the running children |
//! | `if_then_else` | the first child until it is done, then the second (Success) or the third (Failure) | as the branch; Failure when there is no third; Skipped when the first is | the branch | the running child |
//! | `while_do_else` | the first child on every tick, then the branch | the same | nothing | the other branch, before the new one starts |
//! | `switch` | the child whose case equals `variable`, else the last; looks on every tick | as that child | the running child | the old child, before the new one starts |
//! | `try_catch` | all children but the last as a `sequence`; when one fails, the last until it is done | Success of the sequence, or its Failure | the running child | the running child; then, with `catch_on_halt`, ticks the last child once |
//! | `recover` | the first child; when it fails, the child for the reason; when that succeeds, the first again | Success of the first; its Failure after `attempts`, when no child is for the reason, or when that child fails | attempts made | the running child |
//!
//! A skipped child counts as passed over; when all are skipped, so is the node (but a `parallel` that wants all succeeds). While a child runs the node runs. A node that
//! has ended has idle children.

use crate::blackboard::to_literal;
use crate::literal::Literal;
use crate::script::{Scalar, scalar_of, scalar_of_literal};
use crate::status::{Failure, Status, reason};
use crate::tree::{NONE, NodeId, Tree};

impl<C> Tree<C> {
    /// Sequences (`ends_on` Failure) and fallbacks (`ends_on` Success).
    pub(crate) fn tick_sequence(&mut self, id: NodeId, context: &mut C, ends_on: Status, is_async: bool) -> Status {
        while self.nodes[id as usize].cursor < self.nodes[id as usize].n_children {
            let child = self.child(id, self.nodes[id as usize].cursor);
            let was_idle = self.nodes[child as usize].status == Status::Idle;
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
            if is_async && was_idle && status != Status::Skipped && node.cursor < node.n_children {
                self.run.wants_tick = true;
                return Status::Running;
            }
        }
        self.reset_children(id, context);
        end_of_row(ends_on, self.nodes[id as usize].count == 0)
    }

    pub(crate) fn tick_sequence_with_memory(&mut self, id: NodeId, is_start: bool, context: &mut C) -> Status {
        // Where it goes on, it also knows whether what came before was skipped.
        if is_start && self.nodes[id as usize].cursor == 0 {
            self.nodes[id as usize].count = 0;
        }
        let status = self.tick_sequence(id, context, Status::Failure, true);
        if !matches!(status, Status::Running | Status::Failure) {
            self.nodes[id as usize].cursor = 0;
        }
        status
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
                // Children before it are done; of those after it only the one that ran can be other than idle.
                for other_idx in (0..child_idx).chain((running_idx != NONE && running_idx > child_idx).then_some(running_idx)) {
                    let other = self.child(id, other_idx);
                    if self.nodes[other as usize].status != Status::Idle {
                        self.halt_node(other, context);
                    }
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
        let (wants_all, n_success, n_failure) = match self.thresholds(id) {
            Ok(thresholds) => thresholds,
            Err(failure) => {
                self.reset_children(id, context);
                return self.run.fail(id, failure);
            }
        };
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
            if n_children - n_failed < n_success || n_failed == n_failure {
                self.reset_children(id, context);
                return Status::Failure;
            }
        }
        if n_skipped == n_children { Status::Skipped } else { Status::Running }
    }

    /// Whether skipped children count as successes, how many successes and how many failures end a `parallel`.
    fn thresholds(&self, id: NodeId) -> Result<(bool, u32, u32), Failure> {
        let n_children = self.nodes[id as usize].n_children;
        let success = self.built_in_port::<i32>(id, 0)?.map_or(-1, |n| *n);
        let failure = self.built_in_port::<i32>(id, 1)?.map_or(1, |n| *n);
        let (n_success, n_failure) = (from_end(success, n_children), from_end(failure, n_children));
        for (n, what) in [(n_success, "successes"), (n_failure, "failures")] {
            if n > n_children {
                return Err(Failure::new(reason::OUT_OF_REACH, format!("{n} {what} are asked of {n_children} children")));
            }
        }
        Ok((success < 0, n_success, n_failure))
    }

    pub(crate) fn tick_parallel_all(&mut self, id: NodeId, context: &mut C) -> Status {
        let n_children = self.nodes[id as usize].n_children;
        let max_failures = match self.built_in_port::<i32>(id, 0) {
            Ok(max_failures) => from_end(max_failures.map_or(1, |n| *n), n_children),
            Err(failure) => return self.run.fail(id, failure),
        };
        if max_failures > n_children {
            self.reset_children(id, context);
            let detail = format!("{max_failures} failures are asked of {n_children} children");
            return self.run.fail(id, Failure::new(reason::OUT_OF_REACH, detail));
        }
        let mut n_skipped = 0;
        for child_idx in 0..n_children {
            let child = self.child(id, child_idx);
            if matches!(self.nodes[child as usize].status, Status::Success | Status::Failure) {
                continue;
            }
            match self.tick_node(child, context) {
                Status::Skipped => n_skipped += 1,
                Status::Success => self.nodes[id as usize].count += 1,
                Status::Failure => {
                    self.nodes[id as usize].n_failed += 1;
                    if let Some(failure) = self.run.failure.clone() {
                        self.kept.insert(id, failure);
                    }
                }
                Status::Running | Status::Idle => {}
            }
        }
        let (n_succeeded, n_failed) = (self.nodes[id as usize].count, self.nodes[id as usize].n_failed);
        if n_skipped == n_children {
            return Status::Skipped;
        }
        if n_skipped + n_succeeded + n_failed < n_children {
            return Status::Running;
        }
        self.reset_children(id, context);
        let kept = self.kept.remove(&id);
        if n_failed < max_failures {
            return Status::Success;
        }
        match kept {
            Some(failure) => {
                self.run.failure = Some(failure);
                Status::Failure
            }
            None => self.run.fail(id, Failure::new(reason::OUT_OF_REACH, "no failure is accepted and none is needed to fail")),
        }
    }

    pub(crate) fn tick_if_then_else(&mut self, id: NodeId, context: &mut C) -> Status {
        if self.nodes[id as usize].cursor == 0 {
            let condition = self.child(id, 0);
            match self.tick_node(condition, context) {
                Status::Running => return Status::Running,
                Status::Success => self.nodes[id as usize].cursor = 1,
                Status::Failure if self.nodes[id as usize].n_children == 3 => self.nodes[id as usize].cursor = 2,
                status => {
                    self.reset_children(id, context);
                    return status;
                }
            }
        }
        let branch = self.child(id, self.nodes[id as usize].cursor);
        let status = self.tick_node(branch, context);
        if status != Status::Running {
            self.reset_children(id, context);
        }
        status
    }

    pub(crate) fn tick_while_do_else(&mut self, id: NodeId, context: &mut C) -> Status {
        let condition = self.child(id, 0);
        let (taken, other) = match self.tick_node(condition, context) {
            Status::Running => return Status::Running,
            Status::Success => (1, 2),
            Status::Failure if self.nodes[id as usize].n_children == 3 => (2, 1),
            status => {
                self.reset_children(id, context);
                return status;
            }
        };
        if other < self.nodes[id as usize].n_children {
            let other = self.child(id, other);
            if self.nodes[other as usize].status != Status::Idle {
                self.halt_node(other, context);
            }
        }
        let branch = self.child(id, taken);
        let status = self.tick_node(branch, context);
        if status != Status::Running {
            self.reset_children(id, context);
        }
        status
    }

    pub(crate) fn tick_switch(&mut self, id: NodeId, is_start: bool, context: &mut C) -> Status {
        if is_start {
            self.nodes[id as usize].cursor = NONE;
        }
        let selected = match self.selected_case(id) {
            Ok(selected) => selected,
            Err(failure) => {
                self.reset_children(id, context);
                return self.run.fail(id, failure);
            }
        };
        let running = self.nodes[id as usize].cursor;
        if running != NONE && running != selected {
            let running = self.child(id, running);
            self.halt_node(running, context);
        }
        let child = self.child(id, selected);
        let status = self.tick_node(child, context);
        if status == Status::Running {
            self.nodes[id as usize].cursor = selected;
        } else {
            self.reset_children(id, context);
        }
        status
    }

    /// The child of the case that equals the variable, or the last child.
    fn selected_case(&self, id: NodeId) -> Result<u32, Failure> {
        let default = self.nodes[id as usize].n_children - 1;
        let Some(value) = self.source(id, 0).read(&self.run.board.slots)? else { return Ok(default) };
        // A word out of a list of the application is compared by its text.
        let port_type = self.source(id, 0).slot().and_then(|slot| self.slot_types[slot as usize].as_ref());
        let literal = if scalar_of(&*value).is_none() { to_literal(&value, port_type) } else { None };
        let scalar = scalar_of(&*value).or_else(|| literal.as_ref().and_then(scalar_of_literal));
        let Some(scalar) = scalar else { return Ok(default) };
        let cases = self.built_in_port::<Vec<Literal>>(id, 1)?;
        let is_case = |case: &Literal| scalar_of_literal(case).is_some_and(|case| is_same(&scalar, &case));
        let found = cases.as_ref().and_then(|cases| cases.iter().position(is_case));
        Ok(found.and_then(|case_idx| u32::try_from(case_idx).ok()).unwrap_or(default).min(default))
    }

    pub(crate) fn tick_try_catch(&mut self, id: NodeId, context: &mut C) -> Status {
        let last = self.nodes[id as usize].n_children - 1;
        while self.nodes[id as usize].n_failed == 0 {
            let cursor = self.nodes[id as usize].cursor;
            if cursor == last {
                self.reset_children(id, context);
                return end_of_row(Status::Failure, self.nodes[id as usize].count == 0);
            }
            let child = self.child(id, cursor);
            let status = self.tick_node(child, context);
            match status {
                Status::Running => return Status::Running,
                Status::Failure => {
                    if let Some(failure) = self.run.failure.clone() {
                        self.kept.insert(id, failure);
                    }
                    self.reset_children(id, context);
                    self.nodes[id as usize].n_failed = 1;
                }
                _ => {
                    let node = &mut self.nodes[id as usize];
                    node.cursor += 1;
                    node.count += u32::from(status != Status::Skipped);
                }
            }
        }
        let catch = self.child(id, last);
        if self.tick_node(catch, context) == Status::Running {
            return Status::Running;
        }
        self.reset_children(id, context);
        self.run.failure = self.kept.remove(&id).or_else(|| self.run.failure.take());
        Status::Failure
    }

    pub(crate) fn halt_try_catch(&mut self, id: NodeId, context: &mut C) {
        let is_trying = self.nodes[id as usize].n_failed == 0;
        self.reset_children(id, context);
        self.kept.remove(&id);
        let cleans_up = self.built_in_port::<bool>(id, 0).ok().flatten().is_some_and(|catch_on_halt| *catch_on_halt);
        if is_trying && cleans_up {
            let catch = self.child(id, self.nodes[id as usize].n_children - 1);
            let decided = self.run.failure.take();
            self.tick_node(catch, context);
            self.run.failure = decided;
            self.reset_children(id, context);
        }
    }

    pub(crate) fn tick_recover(&mut self, id: NodeId, context: &mut C) -> Status {
        loop {
            let cursor = self.nodes[id as usize].cursor;
            let child = self.child(id, cursor);
            let was_idle = self.nodes[child as usize].status == Status::Idle;
            let status = self.tick_node(child, context);
            match (cursor, status) {
                (_, Status::Running) => return Status::Running,
                (0, Status::Failure) => {
                    self.nodes[id as usize].count += 1;
                    let Some(branch) = self.branch_for_failure(id) else {
                        self.reset_children(id, context);
                        return Status::Failure;
                    };
                    if let Some(failure) = self.run.failure.clone() {
                        self.kept.insert(id, failure);
                    }
                    self.reset_children(id, context);
                    self.nodes[id as usize].cursor = branch;
                }
                (0, _) => {
                    self.reset_children(id, context);
                    return status;
                }
                (_, Status::Failure) => {
                    self.reset_children(id, context);
                    self.run.failure = self.kept.remove(&id).or_else(|| self.run.failure.take());
                    return Status::Failure;
                }
                (_, _) => {
                    self.kept.remove(&id);
                    self.reset_children(id, context);
                    self.nodes[id as usize].cursor = 0;
                    if was_idle {
                        self.run.wants_tick = true;
                        return Status::Running;
                    }
                }
            }
        }
    }

    /// The child for the reason of the last failure, while attempts are left.
    fn branch_for_failure(&self, id: NodeId) -> Option<u32> {
        let attempts = *self.built_in_port::<u32>(id, 0).ok().flatten()?;
        let on = self.built_in_port::<Vec<String>>(id, 1).ok().flatten()?;
        let reason = &self.run.failure.as_ref()?.failure.reason;
        let branch = on.iter().position(|name| name == reason || name == "any")?;
        let branch = u32::try_from(branch + 1).ok()?;
        (self.nodes[id as usize].count < attempts && branch < self.nodes[id as usize].n_children).then_some(branch)
    }
}

/// A negative number counts from the end: -1 is all.
fn from_end(threshold: i32, n_children: u32) -> u32 {
    let n_children = i64::from(n_children);
    let threshold = i64::from(threshold);
    let counted = if threshold < 0 { (n_children + threshold + 1).max(0) } else { threshold };
    u32::try_from(counted).unwrap_or(u32::MAX)
}

/// Equal as texts or as numbers, so that a case can be written either way.
fn is_same(value: &Scalar<'_>, case: &Scalar<'_>) -> bool {
    match (value, case) {
        (Scalar::Text(value), Scalar::Text(case)) => value == case,
        (Scalar::Text(text), Scalar::Number(number)) | (Scalar::Number(number), Scalar::Text(text)) => {
            text.trim().parse::<f64>().is_ok_and(|text| text == *number)
        }
        (Scalar::Text(text), Scalar::Bool(truth)) | (Scalar::Bool(truth), Scalar::Text(text)) => {
            text.as_ref() == if *truth { "true" } else { "false" }
        }
        (Scalar::Number(value), Scalar::Number(case)) => value == case,
        (Scalar::Bool(value), Scalar::Bool(case)) => value == case,
        (Scalar::Bool(truth), Scalar::Number(number)) | (Scalar::Number(number), Scalar::Bool(truth)) => {
            *number == f64::from(u8::from(*truth))
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

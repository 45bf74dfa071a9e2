//! Nodes with one child.
//!
//! | node | child succeeds | child fails | remembers | halts |
//! |---|---|---|---|---|
//! | `retry` {attempts, on} | Success | a new attempt begins; Failure after `attempts` (-1: never), or at once when the reason is not in `on` (empty: any) | attempts made | the child |
//! | `repeat` {times} | a new round begins; Success after `times` (never when -1 or not given) | Failure | rounds made | the child |
//! | `keep_running_until_failure` | Running, and a new round begins in the next tick | Failure | - | the child |
//! | `timeout` {secs} | Success | Failure | when it started | the child, once `secs` have passed: Failure with reason `timeout` |
//! | `delay` {secs} | Success | Failure | when it started | the child; the child is first ticked when `secs` have passed |
//! | `rate_limit` {hz} | Success | Failure | when the child last began, also over halts | the child; runs without ticking it until 1 / `hz` has passed since |
//! | `run_once` {then_skip} | Success | Failure | that it is done, also over halts: Skipped from then on, or with `then_skip: false` the same result | the child |
//! | `loop` {over, item, if_empty} | Running, and the next item comes in the next tick; `if_empty` when none is left | Failure | items done | the child |
//! | `precondition` {if, else} | Success | Failure | that the child runs: `if` is asked only before it begins, and `else` given when it does not hold | the child |
//! | `skip_unless_updated` {entry} | Success | Failure | the last write it saw, also over halts; Skipped when there is no newer one and the child does not run | the child |
//! | `wait_value_update` {entry} | Success | Failure | the same, but it runs instead | the child |
//! | `inverter` | Failure with reason `inverted` | Success | - | the child |
//! | `force_success` | Success | Success | - | the child |
//! | `force_failure` | Failure with reason `inverted` | Failure | - | the child |
//! | `subtree` | Success | Failure | - | the child |
//!
//! While the child runs the decorator runs, and a skipped child makes it skipped (but `keep_running_until_failure` runs on and `loop` goes to the
//! next item). A decorator that has ended has an idle child. A new round or attempt begins in the same tick after a child that took several ticks, and
//! in the next one after a child that was done in one call, so that no tick is endless.
//! Time is the time handed to the tick; a `timeout` is tested before the child is ticked.

use crate::blackboard;
use crate::literal::Literal;
use crate::port::{PortType, Value};
use crate::script::scalar_of;
use crate::status::{Failure, Status, reason};
use crate::tree::{Kind, NONE, NodeId, Tree};
use std::any::TypeId;
use std::sync::Arc;

impl<C> Tree<C> {
    pub(crate) fn tick_retry(&mut self, id: NodeId, context: &mut C) -> Status {
        loop {
            let attempts = match self.built_in_port::<i32>(id, 0) {
                Ok(attempts) => attempts.map_or(-1, |attempts| *attempts),
                Err(failure) => return self.run.fail(id, failure),
            };
            if is_used_up(self.nodes[id as usize].count, attempts) {
                return self.run.fail(id, Failure::new(reason::OUT_OF_REACH, "no attempt is allowed"));
            }
            let was_idle = self.nodes[self.child(id, 0) as usize].status == Status::Idle;
            let status = self.tick_child(id, context);
            if status != Status::Failure {
                return status;
            }
            self.nodes[id as usize].count += 1;
            if is_used_up(self.nodes[id as usize].count, attempts) || !self.is_retried(id) {
                return Status::Failure;
            }
            if was_idle {
                self.run.wants_tick = true;
                return Status::Running;
            }
        }
    }

    pub(crate) fn tick_repeat(&mut self, id: NodeId, context: &mut C) -> Status {
        loop {
            let times = match self.built_in_port::<i32>(id, 0) {
                Ok(times) => times.map_or(-1, |times| *times),
                Err(failure) => return self.run.fail(id, failure),
            };
            if is_used_up(self.nodes[id as usize].count, times) {
                return Status::Success;
            }
            let was_idle = self.nodes[self.child(id, 0) as usize].status == Status::Idle;
            let status = self.tick_child(id, context);
            if status != Status::Success {
                return status;
            }
            let node = &mut self.nodes[id as usize];
            node.count = node.count.saturating_add(1);
            if was_idle && !is_used_up(node.count, times) {
                self.run.wants_tick = true;
                return Status::Running;
            }
        }
    }

    pub(crate) fn tick_keep_running(&mut self, id: NodeId, context: &mut C) -> Status {
        match self.tick_child(id, context) {
            Status::Failure => Status::Failure,
            _ => Status::Running,
        }
    }

    pub(crate) fn tick_timeout(&mut self, id: NodeId, is_start: bool, context: &mut C) -> Status {
        if is_start {
            if let Err(failure) = self.add_secs(id) {
                return self.run.fail(id, failure);
            }
        } else if self.run.now_secs >= self.nodes[id as usize].deadline_secs {
            self.reset_children(id, context);
            let secs = self.built_in_port::<f64>(id, 0).ok().flatten().map_or(0.0, |secs| *secs);
            return self.run.fail(id, Failure::new(reason::TIMEOUT, format!("not done within {secs} s")));
        }
        self.tick_child(id, context)
    }

    pub(crate) fn tick_delay(&mut self, id: NodeId, is_start: bool, context: &mut C) -> Status {
        if is_start && let Err(failure) = self.add_secs(id) {
            return self.run.fail(id, failure);
        }
        if self.run.now_secs < self.nodes[id as usize].deadline_secs {
            return Status::Running;
        }
        self.tick_child(id, context)
    }

    pub(crate) fn tick_rate_limit(&mut self, id: NodeId, is_start: bool, context: &mut C) -> Status {
        let period_secs = match self.built_in_port::<f64>(id, 0) {
            Ok(hz) => hz.map_or(0.0, |hz| 1.0 / *hz),
            Err(failure) => return self.run.fail(id, failure),
        };
        let now_secs = self.run.now_secs;
        let node = &mut self.nodes[id as usize];
        if is_start {
            node.cursor = 0;
        }
        if node.cursor == 0 {
            let has_begun = node.count > 0;
            // Rounding must not cost a period.
            if has_begun && now_secs - f64::from_bits(node.seen) < period_secs * (1.0 - 1e-9) {
                return Status::Running;
            }
            (node.cursor, node.count, node.seen) = (1, 1, now_secs.to_bits());
        }
        let status = self.tick_child(id, context);
        if status != Status::Running {
            self.nodes[id as usize].cursor = 0;
        }
        status
    }

    pub(crate) fn tick_run_once(&mut self, id: NodeId, context: &mut C) -> Status {
        let node = &self.nodes[id as usize];
        if node.count > 0 {
            let then_skip = self.built_in_port::<bool>(id, 0).ok().flatten().is_none_or(|then_skip| *then_skip);
            return match (then_skip, self.kept.get(&id)) {
                (true, _) => Status::Skipped,
                (false, None) => Status::Success,
                (false, Some(at)) => {
                    let failure = at.failure.clone();
                    self.run.fail(id, failure)
                }
            };
        }
        let status = self.tick_child(id, context);
        if matches!(status, Status::Success | Status::Failure) {
            self.nodes[id as usize].count = 1;
            if let Some(at) = self.run.failure.clone().filter(|_| status == Status::Failure) {
                self.kept.insert(id, at);
            }
        }
        status
    }

    pub(crate) fn tick_loop(&mut self, id: NodeId, context: &mut C) -> Status {
        if self.nodes[id as usize].cursor == 0 {
            match self.next_item(id) {
                Ok(true) => self.nodes[id as usize].cursor = 1,
                Ok(false) => {
                    let if_empty = self.built_in_port::<Status>(id, 2).ok().flatten().map_or(Status::Success, |status| *status);
                    if if_empty == Status::Failure {
                        return self.run.fail(id, Failure::new(reason::NOTHING_LEFT, "nothing is left to do"));
                    }
                    return if_empty;
                }
                Err(failure) => return self.run.fail(id, failure),
            }
        }
        match self.tick_child(id, context) {
            Status::Running => Status::Running,
            Status::Failure => Status::Failure,
            _ => {
                let node = &mut self.nodes[id as usize];
                node.cursor = 0;
                self.run.wants_tick = true;
                Status::Running
            }
        }
    }

    /// Puts the next item on the blackboard; false when none is left.
    fn next_item(&mut self, id: NodeId) -> Result<bool, Failure> {
        let Some(list) = self.source(id, 0).read(&self.run.board.slots)? else { return Err(blackboard::empty("over")) };
        let item_idx = self.nodes[id as usize].count as usize;
        let item = if let Some(literal) = list.downcast_ref::<Literal>() {
            let Literal::List(items) = literal else {
                return Err(Failure::new(reason::WRONG_TYPE, format!("port \"over\": expected a list, found {literal}")));
            };
            items.get(item_idx).map(|item| Arc::new(item.clone()) as Value)
        } else {
            let Some(item) = self.lists.iter().find_map(|list_type| (list_type.next)(&*list, item_idx)) else {
                return Err(Failure::new(
                    reason::WRONG_TYPE,
                    "port \"over\": the value is of no type that is known as a list or queue",
                ));
            };
            item
        };
        let Some(item) = item else { return Ok(false) };
        self.nodes[id as usize].count += 1;
        self.write_any(id, 1, item)?;
        Ok(true)
    }

    /// Writes a value of any type to a key of a built-in node.
    fn write_any(&mut self, id: NodeId, port_idx: usize, value: Value) -> Result<(), Failure> {
        let Some(slot) = self.source(id, port_idx).slot() else { return Ok(()) };
        let port_type = self.slot_types[slot as usize].clone();
        let value = fit(value, port_type.as_ref()).map_err(|message| {
            Failure::new(reason::WRONG_TYPE, format!("blackboard key {:?}: {message}", self.slot_keys[slot as usize]))
        })?;
        self.run.put(id, slot, Some(value), port_type.as_ref());
        Ok(())
    }

    pub(crate) fn tick_precondition(&mut self, id: NodeId, context: &mut C) -> Status {
        let script = self.nodes[id as usize].leaf;
        if self.nodes[id as usize].cursor == 0 && script != NONE {
            match self.run_script(script, id) {
                Ok(true) => self.nodes[id as usize].cursor = 1,
                Ok(false) => {
                    let status = self.built_in_port::<Status>(id, 1).ok().flatten().map_or(Status::Failure, |status| *status);
                    if status == Status::Failure {
                        return self.run.fail(id, Failure { reason: reason::CONDITION_FALSE.into(), detail: String::new() });
                    }
                    return status;
                }
                Err(failure) => return self.run.fail(id, failure),
            }
        }
        self.tick_child(id, context)
    }

    pub(crate) fn tick_unless_updated(&mut self, id: NodeId, kind: Kind, context: &mut C) -> Status {
        if self.nodes[id as usize].cursor == 0 && !self.is_updated(id) {
            return if kind == Kind::WaitValueUpdate { Status::Running } else { Status::Skipped };
        }
        let status = self.tick_child(id, context);
        self.nodes[id as usize].cursor = u32::from(status == Status::Running);
        status
    }

    /// Whether the entry at port 0 was written since the last time.
    fn is_updated(&mut self, id: NodeId) -> bool {
        let sequence = self.source(id, 0).slot().map_or(0, |slot| self.run.board.stamp(slot).sequence);
        std::mem::replace(&mut self.nodes[id as usize].seen, sequence) != sequence
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

    /// Built-in nodes without children:
    ///
    /// | node | does | ends with |
    /// |---|---|---|
    /// | `script` {code} | runs the statements | Success |
    /// | `script_condition` {code} | evaluates the expression | Success when true, Failure with reason `condition_false` when not |
    /// | `set_blackboard` {value, output_key} | writes the entry | Success; Failure with reason `wrong_type` |
    /// | `unset_blackboard` {key} | empties the entry | Success |
    /// | `was_entry_updated` {entry} | compares the number of the last write | Success when newer than the last time it was asked |
    /// | `sleep` {secs} | waits | Success after `secs` |
    /// | `always_success`, `always_failure` | - | as named |
    pub(crate) fn tick_built_in_leaf(&mut self, id: NodeId, kind: Kind, is_start: bool) -> Status {
        match self.do_built_in_leaf(id, kind, is_start) {
            Ok(status) => status,
            Err(failure) => self.run.fail(id, failure),
        }
    }

    fn do_built_in_leaf(&mut self, id: NodeId, kind: Kind, is_start: bool) -> Result<Status, Failure> {
        let holds = |truth: bool| {
            if truth {
                Ok(Status::Success)
            } else {
                Err(Failure { reason: reason::CONDITION_FALSE.into(), detail: String::new() })
            }
        };
        match kind {
            Kind::Script => {
                // What its last statement gives is of no account, be it a text.
                self.run_script(self.nodes[id as usize].leaf, id).map(|_truth| Status::Success)
            }
            Kind::ScriptCondition => holds(self.run_script(self.nodes[id as usize].leaf, id)?),
            Kind::WasEntryUpdated => holds(self.is_updated(id)),
            Kind::SetBlackboard => {
                let Some(value) = self.source(id, 0).read(&self.run.board.slots)? else { return Err(blackboard::empty("value")) };
                self.write_any(id, 1, value)?;
                Ok(Status::Success)
            }
            Kind::UnsetBlackboard => {
                if let Some(slot) = self.source(id, 0).slot() {
                    self.run.put(id, slot, None, None);
                }
                Ok(Status::Success)
            }
            Kind::Sleep => {
                if is_start {
                    self.add_secs(id)?;
                }
                let is_over = self.run.now_secs >= self.nodes[id as usize].deadline_secs;
                Ok(if is_over { Status::Success } else { Status::Running })
            }
            Kind::AlwaysFailure => Err(Failure::new(reason::ALWAYS_FAILURE, "")),
            _ => Ok(Status::Success),
        }
    }

    /// Moves the deadline by the seconds at port 0.
    fn add_secs(&mut self, id: NodeId) -> Result<(), Failure> {
        let secs = self.built_in_port::<f64>(id, 0)?.map_or(f64::INFINITY, |secs| *secs);
        self.nodes[id as usize].deadline_secs += secs;
        Ok(())
    }

    fn tick_child(&mut self, id: NodeId, context: &mut C) -> Status {
        let child = self.child(id, 0);
        let status = self.tick_node(child, context);
        if status != Status::Running {
            self.set_status(child, Status::Idle);
        }
        status
    }

    /// Whether the child's reason is one that `on` (port 1) names.
    fn is_retried(&self, id: NodeId) -> bool {
        let Ok(Some(on)) = self.built_in_port::<Vec<String>>(id, 1) else { return true };
        let reason = self.run.failure.as_ref().map_or("", |at| &at.failure.reason);
        on.is_empty() || on.iter().any(|name| name == reason)
    }
}

/// Whether `count` rounds are all that `limit` allows; -1 allows any number.
fn is_used_up(count: u32, limit: i32) -> bool {
    u32::try_from(limit).is_ok_and(|limit| count >= limit)
}

/// The value as an entry of the type holds it.
fn fit(value: Value, port_type: Option<&PortType>) -> Result<Value, String> {
    let Some(port_type) = port_type else { return Ok(value) };
    if (*value).type_id() == port_type.id {
        return Ok(value);
    }
    let literal = match value.downcast_ref::<Literal>() {
        Some(literal) => Some(literal.clone()),
        // A number goes into an entry of another type of number.
        None => scalar_of(&*value).map(crate::script::Scalar::into_literal),
    };
    if port_type.id == TypeId::of::<Literal>()
        && let Some(literal) = literal
    {
        return Ok(Arc::new(literal));
    }
    match (&port_type.convert, literal) {
        (Some(convert), Some(literal)) => convert(&literal),
        _ => Err(format!("it holds {}, and the value is of another type", port_type.name)),
    }
}

//! Pre-conditions and post-conditions, and the scripts that nodes run.
//!
//! | condition | evaluated | then |
//! |---|---|---|
//! | `failure_if` | before a tick of a node that does not run | true: Failure with reason `failure_if`, the node is not ticked |
//! | `success_if` | the same, after it | true: Success, the node is not ticked |
//! | `skip_if` | the same, after it | true: Skipped, the node is not ticked |
//! | `while` | before every tick | false: the node is halted if it runs; Skipped |
//! | `on_success`, `on_failure` | after the node ended so, also when a pre-condition decided it | - |
//! | `post` | after either | - |
//! | `on_halted` | after the node was halted while it ran | - |
//!
//! A script that fails makes its node fail with reason `script_failed`; after a halt the failure is only noted.

use crate::blackboard::{Source, to_entry, to_literal};
use crate::port::{PortType, Value};
use crate::script::{Names, Scalar, Statement, scalar_of, scalar_of_literal};
use crate::spec::When;
use crate::status::{Failure, Status, reason};
use crate::tree::{NONE, NodeId, Runtime, Tree};
use std::borrow::Cow;

/// Scripts of one node, in the order of [`When::ALL`].
#[derive(Clone, Default)]
pub(crate) struct Conditions(pub(crate) [Option<u32>; 8]);

/// A script whose names are sources.
#[derive(Clone)]
pub(crate) struct Script {
    pub(crate) statements: Vec<Statement>,
    pub(crate) first_source: u32,
}

struct SourceNames<'a> {
    sources: &'a [Source],
    run: &'a Runtime,
    slot_keys: &'a [String],
    slot_types: &'a [Option<PortType>],
}

impl SourceNames<'_> {
    /// A value of a type of the application that files can give, such as a word out of a list.
    fn by_form(&self, value: &Value, slot: u32) -> Option<Scalar<'static>> {
        owned(scalar_of_literal(&to_literal(value, self.slot_types[slot as usize].as_ref())?))
    }
}

fn owned(scalar: Option<Scalar<'_>>) -> Option<Scalar<'static>> {
    Some(match scalar? {
        Scalar::Text(text) => Scalar::Text(Cow::Owned(text.into_owned())),
        Scalar::Number(number) => Scalar::Number(number),
        Scalar::Bool(value) => Scalar::Bool(value),
    })
}

impl Names for SourceNames<'_> {
    fn value(&self, name: u32) -> Result<Scalar<'_>, String> {
        let source = &self.sources[name as usize];
        let key = || source.slot().map_or("", |slot| &self.slot_keys[slot as usize]);
        if let Source::Slot(slot) = source {
            let Some(value) = &self.run.board.slots[*slot as usize].value else {
                return Err(format!("blackboard key {:?} has no value yet", key()));
            };
            return scalar_of(&**value)
                .or_else(|| self.by_form(value, *slot))
                .ok_or_else(|| format!("blackboard key {:?} holds no number, text or truth", key()));
        }
        let value = source.read(&self.run.board.slots).map_err(|failure| failure.to_string())?;
        let Some(value) = value else { return Err(format!("blackboard key {:?} has no value yet", key())) };
        owned(scalar_of(&*value)).ok_or_else(|| format!("the field of blackboard key {:?} is no number, text or truth", key()))
    }
}

impl<C> Tree<C> {
    /// Runs a script for the node and gives the truth of its last statement.
    pub(crate) fn run_script(&mut self, script: u32, id: NodeId) -> Result<bool, Failure> {
        let fail = |message: String| Failure::new(reason::SCRIPT_FAILED, message);
        let script = &self.scripts[script as usize];
        let sources = &self.sources[script.first_source as usize..];
        let mut truth = Ok(true);
        for statement in &script.statements {
            let names = SourceNames { sources, run: &self.run, slot_keys: &self.slot_keys, slot_types: &self.slot_types };
            let value = statement.value.eval(&names).map_err(fail)?;
            let Some(slot) = statement.target.and_then(|target| sources[target as usize].slot()) else {
                truth = value.truth();
                continue;
            };
            let old = self.run.board.slots[slot as usize].value.as_ref();
            let value = to_entry(value, old, self.slot_types[slot as usize].as_ref()).map_err(fail)?;
            self.run.put(id, slot, Some(value), self.slot_types[slot as usize].as_ref());
        }
        truth.map_err(fail)
    }

    /// A tick of a node with conditions.
    pub(crate) fn tick_conditioned(&mut self, id: NodeId, context: &mut C) -> Status {
        let status = match self.pre_condition(id, context) {
            Ok(None) => self.tick_plain(id, context),
            Ok(Some(status)) => {
                self.set_status(id, status);
                status
            }
            Err(failure) => self.fail_now(id, failure),
        };
        let after = match status {
            Status::Success => When::OnSuccess,
            Status::Failure => When::OnFailure,
            _ => return status,
        };
        for when in [after, When::Post] {
            if let Some(script) = self.condition(id, when)
                && let Err(failure) = self.run_script(script, id)
            {
                return self.fail_now(id, failure);
            }
        }
        status
    }

    fn fail_now(&mut self, id: NodeId, failure: Failure) -> Status {
        self.run.fail(id, failure);
        self.set_status(id, Status::Failure);
        Status::Failure
    }

    fn condition(&self, id: NodeId, when: When) -> Option<u32> {
        let conditions = self.nodes[id as usize].conditions;
        if conditions == NONE { None } else { self.conditions[conditions as usize].0[when as usize] }
    }

    /// What the pre-conditions decide, if anything.
    fn pre_condition(&mut self, id: NodeId, context: &mut C) -> Result<Option<Status>, Failure> {
        let is_running = self.nodes[id as usize].status == Status::Running;
        for (when, status) in
            [(When::FailureIf, Status::Failure), (When::SuccessIf, Status::Success), (When::SkipIf, Status::Skipped)]
        {
            if let Some(script) = self.condition(id, when)
                && !is_running
                && self.run_script(script, id)?
            {
                if status == Status::Failure {
                    return Err(Failure::new(reason::FAILURE_IF, "its condition `failure_if` holds"));
                }
                return Ok(Some(status));
            }
        }
        if let Some(script) = self.condition(id, When::While)
            && !self.run_script(script, id)?
        {
            self.halt_node(id, context);
            return Ok(Some(Status::Skipped));
        }
        Ok(None)
    }

    /// What follows the halt of a running node.
    pub(crate) fn after_halt(&mut self, id: NodeId) {
        if let Some(script) = self.condition(id, When::OnHalted)
            && let Err(failure) = self.run_script(script, id)
        {
            self.run.note_failure(id, failure);
        }
    }
}

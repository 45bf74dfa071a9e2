//! What happened, in order.

use crate::literal::Literal;
use crate::status::{Failure, Status};

/// How much is written down.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum JournalLevel {
    /// Nothing.
    #[default]
    Off,
    /// Status changes and failures.
    Transitions,
    /// Port writes as well.
    Writes,
    /// Port writes with their values, where these have the form of a literal, and every tick: enough for [`crate::replay`].
    Values,
}

/// One event.
#[derive(Clone, Debug, PartialEq)]
pub struct Record {
    /// Number of the tick, from 1.
    pub tick_idx: u64,
    /// Time handed to that tick.
    pub now_secs: f64,
    /// The node.
    pub node: u32,
    /// What happened.
    pub change: Change,
}

/// What happened to a node.
#[derive(Clone, Debug, PartialEq)]
pub enum Change {
    /// Another status.
    Status {
        /// Before.
        from: Status,
        /// After.
        to: Status,
    },
    /// The node itself failed, and why; its change of status follows.
    Failed(Box<Failure>),
    /// The node wrote a blackboard entry; [`crate::Tree::slot_key`] names it.
    Write {
        /// Number of the entry.
        slot: u32,
        /// What was written, at [`JournalLevel::Values`].
        value: Option<Box<Literal>>,
    },
    /// A tick begins. The node is the root.
    Ticked,
    /// The owner halts the tree. The node is the root.
    HaltAsked,
    /// The owner gives the node a result: see [`crate::Tree::force`].
    Forced(Result<(), Box<Failure>>),
    /// The owner let time stand still: see [`crate::Tree::postpone`]. The node is the root.
    Postponed {
        /// How long, seconds.
        secs: f64,
    },
}

/// A [`Record`] with names in place of numbers, for files. Numbers change when a tree is built anew.
#[derive(Clone, Debug, PartialEq)]
pub struct NamedRecord {
    /// Number of the tick, from 1.
    pub tick_idx: u64,
    /// Time handed to that tick.
    pub now_secs: f64,
    /// The way to the node from the root; of siblings with the same name the second is `lift#2`. Empty for the application.
    pub path: String,
    /// What happened.
    pub change: NamedChange,
}

/// A [`Change`] with names in place of numbers.
#[derive(Clone, Debug, PartialEq)]
pub enum NamedChange {
    /// Another status.
    Status {
        /// Before.
        from: Status,
        /// After.
        to: Status,
    },
    /// The node itself failed, and why.
    Failed(Failure),
    /// The node wrote a blackboard entry.
    Write {
        /// Its key; entries of subtrees begin with the path of the subtree.
        key: String,
        /// What was written, where it has the form of a literal.
        value: Option<Literal>,
    },
    /// A tick begins.
    Ticked,
    /// The owner halts the tree.
    HaltAsked,
    /// The owner gives the node a result.
    Forced(Result<(), Failure>),
    /// The owner let time stand still.
    Postponed {
        /// How long, seconds.
        secs: f64,
    },
}

/// Names of the nodes and entries of a tree; made by [`crate::Tree::names`], valid until it is reloaded.
#[derive(Clone, Debug)]
pub struct Names {
    pub(crate) paths: Vec<String>,
    pub(crate) keys: Vec<String>,
}

impl Names {
    /// The way to a node.
    #[must_use]
    pub fn path(&self, node: u32) -> &str {
        self.paths.get(node as usize).map_or("", String::as_str)
    }

    /// The record with names.
    #[must_use]
    pub fn of(&self, record: Record) -> NamedRecord {
        let change = match record.change {
            Change::Status { from, to } => NamedChange::Status { from, to },
            Change::Failed(failure) => NamedChange::Failed(*failure),
            Change::Write { slot, value } => {
                let key = self.keys.get(slot as usize).cloned().unwrap_or_default();
                NamedChange::Write { key, value: value.map(|value| *value) }
            }
            Change::Ticked => NamedChange::Ticked,
            Change::HaltAsked => NamedChange::HaltAsked,
            Change::Forced(result) => NamedChange::Forced(result.map_err(|failure| *failure)),
            Change::Postponed { secs } => NamedChange::Postponed { secs },
        };
        let path = self.path(record.node).to_owned();
        NamedRecord { tick_idx: record.tick_idx, now_secs: record.now_secs, path, change }
    }
}

/// The events since the last [`crate::Tree::drain_journal`].
#[derive(Default)]
pub(crate) struct Journal {
    pub(crate) level: JournalLevel,
    pub(crate) records: Vec<Record>,
}

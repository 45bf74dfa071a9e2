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
    /// Port writes with their values, where these have the form of a literal.
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
}

/// The events since the last [`crate::Tree::drain_journal`].
#[derive(Default)]
pub(crate) struct Journal {
    pub(crate) level: JournalLevel,
    pub(crate) records: Vec<Record>,
}

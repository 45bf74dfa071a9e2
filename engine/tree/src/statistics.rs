//! What each node did, counted from the journal.

use crate::journal::{Change, Record};
use crate::status::Status;
use crate::tree::NodeId;

/// Counts of one node.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct NodeStatistics {
    /// How often it began to run.
    pub n_started: u64,
    /// How often it succeeded.
    pub n_succeeded: u64,
    /// How often it failed.
    pub n_failed: u64,
    /// How often it was skipped.
    pub n_skipped: u64,
    /// How often it was halted while it ran.
    pub n_halted: u64,
    /// Time it has been running, seconds; without the time since it began when it runs now.
    pub running_secs: f64,
    running_since_secs: f64,
}

/// Counts of every node of a tree, fed with its journal.
#[derive(Clone, Debug, Default)]
pub struct Statistics(Vec<NodeStatistics>);

impl Statistics {
    /// Adds a record.
    pub fn observe(&mut self, record: &Record) {
        let Change::Status { from, to } = record.change else { return };
        let node = record.node as usize;
        if self.0.len() <= node {
            self.0.resize(node + 1, NodeStatistics::default());
        }
        let counts = &mut self.0[node];
        if from == Status::Running {
            counts.running_secs += record.now_secs - counts.running_since_secs;
        }
        match to {
            Status::Running => {
                counts.n_started += 1;
                counts.running_since_secs = record.now_secs;
            }
            Status::Success => counts.n_succeeded += 1,
            Status::Failure => counts.n_failed += 1,
            Status::Skipped => counts.n_skipped += 1,
            Status::Idle => counts.n_halted += u64::from(from == Status::Running),
        }
    }

    /// Counts of one node.
    #[must_use]
    pub fn of(&self, node: NodeId) -> NodeStatistics {
        self.0.get(node as usize).copied().unwrap_or_default()
    }
}

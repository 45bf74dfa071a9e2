//! What the live view shows, brought up to date by the owner of the tree once per tick.

use super::board::Board;
use super::scopes::Scopes;
use super::{MAX_NODES, alias, status_byte, transition, tree_xml};
use crate::journal::{Change, Record};
use crate::port::Value;
use crate::status::Status;
use crate::tree::{NONE, NodeId, Tree};
use std::collections::VecDeque;
use std::hash::{BuildHasher as _, Hasher as _, RandomState};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// How many changes a recording keeps for the next request.
pub(super) const MAX_TRANSITIONS: usize = 1000;
/// Values that nobody asks for are looked at this often, so that a client that comes after the last tick sees them.
const UNASKED: Duration = Duration::from_millis(100);
/// Added to the status that a node had before it became idle.
const IDLE_AFTER: u8 = 10;

/// A tree as it was after its last tick.
#[derive(Default)]
pub(super) struct Snapshot {
    pub(super) xml: Arc<str>,
    pub(super) uuid: [u8; 16],
    pub(super) board: Arc<Board>,
    /// Number and status of each node, as they are sent.
    pub(super) status: Vec<u8>,
    pub(super) values: Vec<Option<Value>>,
    pub(super) transitions: VecDeque<[u8; 9]>,
    /// Time of the tree when the recording began.
    pub(super) recording_from_secs: Option<f64>,
    pub(super) now_secs: f64,
    /// Why nothing is shown.
    pub(super) refusal: Option<String>,
    /// A client waits for values as of the next tick.
    pub(super) wants_values: bool,
    /// Whether `values` are those of the last tick.
    pub(super) has_newest_values: bool,
    identity: Identity,
    n_writes: u64,
    valued_at: Option<Instant>,
    was_running: bool,
}

/// A reload puts new tables in the place of these, and they are made before the old ones go.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Identity([usize; 6]);

impl Identity {
    fn of<C>(tree: &Tree<C>) -> Self {
        Self([
            tree.nodes.as_ptr().addr(),
            tree.nodes.len(),
            tree.locations.as_ptr().addr(),
            tree.sources.as_ptr().addr(),
            tree.slot_keys.as_ptr().addr(),
            tree.slot_keys.len(),
        ])
    }
}

impl Snapshot {
    pub(super) fn new<C>(tree: &Tree<C>) -> Self {
        let mut snapshot = Self::default();
        snapshot.show(tree);
        snapshot
    }

    /// Begins anew with this tree.
    pub(super) fn show<C>(&mut self, tree: &Tree<C>) {
        self.identity = Identity::of(tree);
        self.uuid = random_uuid();
        self.transitions.clear();
        self.values.clear();
        self.n_writes = 0;
        self.now_secs = tree.now_secs();
        self.refusal = None;
        (self.status, self.board, self.xml) = (Vec::new(), Arc::default(), Arc::from(""));
        if tree.n_nodes() > MAX_NODES {
            let n_nodes = tree.n_nodes();
            self.refusal = Some(format!("the tree has {n_nodes} nodes, Groot2 numbers at most {MAX_NODES}"));
            return;
        }
        let paths = tree.unique_paths();
        let scopes = Scopes::new(tree, &paths);
        self.xml = tree_xml::with_scopes(tree, &paths, &scopes).into();
        self.board = Arc::new(Board::new(tree, scopes));
        let nodes = tree.nodes.iter().zip(0..);
        let bytes = nodes.filter_map(|(node, id)| Some((alias(id)?.to_le_bytes(), status_byte(node.status))));
        self.status = bytes.flat_map(|([low, high], status)| [low, high, status]).collect();
        self.take_values(tree);
    }

    /// Takes over what happened since the last call.
    pub(super) fn update<C>(&mut self, tree: &Tree<C>, records: &[Record]) {
        self.now_secs = tree.now_secs();
        if self.identity != Identity::of(tree) {
            // The records may name nodes of either tree; the statuses are in the tree itself.
            return self.show(tree);
        }
        if self.refusal.is_some() {
            return;
        }
        let mut is_journaled = false;
        for record in records {
            if let Change::Status { from, to } = record.change {
                is_journaled = true;
                self.change(tree, record.node, from, to);
                self.record(record, to);
            }
        }
        if !is_journaled {
            self.read_statuses(tree);
        }
        self.update_values(tree);
    }

    fn change<C>(&mut self, tree: &Tree<C>, id: NodeId, from: Status, to: Status) {
        let byte = if to == Status::Idle { IDLE_AFTER + status_byte(from) } else { status_byte(to) };
        self.set_byte(id, byte);
        // A skipped node is idle here at once, there with its parent.
        if to != Status::Running
            && let Some(node) = tree.nodes.get(id as usize)
        {
            for at in node.first_child..node.first_child + node.n_children {
                let child = tree.children.get(at as usize).copied().unwrap_or(NONE);
                if self.byte(child) == Some(status_byte(Status::Skipped)) {
                    self.set_byte(child, IDLE_AFTER + status_byte(Status::Skipped));
                }
            }
        }
    }

    fn byte(&self, id: NodeId) -> Option<u8> {
        self.status.get((id as usize).checked_mul(3)?.checked_add(2)?).copied()
    }

    fn set_byte(&mut self, id: NodeId, byte: u8) {
        let at = (id as usize).checked_mul(3).and_then(|at| at.checked_add(2));
        if let Some(place) = at.and_then(|at| self.status.get_mut(at)) {
            *place = byte;
        }
    }

    fn record(&mut self, record: &Record, to: Status) {
        let Some(from_secs) = self.recording_from_secs else { return };
        let Some(alias) = alias(record.node) else { return };
        if let Some(bytes) = transition((record.now_secs - from_secs).max(0.0), alias, to) {
            if self.transitions.len() == MAX_TRANSITIONS {
                self.transitions.pop_front();
            }
            self.transitions.push_back(bytes);
        }
    }

    /// Without a journal the statuses between ticks are all there is.
    fn read_statuses<C>(&mut self, tree: &Tree<C>) {
        for (node, place) in tree.nodes.iter().zip(self.status.chunks_exact_mut(3)) {
            let shown = if matches!(place[2], 1..=3) { place[2] } else { 0 };
            let found = status_byte(node.status);
            if shown != found {
                place[2] = if found == 0 { IDLE_AFTER + shown } else { found };
            }
        }
    }

    fn update_values<C>(&mut self, tree: &Tree<C>) {
        let is_running = tree.nodes.first().is_some_and(|root| root.status == Status::Running);
        let has_ended = std::mem::replace(&mut self.was_running, is_running) && !is_running;
        if tree.run.board.n_writes == self.n_writes {
            self.has_newest_values = true;
            self.wants_values = false;
            return;
        }
        let is_due = || self.valued_at.is_none_or(|at| at.elapsed() >= UNASKED);
        if self.wants_values || has_ended || is_due() {
            self.take_values(tree);
        } else {
            self.has_newest_values = false;
        }
    }

    /// Shares the values written since the last call; they are read when a client asks.
    fn take_values<C>(&mut self, tree: &Tree<C>) {
        self.values.resize(tree.run.board.slots.len(), None);
        for (value, slot) in self.values.iter_mut().zip(&tree.run.board.slots) {
            // A value held here is never written in place, so another one has another address.
            if value.as_ref().map(Arc::as_ptr) != slot.value.as_ref().map(Arc::as_ptr) {
                value.clone_from(&slot.value);
            }
        }
        self.n_writes = tree.run.board.n_writes;
        self.valued_at = Some(Instant::now());
        (self.has_newest_values, self.wants_values) = (true, false);
    }
}

/// A random UUID, version 4. It tells trees apart and guards nothing.
fn random_uuid() -> [u8; 16] {
    let mut uuid = [0; 16];
    for half in uuid.chunks_exact_mut(8) {
        // Each has keys of its own, from the system's random numbers.
        half.copy_from_slice(&RandomState::new().build_hasher().finish().to_le_bytes());
    }
    uuid[6] = uuid[6] & 0x0f | 0x40;
    uuid[8] = uuid[8] & 0x3f | 0x80;
    uuid
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_tree_has_a_uuid_of_its_own() {
        let (one, other) = (random_uuid(), random_uuid());
        assert_ne!(one, other);
        assert_eq!((one[6] >> 4, one[8] >> 6), (4, 2));
    }
}

//! Logs and a live view for Groot2, the editor and monitor of BehaviorTree.CPP.
//!
//! | what | made with | format |
//! |---|---|---|
//! | tree as XML with node numbers | [`tree_xml`] | BehaviorTree.CPP 4 |
//! | log file | [`BtlogWriter`] | `.btlog`, FileLogger2 version 1 |
//! | live view | [`Server`] | Groot2 protocol 2 over ZMTP 3.1, read-only |
//!
//! The formats number nodes from 1 with 16 bits: node `id` is number `id + 1`, and a tree has at most [`MAX_NODES`] nodes.
//!
//! ```
//! use sfg_tree::groot::BtlogWriter;
//! use sfg_tree::{JournalLevel, NodeSpec, Registry, TreeSpec};
//!
//! let mut tree = Registry::<()>::new().build(&TreeSpec::new(NodeSpec::new("always_success"))).map_err(|e| e[0].to_string())?;
//! tree.set_journal_level(JournalLevel::Transitions);
//! let mut log = BtlogWriter::for_tree(Vec::new(), &tree, 0).map_err(|error| error.to_string())?;
//! tree.tick(0.5, &mut ());
//! log.records(&tree.drain_journal()).map_err(|error| error.to_string())?;
//! let file = log.finish().map_err(|error| error.to_string())?;
//! assert_eq!(file[..18], *b"BTCPP4-FileLogger2");
//! assert_eq!(file[file.len() - 27..][..9], [0x20, 0xa1, 7, 0, 0, 0, 1, 0, 1], "half a second, node 1, running");
//! # Ok::<(), String>(())
//! ```

mod board;
mod btlog;
mod msgpack;
mod names;
mod reply;
mod scopes;
mod server;
mod snapshot;
mod tree_xml;
mod zmtp;

pub use btlog::BtlogWriter;
pub use server::Server;
pub use tree_xml::tree_xml;

use crate::blackboard::{self, Form};
use crate::literal::Literal;
use crate::port::{PortType, Value};
use crate::status::Status;
use crate::tree::NodeId;
use std::any::TypeId;
use std::collections::HashMap;
use thiserror::Error;

/// Most nodes a tree can have: numbers are 16 bits wide and 0 is none.
pub const MAX_NODES: usize = u16::MAX as usize;

/// Why a log or a live view cannot be made.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum GrootError {
    /// The tree is too large for the format.
    #[error("the tree has {n_nodes} nodes, Groot2 numbers at most {MAX_NODES}")]
    TooManyNodes {
        /// How many it has, or at least has.
        n_nodes: usize,
    },
    /// The definition of the tree is too long for the format.
    #[error("the XML of the tree has {n_bytes} bytes, a log holds at most {}", i32::MAX)]
    XmlTooLong {
        /// Its length.
        n_bytes: usize,
    },
    /// The time of a record cannot be written.
    #[error("a time of {now_secs} s since the start of the log cannot be written, expected 0 to 281474976 s")]
    Time {
        /// The time of the tick.
        now_secs: f64,
    },
    /// The second socket has the next port, which does not exist.
    #[error("port {port} has no next port for the publisher")]
    NoNextPort {
        /// As asked for.
        port: u16,
    },
    /// A socket cannot be opened; another monitor may have the port.
    #[error("port {port} cannot be opened")]
    Port {
        /// The port.
        port: u16,
        /// What the system says.
        source: std::io::Error,
    },
    /// A thread cannot be started.
    #[error("the system gives no thread for the live view")]
    NoThread {
        /// What the system says.
        source: std::io::Error,
    },
    /// The log cannot be written.
    #[error("the log cannot be written")]
    Write {
        /// What the system says.
        source: std::io::Error,
    },
}

/// The number of a node in files and messages, or nothing when it has none.
fn alias(node: NodeId) -> Option<u16> {
    u16::try_from(node).ok()?.checked_add(1)
}

/// A value as a literal, where its type has that form.
fn literal_of(value: &Value, port_type: Option<&PortType>, forms: &HashMap<TypeId, Form>) -> Option<Literal> {
    blackboard::to_form(value, port_type, forms)
}

/// A status in files and messages.
fn status_byte(status: Status) -> u8 {
    match status {
        Status::Idle => 0,
        Status::Running => 1,
        Status::Success => 2,
        Status::Failure => 3,
        Status::Skipped => 4,
    }
}

/// A change of status in files and messages: 48 bits of microseconds, 16 of the node, 8 of the status, little-endian.
/// Nothing when the time is before the start or more than 8.9 years after it.
fn transition(secs: f64, alias: u16, status: Status) -> Option<[u8; 9]> {
    let micros = (secs * 1e6).round();
    if !(0.0..281_474_976_710_656.0).contains(&micros) {
        return None;
    }
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "checked above")]
    let micros = (micros as u64).to_le_bytes();
    let alias = alias.to_le_bytes();
    Some([micros[0], micros[1], micros[2], micros[3], micros[4], micros[5], alias[0], alias[1], status_byte(status)])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nodes_are_numbered_from_one_with_16_bits() {
        assert_eq!(alias(0), Some(1));
        assert_eq!(alias(65_534), Some(65_535));
        assert_eq!(alias(65_535), None);
        assert_eq!(alias(u32::MAX), None);
    }

    #[test]
    fn a_transition_has_nine_bytes() {
        assert_eq!(transition(1.5, 0x0102, Status::Failure), Some([0x60, 0xe3, 0x16, 0, 0, 0, 2, 1, 3]));
        assert_eq!(transition(281_474_976.7, 1, Status::Idle), Some([0x60, 0xd6, 0xff, 0xff, 0xff, 0xff, 1, 0, 0]));
        for secs in [-1e-3, 281_474_977.0, f64::NAN, f64::INFINITY] {
            assert_eq!(transition(secs, 1, Status::Idle), None);
        }
    }
}

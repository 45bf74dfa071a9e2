//! Mistakes in a [`crate::TreeSpec`].

use thiserror::Error;

/// One mistake and its place.
#[derive(Clone, Debug, PartialEq, Error)]
#[error("{path}: {problem}")]
pub struct BuildError {
    /// The `location` of the node, port or subtree at fault.
    pub location: u32,
    /// The way from the root: `sequence/retry/lift`.
    pub path: String,
    /// What is wrong.
    pub problem: Problem,
    /// What to do about it, if there is more to say.
    pub help: Option<String>,
}

/// What is wrong with a tree.
#[derive(Clone, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum Problem {
    /// No such kind of node.
    #[error("unknown node {name:?}")]
    UnknownNode {
        /// As written.
        name: String,
    },
    /// No such subtree.
    #[error("unknown subtree {name:?}")]
    UnknownSubtree {
        /// As written.
        name: String,
    },
    /// Two subtrees have one name.
    #[error("subtree {name:?} is defined twice")]
    DuplicateSubtree {
        /// The name.
        name: String,
    },
    /// A subtree uses itself.
    #[error("subtree {name:?} contains itself: {chain}")]
    RecursiveSubtree {
        /// The name.
        name: String,
        /// Who uses whom.
        chain: String,
    },
    /// Too few or too many children.
    #[error("{kind:?} takes {expected}, found {n_found}")]
    ChildCount {
        /// Kind of the node.
        kind: String,
        /// How many it takes, in words.
        expected: String,
        /// How many it has.
        n_found: usize,
    },
    /// The node has no such port.
    #[error("{kind:?} has no port {port:?}")]
    UnknownPort {
        /// Kind of the node.
        kind: String,
        /// As written.
        port: String,
    },
    /// A port is given twice.
    #[error("port {port:?} is given twice")]
    DuplicatePort {
        /// The port.
        port: String,
    },
    /// A port must be given and is not.
    #[error("{kind:?} needs port {port:?}: {expected}")]
    MissingPort {
        /// Kind of the node.
        kind: String,
        /// The port.
        port: String,
        /// What it takes.
        expected: String,
    },
    /// A literal does not fit its port.
    #[error("port {port:?}: {message}")]
    BadLiteral {
        /// The port.
        port: String,
        /// Expected and found.
        message: String,
    },
    /// An output needs a key.
    #[error("port {port:?} is written by the node and needs a blackboard key such as \"{{{port}}}\"")]
    OutputNeedsKey {
        /// The port.
        port: String,
    },
    /// A key is read that holds nothing.
    #[error("port {port:?} reads blackboard key {key:?}, which no earlier node writes")]
    DanglingKey {
        /// The port.
        port: String,
        /// The key.
        key: String,
    },
    /// Writer and reader of a key disagree.
    #[error("port {port:?} uses blackboard key {key:?} as {found}, but {other} {other_does} it as {expected}")]
    TypeClash {
        /// The port.
        port: String,
        /// The key.
        key: String,
        /// Type of this port.
        found: String,
        /// Type of the entry.
        expected: String,
        /// Path of the node that settled the type.
        other: String,
        /// `writes` or `reads`.
        other_does: &'static str,
    },
    /// A value has no such field.
    #[error("port {port:?}: {type_name} has no field {field:?}")]
    UnknownField {
        /// The port.
        port: String,
        /// Type of the value.
        type_name: String,
        /// As written.
        field: String,
    },
    /// A node writes what the subtree only reads.
    #[error("port {port:?} writes blackboard key {key:?}, which the subtree declares as an input")]
    ReadOnlyKey {
        /// The port.
        port: String,
        /// The key.
        key: String,
    },
    /// Nesting beyond reason.
    #[error("the tree is nested deeper than {limit} nodes")]
    TooDeep {
        /// The limit.
        limit: usize,
    },
    /// Subtrees multiply beyond reason.
    #[error("the tree has more than {limit} nodes once its subtrees are unfolded")]
    TooLarge {
        /// The limit.
        limit: usize,
    },
}

/// Why the application cannot set a blackboard entry.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum EntryError {
    /// The entry has another type.
    #[error("blackboard key {key:?} holds {expected}, not {found}")]
    Type {
        /// The key.
        key: String,
        /// Type of the entry.
        expected: String,
        /// Type given.
        found: String,
    },
}

//! What is wrong with a file, or cannot be written into one.

use std::fmt;
use thiserror::Error;

/// One mistake and its place.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error("{place}: {text:?}: {fault}")]
pub struct XmlProblem {
    /// Where it is.
    pub place: XmlPlace,
    /// What is at fault, as written; long texts are cut.
    pub text: String,
    /// What is wrong with it.
    pub fault: XmlFault,
    /// What to do about it.
    pub help: String,
}

/// Where a mistake is.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum XmlPlace {
    /// In a file that is imported.
    File {
        /// Path it was loaded by; empty for the text given.
        path: String,
        /// From 1.
        line: u32,
        /// In characters, from 1.
        column: u32,
    },
    /// In a tree that is exported.
    Node {
        /// The way from the root: `sequence/retry/lift`.
        path: String,
        /// The `location` of the node, port or subtree.
        location: u32,
    },
}

impl fmt::Display for XmlPlace {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::File { path, line, column } if path.is_empty() => write!(f, "{line}:{column}"),
            Self::File { path, line, column } => write!(f, "{path}:{line}:{column}"),
            Self::Node { path, .. } => f.write_str(path),
        }
    }
}

/// What is wrong.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum XmlFault {
    /// No XML. Only the first such mistake of a file is found.
    #[error("not well-formed XML: {message}")]
    Syntax {
        /// As the parser says it.
        message: String,
    },
    /// Files beyond reason.
    #[error("the files have more than {limit} bytes")]
    TooLarge {
        /// The limit.
        limit: usize,
    },
    /// Nesting beyond reason.
    #[error("nested deeper than {limit} nodes")]
    TooDeep {
        /// The limit.
        limit: usize,
    },
    /// A number of things beyond reason.
    #[error("more than {limit} {what}")]
    TooMany {
        /// Of what.
        what: &'static str,
        /// The limit.
        limit: usize,
    },
    /// The outermost element is not `root`.
    #[error("a file of BehaviorTree.CPP has <root> around everything")]
    UnknownRoot,
    /// Something that only BehaviorTree.CPP 3 has.
    #[error("this is of BehaviorTree.CPP 3")]
    Version3,
    /// Neither format 3 nor 4.
    #[error("unknown BTCPP_format")]
    UnknownFormat,
    /// No such element here.
    #[error("unknown element in <{parent}>")]
    UnknownElement {
        /// The element around it.
        parent: &'static str,
    },
    /// An attribute must be given and is not.
    #[error("the attribute {attribute:?} is missing")]
    MissingAttribute {
        /// The attribute.
        attribute: &'static str,
    },
    /// An attribute that has no place here.
    #[error("the attribute is not allowed here")]
    MisplacedAttribute,
    /// Two trees have one name.
    #[error("this tree is defined twice")]
    DuplicateTree,
    /// Two palette entries of a subtree differ.
    #[error("this subtree has two different models")]
    DuplicateModel,
    /// An element takes another number of children.
    #[error("expected {expected}, found {n_found}")]
    ChildCount {
        /// How many it takes, in words.
        expected: &'static str,
        /// How many it has.
        n_found: usize,
    },
    /// Nobody says which tree to run.
    #[error("no tree to run is named")]
    NoMainTree,
    /// No such tree.
    #[error("unknown tree")]
    UnknownTree,
    /// A file is looked for in a ROS package.
    #[error("files of ROS packages cannot be included")]
    RosPackage,
    /// A file includes itself.
    #[error("the file includes itself: {chain}")]
    IncludeCycle {
        /// Who includes whom.
        chain: String,
    },
    /// A file cannot be loaded.
    #[error("cannot be included: {message}")]
    Include {
        /// As the loader says it.
        message: String,
    },
    /// A name with a letter that names cannot have.
    #[error("a name cannot have {letter:?}")]
    ForbiddenLetter {
        /// The letter.
        letter: char,
    },
    /// A name that means something else.
    #[error("this name is reserved")]
    ReservedName,
    /// A name that cannot be a port's.
    #[error("a port begins with a letter from a to z")]
    PortName,
    /// Braces that hold no key.
    #[error("no blackboard key: {message}")]
    BadKey {
        /// Why not.
        message: String,
    },
    /// A constant that the port does not take.
    #[error("expected {expected}")]
    BadValue {
        /// What it takes.
        expected: String,
    },
    /// The port takes no key.
    #[error("a key cannot stand here: {message}")]
    KeyHere {
        /// Why not.
        message: &'static str,
    },
    /// No such port.
    #[error("{node} has no such port")]
    UnknownPort {
        /// The node.
        node: String,
    },
    /// A port must be given and is not.
    #[error("the port {port:?} must be given")]
    MissingPort {
        /// The port.
        port: String,
    },
    /// The format is not named; a warning.
    #[error("BTCPP_format is missing; read as format 4")]
    NoFormat,
    /// Something that has no effect; a warning.
    #[error("this has no effect")]
    Ignored,
    /// A letter that XML wants written otherwise; a warning.
    #[error("XML wants {expected} here")]
    BareLetter {
        /// How to write it.
        expected: &'static str,
    },
    /// BehaviorTree.CPP cannot say this.
    #[error("BehaviorTree.CPP has no {what}")]
    Lossy {
        /// What it lacks.
        what: &'static str,
    },
}

/// The beginning of a text, short enough for a message.
pub(super) fn excerpt(text: &str) -> String {
    const N_LETTERS: usize = 80;
    match text.char_indices().nth(N_LETTERS) {
        Some((end, _)) => format!("{}...", &text[..end]),
        None => text.to_owned(),
    }
}

//! A tree as plain data: what a file or a program asks for, not yet checked.

use crate::literal::Literal;
use crate::port::Direction;

/// A tree to build.
#[derive(Clone, Debug, Default)]
pub struct TreeSpec {
    /// The root node.
    pub root: NodeSpec,
    /// Trees that a `subtree` node can name.
    pub subtrees: Vec<SubtreeSpec>,
    /// Blackboard entries of the root scope that exist before the first tick: key, value, location.
    pub entries: Vec<(String, Literal, u32)>,
    /// A key that nothing writes is a mistake unless this is set; then reading it fails when the tree runs.
    pub allows_unwritten_keys: bool,
    /// The file format has no types: a text given to a number port is read as a number.
    pub has_untyped_texts: bool,
}

impl TreeSpec {
    /// A tree without subtrees and entries.
    #[must_use]
    pub fn new(root: NodeSpec) -> Self {
        Self { root, ..Self::default() }
    }

    /// Adds a subtree.
    #[must_use]
    pub fn subtree(mut self, subtree: SubtreeSpec) -> Self {
        self.subtrees.push(subtree);
        self
    }

    /// Adds an entry.
    #[must_use]
    pub fn entry(mut self, key: impl Into<String>, value: impl Into<Literal>) -> Self {
        self.entries.push((key.into(), value.into(), 0));
        self
    }
}

/// A tree with its own blackboard scope; only its ports connect it to the scope of its user.
#[derive(Clone, Debug, Default)]
pub struct SubtreeSpec {
    /// What `subtree` nodes call it.
    pub name: String,
    /// Its connections.
    pub ports: Vec<SubtreePort>,
    /// Its users may connect keys that are not among `ports`, in both directions.
    pub is_open: bool,
    /// Its root.
    pub root: NodeSpec,
    /// Where it was written; meaning is the author's.
    pub location: u32,
}

/// A connection of a subtree: a key inside that is a key or a value outside.
#[derive(Clone, Debug)]
pub struct SubtreePort {
    /// The key inside; also the key outside unless the user of the subtree says otherwise.
    pub name: String,
    /// Which way values go, seen from inside.
    pub direction: Direction,
    /// Value used when the user says nothing.
    pub default: Option<Literal>,
    /// Where it was written.
    pub location: u32,
}

/// What a node is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum NodeKind {
    /// A built-in or registered kind: `sequence`, `lift`.
    Named(String),
    /// A use of the subtree of this name.
    Subtree(String),
}

impl Default for NodeKind {
    fn default() -> Self {
        Self::Named(String::new())
    }
}

/// One node.
#[derive(Clone, Debug, Default)]
pub struct NodeSpec {
    /// What it is.
    pub kind: NodeKind,
    /// A name of its own, for journals and messages.
    pub title: Option<String>,
    /// What its ports are given.
    pub ports: Vec<PortSetting>,
    /// Scripts that decide before it is ticked or run after it.
    pub conditions: Vec<ConditionSpec>,
    /// Of a subtree: every key inside that is not connected is the key of the same name outside, unless it begins with `_`.
    pub is_autoremapped: bool,
    /// Its children in order.
    pub children: Vec<NodeSpec>,
    /// Where it was written; comes back in [`crate::BuildError`].
    pub location: u32,
}

/// A pre-condition or post-condition of a node.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ConditionSpec {
    /// When it is evaluated and what follows.
    pub when: When,
    /// The script.
    pub script: String,
    /// Where it was written; comes back in [`crate::BuildError`].
    pub location: u32,
}

/// When the script of a [`ConditionSpec`] is evaluated.
///
/// The first three are asked in this order when the node is not running, `While` on every tick.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum When {
    /// True: the node fails without being ticked.
    FailureIf,
    /// True: the node succeeds without being ticked.
    SuccessIf,
    /// True: the node is skipped.
    SkipIf,
    /// False: the node is halted if it runs, and skipped.
    While,
    /// Runs after the node succeeded.
    OnSuccess,
    /// Runs after the node failed.
    OnFailure,
    /// Runs after the node was halted while it ran.
    OnHalted,
    /// Runs after the node succeeded or failed, after the two above.
    Post,
}

impl When {
    /// Every moment, in the order of evaluation.
    pub const ALL: [Self; 8] = [
        Self::FailureIf,
        Self::SuccessIf,
        Self::SkipIf,
        Self::While,
        Self::OnSuccess,
        Self::OnFailure,
        Self::OnHalted,
        Self::Post,
    ];

    /// The name in files: `skip_if`.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::FailureIf => "failure_if",
            Self::SuccessIf => "success_if",
            Self::SkipIf => "skip_if",
            Self::While => "while",
            Self::OnSuccess => "on_success",
            Self::OnFailure => "on_failure",
            Self::OnHalted => "on_halted",
            Self::Post => "post",
        }
    }
}

/// What one port is given.
#[derive(Clone, Debug)]
pub struct PortSetting {
    /// The port.
    pub name: String,
    /// Its value.
    pub value: PortValue,
    /// Where the name was written; comes back in [`crate::BuildError`] when the port is unknown.
    pub name_location: u32,
    /// Where the value was written; comes back in [`crate::BuildError`] otherwise.
    pub location: u32,
}

/// The value of a port.
#[derive(Clone, Debug, PartialEq)]
pub enum PortValue {
    /// A constant.
    Literal(Literal),
    /// A blackboard entry, or with dots a field of one: `functionality.target`. `@` before it means the root scope.
    Key(String),
}

impl PortValue {
    /// `"{key}"` is a key, everything else a text.
    ///
    /// # Errors
    /// When the text looks like a key and is none: blanks around the braces, or letters a key cannot have.
    pub fn from_text(text: &str) -> Result<Self, String> {
        let trimmed = text.trim();
        let Some(key) = trimmed.strip_prefix('{').and_then(|rest| rest.strip_suffix('}')) else {
            return Ok(Self::Literal(Literal::Text(text.to_owned())));
        };
        if trimmed.len() != text.len() {
            return Err(format!("blanks around the key {trimmed:?}; write it without them"));
        }
        let is_word = |word: &str| {
            word.starts_with(|first: char| first.is_ascii_alphabetic() || first == '_')
                && word.chars().all(|letter| letter.is_ascii_alphanumeric() || letter == '_')
        };
        if key.strip_prefix('@').unwrap_or(key).split('.').all(is_word) {
            Ok(Self::Key(key.to_owned()))
        } else {
            Err(format!("{text:?} is no blackboard key; a key has letters, digits and underscores, and dots before fields"))
        }
    }
}

impl NodeSpec {
    /// A node of a built-in or registered kind.
    pub fn new(kind: impl Into<String>) -> Self {
        Self { kind: NodeKind::Named(kind.into()), ..Self::default() }
    }

    /// A use of a subtree.
    pub fn subtree(name: impl Into<String>) -> Self {
        Self { kind: NodeKind::Subtree(name.into()), ..Self::default() }
    }

    /// Gives a port a constant.
    #[must_use]
    pub fn with(self, port: impl Into<String>, value: impl Into<Literal>) -> Self {
        self.port(port, PortValue::Literal(value.into()))
    }

    /// Points a port to a blackboard key.
    #[must_use]
    pub fn with_key(self, port: impl Into<String>, key: impl Into<String>) -> Self {
        self.port(port, PortValue::Key(key.into()))
    }

    fn port(mut self, name: impl Into<String>, value: PortValue) -> Self {
        self.ports.push(PortSetting { name: name.into(), value, name_location: self.location, location: self.location });
        self
    }

    /// Adds a child.
    #[must_use]
    pub fn child(mut self, child: NodeSpec) -> Self {
        self.children.push(child);
        self
    }

    /// Adds children.
    #[must_use]
    pub fn children(mut self, children: impl IntoIterator<Item = NodeSpec>) -> Self {
        self.children.extend(children);
        self
    }

    /// Adds a pre-condition or post-condition.
    #[must_use]
    pub fn when(mut self, when: When, script: impl Into<String>) -> Self {
        self.conditions.push(ConditionSpec { when, script: script.into(), location: self.location });
        self
    }

    /// Gives the node a name of its own.
    #[must_use]
    pub fn title(mut self, title: impl Into<String>) -> Self {
        self.title = Some(title.into());
        self
    }
}

#[cfg(test)]
mod tests {
    use super::PortValue;

    #[test]
    fn braces_make_a_key() {
        assert_eq!(PortValue::from_text("{functionality.target}"), Ok(PortValue::Key("functionality.target".to_owned())));
        assert_eq!(PortValue::from_text("a {b} c"), Ok(PortValue::Literal("a {b} c".into())));
    }

    // BehaviorTree.CPP issue 605: a pointer with trailing blanks silently becomes a text.
    #[test]
    fn a_key_with_blanks_around_is_refused() {
        assert!(PortValue::from_text("{key}  ").is_err());
        assert!(PortValue::from_text("{two words}").is_err());
        assert!(PortValue::from_text("{}").is_err());
        assert!(PortValue::from_text("{a..b}").is_err());
    }
}

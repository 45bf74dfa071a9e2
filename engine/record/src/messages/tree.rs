//! The behaviour tree: what it is, what its nodes did and wrote.

use schemars::JsonSchema;
use serde::Serialize;
use serde_json::Value;
use sfg_tree::{Direction, PortBinding, Tree};

/// `/tree/definition`: the nodes, depth first. At the start and after each reload.
#[derive(Clone, Debug, Default, PartialEq, Serialize, JsonSchema)]
pub struct TreeDefinition {
    /// A parent comes before its children.
    pub nodes: Vec<NodeHeader>,
}

/// One node.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct NodeHeader {
    /// The way from the root; unique.
    pub path: String,
    /// Parent, place in `nodes`.
    pub parent: Option<usize>,
    /// Kind: `sequence`, `lift`, `subtree`.
    pub kind: String,
    /// Its own name, or that of its subtree, or its kind.
    pub name: String,
    /// What its kind does.
    pub doc: String,
    /// Its ports.
    pub ports: Vec<PortHeader>,
}

/// One port of a node.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct PortHeader {
    /// Name.
    pub name: String,
    /// `input`, `output`, `inout`, or `setting` for one that a file gives a value.
    pub direction: String,
    /// `{key}` of a blackboard entry or a value as JSON; empty when there is neither.
    pub value: String,
}

impl TreeDefinition {
    /// The definition of `tree`.
    #[must_use]
    pub fn of<C>(tree: &Tree<C>) -> Self {
        let names = tree.names();
        let node = |node: sfg_tree::NodeDefinition| NodeHeader {
            path: names.path(node.id).to_owned(),
            parent: node.parent.map(|parent| parent as usize),
            kind: node.kind,
            name: node.title,
            doc: tree.doc(node.id).to_owned(),
            ports: tree.ports(node.id).iter().map(port).collect(),
        };
        Self { nodes: depth_first(tree.definition().map(node).collect()) }
    }
}

fn port(port: &sfg_tree::BoundPort) -> PortHeader {
    let (direction, value) = match (&port.value, port.spec.direction()) {
        (PortBinding::Literal(literal), Direction::In) => ("setting", crate::json_of(literal).to_string()),
        (PortBinding::Literal(literal), _) => ("inout", crate::json_of(literal).to_string()),
        (PortBinding::Nothing, Direction::In) => ("setting", String::new()),
        (PortBinding::Key(key), Direction::In) => ("input", format!("{{{key}}}")),
        (PortBinding::Key(key), Direction::InOut) => ("inout", format!("{{{key}}}")),
        (PortBinding::Key(key), Direction::Out) => ("output", format!("{{{key}}}")),
        (PortBinding::Nothing, Direction::Out | Direction::InOut) => ("output", String::new()),
    };
    PortHeader { name: port.spec.name().to_owned(), direction: direction.to_owned(), value }
}

/// The tree numbers children in a row; files have each child's own children right after it.
fn depth_first(nodes: Vec<NodeHeader>) -> Vec<NodeHeader> {
    let mut children = vec![Vec::new(); nodes.len()];
    let mut open = Vec::new();
    for (idx, node) in nodes.iter().enumerate() {
        match node.parent {
            Some(parent) => children[parent].push(idx),
            None => open.push((idx, None)),
        }
    }
    open.reverse();
    let mut nodes: Vec<Option<NodeHeader>> = nodes.into_iter().map(Some).collect();
    let mut sorted = Vec::with_capacity(nodes.len());
    while let Some((idx, parent)) = open.pop() {
        let place = sorted.len();
        open.extend(children[idx].iter().rev().map(|child| (*child, Some(place))));
        sorted.extend(nodes[idx].take().map(|node| NodeHeader { parent, ..node }));
    }
    sorted
}

/// `/tree`: a status change of one node.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct Transition {
    /// Time on the driver's clock.
    pub stamp_secs: f64,
    /// Tick in which it happened.
    pub tick: u64,
    /// Path of the node.
    pub node: String,
    /// Status before: `idle`, `running`, `success`, `failure`.
    pub from: String,
    /// Status after; `skipped` as well.
    pub to: String,
    /// Why the node failed by itself.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
    /// The same in a sentence.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub detail: Option<String>,
}

/// `/blackboard`: a node wrote an entry.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct Write {
    /// Time on the driver's clock.
    pub stamp_secs: f64,
    /// Tick in which it happened; 0 before the first.
    pub tick: u64,
    /// Path of the node; empty for the application.
    pub node: String,
    /// The entry; keys of subtrees begin with the path of the subtree.
    pub key: String,
    /// What was written; null when it was removed or has no JSON form.
    pub value: Value,
}

/// `/journal`: one tick of the tree, for `sfg replay`.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct JournalTick {
    /// Number of the tick, from 1.
    pub tick: u64,
    /// Time handed to it.
    pub now_secs: f64,
    /// The owner halted the tree instead of ticking it.
    #[serde(skip_serializing_if = "is_false")]
    pub halt: bool,
    /// Written by the application before the first tick.
    #[serde(skip_serializing_if = "is_false")]
    pub before: bool,
    /// `["status", path, from, to]`, `["failed", path, reason, detail]`, `["wrote", path, key, value]`, `["forced", path, status]` with reason and
    /// detail of a failure, or `["postponed", path, secs]`; the path of the
    /// application is empty.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub changes: Vec<Value>,
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde's form")]
fn is_false(flag: &bool) -> bool {
    !flag
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nodes_are_put_in_document_order() {
        let node = |name: &str, parent| NodeHeader {
            path: name.to_owned(),
            parent,
            kind: String::new(),
            name: name.to_owned(),
            doc: String::new(),
            ports: Vec::new(),
        };
        let by_level = vec![node("a", None), node("b", Some(0)), node("c", Some(0)), node("d", Some(1)), node("e", Some(2))];
        let sorted = depth_first(by_level);
        let found: Vec<_> = sorted.iter().map(|node| (node.name.as_str(), node.parent)).collect();
        assert_eq!(found, [("a", None), ("b", Some(0)), ("d", Some(1)), ("c", Some(0)), ("e", Some(3))]);
    }
}

//! What the nodes of a tested tree are called.

use crate::mistake::Place;
use crate::reader::Reader;
use sfg_tree::{Mocks, NodeClass, NodeId, NodeKind, NodeModel, NodeSpec, Registry, Tree, TreeSpec, nearest};
use std::collections::BTreeSet;

/// One node and its names, the more exact first.
#[derive(Clone, Debug)]
pub(super) struct Named {
    pub(super) id: NodeId,
    pub(super) path: String,
    pub(super) title: String,
    pub(super) kind: String,
    pub(super) class: NodeClass,
    /// A leaf of the application: its results can be given, and its ends are seen.
    pub(super) is_mocked: bool,
}

impl Named {
    pub(super) fn names(&self) -> [&str; 3] {
        [&self.path, &self.title, &self.kind]
    }

    pub(super) fn is_called(&self, name: &str) -> bool {
        self.names().contains(&name)
    }
}

/// Every node of a tree, and the words that are known beside them.
#[derive(Clone, Debug)]
pub(super) struct Names {
    pub(super) nodes: Vec<Named>,
    /// Keys of the root's blackboard.
    pub(super) keys: Vec<String>,
    /// Names that mean something in this scenario or to the application, but no node of the tree.
    unused: BTreeSet<String>,
}

impl Names {
    pub(super) fn of(tree: &Tree<Mocks>, spec: &TreeSpec, models: &[NodeModel]) -> Self {
        let built_in: BTreeSet<String> =
            Registry::<()>::new().models().iter().map(|model| model.name.clone().into_owned()).collect();
        let names = tree.names();
        let node = |node: sfg_tree::NodeDefinition| {
            let is_leaf = matches!(node.class, NodeClass::Action | NodeClass::Step | NodeClass::Condition);
            let is_mocked = is_leaf && !built_in.contains(&node.kind);
            let path = names.path(node.id).to_owned();
            Named { id: node.id, path, title: node.title, kind: node.kind, class: node.class, is_mocked }
        };
        let nodes = tree.definition().map(node).collect();
        // Keys of subtrees begin with the path of the subtree and a colon.
        let keys = (0..).map_while(|slot| tree.slot_key(slot)).filter(|key| !key.contains(':')).map(str::to_owned).collect();
        let mut unused: BTreeSet<String> = models.iter().map(|model| model.name.clone().into_owned()).collect();
        spec.subtrees.iter().for_each(|subtree| collect(&subtree.root, &mut unused));
        Self { nodes, keys, unused }
    }

    /// The leaves called `name`; reports when there are none.
    pub(super) fn leaves(&self, reader: &mut Reader, name: &str, place: Place) -> Vec<&Named> {
        let called: Vec<&Named> = self.nodes.iter().filter(|node| node.is_called(name)).collect();
        let leaves: Vec<&Named> = called.iter().copied().filter(|node| node.is_mocked).collect();
        if !leaves.is_empty() {
            return leaves;
        }
        if let Some(node) = called.first() {
            let message = if node.kind == name {
                format!("{name:?} always does the same and cannot be given results")
            } else {
                format!("{name:?} is of the kind {:?}, which always does the same and cannot be given results", node.kind)
            };
            reader.report_with_help(place, message, format!("leaves of the tree are {}", self.leaf_titles().join(", ")));
        } else if self.unused.contains(name) {
            let help = format!("leaves of the tree are {}", self.leaf_titles().join(", "));
            reader.report_with_help(place, format!("{name:?} can never run: it is not in the tree"), help);
        } else {
            let help = self.meant(name, |node| node.is_mocked);
            let help = help.unwrap_or_else(|| format!("leaves of the tree are {}", self.leaf_titles().join(", ")));
            reader.report_with_help(place, format!("the tree has no leaf {name:?}"), help);
        }
        Vec::new()
    }

    /// Reports when no node is called `name`.
    pub(super) fn check_node(&self, reader: &mut Reader, name: &str, place: Place) {
        if !self.nodes.iter().any(|node| node.is_called(name)) {
            let help = self.meant(name, |_| true).unwrap_or_else(|| "a path begins at the root: \"sequence/lift\"".to_owned());
            reader.report_with_help(place, format!("the tree has no node {name:?}"), help);
        }
    }

    /// Reports when the tree does not use `key`.
    pub(super) fn check_key(&self, reader: &mut Reader, key: &str, place: Place) {
        if !self.keys.iter().any(|known| known == key) {
            let help = match nearest(key, self.keys.iter().map(String::as_str)) {
                Some(near) => format!("did you mean {near:?}?"),
                None if self.keys.is_empty() => "it uses none".to_owned(),
                None => format!("it uses {}", self.keys.join(", ")),
            };
            reader.report_with_help(place, format!("the tree does not use blackboard key {key:?}"), help);
        }
    }

    fn leaf_titles(&self) -> Vec<&str> {
        let mut seen = BTreeSet::new();
        self.nodes
            .iter()
            .filter(|node| node.is_mocked)
            .map(|node| node.title.as_str())
            .filter(|title| seen.insert(*title))
            .collect()
    }

    fn meant(&self, name: &str, is_meant: impl Fn(&Named) -> bool) -> Option<String> {
        let nodes = || self.nodes.iter().filter(|node| is_meant(node));
        // The end of a path is what people remember.
        let longer = nodes().find(|node| node.path.strip_suffix(name).is_some_and(|rest| rest.ends_with('/')));
        let near = longer.map(|node| node.path.as_str()).or_else(|| nearest(name, nodes().flat_map(Named::names)));
        near.map(|near| format!("did you mean {near:?}?"))
    }
}

/// Titles and kinds of a subtree that may be used nowhere.
fn collect(node: &NodeSpec, names: &mut BTreeSet<String>) {
    names.extend(node.title.clone());
    if let NodeKind::Named(name) = &node.kind {
        names.insert(name.clone());
    }
    node.children.iter().for_each(|child| collect(child, names));
}

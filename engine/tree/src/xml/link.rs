//! The trees of all files together: which is the root, and what the models of subtrees add.

use super::file::Importer;
use super::problem::XmlFault;
use super::value::{self, Kind};
use super::{XmlModel, XmlPort};
use crate::nearest::nearest;
use crate::registry::NodeClass;
use crate::spec::{NodeKind, NodeSpec, PortSetting, PortValue, SubtreePort, TreeSpec};
use std::collections::{BTreeMap, BTreeSet};

impl Importer<'_> {
    /// The tree, unless something is wrong with it.
    pub(super) fn finish(&mut self) -> Option<TreeSpec> {
        let names: Vec<String> = self.trees.iter().map(|tree| tree.name.clone()).collect();
        let help = |name: &str| match nearest(name, names.iter().map(String::as_str)) {
            Some(near) => format!("did you mean {near:?}?"),
            None => format!("the trees are {}", names.iter().take(10).map(String::as_str).collect::<Vec<_>>().join(", ")),
        };
        let uses = std::mem::take(&mut self.uses);
        for (name, location) in &uses {
            if !self.tree_names.contains(name) && !self.is_full() {
                self.problem(*location, name, XmlFault::UnknownTree, help(name));
            }
        }
        self.connect_modelled_ports();
        let main = self.options.main_tree.clone().map(|name| (name, 0)).or(self.main.take());
        let main_idx = match &main {
            Some((name, location)) => {
                let found = self.trees.iter().position(|tree| tree.name == *name);
                if found.is_none() {
                    self.problem(*location, name, XmlFault::UnknownTree, help(name));
                }
                found?
            }
            None if self.trees.len() == 1 => 0,
            // What kept the trees from being read is known already.
            None if self.trees.is_empty() && self.has_problems() => return None,
            None => {
                let names: Vec<&str> = names.iter().take(10).map(String::as_str).collect();
                let help = format!("name one of {}, or write main_tree_to_execute=\"...\" into <root>", names.join(", "));
                self.problem(0, "root", XmlFault::NoMainTree, help);
                return None;
            }
        };
        let mut subtrees = std::mem::take(&mut self.trees);
        let root = if uses.iter().any(|(name, _)| *name == subtrees[main_idx].name) {
            subtrees[main_idx].root.clone()
        } else {
            subtrees.remove(main_idx).root
        };
        Some(TreeSpec { root, subtrees, entries: Vec::new(), allows_unwritten_keys: true, has_untyped_texts: true })
    }

    /// Gives subtrees the ports of their models, and their users what the models say beyond constants.
    fn connect_modelled_ports(&mut self) {
        let mut models: BTreeMap<String, XmlModel> = BTreeMap::new();
        for model in self.models.iter().filter(|model| model.class == NodeClass::Subtree) {
            models.entry(model.name.clone()).or_insert_with(|| model.clone());
        }
        if models.is_empty() {
            return;
        }
        let mut trees = std::mem::take(&mut self.trees);
        for tree in &mut trees {
            if let Some(model) = models.get(&tree.name) {
                tree.ports = model.ports.iter().map(|port| port.subtree_port()).collect();
            }
            self.connect(&mut tree.root, &models);
        }
        self.trees = trees;
    }

    fn connect(&mut self, node: &mut NodeSpec, models: &BTreeMap<String, XmlModel>) {
        for child in &mut node.children {
            self.connect(child, models);
        }
        let NodeKind::Subtree(name) = &node.kind else { return };
        let Some(model) = models.get(name) else { return };
        let given: BTreeSet<&str> = node.ports.iter().map(|setting| setting.name.as_str()).collect();
        let mut added = Vec::new();
        for port in model.ports.iter().filter(|port| !given.contains(port.name.as_str())) {
            let text = port.default.as_deref().unwrap_or_default();
            let value = match value::read(Kind::Subtree, &port.name, text) {
                // Autoremapping wins over the default there; a port without default is autoremapped here, too.
                _ if node.is_autoremapped && text.is_empty() => continue,
                _ if node.is_autoremapped => PortValue::Key(port.name.clone()),
                _ if text.is_empty() => {
                    let fault = XmlFault::MissingPort { port: port.name.clone() };
                    self.problem(node.location, name, fault, format!("write {0}=\"{{{0}}}\"", port.name));
                    continue;
                }
                Ok(value @ PortValue::Key(_)) => value,
                _ => continue,
            };
            let location = node.location;
            added.push(PortSetting { name: port.name.clone(), value, name_location: location, location });
        }
        node.ports.extend(added);
    }
}

impl XmlPort {
    fn subtree_port(&self) -> SubtreePort {
        let default = match self.default.as_deref().filter(|text| !text.is_empty()) {
            Some(text) => value::read(Kind::Subtree, &self.name, text).ok(),
            None => None,
        };
        let default = default.and_then(|value| if let PortValue::Literal(literal) = value { Some(literal) } else { None });
        SubtreePort { name: self.name.clone(), direction: self.direction, default, location: self.location }
    }
}

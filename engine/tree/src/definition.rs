//! What is bound to the ports of a node, for viewers.

use crate::blackboard::{Source, to_form};
use crate::literal::Literal;
use crate::port::PortSpec;
use crate::status::Status;
use crate::tree::{NodeId, Tree};

/// A port of one node and what it is bound to.
#[derive(Clone, Debug)]
pub struct BoundPort {
    /// The port as its kind declares it.
    pub spec: PortSpec,
    /// What stands for it in this tree.
    pub value: PortBinding,
}

/// What stands for a port in a tree.
#[derive(Clone, Debug, PartialEq)]
pub enum PortBinding {
    /// Nothing was given to an optional port, or what was given has no literal form.
    Nothing,
    /// A blackboard entry; keys of subtrees begin with the path of the subtree.
    Key(String),
    /// A value from the file, or the default.
    Literal(Literal),
}

impl<C> Tree<C> {
    /// The ports of a node in the order of its kind; none for a node that is not in the tree.
    #[must_use]
    pub fn ports(&self, node: NodeId) -> Vec<BoundPort> {
        let Some(shape) = self.nodes.get(node as usize) else { return Vec::new() };
        let Some(model) = self.models.get(shape.model as usize) else { return Vec::new() };
        let bound = |(port_idx, spec): (usize, &PortSpec)| {
            let source = self.sources.get(shape.first_source as usize + port_idx)?;
            Some(BoundPort { spec: spec.clone(), value: self.binding(source, spec) })
        };
        model.ports.iter().enumerate().filter_map(bound).collect()
    }

    /// What the node's kind does, in one sentence; empty for a subtree.
    #[must_use]
    pub fn doc(&self, node: NodeId) -> &str {
        let model = self.nodes.get(node as usize).and_then(|node| self.models.get(node.model as usize));
        model.map_or("", |model| &*model.doc)
    }

    fn binding(&self, source: &Source, spec: &PortSpec) -> PortBinding {
        if let Some(slot) = source.slot() {
            return self.slot_key(slot).map_or(PortBinding::Nothing, |key| PortBinding::Key(key.to_owned()));
        }
        let Source::Literal(value) = source else { return PortBinding::Nothing };
        if let Some(status) = value.downcast_ref::<Status>() {
            return PortBinding::Literal(Literal::Text(status.name().to_owned()));
        }
        to_form(value, Some(&spec.port_type), &self.run.forms).map_or(PortBinding::Nothing, PortBinding::Literal)
    }
}

#[cfg(test)]
mod tests {
    #![expect(clippy::unwrap_used, reason = "tests fail by panicking")]
    use super::*;
    use crate::{NodeSpec, Registry, TreeSpec};

    #[test]
    fn ports_tell_keys_and_values() {
        let mut registry = Registry::<()>::new();
        let ports = [PortSpec::output::<f64>("width_m").doc("how wide"), PortSpec::setting::<f64>("secs").default_value(0.5)];
        registry.step("measure", ports, |_tick| Ok(())).doc("Measures.");
        let tree = registry.build(&TreeSpec { root: NodeSpec::new("measure"), ..TreeSpec::default() }).unwrap();
        let ports = tree.ports(0);
        assert_eq!(tree.doc(0), "Measures.");
        assert_eq!(ports[0].spec.doc_text(), "how wide");
        assert_eq!(ports[0].value, PortBinding::Key("width_m".to_owned()));
        assert_eq!(ports[1].value, PortBinding::Literal(Literal::Float(0.5)));
        assert!(tree.ports(7).is_empty() && tree.doc(7).is_empty());
    }
}

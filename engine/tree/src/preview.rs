//! What a tree would do, without doing it.

use crate::registry::{Footprint, NodeClass};
use crate::tree::{Kind, NodeId, Tree};

/// An action or step of a tree.
#[derive(Clone, Debug, PartialEq)]
pub struct PreviewStep {
    /// Its number.
    pub node: NodeId,
    /// The way to it from the root.
    pub path: String,
    /// Its kind.
    pub kind: String,
    /// Whether it may take several ticks.
    pub class: NodeClass,
    /// What it occupies while it runs.
    pub footprint: Footprint,
    /// How long it usually takes, seconds.
    pub expected_secs: Option<f64>,
}

/// Two actions in branches of a parallel node that occupy the same part: the second one would wait for the first.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Conflict {
    /// Path of the parallel node.
    pub parallel: String,
    /// Path of the action in the earlier branch.
    pub first: String,
    /// Path of the action in the later branch.
    pub second: String,
    /// What both occupy.
    pub part: String,
}

/// What a tree would do.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Preview {
    /// Actions, steps and conditions of the application in document order.
    pub steps: Vec<PreviewStep>,
    /// Clashes of parallel branches.
    pub conflicts: Vec<Conflict>,
}

impl<C> Tree<C> {
    /// Walks the tree without ticking it.
    #[must_use]
    pub fn preview(&self) -> Preview {
        let mut preview = Preview::default();
        for (node, id) in self.nodes.iter().zip(0..) {
            match node.kind {
                Kind::Leaf => preview.steps.push(self.step(id)),
                Kind::Parallel | Kind::ParallelAll => self.conflicts_of(id, &mut preview.conflicts),
                _ => {}
            }
        }
        preview
    }

    fn step(&self, id: NodeId) -> PreviewStep {
        let model = &self.models[self.nodes[id as usize].model as usize];
        PreviewStep {
            node: id,
            path: self.path(id),
            kind: model.name.to_string(),
            class: model.class,
            footprint: model.footprint.clone(),
            expected_secs: model.expected_secs,
        }
    }

    fn conflicts_of(&self, id: NodeId, conflicts: &mut Vec<Conflict>) {
        let n_children = self.nodes[id as usize].n_children;
        let branches: Vec<Vec<(NodeId, &str)>> =
            (0..n_children).map(|child_idx| self.parts_below(self.child(id, child_idx))).collect();
        for (second_idx, second) in branches.iter().enumerate() {
            for first in branches[..second_idx].iter().flatten() {
                for (node, part) in second {
                    if first.1 == *part {
                        conflicts.push(Conflict {
                            parallel: self.path(id),
                            first: self.path(first.0),
                            second: self.path(*node),
                            part: (*part).to_owned(),
                        });
                    }
                }
            }
        }
    }

    /// Actions below a node and what they occupy.
    fn parts_below(&self, id: NodeId) -> Vec<(NodeId, &str)> {
        let node = &self.nodes[id as usize];
        if node.kind == Kind::Leaf {
            let model = &self.models[node.model as usize];
            return match &model.footprint {
                Footprint::Parts(parts) if model.class == NodeClass::Action => parts.iter().map(|part| (id, &**part)).collect(),
                _ => Vec::new(),
            };
        }
        (0..node.n_children).flat_map(|child_idx| self.parts_below(self.child(id, child_idx))).collect()
    }
}

//! Changing a tree while it runs: edit its [`TreeSpec`], then [`Tree::reload`] it between two ticks.

use crate::problem::BuildError;
use crate::registry::Registry;
use crate::spec::{NodeKind, NodeSpec, TreeSpec};
use crate::status::Status;
use crate::tree::{Kind, NONE, NodeId, Tree};
use std::collections::HashMap;
use thiserror::Error;

/// Why a tree was not changed. It runs on as it was.
#[derive(Clone, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum EditError {
    /// The new tree has mistakes.
    #[error("the new tree has mistakes, {} in all; the first: {}", .0.len(), .0[0])]
    Build(Vec<BuildError>),
    /// Nodes that run now, or still stop, are not in the new tree.
    #[error("running nodes would vanish: {}; halt them first", .paths.join(", "))]
    RunningNodesVanish {
        /// Their paths in the running tree.
        paths: Vec<String>,
    },
    /// No node has this path.
    #[error("no node has the path {path:?}")]
    UnknownPath {
        /// As given.
        path: String,
    },
    /// The root cannot be removed, only replaced.
    #[error("the root of a tree cannot be removed, only replaced")]
    Root,
}

/// What a reload changed.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Reloaded {
    /// Paths of nodes that are new.
    pub added: Vec<String>,
    /// Paths of nodes that are gone.
    pub removed: Vec<String>,
}

impl TreeSpec {
    /// The node at a path such as `sequence/retry/lift`. Of siblings with the same name the second is `lift#2`. A path begins
    /// at the root, or with the name of a subtree and a colon: `grasp:sequence/lift`.
    pub fn node_mut(&mut self, path: &str) -> Option<&mut NodeSpec> {
        let (mut node, steps) = match path.split_once(':') {
            Some((subtree, steps)) => (&mut self.subtrees.iter_mut().find(|tree| tree.name == subtree)?.root, steps),
            None => (&mut self.root, path),
        };
        let mut steps = steps.split('/');
        if steps.next()? != title(node) {
            return None;
        }
        for step in steps {
            let child_idx = child_at(node, step)?;
            node = &mut node.children[child_idx];
        }
        Some(node)
    }

    /// Puts a node below the one at `parent`, before its child number `child_idx` (from 0) or at the end.
    ///
    /// # Errors
    /// [`EditError::UnknownPath`].
    pub fn insert(&mut self, parent: &str, child_idx: usize, node: NodeSpec) -> Result<(), EditError> {
        let parent = self.node_mut(parent).ok_or_else(|| EditError::UnknownPath { path: parent.to_owned() })?;
        parent.children.insert(child_idx.min(parent.children.len()), node);
        Ok(())
    }

    /// Takes out the node at a path with all below it.
    ///
    /// # Errors
    /// [`EditError::UnknownPath`], [`EditError::Root`].
    pub fn remove(&mut self, path: &str) -> Result<NodeSpec, EditError> {
        let (parent, step) = path.rsplit_once('/').ok_or(EditError::Root)?;
        let unknown = || EditError::UnknownPath { path: path.to_owned() };
        let parent = self.node_mut(parent).ok_or_else(unknown)?;
        let child_idx = child_at(parent, step).ok_or_else(unknown)?;
        Ok(parent.children.remove(child_idx))
    }

    /// Puts another node in the place of the one at a path; gives the old one.
    ///
    /// # Errors
    /// [`EditError::UnknownPath`].
    pub fn replace(&mut self, path: &str, node: NodeSpec) -> Result<NodeSpec, EditError> {
        let old = self.node_mut(path).ok_or_else(|| EditError::UnknownPath { path: path.to_owned() })?;
        Ok(std::mem::replace(old, node))
    }
}

fn title(node: &NodeSpec) -> &str {
    node.title.as_deref().unwrap_or(match &node.kind {
        NodeKind::Named(name) | NodeKind::Subtree(name) => name,
    })
}

/// The child that a step of a path names.
fn child_at(node: &NodeSpec, step: &str) -> Option<usize> {
    let (name, nth) = match step.rsplit_once('#') {
        Some((name, nth)) if nth.parse::<usize>().is_ok_and(|nth| nth >= 1) => (name, nth.parse::<usize>().ok()?),
        _ => (step, 1),
    };
    (0..node.children.len()).filter(|child_idx| title(&node.children[*child_idx]) == name).nth(nth - 1)
}

impl<C> Tree<C> {
    /// The path of each node, made unique: of siblings with the same name the second is `lift#2`.
    pub(crate) fn unique_paths(&self) -> Vec<String> {
        let mut paths: Vec<String> = Vec::with_capacity(self.nodes.len());
        let mut n_same: HashMap<(NodeId, &str), u32> = HashMap::new();
        for (node, id) in self.nodes.iter().zip(0..) {
            let title = self.title(id);
            let nth = n_same.entry((node.parent, title)).or_default();
            *nth += 1;
            let step = if *nth == 1 { title.to_owned() } else { format!("{title}#{nth}") };
            paths.push(if node.parent == NONE { step } else { format!("{}/{step}", paths[node.parent as usize]) });
        }
        paths
    }

    /// Goes on with the tree of `spec`, between two ticks.
    ///
    /// Nodes with the same path and kind keep their state, so what runs runs on, with the ports that `spec` gives. Blackboard
    /// entries with the same key and type keep their values. Times that began to run (of a `timeout`, of a `delay`) stay.
    ///
    /// # Errors
    /// [`EditError::Build`] when `spec` has mistakes, [`EditError::RunningNodesVanish`] when it lacks a running node. The tree
    /// is as it was then.
    pub fn reload(&mut self, registry: &Registry<C>, spec: &TreeSpec) -> Result<Reloaded, EditError> {
        let mut new = registry.build(spec).map_err(EditError::Build)?;
        let (old_paths, new_paths) = (self.unique_paths(), new.unique_paths());
        let ids: HashMap<&str, NodeId> = new_paths.iter().map(String::as_str).zip(0..).collect();
        let new_id = |old: NodeId| {
            let id = *ids.get(old_paths[old as usize].as_str())?;
            (self.kind_name(old) == new.kind_name(id) && self.nodes[old as usize].kind == new.nodes[id as usize].kind)
                .then_some(id)
        };
        let moved: Vec<Option<NodeId>> = (0..).zip(&self.nodes).map(|(old, _)| new_id(old)).collect();
        let is_active = |old: usize| {
            self.nodes[old].status == Status::Running || self.run.stopping.iter().any(|stopping| stopping.node as usize == old)
        };
        let vanishing = |old: &usize| moved[*old].is_none() && is_active(*old);
        let paths: Vec<String> = (0..moved.len()).filter(vanishing).map(|old| old_paths[old].clone()).collect();
        if !paths.is_empty() {
            return Err(EditError::RunningNodesVanish { paths });
        }
        let mut is_kept = vec![false; new_paths.len()];
        for (old, id) in moved.iter().enumerate() {
            let Some(id) = *id else { continue };
            is_kept[id as usize] = true;
            let cursor = self.moved_cursor(old, &moved, &new, id);
            let from = &self.nodes[old];
            let to = &mut new.nodes[id as usize];
            (to.status, to.flags, to.cursor) = (from.status, from.flags, cursor);
            (to.count, to.n_failed, to.deadline_secs, to.seen) = (from.count, from.n_failed, from.deadline_secs, from.seen);
            if from.kind == Kind::Leaf {
                std::mem::swap(&mut new.leaves[to.leaf as usize].kind, &mut self.leaves[from.leaf as usize].kind);
            }
        }
        let slots: HashMap<&str, usize> = new.slot_keys.iter().map(String::as_str).zip(0..).collect();
        for (old, key) in self.slot_keys.iter().enumerate() {
            if let Some(&slot) = slots.get(key.as_str())
                && type_of(&self.slot_types[old]) == type_of(&new.slot_types[slot])
                && self.run.board.slots[old].sequence > 0
            {
                new.run.board.slots[slot] = self.run.board.slots[old].clone();
            }
        }
        new.run.board.n_writes = self.run.board.n_writes;
        let move_id = |id: NodeId| moved[id as usize];
        self.kept = std::mem::take(&mut self.kept).into_iter().filter_map(|(id, at)| Some((move_id(id)?, at))).collect();
        let run = &mut self.run;
        run.active = run.active.iter().filter_map(|id| move_id(*id)).collect();
        for stopping in &mut run.stopping {
            stopping.node = move_id(stopping.node).unwrap_or(stopping.node);
        }
        run.intervention = std::mem::take(&mut run.intervention).moved(move_id);
        run.history.retain_mut(|at| move_id(at.node).map(|id| at.node = id).is_some());
        run.failure = run.failure.take().and_then(|at| Some(crate::FailureAt { node: move_id(at.node)?, ..at }));
        run.board = std::mem::take(&mut new.run.board);
        let kept = std::mem::take(&mut self.kept);
        new.run = std::mem::take(&mut self.run);
        new.kept = kept;
        let removed = (0..moved.len()).filter(|old| moved[*old].is_none()).map(|old| old_paths[old].clone()).collect();
        let added = (0..is_kept.len()).filter(|id| !is_kept[*id]).map(|id| new_paths[id].clone()).collect();
        *self = new;
        Ok(Reloaded { added, removed })
    }

    /// The cursor of a node in the new tree: it goes with the child that it points to.
    fn moved_cursor(&self, old: usize, moved: &[Option<NodeId>], new: &Self, id: NodeId) -> u32 {
        let node = &self.nodes[old];
        let points_to_child = !matches!(
            node.kind,
            Kind::Loop | Kind::Precondition | Kind::RateLimit | Kind::SkipUnlessUpdated | Kind::WaitValueUpdate
        );
        if !points_to_child || node.cursor == NONE || node.n_children == 0 {
            return node.cursor;
        }
        let children = |tree: &Self, id: usize| -> Vec<NodeId> {
            let node = &tree.nodes[id];
            tree.children[node.first_child as usize..][..node.n_children as usize].to_vec()
        };
        let (olds, news) = (children(self, old), children(new, id as usize));
        // The first child from the cursor on that is still there; what is new before it counts as done.
        let next = olds[node.cursor.min(node.n_children) as usize..].iter().find_map(|child| moved[*child as usize]);
        let position = match next {
            Some(child) => news.iter().position(|new_child| *new_child == child),
            None => None,
        };
        position.and_then(|at| u32::try_from(at).ok()).unwrap_or(new.nodes[id as usize].n_children.min(node.cursor))
    }
}

fn type_of(port_type: &Option<crate::PortType>) -> Option<std::any::TypeId> {
    port_type.as_ref().map(|port_type| port_type.id)
}

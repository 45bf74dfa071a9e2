//! Saving a tree that runs, and going on with it in another process.

use crate::action::Tick;
use crate::blackboard::{self, Slot};
use crate::leaf::{LeafKind, WAITING};
use crate::literal::{FromLiteral as _, Literal};
use crate::status::{Failure, Progress, Status};
use crate::tree::{FailureAt, Kind, NONE, Node, NodeId, Tree};
use std::collections::HashMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use thiserror::Error;

/// Version of [`TreeState::to_literal`].
const VERSION: i64 = 1;

/// Where a tree stands between two ticks: what [`Tree::save`] gives and [`Tree::resume`] takes.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TreeState {
    /// Number of the last tick.
    pub tick_idx: u64,
    /// Its time, seconds.
    pub now_secs: f64,
    /// Nodes that are not as in a new tree.
    pub nodes: Vec<NodeState>,
    /// Blackboard entries that were written.
    pub entries: Vec<EntryState>,
}

/// One node of a [`TreeState`].
#[derive(Clone, Debug, PartialEq)]
pub struct NodeState {
    /// Its way from the root; of siblings with the same name the second is `lift#2`.
    pub path: String,
    /// Its kind.
    pub kind: String,
    /// Its status.
    pub status: Status,
    /// `cursor`, `count`, `n_failed`, `flags` of the node.
    pub memory: [u32; 4],
    /// When its time is over or began.
    pub deadline_secs: f64,
    /// Number of the write that it last saw.
    pub seen: u64,
    /// What its action saved; nothing when the action cannot go on elsewhere.
    pub action: Option<Literal>,
    /// The failure that it comes back to.
    pub kept: Option<Failure>,
}

/// One blackboard entry of a [`TreeState`].
#[derive(Clone, Debug, PartialEq)]
pub struct EntryState {
    /// Its key; entries of subtrees begin with the path of the subtree.
    pub key: String,
    /// Its value; nothing when its type has no literal form.
    pub value: Option<Literal>,
    /// Name of its type.
    pub type_name: String,
    /// Number of its last write.
    pub sequence: u64,
    /// Time of its last write.
    pub stamp_secs: f64,
}

/// Why a tree cannot go on from a [`TreeState`]. Nothing was started or changed.
#[derive(Clone, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum ResumeError {
    /// A running action cannot go on in another process.
    #[error("{path} was running and cannot be resumed: {kind:?} saves nothing")]
    Action {
        /// Its path.
        path: String,
        /// Its kind.
        kind: String,
    },
    /// A node of the state is not in the tree.
    #[error("{path} ({kind}) was saved and is not in the tree")]
    Node {
        /// Its path.
        path: String,
        /// Its kind.
        kind: String,
    },
    /// What a node remembers points beyond its children: the state was damaged.
    #[error("{path}: its saved memory does not fit its children")]
    Memory {
        /// Its path.
        path: String,
    },
    /// An entry that a later node reads could not be saved.
    #[error("blackboard key {key:?} is lost: a value of type {type_name} cannot be saved, and {reader} reads it")]
    Lost {
        /// The key.
        key: String,
        /// Type of its value.
        type_name: String,
        /// Path of a node that reads it.
        reader: String,
    },
    /// A saved value does not fit.
    #[error("blackboard key {key:?}: {message}")]
    Value {
        /// The key.
        key: String,
        /// Expected and found.
        message: String,
    },
}

impl<C> Tree<C> {
    /// Where the tree stands. To be called between two ticks.
    #[must_use]
    pub fn save(&self) -> TreeState {
        let paths = self.unique_paths();
        let is_new = |id: usize| {
            let node = &self.nodes[id];
            node.status == Status::Idle && (node.cursor, node.count, node.n_failed, node.flags, node.seen) == (0, 0, 0, 0, 0)
        };
        let nodes = (0..self.nodes.len()).filter(|id| !is_new(*id)).map(|id| self.node_state(id, &paths)).collect();
        let written = (0..self.slot_keys.len()).filter(|slot| self.run.board.slots[*slot].value.is_some());
        let entries = written
            .map(|slot| {
                let Slot { value, sequence, stamp_secs } = &self.run.board.slots[slot];
                let port_type = self.slot_types[slot].as_ref();
                EntryState {
                    key: self.slot_keys[slot].clone(),
                    value: value.as_ref().and_then(|value| blackboard::to_form(value, port_type, &self.run.forms)),
                    type_name: port_type.map_or("any", |port_type| port_type.name()).to_owned(),
                    sequence: *sequence,
                    stamp_secs: *stamp_secs,
                }
            })
            .collect();
        TreeState { tick_idx: self.run.tick_idx, now_secs: self.run.now_secs, nodes, entries }
    }

    fn node_state(&self, id: usize, paths: &[String]) -> NodeState {
        let node = &self.nodes[id];
        let runs = node.kind == Kind::Leaf && node.status == Status::Running && node.flags & WAITING == 0;
        let action = match self.leaves.get(node.leaf as usize).filter(|_| runs).map(|leaf| &leaf.kind) {
            Some(LeafKind::Action(action)) => action.save(),
            _ => None,
        };
        #[expect(clippy::cast_possible_truncation, reason = "numbers of nodes fit")]
        let kept = self.kept.get(&(id as NodeId)).map(|at| at.failure.clone());
        #[expect(clippy::cast_possible_truncation, reason = "numbers of nodes fit")]
        let kind = self.kind_name(id as NodeId).to_owned();
        NodeState {
            path: paths[id].clone(),
            kind,
            status: node.status,
            memory: [node.cursor, node.count, node.n_failed, u32::from(node.flags)],
            deadline_secs: node.deadline_secs,
            seen: node.seen,
            action,
            kept,
        }
    }

    /// What would keep the tree, new and not yet ticked, from going on from `state`.
    #[must_use]
    pub fn check_resume(&self, state: &TreeState) -> Vec<ResumeError> {
        let paths = self.unique_paths();
        let ids: HashMap<&str, NodeId> = paths.iter().map(String::as_str).zip(0..).collect();
        let slots: HashMap<&str, usize> = self.slot_keys.iter().map(String::as_str).zip(0..).collect();
        let mut errors = Vec::new();
        for node in &state.nodes {
            let (path, kind) = (node.path.clone(), node.kind.clone());
            match ids.get(node.path.as_str()).filter(|id| self.kind_name(**id) == node.kind) {
                None => errors.push(ResumeError::Node { path, kind }),
                Some(&id) => {
                    let node_now = &self.nodes[id as usize];
                    if !fits(node_now, node) {
                        errors.push(ResumeError::Memory { path: path.clone() });
                    }
                    let is_action = self
                        .leaves
                        .get(node_now.leaf as usize)
                        .is_some_and(|leaf| node_now.kind == Kind::Leaf && matches!(leaf.kind, LeafKind::Action(_)));
                    let was_running = node.status == Status::Running && node.memory[3] & u32::from(WAITING) == 0;
                    if is_action && was_running && node.action.is_none() {
                        errors.push(ResumeError::Action { path, kind });
                    }
                }
            }
        }
        for entry in &state.entries {
            let Some(&slot) = slots.get(entry.key.as_str()) else { continue };
            match &entry.value {
                Some(value) => {
                    if let Err(message) = self.value_of_literal(slot, value) {
                        errors.push(ResumeError::Value { key: entry.key.clone(), message });
                    }
                }
                None => {
                    if let Some(reader) = self.later_reader(slot, state, &ids) {
                        let (key, type_name) = (entry.key.clone(), entry.type_name.clone());
                        errors.push(ResumeError::Lost { key, type_name, reader: paths[reader].clone() });
                    }
                }
            }
        }
        errors
    }

    /// A node that reads the slot, is not done, and before which no other node that is not done writes it.
    fn later_reader(&self, slot: usize, state: &TreeState, ids: &HashMap<&str, NodeId>) -> Option<usize> {
        let is_done = |id: usize| {
            let done = |node: &&NodeState| matches!(node.status, Status::Success | Status::Failure);
            state.nodes.iter().filter(done).any(|node| {
                let mut up = id;
                loop {
                    if ids.get(node.path.as_str()) == u32::try_from(up).ok().as_ref() {
                        return true;
                    }
                    match self.nodes[up].parent {
                        NONE => return false,
                        parent => up = parent as usize,
                    }
                }
            })
        };
        for (id, node) in self.nodes.iter().enumerate() {
            if node.model == NONE || is_done(id) {
                continue;
            }
            let ports = &self.models[node.model as usize].ports;
            for (port_idx, port) in ports.iter().enumerate() {
                if self.sources[node.first_source as usize + port_idx].slot().is_some_and(|of| of as usize == slot) {
                    if port.direction.reads() && port.required {
                        return Some(id);
                    }
                    if port.direction.writes() {
                        return None;
                    }
                }
            }
        }
        None
    }

    /// The value of a literal for an entry.
    pub(crate) fn value_of_literal(&self, slot: usize, literal: &Literal) -> Result<crate::port::Value, String> {
        blackboard::from_literal(literal, self.slot_types[slot].as_ref(), &self.run.forms)
    }

    /// Goes on where `state` was saved: in a tree that was built from the same spec and not yet ticked. Running actions are
    /// called with [`crate::Action::resume`].
    ///
    /// # Errors
    /// Everything that [`Tree::check_resume`] finds; the tree is as it was then.
    pub fn resume(&mut self, state: &TreeState, context: &mut C) -> Result<(), Vec<ResumeError>> {
        let errors = self.check_resume(state);
        if !errors.is_empty() {
            return Err(errors);
        }
        let paths = self.unique_paths();
        let ids: HashMap<&str, NodeId> = paths.iter().map(String::as_str).zip(0..).collect();
        let slots: HashMap<&str, usize> = self.slot_keys.iter().map(String::as_str).zip(0..).collect();
        (self.run.tick_idx, self.run.now_secs) = (state.tick_idx, state.now_secs);
        for entry in &state.entries {
            let (Some(&slot), Some(value)) = (slots.get(entry.key.as_str()), &entry.value) else { continue };
            let Ok(value) = self.value_of_literal(slot, value) else { continue };
            let (sequence, stamp_secs) = (entry.sequence, entry.stamp_secs);
            self.run.board.slots[slot] = Slot { value: Some(value), sequence, stamp_secs };
            self.run.board.n_writes = self.run.board.n_writes.max(sequence);
        }
        for saved in &state.nodes {
            let Some(&id) = ids.get(saved.path.as_str()) else { continue };
            let node = &mut self.nodes[id as usize];
            node.status = saved.status;
            [node.cursor, node.count, node.n_failed] = [saved.memory[0], saved.memory[1], saved.memory[2]];
            node.flags = u8::try_from(saved.memory[3]).unwrap_or(0);
            (node.deadline_secs, node.seen) = (saved.deadline_secs, saved.seen);
            if let Some(failure) = saved.kept.clone() {
                let (tick_idx, now_secs) = (state.tick_idx, state.now_secs);
                self.kept.insert(id, FailureAt { node: id, tick_idx, now_secs, failure });
            }
        }
        for saved in state.nodes.iter().filter(|saved| saved.action.is_some()) {
            let (Some(&id), Some(action)) = (ids.get(saved.path.as_str()), &saved.action) else { continue };
            self.resume_leaf(id, action, context);
        }
        Ok(())
    }

    fn resume_leaf(&mut self, id: NodeId, state: &Literal, context: &mut C) {
        let node = &self.nodes[id as usize];
        let ports = &self.models[node.model as usize].ports;
        let sources = &self.sources[node.first_source as usize..][..ports.len()];
        let mut tick = Tick { context, node: id, ports, sources, slot_types: &self.slot_types, run: &mut self.run };
        let LeafKind::Action(action) = &mut self.leaves[node.leaf as usize].kind else { return };
        let resumed = catch_unwind(AssertUnwindSafe(|| action.resume(state, &mut tick)));
        // What it says other than Running is found by the next tick: it starts anew, or its parent goes on.
        let status = match resumed {
            Ok(Ok(Progress::Running)) => Status::Running,
            Ok(Ok(Progress::Success)) => Status::Success,
            Ok(Ok(Progress::Skipped)) | Err(_) => Status::Idle,
            Ok(Err(failure)) => {
                self.run.note_failure(id, failure);
                Status::Idle
            }
        };
        self.set_status(id, status);
    }
}

/// Whether the child that a saved node stands at exists.
fn fits(node: &Node, saved: &NodeState) -> bool {
    let cursor = saved.memory[0];
    match node.kind {
        Kind::ReactiveSequence | Kind::ReactiveFallback | Kind::Switch => cursor == NONE || cursor < node.n_children,
        Kind::IfThenElse | Kind::TryCatch | Kind::Recover => saved.status != Status::Running || cursor < node.n_children,
        _ => true,
    }
}

fn map(pairs: Vec<(&str, Literal)>) -> Literal {
    Literal::Map(pairs.into_iter().map(|(key, value)| (key.to_owned(), value)).collect())
}

fn whole(number: u64) -> Literal {
    Literal::Int(i64::try_from(number).unwrap_or(i64::MAX))
}

/// Reads the fields of a map.
struct Reader<'a>(&'a [(String, Literal)]);

impl<'a> Reader<'a> {
    fn new(literal: &'a Literal) -> Result<Self, String> {
        match literal {
            Literal::Map(items) => Ok(Self(items)),
            _ => Err(format!("expected a map, found {literal}")),
        }
    }
    fn find(&self, key: &str) -> Option<&'a Literal> {
        self.0.iter().find(|(name, _)| name == key).map(|(_, value)| value)
    }
    fn get(&self, key: &str) -> Result<&'a Literal, String> {
        self.find(key).ok_or_else(|| format!("{key:?} is missing"))
    }
    fn whole(&self, key: &str) -> Result<u64, String> {
        u64::from_literal(self.get(key)?).map_err(|error| format!("{key:?}: {error}"))
    }
    fn number(&self, key: &str) -> Result<f64, String> {
        f64::from_literal(self.get(key)?).map_err(|error| format!("{key:?}: {error}"))
    }
    fn text(&self, key: &str) -> Result<String, String> {
        String::from_literal(self.get(key)?).map_err(|error| format!("{key:?}: {error}"))
    }
    fn list(&self, key: &str) -> Result<&'a [Literal], String> {
        match self.get(key)? {
            Literal::List(items) => Ok(items),
            other => Err(format!("{key:?}: expected a list, found {other}")),
        }
    }
}

impl TreeState {
    /// The state as maps, lists, numbers and texts, for a file.
    #[must_use]
    pub fn to_literal(&self) -> Literal {
        let node = |node: &NodeState| {
            let mut pairs = vec![
                ("path", Literal::Text(node.path.clone())),
                ("kind", Literal::Text(node.kind.clone())),
                ("status", Literal::Text(node.status.name().to_owned())),
                ("memory", Literal::List(node.memory.iter().map(|number| Literal::Int(i64::from(*number))).collect())),
                ("deadline_secs", Literal::Float(if node.deadline_secs.is_finite() { node.deadline_secs } else { 1e300 })),
                ("seen", Literal::Text(node.seen.to_string())),
            ];
            pairs.extend(node.action.clone().map(|action| ("action", action)));
            if let Some(failure) = &node.kept {
                pairs.push(("kept", Literal::List(vec![failure.reason.to_string().into(), failure.detail.clone().into()])));
            }
            map(pairs)
        };
        let entry = |entry: &EntryState| {
            let mut pairs = vec![
                ("key", Literal::Text(entry.key.clone())),
                ("type", Literal::Text(entry.type_name.clone())),
                ("sequence", whole(entry.sequence)),
                ("stamp_secs", Literal::Float(entry.stamp_secs)),
            ];
            pairs.extend(entry.value.clone().map(|value| ("value", value)));
            map(pairs)
        };
        map(vec![
            ("version", Literal::Int(VERSION)),
            ("tick", whole(self.tick_idx)),
            ("now_secs", Literal::Float(self.now_secs)),
            ("nodes", Literal::List(self.nodes.iter().map(node).collect())),
            ("entries", Literal::List(self.entries.iter().map(entry).collect())),
        ])
    }

    /// The state that [`to_literal`](Self::to_literal) wrote.
    ///
    /// # Errors
    /// What was expected and found.
    pub fn from_literal(literal: &Literal) -> Result<Self, String> {
        let reader = Reader::new(literal)?;
        match reader.whole("version")? {
            1 => {}
            other => return Err(format!("version {other} of a saved tree is not known; this program writes {VERSION}")),
        }
        let node = |literal: &Literal| {
            let reader = Reader::new(literal)?;
            let name = reader.text("status")?;
            let all = [Status::Idle, Status::Running, Status::Success, Status::Failure];
            let status = all.into_iter().find(|status| status.name() == name).ok_or(format!("{name:?} is no status"))?;
            let kept = match reader.find("kept") {
                Some(kept) => {
                    let [reason, detail] = <[String; 2]>::from_literal(kept)?;
                    Some(Failure::new(reason, detail))
                }
                None => None,
            };
            Ok::<_, String>(NodeState {
                path: reader.text("path")?,
                kind: reader.text("kind")?,
                status,
                memory: <[u32; 4]>::from_literal(reader.get("memory")?)?,
                deadline_secs: reader.number("deadline_secs")?,
                seen: reader.text("seen")?.parse().map_err(|_error| "\"seen\": expected a whole number".to_owned())?,
                action: reader.find("action").cloned(),
                kept,
            })
        };
        let entry = |literal: &Literal| {
            let reader = Reader::new(literal)?;
            Ok::<_, String>(EntryState {
                key: reader.text("key")?,
                value: reader.find("value").cloned(),
                type_name: reader.text("type")?,
                sequence: reader.whole("sequence")?,
                stamp_secs: reader.number("stamp_secs")?,
            })
        };
        Ok(Self {
            tick_idx: reader.whole("tick")?,
            now_secs: reader.number("now_secs")?,
            nodes: reader.list("nodes")?.iter().map(node).collect::<Result<_, _>>()?,
            entries: reader.list("entries")?.iter().map(entry).collect::<Result<_, _>>()?,
        })
    }
}

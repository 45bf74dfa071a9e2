//! What the ports of a tree mean to each other: one type a key, no key read before it is written, fields that exist.

use crate::blackboard::{Accessor, Slot, Source};
use crate::literal::{Literal, Shape};
use crate::nearest::nearest;
use crate::port::{PortSpec, PortType, Value};
use crate::problem::{BuildError, Problem};
use crate::tree::{NodeId, Tree};
use std::any::TypeId;
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::sync::Arc;

/// A port that points to a key.
pub(crate) struct Use<'a> {
    pub(crate) slot: u32,
    pub(crate) port: &'a PortSpec,
    /// What messages call the port.
    pub(crate) label: &'a str,
    pub(crate) fields: Vec<String>,
    pub(crate) node: NodeId,
    pub(crate) location: u32,
    pub(crate) key: Cow<'a, str>,
    pub(crate) source_idx: usize,
}

/// What is known about a slot before its users are looked at.
#[derive(Default)]
struct Draft<'a> {
    provided: Option<PortType>,
    initial: Option<(&'a Literal, u32, &'a str)>,
    is_assumed: bool,
}

/// Slots and their users in document order.
#[derive(Default)]
pub(crate) struct Board<'a> {
    drafts: Vec<Draft<'a>>,
    pub(crate) uses: Vec<Use<'a>>,
    pub(crate) n_kept_nodes: Option<usize>,
    /// Whether a key may be read that nothing writes.
    pub(crate) allows_unwritten: bool,
    /// Whether texts of the file may stand for numbers.
    pub(crate) has_untyped_texts: bool,
}

/// Who settled the type of a slot.
struct Settled {
    port_type: PortType,
    by: Option<(NodeId, bool)>,
}

impl<'a> Board<'a> {
    #[expect(clippy::cast_possible_truncation, reason = "bounded by the number of nodes times their ports")]
    pub(crate) fn add_slot(&mut self) -> u32 {
        self.drafts.push(Draft::default());
        (self.drafts.len() - 1) as u32
    }

    /// The application sets the entry.
    pub(crate) fn provide(&mut self, slot: u32, port_type: PortType) {
        self.drafts[slot as usize].provided = Some(port_type);
    }

    /// The entry begins with a literal.
    pub(crate) fn start_with(&mut self, slot: u32, literal: &'a Literal, location: u32, key: &'a str) {
        self.drafts[slot as usize].initial = Some((literal, location, key));
    }

    /// Somebody will set the entry.
    pub(crate) fn assume(&mut self, slot: u32) {
        self.drafts[slot as usize].is_assumed = true;
    }

    /// Every mistake; fills the slots of `tree` and the fields of its sources.
    pub(crate) fn check<C>(
        &self,
        tree: &mut Tree<C>,
        fields: &BTreeMap<(TypeId, String), (PortType, Accessor)>,
    ) -> Vec<BuildError> {
        let mut errors = Vec::new();
        let settled = self.settle();
        self.check_dangling(tree, &mut errors);
        for one in &self.uses {
            let Some(settled) = &settled[one.slot as usize] else {
                // Of a key that nothing writes enough has been said.
                if let Some(field) = one.fields.first()
                    && self.uses.iter().any(|other| other.slot == one.slot && other.port.direction.writes())
                {
                    let (port, type_name) = (one.label.to_owned(), "a value of unknown type".to_owned());
                    errors.push(error_at(tree, one, Problem::UnknownField { port, type_name, field: field.clone() }, None));
                }
                continue;
            };
            let problem = if one.fields.is_empty() {
                type_clash(tree, one, settled)
            } else {
                match resolve_fields(one, settled, fields) {
                    Ok(accessors) => {
                        tree.sources[one.source_idx] = Source::Field(Box::new((one.slot, accessors)));
                        None
                    }
                    Err(finding) => Some(*finding),
                }
            };
            if let Some((problem, help)) = problem {
                errors.push(error_at(tree, one, problem, help));
            }
        }
        for (slot, draft) in self.drafts.iter().enumerate() {
            let value = match draft.initial {
                Some((literal, location, key)) => match self.initial(slot, literal) {
                    Ok(value) => Some(value),
                    Err(message) => {
                        let problem = Problem::BadLiteral { port: key.to_owned(), message };
                        let path = tree.slot_keys[slot].clone();
                        errors.push(BuildError { location, path, problem, help: None });
                        None
                    }
                },
                None => None,
            };
            tree.run.board.slots.push(Slot { value, ..Slot::default() });
        }
        tree.slot_types = settled.into_iter().map(|settled| settled.map(|settled| settled.port_type)).collect();
        errors
    }

    /// The type of each slot: what the application provides, else the first writer's, else the first reader's.
    fn settle(&self) -> Vec<Option<Settled>> {
        let mut settled: Vec<Option<Settled>> =
            self.drafts.iter().map(|draft| draft.provided.clone().map(|port_type| Settled { port_type, by: None })).collect();
        for wants_writer in [true, false] {
            for one in &self.uses {
                let place = &mut settled[one.slot as usize];
                let is_any = one.port.port_type.is_any();
                if place.is_none() && !is_any && one.fields.is_empty() && (one.port.direction.writes() || !wants_writer) {
                    *place = Some(Settled { port_type: one.port.port_type.clone(), by: Some((one.node, wants_writer)) });
                }
            }
        }
        settled
    }

    fn check_dangling<C>(&self, tree: &Tree<C>, errors: &mut Vec<BuildError>) {
        let mut is_written: Vec<bool> =
            self.drafts.iter().map(|draft| draft.is_assumed || draft.provided.is_some() || draft.initial.is_some()).collect();
        for (use_idx, one) in self.uses.iter().enumerate() {
            let slot = one.slot as usize;
            if one.port.direction.reads() && one.port.required && !is_written[slot] && !self.allows_unwritten {
                let later = self.uses[use_idx..].iter().find(|other| other.slot == one.slot && other.port.direction.writes());
                let help = match later {
                    Some(later) if later.node != one.node => Some(format!("it is written later, by {}", tree.path(later.node))),
                    _ => help_for_unwritten(tree, one, &is_written),
                };
                let problem = Problem::DanglingKey { port: one.label.to_owned(), key: one.key.to_string() };
                errors.push(error_at(tree, one, problem, help));
            }
            is_written[slot] |= one.port.direction.writes();
        }
    }

    /// The value of an entry that begins with a literal: converted as its first user that takes literals wants it.
    fn initial(&self, slot: usize, literal: &Literal) -> Result<Value, String> {
        let users = || self.uses.iter().filter(|one| one.slot as usize == slot && one.fields.is_empty());
        let typed = || users().filter(|one| !one.port.port_type.is_any());
        match typed().find(|one| one.port.port_type.convert.is_some()).or_else(|| typed().next()) {
            Some(one) => match literal {
                Literal::Text(text) if self.has_untyped_texts => one.port.value_of_text(text),
                // A constant that looks like a number may be meant for a text.
                Literal::Int(_) | Literal::Float(_) if self.has_untyped_texts => {
                    one.port.value_of(literal).or_else(|_number| one.port.value_of_text(&literal.to_string()))
                }
                _ => one.port.value_of(literal),
            },
            None => Ok(Arc::new(match literal {
                Literal::Text(text) if self.has_untyped_texts => Literal::from_text(text, &Shape::Any),
                _ => literal.clone(),
            })),
        }
    }
}

/// A key of the same scope with nearly this name, or the way to a key outside a subtree.
fn help_for_unwritten<C>(tree: &Tree<C>, one: &Use<'_>, is_written: &[bool]) -> Option<String> {
    let split = |slot: usize| tree.slot_keys[slot].rsplit_once(':').unwrap_or(("", &tree.slot_keys[slot]));
    let (scope, key) = split(one.slot as usize);
    let written = || (0..is_written.len()).filter(|slot| is_written[*slot]).map(split);
    if let Some(near) = nearest(key, written().filter(|(other, _)| *other == scope).map(|(_, name)| name)) {
        return Some(format!("did you mean \"{{{near}}}\"?"));
    }
    let is_outside = !scope.is_empty() && written().any(|(_, name)| name == key);
    is_outside.then(|| format!("a subtree has its own keys; declare {key:?} under its `in`"))
}

type Finding = (Problem, Option<String>);

fn type_clash<C>(tree: &Tree<C>, one: &Use<'_>, settled: &Settled) -> Option<Finding> {
    if one.port.port_type.is_any() || one.port.port_type.id == settled.port_type.id {
        return None;
    }
    let (other, other_does) = match settled.by {
        None => ("the application".to_owned(), "provides"),
        Some((node, writes)) => (tree.path(node), if writes { "writes" } else { "reads" }),
    };
    let (port, key, found) = (one.label.to_owned(), one.key.to_string(), one.port.port_type.name.clone());
    Some((Problem::TypeClash { port, key, found, expected: settled.port_type.name.clone(), other, other_does }, None))
}

fn resolve_fields(
    one: &Use<'_>,
    settled: &Settled,
    fields: &BTreeMap<(TypeId, String), (PortType, Accessor)>,
) -> Result<Vec<Accessor>, Box<Finding>> {
    let (mut port_type, mut accessors) = (settled.port_type.clone(), Vec::new());
    for field in &one.fields {
        let Some((next, accessor)) = fields.get(&(port_type.id, field.clone())) else {
            let known: Vec<&str> =
                fields.keys().filter(|(owner, _)| *owner == port_type.id).map(|(_, name)| name.as_str()).collect();
            let help = match nearest(field, known.iter().copied()) {
                Some(near) => format!("did you mean {near:?}?"),
                None if known.is_empty() => "it has no fields".to_owned(),
                None => format!("its fields are {}", known.join(", ")),
            };
            let (port, type_name) = (one.label.to_owned(), port_type.name);
            return Err(Box::new((Problem::UnknownField { port, type_name, field: field.clone() }, Some(help))));
        };
        accessors.push(Arc::clone(accessor));
        port_type = next.clone();
    }
    if one.port.port_type.is_any() || port_type.id == one.port.port_type.id {
        return Ok(accessors);
    }
    let (port, key, found) = (one.label.to_owned(), one.key.to_string(), one.port.port_type.name.clone());
    let (other, other_does) = ("the field".to_owned(), "provides");
    Err(Box::new((Problem::TypeClash { port, key, found, expected: port_type.name, other, other_does }, None)))
}

fn error_at<C>(tree: &Tree<C>, one: &Use<'_>, problem: Problem, help: Option<String>) -> BuildError {
    BuildError { location: one.location, path: tree.path(one.node), problem, help }
}

//! Blackboard entries as Groot2 reads them: one map per subtree.

use super::scopes::Scopes;
use super::{literal_of, msgpack};
use crate::blackboard::Form;
use crate::literal::Literal;
use crate::port::{PortType, Value};
use crate::tree::Tree;
use std::any::TypeId;
use std::collections::{BTreeSet, HashMap};
use std::sync::Arc;

/// Longer answers have names of types in place of further values.
const MAX_BYTES: usize = 8 * 1024 * 1024;

/// What is known about the entries of a tree until it is reloaded.
#[derive(Default)]
pub(super) struct Board {
    scopes: Scopes,
    types: Vec<Option<PortType>>,
    forms: Arc<HashMap<TypeId, Form>>,
}

impl Board {
    pub(super) fn new<C>(tree: &Tree<C>, scopes: Scopes) -> Self {
        Self { scopes, types: tree.slot_types.clone(), forms: Arc::clone(&tree.run.forms) }
    }

    /// The entries of subtrees, named with semicolons between, as a MessagePack map of maps. Names that no subtree has and
    /// entries without a value are left out; a value without a literal form is the name of its type.
    pub(super) fn dump(&self, names: &str, values: &[Option<Value>]) -> Vec<u8> {
        let names: BTreeSet<&str> = names.split(';').collect();
        let scopes: Vec<_> = self.scopes.list.iter().filter(|scope| names.contains(scope.name.as_str())).collect();
        let mut out = Vec::new();
        msgpack::write_map_length(&mut out, scopes.len());
        for scope in scopes {
            msgpack::write_text(&mut out, &scope.name);
            let entries: Vec<(u32, &str, &Value)> = scope
                .keys
                .iter()
                .filter_map(|(slot, key)| Some((*slot, key.as_str(), values.get(*slot as usize)?.as_ref()?)))
                .collect();
            msgpack::write_map_length(&mut out, entries.len());
            for (slot, key, value) in entries {
                msgpack::write_text(&mut out, key);
                match self.literal(slot, value) {
                    Some(literal) if out.len() < MAX_BYTES => msgpack::write_literal(&mut out, &literal),
                    _ => msgpack::write_text(&mut out, self.type_name(slot)),
                }
            }
        }
        out
    }

    fn literal(&self, slot: u32, value: &Value) -> Option<Literal> {
        literal_of(value, self.types.get(slot as usize)?.as_ref(), &self.forms)
    }

    fn type_name(&self, slot: u32) -> &str {
        self.types.get(slot as usize).and_then(Option::as_ref).map_or("any", PortType::name)
    }
}

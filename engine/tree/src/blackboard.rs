//! Values shared between nodes, in numbered slots. Names exist only while a tree is built.

use crate::literal::{FromLiteral as _, Literal};
use crate::port::{PortType, Value};
use crate::script::{Scalar, scalar_of};
use crate::status::{Failure, reason};
use std::any::{Any, TypeId};
use std::collections::HashMap;
use std::sync::Arc;

/// One shared value.
#[derive(Clone, Default)]
pub(crate) struct Slot {
    pub(crate) value: Option<Value>,
    /// Number of the last write, from 1 over the whole blackboard; 0 when there was none.
    pub(crate) sequence: u64,
    /// Time of the tick in which it was written.
    pub(crate) stamp_secs: f64,
}

/// When a blackboard entry was last written.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Stamp {
    /// Number of the write, from 1 over the whole blackboard; 0 when there was none.
    pub sequence: u64,
    /// Time of the tick in which it was written, seconds.
    pub stamp_secs: f64,
}

/// Gets a field out of a value.
pub(crate) type Accessor = Arc<dyn Fn(&(dyn Any + Send + Sync)) -> Result<Value, Failure> + Send + Sync>;

/// Where a port's value is, resolved when the tree is built.
#[derive(Clone)]
pub(crate) enum Source {
    /// Nothing was given to an optional port.
    Unset,
    Literal(Value),
    Slot(u32),
    Field(Box<(u32, Vec<Accessor>)>),
}

impl Source {
    /// The slot behind a port, if any.
    pub(crate) fn slot(&self) -> Option<u32> {
        match self {
            Self::Unset | Self::Literal(_) => None,
            Self::Slot(slot) => Some(*slot),
            Self::Field(field) => Some(field.0),
        }
    }

    /// The value, or nothing when nobody has written it yet.
    pub(crate) fn read(&self, slots: &[Slot]) -> Result<Option<Value>, Failure> {
        match self {
            Self::Unset => Ok(None),
            Self::Literal(value) => Ok(Some(Arc::clone(value))),
            Self::Slot(slot) => Ok(slots[*slot as usize].value.clone()),
            Self::Field(field) => {
                let Some(mut value) = slots[field.0 as usize].value.clone() else { return Ok(None) };
                for accessor in &field.1 {
                    value = accessor(&*value)?;
                }
                Ok(Some(value))
            }
        }
    }
}

/// The slots and how often they were written.
#[derive(Clone, Default)]
pub(crate) struct Blackboard {
    pub(crate) slots: Vec<Slot>,
    pub(crate) n_writes: u64,
}

impl Blackboard {
    /// Puts `value` into a slot, in place where nobody else holds the old one.
    pub(crate) fn write<T: Any + Send + Sync>(&mut self, slot: u32, value: T, now_secs: f64) {
        let slot = self.stamped(slot, now_secs);
        if let Some(old) = &mut slot.value
            && let Some(place) = Arc::get_mut(old).and_then(|any| any.downcast_mut::<T>())
        {
            *place = value;
        } else {
            slot.value = Some(Arc::new(value));
        }
    }

    /// Puts a value that others hold too into a slot, or empties it.
    pub(crate) fn put(&mut self, slot: u32, value: Option<Value>, now_secs: f64) {
        self.stamped(slot, now_secs).value = value;
    }

    fn stamped(&mut self, slot: u32, now_secs: f64) -> &mut Slot {
        self.n_writes += 1;
        let slot = &mut self.slots[slot as usize];
        slot.sequence = self.n_writes;
        slot.stamp_secs = now_secs;
        slot
    }

    pub(crate) fn stamp(&self, slot: u32) -> Stamp {
        let slot = &self.slots[slot as usize];
        Stamp { sequence: slot.sequence, stamp_secs: slot.stamp_secs }
    }
}

/// The value of a script as an entry of the type holds it.
pub(crate) fn to_entry(scalar: Scalar<'_>, old: Option<&Value>, port_type: Option<&PortType>) -> Result<Value, String> {
    // The frequent types, without a detour.
    let id = port_type.map_or_else(|| old.map_or(TypeId::of::<Literal>(), |old| (**old).type_id()), |port_type| port_type.id);
    match &scalar {
        Scalar::Number(value) if id == TypeId::of::<f64>() => return Ok(Arc::new(*value)),
        Scalar::Bool(value) if id == TypeId::of::<bool>() => return Ok(Arc::new(*value)),
        _ if id == TypeId::of::<Literal>() => return Ok(Arc::new(scalar.into_literal())),
        _ => {}
    }
    let literal = scalar.into_literal();
    let Some(port_type) = port_type else { return Ok(Arc::new(literal)) };
    match &port_type.convert {
        Some(convert) => convert(&literal),
        None => by_type(&literal, port_type)
            .unwrap_or_else(|| Err(format!("an entry of type {} cannot be written by a script", port_type.name()))),
    }
}

type ToLiteral = Arc<dyn Fn(&(dyn Any + Send + Sync)) -> Option<Literal> + Send + Sync>;
type FromLiteral = Arc<dyn Fn(&Literal) -> Result<Value, String> + Send + Sync>;

/// How values of a type that files cannot give are written down and read back.
#[derive(Clone)]
pub(crate) struct Form {
    pub(crate) to: ToLiteral,
    pub(crate) from: FromLiteral,
    /// Whether a journal writes it down too.
    pub(crate) is_in_journal: bool,
}

/// A value as a literal, where files can give its type.
pub(crate) fn to_literal(value: &Value, port_type: Option<&PortType>) -> Option<Literal> {
    if let Some(scalar) = scalar_of(&**value) {
        return Some(scalar.into_literal());
    }
    if let Some(literal) = value.downcast_ref::<Literal>() {
        return Some(literal.clone());
    }
    port_type?.to_literal.as_ref()?(&**value)
}

/// A value as a literal, where its type has any such form.
pub(crate) fn to_form(value: &Value, port_type: Option<&PortType>, forms: &HashMap<TypeId, Form>) -> Option<Literal> {
    match forms.get(&(**value).type_id()) {
        Some(form) => (form.to)(&**value),
        None => to_literal(value, port_type),
    }
}

/// A value as a literal for a journal.
pub(crate) fn to_journal(value: &Value, port_type: Option<&PortType>, forms: &HashMap<TypeId, Form>) -> Option<Literal> {
    match forms.get(&(**value).type_id()) {
        Some(form) if !form.is_in_journal => None,
        _ => to_form(value, port_type, forms),
    }
}

/// The value that [`to_form`] wrote down, for an entry of the type.
pub(crate) fn from_literal(
    literal: &Literal,
    port_type: Option<&PortType>,
    forms: &HashMap<TypeId, Form>,
) -> Result<Value, String> {
    let Some(port_type) = port_type else { return Ok(Arc::new(literal.clone())) };
    if let Some(form) = forms.get(&port_type.id) {
        return (form.from)(literal);
    }
    match &port_type.convert {
        Some(convert) => convert(literal),
        None if port_type.id == TypeId::of::<Literal>() => Ok(Arc::new(literal.clone())),
        None => by_type(literal, port_type)
            .unwrap_or_else(|| Err(format!("a value of type {} cannot be read back", port_type.name()))),
    }
}

/// The value for an entry whose type is one that files can give, though none of its ports takes literals.
fn by_type(literal: &Literal, port_type: &PortType) -> Option<Result<Value, String>> {
    macro_rules! try_types {
        ($($candidate:ty),*) => { $(
            if port_type.id == TypeId::of::<$candidate>() {
                return Some(<$candidate>::from_literal(literal).map(|value| Arc::new(value) as Value));
            }
        )* };
    }
    try_types!(f64, i64, bool, String, u32, i32, u64, usize, u8);
    None
}

/// The failure of a node that needs a value nobody has written.
pub(crate) fn empty(port: &str) -> Failure {
    Failure::new(reason::PORT_EMPTY, format!("port {port:?} has no value yet"))
}

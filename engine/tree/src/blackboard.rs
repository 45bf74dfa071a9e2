//! Values shared between nodes, in numbered slots. Names exist only while a tree is built.

use crate::port::Value;
use crate::status::{Failure, reason};
use std::any::Any;
use std::sync::Arc;

/// One shared value.
#[derive(Default)]
pub(crate) struct Slot {
    pub(crate) value: Option<Value>,
}

/// Gets a field out of a value.
pub(crate) type Accessor = Arc<dyn Fn(&(dyn Any + Send + Sync)) -> Result<Value, Failure> + Send + Sync>;

/// Where a port's value is, resolved when the tree is built.
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

/// Puts `value` into `slot`, in place where nobody else holds the old one.
pub(crate) fn write<T: Any + Send + Sync>(slot: &mut Slot, value: T) {
    if let Some(old) = &mut slot.value
        && let Some(place) = Arc::get_mut(old).and_then(|any| any.downcast_mut::<T>())
    {
        *place = value;
    } else {
        slot.value = Some(Arc::new(value));
    }
}

/// The failure of a node that needs a value nobody has written.
pub(crate) fn empty(port: &str) -> Failure {
    Failure::new(reason::PORT_EMPTY, format!("port {port:?} has no value yet"))
}

//! What an author of nodes writes against.

use crate::blackboard::{self, Source};
use crate::journal::{Change, JournalLevel};
use crate::port::{PortSpec, Value};
use crate::status::{Failure, Outcome};
use crate::tree::Runtime;
use std::any::{Any, TypeId};
use std::sync::Arc;

/// A leaf that may take several ticks.
///
/// | call | when | then |
/// |---|---|---|
/// | `start` | the node is ticked and is not running | `Running`: polled from the next tick on; else done |
/// | `poll` | the node is ticked and is running | as above |
/// | `halt` | a running node is not wanted any more, or a call panicked | the node is idle, the next call is `start` |
///
/// A call must not wait. A panic becomes a failure with reason [`crate::reason::PANICKED`].
pub trait Action<C>: Send {
    /// Begins the work.
    ///
    /// # Errors
    /// The reason why it cannot be done.
    fn start(&mut self, tick: &mut Tick<'_, C>) -> Outcome;

    /// Goes on with the work. An action whose `start` never returns `Running` has none.
    ///
    /// # Errors
    /// The reason why it was not done.
    ///
    /// # Panics
    /// If an action that returned `Running` does not have it.
    fn poll(&mut self, _tick: &mut Tick<'_, C>) -> Outcome {
        panic!("an action that returns Running must implement poll");
    }

    /// Stops the work and undoes what must not stay: motions stop, threads end.
    fn halt(&mut self, _tick: &mut Tick<'_, C>) {}
}

/// What a node sees while it is called: the user's context, the time and its ports.
pub struct Tick<'a, C> {
    /// The context handed to [`crate::Tree::tick`].
    pub context: &'a mut C,
    pub(crate) node: u32,
    pub(crate) ports: &'a [PortSpec],
    pub(crate) sources: &'a [Source],
    pub(crate) run: &'a mut Runtime,
}

impl<C> Tick<'_, C> {
    /// The time handed to [`crate::Tree::tick`]: simulated or counted, never the wall clock.
    #[must_use]
    pub fn now_secs(&self) -> f64 {
        self.run.now_secs
    }

    /// The number of this tick of the tree, from 1.
    #[must_use]
    pub fn tick_idx(&self) -> u64 {
        self.run.tick_idx
    }

    /// The value at an input port, shared and not copied.
    ///
    /// # Errors
    /// Reason [`crate::reason::PORT_EMPTY`] when nobody has written it yet.
    ///
    /// # Panics
    /// If the node declared no such port of this type to read.
    pub fn input<T: Any + Send + Sync>(&self, port: &str) -> Result<Arc<T>, Failure> {
        self.optional(port)?.ok_or_else(|| blackboard::empty(port))
    }

    /// A copy of the value at an input port; for settings.
    ///
    /// # Errors
    /// Reason [`crate::reason::PORT_EMPTY`] when nobody has written it yet.
    ///
    /// # Panics
    /// If the node declared no such port of this type to read.
    pub fn get<T: Any + Send + Sync + Clone>(&self, port: &str) -> Result<T, Failure> {
        let port_idx = self.declared::<T>(port);
        match &self.sources[port_idx] {
            // The frequent case needs no shared handle.
            Source::Slot(slot) => match &self.run.slots[*slot as usize].value {
                Some(value) => Ok(cast_ref::<T>(value.as_ref(), port).clone()),
                None => Err(blackboard::empty(port)),
            },
            source => match source.read(&self.run.slots)? {
                Some(value) => Ok(cast_ref::<T>(value.as_ref(), port).clone()),
                None => Err(blackboard::empty(port)),
            },
        }
    }

    /// The value at an input port if there is one.
    ///
    /// # Errors
    /// The failure of a field that the value does not have.
    ///
    /// # Panics
    /// If the node declared no such port of this type to read.
    pub fn optional<T: Any + Send + Sync>(&self, port: &str) -> Result<Option<Arc<T>>, Failure> {
        let port_idx = self.declared::<T>(port);
        Ok(self.sources[port_idx].read(&self.run.slots)?.map(|value| cast(value, port)))
    }

    /// Writes an output port. Nothing happens when the scenario connected it to nothing.
    ///
    /// # Panics
    /// If the node declared no such port of this type to write.
    pub fn set<T: Any + Send + Sync>(&mut self, port: &str, value: T) {
        if let Some(slot) = self.writable::<T>(port) {
            blackboard::write(&mut self.run.slots[slot as usize], value);
            self.note_write(slot);
        }
    }

    /// Writes an output port with a value that others hold too.
    ///
    /// # Panics
    /// If the node declared no such port of this type to write.
    pub fn set_shared<T: Any + Send + Sync>(&mut self, port: &str, value: Arc<T>) {
        if let Some(slot) = self.writable::<T>(port) {
            self.run.slots[slot as usize].value = Some(value);
            self.note_write(slot);
        }
    }

    fn note_write(&mut self, slot: u32) {
        if self.run.journal.level == JournalLevel::Writes {
            self.run.note(self.node, Change::Write { slot });
        }
    }

    fn writable<T: Any>(&self, port: &str) -> Option<u32> {
        let port_idx = self.declared::<T>(port);
        assert!(self.ports[port_idx].direction.writes(), "port {port:?} is declared as an input and was written");
        self.sources[port_idx].slot()
    }

    fn declared<T: Any>(&self, port: &str) -> usize {
        let Some(port_idx) = self.ports.iter().position(|spec| spec.name == port) else {
            panic!("port {port:?} is not declared");
        };
        let port_type = &self.ports[port_idx].port_type;
        assert!(
            port_type.id == TypeId::of::<T>(),
            "port {port:?} is declared as {} and was used as {}",
            port_type.name,
            std::any::type_name::<T>()
        );
        port_idx
    }
}

fn cast<T: Any + Send + Sync>(value: Value, port: &str) -> Arc<T> {
    let Ok(value) = value.downcast::<T>() else {
        panic!("port {port:?} holds another type than it was checked for");
    };
    value
}

fn cast_ref<'v, T: Any>(value: &'v (dyn Any + Send + Sync), port: &str) -> &'v T {
    let Some(value) = value.downcast_ref::<T>() else {
        panic!("port {port:?} holds another type than it was checked for");
    };
    value
}

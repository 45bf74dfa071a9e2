//! What an author of nodes writes against.

use crate::blackboard::{self, Source, Stamp};
use crate::journal::JournalLevel;
use crate::literal::Literal;
use crate::port::{PortSpec, PortType, Value};
use crate::status::{Failure, Outcome};
use crate::tree::Runtime;
use crate::waker::Waker;
use std::any::{Any, TypeId};
use std::sync::Arc;

/// A leaf that may take several ticks.
///
/// | call | when | then |
/// |---|---|---|
/// | `start` | the node is ticked and is not running | `Running`: polled from the next tick on; else done |
/// | `poll` | the node is ticked and is running | as above |
/// | `halt` | a running node is not wanted any more, or a call panicked | `Done`: the next call is `start`; `Pending`: called again on every tick until `Done` |
///
/// A call must not wait. While a halt is pending nothing is started that shares the action's footprint. A panic becomes a failure with reason [`crate::reason::PANICKED`].
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

    /// Stops the work and undoes what must not stay: motions stop, threads end. Work that cannot stop at once says
    /// [`Halt::Pending`] and is asked again.
    fn halt(&mut self, _tick: &mut Tick<'_, C>) -> Halt {
        Halt::Done
    }

    /// What the running action needs to go on in another process, or nothing when it cannot.
    fn save(&self) -> Option<Literal> {
        None
    }

    /// Goes on where [`save`](Self::save) was called, in place of `start`.
    ///
    /// # Errors
    /// The reason why it cannot.
    fn resume(&mut self, _state: &Literal, tick: &mut Tick<'_, C>) -> Outcome {
        self.start(tick)
    }
}

/// Whether a halted action has stopped.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Halt {
    /// It has.
    Done,
    /// It will have within this time, counted from the first call. Later, actions that share its footprint fail with reason
    /// [`crate::reason::HALT_OVERDUE`] until it says `Done`.
    Pending {
        /// Time it needs at most, seconds.
        within_secs: f64,
    },
}

/// What a node sees while it is called: the user's context, the time and its ports.
pub struct Tick<'a, C> {
    /// The context handed to [`crate::Tree::tick`].
    pub context: &'a mut C,
    pub(crate) node: u32,
    pub(crate) ports: &'a [PortSpec],
    pub(crate) sources: &'a [Source],
    pub(crate) slot_types: &'a [Option<PortType>],
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
        self.get_at(0, port)
    }

    /// [`get`](Self::get) for derived code, which knows at which number it declared the port.
    #[doc(hidden)]
    pub fn get_at<T: Any + Send + Sync + Clone>(&self, port_idx: usize, port: &str) -> Result<T, Failure> {
        let port_idx = self.declared::<T>(port_idx, port);
        match &self.sources[port_idx] {
            // The frequent cases need no shared handle.
            Source::Literal(value) => Ok(cast_ref::<T>(value.as_ref(), port).clone()),
            Source::Slot(slot) => match &self.run.board.slots[*slot as usize].value {
                Some(value) => Ok(cast_ref::<T>(value.as_ref(), port).clone()),
                None => Err(blackboard::empty(port)),
            },
            source => match source.read(&self.run.board.slots)? {
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
        self.optional_at(0, port)
    }

    /// [`optional`](Self::optional) for derived code, which knows at which number it declared the port.
    #[doc(hidden)]
    pub fn optional_at<T: Any + Send + Sync>(&self, port_idx: usize, port: &str) -> Result<Option<Arc<T>>, Failure> {
        let port_idx = self.declared::<T>(port_idx, port);
        Ok(self.sources[port_idx].read(&self.run.board.slots)?.map(|value| cast(value, port)))
    }

    /// Writes an output port. Nothing happens when the scenario connected it to nothing.
    ///
    /// # Panics
    /// If the node declared no such port of this type to write.
    pub fn set<T: Any + Send + Sync>(&mut self, port: &str, value: T) {
        self.set_at(0, port, value);
    }

    /// [`set`](Self::set) for derived code, which knows at which number it declared the port.
    #[doc(hidden)]
    pub fn set_at<T: Any + Send + Sync>(&mut self, port_idx: usize, port: &str, value: T) {
        if let Some(slot) = self.writable::<T>(port_idx, port) {
            self.run.board.write(slot, value, self.run.now_secs);
            self.note_write(slot);
        }
    }

    /// Writes an output port with a value that others hold too.
    ///
    /// # Panics
    /// If the node declared no such port of this type to write.
    pub fn set_shared<T: Any + Send + Sync>(&mut self, port: &str, value: Arc<T>) {
        if let Some(slot) = self.writable::<T>(0, port) {
            self.run.board.put(slot, Some(value), self.run.now_secs);
            self.note_write(slot);
        }
    }

    /// When the entry behind a port was last written; nothing when the port has a literal or is not connected.
    ///
    /// # Panics
    /// If the node declared no such port.
    #[must_use]
    pub fn stamp(&self, port: &str) -> Option<Stamp> {
        self.sources[self.port_idx(0, port)].slot().map(|slot| self.run.board.stamp(slot))
    }

    /// Wakes the owner of the tree from another thread, so that the next tick comes before its period.
    #[must_use]
    pub fn waker(&self) -> Waker {
        self.run.waker.clone()
    }

    /// Asks for another tick at once.
    pub fn tick_again(&mut self) {
        self.run.wants_tick = true;
    }

    #[inline]
    fn note_write(&mut self, slot: u32) {
        if self.run.journal.level >= JournalLevel::Writes {
            self.run.note_write(self.node, slot, self.slot_types[slot as usize].as_ref());
        }
    }

    /// The number of a port, which is the expected one unless the node declared its ports in another order.
    fn port_idx(&self, expected_idx: usize, port: &str) -> usize {
        if self.ports.get(expected_idx).is_some_and(|spec| spec.name == port) {
            return expected_idx;
        }
        let Some(port_idx) = self.ports.iter().position(|spec| spec.name == port) else {
            panic!("port {port:?} is not declared");
        };
        port_idx
    }

    fn writable<T: Any>(&self, port_idx: usize, port: &str) -> Option<u32> {
        let port_idx = self.declared::<T>(port_idx, port);
        assert!(self.ports[port_idx].direction.writes(), "port {port:?} is declared as an input and was written");
        self.sources[port_idx].slot()
    }

    fn declared<T: Any>(&self, expected_idx: usize, port: &str) -> usize {
        let port_idx = self.port_idx(expected_idx, port);
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

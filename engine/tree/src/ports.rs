//! Ports of a node as a struct, in place of texts.
//!
//! ```
//! use sfg_tree::{In, InOut, Out, PortWord, Ports, Registry, Status, TreeSpec, nodes::node};
//! use std::sync::Arc;
//!
//! #[derive(Clone, Copy, Debug, PortWord)]
//! enum Side { Left, Right }
//!
//! #[derive(Ports)]
//! struct PourPorts {
//!     /// Share of the grains that is poured.
//!     #[port(setting, default = 0.8, min = 0, max = 1)] fraction: f64,
//!     #[port(setting, default = Side::Left)] side: Side,
//!     #[port(setting, optional)] title: Option<String>,
//!     #[port(input, key = "scene")] inventory: Arc<Vec<String>>,
//!     #[port(output)] fill_ml: Out<f64>,
//! }
//!
//! let mut registry = Registry::<Vec<String>>::new();
//! registry.entry::<Vec<String>>("scene");
//! registry.step_with::<PourPorts>("pour", |tick, ports| {
//!     tick.context.push(format!("{:?} of {} things", ports.side, ports.inventory.len()));
//!     ports.fill_ml.set(tick, 100.0 * ports.fraction);
//!     Ok(())
//! });
//! let spec = TreeSpec::from(node("pour").with("side", Side::Right));
//! let mut tree = registry.build(&spec).map_err(|errors| errors[0].to_string())?;
//! tree.set_entry("scene", vec!["cup".to_owned()]).map_err(|error| error.to_string())?;
//! let mut said = Vec::new();
//! assert_eq!(tree.tick(0.0, &mut said), Status::Success);
//! assert_eq!((said[0].as_str(), tree.entry::<f64>("fill_ml").as_deref()), ("Right of 1 things", Some(&80.0)));
//! # Ok::<(), String>(())
//! ```

use crate::action::{Action, Halt, Tick};
use crate::blackboard::{self, Stamp};
use crate::literal::Literal;
use crate::port::PortSpec;
use crate::registry::{NodeModel, Registry};
use crate::status::{Failure, Outcome, Progress};
use std::any::Any;
use std::borrow::Cow;
use std::fmt;
use std::marker::PhantomData;
use std::sync::Arc;

/// The ports of a node kind as a struct; made by `#[derive(Ports)]`.
///
/// A mistake in an attribute is a compile error at its field:
///
/// ```compile_fail
/// # use sfg_tree::Ports;
/// #[derive(Ports)]
/// struct Wrong {
///     #[port(output)] fill_ml: f64, // an output has the type `Out<T>`
/// }
/// ```
///
/// ```compile_fail
/// # use sfg_tree::Ports;
/// #[derive(Ports)]
/// struct Wrong {
///     #[port(setting, default = 2.0, min = 0, max = 1)] fraction: f64, // the default is outside its limits
/// }
/// ```
///
/// ```compile_fail
/// # use sfg_tree::Ports;
/// struct Cloud;
/// #[derive(Ports)]
/// struct Wrong {
///     #[port(setting)] cloud: Cloud, // no file can give a `Cloud`: it has no `FromLiteral`
/// }
/// ```
pub trait Ports: Sized {
    /// The declarations, in the order of the fields.
    fn specs() -> Vec<PortSpec>;

    /// The values as they are now.
    ///
    /// # Errors
    /// Reason [`crate::reason::PORT_EMPTY`] when an input that is neither optional nor an [`In`] has no value yet.
    fn read<C>(tick: &Tick<'_, C>) -> Result<Self, Failure>;
}

/// No ports.
impl Ports for () {
    fn specs() -> Vec<PortSpec> {
        Vec::new()
    }
    fn read<C>(_tick: &Tick<'_, C>) -> Result<Self, Failure> {
        Ok(())
    }
}

macro_rules! handles {
    ($($(#[$doc:meta])* $handle:ident;)*) => { $(
        $(#[$doc])*
        pub struct $handle<T> {
            port_idx: usize,
            name: &'static str,
            value: PhantomData<fn(T) -> T>,
        }

        impl<T> $handle<T> {
            /// The port declared at number `port_idx`, for derived code.
            #[doc(hidden)]
            #[must_use]
            pub const fn at(port_idx: usize, name: &'static str) -> Self {
                Self { port_idx, name, value: PhantomData }
            }
        }

        impl<T> Clone for $handle<T> {
            fn clone(&self) -> Self {
                *self
            }
        }

        impl<T> Copy for $handle<T> {}

        impl<T> fmt::Debug for $handle<T> {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                write!(f, "{}({})", stringify!($handle), self.name)
            }
        }
    )* };
}
handles! {
    /// A port that is read when asked, so that a running action sees what was written since.
    In;
    /// A port that is written.
    Out;
    /// A port that is read when asked, and written.
    InOut;
}

macro_rules! reads {
    ($($handle:ident)*) => { $(
        impl<T: Any + Send + Sync> $handle<T> {
            /// The value, shared and not copied.
            ///
            /// # Errors
            /// Reason [`crate::reason::PORT_EMPTY`] when nobody has written it yet.
            pub fn shared<C>(&self, tick: &Tick<'_, C>) -> Result<Arc<T>, Failure> {
                self.optional(tick)?.ok_or_else(|| blackboard::empty(self.name))
            }

            /// A copy of the value.
            ///
            /// # Errors
            /// Reason [`crate::reason::PORT_EMPTY`] when nobody has written it yet.
            pub fn get<C>(&self, tick: &Tick<'_, C>) -> Result<T, Failure>
            where
                T: Clone,
            {
                tick.get_at(self.port_idx, self.name)
            }

            /// The value if there is one.
            ///
            /// # Errors
            /// The failure of a field that the value does not have.
            pub fn optional<C>(&self, tick: &Tick<'_, C>) -> Result<Option<Arc<T>>, Failure> {
                tick.optional_at(self.port_idx, self.name)
            }

            /// When the entry behind the port was last written; nothing when it has a literal or is not connected.
            #[must_use]
            pub fn stamp<C>(&self, tick: &Tick<'_, C>) -> Option<Stamp> {
                tick.stamp(self.name)
            }
        }
    )* };
}
reads!(In InOut);

macro_rules! writes {
    ($($handle:ident)*) => { $(
        impl<T: Any + Send + Sync> $handle<T> {
            /// Writes the port. Nothing happens when the scenario connected it to nothing.
            pub fn set<C>(&self, tick: &mut Tick<'_, C>, value: T) {
                tick.set_at(self.port_idx, self.name, value);
            }

            /// Writes the port with a value that others hold too.
            pub fn set_shared<C>(&self, tick: &mut Tick<'_, C>, value: Arc<T>) {
                tick.set_shared(self.name, value);
            }
        }
    )* };
}
writes!(Out InOut);

/// An [`Action`] whose ports are a struct.
///
/// The ports are read once, before `start`; `poll` and `halt` get the same struct. What may change while the action runs is
/// an [`In`] or [`InOut`]. A missing input fails the action before it begins.
pub trait PortAction<C>: Send {
    /// Its ports.
    type Ports: Ports + Send;

    /// Begins the work.
    ///
    /// # Errors
    /// The reason why it cannot be done.
    fn start(&mut self, tick: &mut Tick<'_, C>, ports: &Self::Ports) -> Outcome;

    /// Goes on with the work. An action whose `start` never returns `Running` has none.
    ///
    /// # Errors
    /// The reason why it was not done.
    ///
    /// # Panics
    /// If an action that returned `Running` does not have it.
    fn poll(&mut self, _tick: &mut Tick<'_, C>, _ports: &Self::Ports) -> Outcome {
        panic!("an action that returns Running must implement poll");
    }

    /// Stops the work and undoes what must not stay, as [`Action::halt`].
    fn halt(&mut self, _tick: &mut Tick<'_, C>, _ports: &Self::Ports) -> Halt {
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
    fn resume(&mut self, _state: &Literal, tick: &mut Tick<'_, C>, ports: &Self::Ports) -> Outcome {
        self.start(tick, ports)
    }
}

/// A [`PortAction`] with the ports of its current activation.
struct WithPorts<C, A: PortAction<C>> {
    action: A,
    /// Dropped when the activation ends, so that it keeps no large value alive.
    ports: Option<A::Ports>,
}

impl<C, A: PortAction<C>> WithPorts<C, A> {
    fn call(
        &mut self,
        tick: &mut Tick<'_, C>,
        is_anew: bool,
        call: impl FnOnce(&mut A, &mut Tick<'_, C>, &A::Ports) -> Outcome,
    ) -> Outcome {
        if is_anew {
            self.ports = None;
        }
        let ports = match self.ports.take() {
            Some(ports) => ports,
            None => A::Ports::read(tick)?,
        };
        let outcome = call(&mut self.action, tick, self.ports.insert(ports));
        if outcome != Ok(Progress::Running) {
            self.ports = None;
        }
        outcome
    }
}

impl<C, A: PortAction<C>> Action<C> for WithPorts<C, A> {
    fn start(&mut self, tick: &mut Tick<'_, C>) -> Outcome {
        self.call(tick, true, A::start)
    }

    fn poll(&mut self, tick: &mut Tick<'_, C>) -> Outcome {
        self.call(tick, false, A::poll)
    }

    fn halt(&mut self, tick: &mut Tick<'_, C>) -> Halt {
        // Without ports nothing has begun.
        let Some(ports) = &self.ports else { return Halt::Done };
        let halt = self.action.halt(tick, ports);
        if halt == Halt::Done {
            self.ports = None;
        }
        halt
    }

    fn save(&self) -> Option<Literal> {
        self.action.save()
    }

    fn resume(&mut self, state: &Literal, tick: &mut Tick<'_, C>) -> Outcome {
        self.call(tick, true, |action, tick, ports| action.resume(state, tick, ports))
    }
}

impl<C> Registry<C> {
    /// Adds an action whose ports are a struct; `make` is called once for each node of the tree.
    ///
    /// # Panics
    /// If the name is taken or a default does not fit its port.
    pub fn action_with<A: PortAction<C> + 'static>(
        &mut self,
        name: impl Into<Cow<'static, str>>,
        make: impl Fn() -> A + Send + Sync + 'static,
    ) -> &mut NodeModel
    where
        C: 'static,
    {
        self.action(name, A::Ports::specs(), move || WithPorts { action: make(), ports: None })
    }

    /// Adds a condition whose ports are a struct, as [`Registry::condition`].
    ///
    /// # Panics
    /// If the name is taken or a default does not fit its port.
    pub fn condition_with<P: Ports + 'static>(
        &mut self,
        name: impl Into<Cow<'static, str>>,
        holds: impl Fn(&mut Tick<'_, C>, P) -> Result<bool, Failure> + Send + Sync + 'static,
    ) -> &mut NodeModel {
        self.condition(name, P::specs(), move |tick| holds(tick, P::read(tick)?))
    }

    /// Adds an action that is done within one call and whose ports are a struct, as [`Registry::step`].
    ///
    /// # Panics
    /// If the name is taken or a default does not fit its port.
    pub fn step_with<P: Ports + 'static>(
        &mut self,
        name: impl Into<Cow<'static, str>>,
        run: impl Fn(&mut Tick<'_, C>, P) -> Result<(), Failure> + Send + Sync + 'static,
    ) -> &mut NodeModel {
        self.step(name, P::specs(), move |tick| run(tick, P::read(tick)?))
    }
}

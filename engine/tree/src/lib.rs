//! Behaviour trees with typed ports, a blackboard and a journal.
//!
//! A [`Registry`] holds the node kinds. A [`TreeSpec`] says which nodes a tree has and what their ports are given;
//! [`Registry::build`] checks it as a whole and makes a [`Tree`]. The owner ticks the tree with its own context and time.
//! The crate knows no robot, and no file format but that of BehaviorTree.CPP, which is in `xml` (a default feature).
//!
//! ```
//! use sfg_tree::{NodeSpec, PortSpec, Registry, Status, TreeSpec};
//!
//! let mut registry = Registry::<Vec<String>>::new();
//! registry.step("measure", [PortSpec::output::<f64>("width_m")], |tick| {
//!     tick.set("width_m", 0.08);
//!     Ok(())
//! });
//! registry.step("say", [PortSpec::input::<f64>("width_m")], |tick| {
//!     let width_m = tick.input::<f64>("width_m")?;
//!     tick.context.push(format!("{width_m} m"));
//!     Ok(())
//! });
//! let spec = TreeSpec::new(NodeSpec::new("sequence").child(NodeSpec::new("measure")).child(NodeSpec::new("say")));
//! let mut tree = registry.build(&spec).map_err(|errors| errors[0].to_string())?;
//! let mut said = Vec::new();
//! assert_eq!(tree.tick(0.0, &mut said), Status::Success);
//! assert_eq!(said, ["0.08 m"]);
//! # Ok::<(), String>(())
//! ```
//!
//! [`nodes`] has a function for each built-in node, `#[derive(Ports)]` makes a struct of a node's ports.

mod action;
mod blackboard;
mod builder;
mod check;
mod condition;
mod control;
mod decorator;
mod definition;
mod edit;
#[cfg(feature = "groot")]
pub mod groot;
mod intervene;
mod journal;
mod leaf;
mod literal;
mod mistakes;
mod mock;
mod models;
mod nearest;
pub mod nodes;
mod port;
mod ports;
mod preview;
mod problem;
mod queue;
mod registry;
mod replay;
mod run;
mod script;
mod spec;
mod state;
mod statistics;
mod status;
mod threaded;
mod tree;
mod waker;
#[cfg(feature = "xml")]
pub mod xml;

pub use action::{Action, Halt, Tick};
pub use blackboard::Stamp;
pub use definition::{BoundPort, PortBinding};
pub use edit::{EditError, Reloaded};
pub use intervene::{Break, BreakAt};
pub use journal::{Change, JournalLevel, NamedChange, NamedRecord, Names, Record};
pub use literal::{FromLiteral, Literal, Shape};
pub use mistakes::BuildErrors;
pub use mock::{MockCall, MockResult, Mocks};
pub use nearest::nearest;
pub use port::{Direction, PortSpec, PortType};
pub use ports::{In, InOut, Out, PortAction, Ports};
pub use preview::{Conflict, Preview, PreviewStep};
pub use problem::{BuildError, EntryError, Problem};
pub use queue::Queue;
pub use registry::{Footprint, NodeClass, NodeModel, Registry};
pub use replay::{Divergence, Replayed, replay};
pub use sfg_tree_derive::{PortWord, Ports};
pub use spec::{ConditionSpec, NodeKind, NodeSpec, PortSetting, PortValue, SubtreePort, SubtreeSpec, TreeSpec, When};
pub use state::{EntryState, NodeState, ResumeError, TreeState};
pub use statistics::{NodeStatistics, Statistics};
pub use status::{Failure, Outcome, Progress, Status, reason};
pub use threaded::Stop;
pub use tree::{Backup, FailureAt, NodeDefinition, NodeId, Tree};
pub use waker::Waker;

/// The examples of the README are tests.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;

//! YAML scenarios: parsed with positions, checked as a whole, built into a tree.
//!
//! [`Scenario::load`] reads a file with all that it includes, puts in the values of its parameters and reports every mistake at
//! once, each with file, line, column, the line itself and what to write instead. The names it accepts come from a [`Vocabulary`] and from the node registry, so that this crate knows no node,
//! no plugin and no object model. [`ScenarioTests`] tries a scenario's tree with preset results of its leaves; [`XmlTree`] is a tree of
//! BehaviorTree.CPP, to run in a scenario's scene or to write down as YAML.

mod angle;
mod document;
mod emit;
mod files;
mod layout;
mod mistake;
mod parameters;
mod plugins;
mod reader;
mod reasons;
mod review;
mod scenario;
mod scene;
mod schema;
mod success;
mod testing;
mod tree;
mod vocabulary;
mod xml;

pub use document::{MAX_ALIAS_EXPANSION, MAX_DEPTH, MAX_FILE_BYTES};
pub use files::{MAX_FILES, MAX_INCLUDE_DEPTH};
pub use mistake::{At, Findings, Mistake, Place, ScenarioErrors, Severity, Source};
pub use parameters::{SettingError, Settings};
pub use plugins::{PluginChoice, Plugins};
pub use scenario::{Limits, Scenario, Workspace};
pub use scene::{Distractors, Hollow, ObjectShape, Placement, Range, Scene, SceneObject};
pub use schema::schema;
pub use success::{Predicate, Success};
pub use testing::{CaseResult, Difference, ScenarioTests, TestCase, test_schema};
pub use vocabulary::Vocabulary;
pub use xml::XmlTree;

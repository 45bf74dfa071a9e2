//! Registry of built-in plugins; discovery and loading of dynamic libraries.
//!
//! The application registers its built-ins by name, adds libraries found on the search path, and makes plugins by the names a
//! scenario gives. A library that is refused never stops the others; every refusal has a reason for the user.
//!
//! Libraries run inside the process and are trusted: a crash in one ends the process.

pub mod dynamic;
#[cfg(test)]
mod faults;
pub mod library;
pub mod registry;
pub mod search;

pub use dynamic::DynamicPoseGenerator;
pub use library::{LoadedPlugin, PoseGeneratorFactory, load_library};
pub use registry::{LibraryReport, Registry};
pub use search::{Found, SearchPath, SkipReason, Skipped};

use sfg_plugin::{PluginError, abi};
use std::fmt;
use std::path::PathBuf;

/// The five contracts, in the order of the data path.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Contract {
    /// [`sfg_plugin::LlmBackend`].
    Llm,
    /// [`sfg_plugin::Grounder`].
    Grounder,
    /// [`sfg_plugin::PoseGenerator`].
    PoseGenerator,
    /// [`sfg_plugin::GraspPolicy`].
    GraspPolicy,
    /// [`sfg_plugin::Driver`].
    Driver,
}

impl Contract {
    /// All five.
    pub const ALL: [Self; 5] = [Self::Llm, Self::Grounder, Self::PoseGenerator, Self::GraspPolicy, Self::Driver];

    /// The key under `plugins:` in a scenario.
    #[must_use]
    pub fn key(self) -> &'static str {
        match self {
            Self::Llm => "llm",
            Self::Grounder => "grounder",
            Self::PoseGenerator => "pose_generator",
            Self::GraspPolicy => "grasp_policy",
            Self::Driver => "driver",
        }
    }

    /// The id a library is asked with.
    #[must_use]
    pub fn capability_id(self) -> &'static str {
        match self {
            Self::Llm => abi::capability::LLM_BACKEND,
            Self::Grounder => abi::capability::GROUNDER,
            Self::PoseGenerator => abi::capability::POSE_GENERATOR,
            Self::GraspPolicy => abi::capability::GRASP_POLICY,
            Self::Driver => abi::capability::DRIVER,
        }
    }
}

impl fmt::Display for Contract {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.key())
    }
}

/// Why a plugin is not there.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum HostError {
    /// No plugin of that name. The scenario needs another name, or a library is missing.
    #[error("unknown {contract} plugin {name:?}{}; known: {}", did_you_mean(nearest), list(known))]
    UnknownPlugin {
        /// Which contract was asked for.
        contract: Contract,
        /// The name asked for.
        name: String,
        /// Similar names, best first.
        nearest: Vec<String>,
        /// Every name of this contract.
        known: Vec<String>,
    },
    /// The plugin exists and could not be made.
    #[error(transparent)]
    Plugin(#[from] PluginError),
    /// Two plugins of a contract have one name. The first keeps it.
    #[error("plugin library {path:?}: a {contract} plugin {name:?} exists already; the first one is kept")]
    DuplicateName {
        /// The library that comes too late.
        path: PathBuf,
        /// The contract.
        contract: Contract,
        /// The name.
        name: String,
    },
    /// The file cannot be found or read.
    #[error("plugin library {path:?} cannot be opened: {source}")]
    NotFound {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
    /// The system's loader refuses the file.
    #[error("plugin library {path:?} cannot be loaded: {reason}{hint}")]
    NotLoadable {
        /// The file.
        path: PathBuf,
        /// What the loader says, verbatim.
        reason: String,
        /// What the user can do, when that is known.
        hint: &'static str,
    },
    /// A library, but not one of ours.
    #[error("plugin library {path:?} is no SayFuncGrasp plugin: it exports no symbol {:?}", abi::ENTRY_SYMBOL)]
    NoEntry {
        /// The file.
        path: PathBuf,
    },
    /// It was built for another major version of the boundary.
    #[error(
        "plugin library {path:?} speaks version {plugin_major} of the plugin interface, this program {}; rebuild the plugin",
        abi::ABI_MAJOR
    )]
    OtherVersion {
        /// The file.
        path: PathBuf,
        /// Its version.
        plugin_major: u16,
    },
    /// A table or struct of the library cannot be used.
    #[error("plugin library {path:?} is broken: {reason}")]
    Broken {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
    /// Its `init` failed.
    #[error("plugin library {path:?} could not start: {reason}")]
    InitFailed {
        /// The file.
        path: PathBuf,
        /// What it says.
        reason: String,
    },
    /// It offers none of the contracts this program can use.
    #[error("plugin library {path:?} offers nothing this program knows; asked for {}", list(asked))]
    NoCapability {
        /// The file.
        path: PathBuf,
        /// The ids it was asked with.
        asked: Vec<String>,
    },
}

fn did_you_mean(nearest: &[String]) -> String {
    if nearest.is_empty() { String::new() } else { format!("; did you mean {}", list(nearest)) }
}

fn list(names: &[String]) -> String {
    let quoted: Vec<String> = names.iter().map(|name| format!("{name:?}")).collect();
    if quoted.is_empty() { "none".to_owned() } else { quoted.join(", ") }
}

//! Why a robot could not be loaded or cut into chains.

use std::path::PathBuf;

/// Errors of this crate; all are mistakes in files or names that the user can mend.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum KinematicsError {
    /// A file is missing or unreadable.
    #[error("cannot read {}: {source}; check the path given in the robot description", path.display())]
    ReadFile {
        /// Which file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// A YAML file has an unknown key, a wrong type or a syntax error.
    #[error("robot file {}: {message}", path.display())]
    Yaml {
        /// Which file.
        path: PathBuf,
        /// Line, column, key and what was expected.
        message: String,
    },
    /// A URDF is no URDF.
    #[error("URDF {}: {message}; mend the file or name another one in the robot description", path.display())]
    Urdf {
        /// Which file.
        path: PathBuf,
        /// What is wrong.
        message: String,
    },
    /// An SRDF is no SRDF.
    #[error("SRDF {}: {message}", path.display())]
    Srdf {
        /// Which file.
        path: PathBuf,
        /// Line, column and what is wrong.
        message: String,
    },
    /// A file is no reachability map of the arm, or cannot be written.
    #[error("reachability map {}: {message}", path.display())]
    Reach {
        /// Which file.
        path: PathBuf,
        /// What is wrong and what to do.
        message: String,
    },
    /// A key of the robot description has a value that does not fit the URDF.
    #[error("robot description {}: key {key:?}: {message}", path.display())]
    Description {
        /// Which file.
        path: PathBuf,
        /// Dotted path of the key.
        key: String,
        /// What was found and what was expected.
        message: String,
    },
    /// A name that the robot does not have.
    #[error("no {what} is called {name:?}; the nearest of {n_known} names is {nearest:?}")]
    UnknownName {
        /// `link`, `joint` or `group`.
        what: &'static str,
        /// The name asked for.
        name: String,
        /// How many there are.
        n_known: usize,
        /// The most similar one.
        nearest: String,
    },
    /// Two links without a path of joints from the first to the second.
    #[error("link {tip:?} does not hang on link {base:?}")]
    NoChain {
        /// Where the chain was to begin.
        base: String,
        /// Where it was to end.
        tip: String,
    },
}

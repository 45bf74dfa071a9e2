//! Why a world could not be built or asked.

use std::path::PathBuf;

/// Errors of this crate.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum WorldError {
    /// A file is missing or unreadable.
    #[error("cannot read {}: {source}; check the path given in the scenario", path.display())]
    ReadFile {
        /// Which file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// An object file has an unknown key, a wrong type, an impossible value or a syntax error.
    #[error("object file {}: {message}", path.display())]
    ObjectFile {
        /// Which file.
        path: PathBuf,
        /// Line, column, key and what was expected.
        message: String,
    },
    /// A value of the scene is impossible.
    #[error("scene: {what}: {message}")]
    BadScene {
        /// Which object or setting.
        what: String,
        /// What was found, what was expected.
        message: String,
    },
    /// Nothing in the scene has this name.
    #[error("the scene has no object {name:?}; it has {known:?}")]
    UnknownObject {
        /// The name asked for.
        name: String,
        /// Names that exist.
        known: Vec<String>,
    },
    /// The robot has no camera of this name.
    #[error("the robot has no camera {name:?}; it has {known:?}")]
    UnknownCamera {
        /// The name asked for.
        name: String,
        /// Names that exist.
        known: Vec<String>,
    },
    /// The robot cannot be simulated.
    #[error("robot: {message}")]
    Robot {
        /// What is missing or wrong.
        message: String,
    },
    /// A command does not fit the robot.
    #[error("command refused: {message}")]
    Command {
        /// What was given, what was expected.
        message: String,
    },
    /// A simulated body left the range of finite numbers: a bug or an impossible scene.
    #[error("the simulation diverged at {stamp_secs:.3} s: {what} has no finite pose")]
    Diverged {
        /// When.
        stamp_secs: f64,
        /// Which body.
        what: String,
    },
}

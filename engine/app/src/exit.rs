//! Exit codes, one a kind of ending.

use crate::check::BadInput;
use sfg_types::Outcome;
use std::process::ExitCode;

/// The scenario's success predicates hold.
pub(crate) const SUCCESS: u8 = 0;
/// The run ended and a predicate does not hold.
pub(crate) const JUDGED_FAILURE: u8 = 1;
/// The command line, the scenario or an asset is wrong; nothing moved.
pub(crate) const BAD_INPUT: u8 = 2;
/// The tree failed.
pub(crate) const TREE_FAILURE: u8 = 3;
/// The language backend asked back or refused.
pub(crate) const NOT_ATTEMPTED: u8 = 4;
/// A file, a plugin or a device is missing or broken.
pub(crate) const ENVIRONMENT: u8 = 5;
/// The judge found the physics manipulated.
pub(crate) const PHYSICS_TAMPERED: u8 = 6;
/// A replay decided otherwise, two recordings differ, or a test of a scenario found something else than it expects.
pub(crate) const DIFFERENT: u8 = 7;
/// Ctrl-C or an emergency stop.
pub(crate) const INTERRUPTED: u8 = 130;

/// Ctrl-C before there was anything to report.
#[derive(Debug, thiserror::Error)]
#[error("interrupted; {0}")]
pub(crate) struct Interrupted(pub(crate) String);

/// The code of a command that ended in an error.
#[must_use]
pub(crate) fn code_of_error(error: &anyhow::Error) -> ExitCode {
    ExitCode::from(if error.is::<BadInput>() {
        BAD_INPUT
    } else if error.is::<Interrupted>() {
        INTERRUPTED
    } else {
        ENVIRONMENT
    })
}

/// Shown by `sfg --help`.
pub(crate) const HELP: &str = "Exit codes:\n  \
    0    success, judged true\n  \
    1    the run ended, a success predicate does not hold\n  \
    2    bad input: command line, scenario or asset; nothing moved\n  \
    3    the behaviour tree failed\n  \
    4    the language backend asked back or refused\n  \
    5    environment: a file cannot be written, a plugin or device is missing\n  \
    6    the judge found the physics manipulated\n  \
    7    a replay decided otherwise, two recordings differ, or a scenario test failed\n  \
    130  interrupted, the robot was halted";

/// The code of an outcome.
#[must_use]
pub(crate) fn code(outcome: Outcome) -> ExitCode {
    ExitCode::from(match outcome {
        Outcome::Success => SUCCESS,
        Outcome::JudgedFailure => JUDGED_FAILURE,
        Outcome::TreeFailure => TREE_FAILURE,
        Outcome::NotAttempted => NOT_ATTEMPTED,
        Outcome::Interrupted => INTERRUPTED,
        Outcome::PhysicsTampered => PHYSICS_TAMPERED,
    })
}

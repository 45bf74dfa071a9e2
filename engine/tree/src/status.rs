//! What a node says when it is ticked.

use std::borrow::Cow;
use std::fmt;

/// State of a node.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[repr(u8)]
pub enum Status {
    /// Not active.
    Idle,
    /// Started and not finished.
    Running,
    /// Finished as wanted.
    Success,
    /// Finished otherwise; [`crate::Tree::failure`] says why.
    Failure,
    /// Had nothing to do. Only ever returned: a skipped node stays idle.
    Skipped,
}

impl Status {
    /// The name in files: `success`.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Idle => "idle",
            Self::Running => "running",
            Self::Success => "success",
            Self::Failure => "failure",
            Self::Skipped => "skipped",
        }
    }
}

impl fmt::Display for Status {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// What an action that did not fail says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Progress {
    /// Poll again on the next tick.
    Running,
    /// Done.
    Success,
    /// There was nothing to do.
    Skipped,
}

/// What an action returns.
pub type Outcome = Result<Progress, Failure>;

/// Why a node failed: a reason that the tree can decide on and a detail for people.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Failure {
    /// A word from a closed list of the application or from [`reason`].
    pub reason: Cow<'static, str>,
    /// What happened, with values and units.
    pub detail: String,
}

impl Failure {
    /// A failure for `reason`.
    pub fn new(reason: impl Into<Cow<'static, str>>, detail: impl Into<String>) -> Self {
        Self { reason: reason.into(), detail: detail.into() }
    }
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.reason)?;
        if self.detail.is_empty() { Ok(()) } else { write!(f, ": {}", self.detail) }
    }
}

impl std::error::Error for Failure {}

/// Reasons that the tree itself gives.
pub mod reason {
    /// A `timeout` decorator used up its time.
    pub const TIMEOUT: &str = "timeout";
    /// A node panicked. This is a bug in the node.
    pub const PANICKED: &str = "panicked";
    /// A condition does not hold.
    pub const CONDITION_FALSE: &str = "condition_false";
    /// An input port has no value: the writer of its key has not run or has not succeeded.
    pub const PORT_EMPTY: &str = "port_empty";
    /// An `inverter` or `force_failure` turned a success into a failure.
    pub const INVERTED: &str = "inverted";
    /// A `parallel` waits for more successes or failures than it has children.
    pub const OUT_OF_REACH: &str = "out_of_reach";
    /// The pre-condition `failure_if` of a node holds.
    pub const FAILURE_IF: &str = "failure_if";
    /// A script could not be evaluated: an entry is empty, or a text stands where a number is needed.
    pub const SCRIPT_FAILED: &str = "script_failed";
    /// A halted action has not stopped in the time it asked for, and another action needs what it occupies.
    pub const HALT_OVERDUE: &str = "halt_overdue";
    /// A `loop` has nothing left to do and was told that this is a failure.
    pub const NOTHING_LEFT: &str = "nothing_left";
    /// An `always_failure` was ticked.
    pub const ALWAYS_FAILURE: &str = "always_failure";
    /// A value does not have the type of the entry it is copied to.
    pub const WRONG_TYPE: &str = "wrong_type";
    /// The system gives no thread for a threaded action.
    pub const NO_THREAD: &str = "no_thread";

    /// Every reason above.
    pub const ALL: &[&str] = &[
        TIMEOUT,
        PANICKED,
        CONDITION_FALSE,
        PORT_EMPTY,
        INVERTED,
        OUT_OF_REACH,
        FAILURE_IF,
        SCRIPT_FAILED,
        HALT_OVERDUE,
        NOTHING_LEFT,
        ALWAYS_FAILURE,
        WRONG_TYPE,
        NO_THREAD,
    ];
}

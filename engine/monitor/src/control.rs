//! What a viewer asks of a running tree, and the gate at which the run asks for it between two ticks.

use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// When a breakpoint stops the tree.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum At {
    /// Before the node starts.
    Start,
    /// When it has ended.
    End,
}

/// A request of a viewer, as in the body of `POST /api/control`.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
#[serde(tag = "command", rename_all = "snake_case", deny_unknown_fields)]
pub enum Command {
    /// Ticks no more; the robot comes to rest and holds still.
    Pause,
    /// Goes on.
    Continue,
    /// One tick, then holds still again.
    Step,
    /// Goes on to the next status change of a node, then holds still again.
    Next,
    /// Halts the tree; the run ends.
    Halt,
    /// Stops the robot at once; the run ends.
    Stop,
    /// Sets or clears a breakpoint.
    Break {
        /// Path of the node.
        node: String,
        /// Before it starts or when it has ended.
        at: At,
        /// Set or cleared.
        on: bool,
    },
    /// The node gives this result instead of acting, now if it runs or else the next time.
    Force {
        /// Path of the node.
        node: String,
        /// Its result.
        status: Forcible,
    },
}

/// Results that can be forced.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Forcible {
    /// Success.
    Success,
    /// Failure.
    Failure,
}

/// Why a request is not followed.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum Refused {
    /// The tree has no such node.
    #[error("the tree has no node {0:?}; reload the page if the tree was changed")]
    UnknownNode(String),
    /// The run is over.
    #[error("the run is over")]
    Over,
}

/// A result that a node shall give.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Forced {
    /// Path of the node.
    pub node: String,
    /// Whether it succeeds.
    pub success: bool,
}

/// A place to stop at.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
pub struct Breakpoint {
    /// Path of the node.
    pub node: String,
    /// Before it starts.
    pub start: bool,
    /// When it has ended.
    pub end: bool,
}

/// A breakpoint that was met in a tick.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Hit {
    /// Path of the node.
    pub node: String,
    /// Before its start or at its end.
    pub at: At,
}

/// What the run does next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Go {
    /// Tick the tree.
    Tick,
    /// Hold still for a control period and ask again.
    Hold,
    /// Halt the tree and end.
    Halt,
    /// Stop the robot at once, and end.
    EmergencyStop,
}

/// The answer of the gate.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Turn {
    /// What to do.
    pub go: Go,
    /// Results to force before the tick.
    pub forced: Vec<Forced>,
    /// All breakpoints, when they have changed.
    pub breakpoints: Option<Vec<Breakpoint>>,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
enum Mode {
    #[default]
    Running,
    Paused,
    /// One tick.
    Step,
    /// To the next status change.
    Next,
}

#[derive(Debug, Default)]
struct State {
    mode: Mode,
    /// Why it is paused, for people.
    why: String,
    end: Option<Go>,
    is_over: bool,
    forced: Vec<Forced>,
    breakpoints: BTreeMap<String, Breakpoint>,
    has_new_breakpoints: bool,
    nodes: BTreeSet<String>,
    version: u64,
}

/// The gate between viewers and a run: viewers order, the run asks between two ticks. Neither waits for the other.
#[derive(Debug, Default)]
pub struct Control(Mutex<State>);

impl Control {
    /// A gate that lets the run go on.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// A gate that holds the run before its first tick.
    #[must_use]
    pub fn paused() -> Self {
        let control = Self::default();
        (control.lock().mode, control.lock().why) = (Mode::Paused, "before the first tick".to_owned());
        control
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Tells which nodes the tree has, so that requests can be checked; again when the tree was changed.
    pub fn set_nodes(&self, paths: impl IntoIterator<Item = String>) {
        let mut state = self.lock();
        state.nodes = paths.into_iter().collect();
        let State { nodes, breakpoints, .. } = &mut *state;
        breakpoints.retain(|path, _| nodes.contains(path));
        state.has_new_breakpoints = true;
        state.version += 1;
    }

    /// Takes a request of a viewer.
    ///
    /// # Errors
    /// [`Refused`] when it names no node of the tree, or the run is over.
    pub fn order(&self, command: &Command) -> Result<(), Refused> {
        let mut state = self.lock();
        if state.is_over {
            return Err(Refused::Over);
        }
        if let Command::Break { node, .. } | Command::Force { node, .. } = command
            && !state.nodes.contains(node)
        {
            return Err(Refused::UnknownNode(node.clone()));
        }
        match command {
            Command::Pause => (state.mode, state.why) = (Mode::Paused, "paused from the page".to_owned()),
            Command::Continue => (state.mode, state.why) = (Mode::Running, String::new()),
            Command::Step => state.mode = Mode::Step,
            Command::Next => state.mode = Mode::Next,
            // An emergency stop stays one.
            Command::Halt => state.end = state.end.or(Some(Go::Halt)),
            Command::Stop => state.end = Some(Go::EmergencyStop),
            Command::Break { node, at, on } => {
                let kept = Breakpoint { node: node.clone(), start: false, end: false };
                let breakpoint = state.breakpoints.entry(node.clone()).or_insert(kept);
                match at {
                    At::Start => breakpoint.start = *on,
                    At::End => breakpoint.end = *on,
                }
                state.breakpoints.retain(|_, breakpoint| breakpoint.start || breakpoint.end);
                state.has_new_breakpoints = true;
            }
            Command::Force { node, status } => {
                state.forced.retain(|forced| forced.node != *node);
                state.forced.push(Forced { node: node.clone(), success: *status == Forcible::Success });
            }
        }
        state.version += 1;
        Ok(())
    }

    /// What the run does next; called between two ticks.
    #[must_use]
    pub fn turn(&self) -> Turn {
        let mut state = self.lock();
        let go = match (state.end, state.mode) {
            (Some(end), _) => end,
            (None, Mode::Paused) => Go::Hold,
            (None, _) => Go::Tick,
        };
        let forced = if go == Go::Tick { std::mem::take(&mut state.forced) } else { Vec::new() };
        if !forced.is_empty() {
            state.version += 1;
        }
        let is_new = go == Go::Tick && std::mem::take(&mut state.has_new_breakpoints);
        let breakpoints = is_new.then(|| state.breakpoints.values().cloned().collect());
        Turn { go, forced, breakpoints }
    }

    /// Tells how a tick went: which breakpoints it met and whether a node changed its status.
    pub fn ticked(&self, has_changes: bool, hits: &[Hit]) {
        let mut state = self.lock();
        let why = match (hits.first(), state.mode) {
            (Some(Hit { node, at: At::Start }), _) => format!("breakpoint: before {node} starts"),
            (Some(Hit { node, at: At::End }), _) => format!("breakpoint: {node} has ended"),
            (None, Mode::Step) => "after one tick".to_owned(),
            (None, Mode::Next) if has_changes => "a status has changed".to_owned(),
            _ => return,
        };
        // A request that came during the tick stands.
        (state.mode, state.why) = (Mode::Paused, why);
        state.version += 1;
    }

    /// Tells that the run is over; from then on requests are refused.
    pub fn end(&self) {
        let mut state = self.lock();
        state.is_over = true;
        state.version += 1;
    }

    /// Whether the tree is not ticked now.
    #[must_use]
    pub fn is_paused(&self) -> bool {
        self.lock().mode == Mode::Paused
    }

    /// Whether a result shall be forced at the next tick.
    #[must_use]
    pub fn has_forced(&self) -> bool {
        !self.lock().forced.is_empty()
    }

    /// Whether a halt or an emergency stop was asked for.
    #[must_use]
    pub fn is_ending(&self) -> bool {
        self.lock().end.is_some()
    }

    /// Changes with every change of the state.
    pub(crate) fn version(&self) -> u64 {
        self.lock().version
    }

    /// The state as the page reads it.
    pub(crate) fn to_json(&self) -> serde_json::Value {
        let state = self.lock();
        serde_json::json!({
            "mode": state.mode,
            "paused": state.mode == Mode::Paused,
            "why": state.why,
            "over": state.is_over,
            "ending": match state.end { Some(Go::EmergencyStop) => Some("stop"), Some(_) => Some("halt"), None => None },
            "forced": state.forced,
            "breakpoints": state.breakpoints.values().collect::<Vec<_>>(),
        })
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "tests fail by panicking")]
    use super::*;

    fn control() -> Control {
        let control = Control::new();
        control.set_nodes(["sequence".to_owned(), "sequence/lift".to_owned()]);
        control
    }

    #[test]
    fn a_step_is_one_tick_and_a_pause_holds_until_it_is_told_to_go_on() {
        let control = control();
        assert_eq!(control.turn().go, Go::Tick);
        control.order(&Command::Pause).unwrap();
        control.ticked(true, &[]);
        assert_eq!(control.turn().go, Go::Hold);
        control.order(&Command::Step).unwrap();
        assert_eq!(control.turn().go, Go::Tick);
        control.ticked(false, &[]);
        assert_eq!(control.turn().go, Go::Hold);
        control.order(&Command::Next).unwrap();
        for has_changes in [false, false, true] {
            assert_eq!(control.turn().go, Go::Tick);
            control.ticked(has_changes, &[]);
        }
        assert_eq!(control.turn().go, Go::Hold);
        control.order(&Command::Continue).unwrap();
        control.ticked(true, &[]);
        assert_eq!(control.turn().go, Go::Tick);
    }

    #[test]
    fn breakpoints_pause_and_forced_results_are_handed_over_once() {
        let control = control();
        let node = "sequence/lift".to_owned();
        control.order(&Command::Break { node: node.clone(), at: At::Start, on: true }).unwrap();
        control.order(&Command::Force { node: node.clone(), status: Forcible::Failure }).unwrap();
        let turn = control.turn();
        assert_eq!(turn.forced, [Forced { node: node.clone(), success: false }]);
        assert_eq!(turn.breakpoints, Some(vec![Breakpoint { node: node.clone(), start: true, end: false }]));
        assert_eq!(control.turn(), Turn { go: Go::Tick, forced: Vec::new(), breakpoints: None });
        control.ticked(true, &[Hit { node: node.clone(), at: At::Start }]);
        assert_eq!(control.turn().go, Go::Hold);
        assert!(control.to_json()["why"].as_str().unwrap().contains("before sequence/lift starts"));
        control.order(&Command::Break { node, at: At::Start, on: false }).unwrap();
        control.order(&Command::Continue).unwrap();
        assert_eq!(control.turn().breakpoints, Some(Vec::new()));
    }

    #[test]
    fn an_emergency_stop_works_while_paused_and_is_not_weakened_by_a_halt() {
        let control = control();
        control.order(&Command::Pause).unwrap();
        control.order(&Command::Stop).unwrap();
        control.order(&Command::Halt).unwrap();
        assert_eq!(control.turn().go, Go::EmergencyStop);
    }

    #[test]
    fn unknown_nodes_and_finished_runs_are_refused() {
        let control = control();
        let force = Command::Force { node: "sequence/lft".to_owned(), status: Forcible::Success };
        assert_eq!(control.order(&force), Err(Refused::UnknownNode("sequence/lft".to_owned())));
        control.end();
        assert_eq!(control.order(&Command::Pause), Err(Refused::Over));
    }
}

//! One case: its tree is ticked to its end, and what happened is compared with what is expected.

use super::names::Names;
use crate::mistake::At;
use crate::scene::Range;
use sfg_tree::{Literal, MockCall, MockResult, Mocks, Status, Tree, reason};
use std::collections::BTreeMap;
use std::fmt;
use std::sync::Arc;

/// A case that is ready to run.
#[derive(Debug)]
pub struct TestCase {
    /// What it shows.
    pub name: At<String>,
    pub(super) tree: Tree<Mocks>,
    pub(super) names: Arc<Names>,
    pub(super) results: BTreeMap<String, Vec<MockResult>>,
    pub(super) tick_secs: f64,
    pub(super) halt_at_secs: Option<f64>,
    pub(super) until_secs: f64,
    pub(super) expected: Expected,
}

/// What a case expects; nothing is said about what is missing.
#[derive(Clone, Debug, Default)]
pub(super) struct Expected {
    pub(super) end: Option<End>,
    pub(super) reason: Option<String>,
    pub(super) node: Option<String>,
    pub(super) trace: Option<Vec<Step>>,
    pub(super) contains: Option<Vec<Step>>,
    pub(super) calls: Vec<(String, u32)>,
    pub(super) ends_within_secs: Option<Range>,
    pub(super) entries: Vec<(String, Literal)>,
}

/// How a tree can end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum End {
    Ended(Status),
    Halted,
}

impl End {
    pub(super) const ALL: [Self; 5] = [
        Self::Ended(Status::Success),
        Self::Ended(Status::Failure),
        Self::Ended(Status::Running),
        Self::Ended(Status::Skipped),
        Self::Halted,
    ];

    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Ended(status) => status.name(),
            Self::Halted => "halted",
        }
    }
}

/// The end of an activation of a leaf.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Step {
    /// A path, own name or kind.
    pub(super) leaf: String,
    /// Any when not given.
    pub(super) status: Option<Status>,
}

/// How the end of a leaf's activation is called in a trace.
pub(super) const STEP_ENDS: [(&str, Status); 4] =
    [("success", Status::Success), ("failure", Status::Failure), ("skipped", Status::Skipped), ("halted", Status::Idle)];

fn step_end(status: Status) -> &'static str {
    STEP_ENDS.iter().find(|(_, known)| *known == status).map_or(status.name(), |(name, _)| name)
}

impl fmt::Display for Step {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.leaf)?;
        self.status.map_or(Ok(()), |status| write!(f, " {}", step_end(status)))
    }
}

/// What a case has found.
#[derive(Clone, Debug, PartialEq)]
pub struct CaseResult {
    /// Where it differs from what is expected; none when the case holds.
    pub differences: Vec<Difference>,
    /// Ends of activations of leaves in order: `lift success`.
    pub trace: Vec<String>,
}

/// One expectation that does not hold. Displays as one line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Difference {
    /// The key under `expect`.
    pub what: String,
    /// As the file says it.
    pub expected: String,
    /// What happened.
    pub found: String,
}

impl Difference {
    /// Whether the order of events differs, so that the whole trace tells more.
    #[must_use]
    pub fn is_of_trace(&self) -> bool {
        self.what == "contains" || self.what.starts_with("trace")
    }
}

impl fmt::Display for Difference {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: expected {}, found {}", self.what, self.expected, self.found)
    }
}

/// How a run of the tree ended.
struct Run {
    end: End,
    now_secs: f64,
    /// Reason, path and detail of the failure that decided it.
    failure: Option<(String, usize, String)>,
    calls: Vec<MockCall>,
}

impl TestCase {
    /// Ticks the tree until it ends, is halted or the time is over, and compares.
    #[must_use]
    pub fn run(mut self) -> CaseResult {
        let run = self.tick_to_end();
        let trace: Vec<String> = run.calls.iter().map(|call| format!("{} {}", call.title, step_end(call.status))).collect();
        let mut differences = Vec::new();
        self.compare_end(&run, &mut differences);
        self.compare_trace(&run, &trace, &mut differences);
        self.compare_calls(&run, &mut differences);
        self.compare_entries(&mut differences);
        CaseResult { differences, trace }
    }

    fn tick_to_end(&mut self) -> Run {
        let mut mocks = Mocks::new(&self.tree, std::mem::take(&mut self.results));
        let mut n_ticks = 0.0;
        let (end, now_secs) = loop {
            let now_secs = n_ticks * self.tick_secs;
            // Rounding must not cost a tick.
            if self.halt_at_secs.is_some_and(|halt_at_secs| now_secs >= halt_at_secs - 1e-9) {
                self.tree.halt(&mut mocks);
                break (End::Halted, now_secs);
            }
            if now_secs > self.until_secs + 1e-9 {
                break (End::Ended(Status::Running), self.until_secs);
            }
            let status = self.tree.tick(now_secs, &mut mocks);
            if status != Status::Running {
                break (End::Ended(status), now_secs);
            }
            n_ticks += 1.0;
        };
        let failure = self.tree.failure().filter(|_| end == End::Ended(Status::Failure)).map(|at| {
            let failure = &at.failure;
            (failure.reason.to_string(), at.node as usize, failure.detail.clone())
        });
        Run { end, now_secs, failure, calls: mocks.calls().to_vec() }
    }

    fn compare_end(&self, run: &Run, differences: &mut Vec<Difference>) {
        let path = |id: usize| self.names.nodes.get(id).map_or("", |node| node.path.as_str());
        let ended = match (&run.failure, run.end) {
            (Some((reason, node, detail)), _) => format!("failure: {reason} at {} ({detail})", path(*node)),
            (None, End::Ended(Status::Running)) => format!("running after {} s", run.now_secs),
            (None, end) => end.name().to_owned(),
        };
        let mut differs = |what: &str, expected: &str, found: &str| {
            differences.push(Difference { what: what.to_owned(), expected: expected.to_owned(), found: found.to_owned() });
        };
        if let Some(end) = self.expected.end
            && end != run.end
        {
            differs("status", end.name(), &ended);
        } else {
            let (reason, node) = run.failure.as_ref().map_or((None, None), |(reason, node, _)| (Some(reason), Some(*node)));
            if let Some(expected) = &self.expected.reason
                && reason != Some(expected)
            {
                differs("reason", expected, &ended);
            }
            let node = node.and_then(|id| self.names.nodes.get(id));
            if let Some(expected) = &self.expected.node
                && !node.is_some_and(|node| node.is_called(expected))
            {
                differs("node", expected, node.map_or(ended.as_str(), |node| &node.path));
            }
        }
        if let Some(Range { min, max }) = self.expected.ends_within_secs {
            let found = format!("{:.3} s", run.now_secs);
            match run.end {
                End::Ended(Status::Running) => differs("ends_within_secs", &format!("{min} to {max} s"), &ended),
                _ if run.now_secs < min - 1e-9 || run.now_secs > max + 1e-9 => {
                    differs("ends_within_secs", &format!("{min} to {max} s"), &found);
                }
                _ => {}
            }
        }
        // A case whose results cannot be written tests something else than it says.
        let unwritten = self.tree.failures().filter(|at| at.failure.reason == reason::WRONG_TYPE);
        for at in unwritten.filter(|at| self.names.nodes.get(at.node as usize).is_some_and(|node| node.is_mocked)) {
            let expected = format!("values that fit the ports of {}", path(at.node as usize));
            differs("writes", &expected, &at.failure.detail);
        }
    }

    fn is_step(&self, step: &Step, call: &MockCall) -> bool {
        let node = self.names.nodes.iter().find(|node| node.path == call.path);
        node.is_some_and(|node| node.is_called(&step.leaf)) && step.status.is_none_or(|status| status == call.status)
    }

    fn compare_trace(&self, run: &Run, trace: &[String], differences: &mut Vec<Difference>) {
        if let Some(steps) = &self.expected.trace {
            let n_common = steps.iter().zip(&run.calls).take_while(|(step, call)| self.is_step(step, call)).count();
            if n_common < steps.len().max(run.calls.len()) {
                let or_end = |text: Option<String>| text.unwrap_or_else(|| "the end".to_owned());
                differences.push(Difference {
                    what: format!("trace, item {}", n_common + 1),
                    expected: or_end(steps.get(n_common).map(Step::to_string)),
                    found: or_end(trace.get(n_common).cloned()),
                });
            }
        }
        if let Some(steps) = &self.expected.contains {
            let mut calls = run.calls.iter();
            if let Some(missing) = steps.iter().position(|step| !calls.any(|call| self.is_step(step, call))) {
                let before = missing.checked_sub(1).and_then(|before| steps.get(before));
                let before = before.map_or(String::new(), |before| format!(" after {before}"));
                differences.push(Difference {
                    what: "contains".to_owned(),
                    expected: format!("{}{before}", steps[missing]),
                    found: "none".to_owned(),
                });
            }
        }
    }

    fn compare_calls(&self, run: &Run, differences: &mut Vec<Difference>) {
        for (name, n_expected) in &self.expected.calls {
            let leaves = self.names.nodes.iter().filter(|node| node.is_mocked && node.is_called(name));
            let n_calls = |path: &str| run.calls.iter().filter(|call| call.path == path).count();
            let n_found: usize =
                leaves.map(|leaf| n_calls(&leaf.path) + usize::from(self.tree.status(leaf.id) == Status::Running)).sum();
            if n_found != *n_expected as usize {
                differences.push(Difference {
                    what: format!("calls of {name}"),
                    expected: n_expected.to_string(),
                    found: n_found.to_string(),
                });
            }
        }
    }

    fn compare_entries(&self, differences: &mut Vec<Difference>) {
        for (key, expected) in &self.expected.entries {
            let found = self.tree.literal(key);
            if !found.as_ref().is_some_and(|found| is_same(found, expected)) {
                let found = found.as_ref().map_or_else(|| "nothing that a file can give".to_owned(), crate::emit::flow);
                differences.push(Difference { what: format!("entry {key}"), expected: crate::emit::flow(expected), found });
            }
        }
    }
}

/// Equal, whole numbers and numbers alike.
fn is_same(a: &Literal, b: &Literal) -> bool {
    #[expect(clippy::cast_precision_loss, reason = "numbers of scenarios are far below 2^53")]
    let number = |literal: &Literal| match literal {
        Literal::Int(value) => Some(*value as f64),
        Literal::Float(value) => Some(*value),
        _ => None,
    };
    match (a, b) {
        (Literal::List(a), Literal::List(b)) => a.len() == b.len() && a.iter().zip(b).all(|(a, b)| is_same(a, b)),
        (Literal::Map(a), Literal::Map(b)) => {
            a.len() == b.len() && a.iter().all(|(key, a)| b.iter().any(|(other, b)| key == other && is_same(a, b)))
        }
        // The last digits of a sum are nobody's expectation.
        _ => match (number(a), number(b)) {
            (Some(a), Some(b)) => (a - b).abs() <= 1e-9 * a.abs().max(b.abs()).max(1.0),
            _ => a == b,
        },
    }
}

//! Leaves with preset results, to try out a tree without what its leaves need.

use crate::action::{Action, Halt, Tick};
use crate::blackboard;
use crate::literal::Literal;
use crate::registry::{Factory, Registry};
use crate::status::{Failure, Outcome, Progress, Status};
use crate::tree::{NodeId, Tree};
use std::borrow::Cow;
use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;

/// One activation of a mocked leaf.
#[derive(Clone, Debug, PartialEq)]
pub struct MockResult {
    /// How it ends; [`Status::Running`] never does.
    pub status: Status,
    /// Reason of a failure.
    pub reason: Cow<'static, str>,
    /// Time until then, seconds; conditions and steps take none.
    pub takes_secs: f64,
    /// Blackboard keys, as seen from the leaf's output ports, that it writes when it succeeds.
    pub writes: Vec<(String, Literal)>,
}

impl Default for MockResult {
    fn default() -> Self {
        Self { status: Status::Success, reason: Cow::Borrowed("mocked"), takes_secs: 0.0, writes: Vec::new() }
    }
}

/// The end of an activation of a mocked leaf.
#[derive(Clone, Debug, PartialEq)]
pub struct MockCall {
    /// When, seconds.
    pub now_secs: f64,
    /// The leaf's own name, or its kind.
    pub title: String,
    /// Its way from the root; of siblings with the same name the second is `lift#2`.
    pub path: String,
    /// How it ended; [`Status::Idle`] when it was halted.
    pub status: Status,
}

/// Preset results of leaves, and what was called: the context of a mocked tree.
#[derive(Debug, Default)]
pub struct Mocks {
    results: BTreeMap<String, Vec<MockResult>>,
    n_used: HashMap<NodeId, usize>,
    titles: Vec<String>,
    kinds: Vec<String>,
    paths: Vec<String>,
    calls: Vec<MockCall>,
}

impl Mocks {
    /// Results for a tree made by [`Registry::mocked`]: by path, name or kind of the leaf, the more exact first. Each
    /// activation takes the next; the last repeats. A leaf without any succeeds at once.
    #[must_use]
    pub fn new(tree: &Tree<Self>, results: BTreeMap<String, Vec<MockResult>>) -> Self {
        let (titles, kinds) = tree.definition().map(|node| (node.title, node.kind)).unzip();
        Self { results, titles, kinds, paths: tree.names().paths, ..Self::default() }
    }

    /// Activations that have ended, in order.
    #[must_use]
    pub fn calls(&self) -> &[MockCall] {
        &self.calls
    }

    fn next_result(&mut self, node: NodeId) -> MockResult {
        let names = [&self.paths, &self.titles, &self.kinds].map(|names| &names[node as usize]);
        let Some(results) = names.into_iter().find_map(|name| self.results.get(name)) else { return MockResult::default() };
        let n_used = self.n_used.entry(node).or_default();
        let result = results.get(*n_used).or(results.last()).cloned().unwrap_or_default();
        *n_used += 1;
        result
    }

    fn ended(&mut self, node: NodeId, now_secs: f64, status: Status) {
        let (title, path) = (self.titles[node as usize].clone(), self.paths[node as usize].clone());
        self.calls.push(MockCall { now_secs, title, path, status });
    }
}

impl<C> Registry<C> {
    /// The same node kinds with leaves that take their results from [`Mocks`].
    #[must_use]
    pub fn mocked(&self) -> Registry<Mocks> {
        self.with_leaves(
            || Box::new(Mocked::default()),
            |tick| {
                let result = tick.context.next_result(tick.node);
                finish(tick, &result)
            },
        )
    }

    /// The same node kinds with other leaves: actions made by `action`, conditions and steps that do `at_once`.
    pub(crate) fn with_leaves<D>(
        &self,
        action: impl Fn() -> Box<dyn Action<D>> + Send + Sync + Copy + 'static,
        at_once: impl Fn(&mut Tick<'_, D>) -> Outcome + Send + Sync + Copy + 'static,
    ) -> Registry<D> {
        let factory = |factory: &Factory<C>| match factory {
            Factory::BuiltIn(kind, children) => Factory::BuiltIn(*kind, *children),
            Factory::Action(_) => Factory::Action(Arc::new(action)),
            Factory::Condition(_) => Factory::Condition(Arc::new(move |tick: &mut Tick<'_, D>| {
                at_once(tick).map(|progress| progress == Progress::Success)
            })),
            Factory::Step(_) => Factory::Step(Arc::new(move |tick: &mut Tick<'_, D>| at_once(tick).map(|_progress| ()))),
        };
        Registry {
            models: Arc::clone(&self.models),
            factories: self.factories.iter().map(factory).collect(),
            defaults: self.defaults.clone(),
            fields: self.fields.clone(),
            entries: self.entries.clone(),
            lists: self.lists.clone(),
            forms: Arc::clone(&self.forms),
        }
    }
}

#[derive(Default)]
struct Mocked {
    result: MockResult,
    end_secs: f64,
}

impl Action<Mocks> for Mocked {
    fn start(&mut self, tick: &mut Tick<'_, Mocks>) -> Outcome {
        self.result = tick.context.next_result(tick.node);
        self.end_secs = tick.now_secs() + self.result.takes_secs;
        self.poll(tick)
    }
    fn poll(&mut self, tick: &mut Tick<'_, Mocks>) -> Outcome {
        // Rounding must not cost a tick.
        if self.result.status == Status::Running || tick.now_secs() < self.end_secs - 1e-9 {
            return Ok(Progress::Running);
        }
        finish(tick, &self.result)
    }
    fn halt(&mut self, tick: &mut Tick<'_, Mocks>) -> Halt {
        let (node, now_secs) = (tick.node, tick.now_secs());
        tick.context.ended(node, now_secs, Status::Idle);
        Halt::Done
    }
}

/// Ends the activation: writes what it writes and says how.
fn finish(tick: &mut Tick<'_, Mocks>, result: &MockResult) -> Outcome {
    let (node, now_secs) = (tick.node, tick.now_secs());
    tick.context.ended(node, now_secs, result.status);
    match result.status {
        Status::Success => {
            for (port, value) in &result.writes {
                write(tick, port, value)?;
            }
            Ok(Progress::Success)
        }
        Status::Skipped => Ok(Progress::Skipped),
        Status::Running | Status::Idle => Ok(Progress::Running),
        Status::Failure => Err(Failure::new(result.reason.clone(), "as the test says")),
    }
}

fn write(tick: &mut Tick<'_, Mocks>, port: &str, value: &Literal) -> Result<(), Failure> {
    let wrong = |message: String| Failure::new(crate::reason::WRONG_TYPE, format!("port {port:?}: {message}"));
    let Some(port_idx) = tick.ports.iter().position(|spec| spec.name == port && spec.direction.writes()) else {
        return Err(wrong("the node has no such output".to_owned()));
    };
    let Some(slot) = tick.sources[port_idx].slot() else { return Ok(()) };
    let port_type = tick.slot_types[slot as usize].as_ref();
    let value = blackboard::from_literal(value, port_type, &tick.run.forms).map_err(wrong)?;
    tick.run.put(tick.node, slot, Some(value), port_type);
    Ok(())
}

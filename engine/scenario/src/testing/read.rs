//! Reads test files: every mistake at once, each at its place.

use super::case::{End, Expected, STEP_ENDS, Step, TestCase};
use super::names::{Named, Names};
use crate::document::{Key, Node, Value};
use crate::emit;
use crate::mistake::{At, Mistake, Place, ScenarioErrors, Severity, Source};
use crate::parameters::Settings;
use crate::reader::{Fields, Reader};
use crate::scenario::{Scenario, mistake_of};
use crate::scene::Range;
use crate::schema::with_tree_reasons;
use crate::vocabulary::Vocabulary;
use sfg_tree::{Literal, MockResult, Mocks, NodeClass, NodeModel, Registry, Status, TreeSpec, reason};
use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::Arc;

pub(super) const FILE_KEYS: [&str; 5] = ["description", "scenario", "set", "tick_secs", "cases"];
pub(super) const CASE_KEYS: [&str; 6] = ["name", "leaves", "set_entries", "halt_at_secs", "until_secs", "expect"];
pub(super) const EXPECT_KEYS: [&str; 8] =
    ["status", "reason", "node", "trace", "contains", "calls", "ends_within_secs", "entries"];
/// How an activation of a leaf can be given to end; `runs` never does.
pub(super) const RESULTS: [(&str, Status); 4] =
    [("succeeds", Status::Success), ("fails", Status::Failure), ("skipped", Status::Skipped), ("runs", Status::Running)];
pub(super) const TICK_SECS: (f64, f64) = (0.001, 10.0);
pub(super) const MAX_SECS: f64 = 86_400.0;
/// Until a case has ended by then it is taken to run on.
pub(super) const UNTIL_SECS: f64 = 600.0;
/// An endless loop writes a line a tick.
const MAX_TICKS: f64 = 1e6;

/// Reads one test file.
pub(super) struct TestReader<'a, C> {
    pub(super) reader: &'a mut Reader,
    pub(super) registry: &'a Registry<C>,
    pub(super) vocabulary: &'a Vocabulary,
    /// The test file, then those of its scenario.
    pub(super) sources: &'a mut Vec<Source>,
}

/// The tree that is tested.
struct Tested {
    scenario: Scenario,
    registry: Registry<Mocks>,
    names: Arc<Names>,
}

/// The parts of a case that need no tree.
struct Draft {
    name: At<String>,
    results: BTreeMap<String, Vec<MockResult>>,
    entries: Vec<(At<String>, Literal, Place)>,
    halt_at_secs: Option<f64>,
    until_secs: f64,
    expected: Expected,
}

impl<C> TestReader<'_, C> {
    pub(super) fn file(&mut self, document: &Node) -> Option<Vec<TestCase>> {
        if matches!(document.value, Value::Null) {
            self.reader.report_with_help(Place::START, "the test file is empty", "it needs scenario, cases");
            return None;
        }
        let fields = self.reader.fields("test file", document, &FILE_KEYS)?;
        if let Some(description) = fields.get("description") {
            self.reader.text("description", description);
        }
        let tick_secs = fields.get("tick_secs").map_or(Some(0.1), |node| {
            let (min, max) = TICK_SECS;
            self.reader.number("tick_secs", node, min, max)
        });
        let tested = self.scenario(&fields);
        let cases = self.reader.required("test file", &fields, "cases")?;
        let items = self.reader.list("cases", cases)?;
        if items.is_empty() {
            self.reader.report_with_help(cases.place, "there are no cases", "write at least one: `- name: ...`");
        }
        let mut lines: BTreeMap<String, u32> = BTreeMap::new();
        let mut read = Vec::new();
        for item in items {
            let draft = self.case(item, tested.as_ref(), tick_secs);
            if let Some(draft) = &draft
                && let Some(line) = lines.insert(draft.name.value.clone(), draft.name.place.line)
            {
                let message = format!("two cases are called {:?}", draft.name.value);
                self.reader.report_with_help(draft.name.place, message, format!("the first is in line {line}"));
            }
            if let (Some(draft), Some(tested), Some(tick_secs)) = (draft, &tested, tick_secs) {
                read.extend(self.built(draft, tested, tick_secs));
            }
        }
        tested.map(|_| read)
    }

    /// The scenario, with its own mistakes as mistakes of the test.
    fn scenario(&mut self, fields: &Fields<'_>) -> Option<Tested> {
        let (settings, set_places) = self.settings(fields);
        let name = self.reader.required("test file", fields, "scenario")?;
        let name = self.reader.text("scenario", name)?;
        let own = self.sources.first().map(|source| source.path.clone()).unwrap_or_default();
        let path = own.parent().unwrap_or(Path::new("")).join(&name.value);
        let scenario = match Scenario::load(&path, &settings, self.registry, self.vocabulary) {
            Ok(scenario) => scenario,
            Err(ScenarioErrors::Unreadable { message, .. }) => {
                let help = "the path is relative to the test file";
                self.reader.report_with_help(name.place, format!("cannot read {:?}: {message}", name.value), help);
                return None;
            }
            Err(ScenarioErrors::Mistakes(findings)) => {
                let n_own = u32::try_from(self.sources.len()).unwrap_or(u32::MAX);
                self.sources.extend(findings.sources().iter().cloned());
                for mistake in findings.list().iter().filter(|mistake| mistake.severity == Severity::Error) {
                    self.reader.mistakes.push(in_test(mistake, n_own, &set_places));
                }
                return None;
            }
        };
        let registry = self.registry.mocked();
        let tree = match registry.build(&scenario.tree) {
            Ok(tree) => tree,
            // The same nodes were built with the scenario.
            Err(errors) => {
                let text = errors.first().map(ToString::to_string).unwrap_or_default();
                self.reader.report(name.place, format!("the tree cannot be built: {text}"));
                return None;
            }
        };
        let names = Arc::new(Names::of(&tree, &scenario.tree, registry.models()));
        Some(Tested { scenario, registry, names })
    }

    /// `set` as the command line would give it, and where each parameter is set.
    fn settings(&mut self, fields: &Fields<'_>) -> (Settings, BTreeMap<String, Place>) {
        let mut assignments = Vec::new();
        let mut places = BTreeMap::new();
        let entries = fields.get("set").and_then(|node| self.reader.entries("set", node)).unwrap_or_default();
        for (key, value) in entries {
            let assignment = format!("{}={}", key.text, emit::flow(&value.literal()));
            if matches!(value.value, Value::Null) {
                self.reader.wrong::<()>(&format!("parameter {:?}", key.text), value, "a value");
            } else if Settings::new(std::slice::from_ref(&assignment), []).is_err() {
                let help = "a name has letters, digits and underscores";
                self.reader.report_with_help(key.place, format!("{:?} is no name of a parameter", key.text), help);
            } else {
                assignments.push(assignment);
                places.insert(key.text.clone(), key.place);
            }
        }
        (Settings::new(&assignments, []).unwrap_or_default(), places)
    }

    fn case(&mut self, item: &Node, tested: Option<&Tested>, tick_secs: Option<f64>) -> Option<Draft> {
        let fields = self.reader.fields("case", item, &CASE_KEYS)?;
        let names = tested.map(|tested| &*tested.names);
        let name = self.reader.required("case", &fields, "name").and_then(|node| self.reader.text("name", node));
        if let Some(name) = name.as_ref().filter(|name| name.value.trim().is_empty()) {
            self.reader.report(name.place, "the case has no name; say what it shows");
        }
        let results = fields.get("leaves").map_or_else(|| Some(BTreeMap::new()), |node| self.leaves(node, tested));
        let entries = fields.get("set_entries").map_or_else(|| Some(Vec::new()), |node| self.entries("set_entries", node, names));
        let mut secs = |key: &str| fields.get(key).and_then(|node| self.reader.number(key, node, 0.0, MAX_SECS));
        let (halt_at_secs, until_secs) = (secs("halt_at_secs"), secs("until_secs").unwrap_or(UNTIL_SECS));
        if let Some(node) = fields.get("halt_at_secs")
            && halt_at_secs.is_some_and(|halt_at_secs| halt_at_secs > until_secs)
        {
            let message = format!("halt_at_secs: the case ends after {until_secs} s, before anything is halted");
            self.reader.report_with_help(node.place, message, "give `until_secs` more, or this less");
        }
        if tick_secs.is_some_and(|tick_secs| until_secs / tick_secs > MAX_TICKS) {
            let place = fields.get("until_secs").map_or(fields.place, |node| node.place);
            let message = format!("{until_secs} s are more than {MAX_TICKS} ticks");
            self.reader.report_with_help(place, message, "give `until_secs` less, or `tick_secs` more");
        }
        let expect = self.reader.required("case", &fields, "expect");
        let expected = expect.and_then(|node| self.expect(node, names, fields.get("halt_at_secs").is_some()));
        Some(Draft { name: name?, results: results?, entries: entries?, halt_at_secs, until_secs, expected: expected? })
    }

    /// The case with its tree; the entries that it sets may not fit.
    fn built(&mut self, draft: Draft, tested: &Tested, tick_secs: f64) -> Option<TestCase> {
        let Draft { name, results, entries, halt_at_secs, until_secs, expected } = draft;
        let mut spec: TreeSpec = tested.scenario.tree.clone();
        // Locations beyond those of the scenario are of the test.
        let n_places = tested.scenario.places.len();
        let mut places = vec![name.place; n_places];
        for (key, value, place) in entries {
            let location = u32::try_from(places.len()).unwrap_or(u32::MAX);
            places.push(place);
            spec.entries.retain(|(known, _, _)| *known != key.value);
            spec.entries.push((key.value, value, location));
        }
        match tested.registry.build(&spec) {
            Ok(tree) => {
                let names = Arc::clone(&tested.names);
                Some(TestCase { name, tree, names, results, tick_secs, halt_at_secs, until_secs, expected })
            }
            Err(errors) => {
                self.reader.mistakes.extend(errors.into_iter().map(|error| mistake_of(error, &places)));
                None
            }
        }
    }

    fn leaves(&mut self, node: &Node, tested: Option<&Tested>) -> Option<BTreeMap<String, Vec<MockResult>>> {
        let entries = self.reader.entries("leaves", node)?;
        let given: BTreeSet<&str> = entries.iter().map(|(key, _)| key.text.as_str()).collect();
        let mut all = BTreeMap::new();
        for (key, value) in entries {
            let leaves = tested.map(|tested| (tested, self.takers(key, &given, tested)));
            let what = format!("results of {:?}", key.text);
            // One result alone is a list of one.
            let items = match &value.value {
                Value::List(items) => items.as_slice(),
                Value::Text(_) | Value::Map(_) => std::slice::from_ref(value),
                _ => {
                    self.reader.wrong::<()>(&what, value, "a list such as `[{fails: reason}, succeeds]`");
                    continue;
                }
            };
            if items.is_empty() {
                self.reader.report(value.place, format!("{what}: the list is empty"));
            }
            // Of a name that nobody has, nothing more is said.
            let known = leaves.as_ref().filter(|(_, leaves)| !leaves.is_empty());
            let leaf = known.map(|(tested, leaves)| LeafKind::of(leaves, tested.registry.models()));
            let results: Vec<_> = items.iter().map(|item| self.result(&key.text, item, leaf.as_ref())).collect();
            if let Some(results) = results.into_iter().collect::<Option<Vec<_>>>() {
                all.insert(key.text.clone(), results);
            }
        }
        Some(all)
    }

    /// The leaves that take their results from `key`, and not from a more exact one.
    fn takers<'t>(&mut self, key: &Key, given: &BTreeSet<&str>, tested: &'t Tested) -> Vec<&'t Named> {
        let called = tested.names.leaves(self.reader, &key.text, key.place);
        let is_taker = |leaf: &&Named| leaf.names().into_iter().find(|name| given.contains(name)) == Some(&key.text);
        let takers: Vec<&Named> = called.iter().copied().filter(is_taker).collect();
        if takers.is_empty() && !called.is_empty() {
            let message = format!("nobody takes the results of {:?}: all that is called so has more exact ones", key.text);
            self.reader.report_with_help(key.place, message, "remove them");
        }
        takers
    }

    /// One activation.
    fn result(&mut self, name: &str, node: &Node, leaf: Option<&LeafKind<'_>>) -> Option<MockResult> {
        let words: Vec<String> = RESULTS.iter().map(|(word, _)| (*word).to_owned()).collect();
        let (word, place, body) = match &node.value {
            Value::Text(word) => (word, node.place, None),
            _ => {
                let what = format!("result of {name:?}");
                let (key, body) = self.reader.only(&what, node, "succeeds, fails, skipped or runs", "give each its own `- `")?;
                (&key.text, key.place, Some(body))
            }
        };
        if !self.reader.known("result", word, place, &words) {
            return None;
        }
        let status = RESULTS.iter().find(|(known, _)| known == word).map_or(Status::Success, |(_, status)| *status);
        let mut result = MockResult { status, ..MockResult::default() };
        let mut has_reason = false;
        match body.map(|body| (body, &body.value)) {
            None => {}
            Some((body, Value::Text(_))) if status == Status::Failure => {
                has_reason = true;
                result.reason = self.reason(body)?;
            }
            Some((body, _)) => {
                let known: &[&str] = match status {
                    Status::Success => &["after_secs", "writes"],
                    Status::Failure => &["reason", "after_secs"],
                    Status::Skipped => &["after_secs"],
                    _ => &[],
                };
                if known.is_empty() {
                    self.reader.report_with_help(
                        body.place,
                        format!("{word:?} is given nothing"),
                        format!("write `{word}` alone"),
                    );
                    return None;
                }
                let fields = self.reader.fields(word, body, known)?;
                if let Some(node) = fields.get("after_secs") {
                    result.takes_secs = self.reader.number("after_secs", node, 0.0, MAX_SECS)?;
                    if result.takes_secs > 0.0 && leaf.is_some_and(|leaf| leaf.is_at_once) {
                        self.at_once(name, "after_secs", node.place);
                    }
                }
                if let Some(node) = fields.get("reason") {
                    has_reason = true;
                    result.reason = self.reason(node)?;
                }
                if let Some(node) = fields.get("writes") {
                    result.writes = self.writes(name, node, leaf)?;
                }
            }
        }
        if leaf.is_some_and(|leaf| leaf.is_at_once) && matches!(status, Status::Skipped | Status::Running) {
            self.at_once(name, word, place);
        }
        match leaf {
            Some(leaf) if status == Status::Failure && !has_reason && leaf.is_condition => {
                result.reason = Cow::Borrowed(reason::CONDITION_FALSE);
            }
            Some(_) if status == Status::Failure && !has_reason => {
                self.reader.report_with_help(place, format!("{name:?} fails for no reason"), "write `fails: reason`");
            }
            _ => {}
        }
        Some(result)
    }

    fn at_once(&mut self, name: &str, word: &str, place: Place) {
        let message = format!("{word}: {name:?} is done within a tick, so it can only succeed or fail at once");
        self.reader.report(place, message);
    }

    fn reason(&mut self, node: &Node) -> Option<Cow<'static, str>> {
        let reasons = with_tree_reasons(&self.vocabulary.reasons);
        self.reader.word("failure reason", node, &reasons).map(|word| Cow::Owned(word.value))
    }

    fn writes(&mut self, name: &str, node: &Node, leaf: Option<&LeafKind<'_>>) -> Option<Vec<(String, Literal)>> {
        let mut writes = Vec::new();
        for (key, value) in self.reader.entries("writes", node)? {
            if let Some(leaf) = leaf {
                let outputs: Vec<String> = leaf.outputs.iter().map(|port| (*port).to_owned()).collect();
                if outputs.is_empty() {
                    self.reader.report(key.place, format!("{name:?} writes nothing"));
                } else {
                    self.reader.known("output port", &key.text, key.place, &outputs);
                }
            }
            if matches!(value.value, Value::Null) {
                self.reader.wrong::<()>(&format!("port {:?}", key.text), value, "a value");
            }
            writes.push((key.text.clone(), value.literal()));
        }
        Some(writes)
    }

    /// Blackboard entries with the places of their values.
    fn entries(&mut self, what: &str, node: &Node, names: Option<&Names>) -> Option<Vec<(At<String>, Literal, Place)>> {
        let mut entries = Vec::new();
        for (key, value) in self.reader.entries(what, node)? {
            if let Some(names) = names {
                names.check_key(self.reader, &key.text, key.place);
            }
            if matches!(value.value, Value::Null) {
                self.reader.wrong::<()>(&format!("entry {:?}", key.text), value, "a value");
            }
            entries.push((At { value: key.text.clone(), place: key.place }, value.literal(), value.place));
        }
        Some(entries)
    }

    fn expect(&mut self, node: &Node, names: Option<&Names>, is_halted: bool) -> Option<Expected> {
        let fields = self.reader.fields("expect", node, &EXPECT_KEYS)?;
        if matches!(&node.value, Value::Map(entries) if entries.is_empty()) {
            let message = "the case expects nothing";
            self.reader.report_with_help(fields.place, message, format!("say what is expected: {}", EXPECT_KEYS.join(", ")));
        }
        let mut expected = Expected::default();
        if let Some(node) = fields.get("status") {
            let words: Vec<String> = End::ALL.iter().map(|end| end.name().to_owned()).collect();
            let word = self.reader.word("status", node, &words)?;
            expected.end = End::ALL.into_iter().find(|end| end.name() == word.value);
            if expected.end == Some(End::Halted) && !is_halted {
                self.reader.report_with_help(node.place, "nothing halts the tree", "give the case `halt_at_secs`");
            }
        }
        for key in ["reason", "node"] {
            if let (Some(place), Some(end)) = (fields.key_place(key), expected.end)
                && end != End::Ended(Status::Failure)
            {
                self.reader.report(place, format!("{key}: only a failure has one, and the case expects {}", end.name()));
            }
        }
        expected.reason = fields.get("reason").and_then(|node| self.reason(node)).map(Cow::into_owned);
        if let Some(node) = fields.get("node") {
            let word = self.reader.text("node", node)?;
            if let Some(names) = names {
                names.check_node(self.reader, &word.value, word.place);
            }
            expected.node = Some(word.value);
        }
        expected.trace = fields.get("trace").and_then(|node| self.steps("trace", node, names));
        expected.contains = fields.get("contains").and_then(|node| self.steps("contains", node, names));
        if let Some(list) = fields.get("contains")
            && expected.contains.as_ref().is_some_and(Vec::is_empty)
        {
            self.reader.report(list.place, "contains: the list is empty");
        }
        if let Some(node) = fields.get("calls") {
            for (key, value) in self.reader.entries("calls", node)? {
                if let Some(names) = names {
                    names.leaves(self.reader, &key.text, key.place);
                }
                let count = self.reader.count("calls", value, 0, u32::MAX);
                expected.calls.extend(count.map(|count| (key.text.clone(), count)));
            }
        }
        if let Some(node) = fields.get("ends_within_secs") {
            let range = self.reader.range("ends_within_secs", node, 0.0, MAX_SECS);
            // A number alone is the latest.
            let is_alone = !matches!(node.value, Value::List(_));
            expected.ends_within_secs = range.map(|range| if is_alone { Range { min: 0.0, ..range } } else { range });
        }
        if let Some(node) = fields.get("entries") {
            let entries = self.entries("entries", node, names)?;
            expected.entries = entries.into_iter().map(|(key, value, _)| (key.value, value)).collect();
        }
        Some(expected)
    }

    /// `name`, or `name result`.
    fn steps(&mut self, what: &str, node: &Node, names: Option<&Names>) -> Option<Vec<Step>> {
        let mut steps = Vec::new();
        for item in self.reader.list(what, node)? {
            let Some(text) = self.reader.text(what, item) else { continue };
            let ended = text.value.rsplit_once(' ').map(|(leaf, word)| (leaf.trim_end(), word));
            let known = ended.and_then(|(leaf, word)| {
                STEP_ENDS.iter().find(|(name, _)| *name == word).map(|(_, status)| (leaf, Some(*status)))
            });
            let (leaf, status) = known.unwrap_or((&text.value, None));
            if let Some(names) = names {
                let is_known = names.nodes.iter().any(|node| node.is_called(leaf));
                match ended {
                    // The name is right, so the result is not.
                    Some((leaf, word)) if !is_known && names.nodes.iter().any(|node| node.is_called(leaf)) => {
                        let words: Vec<String> = STEP_ENDS.iter().map(|(name, _)| (*name).to_owned()).collect();
                        self.reader.known("result", word, text.place, &words);
                    }
                    _ => drop(names.leaves(self.reader, leaf, text.place)),
                }
            }
            steps.push(Step { leaf: leaf.to_owned(), status });
        }
        Some(steps)
    }
}

/// What the leaves of one name have in common.
struct LeafKind<'t> {
    is_at_once: bool,
    is_condition: bool,
    outputs: BTreeSet<&'t str>,
}

impl<'t> LeafKind<'t> {
    fn of(leaves: &[&Named], models: &'t [NodeModel]) -> Self {
        let is = |class: fn(NodeClass) -> bool| leaves.iter().all(|leaf| class(leaf.class));
        let model = |leaf: &&Named| models.iter().find(|model| model.name == leaf.kind);
        let ports = leaves.iter().filter_map(model).flat_map(|model| &model.ports);
        Self {
            is_at_once: is(|class| class != NodeClass::Action),
            is_condition: is(|class| class == NodeClass::Condition),
            outputs: ports.filter(|port| port.direction().writes()).map(|port| port.name()).collect(),
        }
    }
}

/// A mistake of the scenario as one of the test; what is wrong with a parameter is shown where the test sets it.
fn in_test(mistake: &Mistake, n_own: u32, set_places: &BTreeMap<String, Place>) -> Mistake {
    let set = mistake.message.strip_prefix("--set ").and_then(|rest| rest.split_once(": "));
    match set.and_then(|(name, message)| Some((set_places.get(name)?, message))) {
        Some((place, message)) => Mistake { place: *place, message: message.to_owned(), ..mistake.clone() },
        None => Mistake { place: Place { file: mistake.place.file + n_own, ..mistake.place }, ..mistake.clone() },
    }
}

//! From a [`TreeSpec`] to a [`Tree`]: nodes, scopes and slots. What ports mean to each other is checked in [`crate::check`].

use crate::blackboard::{Slot, Source};
use crate::check::{Board, Use};
use crate::literal::Literal;
use crate::nearest::nearest;
use crate::port::{Direction, PortSpec};
use crate::problem::{BuildError, Problem};
use crate::registry::{Factory, NodeClass, NodeModel, Registry};
use crate::spec::{NodeKind, NodeSpec, PortSetting, PortValue, SubtreeSpec, TreeSpec};
use crate::status::Status;
use crate::tree::{Kind, Leaf, NONE, Node, NodeId, Runtime, Tree};
use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

/// Recursion while ticking stays within any thread's stack.
const MAX_DEPTH: usize = 256;
/// Ten subtrees that each use the next ten times would need 10^10 nodes.
const MAX_NODES: usize = 1_000_000;

/// Models of the nodes that every registry has, in the order of their documentation.
pub(crate) fn built_in_models() -> Vec<NodeModel> {
    let control = |name, ports, doc| model(name, NodeClass::Control, ports, doc);
    let decorator = |name, ports, doc| model(name, NodeClass::Decorator, ports, doc);
    let at_least_one = |name, doc| PortSpec::setting::<u32>(name).range(1.0, f64::INFINITY).doc(doc);
    vec![
        control("sequence", vec![], "Does its children one after the other until one fails."),
        control("fallback", vec![], "Tries its children one after the other until one succeeds."),
        control("reactive_sequence", vec![], "A sequence that begins with its first child on every tick."),
        control("reactive_fallback", vec![], "A fallback that begins with its first child on every tick."),
        control(
            "parallel",
            vec![
                at_least_one("success", "Successes needed; all children when not given.").optional(),
                at_least_one("failure", "Failures accepted as the end.").default_value(1),
            ],
            "Ticks all its children on every tick.",
        ),
        decorator(
            "retry",
            vec![
                at_least_one("attempts", "How often the child is tried."),
                PortSpec::setting::<Vec<String>>("on")
                    .default_value(Literal::List(vec![]))
                    .doc("Reasons to try again; any when empty."),
            ],
            "Tries its child again when it fails.",
        ),
        decorator(
            "repeat",
            vec![at_least_one("times", "Rounds; endless when not given.").optional()],
            "Does its child again and again.",
        ),
        decorator(
            "timeout",
            vec![PortSpec::setting::<f64>("secs").range(0.001, f64::INFINITY).doc("Time for the child, seconds.")],
            "Halts its child and fails when it takes too long.",
        ),
        decorator("inverter", vec![], "Succeeds when its child fails and fails when it succeeds."),
        decorator("force_success", vec![], "Succeeds whatever its child does."),
        decorator("force_failure", vec![], "Fails whatever its child does."),
    ]
}

fn model(name: &'static str, class: NodeClass, ports: Vec<PortSpec>, doc: &'static str) -> NodeModel {
    NodeModel { name: Cow::Borrowed(name), class, ports, doc: Cow::Borrowed(doc) }
}

fn kind_of(name: &str) -> Kind {
    match name {
        "sequence" => Kind::Sequence,
        "fallback" => Kind::Fallback,
        "reactive_sequence" => Kind::ReactiveSequence,
        "reactive_fallback" => Kind::ReactiveFallback,
        "parallel" => Kind::Parallel,
        "retry" => Kind::Retry,
        "repeat" => Kind::Repeat,
        "timeout" => Kind::Timeout,
        "inverter" => Kind::Inverter,
        "force_success" => Kind::ForceSuccess,
        "force_failure" => Kind::ForceFailure,
        _ => Kind::Leaf,
    }
}

/// The keys that nodes of one tree or subtree see.
#[derive(Default)]
struct Scope {
    path: String,
    keys: BTreeMap<String, u32>,
    read_only: BTreeSet<String>,
}

struct Builder<'a, C> {
    registry: &'a Registry<C>,
    spec: &'a TreeSpec,
    names: BTreeMap<&'a str, usize>,
    subtrees: BTreeMap<&'a str, &'a SubtreeSpec>,
    tree: Tree<C>,
    board: Board<'a>,
    errors: Vec<BuildError>,
    /// Subtrees around the current node.
    open: Vec<&'a str>,
    used: BTreeSet<&'a str>,
    depth: usize,
    is_full: bool,
}

pub(crate) fn build<C>(registry: &Registry<C>, spec: &TreeSpec) -> Result<Tree<C>, Vec<BuildError>> {
    let mut builder = Builder::new(registry, spec);
    let mut scope = Scope::default();
    for (key, port_type) in &registry.entries {
        let slot = builder.slot(&mut scope, key);
        builder.board.provide(slot, port_type.clone());
    }
    for (key, literal, location) in &spec.entries {
        let slot = builder.slot(&mut scope, key);
        builder.board.start_with(slot, literal, *location, key);
    }
    builder.node(&spec.root, NONE, &mut scope);
    builder.check_unused_subtrees();
    builder.finish(scope)
}

impl<'a, C> Builder<'a, C> {
    fn new(registry: &'a Registry<C>, spec: &'a TreeSpec) -> Self {
        let tree = Tree {
            nodes: Vec::new(),
            children: Vec::new(),
            sources: Vec::new(),
            leaves: Vec::new(),
            models: registry.models.clone(),
            titles: BTreeMap::new(),
            locations: Vec::new(),
            slot_keys: Vec::new(),
            slot_types: Vec::new(),
            root_keys: BTreeMap::new(),
            run: Runtime::new(Vec::new()),
        };
        let names = registry.models.iter().enumerate().map(|(model_idx, model)| (&*model.name, model_idx)).collect();
        let (mut subtrees, mut errors) = (BTreeMap::new(), Vec::new());
        for subtree in &spec.subtrees {
            if subtrees.insert(subtree.name.as_str(), subtree).is_some() {
                let problem = Problem::DuplicateSubtree { name: subtree.name.clone() };
                errors.push(BuildError { location: subtree.location, path: subtree.name.clone(), problem, help: None });
            }
        }
        let (board, open, used) = (Board::default(), Vec::new(), BTreeSet::new());
        Self { registry, spec, names, subtrees, tree, board, errors, open, used, depth: 0, is_full: false }
    }

    fn error(&mut self, location: u32, id: NodeId, problem: Problem, help: Option<String>) {
        let path = if id == NONE { String::new() } else { self.tree.path(id) };
        self.errors.push(BuildError { location, path, problem, help });
    }

    /// The slot of `key`, new if the scope does not know it.
    fn slot(&mut self, scope: &mut Scope, key: &str) -> u32 {
        if let Some(&slot) = scope.keys.get(key) {
            return slot;
        }
        let slot = self.board.add_slot();
        self.tree.slot_keys.push(if scope.path.is_empty() { key.to_owned() } else { format!("{}:{key}", scope.path) });
        scope.keys.insert(key.to_owned(), slot);
        slot
    }

    fn node(&mut self, spec: &'a NodeSpec, parent: NodeId, scope: &mut Scope) -> NodeId {
        let id = u32::try_from(self.tree.nodes.len()).unwrap_or(NONE);
        if self.depth >= MAX_DEPTH {
            self.error(spec.location, parent, Problem::TooDeep { limit: MAX_DEPTH }, None);
            self.is_full = true;
        } else if self.tree.nodes.len() >= MAX_NODES {
            self.error(spec.location, parent, Problem::TooLarge { limit: MAX_NODES }, None);
            self.is_full = true;
        }
        if self.is_full {
            return NONE;
        }
        self.depth += 1;
        match &spec.kind {
            NodeKind::Named(name) => self.named(spec, name, id, parent, scope),
            NodeKind::Subtree(name) => self.subtree(spec, name, id, parent, scope),
        }
        self.depth -= 1;
        id
    }

    fn push(&mut self, spec: &NodeSpec, title: Option<&str>, kind: Kind, model: u32, parent: NodeId, n_children: usize) {
        let id = self.tree.nodes.len();
        let (first_child, first_source) = (self.tree.children.len(), self.tree.sources.len());
        self.tree.children.resize(first_child + n_children, NONE);
        self.tree.nodes.push(Node {
            kind,
            status: Status::Idle,
            model,
            parent,
            first_child: index(first_child),
            n_children: index(n_children),
            first_source: index(first_source),
            leaf: NONE,
            cursor: 0,
            count: 0,
            n_failed: 0,
            limit: NONE,
            deadline_secs: 0.0,
        });
        self.tree.locations.push(spec.location);
        if let Some(title) = title {
            self.tree.titles.insert(index(id), title.to_owned());
        }
    }

    fn named(&mut self, spec: &'a NodeSpec, name: &str, id: NodeId, parent: NodeId, scope: &mut Scope) {
        let Some(&model_idx) = self.names.get(name) else {
            self.push(spec, Some(spec.title.as_deref().unwrap_or(name)), Kind::Sequence, 0, parent, spec.children.len());
            let help = nearest(name, self.names.keys().copied()).map(|near| format!("did you mean {near:?}?"));
            self.error(spec.location, id, Problem::UnknownNode { name: name.to_owned() }, help);
            return self.children(spec, id, scope);
        };
        let model = &self.registry.models[model_idx];
        self.push(spec, spec.title.as_deref(), kind_of(name), index(model_idx), parent, spec.children.len());
        let (fits, expected) = match model.class {
            NodeClass::Control => (!spec.children.is_empty(), "at least one child"),
            NodeClass::Decorator => (spec.children.len() == 1, "exactly one child"),
            _ => (spec.children.is_empty(), "no children"),
        };
        if !fits {
            let problem = Problem::ChildCount { kind: name.to_owned(), expected, n_found: spec.children.len() };
            self.error(spec.location, id, problem, None);
        }
        self.ports(spec, model_idx, id, scope);
        let leaf = match &self.registry.factories[model_idx] {
            Factory::BuiltIn => None,
            Factory::Action(make) => Some(Leaf::Action(make())),
            Factory::Condition(holds) => Some(Leaf::Condition(Arc::clone(holds))),
            Factory::Step(run) => Some(Leaf::Step(Arc::clone(run))),
        };
        if let Some(leaf) = leaf {
            self.tree.nodes[id as usize].leaf = index(self.tree.leaves.len());
            self.tree.leaves.push(leaf);
        }
        self.children(spec, id, scope);
    }

    fn children(&mut self, spec: &'a NodeSpec, id: NodeId, scope: &mut Scope) {
        let first_child = self.tree.nodes[id as usize].first_child as usize;
        for (child_idx, child) in spec.children.iter().enumerate() {
            self.tree.children[first_child + child_idx] = self.node(child, id, scope);
        }
    }

    fn ports(&mut self, spec: &'a NodeSpec, model_idx: usize, id: NodeId, scope: &mut Scope) {
        let model = &self.registry.models[model_idx];
        if !spec.ports.is_empty() {
            let known: Vec<&str> = model.ports.iter().map(PortSpec::name).collect();
            self.unknown_ports(spec, &model.name, &known, id);
        }
        for (port_idx, port) in model.ports.iter().enumerate() {
            let given = spec.ports.iter().find(|setting| setting.name == port.name);
            let source = match given.map(|setting| (&setting.value, setting.location)) {
                Some((PortValue::Literal(literal), location)) => self.literal(port, literal, id, location),
                Some((PortValue::Key(key), location)) => self.key(port, key, id, location, scope),
                None => match (&port.default_key, &self.registry.defaults[model_idx][port_idx]) {
                    (Some(key), _) => self.key(port, key, id, spec.location, scope),
                    (None, Some(value)) => Source::Literal(Arc::clone(value)),
                    (None, None) if port.required => {
                        let expected = port.port_type.shape.as_ref().map_or("a blackboard key".to_owned(), ToString::to_string);
                        let (kind, port) = (model.name.to_string(), port.name.to_string());
                        self.error(spec.location, id, Problem::MissingPort { kind, port, expected }, None);
                        Source::Unset
                    }
                    (None, None) => Source::Unset,
                },
            };
            self.tree.sources.push(source);
        }
    }

    fn unknown_ports(&mut self, spec: &'a NodeSpec, kind: &str, known: &[&str], id: NodeId) {
        for (setting_idx, setting) in spec.ports.iter().enumerate() {
            if !known.contains(&setting.name.as_str()) {
                let help = match nearest(&setting.name, known.iter().copied()) {
                    Some(near) => format!("did you mean {near:?}?"),
                    None if known.is_empty() => "it has no ports".to_owned(),
                    None => format!("its ports are {}", known.join(", ")),
                };
                let problem = Problem::UnknownPort { kind: kind.to_owned(), port: setting.name.clone() };
                self.error(setting.name_location, id, problem, Some(help));
            } else if spec.ports[..setting_idx].iter().any(|earlier| earlier.name == setting.name) {
                self.error(setting.name_location, id, Problem::DuplicatePort { port: setting.name.clone() }, None);
            }
        }
    }

    fn literal(&mut self, port: &PortSpec, literal: &Literal, id: NodeId, location: u32) -> Source {
        let name = port.name.to_string();
        if port.direction.writes() {
            self.error(location, id, Problem::OutputNeedsKey { port: name }, None);
            return Source::Unset;
        }
        match port.value_of(literal) {
            Ok(value) => Source::Literal(value),
            Err(message) => {
                let help = port.doc_text();
                let help = (!help.is_empty()).then(|| help.to_owned());
                self.error(location, id, Problem::BadLiteral { port: name, message }, help);
                Source::Unset
            }
        }
    }

    fn key(&mut self, port: &'a PortSpec, key: &'a str, id: NodeId, location: u32, scope: &mut Scope) -> Source {
        let mut words = key.split('.');
        let base = words.next().unwrap_or(key);
        let fields: Vec<String> = words.map(str::to_owned).collect();
        if port.direction.writes() && (scope.read_only.contains(base) || !fields.is_empty()) {
            let problem = Problem::ReadOnlyKey { port: port.name.to_string(), key: key.to_owned() };
            let help = if fields.is_empty() {
                "declare it under `out` or `inout`, or write another key"
            } else {
                "a field of an entry cannot be written"
            };
            self.error(location, id, problem, Some(help.to_owned()));
        }
        let slot = self.slot(scope, base);
        let source_idx = self.tree.sources.len();
        self.board.uses.push(Use { slot, port, fields, node: id, location, key, source_idx });
        Source::Slot(slot)
    }

    fn subtree(&mut self, spec: &'a NodeSpec, name: &'a str, id: NodeId, parent: NodeId, scope: &mut Scope) {
        self.push(spec, Some(spec.title.as_deref().unwrap_or(name)), Kind::Subtree, NONE, parent, 1);
        let Some(&subtree) = self.subtrees.get(name) else {
            let help = match nearest(name, self.subtrees.keys().copied()) {
                Some(near) => format!("did you mean {near:?}?"),
                None if self.subtrees.is_empty() => "no subtree is defined".to_owned(),
                None => format!("defined are {}", self.subtrees.keys().copied().collect::<Vec<_>>().join(", ")),
            };
            return self.error(spec.location, id, Problem::UnknownSubtree { name: name.to_owned() }, Some(help));
        };
        self.used.insert(name);
        if self.open.contains(&name) {
            let chain = self.open.iter().chain([&name]).copied().collect::<Vec<_>>().join(" -> ");
            return self.error(spec.location, id, Problem::RecursiveSubtree { name: name.to_owned(), chain }, None);
        }
        let known: Vec<&str> = subtree.ports.iter().map(|port| port.name.as_str()).collect();
        self.unknown_ports(spec, name, &known, id);
        let mut inner = Scope { path: self.tree.path(id), ..Scope::default() };
        for port in &subtree.ports {
            let setting = spec.ports.iter().find(|setting| setting.name == port.name);
            if port.direction == Direction::In {
                inner.read_only.insert(port.name.clone());
            }
            match (setting, &port.default) {
                (Some(PortSetting { value: PortValue::Key(key), location, .. }), _) if key.contains('.') => {
                    let problem = Problem::BadLiteral {
                        port: port.name.clone(),
                        message: "a field cannot be a port of a subtree".to_owned(),
                    };
                    self.error(*location, id, problem, Some("pass the whole value and name the field inside".to_owned()));
                }
                (Some(PortSetting { value: PortValue::Key(key), .. }), _) => {
                    let slot = self.slot(scope, key);
                    inner.keys.insert(port.name.clone(), slot);
                }
                (Some(PortSetting { value: PortValue::Literal(literal), location, .. }), _) => {
                    if port.direction.writes() {
                        self.error(*location, id, Problem::OutputNeedsKey { port: port.name.clone() }, None);
                    }
                    let slot = self.slot(&mut inner, &port.name);
                    self.board.start_with(slot, literal, *location, &port.name);
                }
                (None, Some(literal)) => {
                    let slot = self.slot(&mut inner, &port.name);
                    self.board.start_with(slot, literal, port.location, &port.name);
                }
                (None, None) => {
                    let slot = self.slot(scope, &port.name);
                    inner.keys.insert(port.name.clone(), slot);
                }
            }
        }
        self.open.push(name);
        let child = self.node(&subtree.root, id, &mut inner);
        self.open.pop();
        let first_child = self.tree.nodes[id as usize].first_child as usize;
        self.tree.children[first_child] = child;
    }

    /// A subtree that nobody uses yet is still checked, with its inputs taken as given.
    fn check_unused_subtrees(&mut self) {
        for subtree in &self.spec.subtrees {
            if self.used.contains(subtree.name.as_str()) || self.is_full {
                continue;
            }
            let mut scope = Scope { path: subtree.name.clone(), ..Scope::default() };
            for port in &subtree.ports {
                let slot = self.slot(&mut scope, &port.name);
                if port.direction.reads() {
                    self.board.assume(slot);
                }
            }
            self.open.push(&subtree.name);
            // Its nodes are forgotten: any error keeps the tree from being made, and without one they are cut off below.
            let n_nodes = self.tree.nodes.len();
            self.node(&subtree.root, NONE, &mut scope);
            self.board.n_kept_nodes.get_or_insert(n_nodes);
            self.open.pop();
        }
    }

    fn finish(mut self, scope: Scope) -> Result<Tree<C>, Vec<BuildError>> {
        if !self.is_full {
            let (board, registry) = (&mut self.board, self.registry);
            self.errors.extend(board.check(&mut self.tree, &registry.fields));
        }
        if !self.errors.is_empty() {
            let mut seen = BTreeSet::new();
            self.errors.retain(|error| seen.insert((error.location, error.problem.to_string())));
            self.errors.sort_by_key(|error| error.location);
            return Err(self.errors);
        }
        if let Some(n_nodes) = self.board.n_kept_nodes {
            self.tree.nodes.truncate(n_nodes);
            self.tree.locations.truncate(n_nodes);
        }
        self.tree.root_keys = scope.keys;
        Ok(self.tree)
    }
}

#[expect(clippy::cast_possible_truncation, reason = "bounded by MAX_NODES times the ports of a node")]
fn index(count: usize) -> u32 {
    count as u32
}

impl Slot {
    pub(crate) fn with(value: Option<crate::port::Value>) -> Self {
        Self { value }
    }
}

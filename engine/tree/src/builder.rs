//! From a [`TreeSpec`] to a [`Tree`]: nodes, scopes and slots. What ports mean to each other is checked in [`crate::check`].

use crate::blackboard::Source;
use crate::check::{Board, Use};
use crate::condition::{Conditions, Script};
use crate::leaf::{Leaf, LeafKind, Parts};
use crate::literal::Literal;
use crate::models::Children;
use crate::nearest::nearest;
use crate::port::{Direction, PortSpec};
use crate::problem::{BuildError, Problem};
use crate::registry::{Factory, Footprint, Registry};
use crate::script;
use crate::spec::{NodeKind, NodeSpec, PortSetting, PortValue, SubtreeSpec, TreeSpec, When};
use crate::status::Status;
use crate::tree::{Kind, NONE, Node, NodeId, Runtime, Tree};
use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::sync::{Arc, LazyLock};

/// Recursion while ticking stays within any thread's stack.
const MAX_DEPTH: usize = 256;
/// Ten subtrees that each use the next ten times would need 10^10 nodes.
const MAX_NODES: usize = 1_000_000;

/// The port of a name that a script reads.
static SCRIPT_IN: LazyLock<PortSpec> = LazyLock::new(|| PortSpec::any_key("script", Direction::In));
/// The port of a name that a script writes.
static SCRIPT_OUT: LazyLock<PortSpec> = LazyLock::new(|| PortSpec::any_key("script", Direction::Out));

/// The keys that nodes of one tree or subtree see. Scopes stand in [`Builder::scopes`], the root's first.
#[derive(Default)]
struct Scope {
    path: String,
    keys: HashMap<String, u32>,
    read_only: BTreeSet<String>,
    /// The scope that keys come from which are not connected.
    automatic: Option<usize>,
}

/// The scope of the main tree.
const ROOT: usize = 0;

struct Builder<'a, C> {
    registry: &'a Registry<C>,
    spec: &'a TreeSpec,
    names: HashMap<&'a str, usize>,
    subtrees: BTreeMap<&'a str, &'a SubtreeSpec>,
    tree: Tree<C>,
    board: Board<'a>,
    errors: Vec<BuildError>,
    scopes: Vec<Scope>,
    /// Names of footprints, one bit each.
    parts: Vec<String>,
    /// Subtrees around the current node.
    open: Vec<&'a str>,
    used: BTreeSet<&'a str>,
    depth: usize,
    is_full: bool,
}

pub(crate) fn build<C>(registry: &Registry<C>, spec: &TreeSpec) -> Result<Tree<C>, Vec<BuildError>> {
    let mut builder = Builder::new(registry, spec);
    let (n_nodes, n_ports) = size_of(&spec.root);
    let (n_nodes, n_ports) = (n_nodes.min(MAX_NODES), n_ports.min(MAX_NODES));
    builder.tree.nodes.reserve(n_nodes);
    builder.tree.locations.reserve(n_nodes);
    builder.tree.children.reserve(n_nodes);
    builder.tree.sources.reserve(n_ports);
    builder.board.uses.reserve(n_ports);
    builder.board.allows_unwritten = spec.allows_unwritten_keys;
    builder.board.has_untyped_texts = spec.has_untyped_texts;
    for (key, port_type) in &registry.entries {
        let slot = builder.slot(ROOT, key);
        builder.board.provide(slot, port_type.clone());
    }
    for (key, literal, location) in &spec.entries {
        let slot = builder.slot(ROOT, key);
        builder.board.start_with(slot, literal, *location, key);
    }
    builder.node(&spec.root, NONE, ROOT);
    builder.check_unused_subtrees();
    builder.finish()
}

impl<'a, C> Builder<'a, C> {
    fn new(registry: &'a Registry<C>, spec: &'a TreeSpec) -> Self {
        let tree = Tree {
            nodes: Vec::new(),
            children: Vec::new(),
            sources: Vec::new(),
            leaves: Vec::new(),
            scripts: Vec::new(),
            conditions: Vec::new(),
            lists: registry.lists.clone(),
            models: Arc::clone(&registry.models),
            titles: BTreeMap::new(),
            locations: Vec::new(),
            slot_keys: Vec::new(),
            slot_types: Vec::new(),
            root_keys: BTreeMap::new(),
            kept: BTreeMap::new(),
            run: Runtime { forms: Arc::clone(&registry.forms), ..Runtime::default() },
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
        let (scopes, parts) = (vec![Scope::default()], Vec::new());
        Self { registry, spec, names, subtrees, tree, board, errors, scopes, parts, open, used, depth: 0, is_full: false }
    }

    fn error(&mut self, location: u32, id: NodeId, problem: Problem, help: Option<String>) {
        let path = if id == NONE { String::new() } else { self.tree.path(id) };
        self.errors.push(BuildError { location, path, problem, help });
    }

    /// The slot of `key`, new if the scope does not know it.
    fn slot(&mut self, scope: usize, key: &str) -> u32 {
        if let Some(key) = key.strip_prefix('@') {
            return self.slot(ROOT, key);
        }
        if let Some(&slot) = self.scopes[scope].keys.get(key) {
            return slot;
        }
        let slot = match self.scopes[scope].automatic {
            Some(outer) if !key.starts_with('_') => self.slot(outer, key),
            _ => {
                let path = &self.scopes[scope].path;
                self.tree.slot_keys.push(if path.is_empty() { key.to_owned() } else { format!("{path}:{key}") });
                self.board.add_slot()
            }
        };
        self.scopes[scope].keys.insert(key.to_owned(), slot);
        slot
    }

    /// A new scope inside another.
    fn add_scope(&mut self, scope: Scope) -> usize {
        self.scopes.push(scope);
        self.scopes.len() - 1
    }

    fn node(&mut self, spec: &'a NodeSpec, parent: NodeId, scope: usize) -> NodeId {
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
            conditions: NONE,
            flags: 0,
            cursor: 0,
            count: 0,
            n_failed: 0,
            deadline_secs: 0.0,
            seen: 0,
        });
        self.tree.locations.push(spec.location);
        if let Some(title) = title {
            self.tree.titles.insert(index(id), title.to_owned());
        }
    }

    fn named(&mut self, spec: &'a NodeSpec, name: &str, id: NodeId, parent: NodeId, scope: usize) {
        let Some(&model_idx) = self.names.get(name) else {
            self.push(spec, Some(spec.title.as_deref().unwrap_or(name)), Kind::Sequence, 0, parent, spec.children.len());
            let help = nearest(name, self.registry.models.iter().map(|model| &*model.name))
                .map(|near| format!("did you mean {near:?}?"));
            self.error(spec.location, id, Problem::UnknownNode { name: name.to_owned() }, help);
            return self.children(spec, id, scope);
        };
        let model = &self.registry.models[model_idx];
        let (kind, children) = match &self.registry.factories[model_idx] {
            Factory::BuiltIn(kind, children) => (*kind, *children),
            _ => (Kind::Leaf, Children::None),
        };
        self.push(spec, spec.title.as_deref(), kind, index(model_idx), parent, spec.children.len());
        self.check_children(spec, name, children, id);
        self.conditions(spec, id, scope, true);
        self.tree.nodes[id as usize].first_source = index(self.tree.sources.len());
        self.ports(spec, model_idx, id, scope);
        self.scripts_of_ports(spec, kind, id, scope);
        let leaf = match &self.registry.factories[model_idx] {
            Factory::BuiltIn(..) => None,
            Factory::Action(make) => Some(LeafKind::Action(make())),
            Factory::Condition(holds) => Some(LeafKind::Condition(Arc::clone(holds))),
            Factory::Step(run) => Some(LeafKind::Step(Arc::clone(run))),
        };
        if let Some(kind) = leaf {
            self.tree.nodes[id as usize].leaf = index(self.tree.leaves.len());
            let parts = self.parts_of(&model.footprint);
            self.tree.leaves.push(Leaf { kind, parts });
        }
        self.children(spec, id, scope);
        self.conditions(spec, id, scope, false);
    }

    fn check_children(&mut self, spec: &'a NodeSpec, name: &str, children: Children, id: NodeId) {
        let n_found = spec.children.len();
        // The children of these stand beside a list of the same length.
        let items = |port: &str| match spec.ports.iter().find(|setting| setting.name == port).map(|setting| &setting.value) {
            Some(PortValue::Literal(Literal::List(items))) => items.len() + 1,
            _ => n_found.max(1),
        };
        let (fits, expected) = match children {
            Children::None => (n_found == 0, "no children".to_owned()),
            Children::One => (n_found == 1, "exactly one child".to_owned()),
            Children::AtLeast(1) => (n_found >= 1, "at least one child".to_owned()),
            Children::AtLeast(n) => (n_found >= n, format!("at least {n} children")),
            Children::TwoOrThree => (n_found == 2 || n_found == 3, "two or three children".to_owned()),
            Children::OneMoreThanCases => {
                (n_found == items("cases"), format!("{} children: one for each case and one more", items("cases")))
            }
            Children::OneMoreThanReasons => {
                (n_found == items("on"), format!("{} children: what is done and one for each reason", items("on")))
            }
        };
        if !fits {
            let problem = Problem::ChildCount { kind: name.to_owned(), expected, n_found };
            self.error(spec.location, id, problem, None);
        }
    }

    /// Compiles the pre-conditions (`before`) or the post-conditions of a node.
    fn conditions(&mut self, spec: &'a NodeSpec, id: NodeId, scope: usize, before: bool) {
        for (condition_idx, condition) in spec.conditions.iter().enumerate() {
            let is_condition = condition.when <= When::While;
            if is_condition != before {
                continue;
            }
            if spec.conditions[..condition_idx].iter().any(|earlier| earlier.when == condition.when) {
                let port = condition.when.name().to_owned();
                self.error(condition.location, id, Problem::DuplicatePort { port }, None);
                continue;
            }
            let script = self.script(condition.when.name(), &condition.script, is_condition, id, condition.location, scope);
            if self.tree.nodes[id as usize].conditions == NONE {
                self.tree.nodes[id as usize].conditions = index(self.tree.conditions.len());
                self.tree.conditions.push(Conditions::default());
            }
            let conditions_idx = self.tree.nodes[id as usize].conditions as usize;
            self.tree.conditions[conditions_idx].0[condition.when as usize] = script;
        }
    }

    /// Compiles the script that a built-in node has in a port.
    fn scripts_of_ports(&mut self, spec: &'a NodeSpec, kind: Kind, id: NodeId, scope: usize) {
        let (port, is_condition) = match kind {
            Kind::Script => ("code", false),
            Kind::ScriptCondition => ("code", true),
            Kind::Precondition => ("if", true),
            _ => return,
        };
        let Some(setting) = spec.ports.iter().find(|setting| setting.name == port) else { return };
        match &setting.value {
            PortValue::Literal(Literal::Text(text)) => {
                let script = self.script(port, text, is_condition, id, setting.location, scope);
                self.tree.nodes[id as usize].leaf = script.unwrap_or(NONE);
            }
            PortValue::Literal(Literal::Bool(value)) if is_condition => {
                let text = if *value { "true" } else { "false" };
                let script = self.script(port, text, is_condition, id, setting.location, scope);
                self.tree.nodes[id as usize].leaf = script.unwrap_or(NONE);
            }
            PortValue::Literal(_) => {}
            PortValue::Key(_) => {
                let problem = Problem::BadLiteral {
                    port: port.to_owned(),
                    message: "expected a script, found a blackboard key".to_owned(),
                };
                self.error(setting.location, id, problem, Some("scripts are read when the tree is built".to_owned()));
            }
        }
    }

    /// Compiles a script; its names become sources one after the other.
    fn script(
        &mut self,
        label: &'static str,
        text: &'a str,
        is_condition: bool,
        id: NodeId,
        location: u32,
        scope: usize,
    ) -> Option<u32> {
        let parsed = match script::parse(text, is_condition) {
            Ok(parsed) => parsed,
            Err(error) => {
                let shown = text.get(error.at.clone()).unwrap_or("").chars().take(40).collect::<String>();
                let column = text[..error.at.start.min(text.len())].chars().count() + 1;
                let near = if shown.trim().is_empty() { String::new() } else { format!(" ({shown:?})") };
                let message = format!("{}, at letter {column}{near}", error.message);
                self.error(location, id, Problem::BadLiteral { port: label.to_owned(), message }, None);
                return None;
            }
        };
        let first_source = index(self.tree.sources.len());
        for name in &parsed.names {
            let mut words = name.key.split('.');
            let base = words.next().unwrap_or(&name.key);
            let fields: Vec<String> = words.map(str::to_owned).collect();
            if name.is_written && self.scopes[scope].read_only.contains(base) {
                let problem = Problem::ReadOnlyKey { port: label.to_owned(), key: base.to_owned() };
                let help = "declare it under `out` or `inout`, or write another key";
                self.error(location, id, problem, Some(help.to_owned()));
            }
            let slot = self.slot(scope, base);
            let source_idx = self.tree.sources.len();
            let directions: &[&'static LazyLock<PortSpec>] = match (name.is_read, name.is_written) {
                (true, true) => &[&SCRIPT_IN, &SCRIPT_OUT],
                (false, true) => &[&SCRIPT_OUT],
                _ => &[&SCRIPT_IN],
            };
            for port in directions {
                let (key, fields) = (Cow::Owned(name.key.clone()), fields.clone());
                self.board.uses.push(Use { slot, port, label, fields, node: id, location, key, source_idx });
            }
            self.tree.sources.push(Source::Slot(slot));
        }
        self.tree.scripts.push(Script { statements: parsed.statements, first_source });
        Some(index(self.tree.scripts.len() - 1))
    }

    /// The bits of a footprint.
    fn parts_of(&mut self, footprint: &Footprint) -> Parts {
        let Footprint::Parts(names) = footprint else { return Parts::UNDECLARED };
        let mut bits = 0;
        for name in names {
            let part_idx = self.parts.iter().position(|known| known == name).unwrap_or_else(|| {
                self.parts.push(name.to_string());
                self.parts.len() - 1
            });
            // More names than bits: the last bit stands for all others, which only holds back more.
            bits |= 1 << part_idx.min(63);
        }
        Parts::named(bits)
    }

    fn children(&mut self, spec: &'a NodeSpec, id: NodeId, scope: usize) {
        let first_child = self.tree.nodes[id as usize].first_child as usize;
        for (child_idx, child) in spec.children.iter().enumerate() {
            self.tree.children[first_child + child_idx] = self.node(child, id, scope);
        }
    }

    fn ports(&mut self, spec: &'a NodeSpec, model_idx: usize, id: NodeId, scope: usize) {
        let model = &self.registry.models[model_idx];
        let is_known = |setting: &PortSetting| model.ports.iter().any(|port| port.name == setting.name);
        if spec.ports.len() > model.ports.len() || !spec.ports.iter().all(is_known) || has_twice(&spec.ports) {
            let known: Vec<&str> = model.ports.iter().map(PortSpec::name).collect();
            self.unknown_ports(spec, &model.name, &known, id);
        }
        for (port_idx, port) in model.ports.iter().enumerate() {
            let given = spec.ports.iter().find(|setting| setting.name == port.name);
            let source = match given.map(|setting| (&setting.value, setting.location)) {
                Some((PortValue::Literal(literal), location)) => self.literal(port, literal, id, location, scope),
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

    fn literal(&mut self, port: &'a PortSpec, literal: &'a Literal, id: NodeId, location: u32, scope: usize) -> Source {
        let name = port.name.to_string();
        // Other formats write `output_key="x"` for the key x.
        if let Literal::Text(key) = literal
            && self.spec.has_untyped_texts
            && port.port_type.is_any()
            && port.port_type.convert.is_none()
        {
            return self.key(port, key, id, location, scope);
        }
        if port.direction.writes() {
            self.error(location, id, Problem::OutputNeedsKey { port: name }, None);
            return Source::Unset;
        }
        let value = match literal {
            Literal::Text(text) if self.spec.has_untyped_texts => port.value_of_text(text),
            _ => port.value_of(literal),
        };
        match value {
            Ok(value) => Source::Literal(value),
            Err(message) => {
                let help = port.doc_text();
                let help = (!help.is_empty()).then(|| help.to_owned());
                self.error(location, id, Problem::BadLiteral { port: name, message }, help);
                Source::Unset
            }
        }
    }

    fn key(&mut self, port: &'a PortSpec, key: &'a str, id: NodeId, location: u32, scope: usize) -> Source {
        let (base, fields) = match key.split_once('.') {
            None => (key, Vec::new()),
            Some((base, fields)) => (base, fields.split('.').map(str::to_owned).collect()),
        };
        if port.direction.writes() && (self.scopes[scope].read_only.contains(base) || !fields.is_empty()) {
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
        let (label, key) = (&port.name, Cow::Borrowed(key));
        self.board.uses.push(Use { slot, port, label, fields, node: id, location, key, source_idx });
        Source::Slot(slot)
    }

    fn subtree(&mut self, spec: &'a NodeSpec, name: &'a str, id: NodeId, parent: NodeId, scope: usize) {
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
        self.conditions(spec, id, scope, true);
        if !subtree.is_open {
            let known: Vec<&str> = subtree.ports.iter().map(|port| port.name.as_str()).collect();
            self.unknown_ports(spec, name, &known, id);
        }
        let inner = self.add_scope(Scope {
            path: self.tree.path(id),
            automatic: spec.is_autoremapped.then_some(scope),
            ..Scope::default()
        });
        for port in &subtree.ports {
            let setting = spec.ports.iter().find(|setting| setting.name == port.name);
            if port.direction == Direction::In && !subtree.is_open {
                self.scopes[inner].read_only.insert(port.name.clone());
            }
            match (setting, &port.default) {
                (Some(setting), _) => self.connect(setting, port.direction, id, scope, inner),
                (None, Some(literal)) => {
                    let slot = self.slot(inner, &port.name);
                    self.board.start_with(slot, literal, port.location, &port.name);
                }
                (None, None) => {
                    let slot = self.slot(scope, &port.name);
                    self.scopes[inner].keys.insert(port.name.clone(), slot);
                }
            }
        }
        for setting in &spec.ports {
            if subtree.is_open && !subtree.ports.iter().any(|port| port.name == setting.name) {
                self.connect(setting, Direction::In, id, scope, inner);
            }
        }
        self.open.push(name);
        let child = self.node(&subtree.root, id, inner);
        self.open.pop();
        let first_child = self.tree.nodes[id as usize].first_child as usize;
        self.tree.children[first_child] = child;
        self.conditions(spec, id, scope, false);
    }

    /// What the user of a subtree gives for a key inside.
    fn connect(&mut self, setting: &'a PortSetting, direction: Direction, id: NodeId, scope: usize, inner: usize) {
        let name = &setting.name;
        match &setting.value {
            PortValue::Key(key) if key.contains('.') => {
                let message = "a field cannot be a port of a subtree".to_owned();
                let problem = Problem::BadLiteral { port: name.clone(), message };
                let help = "pass the whole value and name the field inside";
                self.error(setting.location, id, problem, Some(help.to_owned()));
            }
            PortValue::Key(key) => {
                let slot = self.slot(scope, key);
                self.scopes[inner].keys.insert(name.clone(), slot);
            }
            PortValue::Literal(literal) => {
                if direction.writes() {
                    self.error(setting.location, id, Problem::OutputNeedsKey { port: name.clone() }, None);
                }
                // A value given is the key's own, whatever has that name outside.
                let automatic = self.scopes[inner].automatic.take();
                let slot = self.slot(inner, name);
                self.scopes[inner].automatic = automatic;
                self.board.start_with(slot, literal, setting.location, name);
            }
        }
    }

    /// A subtree that nobody uses yet is still checked, with its inputs taken as given.
    fn check_unused_subtrees(&mut self) {
        for subtree in &self.spec.subtrees {
            if self.used.contains(subtree.name.as_str()) || self.is_full {
                continue;
            }
            let scope = self.add_scope(Scope { path: subtree.name.clone(), ..Scope::default() });
            for port in &subtree.ports {
                let slot = self.slot(scope, &port.name);
                if port.direction.reads() {
                    self.board.assume(slot);
                }
            }
            self.open.push(&subtree.name);
            // Its nodes are forgotten: any error keeps the tree from being made, and without one they are cut off below.
            let n_nodes = self.tree.nodes.len();
            self.node(&subtree.root, NONE, scope);
            self.board.n_kept_nodes.get_or_insert(n_nodes);
            self.open.pop();
        }
    }

    fn finish(mut self) -> Result<Tree<C>, Vec<BuildError>> {
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
        self.tree.root_keys = std::mem::take(&mut self.scopes[ROOT].keys).into_iter().collect();
        Ok(self.tree)
    }
}

fn has_twice(ports: &[PortSetting]) -> bool {
    ports.iter().enumerate().any(|(port_idx, port)| ports[..port_idx].iter().any(|earlier| earlier.name == port.name))
}

/// Nodes and port settings as written, to make room for.
fn size_of(spec: &NodeSpec) -> (usize, usize) {
    spec.children.iter().map(size_of).fold((1, spec.ports.len()), |sum, child| (sum.0 + child.0, sum.1 + child.1))
}

#[expect(clippy::cast_possible_truncation, reason = "bounded by MAX_NODES times the ports of a node")]
fn index(count: usize) -> u32 {
    count as u32
}

//! `tree` and `subtrees`: nodes written as YAML.
//!
//! | form | means |
//! |---|---|
//! | `- lift` | a node that is given nothing |
//! | `- lift: {height_m: 0.1}` | a node and its ports |
//! | `- sequence: [...]` | a node and its children |
//! | `- parallel: {success: 1, do: [...]}` | a node, its ports and its children |
//! | `- retry: {attempts: 3, do: lift}` | a node, its ports and its only child |
//! | `- inverter: is_held` | a node and its only child |
//! | `- subtree: grasp`, `- subtree: {tree: grasp, object: "{cup}"}` | a use of a subtree, and what its ports are given |
//!
//! Beside its ports a node can have a `name` of its own and conditions: `skip_if`, `success_if`, `failure_if` and `while` decide
//! before it is ticked, `on_success`, `on_failure`, `on_halted` and `post` run after it. A use of a subtree can also be given
//! `autoremap: true`, and then shares every key with its user. A subtree with `open: true` can be given any key beside its ports.
//! A port that ends in `_rad` can be given in degrees: `q_deg`.

use crate::angle::radians_key;
use crate::document::{Key, Node, Value};
use crate::mistake::Place;
use crate::reader::Reader;
use crate::reasons::{ANY, ReasonPlace};
use sfg_tree::{
    ConditionSpec, Direction, Literal, NodeClass, NodeKind, NodeModel, NodeSpec, PortSetting, PortValue, Problem, SubtreePort,
    SubtreeSpec, When, nearest,
};
use std::collections::{BTreeMap, BTreeSet};

/// What a subtree may say.
pub(crate) const SUBTREE_KEYS: &[&str] = &["in", "out", "inout", "open", "do"];

/// Gives nodes numbers that lead back to their places, and knows the kinds of nodes.
pub(crate) struct TreeReader<'a> {
    pub(crate) reader: &'a mut Reader,
    pub(crate) models: &'a [NodeModel],
    pub(crate) reasons: Vec<String>,
    /// The ports of each subtree, as declared.
    pub(crate) subtree_ports: BTreeMap<String, Vec<String>>,
    pub(crate) places: Vec<Place>,
    /// Subtrees that could not be read; that they are unknown is not reported as well.
    pub(crate) unread: BTreeSet<String>,
    /// Where the keys of the blackboard's first entries stand.
    pub(crate) entry_places: Vec<Place>,
    /// Where the reasons stand that nodes wait for.
    pub(crate) reason_places: Vec<ReasonPlace>,
    /// How many nodes and ports could not be read; what depends on them is not reported as well.
    pub(crate) spoilt: BTreeSet<u32>,
}

impl TreeReader<'_> {
    fn locate(&mut self, place: Place) -> u32 {
        self.places.push(place);
        u32::try_from(self.places.len() - 1).unwrap_or(u32::MAX)
    }

    pub(crate) fn node(&mut self, node: &Node) -> Option<NodeSpec> {
        match &node.value {
            Value::Text(name) => {
                let location = self.locate(node.place);
                Some(NodeSpec { kind: NodeKind::Named(name.clone()), location, ..NodeSpec::default() })
            }
            Value::Map(_) => {
                let help = "begin it with `- ` to make it the next node, or indent it to make it a port";
                let (key, body) = self.reader.only("node", node, "the name of a node", help)?;
                self.named(key, body)
            }
            Value::List(_) => {
                let help = "write `sequence:` before the list";
                self.reader.report_with_help(node.place, "node: expected the name of a node, found a list", help);
                None
            }
            _ => self.reader.wrong("node", node, "the name of a node"),
        }
    }

    fn named(&mut self, key: &Key, body: &Node) -> Option<NodeSpec> {
        if key.text == "subtree" {
            return self.subtree_use(key, body);
        }
        let location = self.locate(key.place);
        let mut spec = NodeSpec { kind: NodeKind::Named(key.text.clone()), location, ..NodeSpec::default() };
        let class = self.models.iter().find(|model| model.name == key.text).map(|model| model.class);
        let has_do = matches!(&body.value, Value::Map(entries) if entries.iter().any(|(key, _)| key.text == "do"));
        match (class, &body.value) {
            (_, Value::Null) => self.reader.nothing_after(key),
            (Some(NodeClass::Control) | None, Value::List(items)) => self.children(&mut spec, items),
            (Some(NodeClass::Decorator), Value::Text(_)) => self.only_child(&mut spec, body),
            (Some(NodeClass::Decorator), Value::Map(_)) if !has_do && !self.is_ports_of(&key.text, body) => {
                self.only_child(&mut spec, body);
            }
            (_, Value::Map(_)) => self.body(&mut spec, key, body, class)?,
            // That nobody knows it is said when the tree is built.
            (None, _) => drop(self.spoilt.insert(location)),
            (Some(NodeClass::Control), _) => return self.reader.wrong(&key.text, body, "a list of nodes"),
            (Some(NodeClass::Decorator), _) => return self.reader.wrong(&key.text, body, "a node"),
            (_, _) => return self.reader.wrong(&key.text, body, "ports, such as `{port: value}`"),
        }
        Some(spec)
    }

    /// Whether the body of a decorator gives ports (and forgot `do`) rather than naming its child.
    fn is_ports_of(&self, kind: &str, body: &Node) -> bool {
        let Value::Map(entries) = &body.value else { return false };
        let ports = self.models.iter().filter(|model| model.name == kind).flat_map(|model| &model.ports);
        let names: Vec<&str> = ports.map(|port| port.name()).chain(["name"]).chain(When::ALL.map(When::name)).collect();
        let has_ports = names.len() > 1 + When::ALL.len();
        let is_node = |name: &str| name == "subtree" || self.models.iter().any(|model| model.name == name);
        entries.len() != 1
            || entries.iter().any(|(key, _)| names.contains(&key.text.as_str()) || (!is_node(&key.text) && has_ports))
    }

    fn children(&mut self, spec: &mut NodeSpec, items: &[Node]) {
        for item in items {
            self.only_child(spec, item);
        }
    }

    fn only_child(&mut self, spec: &mut NodeSpec, node: &Node) {
        match self.node(node) {
            Some(child) => spec.children.push(child),
            None => {
                self.spoilt.insert(spec.location);
            }
        }
    }

    /// Ports, conditions, `do` and `name`.
    fn body(&mut self, spec: &mut NodeSpec, key: &Key, body: &Node, class: Option<NodeClass>) -> Option<()> {
        let models = self.models;
        let ports = models.iter().filter(|model| model.name == key.text).flat_map(|model| &model.ports);
        let names: Vec<&str> = ports.map(|port| port.name()).collect();
        for (port, value) in self.reader.entries(&key.text, body)? {
            if self.is_common(spec, port, value) {
                continue;
            }
            match (port.text.as_str(), &value.value) {
                ("do", Value::List(items)) if class != Some(NodeClass::Decorator) => self.children(spec, items),
                ("do", Value::List(_)) => {
                    let message = format!("{:?} does one node, found a list", key.text);
                    self.reader.report_with_help(value.place, message, "write `do: {sequence: [...]}`");
                    self.spoilt.insert(spec.location);
                }
                ("do", _) => self.only_child(spec, value),
                _ => {
                    let setting = self.port(port, value, &names, body);
                    if setting.is_none() {
                        self.spoilt.insert(spec.location);
                    }
                    if ["retry", "recover"].contains(&key.text.as_str()) && port.text == "on" {
                        self.check_reasons(spec.location, &key.text, value);
                    }
                    spec.ports.extend(setting);
                }
            }
        }
        Some(())
    }

    /// Takes what every node can be given: a name and conditions.
    fn is_common(&mut self, spec: &mut NodeSpec, key: &Key, value: &Node) -> bool {
        if key.text == "name" {
            spec.title = self.reader.text("name", value).map(|title| title.value);
            return true;
        }
        let Some(when) = When::ALL.into_iter().find(|when| when.name() == key.text) else { return false };
        let script = match &value.value {
            Value::Text(text) if !text.trim().is_empty() => text.clone(),
            Value::Bool(value) => value.to_string(),
            _ => {
                self.reader.wrong::<()>(when.name(), value, "a script such as \"n > 3\"");
                return true;
            }
        };
        let location = self.locate(value.place);
        spec.conditions.push(ConditionSpec { when, script, location });
        true
    }

    /// One port; `ports` are those of the node, `body` all that it is given.
    fn port(&mut self, port: &Key, value: &Node, ports: &[&str], body: &Node) -> Option<PortSetting> {
        let (name_location, location) = (self.locate(port.place), self.locate(value.place));
        if let Some(name) = radians_key(&port.text, |name| ports.contains(&name)) {
            if body.get(&name).is_some() {
                self.reader.angle_given_twice(port, &name);
                return None;
            }
            let value = PortValue::Literal(self.reader.radians(&port.text, value)?.literal());
            return Some(PortSetting { name, value, name_location, location });
        }
        let value = match &value.value {
            Value::Text(text) => match PortValue::from_text(text) {
                Ok(value) => value,
                Err(message) => {
                    self.reader.report(value.place, format!("port {:?}: {message}", port.text));
                    return None;
                }
            },
            Value::Null | Value::Unknown => return self.reader.wrong(&format!("port {:?}", port.text), value, "a value"),
            _ => {
                self.forbid_inner_keys(value);
                PortValue::Literal(value.literal())
            }
        };
        Some(PortSetting { name: port.text.clone(), value, name_location, location })
    }

    /// `[1, "{key}"]` would silently be a text.
    fn forbid_inner_keys(&mut self, node: &Node) {
        match &node.value {
            Value::Text(text) if text.trim_start().starts_with('{') => {
                let message = format!("blackboard key {text:?} inside a list or map");
                self.reader.report_with_help(node.place, message, "a key can only be the whole value of a port");
            }
            Value::List(items) => items.iter().for_each(|item| self.forbid_inner_keys(item)),
            Value::Map(entries) => entries.iter().for_each(|(_, item)| self.forbid_inner_keys(item)),
            _ => {}
        }
    }

    fn check_reasons(&mut self, location: u32, kind: &str, on: &Node) {
        if let Value::List(items) = &on.value {
            for item in items {
                if let Value::Text(text) = &item.value {
                    self.reason_places.push((location, text.clone(), item.place));
                    let reasons = std::mem::take(&mut self.reasons);
                    if reasons.is_empty() || kind != "recover" || text != ANY {
                        self.reader.word("failure reason", item, &reasons);
                    }
                    self.reasons = reasons;
                }
            }
        }
    }

    fn subtree_use(&mut self, key: &Key, body: &Node) -> Option<NodeSpec> {
        let expected = "the name of a subtree, or `{tree: name, port: value}`";
        match &body.value {
            Value::Text(name) => {
                let location = self.locate(body.place);
                Some(NodeSpec { kind: NodeKind::Subtree(name.clone()), location, ..NodeSpec::default() })
            }
            Value::Map(_) => {
                let location = self.locate(key.place);
                let mut spec = NodeSpec { location, ..NodeSpec::default() };
                let mut name = None;
                let tree = match body.get("tree").map(|node| &node.value) {
                    Some(Value::Text(tree)) => tree.as_str(),
                    _ => "",
                };
                let ports = self.subtree_ports.get(tree).cloned().unwrap_or_default();
                let ports: Vec<&str> = ports.iter().map(String::as_str).collect();
                for (port, value) in self.reader.entries("subtree", body)? {
                    match (port.text.as_str(), &value.value) {
                        _ if self.is_common(&mut spec, port, value) => {}
                        ("tree", _) => name = self.reader.text("tree", value),
                        ("autoremap", Value::Bool(is_autoremapped)) => spec.is_autoremapped = *is_autoremapped,
                        ("autoremap", _) => drop(self.reader.wrong::<()>("autoremap", value, "true or false")),
                        _ => spec.ports.extend(self.port(port, value, &ports, body)),
                    }
                }
                let Some(name) = name else {
                    let entries = if let Value::Map(entries) = &body.value { entries.as_slice() } else { &[] };
                    let meant = entries.iter().find(|(port, _)| nearest(&port.text, ["tree"]).is_some());
                    match meant.map(|(port, _)| port) {
                        Some(port) if port.text == "tree" => {}
                        Some(port) => {
                            let message = format!("subtree has no key {:?}", port.text);
                            self.reader.report_with_help(port.place, message, "did you mean \"tree\"?");
                        }
                        None => {
                            let place = entries.first().map_or(key.place, |(port, _)| port.place);
                            self.reader.report(place, "subtree needs key \"tree\": the name of a subtree");
                        }
                    }
                    return None;
                };
                self.places[location as usize] = name.place;
                spec.kind = NodeKind::Subtree(name.value);
                Some(spec)
            }
            _ => self.reader.wrong("subtree", body, expected),
        }
    }

    /// Entries that the blackboard begins with.
    pub(crate) fn blackboard(&mut self, node: &Node) -> Option<Vec<(String, Literal, u32)>> {
        let mut board = Vec::new();
        for (key, value) in self.reader.entries("blackboard", node)? {
            if !matches!(PortValue::from_text(&format!("{{{}}}", key.text)), Ok(PortValue::Key(key)) if !key.contains(['.', '@']))
            {
                let help = "a key has letters, digits and underscores";
                self.reader.report_with_help(key.place, format!("{:?} is no blackboard key", key.text), help);
            }
            if matches!(value.value, Value::Null | Value::Unknown) {
                self.reader.wrong::<()>(&format!("blackboard entry {:?}", key.text), value, "a value");
                let location = self.locate(value.place);
                self.spoilt.insert(location);
                continue;
            }
            let location = self.locate(value.place);
            self.entry_places.push(key.place);
            board.push((key.text.clone(), value.literal(), location));
        }
        Some(board)
    }

    pub(crate) fn subtrees(&mut self, node: &Node) -> Option<Vec<SubtreeSpec>> {
        let entries = self.reader.entries("subtrees", node)?;
        self.subtree_ports = entries.iter().map(|(key, body)| (key.text.clone(), declared_ports(body))).collect();
        let read = |(key, body): (&Key, &Node)| {
            let subtree = self.subtree(key, body);
            if subtree.is_none() {
                self.unread.insert(key.text.clone());
            }
            subtree
        };
        Some(entries.into_iter().filter_map(read).collect())
    }

    fn subtree(&mut self, key: &Key, body: &Node) -> Option<SubtreeSpec> {
        if SUBTREE_KEYS.contains(&key.text.as_str()) {
            let message = format!("no subtree can be called {:?}", key.text);
            self.reader.report_with_help(key.place, message, "indent it to make it a key of the subtree above");
            return None;
        }
        let location = self.locate(key.place);
        let what = format!("subtree {:?}", key.text);
        let fields = self.reader.fields(&what, body, SUBTREE_KEYS)?;
        let mut ports: Vec<SubtreePort> = Vec::new();
        for (list, direction) in [("in", Direction::In), ("out", Direction::Out), ("inout", Direction::InOut)] {
            let Some(list) = fields.get(list) else { continue };
            for item in self.reader.list("ports", list)? {
                if let Some(port) = self.subtree_port(item, direction) {
                    if ports.iter().any(|earlier| earlier.name == port.name) {
                        self.reader.report(item.place, format!("port {:?} is declared twice", port.name));
                    }
                    ports.push(port);
                }
            }
        }
        let root = self.reader.required(&what, &fields, "do").and_then(|node| self.node(node))?;
        let is_open = match fields.get("open").map(|node| (node, &node.value)) {
            None => false,
            Some((_, Value::Bool(is_open))) => *is_open,
            Some((node, _)) => self.reader.wrong("open", node, "true or false")?,
        };
        Some(SubtreeSpec { name: key.text.clone(), ports, is_open, root, location })
    }

    fn subtree_port(&mut self, item: &Node, direction: Direction) -> Option<SubtreePort> {
        let (name, place, default) = match &item.value {
            Value::Text(name) => (name, item.place, None),
            Value::Map(entries) => match entries.as_slice() {
                [(key, value)] if matches!(value.value, Value::Null | Value::Unknown) => {
                    return self.reader.wrong(&format!("port {:?}", key.text), value, "a default value");
                }
                [(key, value)] => (&key.text, value.place, Some(value.literal())),
                _ => return self.reader.wrong("port", item, "a name, or one name with its default"),
            },
            _ => return self.reader.wrong("port", item, "a name, or one name with its default"),
        };
        if default.is_some() && direction == Direction::Out {
            self.reader.report(place, format!("port {name:?} is written by the subtree and can have no default"));
        }
        let location = self.locate(place);
        Some(SubtreePort { name: name.clone(), direction, default, location })
    }
}

/// The names of the ports that a subtree declares; mistakes are reported when it is read.
fn declared_ports(body: &Node) -> Vec<String> {
    let lists = ["in", "out", "inout"].into_iter().filter_map(|list| body.get(list));
    let items = lists.flat_map(|list| if let Value::List(items) = &list.value { items.as_slice() } else { &[] });
    let name = |item: &Node| match &item.value {
        Value::Text(name) => Some(name.clone()),
        Value::Map(entries) => entries.first().map(|(key, _)| key.text.clone()),
        _ => None,
    };
    items.filter_map(name).collect()
}

/// More to say about a mistake than the tree knows: words of the file, and who could write a key.
pub(crate) fn help_for(problem: &Problem, models: &[NodeModel]) -> Option<String> {
    match problem {
        Problem::UnknownNode { name } => {
            let names = models.iter().map(|model| model.name.as_ref()).chain(["subtree"]);
            nearest(name, names).map(|near| format!("did you mean {near:?}?"))
        }
        Problem::DanglingKey { key, .. } => {
            let base = key.split('.').next().unwrap_or(key);
            let writes = |model: &&NodeModel| model.ports.iter().any(|port| port.direction().writes() && port.name() == base);
            let writers: Vec<&str> = models.iter().filter(writes).map(|model| model.name.as_ref()).collect();
            (!writers.is_empty()).then(|| format!("{} writes it; put it earlier in the tree", writers.join(" or ")))
        }
        _ => None,
    }
}

//! A tree as the text of `tree`, `subtrees` and `blackboard` of a scenario.
//!
//! What is written reads back as the same tree, or is refused by name: YAML scenarios keep some words for themselves.

use crate::document::{self, MAX_DEPTH};
use crate::tree::SUBTREE_KEYS;
use sfg_tree::{
    ConditionSpec, Direction, Literal, NodeClass, NodeKind, NodeModel, NodeSpec, PortSetting, PortValue, SubtreeSpec, TreeSpec,
    When,
};
use std::collections::BTreeSet;

/// Shorter lists of ports stand in one line.
const MAX_LINE_CHARS: usize = 100;
/// What YAML reads as something else than a text.
const NO_TEXTS: [&str; 3] = ["true", "false", "null"];

/// A part of a tree that a scenario cannot say.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Unwritable {
    /// The `location` of the part.
    pub(crate) location: u32,
    /// What it is: lower-case, no full stop.
    pub(crate) message: String,
}

/// The text of `spec`; `models` tell which nodes have one child and which many.
///
/// # Errors
/// Every part that a scenario cannot say.
pub(crate) fn tree_text(spec: &TreeSpec, models: &[NodeModel]) -> Result<String, Vec<Unwritable>> {
    let mut emitter = Emitter { models, problems: Vec::new() };
    let mut lines = Vec::new();
    if !spec.entries.is_empty() {
        lines.push("blackboard:".to_owned());
        for (key, value, location) in &spec.entries {
            emitter.forbid_keys(value, *location);
            lines.push(format!("  {}: {}", name_text(key), flow(value)));
        }
    }
    let root = emitter.node(&spec.root);
    lines.extend(under("tree", root));
    if !spec.subtrees.is_empty() {
        lines.push("subtrees:".to_owned());
        let mut seen = BTreeSet::new();
        for subtree in &spec.subtrees {
            if !seen.insert(subtree.name.as_str()) {
                emitter.refuse(subtree.location, format!("there are two subtrees {:?}", subtree.name));
            }
            let body = emitter.subtree(subtree);
            lines.extend(indented(under(&name_text(&subtree.name), Text::Block(body))));
        }
    }
    let text = lines.join("\n") + "\n";
    if emitter.problems.is_empty()
        && let Err(error) = document::parse_as_written(&text)
    {
        let message = format!("nested deeper than the {MAX_DEPTH} lists and maps of a scenario, or unreadable in one: {error}");
        emitter.refuse(spec.root.location, message.lines().next().unwrap_or_default().to_owned());
    }
    if emitter.problems.is_empty() { Ok(text) } else { Err(emitter.problems) }
}

/// Gives constants of the known nodes the types of their ports; formats without types have only texts.
pub(crate) fn with_types(spec: &mut TreeSpec, models: &[NodeModel]) {
    type_node(&mut spec.root, models);
    spec.subtrees.iter_mut().for_each(|subtree| type_node(&mut subtree.root, models));
    spec.has_untyped_texts = false;
}

fn type_node(node: &mut NodeSpec, models: &[NodeModel]) {
    if let NodeKind::Named(name) = &node.kind
        && let Some(model) = models.iter().find(|model| model.name == *name)
    {
        for setting in &mut node.ports {
            let port = model.ports.iter().find(|port| port.name() == setting.name);
            if let (PortValue::Literal(Literal::Text(text)), Some(shape)) =
                (&setting.value, port.and_then(|port| port.port_type().shape()))
            {
                setting.value = PortValue::Literal(Literal::from_text(text, shape));
            }
        }
    }
    node.children.iter_mut().for_each(|child| type_node(child, models));
}

/// A value in one line: `[1, "two"]`.
pub(crate) fn flow(literal: &Literal) -> String {
    match literal {
        Literal::Bool(value) => value.to_string(),
        Literal::Int(value) => value.to_string(),
        Literal::Float(value) if value.is_nan() => ".nan".to_owned(),
        Literal::Float(value) if value.is_infinite() => if *value > 0.0 { ".inf" } else { "-.inf" }.to_owned(),
        Literal::Float(value) => format!("{value:?}"),
        Literal::Text(text) => value_text(text),
        Literal::List(items) => format!("[{}]", items.iter().map(flow).collect::<Vec<_>>().join(", ")),
        Literal::Map(entries) => {
            let entries: Vec<String> =
                entries.iter().map(|(key, value)| format!("{}: {}", name_text(key), flow(value))).collect();
            format!("{{{}}}", entries.join(", "))
        }
    }
}

/// A text where parameters are looked for.
fn value_text(text: &str) -> String {
    name_text(&text.replace("${", "$${"))
}

/// A text as it is: bare where YAML cannot take it for anything else.
fn name_text(text: &str) -> String {
    let is_bare = text.starts_with(|first: char| first.is_ascii_alphabetic() || first == '_')
        && text.chars().all(|letter| letter.is_ascii_alphanumeric() || matches!(letter, '_' | '-'))
        && !NO_TEXTS.contains(&text.to_ascii_lowercase().as_str());
    if is_bare {
        return text.to_owned();
    }
    let mut quoted = String::from("\"");
    for letter in text.chars() {
        match letter {
            '"' | '\\' => quoted.extend(['\\', letter]),
            '\n' => quoted.push_str("\\n"),
            '\t' => quoted.push_str("\\t"),
            // Line ends and letters that YAML does not print.
            '\0'..='\x1f' | '\x7f'..='\u{a0}' | '\u{2028}' | '\u{2029}' | '\u{feff}' | '\u{fffe}' | '\u{ffff}' => {
                quoted.push_str(&format!("\\u{:04x}", u32::from(letter)));
            }
            _ => quoted.push(letter),
        }
    }
    quoted.push('"');
    quoted
}

/// A value as it is put into the text around it.
enum Text {
    /// Without a line end.
    Inline(String),
    Block(Vec<String>),
}

fn indented(lines: Vec<String>) -> impl Iterator<Item = String> {
    lines.into_iter().map(|line| format!("  {line}"))
}

/// `key: value`.
fn under(key: &str, value: Text) -> Vec<String> {
    match value {
        Text::Inline(text) => vec![format!("{key}: {text}")],
        Text::Block(lines) => std::iter::once(format!("{key}:")).chain(indented(lines)).collect(),
    }
}

/// `- value`.
fn item(value: Text) -> Vec<String> {
    match value {
        Text::Inline(text) => vec![format!("- {text}")],
        Text::Block(lines) => {
            let marked = |(line_idx, line)| if line_idx == 0 { format!("- {line}") } else { format!("  {line}") };
            lines.into_iter().enumerate().map(marked).collect()
        }
    }
}

struct Emitter<'a> {
    models: &'a [NodeModel],
    problems: Vec<Unwritable>,
}

impl Emitter<'_> {
    fn refuse(&mut self, location: u32, message: String) {
        self.problems.push(Unwritable { location, message });
    }

    fn node(&mut self, node: &NodeSpec) -> Text {
        let settings = self.settings(node);
        let (head, class) = match &node.kind {
            NodeKind::Subtree(name) => {
                if !node.children.is_empty() {
                    self.refuse(node.location, format!("the use of subtree {name:?} has children"));
                }
                if settings.is_empty() {
                    return Text::Block(vec![format!("subtree: {}", value_text(name))]);
                }
                let tree = ("tree".to_owned(), value_text(name));
                return Text::Block(with_settings("subtree", &[vec![tree], settings].concat()));
            }
            NodeKind::Named(name) => {
                if name.is_empty() || name == "subtree" {
                    self.refuse(node.location, format!("no node can be called {name:?}"));
                }
                (name, self.models.iter().find(|model| model.name == *name).map(|model| model.class))
            }
        };
        if node.children.is_empty() && settings.is_empty() {
            return Text::Inline(value_text(head));
        }
        let head = name_text(head);
        if node.children.is_empty() {
            return Text::Block(with_settings(&head, &settings));
        }
        let mut children: Vec<Text> = node.children.iter().map(|child| self.node(child)).collect();
        if class == Some(NodeClass::Decorator) {
            if children.len() > 1 {
                self.refuse(node.location, format!("{head:?} does one node, found {}", children.len()));
            }
            let child = children.swap_remove(0);
            return Text::Block(match child {
                Text::Inline(_) if settings.is_empty() => under(&head, child),
                _ => with_children(&head, &settings, under("do", child)),
            });
        }
        let items: Vec<String> = children.into_iter().flat_map(item).collect();
        let takes_a_list = matches!(class, None | Some(NodeClass::Control));
        Text::Block(if settings.is_empty() && takes_a_list {
            under(&head, Text::Block(items))
        } else {
            with_children(&head, &settings, under("do", Text::Block(items)))
        })
    }

    /// What is given beside the children: name, ports, conditions.
    fn settings(&mut self, node: &NodeSpec) -> Vec<(String, String)> {
        let is_subtree = matches!(node.kind, NodeKind::Subtree(_));
        let mut settings = Vec::new();
        let mut seen = BTreeSet::new();
        if let Some(title) = &node.title {
            settings.push(("name".to_owned(), value_text(title)));
        }
        if node.is_autoremapped {
            if is_subtree {
                settings.push(("autoremap".to_owned(), "true".to_owned()));
            } else {
                self.refuse(node.location, "only a subtree can be remapped by itself".to_owned());
            }
        }
        for setting in &node.ports {
            let PortSetting { name, value, location, .. } = setting;
            let own: &[&str] = if is_subtree { &["tree", "autoremap"] } else { &["do"] };
            if name == "name" || own.contains(&name.as_str()) || When::ALL.iter().any(|when| when.name() == name) {
                self.refuse(setting.name_location, format!("port {name:?} means something else in a scenario; rename the port"));
            }
            if !seen.insert(name.as_str()) {
                self.refuse(setting.name_location, format!("port {name:?} is given twice"));
            }
            let value = match value {
                PortValue::Key(key) => format!("\"{{{key}}}\""),
                PortValue::Literal(literal) => {
                    self.forbid_keys(literal, *location);
                    flow(literal)
                }
            };
            settings.push((name_text(name), value));
        }
        let mut whens = BTreeSet::new();
        for ConditionSpec { when, script, location } in &node.conditions {
            if script.trim().is_empty() || !whens.insert(*when) {
                self.refuse(*location, format!("{} needs one script that is not empty", when.name()));
            }
            settings.push((when.name().to_owned(), value_text(script)));
        }
        settings
    }

    /// A text in braces would be read as a key.
    fn forbid_keys(&mut self, literal: &Literal, location: u32) {
        let is_key = match literal {
            Literal::Text(text) => !matches!(PortValue::from_text(text), Ok(PortValue::Literal(_))),
            Literal::List(items) => items.iter().any(has_braces),
            Literal::Map(entries) => entries.iter().any(|(_, value)| has_braces(value)),
            _ => false,
        };
        if is_key {
            self.refuse(location, format!("{literal} would be read as a blackboard key"));
        }
    }

    fn subtree(&mut self, subtree: &SubtreeSpec) -> Vec<String> {
        if SUBTREE_KEYS.contains(&subtree.name.as_str()) {
            self.refuse(subtree.location, format!("no subtree can be called {:?}", subtree.name));
        }
        let mut lines = Vec::new();
        let mut seen = BTreeSet::new();
        for (key, direction) in [("in", Direction::In), ("out", Direction::Out), ("inout", Direction::InOut)] {
            let mut ports = Vec::new();
            for port in subtree.ports.iter().filter(|port| port.direction == direction) {
                if !seen.insert(port.name.as_str()) {
                    self.refuse(port.location, format!("port {:?} is declared twice", port.name));
                }
                ports.push(match &port.default {
                    None => value_text(&port.name),
                    Some(default) => format!("{{{}: {}}}", name_text(&port.name), flow(default)),
                });
            }
            if !ports.is_empty() {
                lines.push(format!("{key}: [{}]", ports.join(", ")));
            }
        }
        if subtree.is_open {
            lines.push("open: true".to_owned());
        }
        let root = self.node(&subtree.root);
        lines.extend(under("do", root));
        lines
    }
}

fn has_braces(literal: &Literal) -> bool {
    match literal {
        Literal::Text(text) => text.trim_start().starts_with('{'),
        Literal::List(items) => items.iter().any(has_braces),
        Literal::Map(entries) => entries.iter().any(|(_, value)| has_braces(value)),
        _ => false,
    }
}

fn with_settings(head: &str, settings: &[(String, String)]) -> Vec<String> {
    let short: Vec<String> = settings.iter().map(|(key, value)| format!("{key}: {value}")).collect();
    let line = format!("{head}: {{{}}}", short.join(", "));
    if line.chars().count() <= MAX_LINE_CHARS {
        return vec![line];
    }
    under(head, Text::Block(short))
}

fn with_children(head: &str, settings: &[(String, String)], children: Vec<String>) -> Vec<String> {
    let settings = settings.iter().map(|(key, value)| format!("{key}: {value}"));
    under(head, Text::Block(settings.chain(children).collect()))
}

#[cfg(test)]
mod tests {
    #![expect(clippy::unwrap_used, reason = "tests fail by panicking")]
    use super::*;
    use crate::mistake::Place;
    use crate::parameters::{Parameters, Settings};
    use crate::reader::Reader;
    use crate::tree::TreeReader;
    use sfg_tree::{Registry, SubtreePort, xml};
    use std::collections::BTreeMap;
    use std::path::PathBuf;

    /// The tree in `text`, read as that of a scenario is.
    fn read(text: &str) -> TreeSpec {
        let mut reader = Reader::default();
        let mut document = document::parse(text, 0).unwrap();
        Parameters::new(&mut reader, &Settings::default()).apply(&mut document);
        let registry = Registry::<()>::new();
        let mut trees = TreeReader {
            reader: &mut reader,
            models: registry.models(),
            reasons: Vec::new(),
            subtree_ports: BTreeMap::new(),
            places: vec![Place::START],
            unread: BTreeSet::new(),
            entry_places: Vec::new(),
            reason_places: Vec::new(),
            spoilt: BTreeSet::new(),
        };
        let entries = document.get("blackboard").map_or(Vec::new(), |node| trees.blackboard(node).unwrap());
        let subtrees = document.get("subtrees").map_or(Vec::new(), |node| trees.subtrees(node).unwrap());
        let root = trees.node(document.get("tree").unwrap()).unwrap();
        assert_eq!(reader.mistakes, [], "{text}");
        TreeSpec { root, subtrees, entries, ..TreeSpec::default() }
    }

    /// Without what depends on the file: locations, and the order of inputs among outputs.
    fn plain(mut spec: TreeSpec) -> String {
        fn node(spec: &mut NodeSpec) {
            spec.location = 0;
            spec.ports.iter_mut().for_each(|port| (port.location, port.name_location) = (0, 0));
            spec.conditions.iter_mut().for_each(|condition| condition.location = 0);
            spec.children.iter_mut().for_each(node);
        }
        node(&mut spec.root);
        for subtree in &mut spec.subtrees {
            subtree.location = 0;
            subtree.ports.iter_mut().for_each(|port| port.location = 0);
            let order = |direction| [Direction::In, Direction::Out, Direction::InOut].iter().position(|one| *one == direction);
            subtree.ports.sort_by_key(|port| order(port.direction));
            node(&mut subtree.root);
        }
        spec.entries.iter_mut().for_each(|entry| entry.2 = 0);
        format!("{:#?}\n{:#?}\n{:#?}", spec.root, spec.subtrees, spec.entries)
    }

    #[track_caller]
    fn check_round(spec: TreeSpec) {
        let text = tree_text(&spec, Registry::<()>::new().models()).unwrap();
        assert_eq!(plain(read(&text)), plain(spec), "{text}");
    }

    #[track_caller]
    fn check(spec: NodeSpec, text: &str) {
        let spec = TreeSpec::new(spec);
        assert_eq!(tree_text(&spec, Registry::<()>::new().models()).unwrap(), text);
        check_round(spec);
    }

    #[track_caller]
    fn refuses(spec: NodeSpec, message: &str) {
        let problems = tree_text(&TreeSpec::new(spec), Registry::<()>::new().models()).unwrap_err();
        assert_eq!(problems.iter().map(|problem| problem.message.as_str()).collect::<Vec<_>>(), [message]);
    }

    fn node(kind: &str) -> NodeSpec {
        NodeSpec::new(kind)
    }

    #[test]
    fn every_form_of_a_node() {
        check(node("lift"), "tree: lift\n");
        check(node("lift").with("height_m", 0.1).title("up"), "tree:\n  lift: {name: up, height_m: 0.1}\n");
        check(node("sequence").child(node("a")).child(node("b")), "tree:\n  sequence:\n    - a\n    - b\n");
        check(node("inverter").child(node("a")), "tree:\n  inverter: a\n");
        check(
            node("retry").with("attempts", 3).child(node("sequence").child(node("a").with_key("x", "y"))),
            "tree:\n  retry:\n    attempts: 3\n    do:\n      sequence:\n        - a: {x: \"{y}\"}\n",
        );
        check(
            node("parallel").with("success", 1).child(node("sleep").with("secs", 1.0)),
            "tree:\n  parallel:\n    success: 1\n    do:\n      - sleep: {secs: 1.0}\n",
        );
        check(node("a").when(When::SkipIf, "n > 3"), "tree:\n  a: {skip_if: \"n > 3\"}\n");
        let mut subtree = NodeSpec::subtree("grasp");
        check(subtree.clone(), "tree:\n  subtree: grasp\n");
        subtree.is_autoremapped = true;
        check(subtree.with_key("object", "@cup"), "tree:\n  subtree: {tree: grasp, autoremap: true, object: \"{@cup}\"}\n");
        check(node("unknown").child(node("one")), "tree:\n  unknown:\n    - one\n");
    }

    #[test]
    fn subtrees_ports_and_entries() {
        let port = |name: &str, direction, default| SubtreePort { name: name.to_owned(), direction, default, location: 0 };
        let subtree = SubtreeSpec {
            name: "go on".to_owned(),
            ports: vec![
                port("to", Direction::Out, None),
                port("from", Direction::In, Some(Literal::Float(1e300))),
                port("at", Direction::InOut, None),
            ],
            is_open: true,
            root: node("step"),
            location: 0,
        };
        let spec = TreeSpec::new(NodeSpec::subtree("go on")).subtree(subtree).entry("n", 3).entry("words", vec!["a b", "c"]);
        check_round(spec);
    }

    #[test]
    fn texts_stay_texts() {
        for text in
            ["", " ", "true", "No", "3", "0x1f", "1e5", "a: b", "a #b", "- a", "${x} $${y}", "\"\\", "\n\t\u{7}\u{85}", "e\u{e4}"]
        {
            check_round(TreeSpec::new(node("say").with("text", text).title(text)));
        }
        check_round(TreeSpec::new(
            node("say").with("list", vec!["[", "~"]).with("map", Literal::Map(vec![("a b".to_owned(), 1.into())])),
        ));
        check_round(TreeSpec::new(node("null").child(node("say me").with("on", true).with("a b", -0.0))));
    }

    #[test]
    fn what_a_scenario_cannot_say_is_refused_by_name() {
        refuses(node("a").with("do", 1), "port \"do\" means something else in a scenario; rename the port");
        refuses(node("a").with("while", 1), "port \"while\" means something else in a scenario; rename the port");
        refuses(NodeSpec::subtree("a").with("tree", 1), "port \"tree\" means something else in a scenario; rename the port");
        refuses(node("a").with("x", 1).with("x", 2), "port \"x\" is given twice");
        refuses(node("a").with("x", "{y}"), "\"{y}\" would be read as a blackboard key");
        refuses(node("a").with("x", vec!["{y}"]), "a list of 1 would be read as a blackboard key");
        refuses(node("subtree"), "no node can be called \"subtree\"");
        refuses(node("inverter").child(node("a")).child(node("b")), "\"inverter\" does one node, found 2");
        refuses(node("a").when(When::Post, " "), "post needs one script that is not empty");
        let deep = (0..MAX_DEPTH).fold(node("a"), |inner, _| node("sequence").child(inner));
        let problems = tree_text(&TreeSpec::new(deep), &[]).unwrap_err();
        assert!(problems[0].message.starts_with("nested deeper than"), "{problems:?}");
    }

    #[test]
    fn texts_become_what_their_ports_take() {
        let mut spec = TreeSpec::new(node("sleep").with("secs", "2").with("other", "2"));
        spec.has_untyped_texts = true;
        with_types(&mut spec, Registry::<()>::new().models());
        assert_eq!(plain(spec), plain(TreeSpec::new(node("sleep").with("secs", 2.0).with("other", "2"))));
    }

    #[test]
    fn imported_files_read_back_as_the_same_tree() {
        let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../tree/tests/xml");
        let load = |path: &str| std::fs::read_to_string(folder.join(path)).map_err(|error| error.to_string());
        let mut files: Vec<PathBuf> = std::fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().path()).collect();
        files.sort();
        let mut n_trees = 0;
        for path in files.iter().filter(|path| path.extension().is_some_and(|extension| extension == "xml")) {
            let text = std::fs::read_to_string(path).unwrap();
            // Some files leave it to the program which of their trees runs.
            let names = text.split("<BehaviorTree ID=\"").skip(1).map(|rest| rest.split('"').next().map(str::to_owned));
            for main_tree in names.chain([None]) {
                let options = xml::ImportOptions { main_tree, load: &load, ..xml::ImportOptions::default() };
                if let Ok(imported) = xml::import(&text, &options) {
                    check_round(imported.spec);
                    n_trees += 1;
                }
            }
        }
        assert!(n_trees >= 40, "{n_trees} trees");
    }
}

//! The definition of a tree as Groot2 reads it.

use super::literal_of;
use super::names::{self, Form};
use super::scopes::{MAIN, Scopes};
use crate::blackboard::Source;
use crate::literal::Literal;
use crate::port::{Direction, PortSpec};
use crate::registry::{NodeClass, NodeModel};
use crate::status::Status;
use crate::tree::{Kind, NodeId, Tree};
use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;

/// The tree as BehaviorTree.CPP 4 XML, with the numbers that logs and messages use.
///
/// Each use of a subtree is a `<BehaviorTree>` of its own. `_uid` is the number of a node, `_fullpath` the name of a subtree's
/// blackboard. `<TreeNodesModel>` has every node kind of the registry. Built-in nodes and their ports have the names of
/// BehaviorTree.CPP; those that it lacks (`recover`, a `switch` with other than 2 to 6 cases) keep theirs.
///
/// A built tree does not keep everything that its [`TreeSpec`](crate::TreeSpec) had. Left out are pre- and post-conditions, the
/// field in `"{key.field}"`, constants whose type has no literal form, and the name of a subtree whose node has a title.
#[must_use]
pub fn tree_xml<C>(tree: &Tree<C>) -> String {
    let paths = tree.unique_paths();
    let scopes = Scopes::new(tree, &paths);
    with_scopes(tree, &paths, &scopes)
}

/// [`tree_xml`] with what it needs already at hand.
pub(super) fn with_scopes<C>(tree: &Tree<C>, paths: &[String], scopes: &Scopes) -> String {
    let mut writer =
        Writer { tree, paths, scopes, text: String::with_capacity(256 * tree.nodes.len()), unnamed: BTreeSet::new() };
    writer.text.push_str("<root BTCPP_format=\"4\" main_tree_to_execute=\"MainTree\">\n");
    for scope in &scopes.list {
        let (id, name, root) = match scope.node {
            None => (MAIN, "", (!tree.nodes.is_empty()).then_some(0)),
            Some(node) => (tree.title(node), scope.name.as_str(), writer.children(node).next()),
        };
        let Some(root) = root else { continue };
        writer.text.push_str("  <BehaviorTree");
        attribute(&mut writer.text, "ID", id);
        attribute(&mut writer.text, "_fullpath", name);
        writer.text.push_str(">\n");
        writer.node(root, 2);
        writer.text.push_str("  </BehaviorTree>\n");
    }
    writer.models();
    writer.text.push_str("</root>\n");
    writer.text
}

struct Writer<'a, C> {
    tree: &'a Tree<C>,
    paths: &'a [String],
    scopes: &'a Scopes,
    text: String,
    /// Kinds with several names there of which none fits.
    unnamed: BTreeSet<&'a str>,
}

impl<'a, C> Writer<'a, C> {
    fn children(&self, id: NodeId) -> impl Iterator<Item = NodeId> + use<'a, C> {
        let (tree, node) = (self.tree, &self.tree.nodes[id as usize]);
        (node.first_child..node.first_child + node.n_children).map(move |at| tree.children[at as usize])
    }

    /// Depth is bounded where the tree is built.
    fn node(&mut self, id: NodeId, depth: usize) {
        let tree = self.tree;
        let is_subtree = tree.nodes[id as usize].kind == Kind::Subtree;
        indent(&mut self.text, depth);
        let tag = if is_subtree { self.begin_subtree(id) } else { self.begin(id) };
        if is_subtree || tree.nodes[id as usize].n_children == 0 {
            self.text.push_str("/>\n");
            return;
        }
        self.text.push_str(">\n");
        for child in self.children(id) {
            self.node(child, depth + 1);
        }
        indent(&mut self.text, depth);
        let _infallible = writeln!(self.text, "</{tag}>");
    }

    fn begin_subtree(&mut self, id: NodeId) -> Cow<'static, str> {
        let path = self.paths.get(id as usize).map_or("", String::as_str);
        self.text.push_str("<SubTree");
        attribute(&mut self.text, "ID", self.tree.title(id));
        attribute(&mut self.text, "_fullpath", path);
        attribute(&mut self.text, "_uid", &(u64::from(id) + 1).to_string());
        if let Some(scope) = self.scopes.below(id) {
            for slot in &scope.connected {
                let outer = scope.parent.and_then(|parent| self.scopes.key(parent, *slot));
                if let (Some(inner), Some(outer)) = (scope.keys.get(slot), outer) {
                    attribute(&mut self.text, inner, &format!("{{{outer}}}"));
                }
            }
        }
        Cow::Borrowed("SubTree")
    }

    fn begin(&mut self, id: NodeId) -> Cow<'static, str> {
        let tree = self.tree;
        let Some(model) = tree.models.get(tree.nodes[id as usize].model as usize) else { return Cow::Borrowed("") };
        let name = self.model_name(id, &model.name);
        let tag = if is_element_name(&name) { Cow::Owned(name.clone().into_owned()) } else { Cow::Borrowed(tag(model.class)) };
        let _infallible = write!(self.text, "<{tag}");
        if tag != name {
            attribute(&mut self.text, "ID", &name);
        }
        attribute(&mut self.text, "name", if tree.titles.contains_key(&id) { tree.title(id) } else { &name });
        attribute(&mut self.text, "_uid", &(u64::from(id) + 1).to_string());
        let is_counted_switch = name != model.name && model.name == "switch";
        if name == model.name && matches!(&*model.name, "switch" | "loop") {
            self.unnamed.insert(&model.name);
        }
        for (port_idx, port) in model.ports.iter().enumerate() {
            if is_counted_switch && port.name == "cases" {
                for (case, case_idx) in self.cases(id).iter().zip(1..) {
                    attribute(&mut self.text, &format!("case_{case_idx}"), &text_of(case));
                }
                continue;
            }
            let (theirs, form) = names::port(&model.name, &port.name);
            if let Some(value) = self.value(id, port_idx, port, form, theirs != port.name) {
                attribute(&mut self.text, theirs, &value);
            }
        }
        tag
    }

    /// What stands for a port; nothing when it has its default or no text form.
    fn value(&self, id: NodeId, port_idx: usize, port: &PortSpec, form: Form, is_renamed: bool) -> Option<String> {
        match self.source(id, port_idx)? {
            Source::Unset => None,
            source @ (Source::Slot(_) | Source::Field(_)) => {
                let scope = *self.scopes.of_node.get(id as usize)?;
                Some(format!("{{{}}}", self.scopes.key(scope, source.slot()?)?))
            }
            Source::Literal(value) => {
                if let Some(status) = value.downcast_ref::<Status>() {
                    return Some(status.name().to_uppercase());
                }
                let literal = literal_of(value, Some(&port.port_type), &self.tree.run.forms)?;
                match (form, &literal) {
                    (Form::Millis, Literal::Float(secs)) => Some(millis(*secs)),
                    #[expect(clippy::cast_precision_loss, reason = "settings are far below 2^53")]
                    (Form::Millis, Literal::Int(secs)) => Some(millis(*secs as f64)),
                    // Other defaults there, or none.
                    _ if port.default.as_ref().is_none_or(|default| is_renamed || *default != literal) => {
                        Some(text_of(&literal).into_owned())
                    }
                    _ => None,
                }
            }
        }
    }

    fn source(&self, id: NodeId, port_idx: usize) -> Option<&'a Source> {
        self.tree.sources.get(self.tree.nodes[id as usize].first_source as usize + port_idx)
    }

    fn cases(&self, id: NodeId) -> Vec<Literal> {
        match self.source(id, 1) {
            Some(Source::Literal(value)) => value.downcast_ref::<Vec<Literal>>().cloned().unwrap_or_default(),
            _ => Vec::new(),
        }
    }

    /// The name of a node's kind; of a switch and a loop it depends on what they are given.
    fn model_name(&self, id: NodeId, ours: &'a str) -> Cow<'a, str> {
        match self.tree.nodes[id as usize].kind {
            Kind::Switch => Cow::Owned(names::switch(self.cases(id).len())),
            Kind::Loop => {
                let item = self.source(id, 0).and_then(|over| self.item_type(over));
                let name = names::LOOPS.iter().find(|(_, item_type)| Some(*item_type) == item.as_deref());
                Cow::Borrowed(name.map_or(ours, |(name, _)| name))
            }
            _ => Cow::Borrowed(names::kind(ours)),
        }
    }

    /// The type of the items of what a loop goes over.
    fn item_type(&self, over: &Source) -> Option<Cow<'a, str>> {
        match over {
            Source::Slot(slot) => {
                let port_type = self.tree.slot_types.get(*slot as usize)?.as_ref()?;
                let item = port_type.name().strip_prefix("Vec<").or_else(|| port_type.name().strip_prefix("Queue<"))?;
                item.strip_suffix('>').map(Cow::Borrowed)
            }
            Source::Literal(value) => {
                let literal = literal_of(value, None, &self.tree.run.forms)?;
                let Literal::List(items) = literal else { return None };
                let is_all = |fits: fn(&Literal) -> bool| items.iter().all(fits);
                Some(Cow::Borrowed(if is_all(|item| matches!(item, Literal::Int(_))) {
                    "i32"
                } else if is_all(|item| matches!(item, Literal::Int(_) | Literal::Float(_))) {
                    "f64"
                } else if is_all(|item| matches!(item, Literal::Bool(_))) {
                    "bool"
                } else if is_all(|item| matches!(item, Literal::Text(_))) {
                    "String"
                } else {
                    return None;
                }))
            }
            Source::Unset | Source::Field(_) => None,
        }
    }

    fn models(&mut self) {
        let mut models: BTreeMap<String, String> = BTreeMap::new();
        for model in self.tree.models.iter() {
            match &*model.name {
                "switch" => {
                    for n_cases in names::SWITCH_CASES {
                        models.insert(names::switch(n_cases), switch_text(model, n_cases));
                    }
                }
                "loop" => {
                    for (name, item_type) in names::LOOPS {
                        models.insert(name.to_owned(), model_text(model, name, Some(item_type)));
                    }
                }
                ours => {
                    let name = names::kind(ours);
                    models.insert(name.to_owned(), model_text(model, name, None));
                    continue;
                }
            }
            if self.unnamed.contains(&*model.name) {
                models.insert(model.name.to_string(), model_text(model, &model.name, None));
            }
        }
        self.text.push_str("  <TreeNodesModel>\n");
        self.text.extend(models.into_values());
        self.text.push_str("  </TreeNodesModel>\n");
    }
}

fn model_text(model: &NodeModel, name: &str, item_type: Option<&str>) -> String {
    let mut text = begin_model(model, name);
    for port in &model.ports {
        let (theirs, form) = names::port(&model.name, &port.name);
        let type_name = match (form, item_type, &*port.name) {
            (Form::Millis, ..) => "unsigned int".to_owned(),
            (_, Some(item), "over") => format!("std::deque<{}>", names::type_name(item)),
            (_, Some(item), "item") => names::type_name(item),
            _ => names::type_name(port.port_type.name()),
        };
        port_text(&mut text, port, theirs, &type_name);
    }
    end_model(text, model)
}

fn switch_text(model: &NodeModel, n_cases: usize) -> String {
    let mut text = begin_model(model, &names::switch(n_cases));
    for port in &model.ports {
        if port.name == "cases" {
            for case_idx in 1..=n_cases {
                port_text(&mut text, port, &format!("case_{case_idx}"), "std::string");
            }
        } else {
            port_text(&mut text, port, &port.name, "std::string");
        }
    }
    end_model(text, model)
}

fn begin_model(model: &NodeModel, name: &str) -> String {
    let mut text = format!("    <{}", tag(model.class));
    attribute(&mut text, "ID", name);
    text.push_str(if model.ports.is_empty() { "/>\n" } else { ">\n" });
    text
}

fn end_model(mut text: String, model: &NodeModel) -> String {
    if !model.ports.is_empty() {
        let _infallible = writeln!(text, "    </{}>", tag(model.class));
    }
    text
}

fn port_text(text: &mut String, port: &PortSpec, name: &str, type_name: &str) {
    let tag = match port.direction {
        Direction::In => "input_port",
        Direction::Out => "output_port",
        Direction::InOut => "inout_port",
    };
    let _infallible = write!(text, "      <{tag}");
    attribute(text, "name", name);
    attribute(text, "type", type_name);
    match (&port.default, &port.default_key) {
        (Some(literal), _) if type_name == "BT::NodeStatus" => attribute(text, "default", &text_of(literal).to_uppercase()),
        (Some(literal), _) => attribute(text, "default", &text_of(literal)),
        (None, Some(key)) => attribute(text, "default", &format!("{{{key}}}")),
        (None, None) => {}
    }
    if port.doc.is_empty() {
        text.push_str("/>\n");
    } else {
        text.push('>');
        escape(text, &port.doc);
        let _infallible = writeln!(text, "</{tag}>");
    }
}

fn tag(class: NodeClass) -> &'static str {
    match class {
        NodeClass::Control => "Control",
        NodeClass::Decorator => "Decorator",
        NodeClass::Action | NodeClass::Step => "Action",
        NodeClass::Condition => "Condition",
        NodeClass::Subtree => "SubTree",
    }
}

/// Whether a kind can be the name of its element; else it is an attribute.
fn is_element_name(name: &str) -> bool {
    let is_taken = ["root", "BehaviorTree", "TreeNodesModel", "include", "SubTree"].contains(&name)
        || ["Action", "Condition", "Control", "Decorator"].contains(&name);
    !is_taken
        && name.starts_with(|first: char| first.is_ascii_alphabetic() || first == '_')
        && name.chars().all(|letter| letter.is_ascii_alphanumeric() || matches!(letter, '_' | '-' | '.'))
}

/// Whole milliseconds; a time without end is the longest there is.
fn millis(secs: f64) -> String {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "the cast keeps to the limits")]
    let millis = (secs * 1e3).round() as u32;
    millis.to_string()
}

/// A literal as BehaviorTree.CPP writes it: lists with semicolons, all else that is nested as JSON.
fn text_of(literal: &Literal) -> Cow<'_, str> {
    let is_plain = |item: &Literal| !matches!(item, Literal::List(_) | Literal::Map(_));
    match literal {
        Literal::Text(text) => Cow::Borrowed(text),
        Literal::List(items) if items.iter().all(is_plain) => Cow::Owned(items.iter().map(text_of).collect::<Vec<_>>().join(";")),
        Literal::List(_) | Literal::Map(_) => {
            let mut text = "json:".to_owned();
            json(&mut text, literal);
            Cow::Owned(text)
        }
        other => Cow::Owned(other.to_string()),
    }
}

fn json(text: &mut String, literal: &Literal) {
    match literal {
        Literal::Text(value) => json_text(text, value),
        Literal::List(items) => {
            text.push('[');
            for (item_idx, item) in items.iter().enumerate() {
                text.push_str(if item_idx == 0 { "" } else { "," });
                json(text, item);
            }
            text.push(']');
        }
        Literal::Map(items) => {
            text.push('{');
            for (item_idx, (key, item)) in items.iter().enumerate() {
                text.push_str(if item_idx == 0 { "" } else { "," });
                json_text(text, key);
                text.push(':');
                json(text, item);
            }
            text.push('}');
        }
        other => {
            let _infallible = write!(text, "{other}");
        }
    }
}

fn json_text(text: &mut String, value: &str) {
    text.push('"');
    for letter in value.chars() {
        match letter {
            '"' | '\\' => text.extend(['\\', letter]),
            control if control < ' ' => {
                let _infallible = write!(text, "\\u{:04x}", u32::from(control));
            }
            other => text.push(other),
        }
    }
    text.push('"');
}

fn indent(text: &mut String, depth: usize) {
    text.extend(std::iter::repeat_n("  ", depth));
}

fn attribute(text: &mut String, name: &str, value: &str) {
    let _infallible = write!(text, " {name}=\"");
    escape(text, value);
    text.push('"');
}

fn escape(text: &mut String, value: &str) {
    for letter in value.chars() {
        match letter {
            '&' => text.push_str("&amp;"),
            '<' => text.push_str("&lt;"),
            '>' => text.push_str("&gt;"),
            '"' => text.push_str("&quot;"),
            '\n' => text.push_str("&#10;"),
            '\r' => text.push_str("&#13;"),
            '\t' => text.push_str("&#9;"),
            // XML has no way to write these.
            '\u{0}'..='\u{1f}' | '\u{fffe}' | '\u{ffff}' => text.push('\u{fffd}'),
            other => text.push(other),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::registry::Registry;
    use crate::spec::{NodeSpec, SubtreePort, SubtreeSpec, TreeSpec};

    fn xml(spec: &TreeSpec) -> String {
        let mut registry = Registry::<()>::new();
        registry.step("measure", [PortSpec::output::<f64>("width_m")], |tick| {
            tick.set("width_m", 0.0);
            Ok(())
        });
        registry.step("close to", [PortSpec::setting::<f64>("width_m").default_value(0.08)], |_tick| Ok(()));
        match registry.build(spec) {
            Ok(tree) => tree_xml(&tree),
            Err(errors) => panic!("{}", errors[0]),
        }
    }

    /// Without the models and the line of the root element.
    #[track_caller]
    fn check(root: NodeSpec, expected: &str) {
        let xml = xml(&TreeSpec { allows_unwritten_keys: true, ..TreeSpec::new(root) });
        let trees: Vec<&str> = xml.lines().skip(1).take_while(|line| !line.contains("<TreeNodesModel>")).map(str::trim).collect();
        assert_eq!(trees[1..trees.len() - 1].join(""), expected);
    }

    fn leaf() -> NodeSpec {
        NodeSpec::new("always_success")
    }

    const LEAF: &str = r#"<AlwaysSuccess name="AlwaysSuccess" _uid="2"/>"#;

    #[test]
    fn built_in_nodes_have_their_names_there() {
        let around = |name: &str, ports: &str| format!(r#"<{name} name="{name}" _uid="1"{ports}>{LEAF}</{name}>"#);
        check(NodeSpec::new("inverter").child(leaf()), &around("Inverter", ""));
        check(NodeSpec::new("timeout").with("secs", 1.5).child(leaf()), &around("Timeout", r#" msec="1500""#));
        check(NodeSpec::new("delay").with("secs", 2).child(leaf()), &around("Delay", r#" delay_msec="2000""#));
        check(NodeSpec::new("retry").with("attempts", 3).child(leaf()), &around("RetryUntilSuccessful", r#" num_attempts="3""#));
        check(
            NodeSpec::new("retry").with("attempts", 3).with("on", vec!["lost", "slipped"]).child(leaf()),
            &around("RetryUntilSuccessful", r#" num_attempts="3" on="lost;slipped""#),
        );
        check(NodeSpec::new("repeat").child(leaf()), &around("Repeat", r#" num_cycles="-1""#));
        check(NodeSpec::new("parallel").child(leaf()), &around("Parallel", r#" success_count="-1" failure_count="1""#));
        check(
            NodeSpec::new("precondition").with("if", "a < 1 && b").with("else", "skipped").child(leaf()),
            &around("Precondition", r#" if="a &lt; 1 &amp;&amp; b" else="SKIPPED""#),
        );
        check(NodeSpec::new("rate_limit").with("hz", 10).child(leaf()), &around("RateController", r#" hz="10""#));
    }

    #[test]
    fn loops_and_switches_are_named_by_what_they_are_given() {
        let each = |over: Literal, name: &str, queue: &str| {
            let node = NodeSpec::new("loop").with("over", over).child(leaf());
            let expected =
                format!(r#"<{name} name="{name}" _uid="1" queue="{queue}" value="{{item}}" if_empty="SUCCESS">{LEAF}</{name}>"#);
            check(node, &expected);
        };
        each(vec![1, 2].into(), "LoopInt", "1;2");
        each(vec![0.5, 2.0].into(), "LoopDouble", "0.5;2");
        each(vec!["a", "b"].into(), "LoopString", "a;b");
        let switch = |cases: Vec<&str>| {
            let children = (0..=cases.len()).map(|_| leaf());
            NodeSpec::new("switch").with_key("variable", "part").with("cases", cases).children(children)
        };
        let three = xml(&TreeSpec { allows_unwritten_keys: true, ..TreeSpec::new(switch(vec!["cup", "jug"])) });
        assert!(three.contains(r#"<Switch2 name="Switch2" _uid="1" variable="{part}" case_1="cup" case_2="jug">"#), "{three}");
        assert!(three.contains(r#"<Control ID="Switch6">"#) && !three.contains(r#"ID="switch""#));
        let eight = xml(&TreeSpec { allows_unwritten_keys: true, ..TreeSpec::new(switch(vec!["a"; 8])) });
        assert!(eight.contains(r#"<switch name="switch" _uid="1" variable="{part}" cases="a;a;a;a;a;a;a;a">"#), "{eight}");
        assert!(eight.contains(r#"<Control ID="switch">"#));
    }

    #[test]
    fn names_that_xml_does_not_take_are_escaped() {
        check(leaf().title("a < \"b\"\n"), r#"<AlwaysSuccess name="a &lt; &quot;b&quot;&#10;" _uid="1"/>"#);
        check(NodeSpec::new("close to"), r#"<Action ID="close to" name="close to" _uid="1"/>"#);
        check(
            NodeSpec::new("close to").with("width_m", 0.1),
            r#"<Action ID="close to" name="close to" _uid="1" width_m="0.1"/>"#,
        );
    }

    #[test]
    fn models_have_types_defaults_and_sentences() {
        let xml = xml(&TreeSpec::new(leaf()));
        let model = r#"    <Decorator ID="Timeout">
      <input_port name="msec" type="unsigned int">Time for the child, seconds.</input_port>
    </Decorator>
"#;
        assert!(xml.contains(model), "{xml}");
        assert!(xml.contains(r#"<output_port name="width_m" type="double" default="{width_m}"/>"#), "{xml}");
        assert!(xml.contains(r#"<input_port name="else" type="BT::NodeStatus" default="FAILURE">"#), "{xml}");
        assert!(xml.contains(r#"    <Action ID="AlwaysSuccess"/>"#), "{xml}");
    }

    #[test]
    fn each_use_of_a_subtree_has_its_tree_and_its_keys() {
        let inner = NodeSpec::new("sequence")
            .child(NodeSpec::new("measure").with_key("width_m", "found"))
            .child(NodeSpec::new("measure").with_key("width_m", "own"));
        let port = SubtreePort { name: "found".to_owned(), direction: Direction::Out, default: None, location: 0 };
        let subtree = SubtreeSpec { name: "look".to_owned(), ports: vec![port], root: inner, ..SubtreeSpec::default() };
        let of = |key: &str| NodeSpec::subtree("look").with_key("found", key);
        let root = NodeSpec::new("sequence").child(of("left")).child(of("own"));
        let xml = xml(&TreeSpec::new(root).subtree(subtree));
        let trees: Vec<&str> = xml.lines().take_while(|line| !line.contains("<TreeNodesModel>")).collect();
        let expected = r#"<root BTCPP_format="4" main_tree_to_execute="MainTree">
  <BehaviorTree ID="MainTree" _fullpath="">
    <Sequence name="Sequence" _uid="1">
      <SubTree ID="look" _fullpath="sequence/look" _uid="2" left="{left}"/>
      <SubTree ID="look" _fullpath="sequence/look#2" _uid="6" own_="{own}"/>
    </Sequence>
  </BehaviorTree>
  <BehaviorTree ID="look" _fullpath="sequence/look">
    <Sequence name="Sequence" _uid="3">
      <measure name="measure" _uid="4" width_m="{left}"/>
      <measure name="measure" _uid="5" width_m="{own}"/>
    </Sequence>
  </BehaviorTree>
  <BehaviorTree ID="look" _fullpath="sequence/look#2">
    <Sequence name="Sequence" _uid="7">
      <measure name="measure" _uid="8" width_m="{own_}"/>
      <measure name="measure" _uid="9" width_m="{own}"/>
    </Sequence>
  </BehaviorTree>"#;
        assert_eq!(trees.join("\n"), expected);
    }
}

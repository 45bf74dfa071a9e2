//! A [`TreeSpec`] to a file.

use super::models::{is_xml, loop_for_items, loop_for_type, write_attribute, write_palette};
use super::names::{self, BuiltIn};
use super::problem::{XmlFault, XmlPlace, XmlProblem, excerpt};
use super::value::{self, Kind};
use crate::literal::Literal;
use crate::registry::{NodeClass, NodeModel};
use crate::spec::{NodeKind, NodeSpec, PortSetting, PortValue, SubtreeSpec, TreeSpec};
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;

/// As deep as BehaviorTree.CPP reads.
const DEPTH_MAX: usize = 256;

/// A BehaviorTree.CPP v4 file with `spec`, and with a palette of the application's nodes in `models` and of the subtrees' ports.
///
/// [`super::import`] makes the same tree of it, with other locations, and with these differences:
/// - Constants of the application's nodes are texts: XML has no types. Whole numbers for ports of seconds are fractions.
/// - Subtrees are open, and keys that nothing writes are allowed: BehaviorTree.CPP knows no other trees.
/// - What BehaviorTree.CPP has no default for is written out: the endless `repeat`, the ports that users of a subtree leave out.
///
/// # Errors
/// Every part of the tree that BehaviorTree.CPP cannot say, in the order of the nodes.
pub fn export(spec: &TreeSpec, models: &[NodeModel]) -> Result<String, Vec<XmlProblem>> {
    let mut exporter = Exporter {
        models: models.iter().map(|model| (&*model.name, model)).collect(),
        subtrees: spec.subtrees.iter().map(|subtree| (subtree.name.as_str(), subtree)).collect(),
        loops: BTreeMap::new(),
        out: String::new(),
        titles: BTreeSet::new(),
        path: Vec::new(),
        problems: Vec::new(),
    };
    let main = main_name(&exporter.subtrees);
    exporter.out.push_str("<root BTCPP_format=\"4\"");
    write_attribute(&mut exporter.out, "main_tree_to_execute", &main);
    exporter.out.push_str(">\n");
    for (key, _, location) in &spec.entries {
        let help = "write a set_blackboard or a script that runs first";
        exporter.lossy(*location, key, "blackboard entries that exist before the first tick", help);
    }
    exporter.tree(&main, 0, &spec.root);
    let mut seen = BTreeSet::new();
    for subtree in &spec.subtrees {
        if !seen.insert(subtree.name.as_str()) {
            exporter.problem(subtree.location, &subtree.name, XmlFault::DuplicateTree, "rename one of them");
        }
        exporter.subtree(subtree);
    }
    write_palette(&mut exporter.out, models, &spec.subtrees);
    exporter.out.push_str("</root>\n");
    if exporter.problems.is_empty() { Ok(exporter.out) } else { Err(exporter.problems) }
}

/// A name for the root's tree that no subtree has.
fn main_name(subtrees: &BTreeMap<&str, &SubtreeSpec>) -> String {
    let mut name = "MainTree".to_owned();
    while subtrees.contains_key(name.as_str()) {
        name.push('_');
    }
    name
}

struct Exporter<'a> {
    models: BTreeMap<&'a str, &'a NodeModel>,
    subtrees: BTreeMap<&'a str, &'a SubtreeSpec>,
    /// The loop node for the lists that nodes of the current tree write, by key.
    loops: BTreeMap<&'a str, &'static str>,
    out: String,
    /// Titles of the subtrees that the current tree uses.
    titles: BTreeSet<&'a str>,
    path: Vec<&'a str>,
    problems: Vec<XmlProblem>,
}

impl<'a> Exporter<'a> {
    fn problem(&mut self, location: u32, text: &str, fault: XmlFault, help: &str) {
        let place = XmlPlace::Node { path: self.path.join("/"), location };
        self.problems.push(XmlProblem { place, text: excerpt(text), fault, help: help.to_owned() });
    }

    fn lossy(&mut self, location: u32, text: &str, what: &'static str, help: &str) {
        self.problem(location, text, XmlFault::Lossy { what }, help);
    }

    fn check_name(&mut self, location: u32, name: &str, fault: Option<XmlFault>) {
        if let Some(fault) = fault {
            self.problem(location, name, fault, "rename it; letters, digits, _ and - are allowed");
        }
    }

    fn attribute(&mut self, location: u32, name: &str, value: &str) {
        if let Some(letter) = value.chars().find(|letter| !is_xml(*letter)) {
            self.problem(location, value, XmlFault::ForbiddenLetter { letter }, "XML cannot hold this letter");
        }
        write_attribute(&mut self.out, name, value);
    }

    fn subtree(&mut self, subtree: &'a SubtreeSpec) {
        self.path.push(&subtree.name);
        let taken = names::find(&subtree.name).map(|_| XmlFault::ReservedName);
        self.check_name(subtree.location, &subtree.name, names::name_fault(&subtree.name).or(taken));
        let mut seen = BTreeSet::new();
        for port in &subtree.ports {
            self.check_name(port.location, &port.name, names::port_fault(&port.name));
            if !seen.insert(port.name.as_str()) {
                self.lossy(port.location, &port.name, "ports with one name", "rename one of them");
            }
            if names::port_fault(&port.name).is_none() && !is_element(&port.name) {
                self.lossy(port.location, &port.name, "way to write this port name in XML", "rename the port");
            }
            let default = port.default.clone().map(PortValue::Literal);
            match default.map(|value| value::write(Kind::Subtree, &port.name, &value)) {
                Some(Ok(text)) if text.is_empty() => {
                    self.lossy(port.location, &port.name, "empty defaults", "give another default")
                }
                Some(Err(what)) => self.lossy(port.location, &port.name, what, "leave the default out"),
                _ => {}
            }
        }
        self.tree(&subtree.name, subtree.location, &subtree.root);
        self.path.pop();
    }

    fn tree(&mut self, name: &str, location: u32, root: &'a NodeSpec) {
        self.loops.clear();
        self.titles.clear();
        self.collect_loops(root, 1);
        self.out.push_str("  <BehaviorTree");
        self.attribute(location, "ID", name);
        self.out.push_str(">\n");
        self.node(root, 1);
        self.out.push_str("  </BehaviorTree>\n");
    }

    /// The types of the lists that nodes write: BehaviorTree.CPP has one loop node a type.
    fn collect_loops(&mut self, node: &'a NodeSpec, depth: usize) {
        if let NodeKind::Named(name) = &node.kind
            && let Some(model) = self.models.get(name.as_str())
        {
            for port in model.ports.iter().filter(|port| port.direction.writes()) {
                let key = match node.ports.iter().find(|setting| setting.name == port.name).map(|setting| &setting.value) {
                    Some(PortValue::Key(key)) => Some(key.as_str()),
                    Some(PortValue::Literal(_)) => None,
                    None => port.default_key.as_deref(),
                };
                if let (Some(key), Some(theirs)) = (key, loop_for_type(port.port_type().name())) {
                    self.loops.entry(key).or_insert(theirs);
                }
            }
        }
        if depth < DEPTH_MAX {
            for child in &node.children {
                self.collect_loops(child, depth + 1);
            }
        }
    }

    fn node(&mut self, node: &'a NodeSpec, depth: usize) {
        let name = match &node.kind {
            NodeKind::Named(name) | NodeKind::Subtree(name) => name.as_str(),
        };
        self.path.push(name);
        if depth > DEPTH_MAX {
            let fault = XmlFault::TooDeep { limit: DEPTH_MAX };
            self.problem(node.location, name, fault, "put a part of the tree into a subtree");
            self.path.pop();
            return;
        }
        for _ in 0..=depth {
            self.out.push_str("  ");
        }
        let element = match &node.kind {
            NodeKind::Subtree(name) => self.subtree_use(node, name),
            NodeKind::Named(name) => match self.built_in(node, name) {
                Some(built_in) => self.built_in_node(node, built_in),
                None => self.application_node(node, name),
            },
        };
        self.title_and_conditions(node);
        if node.children.is_empty() {
            self.out.push_str("/>\n");
        } else {
            self.out.push_str(">\n");
            for child in &node.children {
                self.node(child, depth + 1);
            }
            for _ in 0..=depth {
                self.out.push_str("  ");
            }
            _ = writeln!(self.out, "</{element}>");
        }
        self.path.pop();
    }

    /// The node of BehaviorTree.CPP that is our `name`; of switches and loops the right one for the ports.
    fn built_in(&mut self, node: &NodeSpec, name: &str) -> Option<&'static BuiltIn> {
        let value_of = |port: &str| node.ports.iter().find(|setting| setting.name == port).map(|setting| &setting.value);
        match name {
            "switch" => {
                let n_cases = match value_of("cases") {
                    Some(PortValue::Literal(Literal::List(cases))) => cases.len(),
                    _ => 0,
                };
                let found = names::BUILT_INS.iter().find(|built_in| built_in.n_cases == n_cases && n_cases > 0);
                if found.is_none() {
                    self.lossy(node.location, name, "switch other than of 2 to 6 constant cases", "nest two switches");
                }
                found.or(names::find("Switch2"))
            }
            "loop" => match value_of("over") {
                Some(PortValue::Literal(Literal::List(items))) => names::find(loop_for_items(items)),
                Some(PortValue::Key(key)) => {
                    let found = self.loops.get(key.as_str()).copied();
                    if found.is_none() {
                        let help = "let a node of the same tree write the list as Vec<f64>, Vec<i64>, Vec<bool> or Vec<String>";
                        self.lossy(node.location, key, "loop over entries of an unknown type", help);
                    }
                    names::find(found.unwrap_or("LoopString"))
                }
                _ => names::find("LoopString"),
            },
            _ => names::find_ours(name),
        }
    }

    fn built_in_node(&mut self, node: &NodeSpec, built_in: &'static BuiltIn) -> &'a str {
        _ = write!(self.out, "<{}", built_in.theirs);
        if names::is_ours_only(built_in.ours) {
            self.lossy(node.location, built_in.ours, "node like this", "use other nodes");
            return built_in.theirs;
        }
        self.check_duplicates(node);
        for setting in &node.ports {
            if built_in.n_cases > 0 && setting.name == "cases" {
                self.cases(setting);
                continue;
            }
            let Some(port) = built_in.ports.iter().find(|port| port.ours == setting.name) else {
                self.lossy(setting.name_location, &setting.name, "port like this", "leave it out");
                continue;
            };
            self.port(setting, port.theirs, port.kind);
        }
        if built_in.theirs == "Repeat" && node.ports.is_empty() {
            self.attribute(node.location, "num_cycles", "-1");
        }
        if built_in.n_cases > 0 && node.children.len() != built_in.n_cases + 1 {
            let expected = "one child a case and one for the rest";
            let fault = XmlFault::ChildCount { expected, n_found: node.children.len() };
            self.problem(node.location, built_in.ours, fault, "correct the children");
        }
        built_in.theirs
    }

    fn cases(&mut self, setting: &PortSetting) {
        let PortValue::Literal(Literal::List(cases)) = &setting.value else { return };
        for (case, port) in cases.iter().zip(names::CASES) {
            let value = PortValue::Literal(case.clone());
            let setting = PortSetting { value, ..setting.clone() };
            self.port(&setting, port, Kind::Text);
        }
    }

    fn port(&mut self, setting: &PortSetting, theirs: &str, kind: Kind) {
        match value::write(kind, theirs, &setting.value) {
            Ok(text) => self.attribute(setting.location, theirs, &text),
            Err(what) => {
                let text = match &setting.value {
                    PortValue::Literal(Literal::Text(text)) => text.clone(),
                    PortValue::Literal(literal) => literal.to_string(),
                    PortValue::Key(key) => format!("{{{key}}}"),
                };
                self.lossy(setting.location, &text, what, &format!("give port {:?} another value", setting.name));
            }
        }
    }

    fn application_node(&mut self, node: &NodeSpec, name: &'a str) -> &'a str {
        if names::is_ours(name) {
            self.lossy(node.location, name, "node like this", "use other nodes");
        }
        let is_theirs = names::find(name).is_some() || names::version_3(name).is_some();
        let taken = is_theirs.then_some(XmlFault::ReservedName);
        self.check_name(node.location, name, names::node_fault(name).or(taken));
        let element = if is_element(name) {
            name
        } else {
            let guess = match node.children.len() {
                0 => NodeClass::Action,
                1 => NodeClass::Decorator,
                _ => NodeClass::Control,
            };
            names::element_of(self.models.get(name).map_or(guess, |model| model.class))
        };
        _ = write!(self.out, "<{element}");
        if element != name {
            self.attribute(node.location, "ID", name);
        }
        self.named_ports(node, Kind::Application);
        element
    }

    fn subtree_use(&mut self, node: &'a NodeSpec, name: &str) -> &'a str {
        self.out.push_str("<SubTree");
        self.attribute(node.location, "ID", name);
        if !self.subtrees.contains_key(name) {
            self.problem(node.location, name, XmlFault::UnknownTree, "add the subtree");
        }
        if !node.children.is_empty() {
            let fault = XmlFault::ChildCount { expected: "no children of a use of a subtree", n_found: node.children.len() };
            self.problem(node.location, name, fault, "remove them");
        }
        if let Some(title) = &node.title
            && !self.titles.insert(title)
        {
            self.lossy(node.location, title, "two subtrees of one title in a tree", "rename one of them");
        }
        if node.is_autoremapped {
            self.out.push_str(" _autoremap=\"true\"");
        }
        self.named_ports(node, Kind::Subtree);
        let Some(subtree) = self.subtrees.get(name).copied() else { return "SubTree" };
        for port in &subtree.ports {
            if node.ports.iter().any(|setting| setting.name == port.name) {
                continue;
            }
            // Without default a port is mandatory there and the key of its name here; autoremapping passes over defaults there.
            let value = match &port.default {
                None if node.is_autoremapped => continue,
                Some(_) if !node.is_autoremapped => continue,
                None => PortValue::Key(port.name.clone()),
                Some(literal) => PortValue::Literal(literal.clone()),
            };
            let location = node.location;
            let setting = PortSetting { name: port.name.clone(), value, name_location: location, location };
            self.port(&setting, &port.name, Kind::Subtree);
        }
        "SubTree"
    }

    /// Ports that have the same name on both sides.
    fn named_ports(&mut self, node: &NodeSpec, kind: Kind) {
        self.check_duplicates(node);
        for setting in &node.ports {
            self.check_name(setting.name_location, &setting.name, names::port_fault(&setting.name));
            if names::port_fault(&setting.name).is_none() && !is_element(&setting.name) {
                self.lossy(setting.name_location, &setting.name, "way to write this port name in XML", "rename the port");
            }
            self.port(setting, &setting.name, kind);
        }
    }

    fn check_duplicates(&mut self, node: &NodeSpec) {
        let mut seen = BTreeSet::new();
        for setting in &node.ports {
            if !seen.insert(setting.name.as_str()) {
                self.lossy(setting.name_location, &setting.name, "port that is given twice", "give it once");
            }
        }
    }

    fn title_and_conditions(&mut self, node: &NodeSpec) {
        if let Some(title) = &node.title {
            if title.is_empty() {
                self.lossy(node.location, title, "empty titles", "leave the title out");
            }
            if let Some(fault) = names::title_fault(title) {
                self.problem(node.location, title, fault, "rename the node");
            } else {
                self.attribute(node.location, "name", title);
            }
        }
        let mut seen = BTreeSet::new();
        for condition in &node.conditions {
            if !seen.insert(condition.when) {
                self.lossy(condition.location, condition.when.name(), "second script at the same moment", "join the scripts");
            }
            self.attribute(condition.location, names::attribute_of(condition.when), &condition.script);
        }
        if node.is_autoremapped && matches!(node.kind, NodeKind::Named(_)) {
            self.lossy(node.location, "autoremap", "autoremapping of nodes that are no subtrees", "leave it out");
        }
    }
}

/// Whether XML takes the name as an element or attribute; letters beyond ASCII are left to the explicit form.
fn is_element(name: &str) -> bool {
    name.starts_with(|first: char| first.is_ascii_alphabetic() || first == '_')
        && name.chars().all(|letter| letter.is_ascii_alphanumeric() || matches!(letter, '_' | '-'))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::port::{Direction, PortSpec};
    use crate::spec::{SubtreePort, When};

    fn models() -> Vec<NodeModel> {
        let mut find = NodeModel::new("find", NodeClass::Action, vec![PortSpec::output::<Vec<f64>>("heights")]);
        find.doc("");
        vec![find]
    }

    fn leaf() -> NodeSpec {
        NodeSpec::new("lift")
    }

    #[track_caller]
    fn check(root: NodeSpec, expected: &str) {
        let found = export(&TreeSpec::new(root), &models());
        let found = match &found {
            Ok(text) => text.split("\n    ").nth(1).and_then(|rest| rest.split('\n').next()).unwrap_or_default().to_owned(),
            Err(problems) => problems.iter().map(ToString::to_string).collect::<Vec<_>>().join("; "),
        };
        assert_eq!(found, expected);
    }

    #[test]
    fn nodes_and_ports_have_their_names_and_units() {
        check(NodeSpec::new("timeout").with("secs", 1.5).child(leaf()), "<Timeout msec=\"1500\">");
        check(NodeSpec::new("retry").with("attempts", 3).child(leaf()), "<RetryUntilSuccessful num_attempts=\"3\">");
        check(NodeSpec::new("repeat").child(leaf()), "<Repeat num_cycles=\"-1\">");
        check(
            NodeSpec::new("precondition").with("if", "a < b").with("else", "skipped").child(leaf()),
            "<Precondition if=\"a &lt; b\" else=\"SKIPPED\">",
        );
        check(
            NodeSpec::new("set_blackboard").with("value", "1").with_key("output_key", "k"),
            "<SetBlackboard value=\"1\" output_key=\"k\"/>",
        );
        let cases = NodeSpec::new("switch").with_key("variable", "v").with("cases", vec!["a", "b"]);
        check(cases.children([leaf(), leaf(), leaf()]), "<Switch2 variable=\"{v}\" case_1=\"a\" case_2=\"b\">");
    }

    #[test]
    fn nodes_of_the_application_keep_theirs() {
        check(
            leaf().with("height_m", 0.5).with_key("goal", "@goal").title("up & away"),
            "<lift height_m=\"0.5\" goal=\"{@goal}\" name=\"up &amp; away\"/>",
        );
        check(leaf().with("ids", vec![1, 2]).when(When::SkipIf, "a\n&& b"), "<lift ids=\"1;2\" _skipIf=\"a&#10;&amp;&amp; b\"/>");
        check(NodeSpec::new("l\u{ef}ft"), "<Action ID=\"l\u{ef}ft\"/>");
    }

    #[test]
    fn a_loop_has_the_type_of_its_list() {
        let over = |name: &str| NodeSpec::new("loop").with_key("over", name).with_key("item", "x").child(leaf());
        check(NodeSpec::new("loop").with("over", vec![1.5]).child(leaf()), "<LoopDouble queue=\"1.5\">");
        check(NodeSpec::new("loop").with("over", vec!["a"]).child(leaf()), "<LoopString queue=\"a\">");
        let spec = TreeSpec::new(NodeSpec::new("sequence").child(NodeSpec::new("find")).child(over("heights")));
        assert!(export(&spec, &models()).is_ok_and(|text| text.contains("<LoopDouble queue=\"{heights}\" value=\"{x}\">")));
        check(over("heights"), "loop: \"heights\": BehaviorTree.CPP has no loop over entries of an unknown type");
    }

    #[test]
    fn what_only_we_have_is_refused_by_name() {
        check(NodeSpec::new("recover").child(leaf()), "recover: \"recover\": BehaviorTree.CPP has no node like this");
        check(
            NodeSpec::new("rate_limit").with("hz", 1.0).child(leaf()),
            "rate_limit: \"rate_limit\": BehaviorTree.CPP has no node like this",
        );
        check(
            NodeSpec::new("retry").with("attempts", 1).with("on", vec!["slipped"]).child(leaf()),
            "retry: \"on\": BehaviorTree.CPP has no port like this",
        );
        let seven: Vec<String> = (0..7).map(|number| number.to_string()).collect();
        check(
            NodeSpec::new("switch").with_key("variable", "v").with("cases", seven).children(vec![leaf(); 8]),
            "switch: \"switch\": BehaviorTree.CPP has no switch other than of 2 to 6 constant cases; \
             switch: \"switch\": expected one child a case and one for the rest, found 8",
        );
        check(
            leaf().with_key("goal", "grasp.pose"),
            "lift: \"{grasp.pose}\": BehaviorTree.CPP has no fields of blackboard entries",
        );
        check(leaf().with("pose", Literal::Map(vec![])), "lift: \"a map of 0\": BehaviorTree.CPP has no maps");
        check(leaf().with("poses", vec![vec![1.0]]), "lift: \"a list of 1\": BehaviorTree.CPP has no lists of lists");
        check(leaf().with("text", "{x}"), "lift: \"{x}\": BehaviorTree.CPP has no way to write this text as a constant");
        check(leaf().title("a\u{7}"), "lift: \"a\\u{7}\": a name cannot have '\\u{7}'");
        check(leaf().with("text", "a\u{7}"), "lift: \"a\\u{7}\": a name cannot have '\\u{7}'");
        check(leaf().with("my.port", 1), "lift: \"my.port\": a name cannot have '.'");
        check(NodeSpec::new("Sequence").child(leaf()), "Sequence: \"Sequence\": this name is reserved");
        check(NodeSpec::new("open door"), "open door: \"open door\": a name cannot have ' '");
        check(leaf().with("a", 1).with("a", 2), "lift: \"a\": BehaviorTree.CPP has no port that is given twice");
        check(
            leaf().when(When::Post, "a").when(When::Post, "b"),
            "lift: \"post\": BehaviorTree.CPP has no second script at the same moment",
        );
        check(
            NodeSpec::new("sleep").with_key("secs", "t"),
            "sleep: \"{t}\": BehaviorTree.CPP has no key for this port that means the same",
        );
        check(NodeSpec::subtree("None"), "None: \"None\": unknown tree");
        check(leaf().title("a\u{ffff}"), "lift: \"a\\u{ffff}\": a name cannot have '\\u{ffff}'");
    }

    #[test]
    fn two_uses_of_subtrees_in_a_tree_have_two_titles() {
        let subtree = SubtreeSpec { name: "Go".to_owned(), root: leaf(), ..SubtreeSpec::default() };
        let uses = [NodeSpec::subtree("Go").title("go"), NodeSpec::subtree("Go").title("go")];
        let problems = export(&TreeSpec::new(NodeSpec::new("sequence").children(uses)).subtree(subtree), &[]).err();
        let texts: Vec<String> = problems.iter().flatten().map(ToString::to_string).collect();
        assert_eq!(texts, ["sequence/Go: \"go\": BehaviorTree.CPP has no two subtrees of one title in a tree"]);
    }

    #[test]
    fn all_lossy_parts_come_at_once_with_their_paths_and_locations() {
        let mut deep = NodeSpec::new("recover").child(leaf().with_key("goal", "a.b"));
        deep.children[0].ports[0].location = 7;
        let spec = TreeSpec::new(NodeSpec::new("sequence").child(deep)).entry("speed", 1.0);
        let problems = export(&spec, &[]).err().unwrap_or_default();
        let places: Vec<String> = problems.iter().map(|problem| problem.place.to_string()).collect();
        assert_eq!(places, ["", "sequence/recover", "sequence/recover/lift"]);
        assert_eq!(problems[2].place, XmlPlace::Node { path: "sequence/recover/lift".to_owned(), location: 7 });
    }

    #[test]
    fn ports_of_subtrees_are_in_the_palette_and_written_out_in_users() {
        let ports = vec![
            SubtreePort { name: "goal".to_owned(), direction: Direction::In, default: None, location: 0 },
            SubtreePort { name: "speed".to_owned(), direction: Direction::In, default: Some(Literal::Float(2.0)), location: 0 },
        ];
        let subtree = SubtreeSpec { name: "Go".to_owned(), ports, is_open: true, root: leaf(), location: 0 };
        let expected = r#"<root BTCPP_format="4" main_tree_to_execute="MainTree">
  <BehaviorTree ID="MainTree">
    <SubTree ID="Go" goal="{goal}"/>
  </BehaviorTree>
  <BehaviorTree ID="Go">
    <lift/>
  </BehaviorTree>
  <TreeNodesModel>
    <SubTree ID="Go">
      <input_port name="goal"/>
      <input_port name="speed" default="2.0"/>
    </SubTree>
  </TreeNodesModel>
</root>
"#;
        assert_eq!(export(&TreeSpec::new(NodeSpec::subtree("Go")).subtree(subtree), &[]).as_deref(), Ok(expected));
    }
}

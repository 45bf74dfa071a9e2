//! Trees and nodes of a file.

use super::file::{Importer, Reader};
use super::names::{self, BuiltIn};
use super::problem::{XmlFault, XmlProblem};
use super::value::{self, Kind};
use super::{ImportOptions, ImportedTree};
use crate::literal::Literal;
use crate::nearest::nearest;
use crate::registry::NodeClass;
use crate::spec::{ConditionSpec, NodeKind, NodeSpec, PortSetting, PortValue, SubtreeSpec, When};
use roxmltree::{Attribute, Node};

/// The tree of a BehaviorTree.CPP v4 file.
///
/// Built-in nodes get our names, ports and units (see `names.rs`); constants of other nodes stay texts, of subtrees they are numbers
/// if they look like it. Ports that a model of the subtree gives a key are written into its users, as BehaviorTree.CPP does.
///
/// # Errors
/// Every mistake with its place, in the order of the files; the first 1000. What BehaviorTree.CPP 4 would not load is refused, and
/// what would mean something else here: `ros_pkg`, keys with dots, keys for milliseconds.
pub fn import(text: &str, options: &ImportOptions<'_>) -> Result<ImportedTree, Vec<XmlProblem>> {
    let mut importer = Importer::new(options);
    importer.file(text, String::new(), 0);
    let spec = importer.finish();
    let (problems, warnings) = importer.findings();
    match spec {
        Some(spec) if problems.is_empty() => {
            let Importer { places, files, models, .. } = importer;
            Ok(ImportedTree { spec, places, files, models, warnings })
        }
        _ => Err(problems),
    }
}

/// What a node is, before its attributes are read.
struct Head<'a> {
    name: &'a str,
    class: Option<NodeClass>,
    built_in: Option<&'static BuiltIn>,
    /// Of a switch: where the cases are among the ports, and which were given.
    cases: Option<usize>,
    given: [Option<Literal>; 6],
}

impl Reader<'_, '_> {
    pub(super) fn behavior_tree(&mut self, element: Node<'_, '_>) {
        let location = self.at(element.range().start);
        let is_only = element.parent_element().is_some_and(|root| root.children().filter(Node::is_element).count() == 1);
        let name = match element.attribute_node("ID") {
            Some(id) => {
                self.check_name(id.range_value().start, id.value(), names::name_fault);
                if names::find(id.value()).is_some() {
                    self.value_problem(id, XmlFault::ReservedName, "a node has this name; rename the tree");
                }
                id.value().to_owned()
            }
            // Nobody can name it; this only keeps it apart from the nameless trees of other files.
            None if is_only => format!("BehaviorTree_{}", self.importer.files.len() - 1),
            None => {
                let fault = XmlFault::MissingAttribute { attribute: "ID" };
                self.importer.problem(location, "BehaviorTree", fault, "give every tree of the file a name");
                String::new()
            }
        };
        for attribute in element.attributes() {
            if attribute.name() != "ID" && !attribute.name().starts_with('_') {
                self.warn_ignored(attribute, ["ID"]);
            }
        }
        let mut roots = Vec::new();
        for child in element.children() {
            if child.is_element() {
                roots.push(self.node(child, 1));
            } else {
                self.warn_text(child);
            }
        }
        if roots.len() != 1 {
            let fault = XmlFault::ChildCount { expected: "exactly one node in a tree", n_found: roots.len() };
            self.importer.problem(location, "BehaviorTree", fault, "put the nodes into a <Sequence>, or what you mean");
        }
        if !name.is_empty() && !self.importer.tree_names.insert(name.clone()) {
            self.importer.problem(location, &name, XmlFault::DuplicateTree, "rename one of them");
        }
        let root = if roots.is_empty() { NodeSpec::default() } else { roots.swap_remove(0) };
        self.importer.trees.push(SubtreeSpec { name, ports: Vec::new(), is_open: true, root, location });
    }

    fn node(&mut self, element: Node<'_, '_>, depth: usize) -> NodeSpec {
        let location = self.at(element.range().start);
        let mut spec = NodeSpec { location, ..NodeSpec::default() };
        if self.importer.is_full() {
            return spec;
        }
        let limit = self.importer.options.depth_max;
        if depth > limit {
            let text = element.tag_name().name();
            self.importer.problem(location, text, XmlFault::TooDeep { limit }, "put a part of the tree into a subtree");
            return spec;
        }
        let Some(mut head) = self.head(element) else {
            // Its children have mistakes of their own.
            for child in element.children().filter(Node::is_element) {
                self.node(child, depth + 1);
            }
            return spec;
        };
        spec.kind = match (head.class, head.built_in) {
            (Some(NodeClass::Subtree), _) => NodeKind::Subtree(head.name.to_owned()),
            (_, Some(built_in)) => NodeKind::Named(built_in.ours.to_owned()),
            (_, None) => NodeKind::Named(head.name.to_owned()),
        };
        spec.ports.reserve_exact(element.attributes().len());
        spec.children.reserve_exact(element.children().filter(Node::is_element).count());
        for attribute in element.attributes() {
            self.attribute(attribute, &mut head, &mut spec);
        }
        // The default of Nav2's node, which ours does not have.
        if head.name == names::RATE_CONTROLLER && spec.ports.is_empty() {
            let value = PortValue::Literal(Literal::Float(10.0));
            spec.ports.push(PortSetting { name: "hz".to_owned(), value, name_location: location, location });
        }
        for child in element.children() {
            if child.is_element() {
                let child = self.node(child, depth + 1);
                spec.children.push(child);
            } else if child.is_text() {
                self.warn_text(child);
            }
        }
        self.check_children(element, &head, location, spec.children.len());
        self.collect_cases(&head, &mut spec);
        spec
    }

    /// The name of a node, refused if it cannot be one.
    fn head<'a>(&mut self, element: Node<'a, '_>) -> Option<Head<'a>> {
        let tag = element.tag_name();
        let class = names::class_of(tag.name());
        let (offset, name) = match class {
            None => (element.range().start, tag.name()),
            Some(_) => match element.attribute_node("ID") {
                Some(id) => (id.range_value().start, id.value()),
                None => {
                    let help = format!("write <{} ID=\"...\">", tag.name());
                    self.element_problem(element, XmlFault::MissingAttribute { attribute: "ID" }, help);
                    return None;
                }
            },
        };
        if self.is_version_3(offset, name) {
            return None;
        }
        let is_prefixed =
            tag.namespace().is_some_and(|namespace| element.lookup_prefix(namespace).is_some_and(|p| !p.is_empty()));
        if is_prefixed {
            self.element_problem(element, XmlFault::ForbiddenLetter { letter: ':' }, "rename the node");
            return None;
        }
        let built_in = names::find(name);
        if class == Some(NodeClass::Subtree) {
            self.check_name(offset, name, names::name_fault);
            let location = self.at(offset);
            if built_in.is_some() {
                self.importer.problem(location, name, XmlFault::ReservedName, "a node has this name; rename the tree");
            }
            self.importer.uses.push((name.to_owned(), location));
        } else if built_in.is_none() {
            self.check_name(offset, name, names::node_fault);
            if names::is_ours(name) {
                let help = match names::find_ours(name) {
                    Some(theirs) => format!("write {}, or rename the node if it is another", theirs.theirs),
                    None => "rename it; the engine has another node of this name".to_owned(),
                };
                let location = self.at(offset);
                self.importer.problem(location, name, XmlFault::ReservedName, help);
            }
        }
        let given = std::array::from_fn(|_| None);
        Some(Head { name, class, built_in: built_in.filter(|_| class != Some(NodeClass::Subtree)), cases: None, given })
    }

    pub(super) fn check_name(&mut self, offset: usize, name: &str, fault: fn(&str) -> Option<XmlFault>) {
        if let Some(fault) = fault(name) {
            let location = self.at(offset);
            self.importer.problem(location, name, fault, "rename it; letters, digits, _ and - are allowed");
        }
    }

    fn attribute(&mut self, attribute: Attribute<'_, '_>, head: &mut Head<'_>, spec: &mut NodeSpec) {
        let (name, value) = (attribute.name(), attribute.value());
        if attribute.namespace().is_some() {
            self.name_problem(attribute, XmlFault::ForbiddenLetter { letter: ':' }, "rename the port");
        } else if name == "ID" {
            if head.class.is_none() {
                self.name_problem(attribute, XmlFault::MisplacedAttribute, "it belongs to <Action ID=\"...\"> and the like");
            }
        } else if name == "name" {
            if let Some(fault) = names::title_fault(value) {
                self.value_problem(attribute, fault, "rename the node");
            }
            spec.title = (!value.is_empty()).then(|| value.to_owned());
        } else if name.starts_with('_') {
            self.reserved(attribute, head, spec);
        } else {
            self.port(attribute, head, spec);
        }
    }

    fn reserved(&mut self, attribute: Attribute<'_, '_>, head: &Head<'_>, spec: &mut NodeSpec) {
        let (name, value) = (attribute.name(), attribute.value());
        if let Some(when) = names::when_of(name) {
            let location = self.at(attribute.range_value().start);
            return spec.conditions.push(ConditionSpec { when, script: value.to_owned(), location });
        }
        match name {
            "_description" | "_uid" | "_fullpath" => {}
            "_autoremap" if head.class == Some(NodeClass::Subtree) => match value::read(Kind::Bool, name, value) {
                Ok(PortValue::Literal(Literal::Bool(is_autoremapped))) => spec.is_autoremapped = is_autoremapped,
                _ => self.value_problem(attribute, XmlFault::BadValue { expected: "true or false".to_owned() }, "write true"),
            },
            _ if self.is_version_3(attribute.range().start, name) => {}
            _ => {
                let known = When::ALL.into_iter().map(names::attribute_of);
                self.warn_ignored(attribute, known.chain(["_autoremap", "_description"]));
            }
        }
    }

    fn port(&mut self, attribute: Attribute<'_, '_>, head: &mut Head<'_>, spec: &mut NodeSpec) {
        let (theirs, text) = (attribute.name(), attribute.value());
        let (ours, kind) = match head.built_in {
            None => {
                if let Some(fault) = names::port_fault(theirs) {
                    return self.name_problem(attribute, fault, "rename the port; letters, digits, _ and - are allowed");
                }
                (theirs, if head.class == Some(NodeClass::Subtree) { Kind::Subtree } else { Kind::Application })
            }
            Some(built_in) => match built_in.ports.iter().find(|port| port.theirs == theirs) {
                Some(port) => (port.ours, port.kind),
                None if case_idx(built_in, theirs).is_some() => return self.case(attribute, head, spec),
                None => return self.unknown_port(attribute, built_in),
            },
        };
        match value::read(kind, theirs, text) {
            Ok(value) => {
                let (name_location, location) = (self.at(attribute.range().start), self.at(attribute.range_value().start));
                spec.ports.push(PortSetting { name: ours.to_owned(), value, name_location, location });
            }
            Err(fault) => {
                let help = match fault {
                    XmlFault::BadKey { .. } => "write \"{key}\" with letters, digits and underscores, without blanks",
                    XmlFault::KeyHere { .. } => "write a constant",
                    _ => "correct the value",
                };
                self.value_problem(attribute, fault, help);
            }
        }
    }

    fn unknown_port(&mut self, attribute: Attribute<'_, '_>, built_in: &BuiltIn) {
        let known: Vec<&str> = built_in.ports.iter().map(|port| port.theirs).collect();
        let help = match nearest(attribute.name(), known.iter().copied()) {
            Some(near) => format!("did you mean {near:?}?"),
            None if known.is_empty() => "it has no ports".to_owned(),
            None => format!("its ports are {}", known.join(", ")),
        };
        self.name_problem(attribute, XmlFault::UnknownPort { node: built_in.theirs.to_owned() }, help);
    }

    fn case(&mut self, attribute: Attribute<'_, '_>, head: &mut Head<'_>, spec: &mut NodeSpec) {
        let case_idx = head.built_in.and_then(|built_in| case_idx(built_in, attribute.name())).unwrap_or_default();
        match value::read(Kind::Text, attribute.name(), attribute.value()) {
            Ok(PortValue::Literal(literal)) => head.given[case_idx] = Some(literal),
            Ok(PortValue::Key(_)) => {
                let fault = XmlFault::KeyHere { message: "the cases are constants" };
                self.value_problem(attribute, fault, "write a constant");
            }
            Err(fault) => self.value_problem(attribute, fault, "write a constant"),
        }
        if head.cases.is_none() {
            head.cases = Some(spec.ports.len());
            let (name_location, location) = (self.at(attribute.range().start), self.at(attribute.range_value().start));
            let value = PortValue::Literal(Literal::List(Vec::new()));
            spec.ports.push(PortSetting { name: "cases".to_owned(), value, name_location, location });
        }
    }

    /// The cases of a switch as one port.
    fn collect_cases(&mut self, head: &Head<'_>, spec: &mut NodeSpec) {
        let n_cases = head.built_in.map_or(0, |built_in| built_in.n_cases);
        if n_cases == 0 {
            return;
        }
        let cases: Vec<Literal> = head.given.iter().flatten().cloned().collect();
        match head.cases {
            Some(port_idx) if cases.len() == n_cases => {
                spec.ports[port_idx].value = PortValue::Literal(Literal::List(cases));
            }
            _ => {
                let missing = (0..n_cases).find(|case_idx| head.given[*case_idx].is_none()).unwrap_or_default();
                let fault = XmlFault::MissingPort { port: format!("case_{}", missing + 1) };
                self.importer.problem(spec.location, head.name, fault, "give every case");
            }
        }
    }

    fn check_children(&mut self, element: Node<'_, '_>, head: &Head<'_>, location: u32, n_found: usize) {
        let n_cases = head.built_in.map_or(0, |built_in| built_in.n_cases);
        let (fits, expected) = match head.class {
            Some(NodeClass::Subtree) => (n_found == 0, "no children of a use of a subtree"),
            Some(NodeClass::Action | NodeClass::Condition) => (n_found == 0, "no children"),
            Some(NodeClass::Decorator) => (n_found == 1, "exactly one child"),
            Some(NodeClass::Control) if n_cases == 0 => (n_found > 0, "at least one child"),
            _ => (n_cases == 0 || n_found == n_cases + 1, "one child a case and one for the rest"),
        };
        if !fits {
            let fault = XmlFault::ChildCount { expected, n_found };
            self.importer.problem(location, element.tag_name().name(), fault, "correct the children");
        }
    }
}

/// `case_1` -> 0.
fn case_idx(built_in: &BuiltIn, port: &str) -> Option<usize> {
    names::CASES[..built_in.n_cases].iter().position(|case| *case == port)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "tests fail by panicking")]
    use super::*;
    use std::fmt::Write;

    /// `sequence[title](port=value)!skip_if:script{child child}`.
    fn show(node: &NodeSpec) -> String {
        let mut out = match &node.kind {
            NodeKind::Named(name) => name.clone(),
            NodeKind::Subtree(name) => format!("@{name}{}", if node.is_autoremapped { "*" } else { "" }),
        };
        if let Some(title) = &node.title {
            _ = write!(out, "[{title}]");
        }
        let ports: Vec<String> = node.ports.iter().map(|port| format!("{}={:?}", port.name, port.value)).collect();
        if !ports.is_empty() {
            _ = write!(out, "({})", ports.join(" ").replace("Literal(", "").replace("))", ")"));
        }
        for condition in &node.conditions {
            _ = write!(out, "!{}:{}", condition.when.name(), condition.script);
        }
        if !node.children.is_empty() {
            _ = write!(out, "{{{}}}", node.children.iter().map(show).collect::<Vec<_>>().join(" "));
        }
        out
    }

    #[track_caller]
    fn check(inside: &str, expected: &str) {
        let text = format!(
            "<root BTCPP_format='4' main_tree_to_execute='T'><BehaviorTree ID='T'>{inside}</BehaviorTree>\
             <BehaviorTree ID='S'><A/></BehaviorTree></root>"
        );
        match import(&text, &ImportOptions::default()) {
            Ok(tree) => assert_eq!(show(&tree.spec.root), expected),
            Err(problems) => panic!("{}", problems[0]),
        }
    }

    #[test]
    fn compact_and_explicit_forms_are_the_same() {
        check("<Sequence><A/><B x='1'/></Sequence>", "sequence{A B(x=Text(\"1\"))}");
        check("<Control ID='Sequence'><Action ID='A'/><Condition ID='B' x='1'/></Control>", "sequence{A B(x=Text(\"1\"))}");
        check("<Decorator ID='Mine'><A/></Decorator>", "Mine{A}");
    }

    #[test]
    fn ports_of_built_in_nodes_have_our_names_and_units() {
        check("<Timeout msec='1500'><A/></Timeout>", "timeout(secs=Float(1.5)){A}");
        check("<RetryUntilSuccessful num_attempts='-1'><A/></RetryUntilSuccessful>", "retry(attempts=Int(-1)){A}");
        check("<Repeat num_cycles='{n}'><A/></Repeat>", "repeat(times=Key(\"n\")){A}");
        check("<Parallel success_count='-1'><A/></Parallel>", "parallel(success=Int(-1)){A}");
        check("<RunOnce then_skip='false'><A/></RunOnce>", "run_once(then_skip=Bool(false)){A}");
        check("<RateController><A/></RateController>", "rate_limit(hz=Float(10.0)){A}");
        check("<SetBlackboard value='1' output_key='k'/>", "set_blackboard(value=Text(\"1\") output_key=Key(\"k\"))");
        check(
            "<Precondition if='a' else='SKIPPED'><A/></Precondition>",
            "precondition(if=Text(\"a\") else=Text(\"skipped\")){A}",
        );
        check(
            "<LoopBool queue='1;0' value='{b}'><A/></LoopBool>",
            "loop(over=List([Bool(true), Bool(false)]) item=Key(\"b\")){A}",
        );
    }

    #[test]
    fn the_cases_of_a_switch_are_one_port_in_their_order() {
        check(
            "<Switch2 case_2='b' variable='{v}' case_1='a'><A/><B/><C/></Switch2>",
            "switch(cases=List([Text(\"a\"), Text(\"b\")]) variable=Key(\"v\")){A B C}",
        );
    }

    #[test]
    fn keys_of_every_form() {
        check("<A x='{k}' y='{=}' z='{@k}'/>", "A(x=Key(\"k\") y=Key(\"y\") z=Key(\"@k\"))");
        check("<A x='a {k} b' y='json:{}'/>", "A(x=Text(\"a {k} b\") y=Text(\"json:{}\"))");
    }

    #[test]
    fn subtrees_take_numbers_texts_and_keys() {
        check("<SubTree ID='S' a='42' b='4.5' c='x;1' d='{=}'/>", "@S(a=Int(42) b=Float(4.5) c=Text(\"x;1\") d=Key(\"d\"))");
        check("<SubTree ID='S' name='s' _autoremap='1'/>", "@S*[s]");
    }

    #[test]
    fn conditions_titles_and_metadata() {
        check("<A name='a/b' _skipIf='x' _onHalted='y:=1'/>", "A[a/b]!skip_if:x!on_halted:y:=1");
        check("<A name='' _uid='3' _fullpath='x' _description='d'/>", "A");
    }

    #[test]
    fn a_model_gives_ports_and_writes_keys_into_users() {
        let model = |user: &str| {
            format!(
                "<root BTCPP_format='4' main_tree_to_execute='T'><BehaviorTree ID='T'>{user}</BehaviorTree>\
                 <BehaviorTree ID='S'><A/></BehaviorTree><TreeNodesModel><SubTree ID='S'><input_port name='n' default='7'/>\
                 <output_port name='r' default='{{result}}'/></SubTree></TreeNodesModel></root>"
            )
        };
        let read = |user: &str| import(&model(user), &ImportOptions::default()).unwrap().spec;
        let spec = read("<SubTree ID='S'/>");
        assert_eq!(show(&spec.root), "@S(r=Key(\"result\"))");
        let ports: Vec<_> = spec.subtrees[0].ports.iter().map(|port| (port.name.as_str(), port.default.clone())).collect();
        assert_eq!(ports, [("n", Some(Literal::Int(7))), ("r", None)]);
        assert_eq!(show(&read("<SubTree ID='S' n='8' r='{x}'/>").root), "@S(n=Int(8) r=Key(\"x\"))");
        assert_eq!(show(&read("<SubTree ID='S' _autoremap='true'/>").root), "@S*(n=Key(\"n\") r=Key(\"r\"))");
    }

    #[test]
    fn a_tree_that_is_run_and_used_is_both() {
        let text = "<root BTCPP_format='4' main_tree_to_execute='T'><BehaviorTree ID='T'><A/></BehaviorTree>\
                    <BehaviorTree ID='U'><SubTree ID='T'/></BehaviorTree></root>";
        let spec = import(text, &ImportOptions::default()).unwrap().spec;
        let names: Vec<&str> = spec.subtrees.iter().map(|subtree| subtree.name.as_str()).collect();
        assert_eq!((show(&spec.root).as_str(), names), ("A", vec!["T", "U"]));
        let options = ImportOptions { main_tree: Some("U".to_owned()), ..ImportOptions::default() };
        assert_eq!(show(&import(text, &options).unwrap().spec.root), "@T");
    }
}

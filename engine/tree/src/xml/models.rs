//! The palette: what an editor knows about nodes, `<TreeNodesModel>`.

use super::file::Reader;
use super::names;
use super::problem::XmlFault;
use super::value::{self, Kind};
use crate::literal::Literal;
use crate::nearest::nearest;
use crate::port::Direction;
use crate::registry::{NodeClass, NodeModel};
use crate::spec::SubtreeSpec;
use roxmltree::Node;
use std::fmt::Write;

/// More ports than a subtree has; each of its users is compared with all of them.
const N_PORTS_MAX: usize = 256;

/// What a palette says about a node.
#[derive(Clone, Debug, PartialEq)]
pub struct XmlModel {
    /// Its name.
    pub name: String,
    /// What it does with children. A [`NodeClass::Step`] is an action here.
    pub class: NodeClass,
    /// Its ports.
    pub ports: Vec<XmlPort>,
    /// Where it was written.
    pub location: u32,
}

/// What a palette says about a port.
#[derive(Clone, Debug, PartialEq)]
pub struct XmlPort {
    /// Its name.
    pub name: String,
    /// Which way its value goes.
    pub direction: Direction,
    /// The C++ type, which is a label only: `std::string`.
    pub type_label: Option<String>,
    /// What it is given when nobody says anything: a constant or `{key}`.
    pub default: Option<String>,
    /// For the reader.
    pub description: String,
    /// Where it was written.
    pub location: u32,
}

impl Reader<'_, '_> {
    pub(super) fn palette(&mut self, palette: Node<'_, '_>) {
        for element in palette.children().filter(Node::is_element) {
            let tag = element.tag_name().name();
            let Some(class) = names::class_of(tag) else {
                let classes = ["Action", "Condition", "Control", "Decorator", "SubTree"];
                let near = nearest(tag, classes);
                let help =
                    near.map_or_else(|| format!("write one of {}", classes.join(", ")), |near| format!("did you mean <{near}>?"));
                self.element_problem(element, XmlFault::UnknownElement { parent: "TreeNodesModel" }, help);
                continue;
            };
            let Some(id) = element.attribute_node("ID") else {
                let help = format!("write <{tag} ID=\"...\">");
                self.element_problem(element, XmlFault::MissingAttribute { attribute: "ID" }, help);
                continue;
            };
            self.check_name(id.range_value().start, id.value(), names::name_fault);
            let location = self.at(element.range().start);
            let ports = self.model_ports(element, class);
            let model = XmlModel { name: id.value().to_owned(), class, ports, location };
            self.add_model(model);
        }
    }

    /// Every file of an editor repeats the palette; the first entry counts.
    fn add_model(&mut self, model: XmlModel) {
        let importer = &mut *self.importer;
        let Some(&earlier) = importer.model_names.get(&(model.class == NodeClass::Subtree, model.name.clone())) else {
            importer.model_names.insert((model.class == NodeClass::Subtree, model.name.clone()), importer.models.len());
            return importer.models.push(model);
        };
        let essence = |model: &XmlModel| -> Vec<(String, Direction, Option<String>)> {
            model.ports.iter().map(|port| (port.name.clone(), port.direction, port.default.clone())).collect()
        };
        if model.class == NodeClass::Subtree && essence(&model) != essence(&importer.models[earlier]) {
            importer.problem(model.location, &model.name, XmlFault::DuplicateModel, "keep one of them");
        }
    }

    fn model_ports(&mut self, element: Node<'_, '_>, class: NodeClass) -> Vec<XmlPort> {
        let mut ports: Vec<XmlPort> = Vec::new();
        for child in element.children().filter(Node::is_element) {
            let direction = match child.tag_name().name() {
                "input_port" => Direction::In,
                "output_port" => Direction::Out,
                // The second is what Nav2's palette calls it.
                "inout_port" | "bidirectional_port" => Direction::InOut,
                "MetadataFields" => continue,
                name => {
                    let near = nearest(name, ["input_port", "output_port", "inout_port"]);
                    let help = near.map_or("remove it".to_owned(), |near| format!("did you mean <{near}>?"));
                    self.element_problem(child, XmlFault::UnknownElement { parent: "TreeNodesModel" }, help);
                    continue;
                }
            };
            let Some(name) = child.attribute_node("name") else {
                let help = "write name=\"...\"";
                self.element_problem(child, XmlFault::MissingAttribute { attribute: "name" }, help);
                continue;
            };
            if let Some(fault) = names::port_fault(name.value()) {
                self.value_problem(name, fault, "rename the port; letters, digits, _ and - are allowed");
            }
            if ports.len() >= N_PORTS_MAX {
                let fault = XmlFault::TooMany { what: "ports of a node", limit: N_PORTS_MAX };
                self.element_problem(child, fault, "no node needs so many");
                break;
            }
            let default = child.attribute_node("default");
            if let (NodeClass::Subtree, Some(default)) = (class, default)
                && let Err(fault) = value::read(Kind::Subtree, name.value(), default.value())
            {
                self.value_problem(default, fault, "write \"{key}\" with letters, digits and underscores, without blanks");
            }
            let description = child.attribute("description").or_else(|| child.text().map(str::trim)).unwrap_or_default();
            ports.push(XmlPort {
                name: name.value().to_owned(),
                direction,
                type_label: child.attribute("type").map(str::to_owned),
                default: default.map(|default| default.value().to_owned()),
                description: description.to_owned(),
                location: self.at(child.range().start),
            });
        }
        ports
    }
}

/// The palette of `models` as a file of its own, for an editor. Built-in nodes are left out: editors know them.
///
/// Types are labels of C++ where there is a usual one, else our own. Constants that XML cannot write are left out.
#[must_use]
pub fn export_models(models: &[NodeModel]) -> String {
    let mut out = String::from("<root BTCPP_format=\"4\">\n");
    write_palette(&mut out, models, &[]);
    out.push_str("</root>\n");
    out
}

/// `<TreeNodesModel>` of the application's nodes and of the subtrees that have ports; nothing when there are none.
pub(super) fn write_palette(out: &mut String, models: &[NodeModel], subtrees: &[SubtreeSpec]) {
    let is_shown = |model: &&NodeModel| model.class != NodeClass::Subtree && !names::is_ours(&model.name);
    let mut models = models.iter().filter(is_shown).peekable();
    let mut subtrees = subtrees.iter().filter(|subtree| !subtree.ports.is_empty()).peekable();
    if models.peek().is_none() && subtrees.peek().is_none() {
        return;
    }
    out.push_str("  <TreeNodesModel>\n");
    for model in models {
        open(out, names::element_of(model.class), &model.name, model.ports.is_empty());
        for port in &model.ports {
            let default = match (&port.default, &port.default_key) {
                (Some(literal), _) => value::write_literal(Kind::Application, literal).ok(),
                (None, key) => key.as_ref().map(|key| format!("{{{key}}}")),
            };
            write_port(
                out,
                &port.name,
                port.direction,
                Some(&type_label(port.port_type().name())),
                default.as_deref(),
                &port.doc,
            );
        }
        close(out, names::element_of(model.class), model.ports.is_empty());
    }
    for subtree in subtrees {
        open(out, "SubTree", &subtree.name, false);
        for port in &subtree.ports {
            let default = port.default.as_ref().and_then(|literal| value::write_literal(Kind::Subtree, literal).ok());
            write_port(out, &port.name, port.direction, None, default.as_deref(), "");
        }
        close(out, "SubTree", false);
    }
    out.push_str("  </TreeNodesModel>\n");
}

fn open(out: &mut String, element: &str, name: &str, is_empty: bool) {
    _ = write!(out, "    <{element}");
    write_attribute(out, "ID", name);
    out.push_str(if is_empty { "/>\n" } else { ">\n" });
}

fn close(out: &mut String, element: &str, is_empty: bool) {
    if !is_empty {
        _ = writeln!(out, "    </{element}>");
    }
}

fn write_port(out: &mut String, name: &str, direction: Direction, label: Option<&str>, default: Option<&str>, doc: &str) {
    let element = match direction {
        Direction::In => "input_port",
        Direction::Out => "output_port",
        Direction::InOut => "inout_port",
    };
    _ = write!(out, "      <{element}");
    write_attribute(out, "name", name);
    if let Some(label) = label {
        write_attribute(out, "type", label);
    }
    if let Some(default) = default {
        write_attribute(out, "default", default);
    }
    if doc.is_empty() {
        out.push_str("/>\n");
    } else {
        out.push('>');
        write_escaped(out, doc);
        _ = writeln!(out, "</{element}>");
    }
}

/// ` name="value"`.
pub(super) fn write_attribute(out: &mut String, name: &str, value: &str) {
    _ = write!(out, " {name}=\"");
    write_escaped(out, value);
    out.push('"');
}

/// XML reads blanks other than the space as a space, unless they are written as numbers.
fn write_escaped(out: &mut String, text: &str) {
    for letter in text.chars() {
        match letter {
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '&' => out.push_str("&amp;"),
            '"' => out.push_str("&quot;"),
            '\n' => out.push_str("&#10;"),
            '\r' => out.push_str("&#13;"),
            '\t' => out.push_str("&#9;"),
            letter if is_xml(letter) => out.push(letter),
            _ => out.push('\u{fffd}'),
        }
    }
}

/// Whether XML can hold the letter at all.
pub(super) fn is_xml(letter: char) -> bool {
    matches!(letter, '\t' | '\n' | '\r' | '\u{20}'..='\u{d7ff}' | '\u{e000}'..='\u{fffd}' | '\u{10000}'..)
}

/// The C++ type of one of ours; types that C++ does not have keep their names.
pub(crate) fn type_label(name: &str) -> String {
    let scalar = |name: &str| {
        Some(match name {
            "f64" => "double",
            "f32" => "float",
            "i32" => "int",
            "i64" => "int64_t",
            "u8" => "unsigned char",
            "u32" => "unsigned int",
            "u64" | "usize" => "uint64_t",
            "bool" => "bool",
            "String" => "std::string",
            _ => return None,
        })
    };
    let item = name.strip_prefix("Vec<").and_then(|rest| rest.strip_suffix('>'));
    match (scalar(name), item.and_then(scalar)) {
        (Some(label), _) => label.to_owned(),
        (None, Some(item)) => format!("std::vector<{item}>"),
        (None, None) => name.to_owned(),
    }
}

/// The loop node for entries of the list type `name`.
pub(super) fn loop_for_type(name: &str) -> Option<&'static str> {
    Some(match name {
        "Vec<bool>" => "LoopBool",
        "Vec<f64>" => "LoopDouble",
        "Vec<i32>" | "Vec<i64>" => "LoopInt",
        "Vec<String>" => "LoopString",
        _ => return None,
    })
}

/// The loop node for constants like `items`; texts when there are none.
pub(super) fn loop_for_items(items: &[Literal]) -> &'static str {
    match items.first() {
        Some(Literal::Bool(_)) => "LoopBool",
        Some(Literal::Int(_)) if items.iter().all(|item| matches!(item, Literal::Int(_))) => "LoopInt",
        Some(Literal::Int(_) | Literal::Float(_)) => "LoopDouble",
        _ => "LoopString",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::port::PortSpec;

    #[test]
    fn a_palette_says_what_an_editor_needs() {
        let mut lift = NodeModel::new(
            "lift",
            NodeClass::Action,
            vec![
                PortSpec::setting::<f64>("height_m").default_value(0.12).doc("Above the table & not < 0."),
                PortSpec::input::<std::path::PathBuf>("plan"),
                PortSpec::output::<Vec<f64>>("joints"),
            ],
        );
        lift.doc("");
        let expected = r#"<root BTCPP_format="4">
  <TreeNodesModel>
    <Action ID="lift">
      <input_port name="height_m" type="double" default="0.12">Above the table &amp; not &lt; 0.</input_port>
      <input_port name="plan" type="PathBuf" default="{plan}"/>
      <output_port name="joints" type="std::vector&lt;double&gt;" default="{joints}"/>
    </Action>
  </TreeNodesModel>
</root>
"#;
        assert_eq!(export_models(std::slice::from_ref(&lift)), expected);
        lift.name = "sequence".into();
        assert_eq!(export_models(&[lift]), "<root BTCPP_format=\"4\">\n</root>\n");
    }
}

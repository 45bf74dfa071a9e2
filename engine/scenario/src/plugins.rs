//! `plugins`: which implementation of each contract a run uses.

use crate::document::{Node, Value};
use crate::mistake::Place;
use crate::reader::Reader;
use crate::vocabulary::Vocabulary;
use sfg_tree::Literal;

/// The implementation of each contract; the application's own choice where nothing is said.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Plugins {
    /// Infers what is wanted.
    pub llm: Option<PluginChoice>,
    /// Finds things and parts in images.
    pub grounder: Option<PluginChoice>,
    /// Proposes palm poses.
    pub pose_generator: Option<PluginChoice>,
    /// Closes the hand.
    pub grasp_policy: Option<PluginChoice>,
    /// Moves the robot.
    pub driver: Option<PluginChoice>,
}

/// A plugin and its parameters.
#[derive(Clone, Debug, PartialEq)]
pub struct PluginChoice {
    /// Name of the plugin.
    pub name: String,
    /// An object; empty when none were given. The plugin checks it.
    pub params: serde_json::Value,
    /// Where it was named.
    pub place: Place,
}

/// Keys of [`Plugins`], in the order of the data path.
pub(crate) const CONTRACTS: [&str; 5] = ["llm", "grounder", "pose_generator", "grasp_policy", "driver"];

impl Reader {
    pub(crate) fn plugins(&mut self, node: &Node, vocabulary: &Vocabulary) -> Option<Plugins> {
        let fields = self.fields("plugins", node, &CONTRACTS)?;
        let mut choose = |contract: &str| fields.get(contract).and_then(|node| self.plugin(contract, node, vocabulary));
        Some(Plugins {
            llm: choose("llm"),
            grounder: choose("grounder"),
            pose_generator: choose("pose_generator"),
            grasp_policy: choose("grasp_policy"),
            driver: choose("driver"),
        })
    }

    fn plugin(&mut self, contract: &str, node: &Node, vocabulary: &Vocabulary) -> Option<PluginChoice> {
        let what = format!("{contract} plugin");
        let known = vocabulary.plugins(contract);
        match &node.value {
            Value::Text(_) => {
                let name = self.word(&what, node, known)?;
                Some(PluginChoice {
                    name: name.value,
                    params: serde_json::Value::Object(serde_json::Map::new()),
                    place: name.place,
                })
            }
            Value::Map(entries) => {
                let [(key, params)] = entries.as_slice() else {
                    return self.wrong(&what, node, "a name, or one name with its parameters: `{name: {parameter: value}}`");
                };
                let is_known = self.known(&what, &key.text, key.place, known);
                let params = match &params.value {
                    Value::Null => serde_json::Value::Object(serde_json::Map::new()),
                    Value::Map(_) => self.json(params)?,
                    _ => return self.wrong(&format!("parameters of {:?}", key.text), params, "a map"),
                };
                is_known.then(|| PluginChoice { name: key.text.clone(), params, place: key.place })
            }
            _ => self.wrong(&what, node, "a name, or one name with its parameters: `{name: {parameter: value}}`"),
        }
    }

    /// The value as JSON; numbers that JSON does not have are mistakes.
    fn json(&mut self, node: &Node) -> Option<serde_json::Value> {
        Some(match &node.value {
            Value::List(items) => {
                let items: Vec<_> = items.iter().map(|item| self.json(item)).collect();
                serde_json::Value::Array(items.into_iter().collect::<Option<_>>()?)
            }
            Value::Map(_) => {
                let entries = self.entries("parameters", node)?;
                let entries: Vec<_> =
                    entries.into_iter().map(|(key, value)| self.json(value).map(|value| (key.text.clone(), value))).collect();
                serde_json::Value::Object(entries.into_iter().collect::<Option<_>>()?)
            }
            Value::Float(value) if !value.is_finite() => return self.wrong("parameter", node, "a finite number"),
            Value::Null => serde_json::Value::Null,
            _ => json_of(&node.literal()),
        })
    }
}

/// A literal as JSON; a number that JSON does not have becomes null.
pub(crate) fn json_of(literal: &Literal) -> serde_json::Value {
    match literal {
        Literal::Bool(value) => (*value).into(),
        Literal::Int(value) => (*value).into(),
        Literal::Float(value) => (*value).into(),
        Literal::Text(text) => text.as_str().into(),
        Literal::List(items) => items.iter().map(json_of).collect(),
        Literal::Map(entries) => {
            serde_json::Value::Object(entries.iter().map(|(key, value)| (key.clone(), json_of(value))).collect())
        }
    }
}

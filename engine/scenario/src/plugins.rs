//! `plugins`: which implementation of each contract a run uses.

use crate::angle::radians_key;
use crate::document::{Node, Value};
use crate::mistake::Place;
use crate::reader::Reader;
use crate::vocabulary::Vocabulary;
use sfg_tree::Literal;
use std::collections::BTreeMap;

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
    /// An object; empty when none were given. The plugin checks it. Angles are in radians, whatever the file says.
    pub params: serde_json::Value,
    /// Where each parameter was named and where its value stands.
    pub param_places: BTreeMap<String, (Place, Place)>,
    /// Where it was named.
    pub place: Place,
}

impl PluginChoice {
    fn without_params(name: String, place: Place) -> Self {
        Self { name, params: serde_json::Value::Object(serde_json::Map::new()), param_places: BTreeMap::new(), place }
    }
}

/// Keys of [`Plugins`], in the order of the data path.
pub(crate) const CONTRACTS: [&str; 5] = ["llm", "grounder", "pose_generator", "grasp_policy", "driver"];

const EXPECTED: &str = "a name, or one name with its parameters: `{name: {parameter: value}}`";

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
                Some(PluginChoice::without_params(name.value, name.place))
            }
            Value::Map(_) => {
                let (key, params) = self.only(&what, node, EXPECTED, "indent it to make it a parameter")?;
                let is_known = self.known(&what, &key.text, key.place, known);
                let mut choice = PluginChoice::without_params(key.text.clone(), key.place);
                match &params.value {
                    Value::Null => self.nothing_after(key),
                    Value::Map(entries) => {
                        choice.params = self.json(params)?;
                        choice.param_places =
                            entries.iter().map(|(key, value)| (parameter_name(&key.text), (key.place, value.place))).collect();
                    }
                    _ => return self.wrong(&format!("parameters of {:?}", key.text), params, "a map"),
                }
                is_known.then_some(choice)
            }
            _ => self.wrong(&what, node, EXPECTED),
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
                let mut object = Some(serde_json::Map::new());
                for (key, value) in self.entries("parameters", node)? {
                    let name = parameter_name(&key.text);
                    let value = if name == key.text {
                        self.json(value)
                    } else {
                        if node.get(&name).is_some() {
                            self.angle_given_twice(key, &name);
                        }
                        self.radians(&key.text, value).and_then(|value| self.json(&value))
                    };
                    match (&mut object, value) {
                        (Some(object), Some(value)) => drop(object.insert(name, value)),
                        _ => object = None,
                    }
                }
                serde_json::Value::Object(object?)
            }
            Value::Float(value) if !value.is_finite() => return self.wrong("parameter", node, "a finite number"),
            Value::Null => serde_json::Value::Null,
            Value::Unknown => return None,
            _ => json_of(&node.literal()),
        })
    }
}

/// The name under which the plugin gets a parameter: angles are handed over in radians.
fn parameter_name(written: &str) -> String {
    radians_key(written, |key| key.ends_with("_rad")).unwrap_or_else(|| written.to_owned())
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

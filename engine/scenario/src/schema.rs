//! The JSON Schema of scenarios, for completion and checking in editors.
//!
//! It is made from the same lists that the reader checks: node models and vocabulary. What a schema cannot say (keys that
//! nobody writes, types of keys) only [`crate::Scenario::load`] finds.

use crate::angle::degrees_key;
use crate::files::INCLUDED_KEYS;
use crate::reasons::ANY;
use crate::scene::{MOUTH_M, WALL_M};
use crate::vocabulary::Vocabulary;
use serde_json::{Map, Value, json};
use sfg_tree::{Literal, NodeClass, NodeModel, PortSpec, Shape, When};

const PARAMETER_PATTERN: &str = "\\$\\{[A-Za-z_][A-Za-z0-9_]*(:-[^}]*)?\\}";

/// The schema of a scenario that uses these nodes and names. That of a file to include is `#/$defs/included` in it.
#[must_use]
pub fn schema(models: &[NodeModel], vocabulary: &Vocabulary) -> Value {
    let mut schema = plain_schema(models, vocabulary);
    for when in When::ALL {
        schema["$defs"][when.name()] = script(when);
    }
    let properties = schema["properties"].clone();
    let included: Map<String, Value> = INCLUDED_KEYS
        .iter()
        .map(|key| {
            let mut property = properties[*key].clone();
            // Objects may stand in another file.
            if let Some(scene) = property.as_object_mut() {
                scene.remove("required");
            }
            ((*key).to_owned(), property)
        })
        .collect();
    schema["$defs"]["included"] = object(included, &[], "A file that others include.");
    let is_plain = |key: &str| ["key", "parameter", "parameters", "include"].contains(&key);
    for part in ["properties", "$defs"] {
        if let Some(parts) = schema[part].as_object_mut() {
            parts.iter_mut().filter(|(key, _)| !is_plain(key)).for_each(|(_, part)| allow_parameters(part));
        }
    }
    schema
}

/// Wherever a value stands that is no text, a parameter may stand.
fn allow_parameters(schema: &mut Value) {
    let Some(entries) = schema.as_object_mut() else { return };
    for (key, value) in entries.iter_mut() {
        match key.as_str() {
            "properties" => {
                let values = value.as_object_mut().into_iter().flatten();
                values
                    .filter(|(key, _)| !["include", "parameters"].contains(&key.as_str()))
                    .for_each(|(_, value)| allow_parameters(value));
            }
            "items" | "additionalProperties" => allow_parameters(value),
            "anyOf" => value.as_array_mut().into_iter().flatten().for_each(allow_parameters),
            _ => {}
        }
    }
    let is_typed = |name: &str| ["number", "integer", "boolean", "array"].contains(&name);
    let takes_text = !entries.get("type").and_then(Value::as_str).is_some_and(is_typed)
        && !entries.contains_key("enum")
        && !entries.contains_key("const");
    if takes_text {
        return;
    }
    let mut value = std::mem::take(entries);
    for key in ["description", "default"] {
        if let Some(said) = value.shift_remove(key) {
            entries.insert(key.to_owned(), said);
        }
    }
    entries.insert("anyOf".to_owned(), json!([value, {"$ref": "#/$defs/parameter"}]));
}

fn plain_schema(models: &[NodeModel], vocabulary: &Vocabulary) -> Value {
    let plugins: Map<String, Value> =
        crate::plugins::CONTRACTS.iter().map(|contract| ((*contract).to_owned(), plugin(vocabulary.plugins(contract)))).collect();
    json!({
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "SayFuncGrasp scenario",
        "type": "object",
        "required": ["version", "robot", "scene", "tree"],
        "additionalProperties": false,
        "properties": {
            "version": {"const": 1, "description": "Version of this format."},
            "description": {"type": "string", "description": "What the scenario shows."},
            "include": {
                "type": "array",
                "items": {"type": "string"},
                "description": "Files whose subtrees, scene, plugins, limits and parameters are taken over; paths are relative to this file."
            },
            "parameters": {"type": "object", "description": "Values that `${name}` stands for, unless `--set name=value` says otherwise."},
            "blackboard": {"type": "object", "description": "Entries that the blackboard begins with."},
            "robot": described(word(&vocabulary.robots), "Name of the robot."),
            "arm": {"enum": ["left", "right"], "default": "left", "description": "The acting arm and hand."},
            "scene": scene(),
            "instruction": {"type": "string", "minLength": 1, "maxLength": 4096, "description": "What the robot is told."},
            "plugins": object(plugins, &[], "Which implementation of each contract is used."),
            "tree": {"$ref": "#/$defs/node"},
            "subtrees": {"type": "object", "additionalProperties": {"$ref": "#/$defs/subtree"}, "description": "Trees that `subtree` nodes name."},
            "success": {
                "type": "object",
                "additionalProperties": false,
                "description": "What must hold at the end.",
                "properties": {
                    "truth": predicates(&vocabulary.truth_predicates, "Judged by the simulator."),
                    "sensed": predicates(&vocabulary.sensed_predicates, "Judged from sensors alone.")
                }
            },
            "limits": {
                "type": "object",
                "additionalProperties": false,
                "description": "Bounds of a run.",
                "properties": {
                    "timeout_secs": {"type": "number", "minimum": 1, "maximum": 3600, "default": 120, "description": "Simulated time, seconds."},
                    "max_joint_speed_fraction": {"type": "number", "minimum": 0.01, "maximum": 1, "default": 0.5, "description": "Share of the joint speed limits."},
                    "workspace": {
                        "type": "object",
                        "additionalProperties": false,
                        "required": ["x_m", "y_m", "z_m"],
                        "description": "Where the palm may go, base frame, metres.",
                        "properties": {"x_m": range_ref(), "y_m": range_ref(), "z_m": range_ref()}
                    }
                }
            }
        },
        "$defs": {
            "range": {
                "description": "A number, or [min, max] to draw from.",
                "anyOf": [{"type": "number"}, {"type": "array", "items": {"type": "number"}, "minItems": 2, "maxItems": 2}]
            },
            "key": {"type": "string", "pattern": "^\\{[A-Za-z_][A-Za-z0-9_]*(\\.[A-Za-z_][A-Za-z0-9_]*)*\\}$", "description": "A blackboard key."},
            "parameter": {"type": "string", "pattern": PARAMETER_PATTERN, "description": "The value of a parameter."},
            "object_model": word(&vocabulary.object_models),
            "object": object_schema(),
            "reason": word(&with_tree_reasons(&vocabulary.reasons)),
            "node": node(models),
            "subtree": {
                "type": "object",
                "required": ["do"],
                "additionalProperties": false,
                "properties": {
                    "in": subtree_ports("Keys that the subtree reads."),
                    "out": subtree_ports("Keys that the subtree writes."),
                    "inout": subtree_ports("Keys that the subtree reads and writes."),
                    "open": {"type": "boolean", "default": false, "description": "Whether its users may connect keys that are no ports."},
                    "do": {"$ref": "#/$defs/node"}
                }
            }
        }
    })
}

fn scene() -> Value {
    json!({
        "type": "object",
        "required": ["objects"],
        "additionalProperties": false,
        "description": "What stands where.",
        "properties": {
            "table": {
                "type": "object",
                "additionalProperties": false,
                "properties": {"height_m": described(range_ref(), "Height of the top above the base origin, metres.")}
            },
            "friction": described(range_ref(), "Friction of every pair of surfaces, at most 0.8."),
            "distractors": {
                "type": "object",
                "required": ["n"],
                "additionalProperties": false,
                "description": "Objects that nobody asks for.",
                "properties": {
                    "n": {"type": "integer", "minimum": 0, "maximum": 20},
                    "from": {"type": "array", "items": {"$ref": "#/$defs/object_model"}}
                }
            },
            "objects": {
                "type": "array",
                "items": {"type": "object", "minProperties": 1, "maxProperties": 1, "additionalProperties": {"$ref": "#/$defs/object"}}
            }
        }
    })
}

fn object_schema() -> Value {
    json!({
        "type": "object",
        "required": ["at"],
        "additionalProperties": false,
        "properties": {
            "model": {"$ref": "#/$defs/object_model"},
            "mesh": {"type": "string", "description": "Scanned surface, OBJ, relative to this file."},
            "hulls": {"type": "string", "description": "Convex parts of the scan, OBJ."},
            "mass_kg": {"type": "number", "minimum": 0.001, "maximum": 10, "description": "Mass of the scan, kilograms."},
            "hollow": {
                "type": "object",
                "required": ["mouth_m", "wall_m"],
                "additionalProperties": false,
                "description": "Makes a closed scan a vessel: it is cut off level at the mouth and bored round from there.",
                "properties": {
                    "mouth_m": {
                        "type": "number",
                        "minimum": MOUTH_M.0,
                        "maximum": MOUTH_M.1,
                        "description": "Height of the cut over the base, metres."
                    },
                    "wall_m": {
                        "type": "number",
                        "minimum": WALL_M.0,
                        "maximum": WALL_M.1,
                        "description": "Thinnest wall, metres: a flat bottle has thicker ones on its long sides."
                    }
                }
            },
            "at": {
                "type": "object",
                "required": ["x_m", "y_m"],
                "additionalProperties": false,
                "description": "Pose on the table, base frame.",
                "properties": {
                    "x_m": described(range_ref(), "Ahead of the robot, metres."),
                    "y_m": described(range_ref(), "To its left, metres."),
                    "yaw_deg": {"anyOf": [{"const": "any"}, range_ref()], "description": "Rotation about the vertical, degrees."},
                    "yaw_rad": {"anyOf": [{"const": "any"}, range_ref()], "description": "The same in radians."}
                }
            },
            "filled_grains": {"type": "integer", "minimum": 0, "maximum": 2000, "description": "Grains inside."},
            "colour": {"type": "string", "description": "Instead of the model's own."},
            "height_scale": described(range_ref(), "Factor on the height."),
            "radius_scale": described(range_ref(), "Factor on width and depth."),
            "mass_scale": described(range_ref(), "Factor on the mass.")
        }
    })
}

/// A node by its name alone, or as a map with its name as the only key.
fn node(models: &[NodeModel]) -> Value {
    let is_bare = |model: &&NodeModel| {
        !matches!(model.class, NodeClass::Control | NodeClass::Decorator) && !model.ports.iter().any(PortSpec::must_be_given)
    };
    let bare: Vec<&str> = models.iter().filter(is_bare).map(|model| model.name.as_ref()).collect();
    let mut properties: Map<String, Value> =
        models.iter().map(|model| (model.name.to_string(), described(body(model), &model.doc))).collect();
    let mut used_subtree = conditions();
    used_subtree.insert("tree".to_owned(), json!({"type": "string"}));
    used_subtree.insert("autoremap".to_owned(), json!({"type": "boolean", "description": "Shares every key with its user."}));
    let subtree = json!({
        "anyOf": [
            {"type": "string"},
            {"type": "object", "required": ["tree"], "properties": used_subtree}
        ],
        "description": "Does a tree of `subtrees`."
    });
    properties.insert("subtree".to_owned(), subtree);
    let map = json!({"type": "object", "minProperties": 1, "maxProperties": 1, "additionalProperties": false, "properties": properties});
    if bare.is_empty() { map } else { json!({"anyOf": [{"enum": bare}, map]}) }
}

fn body(model: &NodeModel) -> Value {
    let mut properties = conditions();
    let mut required: Vec<&str> = Vec::new();
    // Ports that must be given in one of two units.
    let mut either_unit: Vec<Value> = Vec::new();
    for spec in &model.ports {
        let value = if ["retry", "recover"].contains(&&*model.name) && spec.name() == "on" {
            let reason = json!({"$ref": "#/$defs/reason"});
            let item = if model.name == "recover" { json!({"anyOf": [reason, {"const": ANY}]}) } else { reason };
            described(json!({"type": "array", "items": item}), spec.doc_text())
        } else {
            port(spec)
        };
        if let Some(degrees) = degrees_key(spec.name()) {
            // A key holds radians, and so do limits.
            let shape = spec.port_type().shape().map_or_else(|| json!({}), shape_schema);
            properties.insert(degrees.clone(), described(shape, "The same in degrees."));
            if spec.must_be_given() {
                either_unit.push(json!({"anyOf": [{"required": [spec.name()]}, {"required": [degrees]}]}));
            }
        } else if spec.must_be_given() {
            required.push(spec.name());
        }
        properties.insert(spec.name().to_owned(), value);
    }
    let child = json!({"$ref": "#/$defs/node"});
    let children = json!({"type": "array", "minItems": 1, "items": child});
    let short = match model.class {
        NodeClass::Control => Some(children.clone()),
        NodeClass::Decorator if required.is_empty() && either_unit.is_empty() => Some(child.clone()),
        NodeClass::Decorator => None,
        // Nothing after the colon gives nothing.
        _ if required.is_empty() && either_unit.is_empty() => Some(json!({"type": "null"})),
        _ => None,
    };
    match model.class {
        NodeClass::Control => {
            properties.insert("do".to_owned(), children);
            required.push("do");
        }
        NodeClass::Decorator => {
            properties.insert("do".to_owned(), child);
            required.push("do");
        }
        _ => {}
    }
    let mut long = json!({"type": "object", "additionalProperties": false, "required": required, "properties": properties});
    if !either_unit.is_empty() {
        long["allOf"] = Value::Array(either_unit);
    }
    short.map_or_else(|| long.clone(), |short| json!({"anyOf": [short, long]}))
}

/// What every node can be given beside its ports.
fn conditions() -> Map<String, Value> {
    let name = ("name".to_owned(), json!({"type": "string", "description": "A name of its own, for journals."}));
    let conditions = When::ALL.map(|when| (when.name().to_owned(), json!({"$ref": format!("#/$defs/{}", when.name())})));
    std::iter::once(name).chain(conditions).collect()
}

/// The script of a condition.
fn script(when: When) -> Value {
    let doc = match when {
        When::FailureIf => "Script; true: the node fails without being ticked.",
        When::SuccessIf => "Script; true: the node succeeds without being ticked.",
        When::SkipIf => "Script; true: the node is skipped.",
        When::While => "Script; false: the node is halted and skipped.",
        When::OnSuccess => "Script that runs after the node succeeded.",
        When::OnFailure => "Script that runs after the node failed.",
        When::OnHalted => "Script that runs after the node was halted.",
        When::Post => "Script that runs after the node ended or was halted.",
    };
    json!({"type": ["string", "boolean"], "description": doc})
}

fn port(spec: &PortSpec) -> Value {
    let key = json!({"$ref": "#/$defs/key"});
    let value = match spec.port_type().shape() {
        None => key,
        Some(shape) => {
            let mut literal = shape_schema(shape);
            if let (Some((min, max)), Some(entries)) = (spec.limits(), literal.as_object_mut()) {
                entries.insert("minimum".to_owned(), json!(min));
                if max.is_finite() {
                    entries.insert("maximum".to_owned(), json!(max));
                }
            }
            json!({"anyOf": [literal, key]})
        }
    };
    let mut value = described(value, spec.doc_text());
    if let (Some(default), Some(entries)) = (spec.default_literal(), value.as_object_mut()) {
        entries.insert("default".to_owned(), default_json(default));
    }
    value
}

fn default_json(literal: &Literal) -> Value {
    crate::plugins::json_of(literal)
}

fn shape_schema(shape: &Shape) -> Value {
    match shape {
        Shape::Bool => json!({"type": "boolean"}),
        Shape::Int => json!({"type": "integer"}),
        Shape::Float => json!({"type": "number"}),
        Shape::Text => json!({"type": "string"}),
        Shape::OneOf(words) => word(words),
        Shape::List(item, None) => json!({"type": "array", "items": shape_schema(item)}),
        Shape::List(item, Some(n)) => json!({"type": "array", "items": shape_schema(item), "minItems": n, "maxItems": n}),
        Shape::Map => json!({"type": "object"}),
        Shape::Any => json!({}),
    }
}

fn plugin(names: &[String]) -> Value {
    let params: Map<String, Value> = names.iter().map(|name| (name.clone(), json!({"type": ["object", "null"]}))).collect();
    let with_params = if names.is_empty() {
        json!({"type": "object", "minProperties": 1, "maxProperties": 1})
    } else {
        json!({"type": "object", "minProperties": 1, "maxProperties": 1, "additionalProperties": false, "properties": params})
    };
    json!({"anyOf": [word(names), with_params]})
}

fn predicates(names: &[String], doc: &str) -> Value {
    let args: Map<String, Value> = names.iter().map(|name| (name.clone(), json!({"type": ["object", "null"]}))).collect();
    let with_args = if names.is_empty() {
        json!({"type": "object", "minProperties": 1, "maxProperties": 1})
    } else {
        json!({"type": "object", "minProperties": 1, "maxProperties": 1, "additionalProperties": false, "properties": args})
    };
    json!({"type": "array", "items": {"anyOf": [word(names), with_args]}, "description": doc})
}

fn subtree_ports(doc: &str) -> Value {
    let with_default = json!({"type": "object", "minProperties": 1, "maxProperties": 1});
    json!({"type": "array", "items": {"anyOf": [{"type": "string"}, with_default]}, "description": doc})
}

pub(crate) fn with_tree_reasons(reasons: &[String]) -> Vec<String> {
    let own = sfg_tree::reason::ALL.iter().map(|reason| (*reason).to_owned());
    let mut all = reasons.to_vec();
    if !all.is_empty() {
        all.extend(own.filter(|reason| !reasons.contains(reason)));
    }
    all
}

/// One of some words, or any word when the list is empty.
fn word(words: &[String]) -> Value {
    if words.is_empty() { json!({"type": "string"}) } else { json!({"enum": words}) }
}

fn range_ref() -> Value {
    json!({"$ref": "#/$defs/range"})
}

fn object(properties: Map<String, Value>, required: &[&str], doc: &str) -> Value {
    json!({"type": "object", "additionalProperties": false, "required": required, "properties": properties, "description": doc})
}

fn described(mut schema: Value, doc: &str) -> Value {
    if let (false, Some(entries)) = (doc.is_empty(), schema.as_object_mut()) {
        entries.insert("description".to_owned(), json!(doc));
    }
    schema
}

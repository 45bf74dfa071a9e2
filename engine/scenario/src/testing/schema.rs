//! The JSON Schema of test files.

use super::case::End;
use super::read::{MAX_SECS, TICK_SECS, UNTIL_SECS};
use crate::schema::with_tree_reasons;
use crate::vocabulary::Vocabulary;
use serde_json::{Value, json};

/// The schema of test files whose failures have these reasons. Names of leaves depend on the scenario and are not in it.
#[must_use]
pub fn test_schema(vocabulary: &Vocabulary) -> Value {
    let reasons = with_tree_reasons(&vocabulary.reasons);
    let reason = if reasons.is_empty() { json!({"type": "string"}) } else { json!({"enum": reasons}) };
    let ends = End::ALL.map(End::name);
    let secs = |doc: &str| json!({"type": "number", "minimum": 0, "maximum": MAX_SECS, "description": doc});
    let result = |keys: Value| json!({"type": "object", "additionalProperties": false, "properties": keys});
    let after_secs = secs("Time until then, seconds.");
    let success =
        result(json!({"after_secs": after_secs, "writes": {"type": "object", "description": "Values of its output ports."}}));
    let failure = result(json!({"reason": {"$ref": "#/$defs/reason"}, "after_secs": after_secs}));
    let named = |doc: &str| json!({"type": "object", "minProperties": 1, "description": doc});
    let steps = |doc: &str| json!({"type": "array", "items": {"type": "string"}, "description": doc});
    json!({
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "SayFuncGrasp scenario test",
        "type": "object",
        "required": ["scenario", "cases"],
        "additionalProperties": false,
        "properties": {
            "description": {"type": "string", "description": "What is tested."},
            "scenario": {"type": "string", "description": "Scenario whose tree is tested; the path is relative to this file."},
            "set": {"type": "object", "description": "Values of the scenario's parameters."},
            "tick_secs": {"type": "number", "minimum": TICK_SECS.0, "maximum": TICK_SECS.1, "default": 0.1, "description": "Time from tick to tick, seconds."},
            "cases": {"type": "array", "minItems": 1, "items": {"$ref": "#/$defs/case"}}
        },
        "$defs": {
            "reason": reason,
            "result": {
                "description": "One activation of a leaf.",
                "anyOf": [
                    {"enum": ["succeeds", "fails", "skipped", "runs"]},
                    {
                        "type": "object",
                        "minProperties": 1,
                        "maxProperties": 1,
                        "additionalProperties": false,
                        "properties": {
                            "succeeds": success,
                            "fails": {"anyOf": [{"$ref": "#/$defs/reason"}, failure]},
                            "skipped": result(json!({"after_secs": after_secs}))
                        }
                    }
                ]
            },
            "case": {
                "type": "object",
                "required": ["name", "expect"],
                "additionalProperties": false,
                "properties": {
                    "name": {"type": "string", "minLength": 1, "description": "What the case shows."},
                    "leaves": {
                        "type": "object",
                        "description": "Results by path, own name or kind of a leaf: one item an activation, the last repeats. Other leaves succeed at once.",
                        "additionalProperties": {"anyOf": [
                            {"$ref": "#/$defs/result"},
                            {"type": "array", "minItems": 1, "items": {"$ref": "#/$defs/result"}}
                        ]}
                    },
                    "set_entries": named("Blackboard entries before the first tick."),
                    "halt_at_secs": secs("When the tree is halted."),
                    "until_secs": {"type": "number", "minimum": 0, "maximum": MAX_SECS, "default": UNTIL_SECS, "description": "A tree that has not ended by then is running."},
                    "expect": {
                        "type": "object",
                        "minProperties": 1,
                        "additionalProperties": false,
                        "properties": {
                            "status": {"enum": ends},
                            "reason": {"$ref": "#/$defs/reason"},
                            "node": {"type": "string", "description": "Where it failed: path, own name or kind."},
                            "trace": steps("All ends of activations of leaves in order: `lift success`, or `lift` for any result."),
                            "contains": steps("Ends of activations in this order; others may stand between them."),
                            "calls": {"type": "object", "additionalProperties": {"type": "integer", "minimum": 0}, "description": "How often leaves are activated."},
                            "ends_within_secs": {
                                "anyOf": [
                                    {"type": "number", "minimum": 0},
                                    {"type": "array", "items": {"type": "number", "minimum": 0}, "minItems": 2, "maxItems": 2}
                                ],
                                "description": "When the tree ends: [earliest, latest], or the latest alone."
                            },
                            "entries": named("Blackboard entries at the end.")
                        }
                    }
                }
            }
        }
    })
}

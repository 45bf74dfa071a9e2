//! `success`: what must hold at the end.

use crate::document::{Node, Value};
use crate::mistake::{At, Place};
use crate::reader::Reader;
use crate::vocabulary::Vocabulary;
use sfg_tree::Literal;

/// The predicates of a run; all of a list must hold.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Success {
    /// Judged by the simulator.
    pub truth: Vec<Predicate>,
    /// Judged from sensors alone.
    pub sensed: Vec<Predicate>,
}

/// One thing that must hold; the application knows what it means.
#[derive(Clone, Debug, PartialEq)]
pub struct Predicate {
    /// Its name.
    pub name: String,
    /// Its arguments in the order of the file.
    pub args: Vec<(At<String>, At<Literal>)>,
    /// Where it was named.
    pub place: Place,
}

impl Predicate {
    /// An argument by name.
    #[must_use]
    pub fn arg(&self, name: &str) -> Option<&At<Literal>> {
        self.args.iter().find(|(key, _)| key.value == name).map(|(_, value)| value)
    }

    /// The arguments as a JSON object.
    #[must_use]
    pub fn args_json(&self) -> serde_json::Value {
        serde_json::Value::Object(
            self.args.iter().map(|(key, value)| (key.value.clone(), crate::plugins::json_of(&value.value))).collect(),
        )
    }
}

const EXPECTED: &str = "a name, or one name with its arguments: `- name: {argument: value}`";

impl Reader {
    pub(crate) fn success(&mut self, node: &Node, vocabulary: &Vocabulary) -> Option<Success> {
        let fields = self.fields("success", node, &["truth", "sensed"])?;
        let mut of = |key: &str, known: &[String]| -> Vec<Predicate> {
            let items = fields.get(key).and_then(|list| self.list(key, list)).unwrap_or_default();
            items.iter().filter_map(|item| self.predicate(item, known)).collect()
        };
        Some(Success { truth: of("truth", &vocabulary.truth_predicates), sensed: of("sensed", &vocabulary.sensed_predicates) })
    }

    fn predicate(&mut self, item: &Node, known: &[String]) -> Option<Predicate> {
        let (name, place, body) = match &item.value {
            Value::Text(name) => (name, item.place, None),
            Value::Map(_) => {
                let (key, body) =
                    self.only("predicate", item, EXPECTED, "begin it with `- `, or indent it to make it an argument")?;
                (&key.text, key.place, Some((key, body)))
            }
            _ => return self.wrong("predicate", item, EXPECTED),
        };
        let is_known = self.known("predicate", name, place, known);
        let mut args = Vec::new();
        match body {
            None => {}
            Some((key, body)) if matches!(body.value, Value::Null) => self.nothing_after(key),
            Some((_, body)) => {
                for (key, value) in self.entries(name, body)? {
                    if matches!(value.value, Value::Float(number) if !number.is_finite()) {
                        self.wrong::<()>(&key.text, value, "a finite number");
                    }
                    let key = At { value: key.text.clone(), place: key.place };
                    args.push((key, At { value: value.literal(), place: value.place }));
                }
            }
        }
        is_known.then(|| Predicate { name: name.clone(), args, place })
    }
}

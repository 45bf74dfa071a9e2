//! The knowledge base: things, kinds, rules and verbs, read once from the files under `knowledge/`.

use crate::words::{SmallWords, tokens};
use serde::Deserialize;
use sfg_types::{GraspType, ShapeClass, Task};
use std::collections::{BTreeMap, BTreeSet};

const OBJECTS: &str = include_str!("../knowledge/objects.yaml");
const RULES: &str = include_str!("../knowledge/rules.yaml");
const TASKS: &str = include_str!("../knowledge/tasks.yaml");
const WORDS: &str = include_str!("../knowledge/words.yaml");

/// Why the compiled-in files are unusable; a test keeps it from happening.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum KnowledgeError {
    /// A file is no valid YAML of its form.
    #[error("knowledge/{file}: {message}")]
    Unreadable {
        /// File name.
        file: &'static str,
        /// What the parser says.
        message: String,
    },
    /// A file contradicts itself or another one.
    #[error("knowledge: {0}")]
    Inconsistent(String),
}

/// How a part is held.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Hold {
    pub(crate) part: String,
    #[serde(rename = "type")]
    pub(crate) grasp_type: GraspType,
    pub(crate) why: String,
}

/// One category of things.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Thing {
    pub(crate) name: String,
    pub(crate) words: Vec<String>,
    pub(crate) kind: String,
    #[serde(default)]
    pub(crate) novel: bool,
    #[serde(default)]
    pub(crate) looks_like: Vec<String>,
    /// Part and the size across which the hand closes, metres.
    pub(crate) parts: BTreeMap<String, f64>,
    #[serde(default)]
    pub(crate) holds: BTreeMap<String, Hold>,
}

impl Thing {
    /// True when `word` is one of the words for it.
    pub(crate) fn is_called(&self, word: &str) -> bool {
        self.name == word || self.words.iter().any(|own| own == word)
    }
}

/// Up to a size, this type.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct SizeStep {
    up_to_m: f64,
    #[serde(rename = "type")]
    grasp_type: GraspType,
}

/// A family of things.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Kind {
    pub(crate) name: String,
    pub(crate) parts: Vec<String>,
    pub(crate) pours: f64,
    pub(crate) receives: f64,
}

/// A grasp type, or a family from which the size of the part chooses.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Family {
    Wrap,
    Pinch,
    #[serde(untagged)]
    Exactly(GraspType),
}

/// A general rule.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Rule {
    #[serde(default)]
    tasks: Vec<Task>,
    #[serde(default)]
    kinds: Vec<String>,
    parts: Vec<String>,
    #[serde(rename = "type")]
    family: Family,
    why: String,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Rules {
    wrap: Vec<SizeStep>,
    pinch: Vec<SizeStep>,
    kinds: Vec<Kind>,
    shapes: BTreeMap<ShapeClass, String>,
    rules: Vec<Rule>,
}

/// A verb with the places of its roles in the sentence.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Verb {
    pub(crate) verb: String,
    pub(crate) task: Task,
    pub(crate) rank: u8,
    pub(crate) phrases: Vec<String>,
    pub(crate) held: Vec<String>,
    pub(crate) target: Vec<String>,
    #[serde(default)]
    pub(crate) tools: Vec<String>,
    #[serde(default)]
    pub(crate) needs_target: bool,
    #[serde(default)]
    pub(crate) note: Option<String>,
}

/// How to hold something, and how sure that is.
#[derive(Clone, Debug)]
pub(crate) struct Advice {
    pub(crate) part: String,
    pub(crate) grasp_type: GraspType,
    pub(crate) why: String,
    /// Share of such advice that people would agree with, estimated: 0.97 for an entry, less for a rule.
    pub(crate) confidence: f64,
}

/// Everything the backend knows.
#[derive(Clone, Debug)]
pub struct Knowledge {
    pub(crate) things: Vec<Thing>,
    pub(crate) verbs: Vec<Verb>,
    pub(crate) small: SmallWords,
    rules: Rules,
}

impl Knowledge {
    /// The compiled-in knowledge, checked.
    ///
    /// # Errors
    /// [`KnowledgeError`] when a file is malformed or inconsistent.
    pub fn embedded() -> Result<Self, KnowledgeError> {
        fn read<T: serde::de::DeserializeOwned>(file: &'static str, text: &str) -> Result<T, KnowledgeError> {
            serde_saphyr::from_str(text).map_err(|error| KnowledgeError::Unreadable { file, message: error.to_string() })
        }
        let knowledge = Self {
            things: read("objects.yaml", OBJECTS)?,
            verbs: read("tasks.yaml", TASKS)?,
            small: read("words.yaml", WORDS)?,
            rules: read("rules.yaml", RULES)?,
        };
        knowledge.check()?;
        Ok(knowledge)
    }

    /// The same without the ten objects that the paper calls novel.
    #[must_use]
    pub fn without_novel(mut self) -> Self {
        self.things.retain(|thing| !thing.novel);
        self
    }

    /// How many categories of things are known.
    #[must_use]
    pub fn n_things(&self) -> usize {
        self.things.len()
    }

    /// The thing for which `word` stands.
    pub(crate) fn thing(&self, word: &str) -> Option<&Thing> {
        self.things.iter().find(|thing| thing.name == word).or_else(|| self.things.iter().find(|thing| thing.is_called(word)))
    }

    pub(crate) fn kind(&self, name: &str) -> Option<&Kind> {
        self.rules.kinds.iter().find(|kind| kind.name == name)
    }

    /// The kind for which an unknown thing of this form is taken.
    pub(crate) fn kind_of_shape(&self, shape: ShapeClass) -> Option<&Kind> {
        self.kind(self.rules.shapes.get(&shape)?)
    }

    /// How to hold a known thing, or (`None`) an unknown one of the kind; `body_m` is the measured width of its body.
    /// `asked` is the part the user named.
    pub(crate) fn advice(
        &self,
        thing: Option<&Thing>,
        kind: &Kind,
        verb: &Verb,
        body_m: f64,
        asked: &[String],
    ) -> Option<Advice> {
        let has = |part: &String| thing.map_or(kind.parts.contains(part), |thing| thing.parts.contains_key(part));
        if let Some(part) = asked.iter().find(|part| has(part)) {
            return Some(self.advice_on_part(thing, verb, part, body_m));
        }
        if let Some(thing) = thing {
            for (key, confidence) in [(verb.verb.as_str(), 0.97), (verb.task.name(), 0.95)] {
                if let Some(hold) = thing.holds.get(key) {
                    let Hold { part, grasp_type, why } = hold.clone();
                    return Some(Advice { part, grasp_type, why, confidence });
                }
            }
        }
        let (rule, part) = self.rules.rules.iter().find_map(|rule| {
            let fits = (rule.tasks.is_empty() || rule.tasks.contains(&verb.task))
                && (rule.kinds.is_empty() || rule.kinds.contains(&kind.name));
            fits.then(|| rule.parts.iter().find(|part| has(part))).flatten().map(|part| (rule, part.clone()))
        })?;
        let across_m = self.across(thing, &part, body_m);
        Some(Advice {
            grasp_type: self.choose(rule.family, across_m),
            why: rule.why.clone(),
            confidence: if thing.is_some() { 0.70 } else { 0.50 },
            part,
        })
    }

    /// The user named the part: hold that, with the type known for it or by its size.
    fn advice_on_part(&self, thing: Option<&Thing>, verb: &Verb, part: &str, body_m: f64) -> Advice {
        let entries = thing.map(|thing| &thing.holds);
        let known = entries.and_then(|holds| {
            [verb.verb.as_str(), verb.task.name()]
                .iter()
                .filter_map(|key| holds.get(*key))
                .chain(holds.values())
                .find(|hold| hold.part == part)
        });
        let why = format!("the user asked for the {part}");
        let part = part.to_owned();
        match known {
            Some(hold) => Advice { part, grasp_type: hold.grasp_type, why, confidence: 0.90 },
            None => {
                let across_m = self.across(thing, &part, body_m);
                let family = match part.as_str() {
                    "rim" | "edge" | "stem" | "cap" | "tip" => Family::Pinch,
                    "lid" | "knob" => Family::Exactly(GraspType::PrecisionDisk),
                    _ => Family::Wrap,
                };
                Advice { grasp_type: self.choose(family, across_m), part, why, confidence: 0.75 }
            }
        }
    }

    fn across(&self, thing: Option<&Thing>, part: &str, body_m: f64) -> f64 {
        let typical = thing.and_then(|thing| thing.parts.get(part)).copied();
        // The cameras measure the body of this very thing; they do not resolve its handle.
        if part == "body" && body_m > 0.0 { body_m } else { typical.unwrap_or(0.03) }
    }

    fn choose(&self, family: Family, across_m: f64) -> GraspType {
        let steps = match family {
            Family::Exactly(grasp_type) => return grasp_type,
            Family::Wrap => &self.rules.wrap,
            Family::Pinch => &self.rules.pinch,
        };
        let step = steps.iter().find(|step| across_m <= step.up_to_m).or_else(|| steps.last());
        step.map_or(GraspType::MediumWrap, |step| step.grasp_type)
    }

    fn check(&self) -> Result<(), KnowledgeError> {
        let bad = |message: String| Err(KnowledgeError::Inconsistent(message));
        let mut owners: BTreeMap<Vec<String>, &str> = BTreeMap::new();
        let verb_names: BTreeSet<&str> = self.verbs.iter().flat_map(|v| [v.verb.as_str(), v.task.name()]).collect();
        for thing in &self.things {
            if self.kind(&thing.kind).is_none() {
                return bad(format!("{:?} is of the unknown kind {:?}", thing.name, thing.kind));
            }
            for word in thing.words.iter().chain([&thing.name]) {
                if let Some(other) = owners.insert(tokens(word), &thing.name).filter(|other| *other != thing.name) {
                    return bad(format!("{word:?} stands for {other:?} and for {:?}", thing.name));
                }
            }
            if thing.parts.is_empty() || thing.parts.values().any(|size| !(0.001..0.6).contains(size)) {
                return bad(format!("{:?} has no parts or a part of impossible size", thing.name));
            }
            for (key, hold) in &thing.holds {
                if !verb_names.contains(key.as_str()) {
                    return bad(format!("{:?} has an entry for the unknown task {key:?}", thing.name));
                }
                if !thing.parts.contains_key(&hold.part) || hold.why.is_empty() {
                    return bad(format!("{:?}, {key}: {:?} is no part of it, or the reason is missing", thing.name, hold.part));
                }
            }
        }
        for tool in self.verbs.iter().flat_map(|verb| &verb.tools) {
            if self.thing(tool).is_none() {
                return bad(format!("the tool {tool:?} is no known thing"));
            }
        }
        for steps in [&self.rules.wrap, &self.rules.pinch] {
            if steps.is_empty() || !steps.windows(2).all(|pair| pair[0].up_to_m < pair[1].up_to_m) {
                return bad("sizes of the grip families must ascend".to_owned());
            }
        }
        let known_kind = |name: &String| self.kind(name).is_some();
        if !self.rules.rules.iter().flat_map(|rule| &rule.kinds).chain(self.rules.shapes.values()).all(known_kind) {
            return bad("a rule names an unknown kind".to_owned());
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "tests fail by panicking")]
    use super::*;

    #[test]
    fn embedded_files_are_consistent() {
        let knowledge = Knowledge::embedded().unwrap();
        assert!(knowledge.n_things() >= 60, "{} things", knowledge.n_things());
        assert_eq!(knowledge.things.iter().filter(|thing| thing.novel).count(), 10);
        assert!(knowledge.clone().without_novel().thing("stapler").is_none());
    }

    #[test]
    fn every_thing_has_advice_for_every_verb() {
        let knowledge = Knowledge::embedded().unwrap();
        for thing in &knowledge.things {
            for verb in &knowledge.verbs {
                let kind = knowledge.kind(&thing.kind).unwrap();
                let advice = knowledge.advice(Some(thing), kind, verb, 0.06, &[]);
                assert!(advice.is_some_and(|a| thing.parts.contains_key(&a.part)), "{} {}", verb.verb, thing.name);
            }
        }
        for kind in &knowledge.rules.kinds {
            assert!(knowledge.advice(None, kind, &knowledge.verbs[0], 0.06, &[]).is_some(), "{}", kind.name);
        }
    }
}

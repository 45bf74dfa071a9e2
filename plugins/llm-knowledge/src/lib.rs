//! Grasp functionality from an embedded knowledge base: no network, no model weights, well under a millisecond a sentence.
//!
//! [`KnowledgeBackend`] reads the sentence with a small deterministic grammar, resolves what it names against the inventory
//! (whose names are guesses of the cameras, with scores), and looks up how people hold such a thing for such a task: first an
//! entry of the thing itself, then the general rules. Every step becomes a sentence of the rationale. What stays open is
//! asked; what is absent, impossible or unsafe is refused.
//!
//! The knowledge lies in reviewable files under `knowledge/`, compiled in.

mod decide;
mod knowledge;
mod reference;
mod sentence;
mod words;

pub use knowledge::{Knowledge, KnowledgeError};

use reference::Scene;
use sentence::Lexicon;
use sfg_plugin::{FunctionalityRequest, LlmBackend, PluginContext, PluginError};
use sfg_types::FunctionalityAnswer;
use std::collections::BTreeSet;

/// The name under which scenarios ask for this plugin.
pub const NAME: &str = "knowledge";

/// The embedded language backend.
#[derive(Clone, Debug)]
pub struct KnowledgeBackend {
    knowledge: Knowledge,
    lexicon: Lexicon,
}

impl KnowledgeBackend {
    /// A backend with the parameters of the scenario: `without_novel: true` removes the paper's ten novel objects.
    ///
    /// # Errors
    /// [`PluginError::BadParameter`] for any other parameter or a value that is no boolean.
    pub fn new(context: &PluginContext<'_>) -> Result<Self, PluginError> {
        let bad = |message: String| PluginError::BadParameter { plugin: NAME.to_owned(), message };
        let mut without_novel = false;
        let empty = serde_json::Map::new();
        let params = match context.params {
            serde_json::Value::Null => &empty,
            serde_json::Value::Object(params) => params,
            other => return Err(bad(format!("expected a map of parameters, got {other}"))),
        };
        for (key, value) in params {
            if key != "without_novel" {
                return Err(bad(format!("unknown parameter {key:?}, known: \"without_novel\"")));
            }
            without_novel =
                value.as_bool().ok_or_else(|| bad(format!("\"without_novel\" must be true or false, got {value}")))?;
        }
        let knowledge =
            Knowledge::embedded().map_err(|error| PluginError::Failed { plugin: NAME.to_owned(), message: error.to_string() })?;
        Ok(Self::from_knowledge(if without_novel { knowledge.without_novel() } else { knowledge }))
    }

    /// A backend over the given knowledge.
    #[must_use]
    pub fn from_knowledge(knowledge: Knowledge) -> Self {
        let lexicon = Lexicon::new(&knowledge);
        Self { knowledge, lexicon }
    }
}

impl LlmBackend for KnowledgeBackend {
    fn infer(&mut self, request: &FunctionalityRequest<'_>) -> Result<FunctionalityAnswer, PluginError> {
        let seen: BTreeSet<String> = request
            .inventory
            .clusters
            .iter()
            .flat_map(|cluster| cluster.names.iter().map(|ranked| ranked.name.clone()))
            .collect();
        let sentence = self.lexicon.parse(request.instruction.as_str(), &seen);
        Ok(decide::decide(&sentence, &Scene { inventory: request.inventory, knowledge: &self.knowledge }))
    }
}

#[cfg(test)]
mod tests;

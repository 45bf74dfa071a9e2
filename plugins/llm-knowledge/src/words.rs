//! Words: splitting, inflection, typing errors, and the small words of a sentence.

use serde::Deserialize;
use sfg_types::ColourName;
use std::collections::{BTreeMap, BTreeSet};

/// Lower-case words without punctuation; `don't` becomes `do not`, hyphens and apostrophes separate.
pub(crate) fn tokens(text: &str) -> Vec<String> {
    let text = text.to_lowercase().replace('’', "'").replace("n't", " not");
    text.split(|c: char| !c.is_alphanumeric()).filter(|word| !word.is_empty()).map(str::to_owned).collect()
}

/// The word itself and what it may be an inflected form of.
pub(crate) fn lemmas(word: &str) -> Vec<String> {
    let mut forms = vec![word.to_owned()];
    let mut push = |form: &str| {
        if form.len() >= 2 {
            forms.push(form.to_owned());
        }
    };
    if let Some(stem) = word.strip_suffix("ies") {
        push(&format!("{stem}y"));
    }
    if let Some(stem) = word.strip_suffix("ves") {
        push(&format!("{stem}fe"));
    }
    if let Some(stem) = word.strip_suffix("es") {
        push(stem);
    }
    if let Some(stem) = word.strip_suffix('s').filter(|stem| !stem.ends_with('s')) {
        push(stem);
    }
    for suffix in ["ing", "ed"] {
        if let Some(stem) = word.strip_suffix(suffix).filter(|stem| stem.len() >= 2) {
            push(stem);
            push(&format!("{stem}e"));
            let mut letters = stem.chars().rev();
            if letters.next() == letters.next() {
                push(&stem[..stem.len() - stem.chars().next_back().map_or(0, char::len_utf8)]);
            }
        }
    }
    forms
}

/// The known word that `word` is a typing error of: one letter wrong, missing, added or swapped, words of four letters and more.
pub(crate) fn corrected<'a>(word: &str, known: &'a BTreeSet<String>) -> Option<&'a str> {
    let n = word.chars().count();
    if n < 4 || word.chars().any(|c| c.is_ascii_digit()) {
        return None;
    }
    // Fingers slip inside a word; another first letter is another word ("nice" is no "dice").
    let first = word.chars().next();
    let mut near = known
        .iter()
        .filter(|other| other.chars().next() == first && other.chars().count() >= 4 && strsim::osa_distance(word, other) == 1);
    near.next().map(String::as_str)
}

/// What a size word compares.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Measure {
    Height,
    Volume,
    Length,
    Width,
}

/// Axis of the base frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Axis {
    X,
    Y,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct SizeWord {
    pub(crate) words: Vec<String>,
    pub(crate) measure: Measure,
    pub(crate) sign: f64,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct PlaceWord {
    pub(crate) phrases: Vec<String>,
    pub(crate) axis: Axis,
    pub(crate) sign: f64,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Contents {
    pub(crate) words: Vec<String>,
    #[serde(rename = "in")]
    pub(crate) vessels: Vec<String>,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Generic {
    pub(crate) words: Vec<String>,
    pub(crate) kinds: Vec<String>,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct PartWord {
    pub(crate) words: Vec<String>,
    pub(crate) parts: Vec<String>,
}

/// `words.yaml`.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct SmallWords {
    pub(crate) colours: BTreeMap<String, Vec<String>>,
    pub(crate) sizes: Vec<SizeWord>,
    pub(crate) places: Vec<PlaceWord>,
    pub(crate) contents: Vec<Contents>,
    pub(crate) generic: Vec<Generic>,
    pub(crate) parts: Vec<PartWord>,
    pub(crate) people: BTreeSet<String>,
    pub(crate) harm_always: BTreeSet<String>,
    pub(crate) harm_people: BTreeSet<String>,
    pub(crate) negations: Vec<String>,
    pub(crate) prepositions: Vec<String>,
    pub(crate) determiners: BTreeSet<String>,
    pub(crate) fillers: BTreeSet<String>,
}

/// The word for a colour.
pub(crate) fn colour_word(colour: ColourName) -> &'static str {
    match colour {
        ColourName::Black => "black",
        ColourName::Grey => "grey",
        ColourName::White => "white",
        ColourName::Red => "red",
        ColourName::Orange => "orange",
        ColourName::Yellow => "yellow",
        ColourName::Green => "green",
        ColourName::Blue => "blue",
        ColourName::Purple => "purple",
        ColourName::Pink => "pink",
        ColourName::Brown => "brown",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_are_split_and_reduced() {
        assert_eq!(tokens("Don't stir-fry Anna's eggs!"), ["do", "not", "stir", "fry", "anna", "s", "eggs"]);
        assert!(lemmas("pouring").contains(&"pour".to_owned()));
        assert!(lemmas("stirring").contains(&"stir".to_owned()));
        assert!(lemmas("glasses").contains(&"glass".to_owned()));
        assert!(!lemmas("glass").contains(&"glas".to_owned()));
        assert!(lemmas("knives").contains(&"knife".to_owned()));
    }

    #[test]
    fn one_slip_of_the_finger_is_forgiven() {
        let known: BTreeSet<String> = ["bottle", "bowl", "pour", "mug"].map(str::to_owned).into();
        assert_eq!(corrected("botle", &known), Some("bottle"));
        assert_eq!(corrected("bottel", &known), Some("bottle"));
        assert_eq!(corrected("puor", &known), Some("pour"));
        assert_eq!(corrected("mag", &known), None);
        assert_eq!(corrected("tour", &known), None);
        assert_eq!(corrected("turtle", &known), None);
    }
}

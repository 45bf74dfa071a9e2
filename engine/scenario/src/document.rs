//! A YAML file as a tree of values with places, so that all mistakes can be found in one reading.

use crate::layout;
use crate::mistake::{Mistake, Place};
use serde::de::{Deserialize, Deserializer, MapAccess, SeqAccess, Visitor};
use serde_saphyr::Spanned;
use sfg_tree::Literal;
use std::fmt;

/// Largest accepted file.
pub const MAX_FILE_BYTES: usize = 16 << 20;
/// Deepest accepted nesting of lists and maps.
pub const MAX_DEPTH: usize = 64;
/// How many values aliases (`*name`) may stand for in all.
pub const MAX_ALIAS_EXPANSION: usize = 10_000;

/// A value and its place.
#[derive(Clone, Debug)]
pub(crate) struct Node {
    pub(crate) value: Value,
    pub(crate) place: Place,
}

#[derive(Clone, Debug)]
pub(crate) enum Value {
    Null,
    /// Nobody knows, and that was reported already.
    Unknown,
    Bool(bool),
    Int(i64),
    Float(f64),
    Text(String),
    List(Vec<Node>),
    /// In the order of the file; a key may stand there twice.
    Map(Vec<(Key, Node)>),
}

#[derive(Clone, Debug)]
pub(crate) struct Key {
    pub(crate) text: String,
    pub(crate) place: Place,
}

impl Node {
    /// What was found, for "expected ..., found ...".
    pub(crate) fn found(&self) -> String {
        match &self.value {
            Value::Null | Value::Unknown => "nothing".to_owned(),
            Value::Bool(value) => value.to_string(),
            Value::Int(value) => value.to_string(),
            Value::Float(value) => value.to_string(),
            Value::Text(text) if text.chars().count() > 40 => "a text".to_owned(),
            Value::Text(text) => format!("{text:?}"),
            Value::List(items) => format!("a list of {}", items.len()),
            Value::Map(_) => "a map".to_owned(),
        }
    }

    /// Another value at the same place.
    pub(crate) fn with(&self, value: Value) -> Self {
        Self { value, place: self.place }
    }

    /// The value of a key of a map.
    pub(crate) fn get(&self, key: &str) -> Option<&Self> {
        let Value::Map(entries) = &self.value else { return None };
        entries.iter().find(|(name, _)| name.text == key).map(|(_, node)| node)
    }

    /// How many values it holds, itself included.
    pub(crate) fn n_values(&self) -> usize {
        match &self.value {
            Value::List(items) => 1 + items.iter().map(Self::n_values).sum::<usize>(),
            Value::Map(entries) => 1 + entries.iter().map(|(_, node)| node.n_values()).sum::<usize>(),
            _ => 1,
        }
    }

    fn set_file(&mut self, file: u32) {
        self.place.file = file;
        match &mut self.value {
            Value::List(items) => items.iter_mut().for_each(|item| item.set_file(file)),
            Value::Map(entries) => entries.iter_mut().for_each(|(key, node)| {
                key.place.file = file;
                node.set_file(file);
            }),
            _ => {}
        }
    }

    /// The value as a literal; nothing counts as an empty text.
    pub(crate) fn literal(&self) -> Literal {
        match &self.value {
            Value::Null | Value::Unknown => Literal::Text(String::new()),
            Value::Bool(value) => Literal::Bool(*value),
            Value::Int(value) => Literal::Int(*value),
            Value::Float(value) => Literal::Float(*value),
            Value::Text(text) => Literal::Text(text.clone()),
            Value::List(items) => Literal::List(items.iter().map(Self::literal).collect()),
            Value::Map(entries) => Literal::Map(entries.iter().map(|(key, node)| (key.text.clone(), node.literal())).collect()),
        }
    }
}

/// The document in `text`, which is that of the file with this number.
pub(crate) fn parse(text: &str, file: u32) -> Result<Node, Mistake> {
    let mut document = parse_as_written(text).map_err(|error| {
        let mut mistake = layout::slip(text, &error).unwrap_or_else(|| {
            let place = error.location().map_or(Place::START, place_of);
            let (message, help) = explain(&error);
            Mistake { help, ..Mistake::new(place, message) }
        });
        mistake.place.file = file;
        mistake
    })?;
    if file != 0 {
        document.set_file(file);
    }
    Ok(document)
}

pub(crate) fn parse_as_written(text: &str) -> Result<Node, serde_saphyr::Error> {
    let options = serde_saphyr::options! {
        budget: serde_saphyr::budget! {
            max_depth: MAX_DEPTH,
            flow_nesting_limit: MAX_DEPTH,
            max_nodes: 4_000_000,
            max_events: 12_000_000,
            enforce_alias_anchor_ratio: false,
        },
        alias_limits: serde_saphyr::alias_limits! {
            max_total_replayed_events: MAX_ALIAS_EXPANSION,
        },
        duplicate_keys: serde_saphyr::DuplicateKeyPolicy::PassThrough,
        non_finite_float_policy: serde_saphyr::options::NonFiniteFloatPolicy::PassThrough,
        strict_booleans: true,
        with_snippet: false,
    };
    serde_saphyr::from_str_with_options::<Node>(text, options)
}

const DEPTH_HELP: &str = "give a part of the tree a name under `subtrees` and use it with `subtree: name`";

/// The parser's error in the words of this crate where the parser's are no help.
fn explain(error: &serde_saphyr::Error) -> (String, Option<String>) {
    use serde_saphyr::Error;
    use serde_saphyr::budget::BudgetBreach;
    match error {
        Error::WithSnippet { error, .. } | Error::AliasError { error, .. } => explain(error),
        Error::Budget { breach: BudgetBreach::Depth { .. }, .. } => {
            (format!("nested deeper than {MAX_DEPTH} lists and maps"), Some(DEPTH_HELP.to_owned()))
        }
        Error::Budget { breach: BudgetBreach::Documents { .. }, .. } | Error::MultipleDocuments { .. } => {
            ("a second document begins here".to_owned(), Some("a scenario is one document; remove the line `---`".to_owned()))
        }
        Error::AliasReplayLimitExceeded { .. }
        | Error::AliasExpansionLimitExceeded { .. }
        | Error::AliasReplayStackDepthExceeded { .. } => {
            (format!("aliases stand for more than {MAX_ALIAS_EXPANSION} values"), Some("write the values out".to_owned()))
        }
        _ => {
            let text = error.without_snippet().to_string();
            // The scanner's own bound is met before the budget's where brackets nest.
            if text.starts_with("recursion limit exceeded") {
                return (format!("nested deeper than {MAX_DEPTH} lists and maps"), Some(DEPTH_HELP.to_owned()));
            }
            (text.split(" at line ").next().unwrap_or("unreadable").trim_end_matches(',').to_owned(), None)
        }
    }
}

fn place_of(location: serde_saphyr::Location) -> Place {
    let number = |value: u64| u32::try_from(value).unwrap_or(u32::MAX).max(1);
    Place { file: 0, line: number(location.line()), column: number(location.column()), n_chars: 1 }
}

impl<'de> Deserialize<'de> for Node {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let spanned = Spanned::<Value>::deserialize(deserializer)?;
        let mut place = place_of(spanned.referenced);
        let n_chars = match &spanned.value {
            Value::Bool(value) => value.to_string().len(),
            Value::Int(value) => value.to_string().len(),
            Value::Float(value) => value.to_string().len(),
            Value::Text(text) => text.chars().count(),
            Value::Null | Value::Unknown | Value::List(_) | Value::Map(_) => 1,
        };
        place.n_chars = u32::try_from(n_chars).unwrap_or(u32::MAX).max(1);
        Ok(Self { value: spanned.value, place })
    }
}

impl<'de> Deserialize<'de> for Key {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let spanned = Spanned::<String>::deserialize(deserializer)?;
        let mut place = place_of(spanned.referenced);
        place.n_chars = u32::try_from(spanned.value.chars().count()).unwrap_or(u32::MAX).max(1);
        Ok(Self { text: spanned.value, place })
    }
}

impl<'de> Deserialize<'de> for Value {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(AnyValue)
    }
}

struct AnyValue;

impl<'de> Visitor<'de> for AnyValue {
    type Value = Value;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a value")
    }
    fn visit_unit<E>(self) -> Result<Value, E> {
        Ok(Value::Null)
    }
    fn visit_none<E>(self) -> Result<Value, E> {
        Ok(Value::Null)
    }
    fn visit_bool<E>(self, value: bool) -> Result<Value, E> {
        Ok(Value::Bool(value))
    }
    fn visit_i64<E>(self, value: i64) -> Result<Value, E> {
        Ok(Value::Int(value))
    }
    #[expect(
        clippy::cast_precision_loss,
        reason = "beyond the range of whole numbers every key has, so it is refused as too large"
    )]
    fn visit_u64<E>(self, value: u64) -> Result<Value, E> {
        Ok(i64::try_from(value).map_or(Value::Float(value as f64), Value::Int))
    }
    fn visit_f64<E>(self, value: f64) -> Result<Value, E> {
        Ok(Value::Float(value))
    }
    fn visit_str<E>(self, text: &str) -> Result<Value, E> {
        Ok(Value::Text(text.to_owned()))
    }
    fn visit_string<E>(self, text: String) -> Result<Value, E> {
        Ok(Value::Text(text))
    }
    fn visit_seq<A: SeqAccess<'de>>(self, mut items: A) -> Result<Value, A::Error> {
        let mut list = Vec::new();
        while let Some(item) = items.next_element()? {
            list.push(item);
        }
        Ok(Value::List(list))
    }
    fn visit_map<A: MapAccess<'de>>(self, mut entries: A) -> Result<Value, A::Error> {
        let mut map = Vec::new();
        while let Some((key, mut node)) = entries.next_entry::<Key, Node>()? {
            // Nothing stands nowhere; what is missing is seen at the key.
            if matches!(node.value, Value::Null) {
                node.place = key.place;
            }
            map.push((key, node));
        }
        Ok(Value::Map(map))
    }
}

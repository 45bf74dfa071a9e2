//! `parameters`: values with a name, used as `${name}` and set from outside.
//!
//! | form | means |
//! |---|---|
//! | `${height_m}` | the parameter; alone it keeps its type, inside a text it becomes part of the text |
//! | `${height_m:-0.1}` | the parameter; else the environment variable; else 0.1 |
//! | `$${` | the letters `${` |
//!
//! A default under `parameters` may use the environment and the parameters above it.

use crate::document::{self, Key, MAX_ALIAS_EXPANSION, MAX_FILE_BYTES, Node, Value};
use crate::mistake::Place;
use crate::reader::Reader;
use sfg_tree::nearest;
use std::collections::{BTreeMap, BTreeSet};

/// What is decided outside the file: values of parameters, and the environment.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Settings {
    given: BTreeMap<String, String>,
    environment: BTreeMap<String, String>,
}

/// An assignment that cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum SettingError {
    /// Not of the form `name=value`.
    #[error("--set {0:?} is no assignment; write NAME=VALUE, for example height_m=0.15")]
    NoAssignment(String),
    /// The name is assigned twice.
    #[error("--set gives {0:?} twice")]
    Twice(String),
}

impl Settings {
    /// Settings from assignments such as `height_m=0.15` and the environment's variables.
    ///
    /// # Errors
    /// [`SettingError`] when an assignment has no `=`, or two have one name.
    pub fn new(assignments: &[String], environment: impl IntoIterator<Item = (String, String)>) -> Result<Self, SettingError> {
        let mut given = BTreeMap::new();
        for assignment in assignments {
            let parts = assignment.split_once('=').filter(|(name, _)| is_name(name));
            let (name, value) = parts.ok_or_else(|| SettingError::NoAssignment(assignment.clone()))?;
            if given.insert(name.to_owned(), value.to_owned()).is_some() {
                return Err(SettingError::Twice(name.to_owned()));
            }
        }
        Ok(Self { given, environment: environment.into_iter().collect() })
    }
}

fn is_name(text: &str) -> bool {
    text.starts_with(|first: char| first.is_ascii_alphabetic() || first == '_')
        && text.chars().all(|letter| letter.is_ascii_alphanumeric() || letter == '_')
}

/// A part of a text.
#[derive(Debug, PartialEq)]
enum Piece<'t> {
    Text(&'t str),
    Use { name: &'t str, default: Option<&'t str> },
}

/// The parts of `text`, or what is wrong with it.
fn pieces(text: &str) -> Result<Vec<Piece<'_>>, String> {
    let (mut pieces, mut rest) = (Vec::new(), text);
    while let Some(at) = rest.find("${") {
        let (before, after) = (&rest[..at], &rest[at + 2..]);
        if let Some(escaped) = before.strip_suffix('$') {
            pieces.extend([Piece::Text(escaped), Piece::Text("${")]);
            rest = after;
            continue;
        }
        let Some((inside, after)) = after.split_once('}') else {
            return Err(format!("{:?} does not end with \"}}\"", &rest[at..]));
        };
        let (name, default) = inside.split_once(":-").map_or((inside, None), |(name, default)| (name, Some(default)));
        if !is_name(name) {
            return Err(format!("{name:?} is no name of a parameter; a name has letters, digits and underscores"));
        }
        pieces.extend([Piece::Text(before), Piece::Use { name, default }]);
        rest = after;
    }
    pieces.push(Piece::Text(rest));
    pieces.retain(|piece| *piece != Piece::Text(""));
    Ok(pieces)
}

struct Parameter {
    value: Node,
    /// A value that stands in no file is shown where it is used.
    is_from_outside: bool,
    /// Where it is declared, unless it was only given from outside.
    key: Option<Key>,
}

/// Puts values in the place of their names.
pub(crate) struct Parameters<'a> {
    reader: &'a mut Reader,
    settings: &'a Settings,
    known: BTreeMap<String, Parameter>,
    used: BTreeSet<String>,
    /// What came from outside and was used.
    pub(crate) taken: BTreeMap<String, String>,
    n_values: usize,
    n_bytes: usize,
    is_full: bool,
    /// `parameters` is no map: that a parameter is unknown is not reported as well.
    is_unread: bool,
}

impl<'a> Parameters<'a> {
    pub(crate) fn new(reader: &'a mut Reader, settings: &'a Settings) -> Self {
        let (known, used, taken) = (BTreeMap::new(), BTreeSet::new(), BTreeMap::new());
        Self { reader, settings, known, used, taken, n_values: 0, n_bytes: 0, is_full: false, is_unread: false }
    }

    /// Replaces every use in `document`, and reports parameters without a use.
    pub(crate) fn apply(&mut self, document: &mut Node) {
        let place = document.get("parameters").map_or(Place::START, |node| node.place);
        if let Some(node) = document.get("parameters").cloned() {
            self.is_unread = !matches!(node.value, Value::Map(_));
            self.declare(&node);
        }
        let undeclared: Vec<&String> = self.settings.given.keys().filter(|name| !self.known.contains_key(*name)).collect();
        for name in undeclared {
            let value = self.given(name, place).unwrap_or(Node { value: Value::Unknown, place });
            self.known.insert(name.clone(), Parameter { value, is_from_outside: true, key: None });
        }
        if let Value::Map(entries) = &mut document.value {
            let values = entries.iter_mut().filter(|(key, _)| key.text != "parameters" && key.text != "include");
            values.for_each(|(_, node)| self.replace(node));
        }
        self.report_unused(place);
    }

    fn declare(&mut self, node: &Node) {
        for (key, value) in self.reader.entries("parameters", node).unwrap_or_default() {
            if !is_name(&key.text) {
                let help = "a name has letters, digits and underscores";
                self.reader.report_with_help(key.place, format!("{:?} is no name of a parameter", key.text), help);
            }
            let mut value = value.clone();
            if matches!(value.value, Value::Null) {
                self.reader.wrong::<()>(&format!("parameter {:?}", key.text), &value, "a default value");
                value.value = Value::Unknown;
            }
            self.replace(&mut value);
            let given = self.given(&key.text, key.place);
            let is_from_outside = given.is_some();
            let parameter = Parameter { value: given.unwrap_or(value), is_from_outside, key: Some(key.clone()) };
            self.known.insert(key.text.clone(), parameter);
        }
    }

    /// The value of a parameter that is given from outside.
    fn given(&mut self, name: &str, place: Place) -> Option<Node> {
        let text = self.settings.given.get(name)?;
        self.taken.insert(name.to_owned(), text.clone());
        let value = value_of(text).unwrap_or_else(|message| {
            let help = format!("quote a text: --set '{name}=\"...\"'");
            self.reader.report_with_help(place, format!("--set {name}: {message}"), help);
            Value::Unknown
        });
        Some(Node { value, place })
    }

    fn report_unused(&mut self, place: Place) {
        let unused: Vec<(&String, &Parameter)> = self.known.iter().filter(|(name, _)| !self.used.contains(*name)).collect();
        for (name, parameter) in unused {
            match (self.settings.given.contains_key(name), &parameter.key) {
                (true, None) => {
                    let names = self.known.keys().filter(|known| *known != name).chain(&self.used).map(String::as_str);
                    let help = match nearest(name, names) {
                        Some(near) => format!("did you mean {near:?}?"),
                        None => "declare it under `parameters` and use it".to_owned(),
                    };
                    self.reader.report_with_help(place, format!("--set {name}: the scenario has no parameter {name:?}"), help);
                }
                (true, Some(key)) => {
                    let message = format!("--set {name}: the scenario does not use parameter {name:?}");
                    self.reader.report_with_help(key.place, message, format!("write `${{{name}}}` where it is meant"));
                }
                // A file that others include declares more than each of them needs.
                (false, Some(key)) if key.place.file == 0 => {
                    let message = format!("parameter {name:?} is not used");
                    self.reader.warn_with_help(key.place, message, format!("write `${{{name}}}` where it is meant"));
                }
                _ => {}
            }
        }
    }

    fn replace(&mut self, node: &mut Node) {
        match &mut node.value {
            Value::List(items) => items.iter_mut().for_each(|item| self.replace(item)),
            Value::Map(entries) => entries.iter_mut().for_each(|(_, value)| self.replace(value)),
            Value::Text(text) if text.contains("${") => {
                let text = std::mem::take(text);
                *node = self.replaced(&text, node.place);
            }
            _ => {}
        }
    }

    fn replaced(&mut self, text: &str, place: Place) -> Node {
        let unknown = Node { value: Value::Unknown, place };
        if self.is_full {
            return unknown;
        }
        let pieces = match pieces(text) {
            Ok(pieces) => pieces,
            Err(message) => {
                self.reader.report_with_help(place, message, "write `${name}`, or `$${` for the letters themselves");
                return unknown;
            }
        };
        if let [Piece::Use { name, default }] = pieces.as_slice() {
            let node = self.value(name, *default, place);
            let is_small = self.has_room(node.n_values() - 1, n_bytes(&node), place);
            return if is_small { node } else { unknown };
        }
        let mut whole = String::new();
        for piece in pieces {
            let n_before = whole.len();
            match piece {
                Piece::Text(text) => whole.push_str(text),
                Piece::Use { name, default } => {
                    let node = self.value(name, default, place);
                    match &node.value {
                        Value::Unknown => return unknown,
                        Value::Text(text) => whole.push_str(text),
                        Value::Bool(value) => whole.push_str(&value.to_string()),
                        Value::Int(value) => whole.push_str(&value.to_string()),
                        Value::Float(value) if value.is_finite() => whole.push_str(&value.to_string()),
                        _ => {
                            let message = format!("parameter {name:?} is {} and cannot stand inside a text", node.found());
                            self.reader.report(node.place, message);
                            return unknown;
                        }
                    }
                }
            }
            if !self.has_room(0, whole.len() - n_before, place) {
                return unknown;
            }
        }
        unknown.with(Value::Text(whole))
    }

    fn value(&mut self, name: &str, default: Option<&str>, place: Place) -> Node {
        self.used.insert(name.to_owned());
        if let Some(parameter) = self.known.get(name) {
            let value = parameter.value.clone();
            return if parameter.is_from_outside { at_place(value, place) } else { value };
        }
        let unknown = Node { value: Value::Unknown, place };
        let Some(default) = default else {
            if self.is_unread {
                return unknown;
            }
            let help = match nearest(name, self.known.keys().map(String::as_str)) {
                Some(near) => format!("did you mean {near:?}?"),
                None => format!("declare it under `parameters`, or give a default: `${{{name}:-value}}`"),
            };
            self.reader.report_with_help(place, format!("unknown parameter {name:?}"), help);
            return unknown;
        };
        let text = match self.settings.environment.get(name) {
            Some(text) => {
                self.taken.insert(name.to_owned(), text.clone());
                text.as_str()
            }
            None => default,
        };
        let value = value_of(text).unwrap_or_else(|_| Value::Text(text.to_owned()));
        at_place(Node { value, place }, place)
    }

    /// Small files must not become large ones. Once is said enough: what follows is not replaced any more.
    fn has_room(&mut self, n_values: usize, n_bytes: usize, place: Place) -> bool {
        self.n_values += n_values;
        self.n_bytes += n_bytes;
        if !self.is_full && (self.n_values > MAX_ALIAS_EXPANSION || self.n_bytes > MAX_FILE_BYTES) {
            let message = format!("parameters stand for more than {MAX_ALIAS_EXPANSION} values or {} MB", MAX_FILE_BYTES >> 20);
            self.reader.report_with_help(place, message, "write the values out");
            self.is_full = true;
        }
        !self.is_full
    }
}

fn n_bytes(node: &Node) -> usize {
    match &node.value {
        Value::Text(text) => text.len(),
        Value::List(items) => items.iter().map(n_bytes).sum(),
        Value::Map(entries) => entries.iter().map(|(key, node)| key.text.len() + n_bytes(node)).sum(),
        _ => 0,
    }
}

/// `node` as if it were written at `place`.
fn at_place(node: Node, place: Place) -> Node {
    let value = match node.value {
        Value::List(items) => Value::List(items.into_iter().map(|item| at_place(item, place)).collect()),
        value => value,
    };
    Node { value, place }
}

/// A value as in a file: a number, true or false, a text, or a list of them.
fn value_of(text: &str) -> Result<Value, String> {
    if text.is_empty() {
        return Ok(Value::Text(String::new()));
    }
    match document::parse(text, 0) {
        Ok(node) if has_map(&node) => Err("expected a value, found a map".to_owned()),
        Ok(Node { value: Value::Null, .. }) => Ok(Value::Text(text.to_owned())),
        Ok(node) => Ok(node.value),
        Err(mistake) => Err(mistake.message),
    }
}

fn has_map(node: &Node) -> bool {
    match &node.value {
        Value::Map(_) => true,
        Value::List(items) => items.iter().any(has_map),
        _ => false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn check(text: &str, expected: &[Piece<'_>]) {
        assert_eq!(pieces(text).as_deref(), Ok(expected));
    }

    #[test]
    fn texts_are_taken_apart() {
        let name = |name, default| Piece::Use { name, default };
        check("plain $ {a}", &[Piece::Text("plain $ {a}")]);
        check("${a}", &[name("a", None)]);
        check("x${a}y${b:-1 2}", &[Piece::Text("x"), name("a", None), Piece::Text("y"), name("b", Some("1 2"))]);
        check("{${a}}", &[Piece::Text("{"), name("a", None), Piece::Text("}")]);
        check("$${a}", &[Piece::Text("${"), Piece::Text("a}")]);
        check("${a:-}", &[name("a", Some(""))]);
    }

    #[test]
    fn what_cannot_be_taken_apart_is_refused() {
        assert!(pieces("${a").is_err());
        assert!(pieces("${}").is_err());
        assert!(pieces("${a b}").is_err());
    }
}

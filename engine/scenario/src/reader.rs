//! Reads values out of a document and collects what is wrong with them.

use crate::angle::{degrees_key, radians_key};
use crate::document::{Key, Node, Value};
use crate::mistake::{At, Mistake, Place};
use crate::scene::Range;
use sfg_tree::nearest;
use std::collections::BTreeMap;

/// Collects mistakes. Every method reports once and returns nothing when a value cannot be used.
#[derive(Default)]
pub(crate) struct Reader {
    pub(crate) mistakes: Vec<Mistake>,
}

/// The entries of a map with known keys.
pub(crate) struct Fields<'d> {
    pub(crate) entries: Vec<(&'d Key, &'d Node)>,
    pub(crate) place: Place,
}

impl<'d> Fields<'d> {
    pub(crate) fn get(&self, key: &str) -> Option<&'d Node> {
        self.entries.iter().find(|(name, _)| name.text == key).map(|(_, node)| *node)
    }

    pub(crate) fn key_place(&self, key: &str) -> Option<Place> {
        self.entries.iter().find(|(name, _)| name.text == key).map(|(name, _)| name.place)
    }
}

impl Reader {
    pub(crate) fn report(&mut self, place: Place, message: impl Into<String>) {
        self.mistakes.push(Mistake::new(place, message));
    }

    pub(crate) fn report_with_help(&mut self, place: Place, message: impl Into<String>, help: impl Into<String>) {
        self.mistakes.push(Mistake::new(place, message).help(help));
    }

    pub(crate) fn warn_with_help(&mut self, place: Place, message: impl Into<String>, help: impl Into<String>) {
        self.mistakes.push(Mistake::warning(place, message).help(help));
    }

    /// "expected ..., found ...".
    pub(crate) fn wrong<T>(&mut self, what: &str, node: &Node, expected: &str) -> Option<T> {
        if matches!(node.value, Value::Unknown) {
            return None;
        }
        self.report(node.place, format!("{what}: expected {expected}, found {}", node.found()));
        None
    }

    /// The entries of a map, free of duplicates.
    pub(crate) fn entries<'d>(&mut self, what: &str, node: &'d Node) -> Option<Vec<(&'d Key, &'d Node)>> {
        let Value::Map(entries) = &node.value else { return self.wrong(what, node, "a map") };
        let mut lines: BTreeMap<&str, u32> = BTreeMap::new();
        let mut unique: Vec<(&Key, &Node)> = Vec::with_capacity(entries.len());
        for (key, value) in entries {
            if let Some(line) = lines.get(key.text.as_str()) {
                self.report_with_help(
                    key.place,
                    format!("key {:?} is given twice", key.text),
                    format!("it is first given in line {line}"),
                );
            } else {
                lines.insert(&key.text, key.place.line);
                unique.push((key, value));
            }
        }
        Some(unique)
    }

    /// The entries of a map whose keys must be among `known`; those that end in `_rad` may be given in degrees.
    pub(crate) fn fields<'d>(&mut self, what: &str, node: &'d Node, known: &[&str]) -> Option<Fields<'d>> {
        let mut entries = self.entries(what, node)?;
        let is_known = |name: &str| known.contains(&name);
        entries.retain(|(key, _)| {
            let is_fine = is_known(&key.text) || radians_key(&key.text, is_known).is_some();
            if !is_fine {
                let in_degrees: Vec<String> = known.iter().filter_map(|name| degrees_key(name)).collect();
                let help = match nearest(&key.text, known.iter().copied().chain(in_degrees.iter().map(String::as_str))) {
                    Some(near) => format!("did you mean {near:?}?"),
                    None => format!("known here are {}", known.join(", ")),
                };
                self.report_with_help(key.place, format!("{what} has no key {:?}", key.text), help);
            }
            is_fine
        });
        for (key, _) in &entries {
            if let Some(radians) = radians_key(&key.text, is_known)
                && entries.iter().any(|(other, _)| other.text == radians)
            {
                self.angle_given_twice(key, &radians);
            }
        }
        let place = entries.first().map_or(node.place, |(key, _)| key.place);
        Some(Fields { entries, place })
    }

    /// `name:` is taken as `name`, but something was probably to follow.
    pub(crate) fn nothing_after(&mut self, key: &Key) {
        let message = format!("nothing follows {:?} and its colon", key.text);
        self.warn_with_help(key.place, message, format!("write `{}` alone, or indent what belongs to it", key.text));
    }

    pub(crate) fn angle_given_twice(&mut self, degrees: &Key, radians: &str) {
        let message = format!("{:?} and {radians:?} are one angle, given twice", degrees.text);
        self.report_with_help(degrees.place, message, "remove one of the two");
    }

    /// The only entry of a map, as in `name: {...}`.
    pub(crate) fn only<'d>(&mut self, what: &str, node: &'d Node, expected: &str, help: &str) -> Option<(&'d Key, &'d Node)> {
        let Value::Map(entries) = &node.value else { return self.wrong(what, node, expected) };
        let [(key, body), rest @ ..] = entries.as_slice() else { return self.wrong(what, node, expected) };
        if let Some((extra, _)) = rest.first() {
            let message = format!("{what}: expected one name, found {:?} beside {:?}", extra.text, key.text);
            self.report_with_help(extra.place, message, help);
        }
        Some((key, body))
    }

    pub(crate) fn required<'d>(&mut self, what: &str, fields: &Fields<'d>, key: &str) -> Option<&'d Node> {
        let node = fields.get(key);
        if node.is_none() {
            self.report(fields.place, format!("{what} needs key {key:?}"));
        }
        node
    }

    pub(crate) fn list<'d>(&mut self, what: &str, node: &'d Node) -> Option<&'d [Node]> {
        match &node.value {
            Value::List(items) => Some(items),
            _ => self.wrong(what, node, "a list"),
        }
    }

    pub(crate) fn text(&mut self, what: &str, node: &Node) -> Option<At<String>> {
        match &node.value {
            Value::Text(text) => Some(At { value: text.clone(), place: node.place }),
            _ => self.wrong(what, node, "a text"),
        }
    }

    /// A name among `known`; any name when that is empty.
    pub(crate) fn word(&mut self, what: &str, node: &Node, known: &[String]) -> Option<At<String>> {
        let word = self.text(what, node)?;
        self.known(what, &word.value, word.place, known).then_some(word)
    }

    pub(crate) fn known(&mut self, what: &str, word: &str, place: Place, known: &[String]) -> bool {
        let is_known = known.is_empty() || known.iter().any(|name| name == word);
        if !is_known {
            let help = match nearest(word, known.iter().map(String::as_str)) {
                Some(near) => format!("did you mean {near:?}?"),
                None => format!("known are {}", known.join(", ")),
            };
            self.report_with_help(place, format!("unknown {what} {word:?}"), help);
        }
        is_known
    }

    /// A finite number, both limits included.
    pub(crate) fn number(&mut self, what: &str, node: &Node, min: f64, max: f64) -> Option<f64> {
        #[expect(clippy::cast_precision_loss, reason = "any number too large to be exact is out of limits")]
        let number = match node.value {
            Value::Int(value) => value as f64,
            Value::Float(value) => value,
            _ => return self.wrong(what, node, "a number"),
        };
        if (min..=max).contains(&number) {
            Some(number)
        } else {
            self.wrong(what, node, &format!("a number from {min} to {max}"))
        }
    }

    /// A whole number, both limits included.
    pub(crate) fn count(&mut self, what: &str, node: &Node, min: u32, max: u32) -> Option<u32> {
        let number = match node.value {
            Value::Int(value) => u32::try_from(value).ok().filter(|number| (min..=max).contains(number)),
            _ => None,
        };
        if number.is_none() {
            return self.wrong(what, node, &format!("a whole number from {min} to {max}"));
        }
        number
    }

    /// A number, or `[min, max]` to draw from.
    pub(crate) fn range(&mut self, what: &str, node: &Node, min: f64, max: f64) -> Option<Range> {
        let Value::List(items) = &node.value else {
            if matches!(node.value, Value::Int(_) | Value::Float(_)) {
                return self.number(what, node, min, max).map(Range::fixed);
            }
            return self.wrong(what, node, "a number or [min, max]");
        };
        let [first, last] = items.as_slice() else {
            return self.wrong(what, node, "a number or [min, max]");
        };
        let (first_value, last_value) = (self.number(what, first, min, max), self.number(what, last, min, max));
        let range = Range { min: first_value?, max: last_value? };
        if range.min > range.max {
            self.report(node.place, format!("{what}: the range ends at {} before it begins at {}", range.max, range.min));
            return None;
        }
        Some(range)
    }

    /// [`Self::range`] of an optional key, or `default`.
    pub(crate) fn range_or(&mut self, fields: &Fields<'_>, key: &str, limits: (f64, f64), default: Range) -> Range {
        let node = fields.get(key);
        node.and_then(|node| self.range(key, node, limits.0, limits.1)).unwrap_or(default)
    }
}

//! Angles: a key that ends in `_rad` can be given in degrees under the same name with `_deg`.

use crate::document::{Node, Value};
use crate::reader::{Fields, Reader};
use crate::scene::Range;

/// The key in radians that `written` gives in degrees, if `is_known` has one and `written` is no key of its own.
pub(crate) fn radians_key(written: &str, is_known: impl Fn(&str) -> bool) -> Option<String> {
    let key = format!("{}_rad", written.strip_suffix("_deg")?);
    (!is_known(written) && is_known(&key)).then_some(key)
}

/// The key in degrees that stands for `key`, if that is an angle.
pub(crate) fn degrees_key(key: &str) -> Option<String> {
    key.strip_suffix("_rad").map(|name| format!("{name}_deg"))
}

/// An angle as it was written.
pub(crate) struct Angle<'d> {
    pub(crate) key: &'d str,
    pub(crate) node: &'d Node,
    pub(crate) is_in_degrees: bool,
}

impl Angle<'_> {
    /// A full turn in the unit that was used.
    pub(crate) fn full_turn(&self) -> f64 {
        if self.is_in_degrees { 360.0 } else { std::f64::consts::TAU }
    }

    pub(crate) fn unit(&self) -> &'static str {
        if self.is_in_degrees { "degrees" } else { "radians" }
    }

    pub(crate) fn to_radians(&self, range: Range) -> Range {
        if self.is_in_degrees { Range { min: range.min.to_radians(), max: range.max.to_radians() } } else { range }
    }
}

impl<'d> Fields<'d> {
    /// The angle `key`, which ends in `_rad`, in either unit.
    pub(crate) fn angle(&self, key: &str) -> Option<Angle<'d>> {
        let mut entries = self.entries.iter();
        let (written, node) = entries.find(|(name, _)| name.text == key || degrees_key(key).as_ref() == Some(&name.text))?;
        Some(Angle { key: &written.text, node, is_in_degrees: written.text != key })
    }
}

impl Reader {
    /// `node` with every number converted from degrees.
    pub(crate) fn radians(&mut self, what: &str, node: &Node) -> Option<Node> {
        #[expect(clippy::cast_precision_loss, reason = "no angle is that large")]
        let value = match &node.value {
            Value::Int(degrees) => Value::Float((*degrees as f64).to_radians()),
            Value::Float(degrees) => Value::Float(degrees.to_radians()),
            Value::List(items) => {
                let items: Vec<_> = items.iter().map(|item| self.radians(what, item)).collect();
                Value::List(items.into_iter().collect::<Option<_>>()?)
            }
            Value::Text(text) if text.starts_with('{') => {
                let radians = format!("{}_rad", what.trim_end_matches("_deg"));
                self.report_with_help(
                    node.place,
                    format!("{what}: a blackboard key cannot be converted from degrees"),
                    format!("give it as {radians:?}"),
                );
                return None;
            }
            _ => return self.wrong(what, node, "degrees: a number or a list of numbers"),
        };
        Some(node.with(value))
    }
}

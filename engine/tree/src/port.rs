//! Ports: the typed inputs and outputs of a node.

use crate::literal::{FromLiteral, Literal, Shape};
use std::any::{Any, TypeId};
use std::borrow::Cow;
use std::fmt;
use std::sync::Arc;

/// A shared value of any type.
pub(crate) type Value = Arc<dyn Any + Send + Sync>;
type Convert = Arc<dyn Fn(&Literal) -> Result<Value, String> + Send + Sync>;
type ToLiteral = fn(&(dyn Any + Send + Sync)) -> Option<Literal>;

/// The type of ports that take every value.
struct AnyValue;

/// Which way a value goes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
    /// The node reads it.
    In,
    /// The node writes it.
    Out,
    /// The node reads it, then writes it.
    InOut,
}

impl Direction {
    /// Whether the node reads the port.
    #[must_use]
    pub fn reads(self) -> bool {
        self != Self::Out
    }

    /// Whether the node writes the port.
    #[must_use]
    pub fn writes(self) -> bool {
        self != Self::In
    }
}

/// The Rust type of a port.
#[derive(Clone)]
pub struct PortType {
    pub(crate) id: TypeId,
    pub(crate) name: String,
    pub(crate) shape: Option<Shape>,
    pub(crate) convert: Option<Convert>,
    pub(crate) to_literal: Option<ToLiteral>,
}

impl PortType {
    /// A type that only other nodes or the application can provide.
    #[must_use]
    pub fn shared<T: Any + Send + Sync>() -> Self {
        Self { id: TypeId::of::<T>(), name: short_type_name::<T>(), shape: None, convert: None, to_literal: None }
    }

    /// Every type: the node takes the value as it is. A literal stays a [`Literal`].
    #[must_use]
    pub fn any() -> Self {
        let mut any = Self::shared::<AnyValue>().with_literal(Shape::Any, |literal| Ok(literal.clone()));
        any.name = "any".to_owned();
        any
    }

    /// Whether this is [`PortType::any`].
    #[must_use]
    pub fn is_any(&self) -> bool {
        self.id == TypeId::of::<AnyValue>()
    }

    /// A type that a file can give as a literal.
    #[must_use]
    pub fn literal<T: FromLiteral + Any + Send + Sync>() -> Self {
        let mut port_type = Self::shared::<T>().with_literal(T::shape(), T::from_literal);
        port_type.to_literal = Some(|value| value.downcast_ref::<T>()?.to_literal());
        port_type
    }

    fn with_literal<T: Any + Send + Sync>(
        mut self,
        shape: Shape,
        convert: impl Fn(&Literal) -> Result<T, String> + Send + Sync + 'static,
    ) -> Self {
        self.shape = Some(shape);
        self.convert = Some(Arc::new(move |literal| convert(literal).map(|value| Arc::new(value) as Value)));
        self
    }

    /// The short name: `Vec<PalmPoseCandidate>`.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// What a literal looks like, or nothing when a file cannot give one.
    #[must_use]
    pub fn shape(&self) -> Option<&Shape> {
        self.shape.as_ref()
    }
}

impl fmt::Debug for PortType {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.name)
    }
}

/// One port of a node kind.
///
/// | made with | a file may give | when it gives nothing |
/// |---|---|---|
/// | [`input`](Self::input), [`output`](Self::output), [`inout`](Self::inout) | `"{key}"` | the key that has the port's name |
/// | [`setting`](Self::setting), [`setting_with`](Self::setting_with) | a literal or `"{key}"` | [`default_value`](Self::default_value), or a mistake |
#[derive(Clone, Debug)]
pub struct PortSpec {
    pub(crate) name: Cow<'static, str>,
    pub(crate) direction: Direction,
    pub(crate) port_type: PortType,
    pub(crate) default_key: Option<Cow<'static, str>>,
    pub(crate) default: Option<Literal>,
    pub(crate) range: Option<(f64, f64)>,
    pub(crate) required: bool,
    pub(crate) doc: Cow<'static, str>,
}

impl PortSpec {
    fn new(name: impl Into<Cow<'static, str>>, direction: Direction, port_type: PortType) -> Self {
        let name = name.into();
        let (default_key, default, range, doc) = (None, None, None, Cow::Borrowed(""));
        Self { name, direction, port_type, default_key, default, range, required: true, doc }
    }

    /// An artefact that the node reads; its key has the port's name unless the file says otherwise.
    pub fn input<T: Any + Send + Sync>(name: impl Into<Cow<'static, str>>) -> Self {
        Self::new(name, Direction::In, PortType::shared::<T>()).keyed()
    }

    /// An artefact that the node writes; its key has the port's name unless the file says otherwise.
    pub fn output<T: Any + Send + Sync>(name: impl Into<Cow<'static, str>>) -> Self {
        Self::new(name, Direction::Out, PortType::shared::<T>()).keyed()
    }

    /// An artefact that the node reads and writes; its key has the port's name unless the file says otherwise.
    pub fn inout<T: Any + Send + Sync>(name: impl Into<Cow<'static, str>>) -> Self {
        Self::new(name, Direction::InOut, PortType::shared::<T>()).keyed()
    }

    /// A parameter: a literal in the file, or a key.
    pub fn setting<T: FromLiteral + Any + Send + Sync>(name: impl Into<Cow<'static, str>>) -> Self {
        Self::new(name, Direction::In, PortType::literal::<T>())
    }

    /// A parameter of a type that has no [`FromLiteral`] of its own: `convert` makes the value from a literal of `shape`.
    pub fn setting_with<T: Any + Send + Sync>(
        name: impl Into<Cow<'static, str>>,
        shape: Shape,
        convert: impl Fn(&Literal) -> Result<T, String> + Send + Sync + 'static,
    ) -> Self {
        Self::new(name, Direction::In, PortType::shared::<T>().with_literal(shape, convert))
    }

    /// A parameter of any type: the node takes a literal or a value as it is.
    pub fn any_setting(name: impl Into<Cow<'static, str>>) -> Self {
        Self::new(name, Direction::In, PortType::any())
    }

    /// A key of any type, read or written as `direction` says. The file must name it.
    pub fn any_key(name: impl Into<Cow<'static, str>>, direction: Direction) -> Self {
        Self::new(name, direction, PortType { convert: None, shape: None, ..PortType::any() })
    }

    fn keyed(mut self) -> Self {
        self.default_key = Some(self.name.clone());
        self
    }

    /// The key used when the file says nothing.
    #[must_use]
    pub fn default_key(mut self, key: impl Into<Cow<'static, str>>) -> Self {
        self.default_key = Some(key.into());
        self
    }

    /// The value used when the file says nothing.
    #[must_use]
    pub fn default_value(mut self, value: impl Into<Literal>) -> Self {
        self.default = Some(value.into());
        self
    }

    /// Nobody has to provide a value: [`crate::Tick::optional`] reads it.
    #[must_use]
    pub fn optional(mut self) -> Self {
        self.required = false;
        self
    }

    /// Limits, both included, for a number given as a literal.
    #[must_use]
    pub fn range(mut self, min: f64, max: f64) -> Self {
        self.range = Some((min, max));
        self
    }

    /// One sentence for the reader of a scenario.
    #[must_use]
    pub fn doc(mut self, doc: impl Into<Cow<'static, str>>) -> Self {
        self.doc = doc.into();
        self
    }

    /// Name in the file.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Which way the value goes.
    #[must_use]
    pub fn direction(&self) -> Direction {
        self.direction
    }

    /// Type of the value.
    #[must_use]
    pub fn port_type(&self) -> &PortType {
        &self.port_type
    }

    /// Value used when the file says nothing.
    #[must_use]
    pub fn default_literal(&self) -> Option<&Literal> {
        self.default.as_ref()
    }

    /// Limits of a number, both included.
    #[must_use]
    pub fn limits(&self) -> Option<(f64, f64)> {
        self.range
    }

    /// Whether the file must say something.
    #[must_use]
    pub fn must_be_given(&self) -> bool {
        self.required && self.default.is_none() && self.default_key.is_none()
    }

    /// One sentence for the reader of a scenario.
    #[must_use]
    pub fn doc_text(&self) -> &str {
        &self.doc
    }

    /// The value of an untyped text, as other formats have: read as what the port takes.
    pub(crate) fn value_of_text(&self, text: &str) -> Result<Value, String> {
        match &self.port_type.shape {
            Some(shape) => self.value_of(&Literal::from_text(text, shape)),
            None => self.value_of(&Literal::Text(text.to_owned())),
        }
    }

    /// The value of `literal` for this port, or what is wrong with it.
    pub(crate) fn value_of(&self, literal: &Literal) -> Result<Value, String> {
        let Some(convert) = &self.port_type.convert else {
            return Err(format!("expected a blackboard key such as \"{{{}}}\", found {literal}", self.name));
        };
        let value = convert(literal)?;
        #[expect(clippy::cast_precision_loss, reason = "settings are far below 2^53")]
        let number = match literal {
            Literal::Int(number) => Some(*number as f64),
            Literal::Float(number) => Some(*number),
            _ => None,
        };
        match (self.range, number) {
            (Some((min, max)), Some(number)) if !(min..=max).contains(&number) => Err(out_of_range(min, max, number)),
            _ => Ok(value),
        }
    }
}

fn out_of_range(min: f64, max: f64, number: f64) -> String {
    if max.is_infinite() {
        format!("expected at least {min}, found {number}")
    } else {
        format!("expected {min} to {max}, found {number}")
    }
}

/// `alloc::vec::Vec<my_crate::Mask>` -> `Vec<Mask>`.
fn short_type_name<T>() -> String {
    let mut short = String::new();
    for part in std::any::type_name::<T>().split_inclusive(['<', '>', ',', ' ', '(', ')', '[', ']', ';', '&']) {
        short.push_str(part.rsplit("::").next().unwrap_or(part));
    }
    short
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn type_names_lose_their_modules() {
        assert_eq!(short_type_name::<Vec<std::sync::Arc<String>>>(), "Vec<Arc<String>>");
        assert_eq!(short_type_name::<[f64; 3]>(), "[f64; 3]");
        assert_eq!(short_type_name::<Option<std::path::PathBuf>>(), "Option<PathBuf>");
    }

    #[test]
    fn a_number_outside_its_range_is_refused() {
        let port = PortSpec::setting::<f64>("fraction").range(0.0, 1.0);
        assert!(port.value_of(&Literal::Float(0.5)).is_ok());
        assert_eq!(port.value_of(&Literal::Int(2)).err(), Some("expected 0 to 1, found 2".to_owned()));
    }
}

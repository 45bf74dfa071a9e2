//! Values written in a file, and how they become port values.

use std::collections::BTreeMap;
use std::fmt;

/// A value as it stands in a file.
#[derive(Clone, Debug, PartialEq)]
pub enum Literal {
    /// `true`, `false`.
    Bool(bool),
    /// A whole number.
    Int(i64),
    /// A number.
    Float(f64),
    /// A text.
    Text(String),
    /// Values in order.
    List(Vec<Literal>),
    /// Named values in the order of the file.
    Map(Vec<(String, Literal)>),
}

/// What a literal of some type looks like; for messages and for schemas of file formats.
#[derive(Clone, Debug, PartialEq)]
pub enum Shape {
    /// `true` or `false`.
    Bool,
    /// A whole number.
    Int,
    /// A finite number.
    Float,
    /// Any text.
    Text,
    /// One of these texts.
    OneOf(Vec<String>),
    /// A list of values of one shape, of a fixed length if given.
    List(Box<Shape>, Option<usize>),
    /// Any map.
    Map,
    /// Anything.
    Any,
}

impl fmt::Display for Shape {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Bool => f.write_str("true or false"),
            Self::Int => f.write_str("a whole number"),
            Self::Float => f.write_str("a number"),
            Self::Text => f.write_str("a text"),
            Self::OneOf(words) => write!(f, "one of {}", words.join(", ")),
            Self::List(item, None) => write!(f, "a list, each item {item}"),
            Self::List(item, Some(n)) => write!(f, "a list of {n}, each item {item}"),
            Self::Map => f.write_str("a map"),
            Self::Any => f.write_str("any value"),
        }
    }
}

impl fmt::Display for Literal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Bool(value) => write!(f, "{value}"),
            Self::Int(value) => write!(f, "{value}"),
            Self::Float(value) => write!(f, "{value}"),
            Self::Text(value) => write!(f, "{value:?}"),
            Self::List(items) => write!(f, "a list of {}", items.len()),
            Self::Map(items) => write!(f, "a map of {}", items.len()),
        }
    }
}

/// A type that can be given as a literal in a file.
pub trait FromLiteral: Sized {
    /// What such a literal looks like.
    fn shape() -> Shape;

    /// The value of `literal`.
    ///
    /// # Errors
    /// What was expected and what was found, as a text without a full stop.
    fn from_literal(literal: &Literal) -> Result<Self, String>;

    /// The literal that [`from_literal`](Self::from_literal) makes this value from: lets scripts read it and a saved run keep it.
    fn to_literal(&self) -> Option<Literal> {
        None
    }
}

impl Literal {
    /// An untyped text read as `shape`; what does not look like it stays a text, for the conversion to refuse.
    #[must_use]
    pub fn from_text(text: &str, shape: &Shape) -> Self {
        let trimmed = text.trim();
        match shape {
            Shape::Bool => match trimmed {
                "true" | "True" | "TRUE" | "1" => Self::Bool(true),
                "false" | "False" | "FALSE" | "0" => Self::Bool(false),
                _ => Self::Text(text.to_owned()),
            },
            Shape::Int => trimmed.parse().map_or_else(|_text| Self::Text(text.to_owned()), Self::Int),
            Shape::Float => trimmed.parse().map_or_else(|_text| Self::Text(text.to_owned()), Self::Float),
            Shape::List(item, _) => {
                Self::List(trimmed.split(';').filter(|part| !part.is_empty()).map(|part| Self::from_text(part, item)).collect())
            }
            Shape::Any => match (trimmed.parse(), trimmed.parse::<f64>()) {
                (Ok(number), _) => Self::Int(number),
                (_, Ok(number)) if number.is_finite() => Self::Float(number),
                _ => Self::Text(text.to_owned()),
            },
            Shape::Text | Shape::OneOf(_) | Shape::Map => Self::Text(text.to_owned()),
        }
    }
}

fn mismatch<T: FromLiteral>(literal: &Literal) -> String {
    format!("expected {}, found {literal}", T::shape())
}

impl FromLiteral for bool {
    fn to_literal(&self) -> Option<Literal> {
        Some(Literal::Bool(*self))
    }
    fn shape() -> Shape {
        Shape::Bool
    }
    fn from_literal(literal: &Literal) -> Result<Self, String> {
        match literal {
            Literal::Bool(value) => Ok(*value),
            _ => Err(mismatch::<Self>(literal)),
        }
    }
}

macro_rules! integers {
    ($($integer:ty),*) => { $(
        impl FromLiteral for $integer {
            fn to_literal(&self) -> Option<Literal> {
                i64::try_from(*self).ok().map(Literal::Int)
            }
            fn shape() -> Shape {
                Shape::Int
            }
            fn from_literal(literal: &Literal) -> Result<Self, String> {
                match literal {
                    Literal::Int(value) => Self::try_from(*value).map_err(|_overflow| {
                        format!("expected a whole number from {} to {}, found {value}", Self::MIN, Self::MAX)
                    }),
                    _ => Err(mismatch::<Self>(literal)),
                }
            }
        }
    )* };
}
integers!(i32, i64, u8, u32, u64, usize);

impl FromLiteral for f64 {
    fn to_literal(&self) -> Option<Literal> {
        Some(Literal::Float(*self))
    }
    fn shape() -> Shape {
        Shape::Float
    }
    fn from_literal(literal: &Literal) -> Result<Self, String> {
        match literal {
            Literal::Float(value) if value.is_finite() => Ok(*value),
            Literal::Float(value) => Err(format!("expected a finite number, found {value}")),
            #[expect(clippy::cast_precision_loss, reason = "settings are far below 2^53")]
            Literal::Int(value) => Ok(*value as Self),
            _ => Err(mismatch::<Self>(literal)),
        }
    }
}

impl FromLiteral for String {
    fn to_literal(&self) -> Option<Literal> {
        Some(Literal::Text(self.clone()))
    }
    fn shape() -> Shape {
        Shape::Text
    }
    fn from_literal(literal: &Literal) -> Result<Self, String> {
        match literal {
            Literal::Text(value) => Ok(value.clone()),
            _ => Err(mismatch::<Self>(literal)),
        }
    }
}

impl FromLiteral for Literal {
    fn to_literal(&self) -> Option<Literal> {
        Some(self.clone())
    }
    fn shape() -> Shape {
        Shape::Any
    }
    fn from_literal(literal: &Literal) -> Result<Self, String> {
        Ok(literal.clone())
    }
}

impl<T: FromLiteral> FromLiteral for Vec<T> {
    fn to_literal(&self) -> Option<Literal> {
        Some(Literal::List(self.iter().map(T::to_literal).collect::<Option<_>>()?))
    }
    fn shape() -> Shape {
        Shape::List(Box::new(T::shape()), None)
    }
    fn from_literal(literal: &Literal) -> Result<Self, String> {
        match literal {
            Literal::List(items) => items.iter().map(T::from_literal).collect(),
            _ => Err(mismatch::<Self>(literal)),
        }
    }
}

impl<T: FromLiteral, const N: usize> FromLiteral for [T; N] {
    fn to_literal(&self) -> Option<Literal> {
        Some(Literal::List(self.iter().map(T::to_literal).collect::<Option<_>>()?))
    }
    fn shape() -> Shape {
        Shape::List(Box::new(T::shape()), Some(N))
    }
    fn from_literal(literal: &Literal) -> Result<Self, String> {
        let items = Vec::<T>::from_literal(literal).map_err(|message| match literal {
            Literal::List(_) => message,
            _ => mismatch::<Self>(literal),
        })?;
        let n_found = items.len();
        items.try_into().map_err(|_items| format!("expected a list of {N}, found a list of {n_found}"))
    }
}

impl<T: FromLiteral> FromLiteral for BTreeMap<String, T> {
    fn to_literal(&self) -> Option<Literal> {
        Some(Literal::Map(self.iter().map(|(key, value)| Some((key.clone(), value.to_literal()?))).collect::<Option<_>>()?))
    }
    fn shape() -> Shape {
        Shape::Map
    }
    fn from_literal(literal: &Literal) -> Result<Self, String> {
        match literal {
            Literal::Map(items) => items.iter().map(|(key, value)| Ok((key.clone(), T::from_literal(value)?))).collect(),
            _ => Err(mismatch::<Self>(literal)),
        }
    }
}

macro_rules! into_literal {
    ($($source:ty => $make:expr;)*) => { $(
        impl From<$source> for Literal {
            fn from(value: $source) -> Self {
                ($make)(value)
            }
        }
    )* };
}
into_literal! {
    bool => Literal::Bool;
    i64 => Literal::Int;
    i32 => |value| Literal::Int(i64::from(value));
    u32 => |value| Literal::Int(i64::from(value));
    f64 => Literal::Float;
    &str => |value: &str| Literal::Text(value.to_owned());
    String => Literal::Text;
}

impl<T: Into<Literal>> From<Vec<T>> for Literal {
    fn from(items: Vec<T>) -> Self {
        Self::List(items.into_iter().map(Into::into).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_whole_number_is_a_number_but_not_the_reverse() {
        assert_eq!(f64::from_literal(&Literal::Int(3)), Ok(3.0));
        assert_eq!(i64::from_literal(&Literal::Float(3.0)), Err("expected a whole number, found 3".to_owned()));
    }

    #[test]
    fn not_a_number_is_refused() {
        assert_eq!(f64::from_literal(&Literal::Float(f64::NAN)), Err("expected a finite number, found NaN".to_owned()));
        assert!(u8::from_literal(&Literal::Int(-1)).is_err());
    }

    #[test]
    fn arrays_have_their_length() {
        let three = Literal::from(vec![1.0, 2.0, 3.0]);
        assert_eq!(<[f64; 3]>::from_literal(&three), Ok([1.0, 2.0, 3.0]));
        assert_eq!(<[f64; 2]>::from_literal(&three), Err("expected a list of 2, found a list of 3".to_owned()));
    }
}

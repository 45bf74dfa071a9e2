//! Attribute texts to port values and back.

use super::problem::XmlFault;
use crate::literal::Literal;
use crate::spec::PortValue;

/// How a port is written in XML.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    /// 32 bits.
    Int,
    Float,
    Bool,
    Text,
    /// Whole milliseconds there, seconds here.
    Millis,
    /// `SUCCESS` there, `success` here.
    Result,
    /// Always a key.
    Key,
    /// Always a key, with or without braces.
    Entry,
    /// Always a key; BehaviorTree.CPP wants it without braces.
    BareKey,
    /// Constants separated by semicolons.
    Items(Item),
    /// A port of the application: a text, whatever it means.
    Application,
    /// A port of a subtree: a number if it looks like one, as BehaviorTree.CPP has it.
    Subtree,
}

/// Of which type the constants of a loop are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Item {
    Bool,
    Float,
    Int,
    Text,
}

const RESULTS: [(&str, &str); 4] =
    [("FAILURE", "failure"), ("SUCCESS", "success"), ("SKIPPED", "skipped"), ("RUNNING", "running")];
const NO_MILLIS_KEY: &str = "the entry would hold milliseconds there and seconds here";
const NO_RESULT_KEY: &str = "the entry would hold a NodeStatus, which is a text here";

/// The value that `text` gives to the port that BehaviorTree.CPP calls `port`.
///
/// # Errors
/// [`XmlFault::BadKey`], [`XmlFault::KeyHere`] or [`XmlFault::BadValue`].
pub(super) fn read(kind: Kind, port: &str, text: &str) -> Result<PortValue, XmlFault> {
    if let Some(key) = key_of(kind, port, text)? {
        return match kind {
            Kind::Millis => Err(XmlFault::KeyHere { message: NO_MILLIS_KEY }),
            Kind::Result => Err(XmlFault::KeyHere { message: NO_RESULT_KEY }),
            _ => Ok(PortValue::Key(key)),
        };
    }
    let literal = match kind {
        Kind::Application | Kind::Text => Literal::Text(text.to_owned()),
        Kind::Subtree => number(text).unwrap_or_else(|| Literal::Text(text.to_owned())),
        Kind::Int => scalar(Item::Int, text)?,
        Kind::Float => scalar(Item::Float, text)?,
        Kind::Bool => scalar(Item::Bool, text)?,
        Kind::Millis => match text.parse::<u32>() {
            Ok(millis) => Literal::Float(f64::from(millis) / 1000.0),
            Err(_no_number) => return Err(bad_value("whole milliseconds from 0 to 4294967295")),
        },
        Kind::Result => match RESULTS.iter().find(|(theirs, _)| *theirs == text) {
            Some((_, ours)) => Literal::Text((*ours).to_owned()),
            None => return Err(bad_value("one of FAILURE, SUCCESS, SKIPPED, RUNNING")),
        },
        Kind::Items(_) if text.is_empty() => Literal::List(Vec::new()),
        Kind::Items(item) => Literal::List(text.split(';').map(|part| scalar(item, part)).collect::<Result<_, _>>()?),
        Kind::Key => return Err(bad_value("a blackboard key such as \"{key}\"")),
        Kind::Entry | Kind::BareKey => return key(&format!("{{{text}}}")).map(PortValue::Key),
    };
    Ok(PortValue::Literal(literal))
}

/// The text that gives `value` to the port that BehaviorTree.CPP calls `port`; it reads back as the same value.
///
/// # Errors
/// What BehaviorTree.CPP lacks.
pub(super) fn write(kind: Kind, port: &str, value: &PortValue) -> Result<String, &'static str> {
    let text = match value {
        PortValue::Key(key) if key.contains('.') => return Err("fields of blackboard entries"),
        PortValue::Key(key) if kind == Kind::BareKey => key.clone(),
        PortValue::Key(key) => format!("{{{key}}}"),
        PortValue::Literal(literal) => write_literal(kind, literal)?,
    };
    match read(kind, port, &text) {
        Ok(back) if kind == Kind::Application || is_same(&back, value) => match (&back, value) {
            (PortValue::Key(_), PortValue::Literal(_)) => Err("way to write this text as a constant"),
            _ => Ok(text),
        },
        Err(XmlFault::KeyHere { .. }) => Err("key for this port that means the same"),
        _ => Err("way to write this value for this port"),
    }
}

/// The text of a constant of the application, if there is one.
pub(super) fn write_literal(kind: Kind, literal: &Literal) -> Result<String, &'static str> {
    Ok(match (kind, literal) {
        (Kind::Text | Kind::Result | Kind::Items(_) | Kind::Key | Kind::Entry | Kind::BareKey, Literal::Text(text)) => {
            let result = RESULTS.iter().find(|(_, ours)| kind == Kind::Result && *ours == text);
            result.map_or_else(|| text.clone(), |(theirs, _)| (*theirs).to_owned())
        }
        (Kind::Text, _) => return Err("way to write this constant other than as a text"),
        (Kind::Millis, Literal::Int(secs)) => secs.saturating_mul(1000).to_string(),
        (Kind::Millis, Literal::Float(secs)) => (secs * 1000.0).round().to_string(),
        (Kind::Subtree, Literal::Bool(_)) => return Err("true and false for ports of subtrees"),
        (Kind::Items(_) | Kind::Application, Literal::List(items)) => {
            if kind == Kind::Application && items.is_empty() {
                return Err("empty lists");
            }
            let parts: Vec<String> = items.iter().map(write_item).collect::<Result<_, _>>()?;
            parts.join(";")
        }
        (_, Literal::Text(text)) => text.clone(),
        (_, Literal::Int(number)) => number.to_string(),
        (_, Literal::Float(number)) if number.is_finite() => format!("{number:?}"),
        (_, Literal::Float(_)) => return Err("numbers that are not finite"),
        (_, Literal::Bool(value)) => value.to_string(),
        (_, Literal::List(_)) => return Err("lists for this port"),
        (_, Literal::Map(_)) => return Err("maps"),
    })
}

fn write_item(item: &Literal) -> Result<String, &'static str> {
    match item {
        Literal::List(_) => Err("lists of lists"),
        Literal::Text(text) if text.contains(';') => Err("lists of texts with a semicolon"),
        item => write_literal(Kind::Application, item),
    }
}

/// The key in `text`, or nothing when it is a constant.
fn key_of(kind: Kind, port: &str, text: &str) -> Result<Option<String>, XmlFault> {
    // BehaviorTree.CPP takes the bare `=` only where a node reads the port itself.
    if text == "{=}" || (text == "=" && kind != Kind::Subtree) {
        return key(&format!("{{{port}}}")).map(Some);
    }
    let trimmed = text.trim();
    if trimmed.len() >= 2 && trimmed.starts_with('{') && trimmed.ends_with('}') { key(text).map(Some) } else { Ok(None) }
}

fn key(text: &str) -> Result<String, XmlFault> {
    match PortValue::from_text(text) {
        Ok(PortValue::Key(key)) if key.contains('.') => {
            Err(XmlFault::BadKey { message: "a dot in a key means a field of an entry here".to_owned() })
        }
        Ok(PortValue::Key(key)) => Ok(key),
        Ok(PortValue::Literal(_)) => Err(bad_value("a blackboard key such as \"{key}\"")),
        Err(message) => Err(XmlFault::BadKey { message }),
    }
}

fn scalar(item: Item, text: &str) -> Result<Literal, XmlFault> {
    match item {
        Item::Int => match text.trim().parse::<i32>() {
            Ok(number) => Ok(Literal::Int(i64::from(number))),
            Err(_no_number) => Err(bad_value("a whole number of 32 bits")),
        },
        Item::Float => match text.trim().parse::<f64>() {
            Ok(number) if number.is_finite() => Ok(Literal::Float(number)),
            _ => Err(bad_value("a finite number")),
        },
        Item::Bool => match text {
            "true" | "True" | "TRUE" | "1" => Ok(Literal::Bool(true)),
            "false" | "False" | "FALSE" | "0" => Ok(Literal::Bool(false)),
            _ => Err(bad_value("true or false")),
        },
        Item::Text => Ok(Literal::Text(text.to_owned())),
    }
}

/// The number that BehaviorTree.CPP makes of a constant given to a subtree.
fn number(text: &str) -> Option<Literal> {
    if !text.starts_with(|first: char| first.is_ascii_digit() || matches!(first, '-' | '.')) {
        return None;
    }
    if !text.contains(['.', 'e', 'E']) {
        return text.parse().ok().map(Literal::Int);
    }
    text.parse().ok().filter(|number: &f64| number.is_finite()).map(Literal::Float)
}

/// Equal, or the same number.
fn is_same(a: &PortValue, b: &PortValue) -> bool {
    fn literals(a: &Literal, b: &Literal) -> bool {
        match (a, b) {
            #[expect(clippy::cast_precision_loss, clippy::float_cmp, reason = "a number that is not exact is not the same")]
            (Literal::Int(int), Literal::Float(float)) | (Literal::Float(float), Literal::Int(int)) => *int as f64 == *float,
            (Literal::List(a), Literal::List(b)) => a.len() == b.len() && a.iter().zip(b).all(|(a, b)| literals(a, b)),
            _ => a == b,
        }
    }
    match (a, b) {
        (PortValue::Literal(a), PortValue::Literal(b)) => literals(a, b),
        _ => a == b,
    }
}

fn bad_value(expected: &str) -> XmlFault {
    XmlFault::BadValue { expected: expected.to_owned() }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "tests fail by panicking")]
    use super::*;

    #[track_caller]
    fn check(kind: Kind, text: &str, literal: impl Into<Literal>) {
        let value = PortValue::Literal(literal.into());
        assert_eq!(read(kind, "port", text), Ok(value.clone()));
        assert_eq!(write(kind, "port", &value).as_deref(), Ok(text));
    }

    #[track_caller]
    fn check_key(kind: Kind, text: &str, key: &str) {
        assert_eq!(read(kind, "port", text), Ok(PortValue::Key(key.to_owned())));
    }

    #[track_caller]
    fn refuses(kind: Kind, text: &str) {
        assert!(read(kind, "port", text).is_err(), "{text:?} was read");
    }

    #[track_caller]
    fn loses(kind: Kind, literal: impl Into<Literal>, what: &str) {
        assert_eq!(write(kind, "port", &PortValue::Literal(literal.into())), Err(what));
    }

    #[test]
    fn constants_both_ways() {
        check(Kind::Int, "-1", -1);
        check(Kind::Float, "0.5", 0.5);
        check(Kind::Bool, "true", true);
        check(Kind::Millis, "1500", 1.5);
        check(Kind::Millis, "1", 0.001);
        check(Kind::Result, "SKIPPED", "skipped");
        check(Kind::Items(Item::Int), "1;2", vec![1, 2]);
        check(Kind::Items(Item::Text), "a;;b", vec!["a", "", "b"]);
        check(Kind::Items(Item::Float), "", Vec::<f64>::new());
        check(Kind::Application, "3", "3");
        check(Kind::Subtree, "3", 3);
        check(Kind::Subtree, "3.0", 3.0);
        check(Kind::Subtree, "1;2", "1;2");
        check(Kind::Subtree, "=", "=");
    }

    #[test]
    fn keys() {
        check_key(Kind::Application, "{cup}", "cup");
        check_key(Kind::Application, "{@cup}", "@cup");
        check_key(Kind::Application, "{=}", "port");
        check_key(Kind::Application, "=", "port");
        check_key(Kind::BareKey, "cup", "cup");
        check_key(Kind::Entry, "{cup}", "cup");
    }

    #[test]
    fn texts_that_are_no_value() {
        refuses(Kind::Int, "3.5");
        refuses(Kind::Int, "4000000000");
        refuses(Kind::Float, "inf");
        refuses(Kind::Bool, "yes");
        refuses(Kind::Millis, "1.5");
        refuses(Kind::Millis, "{wait}");
        refuses(Kind::Result, "success");
        refuses(Kind::Key, "cup");
        refuses(Kind::Application, "{cup} ");
        refuses(Kind::Application, "{arm.left}");
        refuses(Kind::BareKey, "two words");
        refuses(Kind::Items(Item::Int), "1;x");
    }

    #[test]
    fn values_that_cannot_be_written() {
        loses(Kind::Millis, 0.0001, "way to write this value for this port");
        loses(Kind::Millis, -1.0, "way to write this value for this port");
        loses(Kind::Subtree, "42", "way to write this value for this port");
        loses(Kind::Subtree, true, "true and false for ports of subtrees");
        loses(Kind::Application, "{x}", "way to write this text as a constant");
        loses(Kind::Application, "=", "way to write this text as a constant");
        loses(Kind::Application, Literal::Map(vec![]), "maps");
        loses(Kind::Application, f64::NAN, "numbers that are not finite");
        loses(Kind::Text, 3, "way to write this constant other than as a text");
        assert_eq!(write(Kind::Text, "port", &PortValue::Key("a.b".to_owned())), Err("fields of blackboard entries"));
    }
}

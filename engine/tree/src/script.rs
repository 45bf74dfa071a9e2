//! Scripts: `tries := tries + 1; done := tries >= 3`.
//!
//! The grammar of an expression is that of HCL (crate `hcl-edit`): numbers, texts, `true`, `false`, `+ - * / %`,
//! `== != < <= > >=`, `&& || !`, `a ? b : c` and parentheses. Around it: statements are separated by `;`, an assignment is
//! written `key := value` or `key = value` (also `+=`, `-=`, `*=`, `/=`), and texts may stand in single quotes.
//!
//! A name is a blackboard key, `a.b` a field of its value, `@a` a key of the root scope. All numbers are floating-point; a whole
//! number is stored where the entry is one. `true` equals 1 and `false` equals 0.

use hcl_edit::Span;
use hcl_edit::expr::{BinaryOperator, Expression, TraversalOperator, UnaryOperator};
use std::any::Any;
use std::borrow::Cow;
use std::ops::Range;

use crate::literal::Literal;

/// Longer scripts belong into a node.
const MAX_BYTES: usize = 4096;
/// The library's time for brackets that are never closed doubles with each.
const MAX_NESTING: usize = 8;

/// The value of an expression.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Scalar<'v> {
    Bool(bool),
    Number(f64),
    Text(Cow<'v, str>),
}

impl Scalar<'_> {
    pub(crate) fn into_literal(self) -> Literal {
        match self {
            Self::Bool(value) => Literal::Bool(value),
            #[expect(clippy::cast_possible_truncation, reason = "only whole numbers below 2^53 get here")]
            Self::Number(value) if value.fract() == 0.0 && value.abs() < 9.0e15 => Literal::Int(value as i64),
            Self::Number(value) => Literal::Float(value),
            Self::Text(text) => Literal::Text(text.into_owned()),
        }
    }

    fn describe(&self) -> String {
        match self {
            Self::Bool(value) => value.to_string(),
            Self::Number(value) => value.to_string(),
            Self::Text(text) => format!("{text:?}"),
        }
    }

    fn number(&self) -> Result<f64, String> {
        match self {
            Self::Number(value) => Ok(*value),
            Self::Bool(value) => Ok(f64::from(u8::from(*value))),
            Self::Text(_) => Err(format!("expected a number, found {}", self.describe())),
        }
    }

    pub(crate) fn truth(&self) -> Result<bool, String> {
        match self {
            Self::Bool(value) => Ok(*value),
            Self::Number(value) => Ok(*value != 0.0),
            Self::Text(_) => Err(format!("expected true or false, found {}", self.describe())),
        }
    }
}

/// Something is wrong with a script: where, as bytes from its beginning, and what.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct ScriptError {
    pub(crate) at: Range<usize>,
    pub(crate) message: String,
}

/// A name in a script. Its number is its place in [`Parsed::names`].
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Name {
    pub(crate) key: String,
    pub(crate) is_written: bool,
    /// Whether some statement needs a value that no earlier statement of the script gave it.
    pub(crate) is_read: bool,
}

/// A script whose names are not yet resolved.
#[derive(Clone, Debug)]
pub(crate) struct Parsed {
    pub(crate) names: Vec<Name>,
    pub(crate) statements: Vec<Statement>,
}

#[derive(Clone, Debug)]
pub(crate) struct Statement {
    /// The name that is assigned.
    pub(crate) target: Option<u32>,
    pub(crate) value: Expr,
}

#[derive(Clone, Debug)]
pub(crate) enum Expr {
    Constant(Scalar<'static>),
    Name(u32),
    Not(Box<Expr>),
    Minus(Box<Expr>),
    Binary(Operator, Box<(Expr, Expr)>),
    Choice(Box<(Expr, Expr, Expr)>),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Operator {
    Add,
    Subtract,
    Multiply,
    Divide,
    Remainder,
    Equal,
    NotEqual,
    Less,
    LessOrEqual,
    Greater,
    GreaterOrEqual,
    And,
    Or,
}

/// Gives the value of a name.
pub(crate) trait Names {
    fn value(&self, name: u32) -> Result<Scalar<'_>, String>;
}

impl Expr {
    pub(crate) fn eval<'v>(&'v self, names: &'v impl Names) -> Result<Scalar<'v>, String> {
        match self {
            Self::Constant(Scalar::Text(text)) => Ok(Scalar::Text(Cow::Borrowed(text))),
            Self::Constant(scalar) => Ok(scalar.clone()),
            Self::Name(name) => names.value(*name),
            Self::Not(value) => Ok(Scalar::Bool(!value.eval(names)?.truth()?)),
            Self::Minus(value) => Ok(Scalar::Number(-value.eval(names)?.number()?)),
            Self::Choice(parts) => {
                let (condition, yes, no) = &**parts;
                if condition.eval(names)?.truth()? { yes.eval(names) } else { no.eval(names) }
            }
            Self::Binary(Operator::And, sides) => {
                Ok(Scalar::Bool(sides.0.eval(names)?.truth()? && sides.1.eval(names)?.truth()?))
            }
            Self::Binary(Operator::Or, sides) => Ok(Scalar::Bool(sides.0.eval(names)?.truth()? || sides.1.eval(names)?.truth()?)),
            Self::Binary(operator, sides) => binary(*operator, &sides.0.eval(names)?, &sides.1.eval(names)?),
        }
    }
}

fn binary<'v>(operator: Operator, left: &Scalar<'_>, right: &Scalar<'_>) -> Result<Scalar<'v>, String> {
    if let (Scalar::Text(a), Scalar::Text(b)) = (left, right) {
        return Ok(match operator {
            Operator::Add => Scalar::Text(Cow::Owned(format!("{a}{b}"))),
            Operator::Equal => Scalar::Bool(a == b),
            Operator::NotEqual => Scalar::Bool(a != b),
            Operator::Less => Scalar::Bool(a < b),
            Operator::LessOrEqual => Scalar::Bool(a <= b),
            Operator::Greater => Scalar::Bool(a > b),
            Operator::GreaterOrEqual => Scalar::Bool(a >= b),
            _ => return Err(format!("a text cannot be calculated with, found {}", left.describe())),
        });
    }
    let (Ok(a), Ok(b)) = (left.number(), right.number()) else {
        return Err(format!("a text and a number do not go together: {} and {}", left.describe(), right.describe()));
    };
    Ok(match operator {
        Operator::Add => Scalar::Number(a + b),
        Operator::Subtract => Scalar::Number(a - b),
        Operator::Multiply => Scalar::Number(a * b),
        Operator::Divide if b == 0.0 => return Err("division by zero".to_owned()),
        Operator::Divide => Scalar::Number(a / b),
        Operator::Remainder if b == 0.0 => return Err("division by zero".to_owned()),
        Operator::Remainder => Scalar::Number(a % b),
        #[expect(clippy::float_cmp, reason = "equality is what the author asked for")]
        Operator::Equal => Scalar::Bool(a == b),
        #[expect(clippy::float_cmp, reason = "equality is what the author asked for")]
        Operator::NotEqual => Scalar::Bool(a != b),
        Operator::Less => Scalar::Bool(a < b),
        Operator::LessOrEqual => Scalar::Bool(a <= b),
        Operator::Greater => Scalar::Bool(a > b),
        Operator::GreaterOrEqual => Scalar::Bool(a >= b),
        Operator::And | Operator::Or => unreachable!("decided without looking at both sides"),
    })
}

/// The value of a blackboard entry as scripts see it, or nothing when they cannot.
pub(crate) fn scalar_of(value: &(dyn Any + Send + Sync)) -> Option<Scalar<'_>> {
    macro_rules! number {
        ($($number:ty),*) => { $(
            if let Some(number) = value.downcast_ref::<$number>() {
                #[allow(clippy::cast_precision_loss, clippy::cast_lossless, reason = "numbers in scripts are far below 2^53")]
                return Some(Scalar::Number(*number as f64));
            }
        )* };
    }
    number!(f64, i64);
    if let Some(value) = value.downcast_ref::<bool>() {
        return Some(Scalar::Bool(*value));
    }
    if let Some(text) = value.downcast_ref::<String>() {
        return Some(Scalar::Text(Cow::Borrowed(text)));
    }
    if let Some(literal) = value.downcast_ref::<Literal>() {
        return scalar_of_literal(literal);
    }
    number!(u32, i32, u64, usize, u8, f32);
    None
}

pub(crate) fn scalar_of_literal(literal: &Literal) -> Option<Scalar<'_>> {
    match literal {
        Literal::Bool(value) => Some(Scalar::Bool(*value)),
        #[expect(clippy::cast_precision_loss, reason = "numbers in scripts are far below 2^53")]
        Literal::Int(value) => Some(Scalar::Number(*value as f64)),
        Literal::Float(value) => Some(Scalar::Number(*value)),
        Literal::Text(text) => Some(Scalar::Text(Cow::Borrowed(text))),
        Literal::List(_) | Literal::Map(_) => None,
    }
}

/// Reads a script. A script that is to be a condition is one expression.
pub(crate) fn parse(text: &str, is_condition: bool) -> Result<Parsed, ScriptError> {
    let fail = |at: Range<usize>, message: &str| Err(ScriptError { at, message: message.to_owned() });
    if text.len() > MAX_BYTES {
        return fail(0..text.len(), "a script has at most 4096 letters; write a node instead");
    }
    let pieces = split(text)?;
    if pieces.is_empty() {
        return fail(0..text.len(), "the script is empty");
    }
    if is_condition && pieces.len() > 1 {
        return fail(pieces[1].clone(), "a condition is one expression");
    }
    let mut parser = Parser { names: Vec::new() };
    let mut statements = Vec::new();
    for piece in pieces {
        let statement = parser.statement(text, piece.clone())?;
        if is_condition && statement.target.is_some() {
            return fail(piece, "a condition assigns nothing; compare with `==`");
        }
        statements.push(statement);
    }
    Ok(Parsed { names: parser.names, statements })
}

/// The statements, without blanks around them.
fn split(text: &str) -> Result<Vec<Range<usize>>, ScriptError> {
    let (mut pieces, mut begin, mut quote) = (Vec::new(), 0, None);
    let mut push = |from: usize, to: usize| {
        let piece = &text[from..to];
        let trimmed = piece.trim();
        if !trimmed.is_empty() {
            let start = from + (piece.len() - piece.trim_start().len());
            pieces.push(start..start + trimmed.len());
        }
    };
    let mut is_escaped = false;
    for (at, letter) in text.char_indices() {
        match (quote, letter) {
            (Some(_), _) if is_escaped => is_escaped = false,
            (Some(_), '\\') => is_escaped = true,
            (Some(open), _) if letter == open => quote = None,
            (Some(_), _) => {}
            (None, '\'' | '"') => quote = Some(letter),
            (None, ';') => {
                push(begin, at);
                begin = at + 1;
            }
            (None, _) => {}
        }
    }
    if quote.is_some() {
        return Err(ScriptError { at: begin..text.len(), message: "a text is not closed".to_owned() });
    }
    push(begin, text.len());
    Ok(pieces)
}

struct Parser {
    names: Vec<Name>,
}

impl Parser {
    fn statement(&mut self, text: &str, piece: Range<usize>) -> Result<Statement, ScriptError> {
        let body = &text[piece.clone()];
        let is_letter = |letter: char| letter.is_ascii_alphanumeric() || letter == '_' || letter == '@' || letter == '.';
        let n_key = body.find(|letter| !is_letter(letter)).unwrap_or(body.len());
        let rest = body[n_key..].trim_start();
        let n_blank = body.len() - n_key - rest.len();
        let combined = [("+=", Operator::Add), ("-=", Operator::Subtract), ("*=", Operator::Multiply), ("/=", Operator::Divide)];
        let assignment = combined
            .iter()
            .find(|(sign, _)| rest.starts_with(sign))
            .map(|(sign, operator)| (sign.len(), Some(*operator)))
            .or_else(|| rest.starts_with(":=").then_some((2, None)))
            .or_else(|| (rest.starts_with('=') && !rest.starts_with("==")).then_some((1, None)));
        let Some((n_sign, operator)) = assignment else {
            return Ok(Statement { target: None, value: self.expression(text, piece)? });
        };
        let key = &body[..n_key];
        if !is_key(key) || key.contains('.') {
            let at = piece.start..piece.start + n_key.max(1);
            let message =
                if key.contains('.') { "a field of an entry cannot be assigned" } else { "a key to assign to is missing" };
            return Err(ScriptError { at, message: message.to_owned() });
        }
        let from = piece.start + n_key + n_blank + n_sign;
        let mut value = self.expression(text, from..piece.end)?;
        if let Some(operator) = operator {
            value = Expr::Binary(operator, Box::new((Expr::Name(self.name(key, false)), value)));
        }
        Ok(Statement { target: Some(self.name(key, true)), value })
    }

    fn name(&mut self, key: &str, is_written: bool) -> u32 {
        let known = self.names.iter().position(|name| name.key == key);
        let name_idx = known.unwrap_or_else(|| {
            self.names.push(Name { key: key.to_owned(), is_written: false, is_read: false });
            self.names.len() - 1
        });
        let name = &mut self.names[name_idx];
        if is_written {
            name.is_written = true;
        } else if !name.is_written {
            name.is_read = true;
        }
        u32::try_from(name_idx).unwrap_or(u32::MAX)
    }

    fn expression(&mut self, text: &str, piece: Range<usize>) -> Result<Expr, ScriptError> {
        let (hcl, origin) = to_hcl(text, piece.clone())?;
        let place = |span: Option<Range<usize>>| {
            let span = span.unwrap_or(0..hcl.len());
            let back = |at: usize| origin.get(at).copied().unwrap_or(piece.end);
            let start = back(span.start);
            start..back(span.end).max(start + 1)
        };
        match hcl.parse::<Expression>() {
            Ok(expression) => self.convert(&expression, &place),
            Err(error) => {
                // The library counts columns from 1 and points at the letter before the unexpected one.
                let column = error.location().column().saturating_sub(1).min(hcl.len());
                let at = place(Some(column..column + 1));
                Err(ScriptError { at, message: "no expression can be read here".to_owned() })
            }
        }
    }

    fn convert(
        &mut self,
        expression: &Expression,
        place: &impl Fn(Option<Range<usize>>) -> Range<usize>,
    ) -> Result<Expr, ScriptError> {
        let refuse =
            |what: &str| Err(ScriptError { at: place(expression.span()), message: format!("{what} cannot be used in a script") });
        match expression {
            Expression::Bool(value) => Ok(Expr::Constant(Scalar::Bool(*value.value()))),
            Expression::Number(number) => match number.value().as_f64() {
                Some(number) if number.is_finite() => Ok(Expr::Constant(Scalar::Number(number))),
                _ => refuse("a number of this size"),
            },
            Expression::String(value) => Ok(Expr::Constant(Scalar::Text(Cow::Owned(value.value().clone())))),
            Expression::Variable(name) => Ok(Expr::Name(self.name(&key_of(name.value().as_str()), false))),
            Expression::Traversal(traversal) => {
                let Expression::Variable(name) = &traversal.expr else { return refuse("a field of an expression") };
                let mut key = key_of(name.value().as_str());
                for operator in &traversal.operators {
                    let TraversalOperator::GetAttr(field) = operator.value() else { return refuse("an index") };
                    key.push('.');
                    key.push_str(field.value().as_str());
                }
                Ok(Expr::Name(self.name(&key, false)))
            }
            Expression::Parenthesis(inner) => self.convert(inner.inner(), place),
            Expression::UnaryOp(operation) => {
                let value = Box::new(self.convert(&operation.expr, place)?);
                Ok(match operation.operator.value() {
                    UnaryOperator::Not => Expr::Not(value),
                    UnaryOperator::Neg => Expr::Minus(value),
                })
            }
            Expression::BinaryOp(operation) => {
                let operator = match operation.operator.value() {
                    BinaryOperator::Eq => Operator::Equal,
                    BinaryOperator::NotEq => Operator::NotEqual,
                    BinaryOperator::LessEq => Operator::LessOrEqual,
                    BinaryOperator::GreaterEq => Operator::GreaterOrEqual,
                    BinaryOperator::Less => Operator::Less,
                    BinaryOperator::Greater => Operator::Greater,
                    BinaryOperator::Plus => Operator::Add,
                    BinaryOperator::Minus => Operator::Subtract,
                    BinaryOperator::Mul => Operator::Multiply,
                    BinaryOperator::Div => Operator::Divide,
                    BinaryOperator::Mod => Operator::Remainder,
                    BinaryOperator::And => Operator::And,
                    BinaryOperator::Or => Operator::Or,
                };
                let left = self.convert(&operation.lhs_expr, place)?;
                Ok(Expr::Binary(operator, Box::new((left, self.convert(&operation.rhs_expr, place)?))))
            }
            Expression::Conditional(choice) => {
                let condition = self.convert(&choice.cond_expr, place)?;
                let yes = self.convert(&choice.true_expr, place)?;
                Ok(Expr::Choice(Box::new((condition, yes, self.convert(&choice.false_expr, place)?))))
            }
            Expression::Null(_) => refuse("null"),
            Expression::Array(_) => refuse("a list"),
            Expression::Object(_) => refuse("a map"),
            Expression::FuncCall(_) => refuse("a function"),
            Expression::StringTemplate(_) | Expression::HeredocTemplate(_) => refuse("`${...}` in a text"),
            Expression::ForExpr(_) => refuse("a loop"),
        }
    }
}

/// Stands for `@` at the beginning of a name, which HCL has not.
const ROOT_PREFIX: &str = "__root__";

fn key_of(name: &str) -> String {
    name.strip_prefix(ROOT_PREFIX).map_or_else(|| name.to_owned(), |key| format!("@{key}"))
}

fn is_key(key: &str) -> bool {
    let key = key.strip_prefix('@').unwrap_or(key);
    key.split('.').all(|word| {
        word.starts_with(|first: char| first.is_ascii_alphabetic() || first == '_')
            && word.chars().all(|letter| letter.is_ascii_alphanumeric() || letter == '_')
    })
}

/// The expression in the letters of HCL, and for each of its bytes the byte of `text` it came from.
fn to_hcl(text: &str, piece: Range<usize>) -> Result<(String, Vec<usize>), ScriptError> {
    let (mut hcl, mut origin, mut quote) = (String::new(), Vec::new(), None);
    let mut push = |letters: &str, at: usize| {
        hcl.push_str(letters);
        origin.resize(hcl.len(), at);
    };
    let mut letters = text[piece.clone()].char_indices().map(|(at, letter)| (piece.start + at, letter)).peekable();
    let (mut before, mut is_number, mut n_open) = (' ', false, 0_usize);
    while let Some((at, letter)) = letters.next() {
        let next = letters.peek().map_or(' ', |(_, next)| *next);
        if !before.is_alphanumeric() && before != '_' && before != '.' {
            is_number = letter.is_ascii_digit();
        }
        match letter {
            '(' | '[' | '{' if quote.is_none() => n_open += 1,
            ')' | ']' | '}' if quote.is_none() => n_open = n_open.saturating_sub(1),
            _ => {}
        }
        if n_open > MAX_NESTING {
            let message = format!("brackets are nested deeper than {MAX_NESTING}");
            return Err(ScriptError { at: at..at + 1, message });
        }
        let mut buffer = [0; 4];
        let itself = letter.encode_utf8(&mut buffer);
        match (quote, letter) {
            (Some(_), '\\') => {
                if let Some((_, escaped)) = letters.next() {
                    // HCL has no escape for a quote that ends nothing.
                    push(if escaped == '\'' { "" } else { "\\" }, at);
                    push(escaped.encode_utf8(&mut buffer), at);
                }
            }
            (Some(open), _) if letter == open => {
                quote = None;
                push("\"", at);
            }
            (Some('\''), '"') => push("\\\"", at),
            (Some(_), '$' | '%') if next == '{' => {
                // `${` would begin a template.
                push(itself, at);
                push(itself, at);
            }
            (Some(_), _) => push(itself, at),
            (None, '\'' | '"') => {
                quote = Some(letter);
                push("\"", at);
            }
            // In HCL a dash may be part of a name.
            (None, '-') if !(is_number && matches!(before, 'e' | 'E')) => push(" - ", at),
            (None, '@') if next.is_ascii_alphabetic() || next == '_' => push(ROOT_PREFIX, at),
            (None, '&') if next == '&' || before == '&' => push(itself, at),
            (None, '|') if next == '|' || before == '|' => push(itself, at),
            (None, '&' | '|' | '^' | '~') => {
                let message = format!("the bit operator {letter:?} cannot be used in a script");
                return Err(ScriptError { at: at..at + 1, message });
            }
            (None, '.') if next == '.' => {
                let message = "`..` cannot be used in a script; texts are joined with `+`".to_owned();
                return Err(ScriptError { at: at..at + 2, message });
            }
            (None, '#') => return Err(ScriptError { at: at..at + 1, message: "a script has no comments".to_owned() }),
            (None, '/') if next == '/' || next == '*' => {
                return Err(ScriptError { at: at..at + 2, message: "a script has no comments".to_owned() });
            }
            (None, _) if letter.is_whitespace() => push(" ", at),
            (None, _) => push(itself, at),
        }
        before = letter;
    }
    Ok((hcl.trim_start().to_owned(), {
        let n_blank = hcl.len() - hcl.trim_start().len();
        origin.split_off(n_blank)
    }))
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "tests fail by panicking")]
    use super::*;
    use std::collections::BTreeMap;

    struct Table<'a>(&'a [Name], BTreeMap<&'static str, Scalar<'static>>);

    impl Names for Table<'_> {
        fn value(&self, name: u32) -> Result<Scalar<'_>, String> {
            let key = &self.0[name as usize].key;
            self.1.get(key.as_str()).cloned().ok_or_else(|| format!("{key} is empty"))
        }
    }

    #[track_caller]
    fn check(text: &str, expected: Result<&str, &str>) {
        let parsed = parse(text, true).map_err(|error| error.message);
        let known = BTreeMap::from([
            ("x", Scalar::Number(3.0)),
            ("open", Scalar::Bool(true)),
            ("name", Scalar::Text("mug".into())),
            ("@top", Scalar::Number(7.0)),
            ("a.b", Scalar::Number(0.5)),
        ]);
        let found = parsed.and_then(|parsed| {
            let table = Table(&parsed.names, known);
            parsed.statements[0].value.eval(&table).map(|scalar| scalar.describe())
        });
        assert_eq!(found.as_deref().map_err(String::as_str), expected, "{text}");
    }

    #[test]
    fn numbers() {
        check("1 + 2 * 3", Ok("7"));
        check("(1 + 2) * 3", Ok("9"));
        check("5 / 2", Ok("2.5"));
        check("7 % 4", Ok("3"));
        check("-x + 1", Ok("-2"));
        check("x-1", Ok("2"));
        check("x - -1", Ok("4"));
        check("1e-3 * 1000", Ok("1"));
        check("1 / 0", Err("division by zero"));
    }

    #[test]
    fn comparisons() {
        check("x == 3", Ok("true"));
        check("x != 3 || x >= 4", Ok("false"));
        check("1 < x && x <= 3", Ok("true"));
        check("open == 1", Ok("true"));
        check("open == true", Ok("true"));
        check("!open", Ok("false"));
        check("name == 'mug'", Ok("true"));
        check("name == \"cup\"", Ok("false"));
        check("name > 1", Err("a text and a number do not go together: \"mug\" and 1"));
        check("name && open", Err("expected true or false, found \"mug\""));
    }

    #[test]
    fn choices_and_texts() {
        check("x > 2 ? 'big' : 'small'", Ok("\"big\""));
        check("(x < 2) ? 1 : 3", Ok("3"));
        check("'it' + \"'s\"", Ok("\"it's\""));
        check("'a \\' b'", Ok("\"a ' b\""));
        check("'costs ${x}'", Ok("\"costs ${x}\""));
        check("@top + a.b", Ok("7.5"));
    }

    #[test]
    fn what_a_script_has_not() {
        check("[1, 2]", Err("a list cannot be used in a script"));
        check("f(x)", Err("a function cannot be used in a script"));
        check("null", Err("null cannot be used in a script"));
        check("x & 1", Err("the bit operator '&' cannot be used in a script"));
        check("'a' .. 'b'", Err("`..` cannot be used in a script; texts are joined with `+`"));
        check("x # y", Err("a script has no comments"));
        check("1 +", Err("no expression can be read here"));
        check("", Err("the script is empty"));
        check("'a", Err("a text is not closed"));
        check("x := 1", Err("a condition assigns nothing; compare with `==`"));
        check("x; x", Err("a condition is one expression"));
        check(&"(".repeat(3000), Err("brackets are nested deeper than 8"));
        check("((((((((x))))))))", Ok("3"));
    }

    /// Long rows of one sign end in a mistake or a value, not in a full stack.
    #[test]
    fn long_rows_of_signs() {
        for sign in ["!", "-", "a?", "1?1:", "1+", "1&&", "a.", "1;"] {
            for n in [100, 1000, 4096 / sign.len()] {
                drop(parse(&format!("{}1", sign.repeat(n)), true));
                drop(parse(&format!("{}1", sign.repeat(n)), false));
            }
        }
    }

    #[test]
    fn statements_name_what_they_read_and_write() {
        let parsed = parse("n := 1; n += 2; m = k.f > n;", false).unwrap();
        let names: Vec<(&str, bool, bool)> =
            parsed.names.iter().map(|name| (name.key.as_str(), name.is_read, name.is_written)).collect();
        assert_eq!(names, [("n", false, true), ("k.f", true, false), ("m", false, true)]);
        assert_eq!(parsed.statements.len(), 3);
        assert_eq!(parse("a.b := 1", false).unwrap_err().message, "a field of an entry cannot be assigned");
    }

    #[test]
    fn a_mistake_has_its_place() {
        assert_eq!(parse("a := 1; b := f(2)", false).unwrap_err().at, 13..17);
        assert_eq!(parse("a == 'x' && b ^ 1", true).unwrap_err().at, 14..15);
    }
}

//! Where the lines of a file do not fit each other. A YAML parser notices that some lines after the slip; here the line is
//! looked for whose mending makes the file readable.

use crate::document::parse_as_written;
use crate::mistake::{Mistake, Place};
use crate::scenario::KEYS;
use std::collections::BTreeSet;

/// Larger files are not read again and again; they get the parser's own words.
const MAX_BYTES: usize = 16 << 10;
/// How many lines before the one that the parser stopped at may be to blame.
const N_LINES_BACK: usize = 10;
/// How many lines on either side show where a line should begin.
const N_NEIGHBOURS: usize = 3;

/// What makes `text` unreadable, if that can be said better than the parser does.
pub(crate) fn slip(text: &str, error: &serde_saphyr::Error) -> Option<Mistake> {
    bare_parameter(text, error).or_else(|| odd_line(text, error))
}

/// A parameter between braces or brackets, where YAML takes its braces for its own.
fn bare_parameter(text: &str, error: &serde_saphyr::Error) -> Option<Mistake> {
    let location = error.location()?;
    let (line, column) = (usize::try_from(location.line()).ok()?, usize::try_from(location.column()).ok()?);
    let content = text.lines().nth(line.checked_sub(1)?)?;
    let from: String = content.chars().skip(column.checked_sub(2)?).collect();
    let name = from.strip_prefix("${")?.split('}').next()?;
    let help = format!("write \"${{{name}}}\"");
    let place = Place { file: 0, line: number(line), column: number(column - 1), n_chars: number(name.chars().count() + 3) };
    Some(Mistake::new(place, "a parameter between braces or brackets needs quotes").help(help))
}

/// The line that makes `text` unreadable, if mending that line alone mends the file.
fn odd_line(text: &str, error: &serde_saphyr::Error) -> Option<Mistake> {
    let words = error.without_snippet().to_string();
    let is_about_layout = ["mapping values", "did not find expected", "simple key"].iter().any(|part| words.contains(part));
    if text.is_empty() || text.len() > MAX_BYTES || !is_about_layout {
        return None;
    }
    let lines: Vec<&str> = text.split_inclusive('\n').collect();
    let last = usize::try_from(error.location()?.line()).ok()?.clamp(1, lines.len().max(1));
    let has_content = |line_idx: &usize| {
        let line = lines[*line_idx].trim();
        !line.is_empty() && !line.starts_with('#')
    };
    let suspects: Vec<usize> = (0..last).rev().filter(has_content).take(N_LINES_BACK).collect();
    let mended = |line_idx: usize, line: &str| {
        let whole: String =
            lines[..line_idx].iter().copied().chain([line]).chain(lines[line_idx + 1..].iter().copied()).collect();
        parse_as_written(&whole).is_ok()
    };
    let begins: Vec<usize> = lines.iter().map(|line| line.len() - line.trim_start_matches(' ').len()).collect();
    let moved = |is_wanted: &dyn Fn(usize, usize) -> bool| {
        for &line_idx in suspects.iter().filter(|line_idx| is_entry(lines[**line_idx]) && !is_at_home(lines[**line_idx])) {
            let (begin, content) = (begins[line_idx], lines[line_idx].trim_start_matches(' '));
            let before = (0..line_idx).rev().filter(has_content).take(N_NEIGHBOURS);
            let after = (line_idx + 1..lines.len()).filter(has_content).take(N_NEIGHBOURS);
            let mut seen = BTreeSet::new();
            for other in after.chain(before).chain([last - 1]).map(|other_idx| begins[other_idx]) {
                if is_wanted(begin, other) && seen.insert(other) && mended(line_idx, &format!("{}{content}", " ".repeat(other))) {
                    let message = format!("the line begins in column {}, where column {} fits", begin + 1, other + 1);
                    let help = "keys of one map, and items of one list, begin in one column";
                    return Some(at(line_idx, lines[line_idx], message, help));
                }
            }
        }
        None
    };
    let named = || {
        let is_nameless = |line_idx: &usize| {
            let (blanks, content) = lines[*line_idx].split_at(begins[*line_idx]);
            !is_entry(content) && mended(*line_idx, &format!("{blanks}key: {content}"))
        };
        let line_idx = *suspects.iter().find(|line_idx| is_nameless(line_idx))?;
        Some(at(line_idx, lines[line_idx], "the line has no key".to_owned(), "write `key: value`"))
    };
    // A line moved out of its block by mistake is likelier than one moved in.
    moved(&|begin, other| other > begin).or_else(named).or_else(|| moved(&|begin, other| other < begin))
}

/// Whether a line begins with a key or as an item of a list; others are what their key lost.
fn is_entry(line: &str) -> bool {
    let line = line.trim();
    let is_key = |key: &str| !key.is_empty() && key.chars().all(|letter| letter.is_alphanumeric() || letter == '_');
    line.starts_with("- ") || line.split_once(':').is_some_and(|(key, _)| is_key(key))
}

/// Whether a line holds a key of the whole file, and stands where such a key does.
fn is_at_home(line: &str) -> bool {
    line.split_once(':').is_some_and(|(key, _)| KEYS.contains(&key))
}

fn at(line_idx: usize, line: &str, message: String, help: &str) -> Mistake {
    let content = line.trim_start_matches(' ');
    let place = Place {
        file: 0,
        line: number(line_idx + 1),
        column: number(line.len() - content.len() + 1),
        n_chars: number(content.trim_end().chars().count()).max(1),
    };
    Mistake::new(place, message).help(help)
}

fn number(n: usize) -> u32 {
    u32::try_from(n).unwrap_or(u32::MAX)
}

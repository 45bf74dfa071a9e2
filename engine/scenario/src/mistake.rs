//! Places in a file, mistakes, and how they are shown.

use std::fmt::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Where something was written.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Place {
    /// From 1.
    pub line: u32,
    /// From 1, in characters.
    pub column: u32,
    /// How much of the line it takes, at least 1.
    pub n_chars: u32,
}

impl Place {
    /// The first character of a file.
    pub const START: Self = Self { line: 1, column: 1, n_chars: 1 };
}

/// A value and where it was written.
#[derive(Clone, Debug, PartialEq)]
pub struct At<T> {
    /// The value.
    pub value: T,
    /// Its place.
    pub place: Place,
}

impl<T> std::ops::Deref for At<T> {
    type Target = T;
    fn deref(&self) -> &T {
        &self.value
    }
}

/// A file and its text.
#[derive(Clone, Debug, PartialEq)]
pub struct Source {
    /// Where it was read from; shown to the user as given.
    pub path: PathBuf,
    /// Its content.
    pub text: String,
}

/// One thing that the user has to mend.
#[derive(Clone, Debug, PartialEq)]
pub struct Mistake {
    /// Where.
    pub place: Place,
    /// What is wrong: lower-case, no full stop.
    pub message: String,
    /// What to write instead, if known.
    pub help: Option<String>,
}

impl Mistake {
    /// A mistake at `place`.
    pub fn new(place: Place, message: impl Into<String>) -> Self {
        Self { place, message: message.into(), help: None }
    }

    /// Adds what to write instead.
    #[must_use]
    pub fn help(mut self, help: impl Into<String>) -> Self {
        self.help = Some(help.into());
        self
    }
}

/// Why a scenario cannot be used: everything that is wrong with it.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ScenarioErrors {
    /// The file cannot be read at all.
    #[error("cannot read {path:?}: {message}")]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// Why, and what to do.
        message: String,
    },
    /// The file can be read, and has mistakes. Displays all of them, each with its line.
    #[error("{}", render(source_file, mistakes))]
    Mistakes {
        /// The file.
        source_file: Arc<Source>,
        /// In the order of the file, at least one.
        mistakes: Vec<Mistake>,
    },
}

impl ScenarioErrors {
    pub(crate) fn mistakes(source_file: Arc<Source>, mut mistakes: Vec<Mistake>) -> Self {
        mistakes.sort_by_key(|mistake| mistake.place);
        mistakes.dedup();
        Self::Mistakes { source_file, mistakes }
    }

    pub(crate) fn unreadable(path: &Path, message: impl Into<String>) -> Self {
        Self::Unreadable { path: path.to_owned(), message: message.into() }
    }

    /// How many mistakes there are.
    #[must_use]
    pub fn count(&self) -> usize {
        match self {
            Self::Unreadable { .. } => 1,
            Self::Mistakes { mistakes, .. } => mistakes.len(),
        }
    }

    /// The mistakes; none when the file could not be read.
    #[must_use]
    pub fn list(&self) -> &[Mistake] {
        match self {
            Self::Unreadable { .. } => &[],
            Self::Mistakes { mistakes, .. } => mistakes,
        }
    }
}

fn render(source: &Source, mistakes: &[Mistake]) -> String {
    let lines: Vec<&str> = source.text.lines().collect();
    let mut text = String::new();
    for (mistake_idx, mistake) in mistakes.iter().take(MAX_SHOWN_MISTAKES).enumerate() {
        if mistake_idx > 0 {
            text.push('\n');
        }
        // Writing to a string cannot fail.
        let _infallible = render_one(&mut text, source, &lines, mistake);
    }
    if mistakes.len() > MAX_SHOWN_MISTAKES {
        let _infallible = writeln!(text, "\nand {} more", mistakes.len() - MAX_SHOWN_MISTAKES);
    }
    text
}

/// Nobody mends more than this before the next try.
const MAX_SHOWN_MISTAKES: usize = 50;
/// Longer lines are cut so that a binary file does not fill the screen.
const MAX_SHOWN_CHARS: usize = 160;

fn render_one(out: &mut String, source: &Source, lines: &[&str], mistake: &Mistake) -> fmt::Result {
    let Place { line, column, n_chars } = mistake.place;
    writeln!(out, "error: {}", mistake.message)?;
    let number = line.to_string();
    let margin = " ".repeat(number.len());
    writeln!(out, "{margin}--> {}:{line}:{column}", source.path.display())?;
    if let Some(shown) = lines.get(line as usize - 1) {
        let shown: String =
            shown.chars().take(MAX_SHOWN_CHARS).map(|letter| if letter.is_control() { ' ' } else { letter }).collect();
        let n_shown = shown.chars().count();
        let before = (column as usize - 1).min(n_shown);
        let marked = (n_chars as usize).min(n_shown.saturating_sub(before)).max(1);
        writeln!(out, "{margin} |\n{number} | {shown}\n{margin} | {}{}", " ".repeat(before), "^".repeat(marked))?;
    }
    if let Some(help) = &mistake.help {
        writeln!(out, "{margin} = help: {help}")?;
    }
    Ok(())
}

//! Places in a file, mistakes, and how they are shown.

use std::fmt::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Where something was written.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Place {
    /// Which file: 0 is the scenario's own, the others are included.
    pub file: u32,
    /// From 1.
    pub line: u32,
    /// From 1, in characters.
    pub column: u32,
    /// How much of the line it takes, at least 1.
    pub n_chars: u32,
}

impl Place {
    /// The first character of the scenario's own file.
    pub const START: Self = Self { file: 0, line: 1, column: 1, n_chars: 1 };
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

/// How bad a [`Mistake`] is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Severity {
    /// The scenario cannot be used.
    Error,
    /// The scenario can be used, but probably does not say what was meant.
    Warning,
}

/// One thing that the user has to mend.
#[derive(Clone, Debug, PartialEq)]
pub struct Mistake {
    /// How bad it is.
    pub severity: Severity,
    /// Where.
    pub place: Place,
    /// What is wrong: lower-case, no full stop.
    pub message: String,
    /// What to write instead, if known.
    pub help: Option<String>,
}

impl Mistake {
    /// An error at `place`.
    pub fn new(place: Place, message: impl Into<String>) -> Self {
        Self { severity: Severity::Error, place, message: message.into(), help: None }
    }

    /// A warning at `place`.
    pub fn warning(place: Place, message: impl Into<String>) -> Self {
        Self { severity: Severity::Warning, ..Self::new(place, message) }
    }

    /// Adds what to write instead.
    #[must_use]
    pub fn help(mut self, help: impl Into<String>) -> Self {
        self.help = Some(help.into());
        self
    }
}

/// What is wrong with some files. Displays every mistake with its line.
#[derive(Clone, Debug, PartialEq)]
pub struct Findings {
    sources: Arc<[Source]>,
    mistakes: Vec<Mistake>,
}

impl Findings {
    pub(crate) fn new(sources: Arc<[Source]>, mut mistakes: Vec<Mistake>) -> Self {
        mistakes.sort_by_key(|mistake| (mistake.place, mistake.severity));
        mistakes.dedup();
        // An error says more than a warning about the same words.
        let errors: Vec<Place> =
            mistakes.iter().filter(|mistake| mistake.severity == Severity::Error).map(|mistake| mistake.place).collect();
        mistakes.retain(|mistake| mistake.severity == Severity::Error || errors.binary_search(&mistake.place).is_err());
        Self { sources, mistakes }
    }

    /// The files.
    pub(crate) fn sources(&self) -> &[Source] {
        &self.sources
    }

    /// The mistakes in the order of the files.
    #[must_use]
    pub fn list(&self) -> &[Mistake] {
        &self.mistakes
    }

    /// How many mistakes of this severity there are.
    #[must_use]
    pub fn count(&self, severity: Severity) -> usize {
        self.mistakes.iter().filter(|mistake| mistake.severity == severity).count()
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
    /// The file can be read, and it or a file that it includes has mistakes: at least one error, and every warning.
    #[error("{0}")]
    Mistakes(Findings),
}

impl ScenarioErrors {
    pub(crate) fn unreadable(path: &Path, message: impl Into<String>) -> Self {
        Self::Unreadable { path: path.to_owned(), message: message.into() }
    }

    /// How many mistakes of this severity there are.
    #[must_use]
    pub fn count(&self, severity: Severity) -> usize {
        match self {
            Self::Unreadable { .. } => usize::from(severity == Severity::Error),
            Self::Mistakes(findings) => findings.count(severity),
        }
    }

    /// The mistakes; none when the file could not be read.
    #[must_use]
    pub fn list(&self) -> &[Mistake] {
        match self {
            Self::Unreadable { .. } => &[],
            Self::Mistakes(findings) => findings.list(),
        }
    }
}

impl fmt::Display for Findings {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let lines: Vec<Vec<&str>> = self.sources.iter().map(|source| source.text.lines().collect()).collect();
        for (mistake_idx, mistake) in self.mistakes.iter().take(MAX_SHOWN_MISTAKES).enumerate() {
            if mistake_idx > 0 {
                f.write_char('\n')?;
            }
            let file = mistake.place.file as usize;
            show(f, self.sources.get(file), lines.get(file).map_or(&[], Vec::as_slice), mistake)?;
        }
        if self.mistakes.len() > MAX_SHOWN_MISTAKES {
            writeln!(f, "\nand {} more", self.mistakes.len() - MAX_SHOWN_MISTAKES)?;
        }
        Ok(())
    }
}

/// Nobody mends more than this before the next try.
const MAX_SHOWN_MISTAKES: usize = 50;
/// Longer lines are cut so that a binary file does not fill the screen.
const MAX_SHOWN_CHARS: usize = 160;

fn show(f: &mut fmt::Formatter<'_>, source: Option<&Source>, lines: &[&str], mistake: &Mistake) -> fmt::Result {
    let Place { line, column, n_chars, .. } = mistake.place;
    let word = match mistake.severity {
        Severity::Error => "error",
        Severity::Warning => "warning",
    };
    writeln!(f, "{word}: {}", mistake.message)?;
    let number = line.to_string();
    let margin = " ".repeat(number.len());
    if let Some(source) = source {
        writeln!(f, "{margin}--> {}:{line}:{column}", source.path.display())?;
    }
    if let Some(shown) = lines.get(line as usize - 1) {
        let shown: String =
            shown.chars().take(MAX_SHOWN_CHARS).map(|letter| if letter.is_control() { ' ' } else { letter }).collect();
        let n_shown = shown.chars().count();
        let before = (column as usize - 1).min(n_shown);
        let marked = (n_chars as usize).min(n_shown.saturating_sub(before)).max(1);
        writeln!(f, "{margin} |\n{number} | {shown}\n{margin} | {}{}", " ".repeat(before), "^".repeat(marked))?;
    }
    if let Some(help) = &mistake.help {
        writeln!(f, "{margin} = help: {help}")?;
    }
    Ok(())
}

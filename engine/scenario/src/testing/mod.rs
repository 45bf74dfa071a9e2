//! Tests of scenarios: preset results and delays of leaves in, the trace and the verdict of the tree out. No robot is needed.
//!
//! ```yaml
//! scenario: ../01_pour.yaml         # its tree, subtrees and blackboard are tested, nothing else of it
//! set: {height_m: 0.12}             # values of its parameters; the environment is not looked at
//! tick_secs: 0.1
//! cases:
//!   - name: a second attempt after an empty grasp
//!     leaves:                        # by path, own name or kind; one item an activation, the last repeats
//!       verify_grasp: [{fails: grasp_empty}, succeeds]
//!       lift: [{succeeds: {after_secs: 2.0}}, {fails: {reason: slipped, after_secs: 1.0}}, skipped, runs]
//!     expect: {status: success, calls: {lift: 1}}
//! ```
//! Leaves that are not named succeed at once. Built-in leaves such as `sleep` and `script` do what they always do; they are not
//! in traces. [`test_schema`] lists every key.

mod case;
mod names;
mod read;
mod schema;

pub use case::{CaseResult, Difference, TestCase};
pub use schema::test_schema;

use crate::document;
use crate::files::read_text;
use crate::mistake::{Findings, ScenarioErrors, Severity, Source};
use crate::reader::Reader;
use crate::vocabulary::Vocabulary;
use read::TestReader;
use sfg_tree::Registry;
use std::path::Path;

/// The cases of a test file, checked against the scenario that they test.
#[derive(Debug)]
pub struct ScenarioTests {
    /// At least one, in the order of the file.
    pub cases: Vec<TestCase>,
}

impl ScenarioTests {
    /// The tests in the file at `path`.
    ///
    /// # Errors
    /// [`ScenarioErrors`] with every mistake of the file and of its scenario, or why it cannot be read.
    pub fn load<C>(path: &Path, registry: &Registry<C>, vocabulary: &Vocabulary) -> Result<Self, ScenarioErrors> {
        let text = read_text(path).map_err(|message| ScenarioErrors::unreadable(path, message))?;
        Self::parse(path, text, registry, vocabulary)
    }

    /// The tests in `text`; `path` is shown in messages, and the scenario is found beside it.
    ///
    /// # Errors
    /// [`ScenarioErrors`] with every mistake of the text and of its scenario.
    pub fn parse<C>(path: &Path, text: String, registry: &Registry<C>, vocabulary: &Vocabulary) -> Result<Self, ScenarioErrors> {
        let mut reader = Reader::default();
        let mut sources = vec![Source { path: path.to_owned(), text: text.clone() }];
        let cases = match document::parse(&text, 0) {
            Ok(document) => {
                let mut tests = TestReader { reader: &mut reader, registry, vocabulary, sources: &mut sources };
                tests.file(&document)
            }
            Err(mistake) => {
                reader.mistakes.push(mistake);
                None
            }
        };
        let findings = Findings::new(sources.into(), reader.mistakes);
        match cases {
            Some(cases) if findings.count(Severity::Error) == 0 => Ok(Self { cases }),
            _ => Err(ScenarioErrors::Mistakes(findings)),
        }
    }
}

//! Trees in the XML of BehaviorTree.CPP: read with the places of their parts, put into a scenario, written down as YAML, and the
//! tree of a scenario as XML.

use crate::document::MAX_FILE_BYTES;
use crate::emit;
use crate::files::{MAX_FILES, read_text};
use crate::mistake::{Findings, Mistake, Place, ScenarioErrors, Severity, Source};
use crate::scenario::{Scenario, Written, check_tree};
use sfg_tree::xml::{self, ImportOptions, XmlPlace, XmlProblem};
use sfg_tree::{NodeModel, Registry, TreeSpec};
use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::Arc;

/// A tree out of XML files.
#[derive(Clone, Debug)]
pub struct XmlTree {
    spec: TreeSpec,
    /// Where a `location` of the tree was written.
    places: Vec<Place>,
    sources: Arc<[Source]>,
    warnings: Vec<Mistake>,
}

impl XmlTree {
    /// The tree of the file at `path` and of those that it includes.
    ///
    /// # Errors
    /// [`ScenarioErrors`] with every mistake of the files, or why the first cannot be read.
    pub fn load(path: &Path) -> Result<Self, ScenarioErrors> {
        let text = read_text(path).map_err(|message| ScenarioErrors::unreadable(path, message))?;
        let folder = path.parent().unwrap_or(Path::new("")).to_owned();
        let mut included: RefCell<BTreeMap<String, String>> = RefCell::default();
        let load = |name: &str| {
            if included.borrow().len() >= MAX_FILES {
                return Err(format!("there are more than {MAX_FILES} files"));
            }
            let file = folder.join(name);
            // A pipe would be waited for.
            let text = if file.is_file() { read_text(&file) } else { Err("it is no file".to_owned()) }?;
            included.borrow_mut().insert(name.to_owned(), text.clone());
            Ok(text)
        };
        let options = ImportOptions { load: &load, n_bytes_max: MAX_FILE_BYTES, ..ImportOptions::default() };
        let imported = xml::import(&text, &options);
        let names: Vec<String> = included.get_mut().keys().cloned().collect();
        let own = Source { path: path.to_owned(), text };
        let others = included.into_inner().into_iter().map(|(name, text)| Source { path: folder.join(name), text });
        let files = Files { sources: std::iter::once(own).chain(others).collect(), names };
        match imported {
            Ok(tree) => {
                let places = tree.places.iter().map(|place| {
                    let name = tree.files.get(place.file as usize).map_or("", String::as_str);
                    files.word(files.number(name), place.line, place.column)
                });
                let places = places.collect();
                let warnings =
                    tree.warnings.iter().map(|problem| Mistake { severity: Severity::Warning, ..files.mistake(problem) });
                let warnings = warnings.collect();
                Ok(Self { spec: tree.spec, places, warnings, sources: files.sources })
            }
            Err(problems) => {
                let mistakes = problems.iter().map(|problem| files.mistake(problem)).collect();
                Err(ScenarioErrors::Mistakes(Findings::new(files.sources, mistakes)))
            }
        }
    }

    /// What was read but is probably not meant so.
    #[must_use]
    pub fn warnings(&self) -> Findings {
        Findings::new(Arc::clone(&self.sources), self.warnings.clone())
    }

    /// The tree as the text of a scenario's `tree` and `subtrees`. Constants of the nodes in `models` get the types of their ports.
    ///
    /// # Errors
    /// [`ScenarioErrors`] with every part that a scenario cannot say.
    pub fn to_yaml(&self, models: &[NodeModel]) -> Result<String, ScenarioErrors> {
        let mut spec = self.spec.clone();
        emit::with_types(&mut spec, models);
        emit::tree_text(&spec, models).map_err(|problems| {
            let place = |location: u32| self.places.get(location as usize).copied().unwrap_or(Place::START);
            let mistakes = problems.into_iter().map(|problem| Mistake::new(place(problem.location), problem.message)).collect();
            ScenarioErrors::Mistakes(Findings::new(Arc::clone(&self.sources), mistakes))
        })
    }
}

/// XML files and their texts.
struct Files {
    /// The first has no name.
    names: Vec<String>,
    sources: Arc<[Source]>,
}

impl Files {
    #[expect(clippy::cast_possible_truncation, reason = "a few files")]
    fn number(&self, name: &str) -> u32 {
        self.names.iter().position(|known| known == name).map_or(0, |at| at as u32 + 1)
    }

    /// The rest of the line at a place.
    fn rest(&self, file: u32, line: u32, column: u32) -> impl Iterator<Item = char> {
        let text = self.sources.get(file as usize).map_or("", |source| source.text.as_str());
        let line = text.lines().nth((line as usize).saturating_sub(1)).unwrap_or_default();
        line.chars().skip((column as usize).saturating_sub(1))
    }

    /// The place of the element, attribute or value that begins there.
    fn word(&self, file: u32, line: u32, column: u32) -> Place {
        let is_part = |(at, letter): &(usize, char)| match letter {
            '<' => *at == 0,
            letter => !letter.is_whitespace() && !matches!(letter, '>' | '/' | '=' | '"' | '\''),
        };
        let n_chars = self.rest(file, line, column).enumerate().take_while(is_part).count();
        Place { file, line, column, n_chars: u32::try_from(n_chars).unwrap_or(1).max(1) }
    }

    fn mistake(&self, problem: &XmlProblem) -> Mistake {
        let place = match &problem.place {
            XmlPlace::File { path, line, column } => {
                let place = self.word(self.number(path), *line, *column);
                let n_text = problem.text.chars().count();
                let is_shown = n_text > 0 && self.rest(place.file, *line, *column).take(n_text).eq(problem.text.chars());
                if is_shown { Place { n_chars: u32::try_from(n_text).unwrap_or(1), ..place } } else { place }
            }
            XmlPlace::Node { .. } => Place::START,
        };
        mistake_at(place, problem)
    }
}

fn mistake_at(place: Place, problem: &XmlProblem) -> Mistake {
    let message =
        if problem.text.is_empty() { problem.fault.to_string() } else { format!("{:?}: {}", problem.text, problem.fault) };
    let help = Some(problem.help.clone()).filter(|help| !help.is_empty());
    Mistake { help, ..Mistake::new(place, message) }
}

impl Scenario {
    /// The scenario's tree as a file of BehaviorTree.CPP, with a palette of the nodes in `models`.
    ///
    /// # Errors
    /// [`ScenarioErrors`] with every part of the tree that BehaviorTree.CPP cannot say.
    pub fn to_xml(&self, models: &[NodeModel]) -> Result<String, ScenarioErrors> {
        xml::export(&self.tree, models).map_err(|problems| {
            let mistake = |problem: &XmlProblem| match &problem.place {
                XmlPlace::Node { location, .. } => mistake_at(self.place(*location).unwrap_or(Place::START), problem),
                XmlPlace::File { .. } => mistake_at(Place::START, problem),
            };
            ScenarioErrors::Mistakes(Findings::new(Arc::clone(&self.sources), problems.iter().map(mistake).collect()))
        })
    }

    /// The scenario with another tree: robot, scene, plugins, success and limits stay, and so do the blackboard's first entries.
    ///
    /// # Errors
    /// [`ScenarioErrors`] with every mistake of the tree.
    pub fn with_tree<C>(self, tree: XmlTree, registry: &Registry<C>) -> Result<Self, ScenarioErrors> {
        let XmlTree { mut spec, mut places, sources, warnings } = tree;
        #[expect(clippy::cast_possible_truncation, reason = "a few files")]
        let n_own = self.sources.len() as u32;
        let moved = |place: Place| Place { file: place.file + n_own, ..place };
        places.iter_mut().for_each(|place| *place = moved(*place));
        let mut entry_places = Vec::new();
        for (key, value, location) in &self.tree.entries {
            let place = self.places.get(*location as usize).copied().unwrap_or(Place::START);
            spec.entries.push((key.clone(), value.clone(), u32::try_from(places.len()).unwrap_or(u32::MAX)));
            places.push(place);
            entry_places.push(place);
        }
        let (spoilt, unread) = (BTreeSet::new(), BTreeSet::new());
        let written = Written {
            tree: &spec,
            places: &places,
            entry_places: &entry_places,
            reason_places: &[],
            spoilt: &spoilt,
            unread: &unread,
        };
        let mut found = check_tree(&written, registry, Some(self.limits.timeout_secs));
        // The scenario's entries are there for more than one tree.
        found.retain(|mistake| mistake.severity == Severity::Error || mistake.place.file >= n_own);
        let warned = warnings.into_iter().map(|mistake| Mistake { place: moved(mistake.place), ..mistake });
        let sources: Arc<[Source]> = self.sources.iter().chain(sources.iter()).cloned().collect();
        let findings = Findings::new(Arc::clone(&sources), found.into_iter().chain(warned).collect());
        if findings.count(Severity::Error) > 0 {
            return Err(ScenarioErrors::Mistakes(findings));
        }
        Ok(Self { tree: spec, places, sources, warnings: findings, ..self })
    }
}

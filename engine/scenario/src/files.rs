//! The file of a scenario and the files that it includes, put together as one document.
//!
//! An included file holds parts for others to use: `subtrees`, `scene`, `plugins`, `limits`, `parameters`, and files of its own.
//! What the including file says wins, name by name. Two included files that say different things are a mistake: nobody reads
//! the order of a list of files as an order of precedence.

use crate::document::{self, Key, MAX_FILE_BYTES, Node, Value};
use crate::mistake::{At, Mistake, Place, Source};
use crate::reader::Reader;
use std::collections::BTreeMap;
use std::io::Read;
use std::path::{Path, PathBuf};

/// Longest chain of files that include each other.
pub const MAX_INCLUDE_DEPTH: usize = 16;
/// Most files of one scenario.
pub const MAX_FILES: usize = 64;

/// The parts that are put together entry by entry.
const SECTIONS: [&str; 5] = ["parameters", "plugins", "limits", "subtrees", "scene"];
/// Everything that an included file may say.
pub(crate) const INCLUDED_KEYS: [&str; 8] =
    ["version", "description", "include", "parameters", "plugins", "limits", "subtrees", "scene"];

/// The text of the file at `path`.
pub(crate) fn read_text(path: &Path) -> Result<String, String> {
    let file = std::fs::File::open(path).map_err(|error| error.to_string())?;
    let mut bytes = Vec::new();
    // One byte more than accepted tells a full file from a cut one, also for files that do not know their length.
    file.take(MAX_FILE_BYTES as u64 + 1).read_to_end(&mut bytes).map_err(|error| error.to_string())?;
    if bytes.len() > MAX_FILE_BYTES {
        return Err(format!("it is larger than {} MB; split it, or name files instead of copying them", MAX_FILE_BYTES >> 20));
    }
    String::from_utf8(bytes).map_err(|error| format!("byte {} is no UTF-8 text", error.utf8_error().valid_up_to()))
}

/// Reads a file with all that it includes.
pub(crate) struct Files<'r> {
    pub(crate) reader: &'r mut Reader,
    pub(crate) sources: Vec<Source>,
    /// What was read, by its real path; nothing when it cannot be used.
    known: BTreeMap<PathBuf, Option<Node>>,
    /// The files around the current one, outermost first.
    open: Vec<PathBuf>,
    n_bytes: usize,
}

impl<'r> Files<'r> {
    pub(crate) fn new(reader: &'r mut Reader) -> Self {
        Self { reader, sources: Vec::new(), known: BTreeMap::new(), open: Vec::new(), n_bytes: 0 }
    }

    /// The document in `text`, with what it includes put in. Nothing when one of the files cannot be read at all.
    pub(crate) fn document(&mut self, path: &Path, text: String) -> Option<Node> {
        let file = u32::try_from(self.sources.len()).unwrap_or(u32::MAX);
        self.n_bytes += text.len();
        let parsed = document::parse(&text, file);
        self.sources.push(Source { path: path.to_owned(), text });
        let mut document = match parsed {
            Ok(document) => document,
            Err(mistake) => {
                self.reader.mistakes.push(mistake);
                return None;
            }
        };
        if file != 0 {
            let what = "an included file";
            self.reader.fields(what, &document, &INCLUDED_KEYS)?;
            self.reader.version(&document);
        }
        // A name without a folder is found without its real path.
        self.open.push(path.canonicalize().unwrap_or_else(|_| path.to_owned()));
        let included = self.included(path, &document);
        self.open.pop();
        for other in included? {
            self.put_in(file, &mut document, &other);
        }
        Some(document)
    }

    /// The documents that `document` includes, each once. Nothing when one of them cannot be used.
    fn included(&mut self, path: &Path, document: &Node) -> Option<Vec<Node>> {
        let Some(list) = document.get("include") else { return Some(Vec::new()) };
        let folder = path.parent().unwrap_or(Path::new(""));
        let (mut seen, mut documents) = (BTreeMap::new(), Vec::new());
        let mut is_whole = true;
        for item in self.reader.list("include", list)? {
            let Some(name) = self.reader.text("include", item) else {
                is_whole = false;
                continue;
            };
            let other = folder.join(&name.value);
            let real = match other.canonicalize() {
                Ok(real) => real,
                Err(error) => {
                    let message = format!("cannot read {:?}: {error}", name.value);
                    let help = "the path is relative to the file that includes it";
                    self.reader.report_with_help(item.place, message, help);
                    is_whole = false;
                    continue;
                }
            };
            if let Some(line) = seen.insert(real.clone(), item.place.line) {
                let message = format!("{:?} is included twice", name.value);
                self.reader.report_with_help(item.place, message, format!("it is first included in line {line}"));
                continue;
            }
            match self.include(&name, &other, real) {
                Some(document) => documents.push(document),
                None => is_whole = false,
            }
        }
        is_whole.then_some(documents)
    }

    fn include(&mut self, name: &At<String>, path: &Path, real: PathBuf) -> Option<Node> {
        let place = name.place;
        if self.open.contains(&real) {
            let chain: Vec<String> = self.open.iter().chain([&real]).map(|path| file_name(path)).collect();
            let message = format!("{:?} includes itself: {}", name.value, chain.join(" -> "));
            self.reader.report(place, message);
            return None;
        }
        if let Some(known) = self.known.get(&real) {
            return known.clone();
        }
        if self.open.len() > MAX_INCLUDE_DEPTH {
            self.reader.report(place, format!("files include each other more than {MAX_INCLUDE_DEPTH} deep"));
            return None;
        }
        if self.sources.len() >= MAX_FILES {
            self.reader.report(place, format!("the scenario has more than {MAX_FILES} files"));
            return None;
        }
        // A pipe would be waited for.
        let read = if path.is_file() { read_text(path) } else { Err("it is no file".to_owned()) };
        let read = match read {
            Ok(text) if self.n_bytes + text.len() > MAX_FILE_BYTES => {
                Err(format!("the files of the scenario are larger than {} MB together", MAX_FILE_BYTES >> 20))
            }
            read => read,
        };
        let document = match read {
            Ok(text) => self.document(path, text),
            Err(message) => {
                self.reader.report(place, format!("cannot read {:?}: {message}", name.value));
                None
            }
        };
        self.known.insert(real, document.clone());
        document
    }

    /// Puts the parts of `other` into `document`, which is that of `file`.
    fn put_in(&mut self, file: u32, document: &mut Node, other: &Node) {
        let (Value::Map(own), Value::Map(others)) = (&mut document.value, &other.value) else { return };
        for (key, section) in others.iter().filter(|(key, _)| SECTIONS.contains(&key.text.as_str())) {
            match own.iter_mut().find(|(name, _)| name.text == key.text) {
                None => own.push((key.clone(), section.clone())),
                Some((_, own)) => self.put_in_section(file, own, section),
            }
        }
    }

    fn put_in_section(&mut self, file: u32, own: &mut Node, other: &Node) {
        let (Value::Map(own), Value::Map(others)) = (&mut own.value, &other.value) else { return };
        for (key, entry) in others {
            match own.iter_mut().find(|(name, _)| name.text == key.text) {
                None => own.push((key.clone(), entry.clone())),
                Some((name, own)) if name.text == "objects" => self.put_in_objects(file, own, entry),
                Some((name, _)) => self.compare(file, name, key),
            }
        }
    }

    /// Objects are a list, so that they stand in an order: those of included files come first.
    fn put_in_objects(&mut self, file: u32, own: &mut Node, other: &Node) {
        let (Value::List(own), Value::List(others)) = (&mut own.value, &other.value) else { return };
        let mut added = Vec::new();
        for object in others {
            let Some(name) = object_name(object) else {
                added.push(object.clone());
                continue;
            };
            match own.iter().filter_map(object_name).find(|own| own.text == name.text) {
                None => added.push(object.clone()),
                Some(own) => self.compare(file, own, name),
            }
        }
        let n_included = own.iter().take_while(|object| object.place.file != file).count();
        own.splice(n_included..n_included, added);
    }

    /// `own` stands already where `other` was to be put.
    fn compare(&mut self, file: u32, own: &Key, other: &Key) {
        if own.place.file == file || own.place.file == other.place.file {
            return;
        }
        let path = |place: Place| self.sources.get(place.file as usize).map_or(String::new(), |source| file_name(&source.path));
        let message = format!("two included files give {:?}: {} and {}", other.text, path(own.place), path(other.place));
        let help = "give it in the including file, or rename one of the two";
        self.reader.mistakes.push(Mistake::new(other.place, message).help(help));
    }
}

fn object_name(object: &Node) -> Option<&Key> {
    match &object.value {
        Value::Map(entries) => entries.first().map(|(key, _)| key),
        _ => None,
    }
}

fn file_name(path: &Path) -> String {
    path.file_name().map_or_else(|| path.display().to_string(), |name| name.to_string_lossy().into_owned())
}

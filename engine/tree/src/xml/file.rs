//! One file: its XML, its places, and the files it includes.

use super::names;
use super::problem::{XmlFault, XmlPlace, XmlProblem, excerpt};
use super::text::{excess, repaired};
use super::{ImportOptions, Place, XmlModel};
use crate::nearest::nearest;
use crate::spec::SubtreeSpec;
use roxmltree::{Attribute, Document, Error, Node};
use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet};

/// More mistakes than this help nobody.
const N_PROBLEMS_MAX: usize = 1000;
/// Places count bytes in 32 bits, and repairing a file lengthens it.
const N_BYTES_MAX: usize = 512 << 20;
const N_FILES_MAX: usize = 256;
/// Nesting of includes; each level holds a file in memory.
const INCLUDE_DEPTH_MAX: usize = 16;

/// A problem before the line of its location is known.
pub(super) struct Draft {
    location: u32,
    text: String,
    fault: XmlFault,
    help: String,
}

/// What all files add to.
pub(super) struct Importer<'o> {
    pub(super) options: &'o ImportOptions<'o>,
    pub(super) places: Vec<Place>,
    pub(super) files: Vec<String>,
    /// The files around the current one.
    open: Vec<String>,
    n_bytes: usize,
    pub(super) trees: Vec<SubtreeSpec>,
    pub(super) tree_names: BTreeSet<String>,
    /// Subtrees that nodes name, and where.
    pub(super) uses: Vec<(String, u32)>,
    /// The tree to run as the first file names it.
    pub(super) main: Option<(String, u32)>,
    pub(super) models: Vec<XmlModel>,
    /// Where a model is among `models`, by whether it is a subtree's and by its name.
    pub(super) model_names: BTreeMap<(bool, String), usize>,
    problems: Vec<Draft>,
    warnings: Vec<Draft>,
}

impl<'o> Importer<'o> {
    pub(super) fn new(options: &'o ImportOptions<'o>) -> Self {
        Self {
            options,
            places: vec![Place { file: 0, line: 1, column: 1 }],
            files: Vec::new(),
            open: Vec::new(),
            n_bytes: 0,
            trees: Vec::new(),
            tree_names: BTreeSet::new(),
            uses: Vec::new(),
            main: None,
            models: Vec::new(),
            model_names: BTreeMap::new(),
            problems: Vec::new(),
            warnings: Vec::new(),
        }
    }

    /// Reads a file and what it includes. `location` is where it is asked for.
    pub(super) fn file(&mut self, text: &str, path: String, location: u32) {
        self.n_bytes = self.n_bytes.saturating_add(text.len());
        let limit = self.options.n_bytes_max.min(N_BYTES_MAX);
        if self.n_bytes > limit {
            return self.problem(location, &path, XmlFault::TooLarge { limit }, "split the tree, or raise the limit");
        }
        let file = self.files.len();
        if file >= N_FILES_MAX {
            let fault = XmlFault::TooMany { what: "files", limit: N_FILES_MAX };
            return self.problem(location, &path, fault, "put several trees into one file");
        }
        self.files.push(path.clone());
        self.open.push(path);
        // An element with a few attributes: about one place in 16 bytes.
        self.places.reserve(text.len() / 16);
        let mut reader = Reader { importer: self, file: index(file), spots: Vec::with_capacity(text.len() / 16) };
        let shifts = reader.read(text);
        let spots = std::mem::take(&mut reader.spots);
        self.resolve(text, spots, &shifts);
        self.open.pop();
    }

    /// Lines and columns of `spots` in one sweep: one line may hold the whole file.
    fn resolve(&mut self, text: &str, mut spots: Vec<(u32, u32)>, shifts: &[(usize, usize)]) {
        spots.sort_by_key(|(_, offset)| *offset);
        let bytes = text.as_bytes();
        let (mut at, mut line, mut column) = (0, 1, 1);
        for (location, offset) in spots {
            let offset = offset as usize;
            let n_before = shifts.partition_point(|(from, _)| *from < offset);
            let shift = n_before.checked_sub(1).map_or(0, |last| shifts[last].1);
            let end = offset.saturating_sub(shift).min(bytes.len()).max(at);
            for byte in &bytes[at..end] {
                if *byte == b'\n' {
                    (line, column) = (line + 1, 1);
                } else if byte & 0xC0 != 0x80 {
                    column += 1;
                }
            }
            at = end;
            let place = &mut self.places[location as usize];
            (place.line, place.column) = (line, column);
        }
    }

    /// Whether further problems would be dropped; then there is no use in looking for them.
    pub(super) fn is_full(&self) -> bool {
        self.problems.len() >= N_PROBLEMS_MAX
    }

    pub(super) fn has_problems(&self) -> bool {
        !self.problems.is_empty()
    }

    pub(super) fn problem(&mut self, location: u32, text: &str, fault: XmlFault, help: impl Into<String>) {
        if !self.is_full() {
            self.problems.push(Draft { location, text: excerpt(text), fault, help: help.into() });
        }
    }

    fn warn(&mut self, location: u32, text: &str, fault: XmlFault, help: impl Into<String>) {
        if self.warnings.len() < N_PROBLEMS_MAX {
            self.warnings.push(Draft { location, text: excerpt(text), fault, help: help.into() });
        }
    }

    /// Problems and warnings, each in the order of their places.
    pub(super) fn findings(&mut self) -> (Vec<XmlProblem>, Vec<XmlProblem>) {
        let (places, files) = (&self.places, &self.files);
        let placed = |drafts: Vec<Draft>| {
            let mut drafts: Vec<(Place, Draft)> =
                drafts.into_iter().map(|draft| (places[draft.location as usize], draft)).collect();
            drafts.sort_by_key(|(place, _)| *place);
            let finish = |(place, Draft { text, fault, help, .. }): (Place, Draft)| {
                let path = files.get(place.file as usize).cloned().unwrap_or_default();
                XmlProblem { place: XmlPlace::File { path, line: place.line, column: place.column }, text, fault, help }
            };
            drafts.into_iter().map(finish).collect()
        };
        (placed(std::mem::take(&mut self.problems)), placed(std::mem::take(&mut self.warnings)))
    }
}

/// Reads one file.
pub(super) struct Reader<'i, 'o> {
    pub(super) importer: &'i mut Importer<'o>,
    file: u32,
    /// Locations whose lines are not known yet, and their bytes.
    spots: Vec<(u32, u32)>,
}

impl Reader<'_, '_> {
    /// A new location.
    pub(super) fn at(&mut self, offset: usize) -> u32 {
        let location = index(self.importer.places.len());
        self.importer.places.push(Place { file: self.file, line: 1, column: 1 });
        self.spots.push((location, index(offset)));
        location
    }

    /// A problem of the value of `attribute`.
    pub(super) fn value_problem(&mut self, attribute: Attribute<'_, '_>, fault: XmlFault, help: impl Into<String>) {
        let location = self.at(attribute.range_value().start);
        self.importer.problem(location, attribute.value(), fault, help);
    }

    /// A problem of the name of `attribute`.
    pub(super) fn name_problem(&mut self, attribute: Attribute<'_, '_>, fault: XmlFault, help: impl Into<String>) {
        let location = self.at(attribute.range().start);
        self.importer.problem(location, attribute.name(), fault, help);
    }

    /// A problem of a whole element.
    pub(super) fn element_problem(&mut self, element: Node<'_, '_>, fault: XmlFault, help: impl Into<String>) {
        let location = self.at(element.range().start);
        self.importer.problem(location, element.tag_name().name(), fault, help);
    }

    /// Says that `attribute` is passed over.
    pub(super) fn warn_ignored<'k>(&mut self, attribute: Attribute<'_, '_>, known: impl IntoIterator<Item = &'k str>) {
        if self.importer.warnings.len() >= N_PROBLEMS_MAX {
            return;
        }
        let location = self.at(attribute.range().start);
        let help = match nearest(attribute.name(), known) {
            Some(near) => format!("did you mean {near:?}?"),
            None => "remove it".to_owned(),
        };
        self.importer.warn(location, attribute.name(), XmlFault::Ignored, help);
    }

    /// Says that text between elements is passed over.
    pub(super) fn warn_text(&mut self, child: Node<'_, '_>) {
        let text = child.text().unwrap_or_default();
        if child.is_text() && !text.trim().is_empty() {
            let n_blank = text.len() - text.trim_start().len();
            let location = self.at(child.range().start + n_blank);
            self.importer.warn(location, text.trim(), XmlFault::Ignored, "write a comment as <!-- ... -->");
        }
    }

    /// Reads the text; returns by how much bytes from some place on are shifted, see [`repaired`].
    fn read(&mut self, text: &str) -> Vec<(usize, usize)> {
        if let Some((offset, fault)) = excess(text) {
            let location = self.at(offset);
            self.importer.problem(location, "", fault, "no tree needs so many");
            return Vec::new();
        }
        let error = match Document::parse(text) {
            Ok(document) => {
                self.root(document.root_element());
                return Vec::new();
            }
            Err(error) => error,
        };
        // BehaviorTree.CPP's own examples have scripts such as `a && b` and `a < b`, which its parser lets pass.
        let repaired = repaired(text);
        if let Some((offset, fault)) = excess(&repaired.text) {
            let location = self.at(offset);
            self.importer.problem(location, "", fault, "no tree needs so many");
            return repaired.shifts;
        }
        match Document::parse(&repaired.text) {
            Ok(document) => self.root(document.root_element()),
            // There the letter was not the mistake.
            Err(later) if matches!(error, Error::MalformedEntityReference(_) | Error::UnknownEntityReference(..)) => {
                self.syntax(&repaired.text, &later);
                return repaired.shifts;
            }
            Err(_same) => {
                self.syntax(text, &error);
                return Vec::new();
            }
        }
        for (offset, letter, expected) in repaired.letters {
            let location = self.at(offset);
            self.importer.warn(location, letter, XmlFault::BareLetter { expected }, format!("write {expected}"));
        }
        repaired.shifts
    }

    fn syntax(&mut self, text: &str, error: &Error) {
        let place = error.pos();
        let n_lines_before = (place.row as usize).saturating_sub(1);
        let line_start: usize = text.split_inclusive('\n').take(n_lines_before).map(str::len).sum();
        let line = text[line_start..].lines().next().unwrap_or_default();
        let n_letters_before = (place.col as usize).saturating_sub(1);
        let offset = line.char_indices().nth(n_letters_before).map_or(line.len(), |(offset, _)| offset);
        let location = self.at(line_start + offset);
        let message = error.to_string().replace(&format!(" at {place}"), "");
        self.importer.problem(location, line[offset..].trim_end(), XmlFault::Syntax { message }, "correct the XML");
    }

    fn root(&mut self, root: Node<'_, '_>) {
        if root.tag_name().name() != "root" {
            let help = "put the trees into <root BTCPP_format=\"4\">";
            return self.element_problem(root, XmlFault::UnknownRoot, help);
        }
        let is_first = self.file == 0;
        match root.attribute_node("BTCPP_format") {
            None => {
                let location = self.at(root.range().start);
                self.importer.warn(location, "root", XmlFault::NoFormat, "write <root BTCPP_format=\"4\">");
            }
            Some(format) => match format.value() {
                "4" => {}
                "3" => return self.value_problem(format, XmlFault::Version3, "convert the file with convert_v3_to_v4.py"),
                _ => return self.value_problem(format, XmlFault::UnknownFormat, "only format 4 can be read"),
            },
        }
        for attribute in root.attributes().filter(|attribute| attribute.namespace().is_none()) {
            match attribute.name() {
                "main_tree_to_execute" if is_first => {
                    let location = self.at(attribute.range_value().start);
                    self.importer.main = Some((attribute.value().to_owned(), location));
                }
                "BTCPP_format" | "main_tree_to_execute" | "project_name" => {}
                name if name.starts_with('_') => {}
                _ => self.warn_ignored(attribute, ["BTCPP_format", "main_tree_to_execute"]),
            }
        }
        let mut n_palettes = 0;
        for child in root.children() {
            if !child.is_element() {
                self.warn_text(child);
                continue;
            }
            match child.tag_name().name() {
                "BehaviorTree" => self.behavior_tree(child),
                "include" => self.include(child),
                "TreeNodesModel" => {
                    n_palettes += 1;
                    if n_palettes == 2 {
                        let fault = XmlFault::TooMany { what: "<TreeNodesModel> in a file", limit: 1 };
                        self.element_problem(child, fault, "put all models into one");
                    }
                    self.palette(child);
                }
                name => {
                    let near = nearest(name, ["BehaviorTree", "include", "TreeNodesModel"]);
                    let help =
                        near.map_or("put nodes into a <BehaviorTree>".to_owned(), |near| format!("did you mean <{near}>?"));
                    self.element_problem(child, XmlFault::UnknownElement { parent: "root" }, help);
                }
            }
        }
    }

    fn include(&mut self, element: Node<'_, '_>) {
        if let Some(package) = element.attribute_node("ros_pkg") {
            return self.value_problem(package, XmlFault::RosPackage, "copy the file and give its path only");
        }
        let Some(path) = element.attribute_node("path").filter(|path| !path.value().is_empty()) else {
            return self.element_problem(element, XmlFault::MissingAttribute { attribute: "path" }, "write path=\"file.xml\"");
        };
        let importer = &*self.importer;
        let full = joined(importer.open.last().map_or("", String::as_str), path.value());
        if importer.open.contains(&full) {
            let chain = format!("{} -> {full}", importer.open.join(" -> ").trim_start_matches(" -> "));
            return self.value_problem(path, XmlFault::IncludeCycle { chain }, "remove this include");
        }
        if importer.files.contains(&full) {
            return;
        }
        if importer.open.len() > INCLUDE_DEPTH_MAX {
            let fault = XmlFault::TooMany { what: "includes in one another", limit: INCLUDE_DEPTH_MAX };
            return self.value_problem(path, fault, "include the files from the first one");
        }
        match (importer.options.load)(&full) {
            Ok(text) => {
                let location = self.at(path.range_value().start);
                self.importer.file(&text, full, location);
            }
            Err(message) => self.value_problem(path, XmlFault::Include { message }, "correct the path"),
        }
    }

    /// Refuses what only version 3 has; true if it was such a name.
    pub(super) fn is_version_3(&mut self, offset: usize, name: &str) -> bool {
        let Some(help) = names::version_3(name) else { return false };
        let location = self.at(offset);
        self.importer.problem(location, name, XmlFault::Version3, help);
        true
    }
}

/// `path` as seen from the folder of `from`, without `.` and, where that is possible, without `..`.
fn joined(from: &str, path: &str) -> String {
    let folder = from.rsplit_once('/').map_or("", |(folder, _)| folder);
    let path = if path.starts_with('/') || folder.is_empty() { Cow::from(path) } else { format!("{folder}/{path}").into() };
    let mut parts: Vec<&str> = Vec::new();
    for part in path.split('/').filter(|part| !matches!(*part, "" | ".")) {
        match parts.last() {
            Some(last) if part == ".." && *last != ".." => _ = parts.pop(),
            _ => parts.push(part),
        }
    }
    format!("{}{}", if path.starts_with('/') { "/" } else { "" }, parts.join("/"))
}

#[expect(clippy::cast_possible_truncation, reason = "bounded by the size of the files")]
pub(super) fn index(count: usize) -> u32 {
    count as u32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn check(from: &str, path: &str, expected: &str) {
        assert_eq!(joined(from, path), expected);
    }

    #[test]
    fn paths_are_seen_from_their_file() {
        check("", "doors.xml", "doors.xml");
        check("", "./parts//doors.xml", "parts/doors.xml");
        check("parts/doors.xml", "locks.xml", "parts/locks.xml");
        check("parts/doors.xml", "../main.xml", "main.xml");
        check("parts/doors.xml", "../../up.xml", "../up.xml");
        check("parts/doors.xml", "/all/doors.xml", "/all/doors.xml");
    }
}

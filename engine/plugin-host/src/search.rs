//! Where libraries are looked for. Nothing is loaded here: listing never runs a plugin's code.

use std::collections::BTreeSet;
use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};

/// Environment variable with folders and files, separated as in `PATH`.
pub const PATH_VARIABLE: &str = "SFG_PLUGIN_PATH";

/// The places to look at, first wins.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct SearchPath {
    places: Vec<Place>,
}

/// What was found.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Found {
    /// Libraries to load, in search order, by name within a folder.
    pub libraries: Vec<PathBuf>,
    /// What was passed over, and why.
    pub skipped: Vec<Skipped>,
}

/// A place or file that is not used.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Skipped {
    /// The place or file.
    pub path: PathBuf,
    /// Why.
    pub reason: SkipReason,
}

/// Why a place or file is not used.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum SkipReason {
    /// It was named and is not there.
    #[error("it does not exist")]
    Missing,
    /// The folder cannot be listed.
    #[error("it cannot be read: {0}")]
    Unreadable(String),
    /// A library with the same file name came first.
    #[error("{0:?} has the same name and comes first on the search path")]
    Shadowed(PathBuf),
}

#[derive(Clone, Debug, PartialEq, Eq)]
struct Place {
    path: PathBuf,
    /// Whether the user named it; the default folder may be absent without a word.
    named: bool,
}

impl SearchPath {
    /// The places in order: `explicit` files and folders, those in `variable` (the value of [`PATH_VARIABLE`]), `default_dir`.
    #[must_use]
    pub fn new(explicit: &[PathBuf], variable: Option<&OsStr>, default_dir: &Path) -> Self {
        let from_variable = variable.map(|value| std::env::split_paths(value).collect::<Vec<_>>()).unwrap_or_default();
        let named = explicit.iter().cloned().chain(from_variable).filter(|path| !path.as_os_str().is_empty());
        let mut places: Vec<Place> = named.map(|path| Place { path, named: true }).collect();
        places.push(Place { path: default_dir.to_owned(), named: false });
        Self { places }
    }

    /// The same, with the variable of this process and the folder `plugins` in the current folder.
    #[must_use]
    pub fn from_env(explicit: &[PathBuf]) -> Self {
        Self::new(explicit, std::env::var_os(PATH_VARIABLE).as_deref(), Path::new("plugins"))
    }

    /// Looks at every place. Folders are not searched deeper than one level.
    #[must_use]
    pub fn find(&self) -> Found {
        let mut found = Found::default();
        let mut seen = BTreeSet::new();
        for place in &self.places {
            let path = &place.path;
            if path.is_dir() {
                match libraries_in(path) {
                    Ok(files) => files.into_iter().for_each(|file| found.add(file, &mut seen)),
                    Err(error) => found.skip(path, SkipReason::Unreadable(error.to_string())),
                }
            } else if path.exists() {
                found.add(path.clone(), &mut seen);
            } else if place.named {
                found.skip(path, SkipReason::Missing);
            }
        }
        found
    }
}

impl Found {
    fn add(&mut self, file: PathBuf, seen: &mut BTreeSet<PathBuf>) {
        // The same file reached by two ways is one library, not a conflict.
        if !seen.insert(file.canonicalize().unwrap_or_else(|_| file.clone())) {
            return;
        }
        match self.libraries.iter().find(|earlier| earlier.file_name() == file.file_name()) {
            Some(earlier) => {
                let reason = SkipReason::Shadowed(earlier.clone());
                self.skip(&file, reason);
            }
            None => self.libraries.push(file),
        }
    }

    fn skip(&mut self, path: &Path, reason: SkipReason) {
        self.skipped.push(Skipped { path: path.to_owned(), reason });
    }
}

fn libraries_in(folder: &Path) -> std::io::Result<Vec<PathBuf>> {
    let mut files = Vec::new();
    for entry in fs::read_dir(folder)? {
        let path = entry?.path();
        if path.extension() == Some(OsStr::new(std::env::consts::DLL_EXTENSION)) && path.is_file() {
            files.push(path);
        }
    }
    files.sort();
    Ok(files)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "tests fail by panicking")]

    use super::*;

    fn names(paths: &[PathBuf]) -> Vec<&str> {
        paths.iter().map(|path| path.file_name().unwrap().to_str().unwrap()).collect()
    }

    #[test]
    fn the_first_place_wins_and_everything_passed_over_is_reported() {
        let root = tempfile::tempdir().unwrap();
        let place = |name: &str, files: &[&str]| {
            let folder = root.path().join(name);
            fs::create_dir(&folder).unwrap();
            files.iter().for_each(|file| fs::write(folder.join(file), "").unwrap());
            folder
        };
        let so = std::env::consts::DLL_SUFFIX;
        let (b, a, c) = (format!("b{so}"), format!("a{so}"), format!("c{so}"));
        let first = place("first", &[&b, &a, "readme.txt"]);
        let second = place("second", &[&a, &c]);
        let plugins = place("plugins", &[&c]);
        let absent = root.path().join("absent");
        let variable = std::env::join_paths([&second, &first, &absent]).unwrap();

        let found = SearchPath::new(&[first.join(&a), first.clone()], Some(&variable), &plugins).find();
        assert_eq!(names(&found.libraries), [&a, &b, &c]);
        let skipped = |path: PathBuf, reason| Skipped { path, reason };
        let expected = [
            skipped(second.join(&a), SkipReason::Shadowed(first.join(&a))),
            skipped(absent, SkipReason::Missing),
            skipped(plugins.join(&c), SkipReason::Shadowed(second.join(&c))),
        ];
        assert_eq!(found.skipped, expected);
    }

    #[test]
    fn an_absent_default_folder_is_no_mistake() {
        assert_eq!(SearchPath::new(&[], None, Path::new("no/such/folder")).find(), Found::default());
    }
}

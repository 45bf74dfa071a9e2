//! `sfg run --watch`: a scenario that is edited while it runs.

use crate::assets::Assets;
use crate::check::Checked;
use crate::say::{chain, say};
use sfg_scenario::Scenario;
use std::cell::Cell;
use std::path::Path;
use std::time::SystemTime;

/// Looks whether a file has changed.
pub(crate) struct Watch<'a> {
    assets: &'a Assets,
    path: &'a Path,
    /// The scenario around a tree in XML.
    scene: Option<&'a Path>,
    set: &'a [String],
    seen: Cell<Option<SystemTime>>,
}

impl<'a> Watch<'a> {
    /// Changes of the file at `path` from now on.
    pub(crate) fn new(assets: &'a Assets, path: &'a Path, scene: Option<&'a Path>, set: &'a [String]) -> Self {
        Self { assets, path, scene, set, seen: Cell::new(modified(path)) }
    }

    /// The scenario of a changed file. Its mistakes are printed, and the run goes on as it was.
    pub(crate) fn changed(&self) -> Option<Scenario> {
        let modified = modified(self.path);
        if modified == self.seen.replace(modified) || modified.is_none() {
            return None;
        }
        match Checked::load_in(self.assets, self.path, self.scene, self.set) {
            Ok(checked) => Some(checked.scenario),
            Err(error) => {
                say!("not reloaded: {}", chain(&error));
                None
            }
        }
    }
}

fn modified(path: &Path) -> Option<SystemTime> {
    std::fs::metadata(path).and_then(|metadata| metadata.modified()).ok()
}

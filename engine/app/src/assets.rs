//! The folder of robots, objects and scenarios, and the words that it makes known.

use crate::check::BadInput;
use anyhow::{Context as _, Result};
use sfg_geometry::ObjectModel;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// The asset folder with its object models.
#[derive(Clone, Debug)]
pub(crate) struct Assets {
    /// Where scenarios, robots and objects lie.
    pub(crate) folder: PathBuf,
    /// Declarative models by name.
    pub(crate) models: BTreeMap<String, ObjectModel>,
    /// Robot descriptions by name.
    pub(crate) robots: BTreeMap<String, PathBuf>,
}

impl Assets {
    /// Opens the given folder, or `scenarios` in the working folder, or the one the program was built with.
    pub(crate) fn open(folder: Option<&Path>) -> Result<Self> {
        let built_with = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenarios");
        let folder = match folder {
            Some(folder) => folder.to_owned(),
            None => [PathBuf::from("scenarios"), built_with].into_iter().find(|folder| folder.join("robots").is_dir()).context(
                "no asset folder found; run from the repository or give --assets FOLDER (it holds robots/ and objects/)",
            )?,
        };
        let mut models = BTreeMap::new();
        for path in yaml_files(&folder.join("objects"))? {
            let model = sfg_driver_sim::world::load_object_model(&path).map_err(|error| BadInput(error.to_string()))?;
            models.insert(stem(&path), model);
        }
        let mut robots = BTreeMap::new();
        for path in yaml_files(&folder.join("robots"))? {
            // Hand profiles lie beside the robots; only a robot has arms.
            let text = std::fs::read_to_string(&path).with_context(|| format!("cannot read {}", path.display()))?;
            if text.lines().any(|line| line.starts_with("arms:")) {
                robots.insert(stem(&path), path);
            }
        }
        if robots.is_empty() {
            return Err(BadInput(format!("{} holds no robot description", folder.join("robots").display())).into());
        }
        Ok(Self { folder, models, robots })
    }
}

fn stem(path: &Path) -> String {
    path.file_stem().unwrap_or_default().to_string_lossy().into_owned()
}

fn yaml_files(folder: &Path) -> Result<Vec<PathBuf>> {
    let entries = std::fs::read_dir(folder).map_err(|error| {
        let help = "give --assets a folder that holds robots/ and objects/";
        BadInput(format!("cannot read asset folder {}: {error}; {help}", folder.display()))
    })?;
    let mut files = Vec::new();
    for entry in entries {
        let path = entry.with_context(|| format!("cannot read asset folder {}", folder.display()))?.path();
        if path.extension().is_some_and(|extension| extension == "yaml") {
            files.push(path);
        }
    }
    files.sort();
    Ok(files)
}

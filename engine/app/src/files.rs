//! Files that a command leaves behind.

use anyhow::{Context as _, Result};
use std::io::Write as _;
use std::path::Path;

/// Writes a file whole or not at all: what stood there before stays until everything is on the disk.
pub(crate) fn write_whole(path: &Path, bytes: &[u8]) -> Result<()> {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let name = path.file_name().with_context(|| format!("cannot write {}: it is no name of a file", path.display()))?;
    let mut partial = name.to_owned();
    partial.push(".partial");
    let partial = folder.join(partial);
    let write = || -> std::io::Result<()> {
        std::fs::create_dir_all(folder)?;
        let mut file = std::fs::File::create(&partial)?;
        file.write_all(bytes)?;
        file.sync_all()?;
        std::fs::rename(&partial, path)
    };
    // What is left of a failed attempt helps nobody.
    write().inspect_err(|_| drop(std::fs::remove_file(&partial))).with_context(|| format!("cannot write {}", path.display()))
}

/// Writes to the file if there is one, else to standard output.
pub(crate) fn write_out(path: Option<&Path>, text: &str) -> Result<()> {
    match path {
        Some(path) => write_whole(path, text.as_bytes()),
        None => std::io::stdout().write_all(text.as_bytes()).context("cannot write to standard output"),
    }
}

#[cfg(test)]
mod tests {
    #![expect(clippy::unwrap_used, reason = "tests fail by panicking")]
    use super::write_whole;

    #[test]
    fn a_failed_write_leaves_nothing_behind() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::create_dir(folder.path().join("taken")).unwrap();
        assert!(write_whole(&folder.path().join("taken"), b"text").is_err());
        let names: Vec<_> = std::fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().file_name()).collect();
        assert_eq!(names, ["taken"]);
    }
}

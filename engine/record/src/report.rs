//! `report.json` and `report.html`, each written whole or not at all.

use crate::RecordError;
use crate::page::{Picture, render_page};
use sfg_types::RunReport;
use std::io::Write as _;
use std::path::Path;

/// Writes `report.json` into `folder`.
///
/// # Errors
/// [`RecordError`] when the folder cannot be written; an earlier report is then untouched.
pub fn write_report(folder: &Path, report: &RunReport) -> Result<(), RecordError> {
    let mut text = serde_json::to_vec_pretty(report).map_err(|source| RecordError::Encode { what: "the report", source })?;
    text.push(b'\n');
    write_whole(&folder.join("report.json"), &text)
}

/// Writes `report.html` and the pictures beside it.
///
/// # Errors
/// [`RecordError`] when the folder cannot be written.
pub fn write_page(folder: &Path, report: &RunReport, pictures: &[Picture]) -> Result<(), RecordError> {
    for picture in pictures {
        write_whole(&folder.join(format!("{}.png", picture.name)), &picture.png)?;
    }
    write_whole(&folder.join("report.html"), render_page(report, pictures).as_bytes())
}

/// Writes beside the target and renames, so that a reader never meets half a file.
fn write_whole(path: &Path, bytes: &[u8]) -> Result<(), RecordError> {
    let partial = path.with_extension("partial");
    let write = || -> std::io::Result<()> {
        let mut file = std::fs::File::create(&partial)?;
        file.write_all(bytes)?;
        file.sync_all()?;
        std::fs::rename(&partial, path)
    };
    write().map_err(|source| {
        // The rename did not happen, so what is left is ours alone.
        drop(std::fs::remove_file(&partial));
        RecordError::Io { path: path.to_owned(), source }
    })
}

#[cfg(test)]
mod tests {
    #![expect(clippy::unwrap_used, reason = "tests fail by panicking")]
    use super::*;
    use sfg_types::Outcome;

    pub(crate) fn report() -> RunReport {
        RunReport {
            schema_version: 1,
            scenario: "<pour>".to_owned(),
            scenario_sha256: "00".to_owned(),
            engine_version: "0.1.0".to_owned(),
            seed: 7,
            instruction: "pour & stir".to_owned(),
            outcome: Outcome::Success,
            failure: None,
            predicates: Vec::new(),
            judge: serde_json::Value::Null,
            stages: Vec::new(),
            duration_secs: 1.5,
            timings: serde_json::Value::Null,
        }
    }

    #[test]
    fn report_reads_back_and_leaves_no_partial_file() {
        let folder = tempfile::tempdir().unwrap();
        write_report(folder.path(), &report()).unwrap();
        let text = std::fs::read(folder.path().join("report.json")).unwrap();
        assert_eq!(serde_json::from_slice::<RunReport>(&text).unwrap(), report());
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn page_is_escaped_and_self_contained() {
        let folder = tempfile::tempdir().unwrap();
        write_page(folder.path(), &report(), &[Picture::new("views", "Both views", vec![1, 2, 3])]).unwrap();
        let page = std::fs::read_to_string(folder.path().join("report.html")).unwrap();
        assert!(page.contains("&lt;pour&gt;") && page.contains("pour &amp; stir") && !page.contains("<pour>"));
        assert!(page.contains("data:image/png;base64,AQID"));
        assert!(!page.contains("http"), "the page loads nothing");
        assert!(folder.path().join("views.png").exists());
    }

    #[test]
    fn an_unwritable_folder_is_an_error_with_its_path() {
        let error = write_report(Path::new("/nowhere"), &report()).unwrap_err();
        assert!(error.to_string().contains("/nowhere/report.json"), "{error}");
    }
}

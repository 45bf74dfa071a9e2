//! `report.json` and `report.html`, each written whole or not at all.

use crate::RecordError;
use crate::page::{PageParts, render_page};
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
pub fn write_page(folder: &Path, parts: &PageParts<'_>) -> Result<(), RecordError> {
    for picture in parts.pictures {
        write_whole(&folder.join(format!("{}.png", picture.name)), &picture.png)?;
    }
    write_whole(&folder.join("report.html"), render_page(parts).as_bytes())
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
    use crate::Picture;
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
            safety: sfg_types::SafetyReport::default(),
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

    fn page(report: &RunReport, pictures: &[Picture]) -> String {
        let folder = tempfile::tempdir().unwrap();
        let settings = [("weights_<sha>".to_owned(), "a&b".to_owned())];
        write_page(folder.path(), &PageParts { report, pictures, tree: None, settings: &settings }).unwrap();
        for picture in pictures {
            assert!(folder.path().join(format!("{}.png", picture.name)).exists());
        }
        std::fs::read_to_string(folder.path().join("report.html")).unwrap()
    }

    #[test]
    fn page_is_escaped_and_self_contained() {
        let page = page(&report(), &[Picture::new("views", "Both views", vec![1, 2, 3])]);
        assert!(page.contains("&lt;pour&gt;") && page.contains("pour &amp; stir") && !page.contains("<pour>"));
        assert!(page.contains("weights_&lt;sha&gt;") && page.contains("a&amp;b"));
        assert!(page.contains("data:image/png;base64,AQID"));
        assert!(!page.contains("http") && !page.contains("<script") && !page.contains("@import"), "the page loads nothing");
    }

    /// Every text of a report, filled with markup: none of it may reach the page as markup.
    #[test]
    fn no_text_of_a_report_becomes_markup() {
        let evil = "<img src=x onerror=alert(1)>\"'&";
        let mut report = report();
        for text in [&mut report.scenario, &mut report.scenario_sha256, &mut report.engine_version, &mut report.instruction] {
            *text = evil.to_owned();
        }
        report.failure = Some(sfg_types::RunFailure { reason: evil.into(), node: evil.into(), explanation: evil.into() });
        report.predicates = vec![sfg_types::PredicateResult {
            predicate: evil.into(),
            evaluator: evil.into(),
            passed: false,
            measured: evil.into(),
        }];
        report.judge = serde_json::json!({"state_hash": evil, evil: evil});
        report.timings = serde_json::json!({"stages": [[evil, 1.0]], "total_secs": 2.0});
        let stage = |name: &str, details| sfg_types::StageRecord {
            stage: name.to_owned(),
            stamp_secs: 0.5,
            failure: None,
            summary: evil.to_owned(),
            input_sha256: evil.to_owned(),
            details,
        };
        let candidate = serde_json::json!({
            "base_from_palm": {"rotation": [0.0, 0.0, 0.0, 1.0], "translation": [0.0, 0.0, 0.0]}, "hand_side": "left",
            "stability": 0.5, "synergy": {"c1": 0.0, "c2": 0.0}, "terms": [{"name": evil, "value": 0.5}],
        });
        let act = serde_json::json!({
            "object": {"cluster_id": 0, "name": evil}, "task": "pour", "target": {"cluster_id": 1, "name": evil}, "affordance": evil,
            "grasp_type": "large_diameter", "confidence": 0.9, "rationale": [evil],
        });
        let rejected = serde_json::json!([{"candidate_idx": 0, "reason": {"why": evil}}, {"candidate_idx": 1, "reason": {"why": "no_path", "segment": evil}}]);
        report.stages = vec![
            stage(evil, serde_json::json!({"x": evil})),
            stage("infer_functionality", act),
            stage("generate_palm_poses", serde_json::json!({"candidates": [candidate, candidate]})),
            stage("select_palm_pose", serde_json::json!({"chosen": 7, "rejected": rejected})),
        ];
        let page = page(&report, &[Picture::new("views", evil, vec![1])]);
        assert!(!page.contains("<img src=x") && !page.contains("onerror=alert(1)>\""), "{page}");
        assert_eq!(page.matches("<img ").count(), 1, "the one picture");
        assert!(page.matches("&lt;img src=x onerror=alert(1)&gt;").count() >= 20, "the texts are there, written out");
        report.stages[1].details = serde_json::json!({"choices": [evil]});
        report.stages[1].failure = Some(sfg_types::FailureReason::NeedsAnswer);
        let page = super::render_page(&PageParts { report: &report, pictures: &[], tree: None, settings: &[] });
        assert!(page.contains("It asked back") && !page.contains("<img"), "{page}");
    }

    #[test]
    fn the_page_tells_the_verdict_first_and_the_reasons_of_rejections() {
        let candidate = serde_json::json!({
            "base_from_palm": {"rotation": [0.0, 0.0, 0.0, 1.0], "translation": [0.0, 0.0, 0.0]}, "hand_side": "left",
            "stability": 0.5, "synergy": {"c1": 0.0, "c2": 0.0}, "terms": [{"name": "hold", "value": 0.25}, {"name": "gap_m", "value": 0.1}],
        });
        let stage = |name: &str, details| sfg_types::StageRecord {
            stage: name.to_owned(),
            stamp_secs: 0.75,
            failure: None,
            summary: "because".to_owned(),
            input_sha256: String::new(),
            details,
        };
        let mut report = report();
        report.stages = vec![
            stage("generate_palm_poses", serde_json::json!({"candidates": [candidate, candidate, candidate]})),
            stage(
                "select_palm_pose",
                serde_json::json!({"chosen": 1, "rejected": [
                {"candidate_idx": 0, "reason": {"why": "no_inverse_kinematics", "key_pose": "lift", "miss_m": 0.042}},
                {"candidate_idx": 2, "reason": {"why": "ranked_lower"}}]}),
            ),
        ];
        let page = page(&report, &[]);
        let place = |text: &str| page.find(text).unwrap_or_else(|| panic!("{text:?} is missing: {page}"));
        assert!(
            place("<h1>Success</h1>") < place("Candidate palm poses (3)") && place("✓ chosen") < place("✕ no arm configuration")
        );
        place("no arm configuration reaches the lift pose, best misses by 0.042 m");
        place("no inverse kinematics</span>");
        place("left:0.0%;width:50.0%");
    }

    #[test]
    fn an_unwritable_folder_is_an_error_with_its_path() {
        let error = write_report(Path::new("/nowhere"), &report()).unwrap_err();
        assert!(error.to_string().contains("/nowhere/report.json"), "{error}");
    }
}

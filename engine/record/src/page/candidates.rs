//! The candidate palm poses: terms of their scores, the chosen one, and why the others were not taken.

use super::text::{escape, percent, words};
use serde_json::Value;
use sfg_types::{PalmPoseCandidate, RejectionReason, RunReport};
use std::collections::BTreeMap;
use std::fmt::Write as _;

/// So many are shown at once; the others unfold.
const SHOWN: usize = 10;

/// One candidate and what became of it.
struct Row {
    idx: usize,
    candidate: PalmPoseCandidate,
    is_chosen: bool,
    rejected: Option<Value>,
}

pub(super) fn render(page: &mut String, report: &RunReport) {
    let rows = rows_of(report);
    if rows.is_empty() {
        return;
    }
    let _ = write!(page, "<section><h2>Candidate palm poses ({})</h2>", rows.len());
    render_counts(page, &rows);
    let terms: Vec<&str> = rows[0].candidate.terms.iter().map(|term| term.name.as_str()).collect();
    render_table(page, &rows[..rows.len().min(SHOWN)], &terms);
    if rows.len() > SHOWN {
        let _ = write!(page, "<details><summary>{} more</summary>", rows.len() - SHOWN);
        render_table(page, &rows[SHOWN..], &terms);
        page.push_str("</details>");
    }
    page.push_str("</section>");
}

/// The candidates of the last attempt: the chosen one first, then by stability.
fn rows_of(report: &RunReport) -> Vec<Row> {
    let Some(at) = report.stages.iter().rposition(|stage| stage.stage == "generate_palm_poses") else { return Vec::new() };
    let generated = report.stages[at].details["candidates"].as_array();
    let selection = report.stages[at..].iter().find(|stage| stage.stage == "select_palm_pose").map(|stage| &stage.details);
    let chosen = selection.and_then(|details| details["chosen"].as_u64());
    let rejected: BTreeMap<u64, Value> = selection
        .and_then(|details| details["rejected"].as_array())
        .into_iter()
        .flatten()
        .filter_map(|rejected| Some((rejected["candidate_idx"].as_u64()?, rejected["reason"].clone())))
        .collect();
    let mut rows: Vec<Row> = generated
        .into_iter()
        .flatten()
        .enumerate()
        .filter_map(|(idx, candidate)| {
            Some(Row {
                idx,
                candidate: serde_json::from_value(candidate.clone()).ok()?,
                is_chosen: chosen == Some(idx as u64),
                rejected: rejected.get(&(idx as u64)).cloned(),
            })
        })
        .collect();
    rows.sort_by(|a, b| b.is_chosen.cmp(&a.is_chosen).then(b.candidate.stability.total_cmp(&a.candidate.stability)));
    rows
}

/// A reason in words; one of a newer program by its tag.
fn reason_text(reason: &Value) -> String {
    serde_json::from_value::<RejectionReason>(reason.clone())
        .map_or_else(|_| reason["why"].as_str().unwrap_or("no reason given").replace('_', " "), |reason| reason.to_string())
}

/// How often each reason was given.
fn render_counts(page: &mut String, rows: &[Row]) {
    let mut counts: BTreeMap<&str, usize> = BTreeMap::new();
    for row in rows {
        let name = match &row.rejected {
            Some(reason) => reason["why"].as_str().unwrap_or("unknown"),
            None if row.is_chosen => "chosen",
            None => "not tried",
        };
        *counts.entry(name).or_default() += 1;
    }
    let mut counts: Vec<(&str, usize)> = counts.into_iter().collect();
    counts.sort_by(|a, b| b.1.cmp(&a.1).then(a.0.cmp(b.0)));
    page.push_str("<ul class=\"counts\">");
    for (name, n) in counts {
        let class = match name {
            "chosen" => "good",
            "ranked_lower" | "not tried" => "open",
            _ => "bad",
        };
        let share = percent(n as f64 / rows.len() as f64);
        let _ = write!(
            page,
            "<li class=\"{class}\"><span class=\"name\">{}</span><span class=\"track\"><span class=\"fill\" style=\"width:{share}\"></span></span><b>{n}</b></li>",
            words(name)
        );
    }
    page.push_str("</ul>");
}

fn render_table(page: &mut String, rows: &[Row], terms: &[&str]) {
    page.push_str("<div class=\"wide\"><table class=\"candidates\"><thead><tr><th>#</th><th>Stability</th>");
    for term in terms {
        let _ = write!(page, "<th>{}</th>", words(term));
    }
    page.push_str("<th>Outcome</th></tr></thead><tbody>");
    for row in rows {
        let _ = write!(page, "<tr{}><td>{}</td>", if row.is_chosen { " class=\"chosen\"" } else { "" }, row.idx + 1);
        render_value(page, row.candidate.stability, true);
        for term in terms {
            match row.candidate.terms.iter().find(|one| one.name == *term) {
                // Terms with a unit are no shares of one.
                Some(term) => render_value(page, term.value, !has_unit(&term.name)),
                None => page.push_str("<td></td>"),
            }
        }
        let _ = match (&row.rejected, row.is_chosen) {
            (_, true) => write!(page, "<td class=\"good\">✓ chosen</td></tr>"),
            (Some(reason), _) => {
                let is_lower = reason["why"] == "ranked_lower";
                let (class, glyph) = if is_lower { ("soft", "○") } else { ("bad", "✕") };
                write!(page, "<td class=\"{class}\">{glyph} {}</td></tr>", escape(&reason_text(reason)))
            }
            (None, false) => write!(page, "<td class=\"soft\">○ not tried</td></tr>"),
        };
    }
    page.push_str("</tbody></table></div>");
}

fn render_value(page: &mut String, value: f64, is_share: bool) {
    let _ = write!(page, "<td class=\"number\">{value:.2}");
    if is_share {
        let _ = write!(page, "<span class=\"meter\"><span style=\"width:{}\"></span></span>", percent(value));
    }
    page.push_str("</td>");
}

fn has_unit(name: &str) -> bool {
    ["_m", "_mm", "_rad", "_deg", "_secs", "_newtons", "_weights"].iter().any(|unit| name.ends_with(unit))
}

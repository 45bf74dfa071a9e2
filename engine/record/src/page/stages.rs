//! The stages in order, each with its time on the robot's clock as a bar, and what computing took.

use super::text::{escape, percent, secs, words};
use sfg_types::RunReport;
use std::fmt::Write as _;

pub(super) fn render(page: &mut String, report: &RunReport) {
    if report.stages.is_empty() {
        return;
    }
    let total_secs = report.duration_secs.max(report.stages.last().map_or(0.0, |stage| stage.stamp_secs)).max(1e-9);
    page.push_str(
        "<section><h2>Stages</h2><table class=\"stages\"><thead><tr><th>Stage</th><th class=\"bar\">On the robot's clock</th>\
         <th class=\"number\">Robot</th><th class=\"number\">Computing</th><th>What was decided, and why</th></tr></thead><tbody>",
    );
    let mut begun_secs = 0.0;
    for (idx, stage) in report.stages.iter().enumerate() {
        let (class, word) = stage.failure.map_or(("good", "ok"), |reason| ("bad", reason.name()));
        let took_secs = (stage.stamp_secs - begun_secs).max(0.0);
        let _ = write!(
            page,
            "<tr class=\"{class}\"><td><code>{}</code><br><span class=\"state {class}\">{} {word}</span></td>\
             <td class=\"bar\"><span class=\"track\"><span class=\"fill\" style=\"left:{};width:{}\"></span></span></td>\
             <td class=\"number\">{}</td><td class=\"number\">{}</td><td>{}</td></tr>",
            escape(&stage.stage),
            if class == "good" { "✓" } else { "✕" },
            percent(begun_secs / total_secs),
            percent(took_secs / total_secs),
            if took_secs > 0.0 { secs(took_secs) } else { "–".to_owned() },
            computing_secs(report, idx, &stage.stage).map_or_else(String::new, secs),
            escape(&stage.summary),
        );
        begun_secs = stage.stamp_secs;
    }
    page.push_str("</tbody></table>");
    render_timings(page, report);
    page.push_str("</section>");
}

/// Wall-clock time of the stage at `idx`, if the timings list it under the same name.
fn computing_secs(report: &RunReport, idx: usize, stage: &str) -> Option<f64> {
    let timed = &report.timings["stages"][idx];
    (timed[0].as_str() == Some(stage)).then(|| timed[1].as_f64()).flatten()
}

fn render_timings(page: &mut String, report: &RunReport) {
    let named = [
        ("ready_secs", "until the robot was ready"),
        ("decision_secs", "from the images to the decision"),
        ("first_motion_secs", "until it first moved"),
        ("total_secs", "in all"),
    ];
    let known: Vec<String> = named
        .iter()
        .filter_map(|(key, text)| Some(format!("<li><b>{}</b> {text}</li>", secs(report.timings[*key].as_f64()?))))
        .collect();
    if !known.is_empty() {
        let _ = write!(page, "<p class=\"soft\">Computing time (wall clock):</p><ul class=\"timings\">{}</ul>", known.concat());
    }
    let mut slowest: Vec<(&str, f64)> = report.timings["stages"]
        .as_array()
        .into_iter()
        .flatten()
        .filter_map(|stage| Some((stage[0].as_str()?, stage[1].as_f64()?)))
        .collect();
    slowest.sort_by(|a, b| b.1.total_cmp(&a.1));
    if let Some((stage, took)) = slowest.first() {
        let _ = write!(page, "<p class=\"soft\">Longest to compute: {} with {}.</p>", words(stage), secs(*took));
    }
}

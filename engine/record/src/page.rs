//! `report.html`: one run on one page, without a single outside reference.

use base64::Engine as _;
use sfg_types::{Outcome, RunReport};
use std::fmt::Write as _;

/// A picture of the run.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Picture {
    /// File name without extension.
    pub name: String,
    /// Sentence under it.
    pub caption: String,
    /// Encoded PNG.
    pub png: Vec<u8>,
}

impl Picture {
    /// A picture with its file name and caption.
    #[must_use]
    pub fn new(name: &str, caption: &str, png: Vec<u8>) -> Self {
        Self { name: name.to_owned(), caption: caption.to_owned(), png }
    }
}

const STYLE: &str = "\
:root{color-scheme:light dark;--line:#8884;--good:#2a7d46;--bad:#b3402e}\
body{font:16px/1.5 system-ui,sans-serif;max-width:70rem;margin:2rem auto;padding:0 1rem}\
h1{font-size:1.5rem}h2{font-size:1.15rem;margin-top:2rem}\
table{border-collapse:collapse;width:100%}td,th{border-bottom:1px solid var(--line);padding:.35rem .6rem;text-align:left;vertical-align:top}\
.good{color:var(--good);font-weight:600}.bad{color:var(--bad);font-weight:600}\
figure{margin:1.5rem 0}img{max-width:100%;height:auto;border-radius:6px}figcaption{opacity:.75}\
code,pre{font:13px/1.45 ui-monospace,monospace}pre{overflow:auto;max-height:24rem;border:1px solid var(--line);padding:.6rem;border-radius:6px}\
";

/// The page for `report`.
#[must_use]
pub(crate) fn render_page(report: &RunReport, pictures: &[Picture]) -> String {
    let mut page = String::new();
    let good = report.outcome == Outcome::Success;
    let outcome = format!("{:?}", report.outcome);
    let _ = write!(
        page,
        "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\"><meta name=\"viewport\" content=\"width=device-width\">\
         <title>{title}</title><style>{STYLE}</style>\
         <h1>{title}: <span class=\"{class}\">{outcome}</span></h1>\
         <p>“{instruction}” · seed {seed} · {duration:.1} s on the driver's clock · engine {version}</p>",
        title = escape(&report.scenario),
        class = if good { "good" } else { "bad" },
        outcome = escape(&outcome),
        instruction = escape(&report.instruction),
        seed = report.seed,
        duration = report.duration_secs,
        version = escape(&report.engine_version),
    );
    if let Some(failure) = &report.failure {
        let _ = write!(
            page,
            "<p class=\"bad\">{} at <code>{}</code>: {}</p>",
            escape(&failure.reason),
            escape(&failure.node),
            escape(&failure.explanation)
        );
    }
    page.push_str("<h2>Judged</h2><table><tr><th>Predicate<th>Evaluator<th>Measured<th></tr>");
    for predicate in &report.predicates {
        let _ = write!(
            page,
            "<tr><td>{}<td>{}<td>{}<td class=\"{}\">{}</tr>",
            escape(&predicate.predicate),
            escape(&predicate.evaluator),
            escape(&predicate.measured),
            if predicate.passed { "good" } else { "bad" },
            if predicate.passed { "holds" } else { "fails" },
        );
    }
    page.push_str("</table><h2>Stages</h2><table><tr><th>Time<th>Stage<th>What was decided, and why<th></tr>");
    for stage in &report.stages {
        let (class, word) = match stage.failure {
            None => ("good", "ok".to_owned()),
            Some(reason) => ("bad", reason.name().to_owned()),
        };
        let _ = write!(
            page,
            "<tr><td>{:.2} s<td><code>{}</code><td>{}<td class=\"{class}\">{word}</tr>",
            stage.stamp_secs,
            escape(&stage.stage),
            escape(&stage.summary),
        );
    }
    page.push_str("</table>");
    for picture in pictures {
        let _ = write!(
            page,
            "<figure><img alt=\"{caption}\" src=\"data:image/png;base64,{data}\"><figcaption>{caption}</figcaption></figure>",
            caption = escape(&picture.caption),
            data = base64::engine::general_purpose::STANDARD.encode(&picture.png),
        );
    }
    page.push_str("<h2>Details</h2>");
    for stage in &report.stages {
        let details = serde_json::to_string_pretty(&stage.details).unwrap_or_default();
        let _ = write!(
            page,
            "<details><summary><code>{}</code></summary><pre>{}</pre></details>",
            escape(&stage.stage),
            escape(&details)
        );
    }
    for (name, value) in [("judge", &report.judge), ("timings", &report.timings)] {
        let text = serde_json::to_string_pretty(value).unwrap_or_default();
        let _ = write!(page, "<details><summary><code>{name}</code></summary><pre>{}</pre></details>", escape(&text));
    }
    page.push_str("</html>\n");
    page
}

fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

//! `report.html`: one run on one page, without a single outside reference.
//!
//! The verdict comes first, then what led there: decision, pictures, candidates, stages, tree, numbers.

mod candidates;
mod decision;
mod outcome;
mod stages;
mod text;

pub use outcome::TreeOutcome;

use base64::Engine as _;
use sfg_types::{Outcome, RunReport};
use std::fmt::Write as _;
use text::{escape, secs};

/// A picture of the run.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Picture {
    /// File name without extension; those that begin with [`Picture::GROUNDING`] are shown together.
    pub name: String,
    /// Sentence under it.
    pub caption: String,
    /// Encoded PNG.
    pub png: Vec<u8>,
}

impl Picture {
    /// How the names of the pictures of one grounding begin: colour, depth and mask of each view.
    pub const GROUNDING: &'static str = "grounding_";

    /// A picture with its file name and caption.
    #[must_use]
    pub fn new(name: &str, caption: &str, png: Vec<u8>) -> Self {
        Self { name: name.to_owned(), caption: caption.to_owned(), png }
    }
}

/// What the page is made of.
#[derive(Clone, Copy, Debug)]
pub struct PageParts<'a> {
    /// The run.
    pub report: &'a RunReport,
    /// Its pictures, in the order in which they are shown.
    pub pictures: &'a [Picture],
    /// How each node of the tree went; `None` leaves the section out.
    pub tree: Option<&'a TreeOutcome>,
    /// Further settings by name: hashes, commit, plugins.
    pub settings: &'a [(String, String)],
}

const STYLE: &str = include_str!("page/style.css");

/// The page of a run.
#[must_use]
pub(crate) fn render_page(parts: &PageParts<'_>) -> String {
    let mut page = String::new();
    let title = format!("{} · seed {}", parts.report.scenario, parts.report.seed);
    let _ = write!(
        page,
        "<!doctype html><html lang=\"en\"><head><meta charset=\"utf-8\"><meta name=\"viewport\" content=\"width=device-width\">\
         <title>{}</title><style>{STYLE}</style></head><body><main>",
        escape(&title)
    );
    render_verdict(&mut page, parts.report);
    decision::render(&mut page, parts.report);
    render_pictures(&mut page, parts.pictures);
    candidates::render(&mut page, parts.report);
    stages::render(&mut page, parts.report);
    if let Some(tree) = parts.tree {
        tree.render(&mut page);
    }
    render_settings(&mut page, parts);
    render_details(&mut page, parts.report);
    page.push_str("</main></body></html>\n");
    page
}

/// Class of the colour, headline and explanation of an outcome.
fn verdict_of(outcome: Outcome) -> (&'static str, &'static str, &'static str) {
    match outcome {
        Outcome::Success => ("good", "Success", "The tree succeeded and everything that was to be true is true."),
        Outcome::JudgedFailure => ("bad", "Judged a failure", "The tree succeeded, but a predicate does not hold."),
        Outcome::TreeFailure => ("bad", "Failed", "The tree failed before the task was done."),
        Outcome::NotAttempted => ("open", "Not attempted", "The sentence was asked back or refused; nothing was grasped."),
        Outcome::Interrupted => ("open", "Interrupted", "The run was stopped from outside; the robot was halted."),
        Outcome::PhysicsTampered => ("bad", "Invalid", "The judge found the physics manipulated."),
    }
}

fn render_verdict(page: &mut String, report: &RunReport) {
    let (class, word, meaning) = verdict_of(report.outcome);
    let _ = write!(
        page,
        "<header class=\"verdict {class}\"><p class=\"scenario\">{}</p><h1>{word}</h1><p class=\"said\">“{}”</p><p>{meaning}</p>",
        escape(&report.scenario),
        escape(&report.instruction),
    );
    if let Some(failure) = &report.failure {
        let _ = write!(
            page,
            "<p class=\"why\"><strong>{}</strong> at <code>{}</code>: {}</p>",
            escape(&failure.reason),
            escape(&failure.node),
            escape(&failure.explanation)
        );
    }
    let wall = report.timings["total_secs"].as_f64();
    let _ = write!(page, "<dl class=\"facts\"><div><dt>Robot time</dt><dd>{}</dd></div>", secs(report.duration_secs));
    if let Some(wall) = wall {
        let _ = write!(page, "<div><dt>Computing time</dt><dd>{}</dd></div>", secs(wall));
    }
    if let Some(decision) = report.timings["decision_secs"].as_f64() {
        let _ = write!(page, "<div><dt>Images to grasp decision</dt><dd>{}</dd></div>", secs(decision));
    }
    let _ = write!(
        page,
        "<div><dt>Seed</dt><dd>{}</dd></div><div><dt>Engine</dt><dd>{}</dd></div></dl></header>",
        report.seed,
        escape(&report.engine_version)
    );
    if report.predicates.is_empty() {
        return;
    }
    page.push_str("<section><h2>What was judged</h2><ul class=\"checks\">");
    for predicate in &report.predicates {
        let (class, glyph, word) = if predicate.passed { ("good", "✓", "holds") } else { ("bad", "✕", "does not hold") };
        let _ = write!(
            page,
            "<li class=\"{class}\"><span class=\"glyph\">{glyph}</span><div><code>{}</code> {word} <span class=\"soft\">· {}</span><br>{}</div></li>",
            escape(&predicate.predicate),
            escape(&predicate.evaluator),
            escape(&predicate.measured),
        );
    }
    page.push_str("</ul></section>");
}

fn render_pictures(page: &mut String, pictures: &[Picture]) {
    let (grounding, others): (Vec<&Picture>, Vec<&Picture>) =
        pictures.iter().partition(|picture| picture.name.starts_with(Picture::GROUNDING));
    if !grounding.is_empty() {
        page.push_str("<section><h2>What the cameras saw, and the part to hold</h2><div class=\"six\">");
        grounding.iter().for_each(|picture| render_figure(page, picture));
        page.push_str("</div></section>");
    }
    if !others.is_empty() {
        page.push_str("<section><h2>The grasp and its result</h2><div class=\"pictures\">");
        others.iter().for_each(|picture| render_figure(page, picture));
        page.push_str("</div></section>");
    }
}

fn render_figure(page: &mut String, picture: &Picture) {
    let _ = write!(
        page,
        "<figure id=\"{name}\"><img alt=\"{caption}\" src=\"data:image/png;base64,{data}\"><figcaption>{caption}</figcaption></figure>",
        name = escape(&picture.name),
        caption = escape(&picture.caption),
        data = base64::engine::general_purpose::STANDARD.encode(&picture.png),
    );
}

fn render_settings(page: &mut String, parts: &PageParts<'_>) {
    let report = parts.report;
    page.push_str("<section><h2>Settings and hashes</h2><table class=\"pairs\">");
    let own = [
        ("scenario_sha256", report.scenario_sha256.clone()),
        ("seed", report.seed.to_string()),
        ("engine_version", report.engine_version.clone()),
        ("report layout", report.schema_version.to_string()),
    ];
    let state_hash = report.judge["state_hash"].as_str().map(|hash| ("state_hash at the end", hash.to_owned()));
    let known: Vec<(&str, String)> = own.into_iter().chain(state_hash).collect();
    let further = parts.settings.iter().filter(|(name, _)| !known.iter().any(|(one, _)| one == name));
    for (name, value) in
        known.iter().map(|(name, value)| (*name, value)).chain(further.map(|(name, value)| (name.as_str(), value)))
    {
        let _ = write!(page, "<tr><th>{}</th><td><code>{}</code></td></tr>", escape(name), escape(value));
    }
    page.push_str("</table></section>");
}

fn render_details(page: &mut String, report: &RunReport) {
    page.push_str("<section class=\"raw\"><h2>Everything that was kept</h2>");
    let stages = report.stages.iter().map(|stage| (stage.stage.as_str(), &stage.details, stage.input_sha256.as_str()));
    for (name, value, hash) in stages.chain([("judge", &report.judge, ""), ("timings", &report.timings, "")]) {
        if value.is_null() {
            continue;
        }
        let json = serde_json::to_string_pretty(value).unwrap_or_default();
        let hash =
            if hash.is_empty() { String::new() } else { format!(" <span class=\"soft\">decided on {}</span>", escape(hash)) };
        let _ =
            write!(page, "<details><summary><code>{}</code>{hash}</summary><pre>{}</pre></details>", escape(name), escape(&json));
    }
    page.push_str("</section>");
}

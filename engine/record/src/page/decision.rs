//! What the sentence was understood as, and why.

use super::text::{escape, percent, words};
use serde_json::Value;
use sfg_types::{GraspFunctionality, RunReport, StageRecord};
use std::fmt::Write as _;

const STAGE: &str = "infer_functionality";

pub(super) fn render(page: &mut String, report: &RunReport) {
    // A retry decides anew: the last decision is the one that was acted on.
    let Some(stage) = report.stages.iter().rfind(|stage| stage.stage == STAGE) else { return };
    page.push_str("<section><h2>What was understood</h2>");
    match serde_json::from_value::<GraspFunctionality>(stage.details.clone()) {
        Ok(functionality) => render_act(page, &functionality),
        Err(_) => render_other(page, stage),
    }
    page.push_str("</section>");
}

fn render_act(page: &mut String, functionality: &GraspFunctionality) {
    let target = functionality.target.as_ref().map_or("–", |target| target.name.as_str());
    let facts = [
        ("Task", functionality.task.name()),
        ("Object", functionality.object.name.as_str()),
        ("Target", target),
        ("Part to hold", functionality.affordance.as_str()),
        ("Grasp type", functionality.grasp_type.name()),
    ];
    page.push_str("<dl class=\"facts\">");
    for (name, value) in facts {
        let _ = write!(page, "<div><dt>{name}</dt><dd>{}</dd></div>", words(value));
    }
    let confidence = functionality.confidence;
    let _ = write!(
        page,
        "<div><dt>Confidence</dt><dd>{confidence:.2}<span class=\"meter\"><span style=\"width:{}\"></span></span></dd></div></dl><ol class=\"why\">",
        percent(confidence)
    );
    for step in &functionality.rationale {
        let _ = write!(page, "<li>{}</li>", escape(step));
    }
    page.push_str("</ol>");
}

/// A question, a refusal or a failure of the backend.
fn render_other(page: &mut String, stage: &StageRecord) {
    let word = match stage.failure.map(sfg_types::FailureReason::name) {
        Some("needs_answer") => "It asked back",
        Some("refused") => "It refused",
        Some(_) => "It failed",
        None => "It answered",
    };
    let _ = write!(page, "<p><strong>{word}:</strong> {}</p>", escape(&stage.summary));
    if let Value::Array(choices) = &stage.details["choices"] {
        page.push_str("<ul>");
        for choice in choices.iter().filter_map(Value::as_str) {
            let _ = write!(page, "<li>{}</li>", escape(choice));
        }
        page.push_str("</ul>");
    }
}

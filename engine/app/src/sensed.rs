//! Success predicates on what the robot itself measured.

use sfg_scenario::Predicate;
use sfg_skills::SkillContext;
use sfg_skills::grasp::verify_grasp::grasp_evidence;
use sfg_tree::Literal;
use sfg_types::PredicateResult;

/// Names and arguments of the sensed predicates.
pub(crate) const PREDICATES: &[(&str, &[&str])] = &[("fill_seen", &["at_least_ml"]), ("holding_felt", &[])];

fn number(predicate: &Predicate, name: &str) -> Option<f64> {
    match predicate.arg(name).map(|arg| &arg.value)? {
        Literal::Int(value) => Some(*value as f64),
        Literal::Float(value) => Some(*value),
        _ => None,
    }
}

/// Judges one predicate from the log of stages and the motors.
pub(crate) fn evaluate(predicate: &Predicate, skills: &SkillContext) -> PredicateResult {
    let (passed, measured) = match predicate.name.as_str() {
        "fill_seen" => {
            let least_ml = number(predicate, "at_least_ml").unwrap_or(f64::INFINITY);
            let gain_ml = skills
                .log
                .records()
                .iter()
                .rev()
                .find(|stage| stage.stage == "pour" && stage.failure.is_none())
                .and_then(|stage| stage.details["gains_secs_ml"].as_array()?.last()?.get(1)?.as_f64());
            match gain_ml {
                Some(gain_ml) => (gain_ml >= least_ml, format!("{gain_ml:.0} ml seen, {least_ml:.0} ml asked")),
                None => (false, "nothing was poured".to_owned()),
            }
        }
        "holding_felt" => {
            let evidence = grasp_evidence(&skills.robot.state().hand, skills.synergy.profile());
            (evidence.is_holding, format!("motor current {:.0} % of stall", 100.0 * evidence.current_share))
        }
        other => (false, format!("no evaluator for {other:?}")),
    };
    PredicateResult { predicate: predicate.name.clone(), evaluator: "sensed".to_owned(), passed, measured }
}

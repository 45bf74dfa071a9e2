//! Where two runs begin to differ, and which decisions are others.

use crate::RecordError;
use crate::log_file::LogFile;
use serde_json::Value;

/// How two recordings differ.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Difference {
    /// The first tick whose status changes are others.
    pub tick: Option<TickDifference>,
    /// Decisions that are others, in the order of a run.
    pub decisions: Vec<DecisionDifference>,
}

/// The first tick that differs.
#[derive(Clone, Debug, PartialEq)]
pub struct TickDifference {
    /// Number of the tick.
    pub tick: u64,
    /// Its time in the first run, or in the second when the first had ended.
    pub now_secs: f64,
    /// Status changes of the first run in it.
    pub a: Vec<String>,
    /// Of the second.
    pub b: Vec<String>,
}

/// A decision that came out otherwise.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DecisionDifference {
    /// What was decided: `grasp type`, `palm pose`, `outcome`.
    pub what: String,
    /// In the first run.
    pub a: String,
    /// In the second.
    pub b: String,
}

impl Difference {
    /// Whether both runs went the same way.
    #[must_use]
    pub fn is_none(&self) -> bool {
        self.tick.is_none() && self.decisions.is_empty()
    }
}

/// Compares two recordings.
///
/// # Errors
/// [`RecordError::Unreadable`] when a message is broken.
pub fn diff(a: &LogFile, b: &LogFile) -> Result<Difference, RecordError> {
    Ok(Difference { tick: first_tick(&ticks(a)?, &ticks(b)?), decisions: decisions(a, b)? })
}

struct TickChanges {
    tick: u64,
    now_secs: f64,
    changes: Vec<String>,
}

/// Status changes by tick; ticks without any are left out.
fn ticks(file: &LogFile) -> Result<Vec<TickChanges>, RecordError> {
    let mut ticks: Vec<TickChanges> = Vec::new();
    for (_, change) in file.json("/tree")? {
        let text = |key: &str| change[key].as_str().unwrap_or("?").to_owned();
        let reason = change["reason"].as_str().map_or(String::new(), |reason| format!(" ({reason})"));
        let line = format!("{} {} -> {}{reason}", text("node"), text("from"), text("to"));
        let tick = change["tick"].as_u64().unwrap_or(0);
        let now_secs = change["stamp_secs"].as_f64().unwrap_or(0.0);
        match ticks.last_mut() {
            Some(last) if last.tick == tick => last.changes.push(line),
            _ => ticks.push(TickChanges { tick, now_secs, changes: vec![line] }),
        }
    }
    Ok(ticks)
}

fn first_tick(a: &[TickChanges], b: &[TickChanges]) -> Option<TickDifference> {
    let is_same = |(a, b): &(&TickChanges, &TickChanges)| a.tick == b.tick && a.changes == b.changes;
    let n_same = a.iter().zip(b).take_while(is_same).count();
    let (a, b) = (a.get(n_same), b.get(n_same));
    // The earlier of the two ticks is the one in which only one run changed something.
    let tick = [a, b].into_iter().flatten().map(|tick| tick.tick).min()?;
    let of_tick =
        |found: Option<&TickChanges>| found.filter(|found| found.tick == tick).map_or(Vec::new(), |found| found.changes.clone());
    let now_secs = [a, b].into_iter().flatten().find(|found| found.tick == tick).map_or(0.0, |found| found.now_secs);
    Some(TickDifference { tick, now_secs, a: of_tick(a), b: of_tick(b) })
}

fn decisions(a: &LogFile, b: &LogFile) -> Result<Vec<DecisionDifference>, RecordError> {
    let (theirs, ours) = (decided(a)?, decided(b)?);
    let mut found = Vec::new();
    for idx in 0..theirs.len().max(ours.len()) {
        let none = (String::new(), "-".to_owned());
        let (one, other) = (theirs.get(idx).unwrap_or(&none), ours.get(idx).unwrap_or(&none));
        if one != other {
            let what = if one.0.is_empty() { other.0.clone() } else { one.0.clone() };
            let text = |decision: &(String, String)| {
                if decision.0 == what || decision.0.is_empty() {
                    decision.1.clone()
                } else {
                    format!("{}: {}", decision.0, decision.1)
                }
            };
            found.push(DecisionDifference { a: text(one), b: text(other), what });
        }
    }
    Ok(found)
}

/// What was decided, in order: name and value.
fn decided(file: &LogFile) -> Result<Vec<(String, String)>, RecordError> {
    let mut decided = Vec::new();
    for (_, message) in file.json("/functionality")? {
        let answer = &message["answer"];
        match answer.as_object().and_then(|answer| answer.iter().next()) {
            Some((kind, act)) if kind == "act" => {
                for (what, value) in
                    [("object", &act["object"]["name"]), ("part", &act["affordance"]), ("grasp type", &act["grasp_type"])]
                {
                    decided.push((what.to_owned(), plain(value)));
                }
            }
            Some((kind, value)) => decided.push(("answer".to_owned(), format!("{kind}: {}", plain(value)))),
            None => {}
        }
    }
    for (_, message) in file.json("/candidates")? {
        let Some(idx) = message["chosen"].as_u64() else { continue };
        let at = &message["candidates"][idx as usize]["base_from_palm"]["translation"];
        let place: Vec<String> = (0..3).filter_map(|axis| at[axis].as_f64()).map(|value| format!("{value:.4}")).collect();
        decided.push(("palm pose".to_owned(), format!("candidate {} at ({}) m", idx + 1, place.join(", "))));
    }
    for (_, message) in file.json("/verdict")? {
        decided.push(("outcome".to_owned(), plain(&message["outcome"])));
        for predicate in message["predicates"].as_array().into_iter().flatten() {
            let holds = if predicate["passed"] == true { "holds" } else { "fails" };
            decided.push((plain(&predicate["predicate"]), holds.to_owned()));
        }
    }
    Ok(decided)
}

fn plain(value: &Value) -> String {
    value.as_str().map_or_else(|| value.to_string(), str::to_owned)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ticks_of(all: &[(u64, &str)]) -> Vec<TickChanges> {
        all.iter().map(|(tick, change)| TickChanges { tick: *tick, now_secs: 0.1, changes: vec![(*change).to_owned()] }).collect()
    }

    #[test]
    fn the_first_tick_that_differs_is_found() {
        let a = ticks_of(&[(1, "a"), (4, "b"), (9, "c")]);
        assert_eq!(first_tick(&a, &ticks_of(&[(1, "a"), (4, "b"), (9, "c")])), None);
        let other = first_tick(&a, &ticks_of(&[(1, "a"), (4, "x")]));
        assert_eq!(other.map(|found| (found.tick, found.a, found.b)), Some((4, vec!["b".to_owned()], vec!["x".to_owned()])));
        let earlier = first_tick(&a, &ticks_of(&[(1, "a"), (3, "b")]));
        assert_eq!(earlier.map(|found| (found.tick, found.a, found.b)), Some((3, Vec::new(), vec!["b".to_owned()])));
        let shorter = first_tick(&a, &ticks_of(&[(1, "a")]));
        assert_eq!(shorter.map(|found| (found.tick, found.b)), Some((4, Vec::new())));
    }
}

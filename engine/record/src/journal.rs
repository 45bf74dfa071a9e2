//! The journal of a tree in `run.mcap`: enough to let the tree decide again.

use crate::log_file::LogFile;
use crate::messages::{JournalTick, Transition, Write};
use crate::{RecordError, Recording};
use serde_json::{Value, json};
use sfg_tree::{Failure, Literal, NamedChange, NamedRecord, Status};
use std::path::Path;

/// Topic of the journal: one message a tick.
pub(crate) const TOPIC: &str = "/journal";

impl Recording {
    /// Records what happened in a tree since the last call: `/journal`, `/tree` and `/blackboard`. Flushes when a status
    /// changed, so that the reason of a crash is in the file.
    ///
    /// # Errors
    /// [`RecordError`] when the file cannot be written.
    pub fn changes(&mut self, records: &[NamedRecord]) -> Result<(), RecordError> {
        self.journal(records)?;
        let (mut failure, mut is_changed) = (None, false);
        for record in records {
            let (stamp_secs, tick, node) = (record.now_secs, record.tick_idx, record.path.clone());
            match &record.change {
                NamedChange::Failed(found) => failure = Some((&record.path, found)),
                NamedChange::Status { from, to } => {
                    let why = failure.take_if(|(path, _)| *path == &record.path && *to == Status::Failure);
                    is_changed = true;
                    self.write(
                        stamp_secs,
                        &Transition {
                            stamp_secs,
                            tick,
                            node,
                            from: from.name().to_owned(),
                            to: to.name().to_owned(),
                            reason: why.map(|(_, failure)| failure.reason.to_string()),
                            detail: why.map(|(_, failure)| failure.detail.clone()),
                        },
                    )?;
                }
                NamedChange::Write { key, value } => {
                    let value = value.as_ref().map_or(Value::Null, json_of);
                    self.write(stamp_secs, &Write { stamp_secs, tick, node, key: key.clone(), value })?;
                }
                NamedChange::Ticked | NamedChange::HaltAsked | NamedChange::Forced(_) | NamedChange::Postponed { .. } => {}
            }
        }
        match records.last() {
            Some(last) if is_changed => self.flush(last.now_secs),
            _ => Ok(()),
        }
    }

    fn journal(&mut self, records: &[NamedRecord]) -> Result<(), RecordError> {
        let mut begin = 0;
        for end in 1..=records.len() {
            let is_step = |at: usize| matches!(records[at].change, NamedChange::Ticked | NamedChange::HaltAsked);
            if end == records.len() || is_step(end) {
                let tick = message(&records[begin..end]);
                self.write(tick.now_secs, &tick)?;
                begin = end;
            }
        }
        Ok(())
    }
}

fn message(records: &[NamedRecord]) -> JournalTick {
    let change = |record: &NamedRecord| match &record.change {
        NamedChange::Status { from, to } => Some(json!(["status", record.path, from.name(), to.name()])),
        NamedChange::Failed(failure) => Some(json!(["failed", record.path, failure.reason, failure.detail])),
        NamedChange::Forced(Ok(())) => Some(json!(["forced", record.path, "success"])),
        NamedChange::Forced(Err(failure)) => Some(json!(["forced", record.path, "failure", failure.reason, failure.detail])),
        NamedChange::Postponed { secs } => Some(json!(["postponed", record.path, secs])),
        NamedChange::Write { key, value } => Some(json!(["wrote", record.path, key, value.as_ref().map(json_of)])),
        NamedChange::Ticked | NamedChange::HaltAsked => None,
    };
    JournalTick {
        tick: records[0].tick_idx,
        now_secs: records[0].now_secs,
        halt: matches!(records[0].change, NamedChange::HaltAsked),
        // Written by the application before the first tick.
        before: !matches!(records[0].change, NamedChange::Ticked | NamedChange::HaltAsked),
        changes: records.iter().filter_map(change).collect(),
    }
}

/// A literal as JSON.
#[must_use]
pub fn json_of(literal: &Literal) -> Value {
    match literal {
        Literal::Bool(value) => json!(value),
        Literal::Int(value) => json!(value),
        Literal::Float(value) => json!(value),
        Literal::Text(value) => json!(value),
        Literal::List(items) => Value::Array(items.iter().map(json_of).collect()),
        Literal::Map(items) => Value::Object(items.iter().map(|(key, value)| (key.clone(), json_of(value))).collect()),
    }
}

/// JSON as a literal; nothing for `null`.
#[must_use]
pub fn literal_of(json: &Value) -> Option<Literal> {
    match json {
        Value::Null => None,
        Value::Bool(value) => Some(Literal::Bool(*value)),
        Value::Number(number) => Some(match number.as_i64() {
            Some(number) => Literal::Int(number),
            None => Literal::Float(number.as_f64().unwrap_or(f64::MAX)),
        }),
        Value::String(text) => Some(Literal::Text(text.clone())),
        Value::Array(items) => items.iter().map(literal_of).collect::<Option<_>>().map(Literal::List),
        Value::Object(items) => {
            let pairs = items.iter().map(|(key, value)| Some((key.clone(), literal_of(value)?)));
            pairs.collect::<Option<_>>().map(Literal::Map)
        }
    }
}

/// What `run.mcap` tells about a run: the metadata it begins with and the journal of its tree.
#[derive(Clone, Debug, Default)]
pub struct RecordedRun {
    /// Scenario, seed, hashes.
    pub metadata: std::collections::BTreeMap<String, String>,
    /// The journal in order.
    pub journal: Vec<NamedRecord>,
    /// Whether the file was read to its end.
    pub is_whole: bool,
}

/// Reads a recording, also one that was cut off: what is there is read.
///
/// # Errors
/// [`RecordError::Unreadable`] when the file is missing, is no recording or has no journal.
pub fn read_run(path: &Path) -> Result<RecordedRun, RecordError> {
    let file = LogFile::open(path)?;
    let unreadable = |message: String| RecordError::Unreadable { path: path.to_owned(), message };
    let mut run = RecordedRun { metadata: file.metadata.clone(), is_whole: file.is_whole, ..RecordedRun::default() };
    let ticks = file.json(TOPIC)?;
    if ticks.is_empty() {
        return Err(unreadable(format!(
            "it has no {TOPIC}: it is damaged, cut off at its beginning, or was recorded by an older program"
        )));
    }
    for (_, tick) in &ticks {
        read_message(tick, &mut run.journal).map_err(|error| unreadable(format!("a message of {TOPIC}: {error}")))?;
    }
    Ok(run)
}

fn read_message(message: &Value, journal: &mut Vec<NamedRecord>) -> Result<(), String> {
    let tick_idx = message["tick"].as_u64().ok_or("\"tick\": expected a whole number")?;
    let now_secs = message["now_secs"].as_f64().ok_or("\"now_secs\": expected a number")?;
    let mut push = |path: &str, change| journal.push(NamedRecord { tick_idx, now_secs, path: path.to_owned(), change });
    if message["halt"] == true {
        push("", NamedChange::HaltAsked);
    } else if message["before"] != true {
        push("", NamedChange::Ticked);
    }
    for change in message["changes"].as_array().into_iter().flatten() {
        let text = |at: usize| change[at].as_str().ok_or_else(|| format!("a change has no text at place {at}"));
        let path = text(1)?;
        let change = match text(0)? {
            "status" => NamedChange::Status { from: status(text(2)?)?, to: status(text(3)?)? },
            "forced" if text(2)? == "success" => NamedChange::Forced(Ok(())),
            "forced" => NamedChange::Forced(Err(Failure::new(text(3)?.to_owned(), text(4)?))),
            "postponed" => NamedChange::Postponed { secs: change[2].as_f64().ok_or("\"postponed\": expected a number")? },
            "failed" => NamedChange::Failed(Failure::new(text(2)?.to_owned(), text(3)?)),
            "wrote" => NamedChange::Write { key: text(2)?.to_owned(), value: literal_of(&change[3]) },
            other => return Err(format!("{other:?} is no kind of change")),
        };
        push(path, change);
    }
    Ok(())
}

fn status(name: &str) -> Result<Status, String> {
    let all = [Status::Idle, Status::Running, Status::Success, Status::Failure, Status::Skipped];
    all.into_iter().find(|status| status.name() == name).ok_or_else(|| format!("{name:?} is no status"))
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "tests fail by panicking")]
    use super::*;
    use sfg_types::{HandCommand, RobotState};
    use std::collections::BTreeMap;

    #[test]
    fn a_journal_comes_back_as_it_was_written() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.mcap");
        let record = |tick_idx: u64, path: &str, change| NamedRecord {
            tick_idx,
            now_secs: 0.25 * tick_idx as f64,
            path: path.to_owned(),
            change,
        };
        let journal = vec![
            record(0, "", NamedChange::Write { key: "n".to_owned(), value: Some(Literal::Int(3)) }),
            record(1, "", NamedChange::Ticked),
            record(1, "sequence", NamedChange::Status { from: Status::Idle, to: Status::Running }),
            record(1, "sequence/a", NamedChange::Failed(Failure::new("slipped", "by 3 mm"))),
            record(1, "sequence/a", NamedChange::Write { key: "cloud".to_owned(), value: None }),
            record(2, "", NamedChange::Ticked),
            record(2, "", NamedChange::HaltAsked),
            record(2, "sequence", NamedChange::Status { from: Status::Running, to: Status::Idle }),
        ];
        let metadata = BTreeMap::from([("seed".to_owned(), "7".to_owned())]);
        let mut recording = Recording::create(&path, &metadata).unwrap();
        recording.changes(&journal).unwrap();
        recording.finish(1.0, &verdict()).unwrap();
        let run = read_run(&path).unwrap();
        assert_eq!((run.journal, run.metadata, run.is_whole), (journal, metadata, true));
        // Cut off in its summary: every message is there.
        let bytes = std::fs::read(&path).unwrap();
        std::fs::write(&path, &bytes[..bytes.len() - 40]).unwrap();
        let cut = read_run(&path).unwrap();
        assert_eq!((cut.journal.len(), cut.is_whole), (8, false));
        // A run that was killed.
        let mut recording = Recording::create(&path, &BTreeMap::new()).unwrap();
        recording.changes(&cut.journal).unwrap();
        recording
            .robot(&crate::messages::RobotSample { state: &killed(), q_command: &[], hand_command: HandCommand::default() })
            .unwrap();
        let bytes = std::fs::read(&path).unwrap();
        drop(recording);
        std::fs::write(&path, bytes).unwrap();
        let cut = read_run(&path).unwrap();
        assert_eq!((cut.journal.len(), cut.is_whole), (8, false));
    }

    fn verdict() -> crate::messages::Verdict<'static> {
        crate::messages::Verdict { outcome: sfg_types::Outcome::Success, predicates: &[], judge: &Value::Null }
    }

    /// A sample late enough to have everything before it written out.
    fn killed() -> RobotState {
        RobotState { stamp_secs: 10.0, ..RobotState::default() }
    }

    #[test]
    fn what_is_no_recording_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.mcap");
        assert!(read_run(&path).unwrap_err().to_string().contains("run.mcap"));
        std::fs::write(&path, "nothing of the kind").unwrap();
        assert!(read_run(&path).unwrap_err().to_string().contains("no recording"));
    }
}

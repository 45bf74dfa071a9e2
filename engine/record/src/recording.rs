//! `run.mcap`: what happened when, on the driver's clock.
//!
//! Messages are JSON with a JSON schema each, so that any MCAP reader shows them without our code. The file is flushed each
//! second and at every status change: after a kill at most the last second is missing.

use crate::RecordError;
use base64::Engine as _;
use mcap::records::MessageHeader;
use serde::Serialize;
use sfg_types::{HandCommand, RobotState, StageRecord};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};

/// One control period: what was measured and what was asked for.
#[derive(Clone, Debug, Serialize)]
pub struct RobotSample<'a> {
    /// Measurement.
    #[serde(flatten)]
    pub state: &'a RobotState,
    /// Commanded joint positions, radians.
    pub q_command: &'a [f64],
    /// Hand set point.
    pub hand_command: HandCommand,
}

/// One status change of one node.
#[derive(Clone, Debug, Serialize)]
pub struct TransitionSample {
    /// Time on the driver's clock.
    pub stamp_secs: f64,
    /// Tick in which it happened.
    pub tick: u64,
    /// Path of the node in the tree.
    pub node: String,
    /// Status before.
    pub from: String,
    /// Status after.
    pub to: String,
}

struct Channel {
    id: u16,
    sequence: u32,
}

/// An open `run.mcap`.
pub struct Recording {
    path: PathBuf,
    writer: mcap::Writer<BufWriter<File>>,
    channels: BTreeMap<String, Channel>,
    flushed_secs: f64,
}

const FLUSH_EVERY_SECS: f64 = 1.0;

/// Topic, schema name, schema. Names are stable: a new layout gets a new number.
const SCHEMAS: &[(&str, &str, &str)] = &[
    (
        "/robot",
        "sfg.RobotSample.v1",
        r#"{"type":"object","properties":{"stamp_secs":{"type":"number"},"side":{"type":"string"},"q":{"type":"array","items":{"type":"number"}},"dq":{"type":"array","items":{"type":"number"}},"q_command":{"type":"array","items":{"type":"number"}},"hand":{"type":"object"},"hand_command":{"type":"object"}}}"#,
    ),
    (
        "/tree",
        "sfg.Transition.v1",
        r#"{"type":"object","properties":{"stamp_secs":{"type":"number"},"tick":{"type":"integer"},"node":{"type":"string"},"from":{"type":"string"},"to":{"type":"string"}}}"#,
    ),
    (
        "/stages",
        "sfg.Stage.v1",
        r#"{"type":"object","properties":{"stage":{"type":"string"},"stamp_secs":{"type":"number"},"failure":{"type":["string","null"]},"summary":{"type":"string"},"input_sha256":{"type":"string"},"details":{"type":"object"}}}"#,
    ),
    (crate::journal::TOPIC, "sfg.Journal.v1", crate::journal::SCHEMA),
    ("/verdict", "sfg.Verdict.v1", r#"{"type":"object"}"#),
];

/// Schema of an encoded picture as viewers know it.
const IMAGE_SCHEMA: (&str, &str) = (
    "foxglove.CompressedImage",
    r#"{"type":"object","properties":{"timestamp":{"type":"object","properties":{"sec":{"type":"integer"},"nsec":{"type":"integer"}}},"frame_id":{"type":"string"},"data":{"type":"string","contentEncoding":"base64"},"format":{"type":"string"}}}"#,
);

impl Recording {
    /// Opens `path` for writing and declares the channels; `metadata` (scenario, seed, hashes) goes to the front of the file.
    ///
    /// # Errors
    /// [`RecordError`] when the file cannot be written.
    pub fn create(path: &Path, metadata: &BTreeMap<String, String>) -> Result<Self, RecordError> {
        let file = File::create(path).map_err(|source| RecordError::Io { path: path.to_owned(), source })?;
        let fail = |source| RecordError::Mcap { path: path.to_owned(), source };
        let mut writer = mcap::WriteOptions::new()
            .library(concat!("sfg-record ", env!("CARGO_PKG_VERSION")))
            .compression(None)
            .create(BufWriter::new(file))
            .map_err(fail)?;
        writer.write_metadata(&mcap::records::Metadata { name: "run".to_owned(), metadata: metadata.clone() }).map_err(fail)?;
        let mut recording = Self { path: path.to_owned(), writer, channels: BTreeMap::new(), flushed_secs: 0.0 };
        for (topic, name, schema) in SCHEMAS {
            recording.declare(topic, name, schema)?;
        }
        Ok(recording)
    }

    fn declare(&mut self, topic: &str, name: &str, schema: &str) -> Result<(), RecordError> {
        let fail = |source| RecordError::Mcap { path: self.path.clone(), source };
        let schema_id = self.writer.add_schema(name, "jsonschema", schema.as_bytes()).map_err(fail)?;
        let fail = |source| RecordError::Mcap { path: self.path.clone(), source };
        let id = self.writer.add_channel(schema_id, topic, "json", &BTreeMap::new()).map_err(fail)?;
        self.channels.insert(topic.to_owned(), Channel { id, sequence: 0 });
        Ok(())
    }

    pub(crate) fn write(&mut self, topic: &str, stamp_secs: f64, message: &impl Serialize) -> Result<(), RecordError> {
        let bytes = serde_json::to_vec(message).map_err(|source| RecordError::Encode { what: "a message", source })?;
        let Some(channel) = self.channels.get_mut(topic) else {
            unreachable!("every topic is declared before its first message");
        };
        let log_time = (stamp_secs.max(0.0) * 1e9).round() as u64;
        let header = MessageHeader { channel_id: channel.id, sequence: channel.sequence, log_time, publish_time: log_time };
        channel.sequence += 1;
        self.writer
            .write_to_known_channel(&header, &bytes)
            .map_err(|source| RecordError::Mcap { path: self.path.clone(), source })?;
        if stamp_secs - self.flushed_secs >= FLUSH_EVERY_SECS {
            self.flush(stamp_secs)?;
        }
        Ok(())
    }

    fn flush(&mut self, stamp_secs: f64) -> Result<(), RecordError> {
        self.flushed_secs = stamp_secs;
        self.writer.flush().map_err(|source| RecordError::Mcap { path: self.path.clone(), source })
    }

    /// Records a control period.
    ///
    /// # Errors
    /// [`RecordError`] when the file cannot be written.
    pub fn robot(&mut self, sample: &RobotSample<'_>) -> Result<(), RecordError> {
        self.write("/robot", sample.state.stamp_secs, sample)
    }

    /// Records a status change and flushes, so that the reason of a crash is in the file.
    ///
    /// # Errors
    /// [`RecordError`] when the file cannot be written.
    pub fn transition(&mut self, sample: &TransitionSample) -> Result<(), RecordError> {
        self.write("/tree", sample.stamp_secs, sample)?;
        self.flush(sample.stamp_secs)
    }

    /// Records the end of a stage.
    ///
    /// # Errors
    /// [`RecordError`] when the file cannot be written.
    pub fn stage(&mut self, stage: &StageRecord) -> Result<(), RecordError> {
        self.write("/stages", stage.stamp_secs, stage)
    }

    /// Records an encoded picture under `/images/<name>`.
    ///
    /// # Errors
    /// [`RecordError`] when the file cannot be written.
    pub fn image(&mut self, stamp_secs: f64, name: &str, png: &[u8]) -> Result<(), RecordError> {
        #[derive(Serialize)]
        struct Stamp {
            sec: u64,
            nsec: u64,
        }
        #[derive(Serialize)]
        struct CompressedImage<'a> {
            timestamp: Stamp,
            frame_id: &'a str,
            data: String,
            format: &'static str,
        }
        let topic = format!("/images/{name}");
        if !self.channels.contains_key(&topic) {
            self.declare(&topic, IMAGE_SCHEMA.0, IMAGE_SCHEMA.1)?;
        }
        let nanos = (stamp_secs.max(0.0) * 1e9).round() as u64;
        let message = CompressedImage {
            timestamp: Stamp { sec: nanos / 1_000_000_000, nsec: nanos % 1_000_000_000 },
            frame_id: name,
            data: base64::engine::general_purpose::STANDARD.encode(png),
            format: "png",
        };
        self.write(&topic, stamp_secs, &message)
    }

    /// Records the verdict and closes the file.
    ///
    /// # Errors
    /// [`RecordError`] when the file cannot be written.
    pub fn finish(mut self, stamp_secs: f64, verdict: &serde_json::Value) -> Result<(), RecordError> {
        self.write("/verdict", stamp_secs, verdict)?;
        let path = self.path.clone();
        self.writer.finish().map_err(|source| RecordError::Mcap { path, source })?;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    #![expect(clippy::unwrap_used, reason = "tests fail by panicking")]
    use super::*;

    fn messages(path: &Path) -> Vec<(String, u64)> {
        let bytes = std::fs::read(path).unwrap();
        let mut found = Vec::new();
        let Ok(stream) = mcap::read::MessageStream::new_with_options(&bytes, mcap::read::Options::IgnoreEndMagic.into()) else {
            return found;
        };
        for message in stream {
            let Ok(message) = message else { break };
            found.push((message.channel.topic.clone(), message.log_time));
        }
        found
    }

    #[test]
    fn messages_come_back_and_an_unfinished_file_keeps_all_but_the_last_second() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.mcap");
        let mut recording = Recording::create(&path, &BTreeMap::from([("seed".to_owned(), "7".to_owned())])).unwrap();
        let mut state = RobotState::default();
        for step in 0..500 {
            state.stamp_secs = f64::from(step) * 0.01;
            recording.robot(&RobotSample { state: &state, q_command: &[], hand_command: HandCommand::default() }).unwrap();
        }
        let survived = messages(&path).len();
        assert!((400..=500).contains(&survived), "{survived} of 500 samples are readable without closing the file");
        recording.image(5.0, "right", &[1, 2, 3]).unwrap();
        recording.finish(5.0, &serde_json::json!({"passed": true})).unwrap();
        let all = messages(&path);
        assert_eq!(all.len(), 502);
        assert_eq!(all[500].0, "/images/right");
        assert_eq!(all[501], ("/verdict".to_owned(), 5_000_000_000));
    }

    #[test]
    fn an_unwritable_place_is_named() {
        let error = Recording::create(Path::new("/nowhere/run.mcap"), &BTreeMap::new()).err().unwrap();
        assert!(error.to_string().contains("/nowhere/run.mcap"), "{error}");
    }
}

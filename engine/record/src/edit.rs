//! New recordings from old ones: whole again after a kill, or a part of one.

use crate::RecordError;
use crate::log_file::LogFile;
use mcap::records::{Metadata, Record};
use std::collections::BTreeMap;
use std::io::BufWriter;
use std::path::Path;

/// What [`recover`] saved.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Recovered {
    /// Messages in the new file.
    pub n_messages: u64,
    /// Log time of the last, nanoseconds.
    pub last_ns: u64,
    /// Bytes of the old file that hold nothing readable.
    pub n_lost_bytes: usize,
    /// The old file was whole.
    pub was_whole: bool,
}

/// A part of a recording.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cut {
    /// Begin on the driver's clock, seconds.
    pub from_secs: f64,
    /// End, seconds; both ends belong to it.
    pub to_secs: f64,
}

/// Writes what can be read of `file` to `target` as a whole recording with its summary.
///
/// # Errors
/// [`RecordError`] when the target cannot be written.
pub fn recover(file: &LogFile, target: &Path) -> Result<Recovered, RecordError> {
    let mut writer = Writer::create(file, target, &file.metadata)?;
    let (mut n_messages, mut last_ns) = (0, 0);
    for message in file.messages() {
        writer.write(&message.header, message.log_time_ns, &message.data)?;
        n_messages += 1;
        last_ns = message.log_time_ns.max(last_ns);
    }
    writer.finish()?;
    Ok(Recovered { n_messages, last_ns, n_lost_bytes: file.n_lost_bytes, was_whole: file.is_whole })
}

/// Writes a part of `file` to `target`, begun with what was valid then: header, tree, scene, statuses, blackboard. How many
/// messages it has.
///
/// # Errors
/// [`RecordError`] when the target cannot be written, or nothing lies between the ends.
pub fn cut(file: &LogFile, part: Cut, target: &Path) -> Result<u64, RecordError> {
    let unreadable = |message: String| RecordError::Unreadable { path: file.path().to_owned(), message };
    let (from_ns, to_ns) = (crate::messages::nanos(part.from_secs), crate::messages::nanos(part.to_secs));
    let (_, last_ns) = file.span_ns().ok_or_else(|| unreadable("it has no message".to_owned()))?;
    if part.from_secs > part.to_secs || from_ns > last_ns {
        let message = format!(
            "nothing lies between {} s and {} s: it has 0 to {:.3} s",
            part.from_secs,
            part.to_secs,
            last_ns as f64 / 1e9
        );
        return Err(unreadable(message));
    }
    let mut metadata = file.metadata.clone();
    metadata.insert("cut_from_secs".to_owned(), part.from_secs.to_string());
    metadata.insert("cut_to_secs".to_owned(), part.to_secs.to_string());
    let mut writer = Writer::create(file, target, &metadata)?;
    // Held back until the part begins: the last of each kind before it.
    let mut valid = BTreeMap::new();
    for (order, message) in file.messages().enumerate().filter(|(_, message)| message.log_time_ns < from_ns) {
        if let Some(key) = key_of_state(&message) {
            valid.insert(key, (order, message));
        }
    }
    let mut valid: Vec<_> = valid.into_values().collect();
    valid.sort_by_key(|(order, _)| *order);
    let mut n_messages = 0;
    for (_, message) in valid {
        writer.write(&message.header, from_ns, &message.data)?;
        n_messages += 1;
    }
    for message in file.messages().filter(|message| (from_ns..=to_ns).contains(&message.log_time_ns)) {
        writer.write(&message.header, message.log_time_ns, &message.data)?;
        n_messages += 1;
    }
    writer.finish()?;
    Ok(n_messages)
}

/// What a message says is valid until another one with the same key; nothing for samples.
fn key_of_state(message: &crate::LoggedMessage<'_>) -> Option<(String, String)> {
    let topic = message.channel.topic.as_str();
    let field = |name: &str| Some(message.json().ok()?[name].as_str()?.to_owned());
    let part = match topic {
        "/tree" => field("node")?,
        "/blackboard" => field("key")?,
        "/robot" | "/joint_states" | "/journal" | "/synergy" | "/motors" | "/log" | "/stages" | "/tf" | "/truth" => return None,
        _ => String::new(),
    };
    Some((topic.to_owned(), part))
}

struct Writer<'a> {
    file: &'a LogFile,
    target: &'a Path,
    partial: std::path::PathBuf,
    writer: mcap::Writer<BufWriter<std::fs::File>>,
    /// Numbers of the channels here, by their numbers there.
    channels: BTreeMap<u16, u16>,
}

impl<'a> Writer<'a> {
    fn create(file: &'a LogFile, target: &'a Path, metadata: &BTreeMap<String, String>) -> Result<Self, RecordError> {
        let mut name = target.file_name().unwrap_or_default().to_owned();
        name.push(".partial");
        let partial = target.with_file_name(name);
        let io = |source| RecordError::Io { path: target.to_owned(), source };
        let output = BufWriter::new(std::fs::File::create(&partial).map_err(io)?);
        let failed = |source| failed(target, source);
        let mut writer = mcap::WriteOptions::new().compression(None).create(output).map_err(failed)?;
        writer.write_metadata(&Metadata { name: "run".to_owned(), metadata: metadata.clone() }).map_err(failed)?;
        for record in file.records() {
            if let Record::Attachment { header, data, .. } = record {
                let attachment = mcap::Attachment {
                    log_time: header.log_time,
                    create_time: header.create_time,
                    name: header.name,
                    media_type: header.media_type,
                    data,
                };
                writer.attach(&attachment).map_err(failed)?;
            }
        }
        Ok(Self { file, target, partial, writer, channels: BTreeMap::new() })
    }

    fn write(&mut self, header: &mcap::records::MessageHeader, log_time_ns: u64, data: &[u8]) -> Result<(), RecordError> {
        let channel_id = match self.channels.get(&header.channel_id) {
            Some(id) => *id,
            None => self.declare(header.channel_id)?,
        };
        let header = mcap::records::MessageHeader { channel_id, log_time: log_time_ns, publish_time: log_time_ns, ..*header };
        self.writer.write_to_known_channel(&header, data).map_err(|source| failed(self.target, source))
    }

    fn declare(&mut self, there: u16) -> Result<u16, RecordError> {
        let declared =
            self.file.channels.get(&there).and_then(|channel| Some((channel, self.file.schemas.get(&channel.schema_id)?)));
        let Some((channel, schema)) = declared else {
            let message = format!("channel {there} has no schema");
            return Err(RecordError::Unreadable { path: self.file.path().to_owned(), message });
        };
        let id = self
            .writer
            .add_schema(&schema.name, &schema.encoding, &schema.data)
            .and_then(|schema| self.writer.add_channel(schema, &channel.topic, &channel.encoding, &BTreeMap::new()))
            .map_err(|source| failed(self.target, source))?;
        self.channels.insert(there, id);
        Ok(id)
    }

    /// Closes the file and puts it in its place.
    fn finish(mut self) -> Result<(), RecordError> {
        self.writer.finish().map_err(|source| failed(self.target, source))?;
        let io = |source| RecordError::Io { path: self.target.to_owned(), source };
        let file = self.writer.into_inner().into_inner().map_err(|error| io(error.into_error()))?;
        file.sync_all().map_err(io)?;
        std::fs::rename(&self.partial, self.target).map_err(io)
    }
}

fn failed(target: &Path, source: mcap::McapError) -> RecordError {
    RecordError::Mcap { path: target.to_owned(), source: Box::new(source.into()) }
}

#[cfg(test)]
mod tests {
    #![expect(clippy::unwrap_used, reason = "tests fail by panicking")]
    use super::*;
    use crate::Recording;
    use crate::messages::{RobotSample, RunHeader};
    use sfg_tree::{NamedChange, NamedRecord, Status};
    use sfg_types::{HandCommand, RobotState};

    fn killed(path: &Path) {
        let mut recording =
            Recording::create(path, &BTreeMap::from([("engine_version".to_owned(), "0.1.0".to_owned())])).unwrap();
        recording.begin(&RunHeader::default()).unwrap();
        recording.attach("robot.urdf", "application/xml", b"<robot/>").unwrap();
        for step in 0..400 {
            let now_secs = f64::from(step) * 0.01;
            let state = RobotState { stamp_secs: now_secs, ..RobotState::default() };
            recording.robot(&RobotSample { state: &state, q_command: &[], hand_command: HandCommand::default() }).unwrap();
            if step % 150 == 50 {
                let change = NamedChange::Status { from: Status::Idle, to: Status::Running };
                recording.changes(&[NamedRecord { tick_idx: 1, now_secs, path: format!("node {step}"), change }]).unwrap();
            }
        }
        let bytes = std::fs::read(path).unwrap();
        drop(recording);
        std::fs::write(path, bytes).unwrap();
    }

    #[test]
    fn a_killed_recording_becomes_whole_with_everything_that_was_in_it() {
        let folder = tempfile::tempdir().unwrap();
        let (path, target) = (folder.path().join("run.mcap"), folder.path().join("recovered.mcap"));
        killed(&path);
        let file = LogFile::open(&path).unwrap();
        let recovered = recover(&file, &target).unwrap();
        let whole = LogFile::open(&target).unwrap();
        assert!(!recovered.was_whole && whole.is_whole);
        assert_eq!(whole.attachments, [("robot.urdf".to_owned(), 8)]);
        let counts = |file: &LogFile| -> Vec<_> { file.channels().iter().map(|c| (c.topic.clone(), c.n_messages)).collect() };
        assert_eq!(counts(&whole), counts(&file));
        assert!(recovered.last_ns >= 3_000_000_000, "{}", recovered.last_ns);
        let bytes = std::fs::read(&target).unwrap();
        assert!(mcap::Summary::read(&bytes).unwrap().is_some(), "it can be sought in");
    }

    #[test]
    fn a_part_begins_with_what_was_valid() {
        let folder = tempfile::tempdir().unwrap();
        let (path, target) = (folder.path().join("run.mcap"), folder.path().join("part.mcap"));
        killed(&path);
        let file = LogFile::open(&path).unwrap();
        cut(&file, Cut { from_secs: 1.0, to_secs: 2.5 }, &target).unwrap();
        let part = LogFile::open(&target).unwrap();
        assert_eq!(part.span_ns(), Some((1_000_000_000, 2_500_000_000)));
        assert_eq!(part.metadata["cut_from_secs"], "1");
        let nodes: Vec<_> = part.json("/tree").unwrap().into_iter().map(|(at, change)| (at, change["node"].clone())).collect();
        assert_eq!(nodes, [(1.0, "node 50".into()), (2.0, "node 200".into())]);
        assert_eq!(part.json("/run").unwrap()[0].0, 1.0);
        let error = cut(&file, Cut { from_secs: 70.0, to_secs: 71.0 }, &target).unwrap_err().to_string();
        assert!(error.contains("nothing lies between 70 s and 71 s"), "{error}");
    }
}

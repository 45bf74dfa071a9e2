//! A recording on disk: what is in it, whether it is whole, and its messages.

use crate::RecordError;
use crate::messages::CHANNELS;
use crate::scan::{Scan, is_mcap};
use mcap::records::{MessageHeader, Record};
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// One channel of a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ChannelInfo {
    /// The channel: `/tree`.
    pub topic: String,
    /// `json` or `protobuf`.
    pub encoding: String,
    /// Name of its schema: `sfg.Transition.v1`, `foxglove.SceneUpdate`.
    pub schema: String,
    /// How many messages it has.
    pub n_messages: u64,
    /// Bytes of its messages.
    pub n_bytes: u64,
    /// Log time of the first, nanoseconds.
    pub first_ns: u64,
    /// Log time of the last.
    pub last_ns: u64,
    pub(crate) schema_id: u16,
}

/// A schema as it stands in the file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct SchemaInfo {
    pub(crate) name: String,
    pub(crate) encoding: String,
    pub(crate) data: Vec<u8>,
}

/// One message of a file.
#[derive(Clone, Debug)]
pub struct LoggedMessage<'a> {
    /// Its channel.
    pub channel: &'a ChannelInfo,
    /// Driver's clock, nanoseconds.
    pub log_time_ns: u64,
    /// JSON or protobuf, as the channel says.
    pub data: Cow<'a, [u8]>,
    pub(crate) header: MessageHeader,
}

impl LoggedMessage<'_> {
    /// The message of a JSON channel.
    ///
    /// # Errors
    /// Why it is no JSON.
    pub fn json(&self) -> Result<serde_json::Value, serde_json::Error> {
        serde_json::from_slice(&self.data)
    }
}

/// A recording, read into memory.
#[derive(Debug)]
pub struct LogFile {
    path: PathBuf,
    bytes: Vec<u8>,
    /// Scenario, seed, hashes.
    pub metadata: BTreeMap<String, String>,
    /// Name and size of each attachment.
    pub attachments: Vec<(String, usize)>,
    /// Whether the file was closed; else its writer was killed or it was cut off.
    pub is_whole: bool,
    /// Bytes that cannot be read.
    pub n_lost_bytes: usize,
    pub(crate) channels: BTreeMap<u16, ChannelInfo>,
    pub(crate) schemas: BTreeMap<u16, SchemaInfo>,
}

/// The recording that a user means: the file itself, or `run.mcap` in the folder of a run.
#[must_use]
pub fn recording_path(run: &Path) -> PathBuf {
    if run.is_dir() { run.join("run.mcap") } else { run.to_owned() }
}

impl LogFile {
    /// Opens a recording, also one that was cut off.
    ///
    /// # Errors
    /// [`RecordError::Unreadable`] when the file is missing, empty, no recording of this engine, or of a newer one.
    pub fn open(path: &Path) -> Result<Self, RecordError> {
        let unreadable = |message: String| RecordError::Unreadable { path: path.to_owned(), message };
        let bytes = std::fs::read(path).map_err(|error| unreadable(error.to_string()))?;
        if bytes.is_empty() {
            return Err(unreadable("it is empty: the run ended before anything was recorded".to_owned()));
        }
        if !is_mcap(&bytes) {
            return Err(unreadable("it is no recording: a recording is an MCAP file".to_owned()));
        }
        let mut file = Self {
            path: path.to_owned(),
            bytes: Vec::new(),
            metadata: BTreeMap::new(),
            attachments: Vec::new(),
            is_whole: false,
            n_lost_bytes: 0,
            channels: BTreeMap::new(),
            schemas: BTreeMap::new(),
        };
        let mut scan = Scan::new(&bytes);
        for record in scan.by_ref() {
            file.take(record);
        }
        (file.is_whole, file.n_lost_bytes) = (scan.is_whole, scan.n_lost);
        file.bytes = bytes;
        file.check().map_err(unreadable)?;
        Ok(file)
    }

    fn take(&mut self, record: Record<'_>) {
        match record {
            Record::Metadata(found) if found.name == "run" => self.metadata = found.metadata,
            Record::Attachment { header, data, .. } => self.attachments.push((header.name, data.len())),
            Record::Schema { header, data } => {
                let info = SchemaInfo { name: header.name, encoding: header.encoding, data: data.into_owned() };
                self.schemas.entry(header.id).or_insert(info);
            }
            Record::Channel(channel) => {
                let schema = self.schemas.get(&channel.schema_id).map_or(String::new(), |schema| schema.name.clone());
                self.channels.entry(channel.id).or_insert(ChannelInfo {
                    topic: channel.topic,
                    encoding: channel.message_encoding,
                    schema,
                    n_messages: 0,
                    n_bytes: 0,
                    first_ns: 0,
                    last_ns: 0,
                    schema_id: channel.schema_id,
                });
            }
            Record::Message { header, data } => {
                if let Some(channel) = self.channels.get_mut(&header.channel_id) {
                    if channel.n_messages == 0 {
                        (channel.first_ns, channel.last_ns) = (header.log_time, header.log_time);
                    }
                    channel.n_messages += 1;
                    channel.n_bytes += data.len() as u64;
                    channel.first_ns = channel.first_ns.min(header.log_time);
                    channel.last_ns = channel.last_ns.max(header.log_time);
                }
            }
            _ => {}
        }
    }

    /// A foreign file and a file of a newer program are told apart by the names of the schemas.
    fn check(&self) -> Result<(), String> {
        let ours: Vec<&str> =
            self.channels.values().map(|channel| &*channel.schema).filter(|name| name.starts_with("sfg.")).collect();
        for found in &ours {
            if let (Some((name, version)), Some((_, known))) =
                (versioned(found), CHANNELS.iter().find_map(|(_, known)| same(found, known)))
                && version > known
            {
                return Err(format!(
                    "it has {name} in version {version} and this program knows up to {known}: it was recorded by a newer program; \
                     open it with that one"
                ));
            }
        }
        if ours.is_empty() && !self.metadata.contains_key("engine_version") {
            let topics: Vec<&str> = self.channels.values().take(3).map(|channel| &*channel.topic).collect();
            let has = if topics.is_empty() { "it has no channel".to_owned() } else { format!("it has {}", topics.join(", ")) };
            return Err(format!("it is an MCAP file, but no recording of sfg: {has}"));
        }
        Ok(())
    }

    /// The file.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Size of the file, bytes.
    #[must_use]
    pub fn n_bytes(&self) -> usize {
        self.bytes.len()
    }

    /// The channels that have messages, by topic.
    #[must_use]
    pub fn channels(&self) -> Vec<&ChannelInfo> {
        let mut channels: Vec<&ChannelInfo> = self.channels.values().filter(|channel| channel.n_messages > 0).collect();
        channels.sort_by(|a, b| a.topic.cmp(&b.topic));
        channels
    }

    /// First and last log time, nanoseconds; nothing when there is no message.
    #[must_use]
    pub fn span_ns(&self) -> Option<(u64, u64)> {
        let channels = self.channels.values().filter(|channel| channel.n_messages > 0);
        channels.map(|channel| (channel.first_ns, channel.last_ns)).reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)))
    }

    pub(crate) fn records(&self) -> Scan<'_> {
        Scan::new(&self.bytes)
    }

    /// The messages in the order of the file.
    pub fn messages(&self) -> impl Iterator<Item = LoggedMessage<'_>> {
        self.records().filter_map(|record| match record {
            Record::Message { header, data } => {
                let channel = self.channels.get(&header.channel_id)?;
                Some(LoggedMessage { channel, log_time_ns: header.log_time, data, header })
            }
            _ => None,
        })
    }

    /// The messages of one channel as JSON, with their log time in seconds.
    ///
    /// # Errors
    /// [`RecordError::Unreadable`] when one is no JSON.
    pub fn json(&self, topic: &str) -> Result<Vec<(f64, serde_json::Value)>, RecordError> {
        let of_topic = self.messages().filter(|message| message.channel.topic == topic);
        of_topic
            .map(|message| match message.json() {
                Ok(value) => Ok((message.log_time_ns as f64 / 1e9, value)),
                Err(error) => {
                    Err(RecordError::Unreadable { path: self.path.clone(), message: format!("a message of {topic}: {error}") })
                }
            })
            .collect()
    }
}

/// `sfg.Run` and 2 of `sfg.Run.v2`.
fn versioned(schema: &str) -> Option<(&str, u32)> {
    let (name, version) = schema.rsplit_once(".v")?;
    Some((name, version.parse().ok()?))
}

/// Name and known version when both are about the same message.
fn same<'a>(found: &str, known: &'a str) -> Option<(&'a str, u32)> {
    versioned(known).filter(|(name, _)| versioned(found).is_some_and(|(found, _)| found == *name))
}

impl LogFile {
    /// The images of a camera, encoded, each with its time of exposure in seconds.
    ///
    /// # Errors
    /// [`RecordError::Unreadable`] when one is no image message.
    pub fn images(&self, camera: &str, kind: crate::views::ImageKind) -> Result<Vec<(f64, Vec<u8>)>, RecordError> {
        use foxglove::Decode as _;
        let what = if kind == crate::views::ImageKind::Colour { "image" } else { "depth" };
        let topic = format!("/camera/{camera}/{what}");
        let of_topic = self.messages().filter(|message| message.channel.topic == topic);
        of_topic
            .map(|message| match foxglove::messages::CompressedImage::decode(&*message.data) {
                Ok(image) => Ok((message.log_time_ns as f64 / 1e9, image.data.to_vec())),
                Err(error) => {
                    Err(RecordError::Unreadable { path: self.path.clone(), message: format!("a message of {topic}: {error}") })
                }
            })
            .collect()
    }

    /// Names of the cameras that have images.
    #[must_use]
    pub fn cameras(&self) -> Vec<String> {
        let topics = self.channels().into_iter().map(|channel| channel.topic.as_str());
        topics.filter_map(|topic| topic.strip_prefix("/camera/")?.strip_suffix("/image")).map(str::to_owned).collect()
    }
}

#[cfg(test)]
mod tests {
    #![expect(clippy::unwrap_used, reason = "tests fail by panicking")]
    use super::*;
    use crate::Recording;
    use crate::messages::{RobotSample, Verdict};
    use sfg_types::{HandCommand, Outcome, RobotState};

    /// A recording of 3 s, closed or killed.
    fn recording(path: &Path, is_closed: bool) {
        let metadata = BTreeMap::from([("seed".to_owned(), "7".to_owned()), ("engine_version".to_owned(), "0.1.0".to_owned())]);
        let mut recording = Recording::create(path, &metadata).unwrap();
        for step in 0..300 {
            let state = RobotState { stamp_secs: f64::from(step) * 0.01, ..RobotState::default() };
            recording.robot(&RobotSample { state: &state, q_command: &[], hand_command: HandCommand::default() }).unwrap();
        }
        let killed = std::fs::read(path).unwrap();
        let verdict = Verdict { outcome: Outcome::Success, predicates: &[], judge: &serde_json::Value::Null };
        recording.finish(3.0, &verdict).unwrap();
        if !is_closed {
            std::fs::write(path, killed).unwrap();
        }
    }

    #[test]
    fn a_whole_file_tells_what_is_in_it() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.mcap");
        recording(&path, true);
        let file = LogFile::open(&path).unwrap();
        assert!(file.is_whole && file.n_lost_bytes == 0);
        assert_eq!(file.metadata["seed"], "7");
        let topics: Vec<_> = file.channels().iter().map(|channel| (channel.topic.as_str(), channel.n_messages)).collect();
        assert_eq!(topics, [("/joint_states", 300), ("/log", 1), ("/robot", 300), ("/verdict", 1)]);
        assert_eq!(file.span_ns(), Some((0, 3_000_000_000)));
        assert_eq!(file.json("/verdict").unwrap()[0].1["outcome"], "success");
    }

    #[test]
    fn a_file_that_was_cut_off_anywhere_opens_with_what_is_there() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.mcap");
        recording(&path, false);
        let bytes = std::fs::read(&path).unwrap();
        let killed = LogFile::open(&path).unwrap();
        assert!(!killed.is_whole);
        let n_killed = killed.json("/robot").unwrap().len();
        assert!((200..=300).contains(&n_killed), "{n_killed} of 300 samples: at most the last second is missing");
        let mut last = 0;
        for cut in (60..bytes.len()).step_by(97) {
            std::fs::write(&path, &bytes[..cut]).unwrap();
            match LogFile::open(&path) {
                Ok(file) => {
                    let n = file.json("/robot").unwrap().len();
                    assert!(n >= last && !file.is_whole, "{n} messages of {cut} bytes, {last} of fewer");
                    last = n;
                }
                // Nothing but a part of the metadata is there.
                Err(error) => assert!(last == 0, "{error}"),
            }
        }
        assert!(n_killed - last <= 1, "{last} of {n_killed}");
    }

    #[test]
    fn what_is_no_recording_of_ours_is_refused_with_its_name() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.mcap");
        let refusal = || LogFile::open(&path).unwrap_err().to_string();
        assert!(refusal().contains("run.mcap"));
        std::fs::write(&path, "").unwrap();
        assert!(refusal().contains("it is empty"), "{}", refusal());
        std::fs::write(&path, "nothing of the kind").unwrap();
        assert!(refusal().contains("it is no recording"), "{}", refusal());
        let write = |schema: &str, topic: &str| {
            let mut writer = mcap::WriteOptions::new().create(std::fs::File::create(&path).unwrap()).unwrap();
            let schema = writer.add_schema(schema, "jsonschema", b"{}").unwrap();
            let channel = writer.add_channel(schema, topic, "json", &BTreeMap::new()).unwrap();
            let header = MessageHeader { channel_id: channel, sequence: 0, log_time: 0, publish_time: 0 };
            writer.write_to_known_channel(&header, b"{}").unwrap();
            writer.finish().unwrap();
        };
        write("sensor_msgs/Image", "/front");
        assert!(refusal().contains("no recording of sfg: it has /front"), "{}", refusal());
        write("sfg.Transition.v9", "/tree");
        assert!(refusal().contains("sfg.Transition in version 9") && refusal().contains("newer program"), "{}", refusal());
    }
}

//! `run.mcap`: what happened when, on the driver's clock.
//!
//! Our own channels are JSON with the schema of their struct, the others have the schemas that Foxglove and Rerun know, so that
//! any MCAP reader shows them without our code. The file is flushed at every status change and once a second, of the driver's
//! clock and of the wall's: after a kill at most the last second is missing.

use crate::messages::{
    Candidates, Functionality, Inventory, KeyPoint, Masks, Message, MotorSample, RobotSample, RunHeader, Stage, SynergySample,
    TreeDefinition, TruthSample, Verdict, nanos,
};
use crate::sink::{File, Live};
use crate::tap::{Recorded, Tap};
use crate::{RecordError, cloud, frames, scene, views};
use foxglove::{Channel, ChannelBuilder, Context, Encode, PartialMetadata, RawChannel, Schema};
use sfg_types::{Observation, StageRecord};
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

const FLUSH_EVERY_SECS: f64 = 1.0;

/// How much of a look is kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Detail {
    /// A decision was taken on it: everything in full, and the points.
    Full,
    /// One of many: stronger compression, depth at a quarter of the resolution.
    Glance,
}

/// An open `run.mcap`, and the live socket if one was asked for.
pub struct Recording {
    context: Arc<Context>,
    file: File,
    live: Option<Live>,
    tap: Option<Tap>,
    channels: BTreeMap<String, Arc<RawChannel>>,
    frames: frames::Frames,
    scene: scene::Scene,
    cameras: BTreeMap<String, views::CameraChannels>,
    cloud: Channel<foxglove::messages::PointCloud>,
    log: Channel<foxglove::messages::Log>,
    flushed_secs: f64,
}

impl Recording {
    /// Opens `path` for writing; `metadata` (scenario, seed, hashes) goes to the front of the file.
    ///
    /// # Errors
    /// [`RecordError`] when the file cannot be written.
    pub fn create(path: &Path, metadata: &BTreeMap<String, String>) -> Result<Self, RecordError> {
        Self::start(path, metadata, None)
    }

    /// The same, and serves every channel to Foxglove at this port of this machine (0: one that is free); gives the port, too.
    ///
    /// # Errors
    /// [`RecordError`] when the file cannot be written or the port is taken; then an older file at `path` is as it was.
    pub fn create_served(path: &Path, metadata: &BTreeMap<String, String>, port: u16) -> Result<(Self, u16), RecordError> {
        let recording = Self::start(path, metadata, Some(port))?;
        let port = recording.live.as_ref().map_or(port, Live::port);
        Ok((recording, port))
    }

    fn start(path: &Path, metadata: &BTreeMap<String, String>, port: Option<u16>) -> Result<Self, RecordError> {
        let context = Context::new();
        // Before the file, which takes the place of an older one.
        let live = port.map(|port| Live::start(&context, port)).transpose()?;
        let file = File::create(path, &context, metadata)?;
        Ok(Self {
            frames: frames::Frames::new(&context),
            scene: scene::Scene::new(&context),
            cameras: BTreeMap::new(),
            cloud: typed(&context, "/cloud"),
            log: typed(&context, "/log"),
            context,
            file,
            live,
            tap: None,
            channels: BTreeMap::new(),
            flushed_secs: 0.0,
        })
    }

    /// Hands every JSON message and every camera image to `tap` as well, as they are recorded.
    #[must_use]
    pub fn with_tap(mut self, tap: Option<Tap>) -> Self {
        self.tap = tap;
        self
    }

    /// Puts a file beside the messages: a robot description, a mesh.
    ///
    /// # Errors
    /// [`RecordError`] when the file cannot be written.
    pub fn attach(&mut self, name: &str, media_type: &str, bytes: &[u8]) -> Result<(), RecordError> {
        self.file.attach(name, media_type, bytes)
    }

    /// Records what everything else refers to, and the frames and the scene that follow from it.
    ///
    /// # Errors
    /// [`RecordError`] when the file cannot be written.
    pub fn begin(&mut self, header: &RunHeader) -> Result<(), RecordError> {
        self.write(0.0, header)?;
        self.frames.begin(header);
        self.scene.begin(header);
        for camera in &header.cameras {
            let channels = views::CameraChannels::new(&self.context, &camera.name);
            channels.calibration(0, &camera.intrinsics);
            self.cameras.insert(camera.name.clone(), channels);
        }
        self.flush(0.0)
    }

    /// Records one message of our own.
    pub(crate) fn write<M: Message>(&mut self, stamp_secs: f64, message: &M) -> Result<(), RecordError> {
        let bytes = serde_json::to_vec(message).map_err(|source| RecordError::Encode { what: M::TOPIC, source })?;
        if !self.channels.contains_key(M::TOPIC) {
            let schema =
                serde_json::to_vec(&schema_of::<M>()).map_err(|source| RecordError::Encode { what: M::TOPIC, source })?;
            let channel = ChannelBuilder::new(M::TOPIC)
                .context(&self.context)
                .message_encoding("json")
                .schema(Schema::new(M::SCHEMA, "jsonschema", schema))
                .build_raw()
                .map_err(|source| self.file.failed(source))?;
            self.channels.insert(M::TOPIC.to_owned(), channel);
        }
        let log_time_ns = nanos(stamp_secs);
        if let Some(channel) = self.channels.get(M::TOPIC) {
            channel.log_with_meta(&bytes, PartialMetadata::with_log_time(log_time_ns));
        }
        if let Some(tap) = &self.tap {
            tap(&Recorded::Message { topic: M::TOPIC, schema: M::SCHEMA, log_time_ns, bytes: &bytes });
        }
        self.written(stamp_secs)
    }

    fn written(&mut self, stamp_secs: f64) -> Result<(), RecordError> {
        self.file.touch();
        if stamp_secs - self.flushed_secs >= FLUSH_EVERY_SECS { self.flush(stamp_secs) } else { Ok(()) }
    }

    pub(crate) fn flush(&mut self, stamp_secs: f64) -> Result<(), RecordError> {
        self.flushed_secs = stamp_secs;
        self.file.flush()
    }

    /// Records the tree as it is built.
    ///
    /// # Errors
    /// [`RecordError`] when the file cannot be written.
    pub fn definition(&mut self, stamp_secs: f64, definition: &TreeDefinition) -> Result<(), RecordError> {
        self.write(stamp_secs, definition)
    }

    /// Records a control period: `/robot` and `/joint_states`.
    ///
    /// # Errors
    /// [`RecordError`] when the file cannot be written.
    pub fn robot(&mut self, sample: &RobotSample<'_>) -> Result<(), RecordError> {
        self.frames.joint_states(sample.state);
        self.write(sample.state.stamp_secs, sample)
    }

    /// Records the hand in its synergy plane and its motors.
    ///
    /// # Errors
    /// [`RecordError`] when the file cannot be written.
    pub fn hand(&mut self, synergy: &SynergySample, motors: &MotorSample) -> Result<(), RecordError> {
        self.write(synergy.stamp_secs, synergy)?;
        self.write(motors.stamp_secs, motors)
    }

    /// Records where the moving links are: `q` is the configuration of the whole robot. Objects go where `truth` says.
    ///
    /// # Errors
    /// [`RecordError`] when the file cannot be written.
    pub fn transforms(&mut self, stamp_secs: f64, q: &[f64], truth: Option<&TruthSample>) -> Result<(), RecordError> {
        self.frames.transforms(stamp_secs, q, truth.map_or(&[], |truth| &truth.objects));
        if let Some(truth) = truth {
            self.write(stamp_secs, truth)?;
        }
        self.written(stamp_secs)
    }

    /// Records the end of a stage.
    ///
    /// # Errors
    /// [`RecordError`] when the file cannot be written.
    pub fn stage(&mut self, stage: &StageRecord) -> Result<(), RecordError> {
        use foxglove::messages::log::Level;
        let text = match stage.failure {
            None => format!("{}: {}", stage.stage, stage.summary),
            Some(reason) => format!("{} failed ({}): {}", stage.stage, reason.name(), stage.summary),
        };
        self.say(stage.stamp_secs, if stage.failure.is_some() { Level::Warning } else { Level::Info }, &stage.stage, text);
        self.write(stage.stamp_secs, &Stage(stage))
    }

    /// Records a warning among the log messages.
    pub fn warn(&mut self, stamp_secs: f64, source: &str, text: String) {
        self.say(stamp_secs, foxglove::messages::log::Level::Warning, source, text);
    }

    fn say(&self, stamp_secs: f64, level: foxglove::messages::log::Level, name: &str, message: String) {
        let log_time_ns = nanos(stamp_secs);
        let entry = foxglove::messages::Log {
            timestamp: Some(timestamp(log_time_ns)),
            level: level as i32,
            message,
            name: name.to_owned(),
            ..foxglove::messages::Log::default()
        };
        self.log.log_with_time(&entry, log_time_ns);
    }

    /// Records what the language backend answered.
    ///
    /// # Errors
    /// [`RecordError`] when the file cannot be written.
    pub fn functionality(&mut self, message: &Functionality<'_>) -> Result<(), RecordError> {
        self.write(message.stamp_secs, message)
    }

    /// Records what stands on the table.
    ///
    /// # Errors
    /// [`RecordError`] when the file cannot be written.
    pub fn inventory(&mut self, message: &Inventory<'_>) -> Result<(), RecordError> {
        self.write(message.stamp_secs, message)
    }

    /// Records the part to hold and draws it over the images.
    ///
    /// # Errors
    /// [`RecordError`] when the file cannot be written.
    pub fn masks(&mut self, message: &Masks) -> Result<(), RecordError> {
        for view in &message.views {
            if let Some(camera) = self.cameras.get(&view.camera) {
                camera.annotations(nanos(message.stamp_secs), view);
            }
        }
        self.write(message.stamp_secs, message)
    }

    /// Records the key point and shows it in the scene.
    ///
    /// # Errors
    /// [`RecordError`] when the file cannot be written.
    pub fn key_point(&mut self, message: &KeyPoint) -> Result<(), RecordError> {
        self.scene.key_point(message);
        self.write(message.stamp_secs, message)
    }

    /// Records the palm poses and shows them in the scene.
    ///
    /// # Errors
    /// [`RecordError`] when the file cannot be written.
    pub fn candidates(&mut self, message: &Candidates<'_>) -> Result<(), RecordError> {
        self.scene.candidates(message);
        self.write(message.stamp_secs, message)
    }

    /// Records a look of the cameras at its time of exposure.
    ///
    /// # Errors
    /// [`RecordError`] when an image cannot be encoded or the file cannot be written.
    pub fn observation(&mut self, observation: &Observation, detail: Detail) -> Result<(), RecordError> {
        let log_time_ns = nanos(observation.stamp_secs);
        for view in &observation.views {
            if !self.cameras.contains_key(&view.camera) {
                self.cameras.insert(view.camera.clone(), views::CameraChannels::new(&self.context, &view.camera));
            }
            let (colour, depth) = (views::jpeg(view, detail)?, views::depth_png(view, detail)?);
            if let Some(camera) = self.cameras.get(&view.camera) {
                camera.calibration(log_time_ns, &view.intrinsics);
                camera.images(log_time_ns, &colour, &depth);
            }
            if let Some(tap) = &self.tap {
                let image = |kind, bytes| Recorded::Image { camera: &view.camera, kind, log_time_ns, bytes };
                tap(&image(views::ImageKind::Colour, &colour));
                tap(&image(views::ImageKind::Depth, &depth));
            }
        }
        if detail == Detail::Full {
            self.cloud.log_with_time(&cloud::points(log_time_ns, self.frames.base(), observation), log_time_ns);
        }
        self.written(observation.stamp_secs)
    }

    /// Records the verdict and closes the file.
    ///
    /// # Errors
    /// [`RecordError`] when the file cannot be written.
    pub fn finish(mut self, stamp_secs: f64, verdict: &Verdict<'_>) -> Result<(), RecordError> {
        use foxglove::messages::log::Level;
        let is_good = verdict.outcome == sfg_types::Outcome::Success;
        let text = format!("verdict: {:?}", verdict.outcome);
        self.say(stamp_secs, if is_good { Level::Info } else { Level::Error }, "verdict", text);
        self.write(stamp_secs, verdict)?;
        self.file.finish()
    }
}

/// The schema of a message as it is written: what is always there is required.
pub(crate) fn schema_of<M: schemars::JsonSchema>() -> schemars::Schema {
    schemars::generate::SchemaSettings::default().for_serialize().into_generator().into_root_schema_for::<M>()
}

/// A channel with one of Foxglove's schemas.
pub(crate) fn typed<T: Encode>(context: &Arc<Context>, topic: &str) -> Channel<T> {
    ChannelBuilder::new(topic).context(context).build()
}

/// The driver's clock as Foxglove writes it.
pub(crate) fn timestamp(log_time_ns: u64) -> foxglove::messages::Timestamp {
    let secs = u32::try_from(log_time_ns / 1_000_000_000).unwrap_or(u32::MAX);
    foxglove::messages::Timestamp::new_checked(secs, (log_time_ns % 1_000_000_000) as u32)
        .unwrap_or(foxglove::messages::Timestamp::MAX)
}

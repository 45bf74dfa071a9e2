//! The messages of a run in memory, and its images.

use axum::body::Bytes;
use base64::Engine as _;
use serde::Serialize;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{Read as _, Seek as _, SeekFrom};
use std::path::PathBuf;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Samples of the robot come at 100 Hz; a page has no use for more than this.
const ROBOT_EVERY_SECS: f64 = 1.0 / 30.0;
/// Live images beyond this are dropped, the oldest of each camera first.
const MAX_LIVE_IMAGE_BYTES: usize = 256 << 20;

/// Which image of a camera.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum ImageKind {
    /// Colour.
    Colour,
    /// Depth, 16 bit, millimetres.
    Depth,
    /// A picture beside the cameras', such as the scene at the end.
    Picture,
}

impl ImageKind {
    /// The kind with a name as in addresses: `image`, `depth`, `picture`.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        match name {
            "image" => Some(Self::Colour),
            "depth" => Some(Self::Depth),
            "picture" => Some(Self::Picture),
            _ => None,
        }
    }

    fn name(self) -> &'static str {
        match self {
            Self::Colour => "image",
            Self::Depth => "depth",
            Self::Picture => "picture",
        }
    }
}

/// An encoded image.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Image {
    /// `image/jpeg` or `image/png`.
    pub media_type: &'static str,
    /// The file's bytes.
    pub bytes: Bytes,
}

/// Where an image is.
#[derive(Clone, Debug)]
pub(crate) enum ImageAt {
    /// A whole recorded message, in memory or at an offset in the file, and how it is written.
    Message(Form, Place),
    /// The image itself.
    Bytes(Bytes),
}

#[derive(Clone, Debug)]
pub(crate) enum Place {
    File { offset: u64, n_bytes: usize },
    Memory(Bytes),
}

/// How a recorded message with an image is written.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Form {
    /// JSON with base64.
    Json,
    /// Protobuf.
    Protobuf,
}

/// What the list of runs says about one.
#[derive(Clone, Debug, Default, Serialize)]
pub(crate) struct About {
    pub(crate) name: String,
    /// Whether more may come.
    pub(crate) live: bool,
    /// What the user should know: the recording is cut off.
    pub(crate) note: Option<String>,
    /// The metadata of the recording.
    pub(crate) metadata: BTreeMap<String, String>,
}

pub(crate) struct Entry {
    pub(crate) topic: u32,
    pub(crate) seconds: f64,
    pub(crate) bytes: Bytes,
}

#[derive(Default)]
struct Inner {
    about: About,
    topics: Vec<String>,
    entries: Vec<Entry>,
    robot_secs: Option<f64>,
    end_secs: f64,
    images: BTreeMap<(String, ImageKind), Vec<(f64, ImageAt)>>,
    n_image_bytes: usize,
}

/// The messages of one run, sorted by time, and where its images are.
#[derive(Default)]
pub struct Store {
    inner: Mutex<Inner>,
    /// The recording that images are read from.
    path: Option<PathBuf>,
}

impl std::fmt::Debug for Store {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let (name, n_messages) = (self.about().name, self.n_messages());
        f.debug_struct("Store").field("name", &name).field("n_messages", &n_messages).finish_non_exhaustive()
    }
}

/// Some messages on their way to a page: lines `[topic, seconds, message]`.
pub(crate) struct Batch {
    pub(crate) lines: Vec<u8>,
    pub(crate) n: usize,
    /// The number of the first message that is not in it.
    pub(crate) next: usize,
    /// Whether the run is over and this is all.
    pub(crate) is_end: bool,
}

impl Store {
    /// An empty store of a run that happens now.
    #[must_use]
    pub fn live(name: &str) -> Self {
        let store = Self::default();
        store.lock().about = About { name: name.to_owned(), live: true, ..About::default() };
        store
    }

    pub(crate) fn of_file(path: PathBuf, about: About) -> Self {
        let store = Self { path: Some(path), ..Self::default() };
        store.lock().about = About { live: false, ..about };
        store
    }

    fn lock(&self) -> MutexGuard<'_, Inner> {
        // A panic while it was held leaves whole entries.
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Appends a JSON message of `topic`; never waits for a viewer. Samples of the robot beyond 30 Hz are left out.
    pub fn push(&self, topic: &str, seconds: f64, bytes: &[u8]) {
        let mut inner = self.lock();
        inner.end_secs = inner.end_secs.max(seconds);
        if topic == "/robot" {
            if inner.robot_secs.is_some_and(|last| seconds >= last && seconds - last < ROBOT_EVERY_SECS - 1e-9) {
                return;
            }
            inner.robot_secs = Some(seconds);
        }
        let known = inner.topics.iter().position(|known| known == topic);
        let topic = known.unwrap_or_else(|| {
            inner.topics.push(topic.to_owned());
            inner.topics.len() - 1
        });
        inner.entries.push(Entry { topic: topic as u32, seconds, bytes: Bytes::copy_from_slice(bytes) });
    }

    /// Keeps an encoded image (JPEG or PNG) taken at `seconds` in memory; beyond 256 MiB the oldest go.
    pub fn push_image(&self, camera: &str, kind: ImageKind, seconds: f64, bytes: &[u8]) {
        let mut inner = self.lock();
        inner.n_image_bytes += bytes.len();
        let images = inner.images.entry((camera.to_owned(), kind)).or_default();
        images.push((seconds, ImageAt::Bytes(Bytes::copy_from_slice(bytes))));
        while inner.n_image_bytes > MAX_LIVE_IMAGE_BYTES {
            let oldest = inner.images.values_mut().filter(|images| images.len() > 1);
            let Some(images) = oldest.min_by(|a, b| a[0].0.total_cmp(&b[0].0)) else { break };
            let (_, dropped) = images.remove(0);
            if let ImageAt::Bytes(bytes) = dropped {
                inner.n_image_bytes -= bytes.len();
            }
        }
        // Pages learn of it by a message of its own, so that they know which images there are.
        drop(inner);
        self.note_image(camera, kind, seconds);
    }

    pub(crate) fn add_image(&self, camera: &str, kind: ImageKind, seconds: f64, at: ImageAt) {
        self.lock().images.entry((camera.to_owned(), kind)).or_default().push((seconds, at));
        self.note_image(camera, kind, seconds);
    }

    fn note_image(&self, camera: &str, kind: ImageKind, seconds: f64) {
        let message = serde_json::json!({"camera": camera, "kind": kind.name(), "stamp_secs": seconds});
        self.push("/image_index", seconds, message.to_string().as_bytes());
    }

    pub(crate) fn edit_about(&self, edit: impl FnOnce(&mut About)) {
        edit(&mut self.lock().about);
    }

    /// Puts the messages of a recording in order of time.
    pub(crate) fn sort(&self) {
        let mut inner = self.lock();
        inner.entries.sort_by(|a, b| a.seconds.total_cmp(&b.seconds));
        for images in inner.images.values_mut() {
            images.sort_by(|a, b| a.0.total_cmp(&b.0));
        }
    }

    /// Tells the viewers that the run is over.
    pub fn end(&self) {
        self.lock().about.live = false;
    }

    /// How many messages there are.
    #[must_use]
    pub fn n_messages(&self) -> usize {
        self.lock().entries.len()
    }

    /// Time of the newest message, seconds on the driver's clock.
    #[must_use]
    pub fn end_secs(&self) -> f64 {
        self.lock().end_secs
    }

    pub(crate) fn about(&self) -> About {
        self.lock().about.clone()
    }

    /// Messages from number `from` on: at most `max_bytes` of them, and one at least where there is one.
    pub(crate) fn since(&self, from: usize, max_bytes: usize) -> Batch {
        let inner = self.lock();
        let mut n_bytes = 0;
        let mut next = from.min(inner.entries.len());
        let mut taken: Vec<(u32, f64, Bytes)> = Vec::new();
        while let Some(entry) = inner.entries.get(next) {
            n_bytes += entry.bytes.len() + 40;
            if n_bytes > max_bytes && !taken.is_empty() {
                break;
            }
            taken.push((entry.topic, entry.seconds, entry.bytes.clone()));
            next += 1;
        }
        let is_end = !inner.about.live && next == inner.entries.len();
        let topics = inner.topics.clone();
        // The run does not wait while the lines are written.
        drop(inner);
        let mut lines = Vec::with_capacity(n_bytes.min(max_bytes) + 64);
        for (topic, seconds, bytes) in &taken {
            let topic = serde_json::Value::from(topics[*topic as usize].as_str());
            lines.extend_from_slice(format!("[{topic},{seconds},").as_bytes());
            lines.extend_from_slice(bytes);
            lines.extend_from_slice(b"]\n");
        }
        Batch { lines, n: taken.len(), next, is_end }
    }

    /// How far a viewer that has read up to `from` is behind, bytes.
    pub(crate) fn backlog(&self, from: usize) -> usize {
        self.lock().entries.iter().skip(from).map(|entry| entry.bytes.len()).sum()
    }

    /// The newest image of a camera at or before `seconds`; `None` when there is none, or when it cannot be read any more.
    #[must_use]
    pub fn image(&self, camera: &str, kind: ImageKind, seconds: f64) -> Option<Image> {
        let at = {
            let inner = self.lock();
            let images = inner.images.get(&(camera.to_owned(), kind))?;
            let n_before = images.partition_point(|(t, _)| *t <= seconds + 1e-6);
            images.get(n_before.checked_sub(1)?)?.1.clone()
        };
        let bytes = match at {
            ImageAt::Bytes(bytes) => bytes,
            ImageAt::Message(form, place) => {
                let message = match place {
                    Place::Memory(bytes) => bytes,
                    Place::File { offset, n_bytes } => {
                        let mut file = File::open(self.path.as_ref()?).ok()?;
                        file.seek(SeekFrom::Start(offset)).ok()?;
                        let mut message = vec![0; n_bytes];
                        file.read_exact(&mut message).ok()?;
                        Bytes::from(message)
                    }
                };
                match form {
                    Form::Json => json_image(&message)?,
                    Form::Protobuf => protobuf_image(&message)?,
                }
            }
        };
        let media_type = if bytes.starts_with(&[0xff, 0xd8]) { "image/jpeg" } else { "image/png" };
        Some(Image { media_type, bytes })
    }
}

fn json_image(message: &[u8]) -> Option<Bytes> {
    let message: serde_json::Value = serde_json::from_slice(message).ok()?;
    base64::engine::general_purpose::STANDARD.decode(message["data"].as_str()?).ok().map(Bytes::from)
}

/// Field 2, the data, of a `foxglove.CompressedImage`.
fn protobuf_image(message: &Bytes) -> Option<Bytes> {
    let mut at = 0;
    while at < message.len() {
        let key = varint(message, &mut at)?;
        match key & 7 {
            0 => drop(varint(message, &mut at)?),
            1 => at += 8,
            2 => {
                let n_bytes = usize::try_from(varint(message, &mut at)?).ok()?;
                let end = at.checked_add(n_bytes).filter(|end| *end <= message.len())?;
                if key >> 3 == 2 {
                    return Some(message.slice(at..end));
                }
                at = end;
            }
            5 => at += 4,
            _ => return None,
        }
    }
    None
}

fn varint(bytes: &[u8], at: &mut usize) -> Option<u64> {
    let mut value = 0;
    for shift in (0..64).step_by(7) {
        let byte = *bytes.get(*at)?;
        *at += 1;
        value |= u64::from(byte & 0x7f) << shift;
        if byte & 0x80 == 0 {
            return Some(value);
        }
    }
    None
}

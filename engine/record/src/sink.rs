//! Where messages go: the file, and the live socket.

use crate::RecordError;
use foxglove::websocket::{ChannelView, Client, ServerListener};
use foxglove::{
    Context, FoxgloveError, McapAttachment, McapWriteOptions, McapWriterHandle, Metadata, PartialMetadata, RawChannel, Sink,
    SinkId, WebSocketServerHandle,
};
use std::collections::BTreeMap;
use std::io::BufWriter;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError, Weak};
use std::thread::JoinHandle;
use std::time::Duration;

type Writer = McapWriterHandle<BufWriter<std::fs::File>>;

/// While the run thinks and writes nothing, what it wrote before must not wait.
const FLUSH_EVERY: Duration = Duration::from_millis(900);

/// The file, flushed by its owner and once a second of wall time.
pub(crate) struct File {
    path: PathBuf,
    /// None when it is closed.
    writer: Option<Arc<Writer>>,
    /// Something was written since the last flush.
    is_dirty: Arc<AtomicBool>,
    flusher: Option<(Sender<()>, JoinHandle<()>)>,
}

impl File {
    pub(crate) fn create(path: &Path, context: &Arc<Context>, metadata: &BTreeMap<String, String>) -> Result<Self, RecordError> {
        let io = |source| RecordError::Io { path: path.to_owned(), source };
        let file = std::fs::File::create(path).map_err(io)?;
        let failed = |source| RecordError::Mcap { path: path.to_owned(), source: Box::new(source) };
        // Compression would need C code; images are compressed by themselves.
        let options = McapWriteOptions::new().compression(None);
        let writer = Arc::new(context.mcap_writer_with_options(options).create(BufWriter::new(file)).map_err(failed)?);
        let metadata = if metadata.is_empty() { BTreeMap::from([(String::new(), String::new())]) } else { metadata.clone() };
        writer.write_metadata("run", metadata).and_then(|()| writer.flush()).map_err(failed)?;
        let is_dirty = Arc::new(AtomicBool::new(false));
        let (stop, stopped) = channel();
        let (weak, dirty): (Weak<Writer>, _) = (Arc::downgrade(&writer), Arc::clone(&is_dirty));
        let flush = move || {
            while stopped.recv_timeout(FLUSH_EVERY) == Err(RecvTimeoutError::Timeout) {
                let Some(writer) = weak.upgrade() else { break };
                // A failure shows again at the owner's next flush.
                if dirty.swap(false, Ordering::AcqRel) && writer.flush().is_err() {
                    dirty.store(true, Ordering::Release);
                }
            }
        };
        let thread = std::thread::Builder::new().name("flush recording".to_owned()).spawn(flush).map_err(io)?;
        Ok(Self { path: path.to_owned(), writer: Some(writer), is_dirty, flusher: Some((stop, thread)) })
    }

    /// Something was written.
    pub(crate) fn touch(&self) {
        self.is_dirty.store(true, Ordering::Release);
    }

    pub(crate) fn flush(&self) -> Result<(), RecordError> {
        self.is_dirty.store(false, Ordering::Release);
        self.with_writer(Writer::flush)
    }

    pub(crate) fn attach(&self, name: &str, media_type: &str, bytes: &[u8]) -> Result<(), RecordError> {
        let attachment = McapAttachment {
            log_time: 0,
            create_time: 0,
            name: name.to_owned(),
            media_type: media_type.to_owned(),
            data: bytes.into(),
        };
        self.with_writer(|writer| writer.attach(&attachment))
    }

    fn with_writer(&self, act: impl Fn(&Writer) -> Result<(), FoxgloveError>) -> Result<(), RecordError> {
        self.writer.as_ref().map_or(Ok(()), |writer| act(writer)).map_err(|source| self.failed(source))
    }

    pub(crate) fn failed(&self, source: FoxgloveError) -> RecordError {
        RecordError::Mcap { path: self.path.clone(), source: Box::new(source) }
    }

    fn stop_flushing(&mut self) {
        if let Some((stop, thread)) = self.flusher.take() {
            drop(stop);
            drop(thread.join());
        }
    }

    /// Closes the file with its summary.
    pub(crate) fn finish(mut self) -> Result<(), RecordError> {
        self.stop_flushing();
        // The flusher has ended, so nobody else holds the writer.
        if let Some(writer) = self.writer.take().and_then(Arc::into_inner) {
            let buffer = writer.close().map_err(|source| self.failed(source))?;
            buffer.into_inner().map_err(|error| RecordError::Io { path: self.path.clone(), source: error.into_error() })?;
        }
        Ok(())
    }
}

impl Drop for File {
    fn drop(&mut self) {
        self.stop_flushing();
    }
}

/// What is recorded once: whoever comes later gets the last message of these at once.
fn is_kept(topic: &str) -> bool {
    const STREAMS: &[&str] =
        &["/robot", "/tf", "/joint_states", "/journal", "/tree", "/blackboard", "/log", "/synergy", "/motors", "/truth"];
    !STREAMS.contains(&topic)
}

/// The last message of each channel that is not written all the time.
struct LastMessages {
    id: SinkId,
    by_topic: Mutex<BTreeMap<String, (u64, Vec<u8>)>>,
}

impl Sink for LastMessages {
    fn id(&self) -> SinkId {
        self.id
    }

    fn log(&self, channel: &RawChannel, message: &[u8], metadata: &Metadata) -> Result<(), FoxgloveError> {
        if is_kept(channel.topic()) {
            let mut by_topic = self.by_topic.lock().unwrap_or_else(PoisonError::into_inner);
            by_topic.insert(channel.topic().to_owned(), (metadata.log_time, message.to_vec()));
        }
        Ok(())
    }
}

struct Greeter {
    context: Weak<Context>,
    last: Arc<LastMessages>,
}

impl ServerListener for Greeter {
    fn on_subscribe(&self, client: Client, channel: ChannelView) {
        let (Some(context), Some(sink)) = (self.context.upgrade(), client.sink_id()) else { return };
        let kept = self.last.by_topic.lock().unwrap_or_else(PoisonError::into_inner).get(channel.topic()).cloned();
        if let (Some((log_time_ns, message)), Some(channel)) = (kept, context.get_channel_by_topic(channel.topic())) {
            channel.log_with_meta_to_sink(&message, PartialMetadata::with_log_time(log_time_ns), Some(sink));
        }
    }
}

/// What the last messages have to get through to those who look on, before the socket is closed.
const FAREWELL: Duration = Duration::from_millis(300);

/// The live socket: closed when it is dropped.
pub(crate) struct Live {
    server: Option<WebSocketServerHandle>,
    port: u16,
}

impl Live {
    /// Starts serving on the loopback address.
    pub(crate) fn start(context: &Arc<Context>, port: u16) -> Result<Self, RecordError> {
        let last = Arc::new(LastMessages { id: SinkId::next(), by_topic: Mutex::default() });
        context.add_sink(Arc::clone(&last) as Arc<dyn Sink>);
        let greeter = Greeter { context: Arc::downgrade(context), last };
        let server = context.websocket_server().name("sfg").bind("127.0.0.1", port).listener(Arc::new(greeter));
        let server = server.start_blocking().map_err(|source| RecordError::Port { port, source: Box::new(source) })?;
        Ok(Self { port: server.port(), server: Some(server) })
    }

    pub(crate) fn port(&self) -> u16 {
        self.port
    }
}

impl Drop for Live {
    fn drop(&mut self) {
        if let Some(server) = self.server.take() {
            if server.client_count() > 0 {
                std::thread::sleep(FAREWELL);
            }
            server.stop().wait_blocking();
        }
    }
}

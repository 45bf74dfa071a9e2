//! The live view: two sockets, one thread that accepts and one for each connection.

use super::GrootError;
use super::reply::reply;
use super::snapshot::Snapshot;
use super::zmtp::{self, Assembly, Frame, ZmtpError};
use crate::journal::Record;
use crate::tree::Tree;
use std::io::{self, Read, Write};
use std::net::{IpAddr, Ipv4Addr, Shutdown, TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

/// Of both sockets together; further clients are turned away.
const MAX_CONNECTIONS: usize = 16;
/// From the connection to the end of the handshake.
const HANDSHAKE: Duration = Duration::from_secs(2);
/// From the first byte of a message to its last.
const MESSAGE: Duration = Duration::from_secs(5);
/// For a reply, which may be long.
const REPLY: Duration = Duration::from_secs(10);
/// A silent client is asked whether it is still there, and then dropped.
const ASKED_AFTER: Duration = Duration::from_secs(10);
const DROPPED_AFTER: Duration = Duration::from_secs(30);
/// How often waiting threads look around.
const LOOK: Duration = Duration::from_millis(250);
const ACCEPT: Duration = Duration::from_millis(20);

/// What the threads share.
pub(super) struct Shared {
    pub(super) snapshot: Mutex<Snapshot>,
    /// The snapshot is new.
    pub(super) updated: Condvar,
    is_stopping: AtomicBool,
}

impl Shared {
    pub(super) fn new(snapshot: Snapshot) -> Self {
        Self { snapshot: Mutex::new(snapshot), updated: Condvar::new(), is_stopping: AtomicBool::new(false) }
    }
}

/// Shows a tree to Groot2 while it runs. Read-only: requests that would change what the tree does are refused.
///
/// Requests are answered on one port (1667 is usual), the publisher of BehaviorTree.CPP is on the next. It only publishes
/// breakpoints, so here it says nothing. The protocol has no authentication; hence the server is reachable from this machine
/// alone, unless [`Server::start_exposed`] says otherwise.
///
/// | limit | value |
/// |---|---|
/// | connections | 16 |
/// | request | 1 MiB, 32 parts, 5 s |
/// | reply | 10 s |
/// | silence | 30 s; a ping after 10 s, which ZeroMQ answers by itself |
///
/// Threads end and ports are free when it is dropped.
#[derive(Debug)]
pub struct Server {
    shared: Arc<Shared>,
    port: u16,
    acceptor: Option<JoinHandle<()>>,
}

impl std::fmt::Debug for Shared {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Shared").finish_non_exhaustive()
    }
}

impl Server {
    /// Usual port for requests.
    pub const PORT: u16 = 1667;

    /// A server that programs on this machine can reach. Port 0 takes any two free ports, see [`port`](Self::port).
    ///
    /// # Errors
    /// [`GrootError::TooManyNodes`], [`GrootError::NoNextPort`], [`GrootError::Port`], [`GrootError::NoThread`].
    pub fn start<C>(port: u16, tree: &Tree<C>) -> Result<Self, GrootError> {
        Self::start_exposed(Ipv4Addr::LOCALHOST.into(), port, tree)
    }

    /// A server at an address of this machine, or at all of them (`0.0.0.0`). Whoever reaches it reads the tree and its
    /// blackboard: only for networks where everybody may.
    ///
    /// # Errors
    /// Those of [`start`](Self::start).
    pub fn start_exposed<C>(address: IpAddr, port: u16, tree: &Tree<C>) -> Result<Self, GrootError> {
        if tree.n_nodes() > super::MAX_NODES {
            return Err(GrootError::TooManyNodes { n_nodes: tree.n_nodes() });
        }
        let (port, listeners) = bind(address, port)?;
        let shared = Arc::new(Shared::new(Snapshot::new(tree)));
        let for_acceptor = Arc::clone(&shared);
        let acceptor = thread::Builder::new()
            .name("groot2".to_owned())
            .spawn(move || accept(&for_acceptor, &listeners))
            .map_err(|source| GrootError::NoThread { source })?;
        Ok(Self { shared, port, acceptor: Some(acceptor) })
    }

    /// The port for requests.
    #[must_use]
    pub fn port(&self) -> u16 {
        self.port
    }

    /// Shows the tree as it is now; to be called after each tick with the records of [`Tree::drain_journal`].
    ///
    /// Without [`crate::JournalLevel::Transitions`] changes within a tick are not seen. After a reload, and for another tree, the
    /// UUID is new and clients read the definition again; one with more than [`MAX_NODES`](super::MAX_NODES) nodes is not shown,
    /// and clients are told so.
    ///
    /// A reload is told by where the tree lies in memory; after two reloads in a row without an update call [`show`](Self::show).
    ///
    /// The cost grows with the records, not with the clients: values are only shared here, every 100 ms or when one was asked for.
    pub fn update<C>(&self, tree: &Tree<C>, records: &[Record]) {
        self.shared.snapshot.lock().unwrap_or_else(PoisonError::into_inner).update(tree, records);
        self.shared.updated.notify_all();
    }

    /// Shows another tree, or the same one under a new UUID.
    pub fn show<C>(&self, tree: &Tree<C>) {
        self.shared.snapshot.lock().unwrap_or_else(PoisonError::into_inner).show(tree);
        self.shared.updated.notify_all();
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        self.shared.is_stopping.store(true, Ordering::Release);
        self.shared.updated.notify_all();
        if let Some(acceptor) = self.acceptor.take() {
            acceptor.thread().unpark();
            // It ends by a panic only if a thread cannot be joined; there is nobody to tell.
            let _ended = acceptor.join();
        }
    }
}

/// What a socket is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Role {
    Rep,
    Pub,
}

impl Role {
    fn name(self) -> &'static str {
        match self {
            Self::Rep => "REP",
            Self::Pub => "PUB",
        }
    }

    fn serves(self, peer: &[u8]) -> bool {
        match self {
            Self::Rep => matches!(peer, b"REQ" | b"DEALER"),
            Self::Pub => matches!(peer, b"SUB" | b"XSUB"),
        }
    }
}

type Listeners = [(Role, TcpListener); 2];

fn bind(address: IpAddr, port: u16) -> Result<(u16, Listeners), GrootError> {
    let open = |port: u16| {
        let listener = TcpListener::bind((address, port))?;
        listener.set_nonblocking(true)?;
        Ok::<_, io::Error>(listener)
    };
    let mut n_tries = 0;
    loop {
        let requests = open(port).map_err(|source| GrootError::Port { port, source })?;
        let found = requests.local_addr().map_err(|source| GrootError::Port { port, source })?.port();
        n_tries += 1;
        match found.checked_add(1).map(|next| (next, open(next))) {
            Some((_, Ok(publisher))) => return Ok((found, [(Role::Rep, requests), (Role::Pub, publisher)])),
            // Any two will do, but the port after the one that was free is taken.
            _ if port == 0 && n_tries < 64 => {}
            Some((next, Err(source))) => return Err(GrootError::Port { port: next, source }),
            None => return Err(GrootError::NoNextPort { port: found }),
        }
    }
}

struct Connection {
    stream: Arc<TcpStream>,
    thread: JoinHandle<()>,
}

fn accept(shared: &Arc<Shared>, listeners: &Listeners) {
    let mut connections: Vec<Connection> = Vec::new();
    while !shared.is_stopping.load(Ordering::Acquire) {
        connections.retain(|connection| !connection.thread.is_finished());
        let mut is_idle = true;
        for (role, listener) in listeners {
            let Ok((stream, _peer)) = listener.accept() else { continue };
            is_idle = false;
            if connections.len() < MAX_CONNECTIONS {
                connections.extend(connect(shared, *role, stream));
            }
        }
        if is_idle {
            thread::park_timeout(ACCEPT);
        }
    }
    for connection in &connections {
        // It may be closed already.
        let _closed = connection.stream.shutdown(Shutdown::Both);
    }
    for connection in connections {
        let _ended = connection.thread.join();
    }
}

/// A thread for a client, or nothing when the system gives none: then the client sees the connection close.
fn connect(shared: &Arc<Shared>, role: Role, stream: TcpStream) -> Option<Connection> {
    let stream = Arc::new(stream);
    let (for_thread, shared) = (Arc::clone(&stream), Arc::clone(shared));
    let serve = move || {
        // However it ends, the client sees the same; there is nobody here to tell.
        let _ended = serve(&shared, role, &for_thread);
        let _closed = for_thread.shutdown(Shutdown::Both);
    };
    let thread = thread::Builder::new().name("groot2 client".to_owned()).spawn(serve).ok()?;
    Some(Connection { stream, thread })
}

fn serve(shared: &Shared, role: Role, stream: &TcpStream) -> Result<(), ZmtpError> {
    stream.set_nonblocking(false)?;
    stream.set_nodelay(true)?;
    stream.set_read_timeout(Some(LOOK))?;
    stream.set_write_timeout(Some(LOOK))?;
    let mut link = Link { stream, is_stopping: &shared.is_stopping, deadline: Instant::now() + HANDSHAKE };
    link.write_all(&zmtp::greeting())?;
    zmtp::read_greeting(&mut link)?;
    link.write_all(&zmtp::ready(role.name()))?;
    match zmtp::read_frame(&mut link, zmtp::MAX_BYTES)? {
        Frame::Command { name, data } if name == b"READY" => {
            if !zmtp::socket_type(&data).is_some_and(|peer| role.serves(peer)) {
                link.write_all(&zmtp::command("ERROR", b"\x13Invalid socket type"))?;
                return Err(ZmtpError::Malformed("a socket of a type that this one does not serve"));
            }
        }
        _ => return Err(ZmtpError::Malformed("no READY after the greeting")),
    }
    let mut assembly = Assembly::default();
    loop {
        if !assembly.is_open() {
            link.wait()?;
            link.deadline = Instant::now() + MESSAGE;
        }
        match zmtp::read_frame(&mut link, assembly.n_left())? {
            Frame::Command { name, data } if name == b"PING" => {
                link.write_all(&zmtp::pong(&data).ok_or(ZmtpError::Malformed("a PING of a wrong length"))?)?;
            }
            // PONG; SUBSCRIBE and CANCEL of a subscriber that is never told anything.
            Frame::Command { .. } => {}
            Frame::Message { is_last, body } => {
                let Some(parts) = assembly.add(is_last, body)? else { continue };
                if role == Role::Rep {
                    link.deadline = Instant::now() + REPLY;
                    link.write_all(&envelope(shared, parts)?)?;
                }
            }
        }
    }
}

/// The reply to a message, under the addresses it came with.
fn envelope(shared: &Shared, mut parts: Vec<Vec<u8>>) -> Result<Vec<u8>, ZmtpError> {
    let delimiter = parts.iter().position(Vec::is_empty).ok_or(ZmtpError::Malformed("a request without a delimiter"))?;
    let request = parts.split_off(delimiter + 1);
    let body = reply(shared, &request);
    Ok(zmtp::message(parts.iter().chain(&body).map(Vec::as_slice)))
}

/// A connection whose reads and writes end at a deadline or with the server.
struct Link<'a> {
    stream: &'a TcpStream,
    is_stopping: &'a AtomicBool,
    deadline: Instant,
}

impl Link<'_> {
    /// Waits for the next byte; asks a silent peer whether it is there.
    fn wait(&mut self) -> Result<(), ZmtpError> {
        let begun = Instant::now();
        let mut was_asked = false;
        loop {
            match self.stream.peek(&mut [0]) {
                Ok(0) => return Err(io::Error::from(io::ErrorKind::UnexpectedEof).into()),
                Ok(_) => return Ok(()),
                Err(error) if !is_timeout(&error) => return Err(error.into()),
                Err(_timeout) => {}
            }
            self.deadline = begun + DROPPED_AFTER;
            self.check()?;
            if !was_asked && begun.elapsed() >= ASKED_AFTER {
                was_asked = true;
                self.write_all(&zmtp::ping())?;
            }
        }
    }

    fn check(&self) -> io::Result<()> {
        if self.is_stopping.load(Ordering::Acquire) {
            return Err(io::ErrorKind::ConnectionAborted.into());
        }
        if Instant::now() >= self.deadline { Err(io::ErrorKind::TimedOut.into()) } else { Ok(()) }
    }

    /// Does `once` until it says something other than that its time is over.
    fn patiently(&mut self, mut once: impl FnMut(&TcpStream) -> io::Result<usize>) -> io::Result<usize> {
        loop {
            self.check()?;
            match once(self.stream) {
                Err(error) if is_timeout(&error) => {}
                result => return result,
            }
        }
    }
}

impl Read for Link<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        self.patiently(|mut stream| stream.read(buffer))
    }
}

impl Write for Link<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.patiently(|mut stream| stream.write(bytes))
    }
    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

fn is_timeout(error: &io::Error) -> bool {
    matches!(error.kind(), io::ErrorKind::WouldBlock | io::ErrorKind::TimedOut | io::ErrorKind::Interrupted)
}

//! The page that shows a run while it happens or afterwards, and the server that it comes from.
//!
//! What goes in are the messages of a run: from its recording ([`Store::open`]), or one by one while it is recorded
//! ([`Store::push`]). What comes out is a page in the browser, and what its user asks of a running tree ([`Control`]). The
//! crate decides nothing about a run and knows no tree, robot or skill. The run never waits for a browser: it only appends
//! to the store, and each viewer reads on from there at its own pace.

mod control;
mod guard;
mod live;
mod page;
mod reader;
mod server;
mod store;

pub use control::{At, Breakpoint, Command, Control, Forced, Forcible, Go, Hit, Refused, Turn};
pub use server::{Options, Server};
pub use store::{Image, ImageKind, Store};

use std::net::SocketAddr;
use std::path::PathBuf;

/// The port of the page when none is given.
pub const DEFAULT_PORT: u16 = 8787;

/// Why a run cannot be shown.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum MonitorError {
    /// A recording cannot be read.
    #[error("cannot show {path}: {message}", path = .path.display())]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// Why, and what to do.
        message: String,
    },
    /// Another program has the port.
    #[error("port {port} is in use by another program, perhaps another sfg; choose another: --{option} {suggestion}")]
    PortInUse {
        /// The port.
        port: u16,
        /// Name of the option of the port.
        option: &'static str,
        /// Another port to try.
        suggestion: u16,
    },
    /// The server cannot be started.
    #[error("cannot serve the page at {address}: {source}")]
    Io {
        /// Where.
        address: SocketAddr,
        /// The system's reason.
        source: std::io::Error,
    },
    /// The address is not this machine's own and there is no token, or a token without an address.
    #[error("{0}")]
    Exposed(&'static str),
}

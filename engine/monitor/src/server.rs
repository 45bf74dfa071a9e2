//! The server of the page: its own thread, one request at a time, nothing of the run waits for it.

use crate::control::{Command, Control};
use crate::guard::{Guard, Refusal};
use crate::live::{self, Viewer};
use crate::store::{ImageKind, Store};
use crate::{MonitorError, page};
use axum::Router;
use axum::body::{Body, Bytes};
use axum::extract::ws::WebSocketUpgrade;
use axum::extract::{Path, Query, Request, State};
use axum::http::{HeaderMap, HeaderName, HeaderValue, StatusCode, header};
use axum::middleware::{self, Next};
use axum::response::{IntoResponse, Response};
use axum::routing::{any, get, post};
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::net::{IpAddr, Ipv4Addr, SocketAddr, TcpListener};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;
use tokio::sync::oneshot;

/// The body of a request is a command, never more.
const MAX_BODY_BYTES: usize = 16 << 10;
/// Further viewers are turned away.
const MAX_VIEWERS: usize = 32;
/// Viewers are given this long to take the last messages.
const FAREWELL: Duration = Duration::from_secs(1);

const CONTENT_SECURITY_POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; \
    connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

/// Where the page is served.
#[derive(Clone, Debug)]
pub struct Options {
    /// This machine alone (127.0.0.1) when left out; needs a token else.
    pub address: Option<IpAddr>,
    /// What requests must show; needs an address.
    pub token: Option<String>,
    /// The port; 0 takes a free one.
    pub port: u16,
    /// Name of the command line option of the port, for messages: `view`.
    pub port_option: &'static str,
}

impl Default for Options {
    fn default() -> Self {
        Self { address: None, token: None, port: crate::DEFAULT_PORT, port_option: "view" }
    }
}

/// Serves the page until it is dropped.
pub struct Server {
    address: SocketAddr,
    token: Option<String>,
    is_closing: Arc<AtomicBool>,
    n_viewers: Arc<AtomicUsize>,
    stop: Option<oneshot::Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl std::fmt::Debug for Server {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Server").field("address", &self.address).field("n_viewers", &self.n_viewers()).finish_non_exhaustive()
    }
}

struct Shared {
    runs: Vec<Arc<Store>>,
    control: Option<Arc<Control>>,
    guard: Guard,
    is_closing: Arc<AtomicBool>,
    n_viewers: Arc<AtomicUsize>,
}

type App = State<Arc<Shared>>;

impl Server {
    /// Starts to serve `runs`, of which the first may be controlled.
    ///
    /// # Errors
    /// [`MonitorError::PortInUse`], [`MonitorError::Exposed`] for an address without a token or the reverse,
    /// [`MonitorError::Io`] when the system refuses.
    pub fn start(options: &Options, runs: Vec<Arc<Store>>, control: Option<Arc<Control>>) -> Result<Self, MonitorError> {
        let ip = match (&options.address, &options.token) {
            (None, None) => IpAddr::V4(Ipv4Addr::LOCALHOST),
            (Some(address), Some(token)) if !token.is_empty() => *address,
            (Some(_), _) => {
                return Err(MonitorError::Exposed("--address lets other machines see the run: it needs --token TOKEN too"));
            }
            (None, Some(_)) => {
                return Err(MonitorError::Exposed("--token is for other machines: it needs --address ADDRESS too"));
            }
        };
        let wanted = SocketAddr::new(ip, options.port);
        let fail = |source| MonitorError::Io { address: wanted, source };
        let listener = TcpListener::bind(wanted).map_err(|source| match source.kind() {
            std::io::ErrorKind::AddrInUse => MonitorError::PortInUse {
                port: options.port,
                option: options.port_option,
                suggestion: options.port.checked_add(1).unwrap_or(crate::DEFAULT_PORT),
            },
            _ => fail(source),
        })?;
        listener.set_nonblocking(true).map_err(fail)?;
        let address = listener.local_addr().map_err(fail)?;
        let runtime = tokio::runtime::Builder::new_current_thread().enable_io().enable_time().build().map_err(fail)?;
        let (is_closing, n_viewers) = (Arc::new(AtomicBool::new(false)), Arc::new(AtomicUsize::new(0)));
        let guard = Guard { address, token: options.token.clone() };
        let shared = Shared { runs, control, guard, is_closing: Arc::clone(&is_closing), n_viewers: Arc::clone(&n_viewers) };
        let (stop, stopped) = oneshot::channel();
        let serve = move || {
            runtime.block_on(async move {
                let Ok(listener) = tokio::net::TcpListener::from_std(listener) else { return };
                let app = router(Arc::new(shared)).into_make_service();
                // Connections that are still open are dropped with the runtime.
                tokio::select! {
                    _ended = axum::serve(listener, app) => {}
                    _stopped = stopped => {}
                }
            });
        };
        let thread = std::thread::Builder::new().name("page".to_owned()).spawn(serve).map_err(fail)?;
        Ok(Self { address, token: options.token.clone(), is_closing, n_viewers, stop: Some(stop), thread: Some(thread) })
    }

    /// Where the page is, for the browser.
    #[must_use]
    pub fn url(&self) -> String {
        let token = self.token.as_ref().map_or_else(String::new, |token| format!("?token={}", percent_encoded(token)));
        format!("http://{}/{token}", self.address)
    }

    /// How many pages look on now.
    #[must_use]
    pub fn n_viewers(&self) -> usize {
        self.n_viewers.load(Ordering::Relaxed)
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        self.is_closing.store(true, Ordering::Relaxed);
        let begun = std::time::Instant::now();
        while self.n_viewers() > 0 && begun.elapsed() < FAREWELL {
            std::thread::sleep(Duration::from_millis(10));
        }
        if let Some(stop) = self.stop.take() {
            let _ended_already = stop.send(());
        }
        if let Some(thread) = self.thread.take() {
            drop(thread.join());
        }
    }
}

fn router(shared: Arc<Shared>) -> Router {
    Router::new()
        .route("/api/info", get(info))
        .route("/api/runs", get(runs))
        .route("/api/runs/{run}/messages", get(messages))
        .route("/api/runs/{run}/image", get(image))
        .route("/api/runs/{run}/live", any(live))
        .route("/api/control", post(order).get(state))
        .fallback(file)
        .layer(middleware::from_fn_with_state(Arc::clone(&shared), check))
        .with_state(shared)
}

/// Lets no request through that is not from the page itself, and gives every answer the same headers.
async fn check(State(shared): App, request: Request, next: Next) -> Response {
    let is_page = page::asset(request.uri().path()).is_some();
    let allowed = shared.guard.check(request.method(), request.uri(), request.headers(), is_page);
    let mut response = match allowed {
        Ok(()) => next.run(request).await,
        Err(refusal) => refusal.into_response(),
    };
    let headers = response.headers_mut();
    for (name, value) in [
        (header::CONTENT_SECURITY_POLICY, CONTENT_SECURITY_POLICY),
        (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
        (header::REFERRER_POLICY, "no-referrer"),
        (header::CACHE_CONTROL, "no-cache"),
        (HeaderName::from_static("cross-origin-resource-policy"), "same-origin"),
    ] {
        headers.entry(name).or_insert(HeaderValue::from_static(value));
    }
    response
}

impl IntoResponse for Refusal {
    fn into_response(self) -> Response {
        let body = serde_json::json!({"error": self.1}).to_string();
        (self.0, [(header::CONTENT_TYPE, "application/json")], body).into_response()
    }
}

fn refusal(status: StatusCode, message: impl Into<Cow<'static, str>>) -> Refusal {
    Refusal(status, message.into())
}

fn json(value: &serde_json::Value) -> Response {
    ([(header::CONTENT_TYPE, "application/json")], value.to_string()).into_response()
}

async fn file(request: Request) -> Result<Response, Refusal> {
    if request.method() != axum::http::Method::GET && request.method() != axum::http::Method::HEAD {
        return Err(refusal(StatusCode::METHOD_NOT_ALLOWED, "There is nothing to change here."));
    }
    match page::asset(request.uri().path()) {
        Some(asset) => Ok(([(header::CONTENT_TYPE, asset.media_type)], asset.text).into_response()),
        None => Err(refusal(StatusCode::NOT_FOUND, "The page has no such file.")),
    }
}

async fn info(State(shared): App) -> Response {
    json(&serde_json::json!({"engine": env!("CARGO_PKG_VERSION"), "control": shared.control.is_some()}))
}

async fn runs(State(shared): App) -> Response {
    let list = shared.runs.iter().map(|store| {
        let about = store.about();
        serde_json::json!({
            "name": about.name, "live": about.live, "note": about.note, "metadata": about.metadata,
            "duration": store.end_secs(), "messages": store.n_messages(),
        })
    });
    json(&serde_json::Value::Array(list.collect()))
}

fn run(shared: &Shared, number: &str) -> Result<Arc<Store>, Refusal> {
    let store = number.parse::<usize>().ok().and_then(|run| shared.runs.get(run));
    store.cloned().ok_or_else(|| refusal(StatusCode::NOT_FOUND, format!("There is no run {number}; /api/runs lists them.")))
}

async fn messages(State(shared): App, Path(number): Path<String>) -> Result<Response, Refusal> {
    let store = run(&shared, &number)?;
    let batch = store.since(0, usize::MAX);
    let next = HeaderValue::from(batch.next as u64);
    let headers =
        [(header::CONTENT_TYPE, HeaderValue::from_static("application/x-ndjson")), (HeaderName::from_static("x-next"), next)];
    Ok((headers, Body::from(batch.lines)).into_response())
}

async fn image(
    State(shared): App,
    Path(number): Path<String>,
    Query(query): Query<BTreeMap<String, String>>,
) -> Result<Response, Refusal> {
    let store = run(&shared, &number)?;
    let value = |name: &str| query.get(name).map_or("", String::as_str);
    let asked = (ImageKind::named(value("kind")), value("t").parse::<f64>());
    let (Some(kind), Ok(seconds)) = asked else {
        return Err(refusal(StatusCode::BAD_REQUEST, "expected ?camera=NAME&kind=image|depth|picture&t=SECONDS"));
    };
    let Some(image) = store.image(value("camera"), kind, seconds) else {
        return Err(refusal(StatusCode::NOT_FOUND, "There is no such image at or before that time."));
    };
    Ok(([(header::CONTENT_TYPE, image.media_type)], Body::from(image.bytes)).into_response())
}

async fn live(
    State(shared): App,
    Path(number): Path<String>,
    Query(query): Query<BTreeMap<String, String>>,
    upgrade: Result<WebSocketUpgrade, axum::extract::ws::rejection::WebSocketUpgradeRejection>,
) -> Result<Response, Refusal> {
    let store = run(&shared, &number)?;
    let upgrade = upgrade.map_err(|error| refusal(StatusCode::BAD_REQUEST, error.to_string()))?;
    if shared.n_viewers.load(Ordering::Relaxed) >= MAX_VIEWERS {
        return Err(refusal(StatusCode::SERVICE_UNAVAILABLE, "Too many viewers look on already; close one."));
    }
    let from = query.get("from").and_then(|from| from.parse().ok()).unwrap_or(0);
    let control = shared.control.clone().filter(|_| number == "0");
    let (is_closing, viewer) = (Arc::clone(&shared.is_closing), Viewer::new(&shared.n_viewers));
    Ok(upgrade
        .max_message_size(MAX_BODY_BYTES)
        .on_upgrade(move |socket| live::serve(socket, store, control, from, is_closing, viewer)))
}

async fn state(State(shared): App) -> Response {
    json(&shared.control.as_ref().map_or(serde_json::Value::Null, |control| control.to_json()))
}

async fn order(
    State(shared): App,
    headers: HeaderMap,
    body: Result<Bytes, axum::extract::rejection::BytesRejection>,
) -> Result<Response, Refusal> {
    let Some(control) = &shared.control else {
        return Err(refusal(
            StatusCode::FORBIDDEN,
            "This page only shows the run; start it with --view --control to pause, step or stop it.",
        ));
    };
    // A form of another site cannot send this type without being asked about first.
    if headers.get(header::CONTENT_TYPE).is_none_or(|kind| kind != "application/json") {
        return Err(refusal(StatusCode::UNSUPPORTED_MEDIA_TYPE, "A request is JSON: content-type: application/json."));
    }
    let Ok(body) = body else { return Err(refusal(StatusCode::PAYLOAD_TOO_LARGE, "The request is too long.")) };
    if body.len() > MAX_BODY_BYTES {
        return Err(refusal(StatusCode::PAYLOAD_TOO_LARGE, "The request is too long."));
    }
    let command: Command = match serde_json::from_slice(&body) {
        Ok(command) => command,
        Err(error) => return Err(refusal(StatusCode::BAD_REQUEST, format!("This is no request: {error}."))),
    };
    match control.order(&command) {
        Ok(()) => Ok(json(&control.to_json())),
        Err(refused) => Err(refusal(StatusCode::CONFLICT, format!("Not done: {refused}."))),
    }
}

fn percent_encoded(text: &str) -> String {
    text.bytes()
        .map(|byte| {
            if byte.is_ascii_alphanumeric() || b"-._~".contains(&byte) {
                char::from(byte).to_string()
            } else {
                format!("%{byte:02X}")
            }
        })
        .collect()
}

//! The server as browsers and others meet it.

#![allow(clippy::unwrap_used, reason = "tests fail by panicking")]

use serde_json::{Value, json};
use sfg_monitor::{Command, Control, Go, MonitorError, Options, Server, Store};
use std::io::{Read as _, Write as _};
use std::net::TcpStream;
use std::sync::Arc;
use std::time::{Duration, Instant};
use tungstenite::client::IntoClientRequest as _;
use tungstenite::{Message, WebSocket};

struct Reply {
    status: u16,
    head: String,
    body: String,
}

fn port(server: &Server) -> u16 {
    let url = server.url();
    url.split(':').nth(2).unwrap().split('/').next().unwrap().parse().unwrap()
}

fn start(store: &Arc<Store>, control: Option<Arc<Control>>) -> Server {
    Server::start(&Options { port: 0, ..Options::default() }, vec![Arc::clone(store)], control).unwrap()
}

/// Sends a request with these headers and no others.
fn ask(port: u16, method: &str, path: &str, headers: &[(&str, &str)], body: &str) -> Reply {
    let mut stream = TcpStream::connect(("127.0.0.1", port)).unwrap();
    stream.set_read_timeout(Some(Duration::from_secs(10))).unwrap();
    let mut request = format!("{method} {path} HTTP/1.1\r\nconnection: close\r\ncontent-length: {}\r\n", body.len());
    for (name, value) in headers {
        request += &format!("{name}: {value}\r\n");
    }
    write!(stream, "{request}\r\n{body}").unwrap();
    let mut text = Vec::new();
    stream.read_to_end(&mut text).unwrap();
    let text = String::from_utf8_lossy(&text).into_owned();
    let (head, body) = text.split_once("\r\n\r\n").unwrap();
    let status = head.split(' ').nth(1).unwrap().parse().unwrap();
    Reply { status, head: head.to_ascii_lowercase(), body: body.to_owned() }
}

fn get(server: &Server, path: &str) -> Reply {
    let port = port(server);
    ask(port, "GET", path, &[("host", &format!("127.0.0.1:{port}"))], "")
}

fn post(server: &Server, body: &str) -> Reply {
    let port = port(server);
    let host = format!("127.0.0.1:{port}");
    let headers = [("host", host.as_str()), ("origin", &format!("http://{host}")), ("content-type", "application/json")];
    ask(port, "POST", "/api/control", &headers, body)
}

fn look_on(server: &Server, from: usize) -> WebSocket<TcpStream> {
    let port = port(server);
    let stream = TcpStream::connect(("127.0.0.1", port)).unwrap();
    stream.set_read_timeout(Some(Duration::from_secs(10))).unwrap();
    let url = format!("ws://127.0.0.1:{port}/api/runs/0/live?from={from}");
    tungstenite::client(url.into_client_request().unwrap(), stream).unwrap().0
}

/// Messages of a viewer until one of them holds `last`.
fn read_until(socket: &mut WebSocket<TcpStream>, last: &str) -> Vec<String> {
    let mut lines = Vec::new();
    loop {
        let Message::Text(text) = socket.read().unwrap() else { continue };
        lines.extend(text.lines().map(str::to_owned));
        if text.contains(last) {
            return lines;
        }
    }
}

fn push(store: &Store, n: u32) {
    store.push("/tree", f64::from(n), json!({"node": "a", "tick": n, "from": "idle", "to": "running"}).to_string().as_bytes());
}

#[test]
fn the_page_comes_with_its_types_and_a_strict_policy() {
    let server = start(&Arc::new(Store::live("pour")), None);
    let page = get(&server, "/");
    assert_eq!(page.status, 200);
    assert!(page.body.contains("<script type=\"module\" src=\"main.js\">"));
    for part in [
        "content-type: text/html; charset=utf-8",
        "content-security-policy: default-src 'none'",
        "cache-control: no-cache",
        "nosniff",
    ] {
        assert!(page.head.contains(part), "{part} is not in {}", page.head);
    }
    assert!(!page.head.contains("unsafe"), "{}", page.head);
    let script = get(&server, "/main.js");
    assert!(script.head.contains("text/javascript"), "{}", script.head);
    // Every module that a script of the page names is served, and nothing is loaded from elsewhere.
    let mut open = vec!["main.js".to_owned()];
    let mut seen = Vec::new();
    while let Some(name) = open.pop() {
        let reply = get(&server, &format!("/{name}"));
        assert_eq!(reply.status, 200, "{name}");
        let texts = reply.body.split(['"', '`']);
        open.extend(texts.filter_map(|text| text.strip_prefix("./")).map(str::to_owned).filter(|name| !seen.contains(name)));
        seen.push(name);
    }
    assert!(seen.len() > 10, "{seen:?}");
    assert_eq!(get(&server, "/nothing.js").status, 404);
    assert_eq!(get(&server, "/../Cargo.toml").status, 404);
}

#[test]
fn other_hosts_and_other_sites_get_nothing() {
    let store = Arc::new(Store::live("pour"));
    push(&store, 1);
    let control = Arc::new(Control::new());
    let server = start(&store, Some(Arc::clone(&control)));
    let port = port(&server);
    let host = format!("127.0.0.1:{port}");
    for path in ["/", "/api/runs", "/api/runs/0/messages", "/api/runs/0/live"] {
        let reply = ask(port, "GET", path, &[("host", &format!("rebound.example:{port}"))], "");
        assert_eq!(reply.status, 421, "{path}");
        assert!(!reply.body.contains("running"), "{}", reply.body);
    }
    let evil = [("host", host.as_str()), ("origin", "http://evil.example"), ("content-type", "application/json")];
    for path in ["/api/runs", "/api/runs/0/messages", "/api/runs/0/image?camera=left&kind=image&t=0"] {
        assert_eq!(ask(port, "GET", path, &evil, "").status, 403, "{path}");
    }
    assert_eq!(ask(port, "POST", "/api/control", &evil, r#"{"command":"stop"}"#).status, 403);
    assert_eq!(control.turn().go, Go::Tick);
    // A form of another site, from a browser that sends no Origin.
    let form = [("host", host.as_str()), ("content-type", "text/plain")];
    assert_eq!(ask(port, "POST", "/api/control", &form, r#"{"command":"stop"}"#).status, 415);
    assert_eq!(control.turn().go, Go::Tick);
    // The WebSocket, which browsers open across sites.
    let stream = TcpStream::connect(("127.0.0.1", port)).unwrap();
    let mut request = format!("ws://{host}/api/runs/0/live").into_client_request().unwrap();
    request.headers_mut().insert("origin", "http://evil.example".parse().unwrap());
    let refused = tungstenite::client(request, stream).err().unwrap().to_string();
    assert!(refused.contains("403"), "{refused}");
    assert_eq!(server.n_viewers(), 0);
}

#[test]
fn an_address_needs_a_token_and_the_token_is_asked_for() {
    let store = Arc::new(Store::live("pour"));
    let address = Some("127.0.0.1".parse().unwrap());
    for options in [
        Options { address, port: 0, ..Options::default() },
        Options { address, token: Some(String::new()), port: 0, ..Options::default() },
        Options { token: Some("t".to_owned()), port: 0, ..Options::default() },
    ] {
        let error = Server::start(&options, vec![Arc::clone(&store)], None).err().unwrap();
        assert!(matches!(error, MonitorError::Exposed(_)), "{error}");
    }
    let options = Options { address, token: Some("se cret".to_owned()), port: 0, ..Options::default() };
    let server = Server::start(&options, vec![store], None).unwrap();
    assert!(server.url().ends_with("?token=se%20cret"), "{}", server.url());
    assert_eq!(get(&server, "/").status, 200);
    for (path, status) in [("/api/runs", 401), ("/api/runs?token=wrong", 401), ("/api/runs?token=se%20cret", 200)] {
        assert_eq!(get(&server, path).status, status, "{path}");
    }
    let stream = TcpStream::connect(("127.0.0.1", port(&server))).unwrap();
    let url = format!("ws://127.0.0.1:{}/api/runs/0/live", port(&server));
    let refused = tungstenite::client(url.into_client_request().unwrap(), stream).err().unwrap().to_string();
    assert!(refused.contains("401"), "{refused}");
}

#[test]
fn a_port_in_use_is_named_with_another_one() {
    let first = start(&Arc::new(Store::live("a")), None);
    let options = Options { port: port(&first), ..Options::default() };
    let error = Server::start(&options, vec![Arc::new(Store::live("b"))], None).err().unwrap().to_string();
    assert!(error.contains(&format!("port {} is in use", options.port)), "{error}");
    assert!(error.contains(&format!("--view {}", options.port + 1)), "{error}");
    drop(first);
    assert!(Server::start(&options, vec![Arc::new(Store::live("b"))], None).is_ok(), "the port is free again");
}

#[test]
fn two_viewers_see_every_message_and_a_late_one_too() {
    let store = Arc::new(Store::live("pour"));
    let server = start(&store, None);
    let (mut first, mut second) = (look_on(&server, 0), look_on(&server, 0));
    for n in 0..500 {
        push(&store, n);
    }
    store.end();
    let (a, b) = (read_until(&mut first, r#"{"over":true}"#), read_until(&mut second, r#"{"over":true}"#));
    assert_eq!(a, b);
    assert_eq!(a.len(), 501);
    let last: Value = serde_json::from_str(&a[499]).unwrap();
    assert_eq!((last[0].as_str(), last[1].as_f64(), last[2]["tick"].as_u64()), (Some("/tree"), Some(499.0), Some(499)));
    let mut late = look_on(&server, 490);
    assert_eq!(read_until(&mut late, r#"{"over":true}"#).len(), 11);
    let all = get(&server, "/api/runs/0/messages");
    assert!(all.head.contains("x-next: 500"), "{}", all.head);
}

#[test]
fn a_viewer_that_takes_nothing_or_vanishes_does_not_hold_up_the_run() {
    let store = Arc::new(Store::live("pour"));
    let server = start(&store, None);
    let stuck = look_on(&server, 0);
    let gone = look_on(&server, 0);
    let begun = Instant::now();
    while server.n_viewers() < 2 {
        assert!(begun.elapsed() < Duration::from_secs(5));
        std::thread::sleep(Duration::from_millis(5));
    }
    drop(gone);
    let long = json!({"text": "x".repeat(1 << 20)}).to_string();
    let begun = Instant::now();
    let mut slowest = Duration::ZERO;
    for n in 0..60 {
        let one = Instant::now();
        store.push("/log", f64::from(n), long.as_bytes());
        slowest = slowest.max(one.elapsed());
        std::thread::sleep(Duration::from_millis(2));
    }
    assert!(begun.elapsed() < Duration::from_secs(5), "60 messages of 1 MB took {:?}", begun.elapsed());
    assert!(slowest < Duration::from_millis(500), "the run waited {slowest:?} for a viewer");
    // The vanished one is noticed.
    let begun = Instant::now();
    while server.n_viewers() > 1 {
        assert!(begun.elapsed() < Duration::from_secs(5), "{} viewers", server.n_viewers());
        std::thread::sleep(Duration::from_millis(20));
    }
    // The one that took nothing is told to load anew once it reads again.
    let mut stuck = stuck;
    let lines = read_until(&mut stuck, r#"{"reload":true}"#);
    assert!(lines.len() < 60, "{} messages came", lines.len());
}

#[test]
fn without_control_every_request_is_refused_with_a_sentence() {
    let server = start(&Arc::new(Store::live("pour")), None);
    for command in ["pause", "stop", "halt"] {
        let reply = post(&server, &json!({"command": command}).to_string());
        assert_eq!(reply.status, 403);
        assert!(reply.body.contains("--control"), "{}", reply.body);
    }
}

#[test]
fn commands_reach_the_gate_and_mistakes_are_named() {
    let control = Arc::new(Control::new());
    control.set_nodes(["sequence".to_owned()]);
    let server = start(&Arc::new(Store::live("pour")), Some(Arc::clone(&control)));
    let mut viewer = look_on(&server, 0);
    assert!(read_until(&mut viewer, "control")[0].contains(r#""paused":false"#));
    assert_eq!(post(&server, r#"{"command":"pause"}"#).status, 200);
    assert_eq!(control.turn().go, Go::Hold);
    assert!(read_until(&mut viewer, "control").concat().contains(r#""paused":true"#));
    let forced = post(&server, r#"{"command":"force","node":"sequence","status":"failure"}"#);
    assert!(forced.body.contains("sequence"), "{}", forced.body);
    for (body, status) in [
        (r#"{"command":"force","node":"nowhere","status":"failure"}"#, 409),
        (r#"{"command":"force","node":"sequence","status":"running"}"#, 400),
        (r#"{"command":"fly"}"#, 400),
        ("", 400),
        (&"x".repeat(20_000), 413),
    ] {
        assert_eq!(post(&server, body).status, status, "{}", &body[..body.len().min(60)]);
    }
    assert_eq!(post(&server, r#"{"command":"stop"}"#).status, 200);
    assert_eq!(control.turn().go, Go::EmergencyStop);
    control.end();
    assert_eq!(post(&server, r#"{"command":"continue"}"#).status, 409);
    assert!(control.order(&Command::Pause).is_err());
}

#[test]
fn images_are_found_by_camera_kind_and_time() {
    let store = Arc::new(Store::live("pour"));
    store.push_image("left", sfg_monitor::ImageKind::Colour, 1.0, &[0xff, 0xd8, 1]);
    store.push_image("left", sfg_monitor::ImageKind::Colour, 2.0, &[0xff, 0xd8, 2]);
    let server = start(&store, None);
    let image = |query: &str| get(&server, &format!("/api/runs/0/image?{query}"));
    assert_eq!(image("camera=left&kind=image&t=0.5").status, 404);
    assert!(image("camera=left&kind=image&t=1.9").head.contains("image/jpeg"));
    assert!(image("camera=left&kind=image&t=1.9").body.ends_with('\u{1}'));
    assert!(image("camera=left&kind=image&t=99").body.ends_with('\u{2}'));
    assert_eq!(image("camera=left&kind=depth&t=9").status, 404);
    assert_eq!(image("camera=left&kind=smell&t=9").status, 400);
    assert_eq!(get(&server, "/api/runs/7/messages").status, 404);
}

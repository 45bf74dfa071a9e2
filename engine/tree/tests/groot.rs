//! The live view and the log as a program on the other side sees them.
#![allow(clippy::unwrap_used, reason = "tests fail by panicking")]

use sfg_tree::groot::{BtlogWriter, GrootError, MAX_NODES, Server, tree_xml};
use sfg_tree::{
    Action, Direction, JournalLevel, NodeSpec, Outcome, PortSpec, Progress, Registry, Status, SubtreePort, SubtreeSpec, Tick,
    Tree, TreeSpec,
};
use std::collections::BTreeMap;
use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::time::{Duration, Instant};

/// Measures for three ticks.
#[derive(Default)]
struct Measure(u32);

impl Action<()> for Measure {
    fn start(&mut self, tick: &mut Tick<'_, ()>) -> Outcome {
        self.0 = 0;
        self.poll(tick)
    }
    fn poll(&mut self, tick: &mut Tick<'_, ()>) -> Outcome {
        self.0 += 1;
        tick.set("width_m", f64::from(self.0) / 4.0);
        Ok(if self.0 == 3 { Progress::Success } else { Progress::Running })
    }
}

struct Mesh;

fn registry() -> Registry<()> {
    let mut registry = Registry::<()>::new();
    registry.action("measure", [PortSpec::output::<f64>("width_m")], Measure::default);
    registry.step("look", [PortSpec::output::<Mesh>("mesh")], |tick| {
        tick.set("mesh", Mesh);
        Ok(())
    });
    registry
}

fn spec() -> TreeSpec {
    let port = SubtreePort { name: "width_m".to_owned(), direction: Direction::Out, default: None, location: 0 };
    let inner = NodeSpec::new("sequence").child(NodeSpec::new("look")).child(NodeSpec::new("measure"));
    let grasp = SubtreeSpec { name: "grasp".to_owned(), ports: vec![port], root: inner, ..SubtreeSpec::default() };
    let root = NodeSpec::new("sequence")
        .child(NodeSpec::subtree("grasp"))
        .child(NodeSpec::new("set_blackboard").with("value", vec!["cup", "jug"]).with_key("output_key", "parts"))
        .child(NodeSpec::new("sleep").with("secs", 1.0));
    TreeSpec::new(root).subtree(grasp)
}

fn tree() -> Tree<()> {
    let mut tree = registry().build(&spec()).unwrap();
    tree.set_journal_level(JournalLevel::Transitions);
    tree
}

/// A ZeroMQ client of one connection: enough to ask and to subscribe.
struct Client(TcpStream);

impl Client {
    fn connect(port: u16, socket_type: &str) -> Self {
        let mut stream = TcpStream::connect(("127.0.0.1", port)).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(5))).unwrap();
        stream.set_nodelay(true).unwrap();
        let mut greeting = [0; 64];
        (greeting[0], greeting[9], greeting[10]) = (0xff, 0x7f, 3);
        greeting[12..16].copy_from_slice(b"NULL");
        // In pieces, as a ZeroMQ library sends it.
        stream.write_all(&greeting[..10]).unwrap();
        stream.write_all(&greeting[10..]).unwrap();
        let mut theirs = [0; 64];
        stream.read_exact(&mut theirs).unwrap();
        assert_eq!((theirs[0], theirs[9], theirs[10]), (0xff, 0x7f, 3));
        let mut ready = b"\x05READY\x0bSocket-Type\0\0\0".to_vec();
        ready.push(u8::try_from(socket_type.len()).unwrap());
        ready.extend(socket_type.as_bytes());
        let mut client = Self(stream);
        client.send(4, &ready);
        let (flags, body) = client.frame().unwrap();
        assert_eq!((flags, &body[..6]), (4, &b"\x05READY"[..]));
        client
    }

    fn send(&mut self, flags: u8, body: &[u8]) {
        self.0.write_all(&[flags, u8::try_from(body.len()).unwrap()]).unwrap();
        self.0.write_all(body).unwrap();
    }

    fn frame(&mut self) -> std::io::Result<(u8, Vec<u8>)> {
        let mut flags = [0];
        self.0.read_exact(&mut flags)?;
        let length = if flags[0] & 2 == 0 {
            let mut length = [0];
            self.0.read_exact(&mut length)?;
            u64::from(length[0])
        } else {
            let mut length = [0; 8];
            self.0.read_exact(&mut length)?;
            u64::from_be_bytes(length)
        };
        let mut body = vec![0; usize::try_from(length).unwrap()];
        self.0.read_exact(&mut body)?;
        Ok((flags[0] & !2, body))
    }

    /// The parts of the next message, without the delimiter.
    fn message(&mut self) -> Vec<Vec<u8>> {
        assert_eq!(self.frame().unwrap(), (1, vec![]), "a delimiter comes first");
        let mut parts = Vec::new();
        loop {
            let (flags, body) = self.frame().unwrap();
            parts.push(body);
            if flags == 0 {
                return parts;
            }
        }
    }

    fn ask(&mut self, kind: u8, text: Option<&str>) -> Vec<Vec<u8>> {
        self.send(1, b"");
        self.send(u8::from(text.is_some()), &[2, kind, 1, 2, 3, 4]);
        if let Some(text) = text {
            self.send(0, text.as_bytes());
        }
        let parts = self.message();
        if parts[0] != b"error" {
            assert_eq!((&parts[0][..6], parts[0].len()), (&[2, kind, 1, 2, 3, 4][..], 22));
        }
        parts
    }

    fn uuid(&mut self) -> Vec<u8> {
        self.ask(b'S', None)[0][6..].to_vec()
    }

    /// The statuses in the order of the nodes.
    fn statuses(&mut self) -> Vec<u8> {
        let body = self.ask(b'S', None).remove(1);
        for (node, number) in body.chunks_exact(3).zip(1_u16..) {
            assert_eq!(node[..2], number.to_le_bytes());
        }
        body.chunks_exact(3).map(|node| node[2]).collect()
    }

    fn board(&mut self, names: &str) -> BTreeMap<String, BTreeMap<String, String>> {
        let body = self.ask(b'B', Some(names)).remove(1);
        let mut rest = &body[..];
        let board = (0..unpack_length(&mut rest, 0x80))
            .map(|_| {
                let name = unpack_text(&mut rest);
                let n_entries = unpack_length(&mut rest, 0x80);
                (name, (0..n_entries).map(|_| (unpack_text(&mut rest), unpack(&mut rest))).collect())
            })
            .collect();
        assert!(rest.is_empty());
        board
    }

    fn is_closed(&mut self) -> bool {
        self.0.set_read_timeout(Some(Duration::from_secs(8))).unwrap();
        // Closed with bytes unread is a reset.
        self.0.read(&mut [0; 512]).map_or_else(|error| error.kind() == std::io::ErrorKind::ConnectionReset, |n| n == 0)
    }
}

fn take<'b>(rest: &mut &'b [u8], n: usize) -> &'b [u8] {
    let (taken, left) = rest.split_at(n);
    *rest = left;
    taken
}

fn unpack_length(rest: &mut &[u8], marker: u8) -> usize {
    let byte = take(rest, 1)[0];
    assert_eq!(byte & 0xf0, marker);
    usize::from(byte & 0x0f)
}

fn unpack_text(rest: &mut &[u8]) -> String {
    let byte = take(rest, 1)[0];
    assert_eq!(byte & 0xe0, 0xa0);
    String::from_utf8(take(rest, usize::from(byte & 0x1f)).to_vec()).unwrap()
}

fn unpack(rest: &mut &[u8]) -> String {
    match rest[0] {
        0xcb => f64::from_be_bytes(take(rest, 9)[1..].try_into().unwrap()).to_string(),
        0x00..=0x7f => take(rest, 1)[0].to_string(),
        0x90..=0x9f => {
            let n_items = unpack_length(rest, 0x90);
            format!("{:?}", (0..n_items).map(|_| unpack(rest)).collect::<Vec<_>>())
        }
        _ => unpack_text(rest),
    }
}

fn tick(tree: &mut Tree<()>, server: &Server, now_secs: f64) -> Status {
    let status = tree.tick(now_secs, &mut ());
    let records = tree.drain_journal();
    server.update(tree, &records);
    status
}

#[test]
fn a_client_sees_the_tree_its_statuses_and_its_blackboard() {
    let mut tree = tree();
    let server = Server::start(0, &tree).unwrap();
    let mut client = Client::connect(server.port(), "REQ");

    assert_eq!(String::from_utf8(client.ask(b'T', None).remove(1)).unwrap(), tree_xml(&tree));
    assert_eq!(client.statuses(), [0; 7]);
    assert_eq!(client.board("MainTree;sequence/grasp;nobody").len(), 2);
    assert_eq!(client.board("MainTree")["MainTree"].len(), 0, "nothing is written yet");

    assert_eq!(tick(&mut tree, &server, 0.0), Status::Running);
    assert_eq!(client.statuses(), [1, 1, 1, 2, 1, 0, 0]);
    assert_eq!(tick(&mut tree, &server, 0.1), Status::Running);
    assert_eq!(tick(&mut tree, &server, 0.2), Status::Running);
    // The last values may not have been taken yet; asking makes the next update take them.
    let board = std::thread::scope(|scope| {
        let answer = scope.spawn(|| client.board("MainTree;sequence/grasp"));
        while !answer.is_finished() {
            server.update(&tree, &[]);
            std::thread::sleep(Duration::from_millis(1));
        }
        answer.join().unwrap()
    });
    assert_eq!(board["MainTree"]["width_m"], "0.75");
    assert_eq!(board["MainTree"]["parts"], r#"["cup", "jug"]"#);
    assert_eq!(board["sequence/grasp"]["width_m"], "0.75", "a connected key is seen from both sides");
    assert_eq!(board["sequence/grasp"]["mesh"], "Mesh", "a value without a literal form is its type");
    assert!(!board["MainTree"].contains_key("mesh"));

    assert_eq!(tick(&mut tree, &server, 5.0), Status::Success);
    assert_eq!(client.statuses(), [12; 7]);
}

#[test]
fn a_client_records_transitions_and_cannot_set_hooks() {
    let mut tree = tree();
    let server = Server::start(0, &tree).unwrap();
    let mut client = Client::connect(server.port(), "REQ");
    let since_1970: u64 = String::from_utf8(client.ask(b'r', Some("start")).remove(1)).unwrap().parse().unwrap();
    assert!(since_1970 > 1_700_000_000_000_000);
    tick(&mut tree, &server, 0.25);
    let transitions = client.ask(b't', None).remove(1);
    assert_eq!(transitions[..18], [0x90, 0xd0, 3, 0, 0, 0, 1, 0, 1, 0x90, 0xd0, 3, 0, 0, 0, 2, 0, 1]);
    assert_eq!(client.ask(b't', None)[1], [0; 0]);
    assert_eq!(client.ask(b'r', Some("stop")).len(), 1);

    assert_eq!(client.ask(b'D', None)[1], b"[]");
    let hook = r#"{"enabled":true,"uid":1,"mode":1,"once":true,"desired_status":"FAILURE","position":0}"#;
    for kind in *b"IURAX" {
        assert_eq!(client.ask(kind, Some(hook)), [b"error".to_vec(), b"read-only".to_vec()]);
    }
    assert_eq!(tick(&mut tree, &server, 0.5), Status::Running);
}

#[test]
fn a_reloaded_tree_has_another_uuid() {
    let mut tree = tree();
    let server = Server::start(0, &tree).unwrap();
    let mut client = Client::connect(server.port(), "REQ");
    tick(&mut tree, &server, 0.0);
    let (uuid, xml) = (client.uuid(), client.ask(b'T', None).remove(1));
    tick(&mut tree, &server, 0.1);
    assert_eq!(client.uuid(), uuid);
    let mut changed = spec();
    changed.root.children.push(NodeSpec::new("always_failure"));
    tree.reload(&registry(), &changed).unwrap();
    tick(&mut tree, &server, 0.2);
    assert_ne!(client.uuid(), uuid);
    assert_eq!(client.statuses(), [1, 2, 0, 0, 0, 2, 1, 0], "what ran runs on");
    let new_xml = client.ask(b'T', None).remove(1);
    assert_eq!(new_xml, tree_xml(&tree).into_bytes());
    assert_ne!(new_xml, xml);
    let uuid = client.uuid();
    server.show(&tree);
    assert_ne!(client.uuid(), uuid);
}

#[test]
fn a_subscriber_is_accepted_and_told_nothing() {
    let server = Server::start(0, &tree()).unwrap();
    let mut old = Client::connect(server.port() + 1, "SUB");
    let mut new = Client::connect(server.port() + 1, "XSUB");
    old.send(0, b"\x01");
    new.send(4, b"\x09SUBSCRIBEabc");
    for client in [&mut old, &mut new] {
        client.send(4, b"\x04PING\0\x64hello");
        assert_eq!(client.frame().unwrap(), (4, b"\x04PONGhello".to_vec()), "the first thing it hears");
    }
}

#[test]
fn a_dealer_gets_its_addresses_back() {
    let server = Server::start(0, &tree()).unwrap();
    let mut client = Client::connect(server.port(), "DEALER");
    client.send(1, b"way back");
    client.send(1, b"");
    client.send(0, b"\x02D\0\0\0\0");
    let parts: Vec<(u8, Vec<u8>)> = (0..4).map(|_| client.frame().unwrap()).collect();
    assert_eq!((&parts[0], &parts[1], &parts[3]), (&(1, b"way back".to_vec()), &(1, vec![]), &(0, b"[]".to_vec())));
}

#[test]
fn who_does_not_keep_to_the_protocol_is_dropped_and_others_are_served() {
    let server = Server::start(0, &tree()).unwrap();
    let raw = |bytes: &[u8]| {
        let mut stream = TcpStream::connect(("127.0.0.1", server.port())).unwrap();
        // The other side may be gone before all is written.
        let _written = stream.write_all(bytes);
        Client(stream)
    };
    let mut dropped = vec![raw(b"GET / HTTP/1.1\r\n\r\n"), raw(&[0; 64]), raw(&[0xff; 4096]), raw(b"")];
    let after_ready = |bytes: &[u8]| {
        let mut client = Client::connect(server.port(), "REQ");
        client.0.write_all(bytes).unwrap();
        client
    };
    dropped.push(after_ready(b"\x08\x00"));
    dropped.push(after_ready(b"\x02\xff\xff\xff\xff\xff\xff\xff\xff"));
    dropped.push(after_ready(b"\x00\x02no"));
    // Begun and never ended.
    dropped.push(after_ready(b"\x01\x00\x00\xff"));
    let begun = Instant::now();
    let mut good = Client::connect(server.port(), "REQ");
    assert_eq!(good.statuses(), [0; 7]);
    assert!(begun.elapsed() < Duration::from_secs(1));
    for (client_idx, client) in dropped.iter_mut().enumerate() {
        let is_closed = client.is_closed() || client.is_closed();
        assert!(is_closed, "client {client_idx}");
    }
    assert_eq!(good.statuses(), [0; 7]);
}

#[test]
fn a_wrong_socket_type_is_told_so() {
    let server = Server::start(0, &tree()).unwrap();
    for (port, socket_type) in [(server.port(), "SUB"), (server.port() + 1, "REQ")] {
        let mut client = Client::connect(port, socket_type);
        assert_eq!(client.frame().unwrap(), (4, b"\x05ERROR\x13Invalid socket type".to_vec()));
        assert!(client.is_closed());
    }
}

#[test]
fn there_is_room_for_sixteen_clients() {
    let server = Server::start(0, &tree()).unwrap();
    let mut clients: Vec<Client> = (0..16).map(|_| Client::connect(server.port(), "REQ")).collect();
    let mut further = Client(TcpStream::connect(("127.0.0.1", server.port())).unwrap());
    assert!(further.is_closed());
    for client in &mut clients {
        assert_eq!(client.statuses(), [0; 7]);
    }
    clients.truncate(15);
    // The thread of the last one needs a moment to end.
    let deadline = Instant::now() + Duration::from_secs(5);
    loop {
        let stream = TcpStream::connect(("127.0.0.1", server.port())).unwrap();
        stream.set_read_timeout(Some(Duration::from_millis(300))).unwrap();
        // A served client is greeted.
        if (&stream).read(&mut [0; 64]).is_ok_and(|n| n > 0) {
            break;
        }
        assert!(Instant::now() < deadline);
    }
}

/// Whatever 300 clients send, the server stays and serves.
#[test]
fn noise_on_the_sockets_does_not_stop_the_server() {
    let mut tree = tree();
    let server = Server::start(0, &tree).unwrap();
    let mut state = 1_u64;
    let mut next = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        u8::try_from(state >> 56).unwrap()
    };
    for client_idx in 0..300_u16 {
        let noise: Vec<u8> = (0..next()).map(|_| next()).collect();
        let Ok(mut stream) = TcpStream::connect(("127.0.0.1", server.port() + client_idx % 2)) else { continue };
        let mut greeting = [0; 64];
        (greeting[0], greeting[9], greeting[10]) = (0xff, 0x7f, 3);
        greeting[12..16].copy_from_slice(b"NULL");
        let ready = b"\x04\x19\x05READY\x0bSocket-Type\0\0\0\x03REQ";
        let parts: &[&[u8]] = match client_idx % 3 {
            0 => &[&noise],
            1 => &[&greeting, &noise],
            _ => &[&greeting, &ready[..], &[next() & 7], &noise],
        };
        // The other side may be gone before all is written.
        let _written = parts.iter().try_for_each(|part| stream.write_all(part));
        if client_idx % 10 == 0 {
            tick(&mut tree, &server, f64::from(client_idx));
        }
    }
    let deadline = Instant::now() + Duration::from_secs(10);
    let mut stream = loop {
        let stream = TcpStream::connect(("127.0.0.1", server.port())).unwrap();
        if stream.peek(&mut [0]).is_ok_and(|n| n == 1) {
            break stream;
        }
        assert!(Instant::now() < deadline, "places are free again soon");
    };
    stream.write_all(b"").unwrap();
    drop(stream);
    assert_eq!(Client::connect(server.port(), "REQ").statuses().len(), 7);
}

#[test]
fn the_end_of_a_server_frees_its_ports_and_closes_its_connections() {
    let tree = tree();
    let server = Server::start(0, &tree).unwrap();
    let port = server.port();
    let mut clients = [Client::connect(port, "REQ"), Client::connect(port + 1, "SUB")];
    let begun = Instant::now();
    drop(server);
    assert!(begun.elapsed() < Duration::from_secs(1), "{:?}", begun.elapsed());
    for client in &mut clients {
        assert!(client.is_closed());
    }
    let again = Server::start(port, &tree).unwrap();
    assert_eq!(again.port(), port);
}

/// Linux has all of 127.0.0.0/8; another address of it stands for another machine.
#[cfg(target_os = "linux")]
#[test]
fn only_an_exposed_server_is_reached_at_other_addresses() {
    let tree = tree();
    let server = Server::start(0, &tree).unwrap();
    assert!(TcpStream::connect(("127.0.0.2", server.port())).is_err());
    assert!(TcpStream::connect(("127.0.0.2", server.port() + 1)).is_err());
    let exposed = Server::start_exposed("0.0.0.0".parse().unwrap(), 0, &tree).unwrap();
    assert!(TcpStream::connect(("127.0.0.2", exposed.port())).is_ok());
}

#[test]
fn what_cannot_be_served_is_refused() {
    let tree = tree();
    let taken = TcpListener::bind(("127.0.0.1", 0)).unwrap();
    let port = taken.local_addr().unwrap().port();
    assert!(matches!(Server::start(port, &tree), Err(GrootError::Port { port: found, .. }) if found == port));
    assert!(matches!(Server::start(port - 1, &tree), Err(GrootError::Port { .. })));
    let large = (0..MAX_NODES).map(|_| NodeSpec::new("always_success"));
    let large = registry().build(&TreeSpec::new(NodeSpec::new("sequence").children(large))).unwrap();
    assert!(matches!(Server::start(0, &large), Err(GrootError::TooManyNodes { n_nodes: 65_536 })));
    assert!(matches!(BtlogWriter::for_tree(Vec::new(), &large, 0), Err(GrootError::TooManyNodes { n_nodes: 65_536 })));
}

#[test]
fn a_log_holds_the_tree_and_every_change_of_status() {
    let mut tree = tree();
    let start_us = 1_700_000_000_000_000_i64;
    let mut log = BtlogWriter::for_tree(Vec::new(), &tree, start_us).unwrap();
    let mut expected = Vec::new();
    for tick_idx in 0..10_u32 {
        tree.tick(f64::from(tick_idx) * 0.5, &mut ());
        for record in tree.drain_journal() {
            log.record(&record).unwrap();
            if let sfg_tree::Change::Status { to, .. } = record.change {
                expected.push((u64::from(tick_idx) * 500_000, u16::try_from(record.node).unwrap() + 1, to as u8));
            }
        }
    }
    let file = log.finish().unwrap();
    assert_eq!(file[..19], *b"BTCPP4-FileLogger2\x01");
    let n_bytes = usize::try_from(i32::from_le_bytes(file[19..23].try_into().unwrap())).unwrap();
    let (xml, rest) = file[23..].split_at(n_bytes);
    assert_eq!(xml, tree_xml(&tree).as_bytes());
    assert_eq!(rest[..8], start_us.to_le_bytes());
    let found: Vec<(u64, u16, u8)> = rest[8..]
        .chunks(9)
        .map(|row| {
            let mut micros = [0; 8];
            micros[..6].copy_from_slice(&row[..6]);
            (u64::from_le_bytes(micros), u16::from_le_bytes([row[6], row[7]]), row[8])
        })
        .collect();
    assert_eq!(found, expected);
    assert!(found.len() > 30);
}

/// A cheap update is what lets a robot run with the server on. The bound is far above what it takes.
#[test]
fn an_update_without_clients_costs_little() {
    let rows = (0..100).map(|_| NodeSpec::new("sequence").children((0..9).map(|_| NodeSpec::new("always_success"))));
    let mut tree = registry().build(&TreeSpec::new(NodeSpec::new("sequence").children(rows))).unwrap();
    tree.set_journal_level(JournalLevel::Transitions);
    let server = Server::start(0, &tree).unwrap();
    let (mut spent, n_ticks) = (Duration::ZERO, 200_u32);
    let mut n_records = 0;
    for tick_idx in 0..n_ticks {
        tree.tick(f64::from(tick_idx), &mut ());
        let records = tree.drain_journal();
        n_records += records.len();
        let begun = Instant::now();
        server.update(&tree, &records);
        spent += begun.elapsed();
    }
    let nanos = spent.as_nanos() / u128::try_from(n_records).unwrap();
    assert!(nanos < 1000, "{nanos} ns a record, {:?} an update of {} nodes", spent / n_ticks, tree.n_nodes());
}

//! Groot2 protocol 2: a request in, the parts of its reply out.
//!
//! | request | reply after the header |
//! |---|---|
//! | `T` tree | XML |
//! | `S` status | 3 bytes a node: number, status; 10 more than the status before for a node that became idle |
//! | `B` blackboard, names | MessagePack map of maps |
//! | `r` recording, `start` | system time, microseconds, as text |
//! | `r` recording, `stop` | - |
//! | `t` transitions | 9 bytes a change since the last request, the newest 1000 |
//! | `D` hooks | `[]`: there are none |
//! | `I`, `U`, `R`, `A`, `X`: set or free hooks | refused: nobody outside decides what a robot does |

use super::server::Shared;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, PoisonError};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

/// How long a request for values waits for the next tick.
const NEXT_TICK: Duration = Duration::from_millis(100);
const PROTOCOL: u8 = 2;

/// The parts of the reply to a request. A refusal is `error` and why.
pub(super) fn reply(shared: &Shared, request: &[Vec<u8>]) -> Vec<Vec<u8>> {
    answer(shared, request).unwrap_or_else(|message| vec![b"error".to_vec(), message.into_bytes()])
}

fn answer(shared: &Shared, request: &[Vec<u8>]) -> Result<Vec<Vec<u8>>, String> {
    let Some(&[_protocol, kind, id0, id1, id2, id3]) = request.first().map(Vec::as_slice) else {
        return Err("wrong request header".to_owned());
    };
    let text = || match request {
        [_, text] => Ok(String::from_utf8_lossy(text)),
        _ => Err("must be 2 parts message".to_owned()),
    };
    let mut snapshot = shared.snapshot.lock().unwrap_or_else(PoisonError::into_inner);
    let header = |uuid: [u8; 16]| [&[PROTOCOL, kind, id0, id1, id2, id3][..], &uuid].concat();
    if let (Some(refusal), b'T' | b'S' | b'B' | b'r' | b't') = (&snapshot.refusal, kind) {
        return Err(refusal.clone());
    }
    let body = match kind {
        b'T' => {
            let (xml, uuid) = (Arc::clone(&snapshot.xml), snapshot.uuid);
            drop(snapshot);
            return Ok(vec![header(uuid), xml.as_bytes().to_vec()]);
        }
        b'S' => snapshot.status.clone(),
        b'B' => {
            let names = text()?;
            if !snapshot.has_newest_values {
                snapshot.wants_values = true;
                let waited = shared.updated.wait_timeout_while(snapshot, NEXT_TICK, |snapshot| snapshot.wants_values);
                (snapshot, _) = waited.unwrap_or_else(PoisonError::into_inner);
                snapshot.wants_values = false;
            }
            let (board, values, uuid) = (Arc::clone(&snapshot.board), snapshot.values.clone(), snapshot.uuid);
            drop(snapshot);
            // The literal forms of values are the application's.
            let dump = catch_unwind(AssertUnwindSafe(|| board.dump(&names, &values)));
            let dump = dump.map_err(|_panic| "a blackboard value could not be written".to_owned())?;
            return Ok(vec![header(uuid), dump]);
        }
        b'r' => match &*text()? {
            "start" => {
                snapshot.recording_from_secs = Some(snapshot.now_secs);
                snapshot.transitions.clear();
                let since_1970 = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
                since_1970.as_micros().to_string().into_bytes()
            }
            "stop" => {
                snapshot.recording_from_secs = None;
                return Ok(vec![header(snapshot.uuid)]);
            }
            _ => return Ok(vec![header(snapshot.uuid)]),
        },
        b't' => std::mem::take(&mut snapshot.transitions).into_iter().flatten().collect(),
        b'D' => b"[]".to_vec(),
        b'I' | b'U' | b'R' | b'A' | b'X' => return Err("read-only".to_owned()),
        _ => return Err("Request not recognized".to_owned()),
    };
    Ok(vec![header(snapshot.uuid), body])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::groot::snapshot::Snapshot;
    use crate::journal::JournalLevel;
    use crate::registry::Registry;
    use crate::spec::{NodeSpec, TreeSpec};
    use crate::tree::Tree;

    fn tree(n_children: usize) -> Tree<()> {
        let children = (0..n_children).map(|_| NodeSpec::new("sleep").with("secs", 1.5));
        let spec = TreeSpec::new(NodeSpec::new("sequence").children(children)).entry("width", 0.5);
        let mut spec = spec;
        spec.root.children.push(NodeSpec::new("script").with("code", "width := width + 1"));
        match Registry::<()>::new().build(&spec) {
            Ok(tree) => tree,
            Err(errors) => panic!("{}", errors[0]),
        }
    }

    fn ask(shared: &Shared, parts: &[&[u8]]) -> Vec<Vec<u8>> {
        reply(shared, &parts.iter().map(|part| part.to_vec()).collect::<Vec<_>>())
    }

    #[track_caller]
    fn check_refusal(shared: &Shared, parts: &[&[u8]], message: &str) {
        let expected = [b"error".to_vec(), message.as_bytes().to_vec()];
        assert_eq!(ask(shared, parts), expected, "{}", String::from_utf8_lossy(&ask(shared, parts)[1]));
    }

    #[test]
    fn the_reply_repeats_the_request_and_names_the_tree() {
        let shared = Shared::new(Snapshot::new(&tree(1)));
        let [header, status] = &ask(&shared, &[b"\x02S\x01\x02\x03\x04"])[..] else { panic!("two parts") };
        assert_eq!((&header[..6], header.len()), (&b"\x02S\x01\x02\x03\x04"[..], 22));
        assert_eq!(*status, [1, 0, 0, 2, 0, 0, 3, 0, 0]);
        assert_eq!(ask(&shared, &[b"\x01T\0\0\0\0"])[0][..2], *b"\x02T", "the protocol is 2 whatever was asked");
    }

    #[test]
    fn what_would_change_the_tree_is_refused() {
        let shared = Shared::new(Snapshot::new(&tree(1)));
        for kind in *b"IURAX" {
            check_refusal(&shared, &[&[2, kind, 0, 0, 0, 0], b"{}"], "read-only");
        }
        assert_eq!(ask(&shared, &[b"\x02D\0\0\0\0"])[1], b"[]");
        check_refusal(&shared, &[b"\x02?\0\0\0\0"], "Request not recognized");
        check_refusal(&shared, &[b"\x02S\0\0\0"], "wrong request header");
        check_refusal(&shared, &[], "wrong request header");
        check_refusal(&shared, &[b"\x02B\0\0\0\0"], "must be 2 parts message");
        check_refusal(&shared, &[b"\x02r\0\0\0\0", b"", b""], "must be 2 parts message");
    }

    #[test]
    fn a_recording_keeps_the_newest_thousand_and_is_emptied_by_reading() {
        let (mut tree, mut context) = (tree(0), ());
        tree.set_journal_level(JournalLevel::Transitions);
        let shared = Shared::new(Snapshot::new(&tree));
        let mut tick = |now_secs: f64| {
            tree.tick(now_secs, &mut context);
            let records = tree.drain_journal();
            shared.snapshot.lock().unwrap_or_else(PoisonError::into_inner).update(&tree, &records);
        };
        let transitions = || ask(&shared, &[b"\x02t\0\0\0\0"]).remove(1);
        tick(1.0);
        assert_eq!(transitions(), [0; 0], "nobody asked for a recording");
        assert!(String::from_utf8_lossy(&ask(&shared, &[b"\x02r\0\0\0\0", b"start"])[1]).parse::<u64>().is_ok());
        tick(1.5);
        let first = transitions();
        assert_eq!(first[..9], [0x20, 0xa1, 7, 0, 0, 0, 1, 0, 1], "half a second after the start the root runs");
        assert_eq!(transitions(), [0; 0]);
        for tick_idx in 0..1000_u32 {
            tick(2.0 + f64::from(tick_idx));
        }
        assert_eq!(transitions().len(), 9 * 1000);
        assert_eq!(ask(&shared, &[b"\x02r\0\0\0\0", b"stop"]).len(), 1);
        tick(2000.0);
        assert_eq!(transitions(), [0; 0]);
    }

    #[test]
    fn an_idle_node_tells_what_it_was() {
        let (mut tree, mut context) = (tree(1), ());
        let shared = Shared::new(Snapshot::new(&tree));
        let mut tick = |now_secs: f64, level: JournalLevel| {
            tree.set_journal_level(level);
            tree.tick(now_secs, &mut context);
            let records = tree.drain_journal();
            shared.snapshot.lock().unwrap_or_else(PoisonError::into_inner).update(&tree, &records);
            ask(&shared, &[b"\x02S\0\0\0\0"])[1].chunks_exact(3).map(|node| node[2]).collect::<Vec<_>>()
        };
        assert_eq!(tick(0.0, JournalLevel::Transitions), [1, 1, 0]);
        assert_eq!(tick(2.0, JournalLevel::Transitions), [12, 12, 12]);
        assert_eq!(tick(3.0, JournalLevel::Off), [1, 1, 12], "statuses are read off the tree without a journal");
        assert_eq!(tick(5.0, JournalLevel::Off), [11, 11, 12]);
    }

    #[test]
    fn a_skipped_node_stays_so_until_its_parent_is_done() {
        let mut registry = Registry::<()>::new();
        registry.step("work", [], |_tick| Ok(()));
        let skipped = NodeSpec::new("work").when(crate::spec::When::SkipIf, "true");
        let spec = TreeSpec::new(NodeSpec::new("sequence").child(skipped).child(NodeSpec::new("sleep").with("secs", 1.0)));
        let Ok(mut tree) = registry.build(&spec) else { panic!("the tree is good") };
        tree.set_journal_level(JournalLevel::Transitions);
        let mut snapshot = Snapshot::new(&tree);
        for (now_secs, expected) in [(0.0, [1, 4, 1]), (0.5, [1, 4, 1]), (1.0, [12, 14, 12])] {
            tree.tick(now_secs, &mut ());
            let records = tree.drain_journal();
            snapshot.update(&tree, &records);
            let shown: Vec<u8> = snapshot.status.chunks_exact(3).map(|node| node[2]).collect();
            assert_eq!(shown, expected);
        }
    }

    #[test]
    fn a_tree_that_is_too_large_is_not_shown() {
        let large = tree(65_534);
        let shared = Shared::new(Snapshot::new(&large));
        for kind in *b"TSt" {
            check_refusal(&shared, &[&[2, kind, 0, 0, 0, 0]], "the tree has 65536 nodes, Groot2 numbers at most 65535");
        }
        let mut snapshot = shared.snapshot.lock().unwrap_or_else(PoisonError::into_inner);
        snapshot.update(&large, &[]);
        let fits = tree(65_533);
        snapshot.update(&fits, &[]);
        assert_eq!((snapshot.refusal.is_none(), snapshot.status.len()), (true, 3 * 65_535));
    }

    #[test]
    fn no_request_makes_it_panic() {
        let shared = Shared::new(Snapshot::new(&tree(3)));
        let mut state = 1_u64;
        let mut next = |below: u64| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (state >> 33) % below
        };
        for _ in 0..100_000 {
            let n_parts = next(4);
            let mut request: Vec<Vec<u8>> = Vec::new();
            for _ in 0..n_parts {
                let n_bytes = if next(2) == 0 { 6 } else { next(12) };
                request.push((0..n_bytes).map(|_| u8::try_from(next(256)).unwrap_or(0)).collect());
            }
            if let Some(kind) = request.first_mut().and_then(|header| header.get_mut(1))
                && next(2) == 0
            {
                *kind = b"TSBrtDIURAX"[usize::try_from(next(11)).unwrap_or(0)];
            }
            assert!(!reply(&shared, &request).is_empty());
        }
    }
}

//! Recordings as they are found.

#![allow(clippy::unwrap_used, reason = "tests fail by panicking")]

use serde_json::json;
use sfg_monitor::{ImageKind, Store};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Writes messages `(topic, schema, encoding, seconds, bytes)`; the bytes of the file.
fn write(path: &Path, messages: &[(&str, &str, &str, f64, Vec<u8>)], is_finished: bool) -> Vec<u8> {
    let file = std::io::BufWriter::new(std::fs::File::create(path).unwrap());
    let mut writer = mcap::WriteOptions::new().compression(None).create(file).unwrap();
    for (topic, schema, encoding, seconds, bytes) in messages {
        let kind = if *encoding == "json" { "jsonschema" } else { "protobuf" };
        let schema = writer.add_schema(schema, kind, b"{}").unwrap();
        let channel_id = writer.add_channel(schema, topic, encoding, &BTreeMap::new()).unwrap();
        let log_time = (seconds * 1e9) as u64;
        let header = mcap::records::MessageHeader { channel_id, sequence: 0, log_time, publish_time: log_time };
        writer.write_to_known_channel(&header, bytes).unwrap();
    }
    writer.flush().unwrap();
    if !is_finished {
        let bytes = std::fs::read(path).unwrap();
        drop(writer);
        std::fs::write(path, &bytes).unwrap();
        return bytes;
    }
    writer.finish().unwrap();
    drop(writer);
    std::fs::read(path).unwrap()
}

fn step(n: u32) -> (&'static str, &'static str, &'static str, f64, Vec<u8>) {
    ("/tree", "sfg.Transition.v1", "json", f64::from(n), json!({"tick": n}).to_string().into_bytes())
}

/// A `foxglove.CompressedImage` by hand: time, data, format, frame.
fn image_message(data: &[u8]) -> Vec<u8> {
    let mut message = vec![0x0a, 2, 0x08, 7, 0x12, u8::try_from(data.len()).unwrap()];
    message.extend_from_slice(data);
    message.extend_from_slice(b"\x1a\x04jpeg\x22\x04left");
    message
}

fn folder() -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    (folder, path)
}

#[test]
fn a_recording_opens_by_file_and_by_folder_with_its_images() {
    let (folder, path) = folder();
    let image = ("/camera/left/image", "foxglove.CompressedImage", "protobuf", 1.5, image_message(&[0xff, 0xd8, 9]));
    let other = ("/tf", "foxglove.FrameTransforms", "protobuf", 1.0, vec![1, 2]);
    write(&path, &[step(3), step(1), image, other], true);
    for found in [path.as_path(), folder.path()] {
        let store = Store::open(found).unwrap();
        // Two steps and the note of the image.
        assert_eq!((store.n_messages(), store.end_secs()), (3, 3.0));
        let image = store.image("left", ImageKind::Colour, 2.0).unwrap();
        assert_eq!((image.media_type, image.bytes.as_ref()), ("image/jpeg", &[0xff, 0xd8, 9][..]));
        assert_eq!(store.image("left", ImageKind::Colour, 1.0), None);
        assert_eq!(store.image("right", ImageKind::Colour, 2.0), None);
    }
}

#[test]
fn a_recording_that_was_cut_off_opens_at_every_length() {
    let (_folder, path) = folder();
    let messages: Vec<_> = (0..50).map(step).collect();
    let bytes = write(&path, &messages, false);
    let store = Store::open(&path).unwrap();
    assert_eq!(store.n_messages(), 50);
    assert!(format!("{store:?}").contains("50"));
    let mut n_open = 0;
    for n_bytes in 1..bytes.len() {
        std::fs::write(&path, &bytes[..n_bytes]).unwrap();
        match Store::open(&path) {
            Ok(store) => {
                assert!(store.n_messages() <= 50);
                n_open += 1;
            }
            Err(error) => assert!(error.to_string().contains("run.mcap"), "{error}"),
        }
    }
    assert!(n_open > 0, "none of the cut files opened");
}

#[test]
fn what_cannot_be_shown_says_why() {
    let (folder, path) = folder();
    let message = |path: &Path| Store::open(path).err().unwrap().to_string();
    assert!(message(&path).contains("no such file"), "{}", message(&path));
    assert!(message(folder.path()).contains("run.mcap"), "{}", message(folder.path()));
    std::fs::write(&path, "").unwrap();
    assert!(message(&path).contains("empty"), "{}", message(&path));
    std::fs::write(&path, "nothing of the kind, but long enough for a head").unwrap();
    assert!(message(&path).contains("no recording"), "{}", message(&path));
    write(&path, &[("/odom", "nav_msgs/Odometry", "cdr", 1.0, vec![1])], true);
    assert!(message(&path).contains("another program"), "{}", message(&path));
    write(&path, &[step(1), ("/candidates", "sfg.Candidates.v2", "json", 1.0, b"{}".to_vec())], true);
    let newer = message(&path);
    assert!(newer.contains("newer program") && newer.contains("sfg.Candidates.v2"), "{newer}");
    write(&path, &[("/tree", "sfg.Transition.v1", "json", 1.0, b"{\"tick\":".to_vec())], true);
    assert!(message(&path).contains("no JSON"), "{}", message(&path));
}

#[test]
fn the_robot_is_thinned_and_live_images_are_bounded() {
    let store = Store::live("pour");
    for n in 0..1000 {
        store.push("/robot", f64::from(n) * 0.01, b"{}");
    }
    assert!((240..=340).contains(&store.n_messages()), "{} of 1000 samples in 10 s", store.n_messages());
    let large = vec![0xff; 1 << 20];
    for n in 0..300 {
        store.push_image("left", ImageKind::Colour, f64::from(n), &large);
    }
    assert!(store.image("left", ImageKind::Colour, 10.0).is_none(), "the oldest are dropped");
    assert!(store.image("left", ImageKind::Colour, 299.0).is_some());
}

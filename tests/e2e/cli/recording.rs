//! `run.mcap` read back with another reader than the one that wrote it.

use serde_json::Value;
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::process::Command;

/// The messages of each topic, in the order of the file; the file must be whole. Those in protobuf are `null`.
pub(crate) fn messages(path: &Path) -> BTreeMap<String, Vec<Value>> {
    let bytes = fs::read(path).unwrap();
    by_topic(mcap::MessageStream::new(&bytes).unwrap().map(Result::unwrap))
}

fn by_topic<'a>(messages: impl Iterator<Item = mcap::Message<'a>>) -> BTreeMap<String, Vec<Value>> {
    let mut topics: BTreeMap<String, Vec<Value>> = BTreeMap::new();
    for message in messages {
        let is_json = message.channel.message_encoding == "json";
        let value = if is_json { serde_json::from_slice(&message.data).unwrap() } else { Value::Null };
        topics.entry(message.channel.topic.clone()).or_default().push(value);
    }
    topics
}

/// The PyPI reader finds every topic; passed over where it is not installed.
pub(crate) fn check_with_python(path: &Path) {
    let has_reader =
        Command::new("python3").args(["-c", "import mcap, mcap_protobuf"]).output().is_ok_and(|output| output.status.success());
    if !has_reader {
        println!("passed over: python3 has no packages mcap and mcap-protobuf-support");
        return;
    }
    let output =
        Command::new("python3").arg(crate::repository("tests/read_recording.py")).arg(path).arg("--pour").output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

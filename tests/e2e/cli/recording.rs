//! `run.mcap` read back with another reader than the one that wrote it.

use serde_json::Value;
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::process::Command;

/// The messages of each topic, in the order of the file; the file must be whole.
pub(crate) fn messages(path: &Path) -> BTreeMap<String, Vec<Value>> {
    let bytes = fs::read(path).unwrap();
    by_topic(mcap::MessageStream::new(&bytes).unwrap().map(Result::unwrap))
}

/// What can be read of a file whose writer was killed.
#[cfg(unix)]
pub(crate) fn survivors(path: &Path) -> BTreeMap<String, Vec<Value>> {
    let bytes = fs::read(path).unwrap();
    let options = mcap::read::Options::IgnoreEndMagic.into();
    by_topic(mcap::MessageStream::new_with_options(&bytes, options).unwrap().map_while(Result::ok))
}

fn by_topic<'a>(messages: impl Iterator<Item = mcap::Message<'a>>) -> BTreeMap<String, Vec<Value>> {
    let mut topics: BTreeMap<String, Vec<Value>> = BTreeMap::new();
    for message in messages {
        topics.entry(message.channel.topic.clone()).or_default().push(serde_json::from_slice(&message.data).unwrap());
    }
    topics
}

/// The PyPI reader finds every topic; passed over where it is not installed.
pub(crate) fn check_with_python(path: &Path) {
    let has_reader = Command::new("python3").args(["-c", "import mcap"]).output().is_ok_and(|output| output.status.success());
    if !has_reader {
        println!("passed over: python3 has no package mcap");
        return;
    }
    let output = Command::new("python3").arg(crate::repository("tests/read_mcap.py")).arg(path).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

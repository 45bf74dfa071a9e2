//! The layout for Foxglove names channels that a run has.
#![expect(clippy::unwrap_used, reason = "tests fail by panicking")]

use serde_json::Value;
use std::path::Path;

/// Topic and first field of every path in the layout.
fn paths(value: &Value, found: &mut Vec<String>) {
    match value {
        Value::String(text) if text.starts_with('/') => found.push(text.clone()),
        Value::Array(items) => items.iter().for_each(|item| paths(item, found)),
        Value::Object(items) => {
            for (key, item) in items {
                if key.starts_with('/') {
                    found.push(key.clone());
                }
                paths(item, found);
            }
        }
        _ => {}
    }
}

#[test]
fn the_layout_shows_channels_of_a_run() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let layout: Value = serde_json::from_slice(&std::fs::read(root.join("scenarios/foxglove-layout.json")).unwrap()).unwrap();
    let test = std::fs::read_to_string(root.join("tests/e2e/cli/log.rs")).unwrap();
    let channels = test.split_once("POUR_CHANNELS: &str = \"").unwrap().1.split_once("\";").unwrap().0;
    let channels: Vec<&str> = channels.split_whitespace().filter(|word| *word != "\\").collect();
    assert!(channels.len() > 20);
    let mut found = Vec::new();
    paths(&layout, &mut found);
    assert!(found.len() > 10, "{found:?}");
    for path in found {
        let topic = path.split_once('.').map_or(path.as_str(), |(topic, _)| topic);
        assert!(channels.contains(&topic), "{path} is no channel of a run");
    }
}

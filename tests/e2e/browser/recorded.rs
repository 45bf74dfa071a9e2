//! What a recording says, read with the `mcap` crate and none of our own code.

use serde_json::Value;
use std::collections::BTreeMap;
use std::path::Path;

/// The JSON messages of a recording by topic, each with its time in seconds, in order.
pub(crate) struct Recorded {
    topics: BTreeMap<String, Vec<(f64, Value)>>,
}

impl Recorded {
    pub(crate) fn read(path: &Path) -> Self {
        let bytes = std::fs::read(path).unwrap();
        let mut topics: BTreeMap<String, Vec<(f64, Value)>> = BTreeMap::new();
        for message in mcap::MessageStream::new(&bytes).unwrap() {
            let message = message.unwrap();
            if message.channel.message_encoding == "json" {
                let value = serde_json::from_slice(&message.data).unwrap();
                topics.entry(message.channel.topic.clone()).or_default().push((message.log_time as f64 * 1e-9, value));
            }
        }
        Self { topics }
    }

    /// All messages of a topic.
    pub(crate) fn all(&self, topic: &str) -> &[(f64, Value)] {
        self.topics.get(topic).map_or(&[], Vec::as_slice)
    }

    /// The newest message at or before `t`.
    pub(crate) fn latest(&self, topic: &str, t: f64) -> Option<&Value> {
        self.all(topic).iter().rfind(|(at, _)| *at <= t + 1e-9).map(|(_, message)| message)
    }

    /// Times at which a node changed its status, by the journal.
    pub(crate) fn change_times(&self) -> Vec<f64> {
        let is_change =
            |message: &Value| message["changes"].as_array().is_some_and(|all| all.iter().any(|one| one[0] == "status"));
        self.all("/journal").iter().filter(|(_, message)| is_change(message)).map(|(t, _)| *t).collect()
    }

    /// The status of each node at `t`, by the journal; a node without a change is idle.
    pub(crate) fn statuses(&self, t: f64) -> BTreeMap<String, String> {
        let mut statuses = BTreeMap::new();
        for (_, message) in self.all("/journal").iter().take_while(|(at, _)| *at <= t + 1e-9) {
            for change in message["changes"].as_array().into_iter().flatten().filter(|change| change[0] == "status") {
                statuses.insert(change[1].as_str().unwrap().to_owned(), change[3].as_str().unwrap().to_lowercase());
            }
        }
        statuses
    }

    /// The end of the recording, seconds.
    pub(crate) fn duration(&self) -> f64 {
        self.topics.values().filter_map(|messages| messages.last()).map(|(t, _)| *t).fold(0.0, f64::max)
    }
}

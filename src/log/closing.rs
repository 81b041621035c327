//! The end of a finished log, found by its index without reading what is before it.

use super::indexed::summary;
use super::part::MetadataMap;
use super::seal;
use hydroline_rigs::bounded;
use std::collections::BTreeMap;
use std::path::Path;

/// A finished log's end.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Closing {
    /// Its `summary` metadata; empty where there is none, or where it is not as it was written.
    pub summary: MetadataMap,
    /// Messages by topic.
    pub messages: BTreeMap<String, u64>,
}

impl Closing {
    /// Of a log; `None` where it has no end, no index, or the index is damaged: read it from the start then.
    pub fn of(path: &Path) -> Option<Closing> {
        let mut contents = summary(&bounded::open(path).ok()?).ok()??;
        let messages = contents.counts().into_iter();
        let messages = messages.map(|(topic, n)| (topic.to_owned(), n)).collect();
        let summary = contents.metadata.remove("summary");
        let summary = summary.filter(|map| seal::holds("summary", map));
        Some(Closing {
            summary: summary.unwrap_or_default(),
            messages,
        })
    }

    /// Messages of a topic.
    pub fn messages_of(&self, topic: &str) -> u64 {
        self.messages.get(topic).copied().unwrap_or(0)
    }
}

//! What stands at a finished log's end, found by its index without reading what is before it.

use super::part::MetadataMap;
use super::records::{self, PREFIX_BYTES};
use super::seal;
use mcap::sans_io::summary_reader::{SummaryReadEvent, SummaryReader, SummaryReaderOptions};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;

/// A metadata record longer than this is none of ours: a recording's summary takes some kilobytes.
const METADATA_MOST_BYTES: u64 = 1 << 20;

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
        let mut file = File::open(path).ok()?;
        let index = index(&mut file)?;
        let counts = index.stats.as_ref()?;
        let topic_of = |id: &u16| Some(index.channels.get(id)?.topic.clone());
        let mut messages: BTreeMap<String, u64> = BTreeMap::new();
        for (id, n) in &counts.channel_message_counts {
            let count = messages.entry(topic_of(id)?).or_default();
            *count = count.saturating_add(*n);
        }
        let of_summary = index.metadata_indexes.iter().rfind(|m| m.name == "summary");
        let summary = of_summary
            .and_then(|at| metadata(&mut file, at.offset, at.length))
            .unwrap_or_default();
        Some(Closing { summary, messages })
    }

    /// Messages of a topic.
    pub fn messages_of(&self, topic: &str) -> u64 {
        self.messages.get(topic).copied().unwrap_or(0)
    }
}

fn index(file: &mut File) -> Option<mcap::Summary> {
    let bytes = file.metadata().ok()?.len();
    let options = SummaryReaderOptions::default()
        .with_file_size(bytes)
        .with_record_length_limit(usize::try_from(bytes).ok()?);
    let mut reader = SummaryReader::new_with_options(options);
    while let Some(event) = reader.next_event() {
        match event.ok()? {
            SummaryReadEvent::ReadRequest(wanted) => {
                let read = file.read(reader.insert(wanted)).ok()?;
                reader.notify_read(read);
            }
            SummaryReadEvent::SeekRequest(to) => reader.notify_seeked(file.seek(to).ok()?),
        }
    }
    reader.finish()
}

/// A metadata record that agrees with its own digest.
fn metadata(file: &mut File, offset: u64, length: u64) -> Option<MetadataMap> {
    let content = length.checked_sub(PREFIX_BYTES)?;
    if content > METADATA_MOST_BYTES {
        return None;
    }
    let start = offset.checked_add(PREFIX_BYTES)?;
    file.seek(SeekFrom::Start(start)).ok()?;
    let mut body = vec![0; usize::try_from(content).ok()?];
    file.read_exact(&mut body).ok()?;
    let (name, map) = records::metadata(&body.into()).ok()?;
    (name == "summary" && seal::holds(&name, &map)).then_some(map)
}

//! The closing summary that a broken-off recording never wrote, made from what is left of it.

use std::collections::BTreeMap;

use prost::Message;

use crate::messages::pb;
use crate::part::MetadataMap;
use crate::records::{ChannelRecord, MessageRecord};
use crate::topic::Topic;

/// Counts frames and what they and the events say about those that are missing.
#[derive(Debug, Default)]
pub(super) struct Ledger {
    frames: u64,
    first_index: Option<u64>,
    last_index: u64,
    faulty: u64,
    sequence_gaps: u64,
    time_gaps: u64,
    /// Marks that events have taken back.
    retracted: u64,
    /// Frames without a place in time (started before the stream, or handed out twice).
    leftover: u64,
    repeated: u64,
}

impl Ledger {
    pub fn message(&mut self, channel: &ChannelRecord, message: &MessageRecord) {
        if channel.topic == Topic::FrameInfo.name() {
            if let Ok(info) = pb::FrameInfo::decode(&message.data[..]) {
                self.frame(&info);
            }
        } else if channel.topic == Topic::Event.name()
            && let Ok(event) = pb::Event::decode(&message.data[..])
        {
            match event.kind.as_str() {
                "camera.gap_retracted" => {
                    self.retracted += event.values.get("frames").map_or(0, |v| *v as u64);
                }
                "camera.leftover" => self.leftover += 1,
                "camera.repeated" => self.repeated += 1,
                _ => {}
            }
        }
    }

    fn frame(&mut self, info: &pb::FrameInfo) {
        self.frames += 1;
        self.first_index.get_or_insert(info.frame_index);
        self.last_index = self.last_index.max(info.frame_index);
        self.faulty += u64::from(!info.fault.is_empty());
        self.sequence_gaps += u64::from(info.sequence_gap_before);
        self.time_gaps += u64::from(info.time_gap_before);
    }

    /// As far as the last frame that was kept: `received + lost = expected`, `logged + dropped = received` (and what has
    /// no place in time). What came after it was in memory when the recording broke off.
    pub fn summary(&self, messages: &BTreeMap<String, u64>) -> MetadataMap {
        let span = self
            .first_index
            .map_or(0, |first| self.last_index.saturating_sub(first) + 1);
        let received = span.saturating_sub(self.leftover + self.repeated);
        let lost = [
            ("sequence_gap", self.sequence_gaps),
            ("time_gap", self.time_gaps.saturating_sub(self.retracted)),
        ];
        let expected = received + lost.iter().map(|(_, n)| n).sum::<u64>();
        let mut map = MetadataMap::from([
            ("recovered".to_owned(), "true".to_owned()),
            (
                "stop.reason".to_owned(),
                "the recording broke off".to_owned(),
            ),
            ("stop.clean".to_owned(), "false".to_owned()),
        ]);
        let mut put = |key: &str, n: u64| map.insert(key.to_owned(), n.to_string());
        put("frames.expected", expected);
        put("frames.received", received);
        for (cause, n) in lost {
            if n > 0 {
                put(&format!("frames.lost.{cause}"), n);
            }
        }
        // In memory, refused by the queue or the disk, or damaged in the file: not distinguished any more.
        put("frames.dropped.unknown", span.saturating_sub(self.frames));
        put("frames.logged", self.frames);
        put("frames.faulty", self.faulty);
        put("frames.leftover", self.leftover);
        put("frames.repeated", self.repeated);
        for (topic, n) in messages {
            put(&format!("messages.{topic}"), *n);
        }
        put("messages.total", messages.values().sum());
        map
    }
}

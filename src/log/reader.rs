//! Reading a log: decoded records with their times, from our files and from anyone's.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use bytes::Bytes;
use prost::Message;

use super::LogError;
use super::image_topics::ImageKind;
use super::messages::{self, ImageMessage, pb};
use super::part::MetadataMap;
use super::records::{ChannelRecord, MessageRecord};
use super::scan::{self, FileScan, Scan, Step};
use super::seal::SealFinding;
use super::topic::Topic;
use hydroline_core::frame::{Frame, GreyRule};
use hydroline_rigs::Rig;

/// A decoded message.
#[derive(Debug, Clone, PartialEq)]
#[allow(clippy::large_enum_variant)]
pub enum Record {
    /// `/camera/image`, joined with its `/camera/frame` where that stands before it.
    Frame(Frame),
    /// `/camera/frame`
    FrameInfo(pb::FrameInfo),
    /// `/thruster/command`
    Command(pb::ThrusterCommand),
    /// `/thruster/echo`
    Echo(pb::ThrusterEcho),
    /// `/vehicle/motion`
    Motion(pb::VehicleMotion),
    /// `/autopilot/motion`
    AutopilotMotion(pb::VehicleMotion),
    /// `/autopilot/state`
    AutopilotState(pb::AutopilotState),
    /// `/sim/truth`
    Truth(pb::VehicleMotion),
    /// `/clock`
    Clock(pb::ClockPair),
    /// `/daemon/event`
    Event(pb::Event),
    /// `/laser/profile`
    Profile(pb::StripeProfile),
    /// `/laser/calibration`
    PlaneCalibration(pb::PlaneCalibration),
    /// `/camera/calibration`
    CameraCalibration(messages::CameraCalibration),
    /// `/camera/annotations`
    Annotations(messages::ImageAnnotations),
    /// `/vehicle/pose`
    Pose(messages::PoseInFrame),
    /// `/daemon/log`
    Log(messages::Log),
    /// A topic, schema or encoding that is not one of ours.
    Other {
        /// Name of the topic.
        topic: String,
        /// Schema name, "" without one.
        schema: String,
        /// Message encoding.
        encoding: String,
        /// The bytes.
        data: Bytes,
    },
}

/// A message with its times.
#[derive(Debug, Clone, PartialEq)]
pub struct LogMessage {
    /// Host realtime at logging, UNIX \[ns\].
    pub log_ns: u64,
    /// When it was true, UNIX \[ns\].
    pub publish_ns: u64,
    /// MCAP sequence.
    pub sequence: u32,
    /// Offset in the file of the record (of its chunk, when it is in one).
    pub offset: u64,
    /// Decoded message.
    pub record: Record,
}

impl LogMessage {
    /// A message of a channel, decoded by `record`.
    pub(super) fn of(
        path: &Path,
        offset: u64,
        channel: &ChannelRecord,
        schema: &str,
        message: MessageRecord,
        record: impl FnOnce(MessageRecord) -> Result<Record, String>,
    ) -> Result<Self, LogError> {
        let (log_ns, publish_ns, sequence) = (message.log_ns, message.publish_ns, message.sequence);
        let record = record(message).map_err(|reason| LogError::Message {
            path: path.to_owned(),
            offset,
            topic: channel.topic.clone(),
            schema: schema.to_owned(),
            reason,
        })?;
        Ok(LogMessage {
            log_ns,
            publish_ns,
            sequence,
            offset,
            record,
        })
    }
}

/// Reads a log from start to end. Everything is checked before it is handed out; the first item
/// that is an error says where and why. After an error the iterator goes on with what is still
/// sound (the next chunk), so stop at the first error unless salvaging.
pub struct LogReader<R = BufReader<File>> {
    path: PathBuf,
    scan: Scan<R>,
    peeked: Option<Step>,
    info: Option<pb::FrameInfo>,
    images: Option<Images>,
}

/// Images of another topic than ours.
struct Images {
    topic: String,
    /// Frames so far: writers of such logs number their messages as they like, or not at all.
    frames: u32,
}

impl LogReader {
    /// Opens a file and reads its head, up to the first message.
    ///
    /// # Errors
    /// [`LogError::Read`], [`LogError::NotMcap`]. Damage shows when iterating.
    pub fn open(path: &Path) -> Result<Self, LogError> {
        let scan: FileScan = scan::open(path)?;
        Ok(Self::over(path, scan))
    }
}

impl<R: BufRead> LogReader<R> {
    /// Over any source; `name` stands in errors.
    ///
    /// # Errors
    /// As [`LogReader::open`].
    pub fn from_source(name: &Path, source: R) -> Result<Self, LogError> {
        Ok(Self::over(name, Scan::of_file(name, source)?))
    }

    fn over(path: &Path, mut scan: Scan<R>) -> Self {
        let peeked = loop {
            match scan.next() {
                Some(Step::Metadata { .. }) => {}
                step => break step,
            }
        };
        Self {
            path: path.to_owned(),
            scan,
            peeked,
            info: None,
            images: None,
        }
    }

    /// Takes the frames from another topic than `/camera/image`, whose messages then are [`Record::Other`]; frames are
    /// numbered from 0 in the file's order. `None` = ours.
    pub fn with_images_of(mut self, topic: Option<&str>) -> Self {
        self.images = topic.map(|topic| Images {
            topic: topic.to_owned(),
            frames: 0,
        });
        self
    }

    /// Metadata read so far, by name: the head's from the start, all of it after the last message.
    pub fn metadata(&self) -> &BTreeMap<String, MetadataMap> {
        &self.scan.learnt.metadata
    }

    /// The rig as TOML from the head; `None` in a log made elsewhere.
    pub fn rig_toml(&self) -> Option<&str> {
        self.toml("rig")
    }

    /// The calibration as TOML from the head, where there is one.
    pub fn calibration_toml(&self) -> Option<&str> {
        self.toml("calibration")
    }

    /// How grey levels come out of the log's frames: as its rig says; without one, or one that reads, luma of full
    /// scale.
    pub fn grey_rule(&self) -> GreyRule {
        grey_rule(self.metadata())
    }

    fn toml(&self, name: &str) -> Option<&str> {
        self.metadata().get(name)?.get("toml").map(String::as_str)
    }

    /// Metadata of which the digests do not say that it is as it was written: the head's from the start, all of it
    /// after the last message.
    pub fn seal_findings(&self) -> Vec<SealFinding> {
        self.scan.learnt.seal_findings()
    }

    /// Library that wrote the file.
    pub fn library(&self) -> &str {
        &self.scan.learnt.library
    }

    /// Only messages logged in `from_ns..=to_ns` (UNIX); errors pass through.
    pub fn between(
        self,
        from_ns: u64,
        to_ns: u64,
    ) -> impl Iterator<Item = Result<LogMessage, LogError>> {
        self.filter(move |item| match item {
            Ok(m) => (from_ns..=to_ns).contains(&m.log_ns),
            Err(_) => true,
        })
    }

    fn decode(
        &mut self,
        offset: u64,
        channel: &Arc<ChannelRecord>,
        message: MessageRecord,
    ) -> Result<LogMessage, LogError> {
        let schema = self.scan.learnt.declared.schema_name(channel);
        let (images, info) = (&mut self.images, &mut self.info);
        LogMessage::of(
            &self.path,
            offset,
            channel,
            schema,
            message,
            |m| match images {
                Some(images) => images.decode(channel, schema, m, info),
                None => decode(channel, schema, m, info),
            },
        )
    }
}

impl<R: BufRead> Iterator for LogReader<R> {
    type Item = Result<LogMessage, LogError>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            let step = self.peeked.take().or_else(|| self.scan.next())?;
            match step {
                Step::Message {
                    offset,
                    channel,
                    message,
                } => {
                    return Some(self.decode(offset, &channel, message));
                }
                Step::Damage { offset, damage } => {
                    return Some(Err(LogError::damaged(&self.path, (offset, damage))));
                }
                // Unchecked bytes: only `recover` looks at them.
                Step::Truncated { .. } | Step::Metadata { .. } => {}
            }
        }
    }
}

impl Images {
    fn decode(
        &mut self,
        channel: &ChannelRecord,
        schema: &str,
        message: MessageRecord,
        info: &mut Option<pb::FrameInfo>,
    ) -> Result<Record, String> {
        let kind = ImageKind::of(schema, &channel.message_encoding);
        match kind.filter(|_| channel.topic == self.topic) {
            Some(kind) => {
                let image = kind.decode(message.data)?;
                let sequence = self.frames;
                self.frames = self.frames.wrapping_add(1);
                messages::frame_from(image, None, sequence, message.publish_ns)
                    .map(Record::Frame)
                    .map_err(|e| e.to_string())
            }
            None if channel.topic == Topic::RawImage.name() => Ok(other(channel, schema, message)),
            None => decode(channel, schema, message, info),
        }
    }
}

/// A message that is handed on as it is.
fn other(channel: &ChannelRecord, schema: &str, message: MessageRecord) -> Record {
    Record::Other {
        topic: channel.topic.clone(),
        schema: schema.to_owned(),
        encoding: channel.message_encoding.clone(),
        data: message.data,
    }
}

/// How grey levels come out of the frames of a log with this metadata: as its rig says; without one, or one that reads,
/// luma of full scale.
pub(super) fn grey_rule(metadata: &BTreeMap<String, MetadataMap>) -> GreyRule {
    let rig = metadata.get("rig").and_then(|m| m.get("toml"));
    rig.and_then(|text| Rig::from_toml(text, "the log's rig", None).ok())
        .map_or_else(GreyRule::default, |rig| rig.grey_rule())
}

/// Decodes a message; `info` remembers the last FrameInfo for the image that follows it.
pub(super) fn decode(
    channel: &ChannelRecord,
    schema: &str,
    message: MessageRecord,
    info: &mut Option<pb::FrameInfo>,
) -> Result<Record, String> {
    let topic =
        Topic::find(&channel.topic, schema).filter(|_| channel.message_encoding == "protobuf");
    let Some(topic) = topic else {
        return Ok(other(channel, schema, message));
    };
    fn from<M: Message + Default>(data: Bytes) -> Result<M, String> {
        M::decode(data).map_err(|e| e.to_string())
    }
    let (sequence, publish_ns, data) = (message.sequence, message.publish_ns, message.data);
    let mut frame = |image: ImageMessage| {
        use messages::Stamped;
        let stamp_ns = match &image {
            ImageMessage::Raw(raw) => raw.stamp_ns(),
            ImageMessage::Compressed(jpeg) => jpeg.stamp_ns(),
        };
        let own = info
            .take()
            .filter(|i| i.sequence == sequence && i.stamp_ns() == stamp_ns);
        messages::frame_from(image, own.as_ref(), sequence, publish_ns).map_err(|e| e.to_string())
    };
    Ok(match topic {
        Topic::RawImage => Record::Frame(frame(ImageMessage::Raw(from(data)?))?),
        Topic::CompressedImage => Record::Frame(frame(ImageMessage::Compressed(from(data)?))?),
        Topic::FrameInfo => {
            let decoded: pb::FrameInfo = from(data)?;
            *info = Some(decoded.clone());
            Record::FrameInfo(decoded)
        }
        Topic::CameraCalibration => Record::CameraCalibration(from(data)?),
        Topic::PlaneCalibration => Record::PlaneCalibration(from(data)?),
        Topic::Annotations => Record::Annotations(from(data)?),
        Topic::Profile => Record::Profile(from(data)?),
        Topic::Command => Record::Command(from(data)?),
        Topic::Echo => Record::Echo(from(data)?),
        Topic::Motion => Record::Motion(from(data)?),
        Topic::AutopilotMotion => Record::AutopilotMotion(from(data)?),
        Topic::AutopilotState => Record::AutopilotState(from(data)?),
        Topic::Truth => Record::Truth(from(data)?),
        Topic::Pose => Record::Pose(from(data)?),
        Topic::Clock => Record::Clock(from(data)?),
        Topic::Event => Record::Event(from(data)?),
        Topic::Log => Record::Log(from(data)?),
    })
}

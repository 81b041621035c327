//! Entries of a log: one per thing that happened, ready to be queued or written.

use bytes::Bytes;
use prost::Message;

use super::LogError;
use super::messages::{self, ImageMessage, Stamped, pb};
use super::topic::Topic;
use hydroline_core::event::Event;
use hydroline_core::frame::Frame;
use hydroline_rigs::FRAME_BYTES_MAX;

/// One thing to log.
#[derive(Debug, Clone, PartialEq)]
pub enum Entry {
    /// A frame: becomes a `/camera/frame` and a `/camera/image` message. May be dropped by the queue.
    Frame {
        /// The frame; its pixels are shared, not copied.
        frame: Frame,
        /// Counts frames received by the daemon, from 0.
        index: u64,
    },
    /// Any other message, already encoded. The queue drops only what can be computed again.
    Message {
        /// Topic that it goes to.
        topic: Topic,
        /// When it was true, UNIX \[ns\]; `None` = its log time.
        publish_ns: Option<u64>,
        /// MCAP sequence; `None` = the writer counts per topic.
        sequence: Option<u32>,
        /// Protobuf bytes.
        data: Bytes,
    },
}

/// Messages that lie in chunks of their own, so that a reader of the others unpacks none of them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Company {
    /// Images and what is said of them.
    Images,
    /// Stripes, and the pictures of them for viewers.
    Stripes,
    /// Whatever is small: motion, commands, events.
    Others,
}

impl Company {
    /// That of a topic; `None` = it stays with what is before it.
    pub(super) fn of(topic: &str) -> Option<Self> {
        let is = |of: Topic| of.name() == topic;
        if is(Topic::FrameInfo) {
            None
        } else if is(Topic::RawImage) {
            Some(Company::Images)
        } else if is(Topic::Profile) || is(Topic::Annotations) {
            Some(Company::Stripes)
        } else {
            Some(Company::Others)
        }
    }
}

/// One MCAP message of an entry.
pub(super) struct Part {
    pub topic: Topic,
    pub publish_ns: Option<u64>,
    pub sequence: Option<u32>,
    pub data: Bytes,
}

/// Book-keeping that a queued entry costs beside its bytes: record header, indexes, FrameInfo.
const OVERHEAD_BYTES: u64 = 256;

impl Entry {
    /// A frame; `index` counts frames received by the daemon from 0.
    pub fn frame(frame: &Frame, index: u64) -> Self {
        Entry::Frame {
            frame: frame.clone(),
            index,
        }
    }

    /// `/thruster/command`
    pub fn command(message: &pb::ThrusterCommand) -> Self {
        Self::encode(Topic::Command, message, Some(message.sequence))
    }

    /// `/thruster/echo`
    pub fn echo(message: &pb::ThrusterEcho) -> Self {
        Self::encode(Topic::Echo, message, Some(message.sequence))
    }

    /// `/clock`
    pub fn clock(message: &pb::ClockPair) -> Self {
        Self::encode(Topic::Clock, message, None)
    }

    /// `/daemon/event`
    pub fn event(event: &Event) -> Self {
        Self::encode(Topic::Event, &messages::event_message(event), None)
    }

    /// `/daemon/event`, as another log holds it.
    pub fn event_message(message: &pb::Event) -> Self {
        Self::encode(Topic::Event, message, None)
    }

    /// `/camera/frame` without its image, as another log holds it.
    pub fn frame_info(message: &pb::FrameInfo) -> Self {
        Self::encode(Topic::FrameInfo, message, Some(message.sequence))
    }

    /// `/laser/profile`
    pub fn profile(message: &pb::StripeProfile) -> Self {
        Self::encode(Topic::Profile, message, Some(message.sequence))
    }

    /// `/camera/annotations`
    pub fn annotations(message: &messages::ImageAnnotations) -> Self {
        Self::encode(Topic::Annotations, message, None)
    }

    /// `/camera/calibration`
    pub fn camera_calibration(message: &messages::CameraCalibration) -> Self {
        Self::encode(Topic::CameraCalibration, message, None)
    }

    /// `/laser/calibration`
    pub fn plane_calibration(message: &pb::PlaneCalibration) -> Self {
        Self::encode(Topic::PlaneCalibration, message, None)
    }

    /// `/vehicle/motion`
    pub fn motion(message: &pb::VehicleMotion) -> Self {
        Self::encode(Topic::Motion, message, None)
    }

    /// `/autopilot/motion`
    pub fn autopilot_motion(message: &pb::VehicleMotion) -> Self {
        Self::encode(Topic::AutopilotMotion, message, None)
    }

    /// `/autopilot/state`
    pub fn autopilot_state(message: &pb::AutopilotState) -> Self {
        Self::encode(Topic::AutopilotState, message, None)
    }

    /// `/sim/truth`
    pub fn truth(message: &pb::VehicleMotion) -> Self {
        Self::encode(Topic::Truth, message, None)
    }

    /// `/vehicle/pose`
    pub fn pose(message: &messages::PoseInFrame) -> Self {
        Self::encode(Topic::Pose, message, None)
    }

    /// `/daemon/log`
    pub fn log_line(message: &messages::Log) -> Self {
        Self::encode(Topic::Log, message, None)
    }

    fn encode<M: Message + Stamped>(topic: Topic, message: &M, sequence: Option<u32>) -> Self {
        Entry::Message {
            topic,
            publish_ns: message.stamp_ns(),
            sequence,
            data: message.encode_to_vec().into(),
        }
    }

    /// A frame: the queue may drop it, and reports when it does.
    pub fn is_frame(&self) -> bool {
        matches!(self, Entry::Frame { .. })
    }

    /// With what it shares a chunk.
    pub fn company(&self) -> Company {
        match self {
            Entry::Frame { .. } => Company::Images,
            Entry::Message { topic, .. } => Company::of(topic.name()).unwrap_or(Company::Others),
        }
    }

    /// The topic of a message that `replay` computes again from the images: the queue may drop it.
    pub fn derived_topic(&self) -> Option<Topic> {
        match self {
            Entry::Message { topic, .. } if topic.is_derived() => Some(*topic),
            _ => None,
        }
    }

    /// Whether it must reach the disk within the command flush time.
    pub fn is_urgent(&self) -> bool {
        matches!(self, Entry::Message { topic, .. } if topic.is_urgent())
    }

    /// Upper bound of the bytes it takes in a chunk, and what it counts for in the queue.
    pub fn size_bytes(&self) -> u64 {
        match self {
            Entry::Frame { frame, .. } => frame.data.len() as u64 + 2 * OVERHEAD_BYTES,
            Entry::Message { data, .. } => data.len() as u64 + OVERHEAD_BYTES,
        }
    }

    /// Refuses what no reader would read: more bytes than the largest frame has.
    ///
    /// # Errors
    /// [`LogError::TooLarge`].
    pub fn check_size(&self) -> Result<(), LogError> {
        let (topic, data) = match self {
            Entry::Frame { frame, .. } => match frame.format.is_compressed() {
                true => (Topic::CompressedImage, &frame.data),
                false => (Topic::RawImage, &frame.data),
            },
            Entry::Message { topic, data, .. } => (*topic, data),
        };
        let bytes = data.len() as u64;
        if bytes > FRAME_BYTES_MAX {
            return Err(LogError::TooLarge {
                topic: topic.name(),
                bytes,
                most: FRAME_BYTES_MAX,
            });
        }
        Ok(())
    }

    /// The MCAP messages it becomes. A frame's info comes before its image, so that a reader has
    /// it when the image arrives, and both share the log time.
    pub(super) fn parts(&self) -> impl Iterator<Item = Part> {
        let parts = self.encode_parts();
        parts.into_iter().flatten()
    }

    fn encode_parts(&self) -> [Option<Part>; 2] {
        match self {
            Entry::Frame { frame, index } => {
                let sequence = Some(frame.meta.sequence);
                let publish_ns = Some(frame.meta.mid_exposure_ns);
                let info = messages::frame_info(frame, *index).encode_to_vec().into();
                let (topic, image) = match messages::image_message(frame) {
                    ImageMessage::Raw(raw) => (Topic::RawImage, raw.encode_to_vec()),
                    ImageMessage::Compressed(jpeg) => {
                        (Topic::CompressedImage, jpeg.encode_to_vec())
                    }
                };
                let info = Part {
                    topic: Topic::FrameInfo,
                    publish_ns,
                    sequence,
                    data: info,
                };
                let image = Part {
                    topic,
                    publish_ns,
                    sequence,
                    data: image.into(),
                };
                [Some(info), Some(image)]
            }
            Entry::Message {
                topic,
                publish_ns,
                sequence,
                data,
            } => {
                let part = Part {
                    topic: *topic,
                    publish_ns: *publish_ns,
                    sequence: *sequence,
                    data: data.clone(),
                };
                [Some(part), None]
            }
        }
    }
}

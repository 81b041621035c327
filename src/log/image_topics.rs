//! Images on other topics than ours, in the messages that ROS 2 and Foxglove write: which there are, and which is meant.

use std::collections::BTreeMap;
use std::fmt;
use std::path::{Path, PathBuf};

use bytes::Bytes;
use hydroline_core::frame::{JpegDamage, PixelFormat, WholeJpeg};
use prost::Message as _;

use super::LogError;
use super::messages::{self, ImageMessage};
use super::records::ChannelRecord;
use super::scan::{self, Step};
use super::topic::Topic;

/// Schema and encoding of an image topic.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum ImageKind {
    /// `foxglove.RawImage`, protobuf.
    Raw,
    /// `foxglove.CompressedImage`, protobuf.
    Compressed,
    /// `sensor_msgs/msg/Image`, CDR.
    RosRaw,
    /// `sensor_msgs/msg/CompressedImage`, CDR.
    RosCompressed,
}

impl ImageKind {
    const ALL: [(ImageKind, &'static str, &'static str); 4] = [
        (ImageKind::Raw, "foxglove.RawImage", "protobuf"),
        (
            ImageKind::Compressed,
            "foxglove.CompressedImage",
            "protobuf",
        ),
        (ImageKind::RosRaw, "sensor_msgs/msg/Image", "cdr"),
        (
            ImageKind::RosCompressed,
            "sensor_msgs/msg/CompressedImage",
            "cdr",
        ),
    ];

    /// The kind of a schema and encoding, if it is read.
    pub fn of(schema: &str, encoding: &str) -> Option<ImageKind> {
        ImageKind::ALL
            .into_iter()
            .find(|(_, s, e)| *s == schema && *e == encoding)
            .map(|(kind, ..)| kind)
    }

    pub fn decode(self, data: Bytes) -> Result<ImageMessage, String> {
        match self {
            ImageKind::Raw => messages::RawImage::decode(data)
                .map(ImageMessage::Raw)
                .map_err(|e| e.to_string()),
            ImageKind::Compressed => messages::CompressedImage::decode(data)
                .map(ImageMessage::Compressed)
                .map_err(|e| e.to_string()),
            ImageKind::RosRaw => messages::ros_image(&data).map_err(|e| e.to_string()),
            ImageKind::RosCompressed => messages::ros_compressed(&data).map_err(|e| e.to_string()),
        }
    }
}

/// Whether messages of this schema and encoding hold images that are packed, as JPEGs are.
pub fn holds_packed_images(schema: &str, encoding: &str) -> bool {
    matches!(
        ImageKind::of(schema, encoding),
        Some(ImageKind::Compressed | ImageKind::RosCompressed)
    )
}

/// Damage of the JPEG that a message of this schema and encoding holds; `None` = it holds none, or a whole one.
pub fn image_damage(schema: &str, encoding: &str, data: &[u8]) -> Option<JpegDamage> {
    let kind = ImageKind::of(schema, encoding).filter(|_| holds_packed_images(schema, encoding))?;
    let Ok(ImageMessage::Compressed(image)) = kind.decode(Bytes::copy_from_slice(data)) else {
        return None;
    };
    let is_jpeg = messages::compression(&image.format) == Some(PixelFormat::Mjpg);
    is_jpeg.then(|| WholeJpeg::of(&image.data).err()).flatten()
}

/// A topic with images.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ImageTopic {
    /// Name of the topic.
    pub topic: String,
    /// Name of the schema.
    pub schema: String,
    /// Message encoding.
    pub encoding: String,
    /// Number of messages.
    pub messages: u64,
    /// Pixel format, width and height \[px\] of the first of them; or the reason why it is not read.
    pub first: Result<(&'static str, u32, u32), String>,
}

impl fmt::Display for ImageTopic {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{} ({}, {} images",
            self.topic, self.schema, self.messages
        )?;
        match &self.first {
            Ok((format, w, h)) => write!(f, ", {format} {w}x{h})"),
            Err(why) => write!(f, ", not read: {why})"),
        }
    }
}

/// Error where no topic can be chosen.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)] // Each message names its fields.
pub enum ImageTopicError {
    #[error(transparent)]
    Log(#[from] LogError),
    #[error("{}: has no images on {wanted}; it has {}; name one with --image-topic", path.display(), listed(there))]
    Missing {
        path: PathBuf,
        wanted: String,
        there: Vec<ImageTopic>,
    },
    #[error("{}: has images on several topics: {}; name one with --image-topic", path.display(), listed(there))]
    Several {
        path: PathBuf,
        there: Vec<ImageTopic>,
    },
    #[error(
        "{}: {topic}; hydroline reads foxglove.RawImage and foxglove.CompressedImage in protobuf, sensor_msgs/msg/Image and \
         sensor_msgs/msg/CompressedImage in CDR: convert the log",
        path.display()
    )]
    Unread {
        path: PathBuf,
        topic: Box<ImageTopic>,
    },
}

fn listed(topics: &[ImageTopic]) -> String {
    let words: Vec<String> = topics.iter().map(ToString::to_string).collect();
    if words.is_empty() {
        "no images at all".to_owned()
    } else {
        words.join("; ")
    }
}

/// Whether the images of this topic are ours, read without being named.
fn is_ours(channel: &ChannelRecord, schema: &str) -> bool {
    let image = Topic::find(&channel.topic, schema)
        .is_some_and(|t| matches!(t, Topic::RawImage | Topic::CompressedImage));
    image && channel.message_encoding == "protobuf"
}

/// Every topic with images; `None` as soon as one of ours is found where `ours_will_do`. Damage is passed over:
/// whoever reads the images reports it.
fn survey(path: &Path, ours_will_do: bool) -> Result<Option<Vec<ImageTopic>>, LogError> {
    let mut scan = scan::open(path)?;
    let mut found: BTreeMap<String, ImageTopic> = BTreeMap::new();
    while let Some(step) = scan.next() {
        let Step::Message {
            channel, message, ..
        } = step
        else {
            continue;
        };
        if let Some(topic) = found.get_mut(&channel.topic) {
            topic.messages += 1;
            continue;
        }
        let schema = scan.learnt.declared.schema_name(&channel);
        if ours_will_do && is_ours(&channel, schema) {
            return Ok(None);
        }
        let encoding = channel.message_encoding.as_str();
        let first = match ImageKind::of(schema, encoding) {
            Some(kind) => kind.decode(message.data).and_then(|image| {
                let frame = messages::frame_from(image, None, 0, message.publish_ns);
                frame
                    .map(|f| (f.format.name(), f.width_px, f.height_px))
                    .map_err(|e| e.to_string())
            }),
            // ROS 1, JSON and the like: named, so that nobody looks for them elsewhere.
            None if schema.ends_with("Image") => Err(format!("{schema} in {encoding}")),
            None => continue,
        };
        found.insert(
            channel.topic.clone(),
            ImageTopic {
                topic: channel.topic.clone(),
                schema: schema.to_owned(),
                encoding: encoding.to_owned(),
                messages: 1,
                first,
            },
        );
    }
    Ok(Some(found.into_values().collect()))
}

/// The topic whose images are meant: the one named, else ours (`None`), else the only one there is; without any too
/// `None`.
pub fn image_topic(
    path: &Path,
    named: Option<&str>,
) -> Result<Option<ImageTopic>, ImageTopicError> {
    let Some(mut there) = survey(path, named.is_none())? else {
        return Ok(None);
    };
    let chosen = match named {
        Some(wanted) => match there.iter().position(|t| t.topic == wanted) {
            Some(at) => there.swap_remove(at),
            None => {
                return Err(ImageTopicError::Missing {
                    path: path.to_owned(),
                    wanted: wanted.to_owned(),
                    there,
                });
            }
        },
        None if there.len() > 1 => {
            return Err(ImageTopicError::Several {
                path: path.to_owned(),
                there,
            });
        }
        None => match there.pop() {
            Some(only) => only,
            None => return Ok(None),
        },
    };
    if chosen.first.is_err() {
        return Err(ImageTopicError::Unread {
            path: path.to_owned(),
            topic: Box::new(chosen),
        });
    }
    Ok(Some(chosen))
}

#[cfg(test)]
mod tests;

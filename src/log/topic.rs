//! The topics of a hydroline log, their schemas, and schemas cut down to what one message needs.

use std::sync::OnceLock;

use foxglove::Encode;
use prost::Message as _;
use prost_types::FileDescriptorSet;

/// One kind of message on one topic. Two of them share `/camera/image`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Topic {
    /// `/camera/image` as `foxglove.RawImage`.
    RawImage,
    /// `/camera/image` as `foxglove.CompressedImage`.
    CompressedImage,
    /// `/camera/frame`.
    FrameInfo,
    /// `/camera/calibration`.
    CameraCalibration,
    /// `/laser/calibration`.
    PlaneCalibration,
    /// `/camera/annotations`.
    Annotations,
    /// `/laser/profile`.
    Profile,
    /// `/thruster/command`.
    Command,
    /// `/thruster/echo`.
    Echo,
    /// `/vehicle/motion`.
    Motion,
    /// `/vehicle/pose`.
    Pose,
    /// `/autopilot/motion`.
    AutopilotMotion,
    /// `/autopilot/state`.
    AutopilotState,
    /// `/clock`.
    Clock,
    /// `/daemon/event`.
    Event,
    /// `/daemon/log`.
    Log,
    /// `/sim/truth`.
    Truth,
}

/// Name and descriptors in an MCAP schema record.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SchemaText {
    /// Full message name, e.g. `hydroline.FrameInfo`.
    pub name: String,
    /// A serialised `google.protobuf.FileDescriptorSet`.
    pub data: Vec<u8>,
}

impl Topic {
    /// Every topic, in the order of reference/interfaces.md.
    pub const ALL: [Topic; 17] = [
        Topic::RawImage,
        Topic::CompressedImage,
        Topic::FrameInfo,
        Topic::CameraCalibration,
        Topic::PlaneCalibration,
        Topic::Annotations,
        Topic::Profile,
        Topic::Command,
        Topic::Echo,
        Topic::Motion,
        Topic::Pose,
        Topic::AutopilotMotion,
        Topic::AutopilotState,
        Topic::Clock,
        Topic::Event,
        Topic::Log,
        Topic::Truth,
    ];

    /// Name of the topic in the file.
    pub fn name(self) -> &'static str {
        match self {
            Topic::RawImage | Topic::CompressedImage => "/camera/image",
            Topic::FrameInfo => "/camera/frame",
            Topic::CameraCalibration => "/camera/calibration",
            Topic::PlaneCalibration => "/laser/calibration",
            Topic::Annotations => "/camera/annotations",
            Topic::Profile => "/laser/profile",
            Topic::Command => "/thruster/command",
            Topic::Echo => "/thruster/echo",
            Topic::Motion => "/vehicle/motion",
            Topic::Pose => "/vehicle/pose",
            Topic::AutopilotMotion => "/autopilot/motion",
            Topic::AutopilotState => "/autopilot/state",
            Topic::Clock => "/clock",
            Topic::Event => "/daemon/event",
            Topic::Log => "/daemon/log",
            Topic::Truth => "/sim/truth",
        }
    }

    /// Full name of the message type.
    pub fn schema_name(self) -> &'static str {
        match self {
            Topic::RawImage => "foxglove.RawImage",
            Topic::CompressedImage => "foxglove.CompressedImage",
            Topic::FrameInfo => "hydroline.FrameInfo",
            Topic::CameraCalibration => "foxglove.CameraCalibration",
            Topic::PlaneCalibration => "hydroline.PlaneCalibration",
            Topic::Annotations => "foxglove.ImageAnnotations",
            Topic::Profile => "hydroline.StripeProfile",
            Topic::Command => "hydroline.ThrusterCommand",
            Topic::Echo => "hydroline.ThrusterEcho",
            Topic::Motion | Topic::AutopilotMotion | Topic::Truth => "hydroline.VehicleMotion",
            Topic::AutopilotState => "hydroline.AutopilotState",
            Topic::Pose => "foxglove.PoseInFrame",
            Topic::Clock => "hydroline.ClockPair",
            Topic::Event => "hydroline.Event",
            Topic::Log => "foxglove.Log",
        }
    }

    /// The topic of that name carrying that schema, if it is one of ours.
    pub fn find(name: &str, schema: &str) -> Option<Topic> {
        Topic::ALL
            .into_iter()
            .find(|t| t.name() == name && t.schema_name() == schema)
    }

    /// Schema for the MCAP file: the descriptor of the message's file and of the files it imports.
    pub fn schema(self) -> SchemaText {
        use foxglove::messages as fg;
        let published = match self {
            Topic::RawImage => fg::RawImage::get_schema(),
            Topic::CompressedImage => fg::CompressedImage::get_schema(),
            Topic::CameraCalibration => fg::CameraCalibration::get_schema(),
            Topic::Annotations => fg::ImageAnnotations::get_schema(),
            Topic::Pose => fg::PoseInFrame::get_schema(),
            Topic::Log => fg::Log::get_schema(),
            _ => None,
        };
        match published {
            Some(s) => SchemaText {
                name: s.name,
                data: s.data.into_owned(),
            },
            None => SchemaText {
                name: self.schema_name().to_owned(),
                data: restricted_to(own_descriptors(), self.schema_name()).encode_to_vec(),
            },
        }
    }

    /// Whether a message on this topic must be on the disk within the command flush time.
    pub fn is_urgent(self) -> bool {
        matches!(self, Topic::Command | Topic::Event)
    }

    /// Whether it is sent once and holds for all that follows.
    pub fn is_calibration(self) -> bool {
        matches!(self, Topic::CameraCalibration | Topic::PlaneCalibration)
    }

    /// Whether `replay` computes its messages again from the images.
    pub fn is_derived(self) -> bool {
        matches!(self, Topic::Profile | Topic::Annotations)
    }
}

/// Schema of a message of Foxglove that holds places, attitudes, motion or images, as Foxglove publishes it; `None` = it is none
/// of those.
pub fn published_schema(name: &str) -> Option<SchemaText> {
    use foxglove::messages as fg;
    let all = [
        fg::FrameTransform::get_schema,
        fg::FrameTransforms::get_schema,
        fg::JointState::get_schema,
        fg::JointStates::get_schema,
        fg::LocationFix::get_schema,
        fg::LocationFixes::get_schema,
        fg::Odometry::get_schema,
        fg::Point3::get_schema,
        fg::Point3InFrame::get_schema,
        fg::Pose::get_schema,
        fg::PoseInFrame::get_schema,
        fg::PosesInFrame::get_schema,
        fg::Quaternion::get_schema,
        fg::Vector3::get_schema,
        fg::RawImage::get_schema,
        fg::CompressedImage::get_schema,
    ];
    let found = all.into_iter().filter_map(|schema| schema());
    let mut found = found.filter(|s| s.name == name);
    found.next().map(|s| SchemaText {
        name: s.name,
        data: s.data.into_owned(),
    })
}

/// Descriptors of `hydroline.proto` and its imports, generated with the messages.
fn own_descriptors() -> &'static FileDescriptorSet {
    static SET: OnceLock<FileDescriptorSet> = OnceLock::new();
    SET.get_or_init(|| {
        let bytes = include_bytes!("generated/hydroline.fds");
        // The bytes are checked in; a test decodes them and finds every message.
        FileDescriptorSet::decode(bytes.as_slice()).unwrap_or_default()
    })
}

/// The file that declares `message`, the files it imports (transitively), imports first.
/// Comments are omitted: viewers do not read them and they would triple the size.
fn restricted_to(set: &FileDescriptorSet, message: &str) -> FileDescriptorSet {
    let declares = |f: &prost_types::FileDescriptorProto| {
        f.message_type
            .iter()
            .any(|m| format!("{}.{}", f.package(), m.name()) == message)
    };
    let mut wanted: Vec<&str> = set
        .file
        .iter()
        .filter(|f| declares(f))
        .map(|f| f.name())
        .collect();
    let mut next = 0;
    while next < wanted.len() {
        if let Some(file) = set.file.iter().find(|f| f.name() == wanted[next]) {
            for import in &file.dependency {
                if !wanted.contains(&import.as_str()) {
                    wanted.push(import);
                }
            }
        }
        next += 1;
    }
    wanted.reverse();
    let file = wanted
        .iter()
        .filter_map(|name| set.file.iter().find(|f| f.name() == *name))
        .map(|f| prost_types::FileDescriptorProto {
            source_code_info: None,
            ..f.clone()
        })
        .collect();
    FileDescriptorSet { file }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_schema_declares_its_message_and_all_it_imports() {
        for topic in Topic::ALL {
            let schema = topic.schema();
            assert_eq!(schema.name, topic.schema_name());
            let set = FileDescriptorSet::decode(schema.data.as_slice()).unwrap();
            let declared = set.file.iter().any(|f| {
                f.message_type
                    .iter()
                    .any(|m| format!("{}.{}", f.package(), m.name()) == schema.name)
            });
            assert!(declared, "{topic:?}");
            for file in &set.file {
                for import in &file.dependency {
                    assert!(
                        set.file.iter().any(|f| f.name() == import),
                        "{topic:?} lacks {import}"
                    );
                }
                assert!(file.source_code_info.is_none());
            }
        }
    }

    #[test]
    fn topics_are_found_by_name_and_schema() {
        for topic in Topic::ALL {
            assert_eq!(Topic::find(topic.name(), topic.schema_name()), Some(topic));
        }
        assert_eq!(Topic::find("/camera/image", "sensor_msgs/msg/Image"), None);
    }

    #[test]
    fn a_schema_holds_no_file_it_does_not_need() {
        let mut set = own_descriptors().clone();
        set.file.push(prost_types::FileDescriptorProto {
            name: Some("stranger.proto".into()),
            ..Default::default()
        });
        let cut = restricted_to(&set, "hydroline.Event");
        let names: Vec<&str> = cut.file.iter().map(|f| f.name()).collect();
        assert_eq!(
            names,
            ["google/protobuf/timestamp.proto", "hydroline.proto"]
        );
    }
}

//! Logs as ROS 2 and Foxglove write them, made with the mcap crate.

use std::collections::BTreeMap;
use std::io::BufWriter;

use hydroline_core::frame::{GreyRule, PixelFormat};

use super::*;
use crate::messages::ros_written;
use crate::{LogReader, Record};

const T0_NS: u64 = 1_760_000_000_000_000_000;

struct Foreign {
    dir: tempfile::TempDir,
    writer: mcap::Writer<BufWriter<std::fs::File>>,
    channels: BTreeMap<String, u16>,
}

impl Foreign {
    fn new() -> Self {
        let dir = tempfile::tempdir().unwrap();
        let file = std::fs::File::create(dir.path().join("bag.mcap")).unwrap();
        let writer = mcap::Writer::new(BufWriter::new(file)).unwrap();
        Self {
            dir,
            writer,
            channels: BTreeMap::new(),
        }
    }

    fn put(&mut self, topic: &str, schema: &str, encoding: &str, at_ns: u64, data: &[u8]) {
        let id = match self.channels.get(topic) {
            Some(id) => *id,
            None => {
                let kind = if encoding == "cdr" {
                    "ros2msg"
                } else {
                    encoding
                };
                let schema = self.writer.add_schema(schema, kind, b"x").unwrap();
                let id = self
                    .writer
                    .add_channel(schema, topic, encoding, &BTreeMap::new())
                    .unwrap();
                self.channels.insert(topic.to_owned(), id);
                id
            }
        };
        let header = mcap::records::MessageHeader {
            channel_id: id,
            // As rosbag2 numbers.
            sequence: 0,
            log_time: at_ns,
            publish_time: at_ns,
        };
        self.writer.write_to_known_channel(&header, data).unwrap();
    }

    fn finish(mut self) -> (tempfile::TempDir, std::path::PathBuf) {
        self.writer.finish().unwrap();
        let path = self.dir.path().join("bag.mcap");
        (self.dir, path)
    }
}

fn ros(level: u8) -> Vec<u8> {
    ros_written(false, "mono8", (4, 2, 4), &[level; 8])
}

#[test]
fn the_only_image_topic_is_taken_and_its_frames_are_numbered() {
    let mut bag = Foreign::new();
    for k in 0..3u64 {
        bag.put(
            "/imu",
            "sensor_msgs/msg/Imu",
            "cdr",
            T0_NS + k,
            &[0, 1, 0, 0],
        );
        bag.put(
            "/cam/image_raw",
            "sensor_msgs/msg/Image",
            "cdr",
            T0_NS + k,
            &ros(k as u8),
        );
    }
    let (_dir, path) = bag.finish();
    let topic = image_topic(&path, None).unwrap().unwrap();
    assert_eq!(
        (topic.topic.as_str(), topic.messages),
        ("/cam/image_raw", 3)
    );
    assert_eq!(topic.first, Ok(("GREY", 4, 2)));
    let (mut levels, mut others) = (Vec::new(), 0);
    for message in LogReader::open(&path)
        .unwrap()
        .with_images_of(Some(&topic.topic))
    {
        match message.unwrap().record {
            Record::Frame(frame) => {
                assert_eq!(frame.meta.mid_exposure_ns, 1_760_000_000_040_000_000);
                let grey = frame.to_grey(&GreyRule::default()).unwrap();
                levels.push((frame.meta.sequence, grey.pixels[0]));
            }
            Record::Other { topic, .. } => others += u32::from(topic == "/imu"),
            other => panic!("{other:?}"),
        }
    }
    assert_eq!((levels, others), (vec![(0, 0), (1, 1), (2, 2)], 3));
}

#[test]
fn several_topics_are_listed_with_sizes_and_counts_and_one_can_be_named() {
    let mut bag = Foreign::new();
    let mut png = std::io::Cursor::new(Vec::new());
    image::GrayImage::from_pixel(5, 3, image::Luma([9]))
        .write_to(&mut png, image::ImageFormat::Png)
        .unwrap();
    let compressed = messages::CompressedImage {
        data: png.into_inner().into(),
        format: "png".into(),
        ..Default::default()
    };
    bag.put("/left", "sensor_msgs/msg/Image", "cdr", T0_NS, &ros(7));
    bag.put("/left", "sensor_msgs/msg/Image", "cdr", T0_NS + 1, &ros(7));
    bag.put(
        "/right",
        "foxglove.CompressedImage",
        "protobuf",
        T0_NS,
        &compressed.encode_to_vec(),
    );
    bag.put("/old", "sensor_msgs/Image", "ros1", T0_NS, &[1, 2, 3]);
    let (_dir, path) = bag.finish();
    let words = image_topic(&path, None).unwrap_err().to_string();
    for word in [
        "/left (sensor_msgs/msg/Image, 2 images, GREY 4x2)",
        "/right (foxglove.CompressedImage, 1 images, PNG 5x3)",
        "/old (sensor_msgs/Image, 1 images, not read: sensor_msgs/Image in ros1)",
        "--image-topic",
    ] {
        assert!(words.contains(word), "no `{word}` in {words}");
    }
    let right = image_topic(&path, Some("/right")).unwrap().unwrap();
    let frames: Vec<_> = LogReader::open(&path)
        .unwrap()
        .with_images_of(Some(&right.topic))
        .filter_map(|m| match m.unwrap().record {
            Record::Frame(frame) => Some(frame),
            _ => None,
        })
        .collect();
    assert_eq!((frames.len(), frames[0].format), (1, PixelFormat::Png));
    assert_eq!(frames[0].meta.mid_exposure_ns, T0_NS);
    let words = image_topic(&path, Some("/middle")).unwrap_err().to_string();
    assert!(
        words.contains("no images on /middle") && words.contains("/left"),
        "{words}"
    );
    let words = image_topic(&path, Some("/old")).unwrap_err().to_string();
    assert!(
        words.contains("convert the log") && words.contains("ros1"),
        "{words}"
    );
}

#[test]
fn our_own_images_need_no_name_and_give_way_to_one() {
    let mut bag = Foreign::new();
    let ours = messages::RawImage {
        width: 2,
        height: 1,
        step: 2,
        encoding: "mono8".into(),
        data: vec![3, 4].into(),
        ..Default::default()
    };
    bag.put("/side", "sensor_msgs/msg/Image", "cdr", T0_NS, &ros(1));
    bag.put(
        "/camera/image",
        "foxglove.RawImage",
        "protobuf",
        T0_NS,
        &ours.encode_to_vec(),
    );
    let (_dir, path) = bag.finish();
    assert_eq!(image_topic(&path, None).unwrap(), None);
    let widths = |topic: Option<&str>| -> Vec<u32> {
        let reader = LogReader::open(&path).unwrap().with_images_of(topic);
        let frames = reader.filter_map(|m| match m.unwrap().record {
            Record::Frame(frame) => Some(frame.width_px),
            _ => None,
        });
        frames.collect()
    };
    assert_eq!((widths(None), widths(Some("/side"))), (vec![2], vec![4]));
    let none = Foreign::new();
    let (_dir, path) = none.finish();
    assert_eq!(image_topic(&path, None).unwrap(), None);
    let words = image_topic(&path, Some("/side")).unwrap_err().to_string();
    assert!(words.contains("no images at all"), "{words}");
}

//! Camera formats from file to stripe: the same picture in each of them gives the same stripe, and what was lost is counted
//! exactly. Folders of images and logs of ROS 2 take the same way.

use crate::support::hydroline;
use hydroline::frame::{
    BayerDepth, BayerOrder, Frame, FrameFault, FrameMeta, LossBefore, PixelFormat, StampClock,
    StampSource,
};
use hydroline::log::messages::pb::StripeProfile;
use hydroline::log::{Entry, FileRecorder, Head, LogReader, Record, SummaryInput, WriteSettings};
use hydroline::stripe::quality;
use hydroline_rigs::Rig;
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

const T0_NS: u64 = 1_760_000_000_000_000_000;
const PERIOD_NS: u64 = 40_000_000;

/// The test picture's grey levels, 720 x 576.
fn picture() -> image::GrayImage {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/frame.png");
    image::open(path).unwrap().into_luma8()
}

/// White light of these levels, as a camera of this format delivers it; rows padded by eight bytes.
fn delivered(format: PixelFormat, light: &image::GrayImage) -> (Vec<u8>, u32) {
    let deep = |level: u8| (f64::from(level) / 255.0 * 4095.0).round() as u16;
    let mut data = Vec::new();
    let (w, h) = light.dimensions();
    let stride = format.row_bytes(w) as u32 + 8;
    for row in 0..h {
        for column in 0..w {
            let level = light.get_pixel(column, row).0[0];
            match format {
                PixelFormat::Grey | PixelFormat::Nv12 => data.push(level),
                PixelFormat::Uyvy => data.extend([128, level]),
                PixelFormat::Rgb24 => data.extend([level; 3]),
                // A sensor of 12 bits, in samples of 16.
                _ => data.extend(deep(level).to_le_bytes()),
            }
        }
        data.extend([0; 8]);
    }
    if format == PixelFormat::Nv12 {
        data.extend(vec![128; (stride * h / 2) as usize]);
    }
    (data, stride)
}

fn rig(format: PixelFormat, extra: &str, channel: &str) -> Rig {
    let text = Rig::builtin("lshpi").unwrap().effective_toml;
    let camera = format!("pixel_format = \"{}\"\n{extra}", format.name());
    let text = text.replace("pixel_format = \"GREY\"", &camera);
    let text = text.replace("shadows = ", &format!("{channel}shadows = "));
    Rig::from_toml(&text, "rig", None).unwrap()
}

/// Six frames; two were lost before the third, three before the fifth, and the fourth is cut.
fn record(path: &Path, format: PixelFormat, rig: &Rig) {
    let light = picture();
    let (data, stride_bytes) = delivered(format, &light);
    let head = Head {
        rig_toml: rig.effective_toml.clone(),
        ..Head::default()
    };
    let settings = WriteSettings::offline(Some(format));
    let mut log = FileRecorder::create(path, false, head, settings).unwrap();
    let mut sequence = 0;
    for k in 0..6u64 {
        let lost = match k {
            2 => 2,
            4 => 3,
            _ => 0,
        };
        sequence += lost + u32::from(k > 0);
        let stamp_ns = T0_NS + u64::from(sequence) * PERIOD_NS;
        let cut = k == 3;
        let frame = Frame {
            format,
            width_px: light.width(),
            height_px: light.height(),
            stride_bytes,
            data: if cut {
                data[..1000].to_vec()
            } else {
                data.clone()
            }
            .into(),
            meta: FrameMeta {
                sequence,
                driver_stamp_ns: stamp_ns,
                stamp_clock: StampClock::Realtime,
                stamp_source: StampSource::MidExposure,
                flags: 0,
                received_monotonic_ns: 1,
                mid_exposure_ns: stamp_ns,
                exposure_s: 0.004,
                fault: cut.then_some(FrameFault::Truncated),
                lost_before: LossBefore {
                    sequence_gap: lost,
                    time_gap: 0,
                },
            },
        };
        log.write(stamp_ns, &Entry::frame(&frame, k)).unwrap();
    }
    log.finish(&SummaryInput::clean("done")).unwrap();
}

/// The words of a command and the files behind them; exit code, standard output, standard error.
pub fn run(words: &str, files: &[&Path]) -> (i32, String, String) {
    let mut command = hydroline();
    let mut files = files.iter();
    for word in words.split(' ') {
        match word {
            "FILE" => command.arg(files.next().unwrap()),
            _ => command.arg(word),
        };
    }
    let output = command.output().unwrap();
    (
        output.status.code().unwrap(),
        String::from_utf8_lossy(&output.stdout).into_owned(),
        String::from_utf8_lossy(&output.stderr).into_owned(),
    )
}

pub fn profiles(log: &Path) -> Vec<StripeProfile> {
    let records = LogReader::open(log).unwrap().map(|m| m.unwrap().record);
    let profiles = records.filter_map(|record| match record {
        Record::Profile(profile) => Some(profile),
        _ => None,
    });
    profiles.collect()
}

/// Mean and largest difference of two stripes' rows where both have a point; the columns are nearly all of them.
fn difference_px(a: &StripeProfile, b: &StripeProfile) -> (f64, f64) {
    // Beside steps a row is that of a stripe cut in part, by what of it each format shows.
    let rows = |p: &StripeProfile| -> BTreeMap<i64, f64> {
        (0..p.row_px.len())
            .filter(|k| p.quality[*k] & quality::NEAR_STEP == 0)
            .map(|k| (p.column_px[k].round() as i64, f64::from(p.row_px[k])))
            .collect()
    };
    let (a, b) = (rows(a), rows(b));
    let both: Vec<f64> = a
        .iter()
        .filter_map(|(c, row)| Some(b.get(c)? - row))
        .collect();
    assert!(
        both.len() * 100 >= a.len() * 95,
        "{} of {}",
        both.len(),
        a.len()
    );
    let worst = both.iter().fold(0.0f64, |w, d| w.max(d.abs()));
    (both.iter().sum::<f64>() / both.len() as f64, worst)
}

/// A pixel format, its keys in the rig's `[camera]` and `[laser]`, mean and largest difference to the grey camera's rows \[px\].
type Case = (PixelFormat, &'static str, &'static str, f64, f64);

const GREY: Case = (PixelFormat::Grey, "", "", 0.0, 0.0);
const NV12: Case = (PixelFormat::Nv12, "", "", 0.0, 0.0);
/// Three quarters of red's pixels are interpolated.
const BAYER_RED: Case = (
    PixelFormat::Bayer(BayerOrder::Bggr, BayerDepth::Sixteen),
    "bits = 12\n",
    "channel = \"red\"\n",
    0.01,
    0.5,
);

#[test]
fn one_picture_in_three_formats_is_one_stripe_and_every_loss_is_counted() {
    one_stripe_of(&[GREY, NV12, BAYER_RED]);
}

#[test]
#[ignore = "half a minute of processor time: tests/nightly; every day three of them"]
fn one_picture_in_every_format_is_one_stripe_and_every_loss_is_counted() {
    one_stripe_of(&[
        GREY,
        (PixelFormat::Uyvy, "", "", 0.0, 0.0),
        NV12,
        (PixelFormat::Rgb24, "", "channel = \"red\"\n", 0.0, 0.0),
        // 4096 levels and back to the same 256.
        (PixelFormat::Y16, "bits = 12\n", "", 0.0, 0.0),
        // Half of green's pixels are interpolated.
        (
            PixelFormat::Bayer(BayerOrder::Grbg, BayerDepth::Sixteen),
            "bits = 12\n",
            "channel = \"green\"\n",
            0.01,
            0.5,
        ),
        BAYER_RED,
    ]);
}

fn one_stripe_of(cases: &[Case]) {
    let dir = tempfile::tempdir().unwrap();
    let mut reference: Option<StripeProfile> = None;
    for &(format, camera, channel, mean_px, worst_px) in cases {
        let name = format!("{}{}", format.name(), channel.len());
        let log = dir.path().join(format!("{name}.mcap"));
        let out = dir.path().join(format!("{name}-replayed.mcap"));
        record(&log, format, &rig(format, camera, channel));
        let (code, stdout, stderr) = run("replay FILE --json --out FILE", &[&log, &out]);
        // The picture shows no target: no poses, which is said, and so is the frame that is cut.
        assert_eq!(code, 3, "{name}: {stderr}");
        assert!(
            stderr.contains("1 of 6 frames are marked as damaged")
                && stderr.contains("have a pose"),
            "{name}: {stderr}"
        );
        let report: Value = serde_json::from_str(&stdout).unwrap();
        let report = &report["replays"][0]["report"];
        let counts = |key: &str| report[key].as_u64().unwrap();
        assert_eq!(
            (
                counts("frames"),
                counts("with_stripe"),
                counts("undecodable")
            ),
            (6, 5, 0),
            "{name}: {report}"
        );
        assert_eq!(
            report["without_stripe"]["frame excluded: truncated"], 1,
            "{name}"
        );
        let (code, stdout, _) = run("doctor FILE --json", &[&log]);
        let said: Value = serde_json::from_str(&stdout).unwrap();
        assert_eq!(
            (code, said["frames_lost"].as_u64()),
            (3, Some(5)),
            "{name}: {said}"
        );

        let stripes: Vec<_> = profiles(&out)
            .into_iter()
            .filter(|p| p.fault.is_empty())
            .collect();
        assert_eq!(stripes.len(), 5, "{name}");
        let stripe = &stripes[0];
        assert!(
            stripe.row_px.len() > 600,
            "{name}: {} points",
            stripe.row_px.len()
        );
        let first = reference.get_or_insert_with(|| stripe.clone());
        let (mean, worst) = difference_px(first, stripe);
        println!("{name}: mean {mean:.4} px, largest {worst:.4} px");
        assert!(
            mean.abs() <= mean_px && worst <= worst_px,
            "{name}: {mean} {worst}"
        );
    }
}

fn deep_png(light: &image::GrayImage, bits: u8) -> image::ImageBuffer<image::Luma<u16>, Vec<u16>> {
    let max = f64::from((1u32 << bits) - 1);
    image::ImageBuffer::from_fn(light.width(), light.height(), |x, y| {
        let level = f64::from(light.get_pixel(x, y).0[0]);
        image::Luma([(level / 255.0 * max).round() as u16])
    })
}

/// A folder with images 1, 2, 4, 7, 8 and 10 and a note.
fn folder(dir: &Path) -> PathBuf {
    let frames = dir.join("frames");
    std::fs::create_dir(&frames).unwrap();
    let deep = deep_png(&picture(), 12);
    for n in [2, 10, 1, 8, 4, 7] {
        deep.save(frames.join(format!("img{n}.png"))).unwrap();
    }
    std::fs::write(frames.join("notes.txt"), "calm").unwrap();
    frames
}

#[test]
fn a_folder_of_images_is_extracted_and_replayed_in_the_order_of_its_numbers() {
    let dir = tempfile::tempdir().unwrap();
    let frames = folder(dir.path());
    let (code, stdout, stderr) = run("extract FILE --json --bits 12", &[&frames]);
    assert_eq!(code, 0, "{stderr}");
    assert!(
        stderr.contains("1 of 7 entries") && stderr.contains("notes.txt"),
        "{stderr}"
    );
    let said: Value = serde_json::from_str(&stdout).unwrap();
    let images = said["images"].as_array().unwrap();
    let names: Vec<&str> = images
        .iter()
        .map(|i| i["image"].as_str().unwrap())
        .collect();
    let numbers: Vec<_> = names
        .iter()
        .map(|n| n.rsplit_once("img").unwrap().1)
        .collect();
    assert_eq!(
        numbers,
        ["1.png", "2.png", "4.png", "7.png", "8.png", "10.png"]
    );
    assert!(images[0]["row_px"].as_array().unwrap().len() > 600);
    // 12 bits taken for 16 are one level of sixteen.
    let (_, stdout, _) = run("extract FILE --json", &[&frames]);
    let dark: Value = serde_json::from_str(&stdout).unwrap();
    let brightest = |image: &Value| {
        let peaks = image["peak"].as_array().unwrap().iter();
        peaks.map(|p| p.as_f64().unwrap()).fold(0.0, f64::max)
    };
    let (read, dark) = (brightest(&images[0]), brightest(&dark["images"][0]));
    assert!(read > 100.0 && dark < 20.0, "{read} {dark}");

    let out = dir.path().join("out.mcap");
    let (code, _, stderr) = run("replay FILE --rig lshpi --out FILE", &[&frames, &out]);
    assert_eq!(code, 2, "{stderr}");
    assert!(
        stderr.contains("--rate-hz") && stderr.contains("img1.png"),
        "{stderr}"
    );
    let rig_file = dir.path().join("rig.toml");
    let rig = rig(PixelFormat::Y16, "bits = 12\n", "");
    std::fs::write(&rig_file, &rig.effective_toml).unwrap();
    let line = "replay FILE --rig FILE --rate-hz 25 --json --out FILE";
    let (code, stdout, stderr) = run(line, &[&frames, &rig_file, &out]);
    assert_eq!(code, 3, "{stderr}");
    let said: Value = serde_json::from_str(&stdout).unwrap();
    let report = &said["replays"][0]["report"];
    assert_eq!(
        (
            report["frames"].as_u64(),
            report["with_stripe"].as_u64(),
            report["frames_missing"].as_u64()
        ),
        (Some(6), Some(6), Some(4)),
        "{report}"
    );
    let stamps: Vec<_> = profiles(&out)
        .iter()
        .map(|p| (p.sequence, p.timestamp.unwrap()))
        .collect();
    assert_eq!(
        stamps.iter().map(|s| s.0).collect::<Vec<_>>(),
        [0, 1, 3, 6, 7, 9]
    );
    assert_eq!(stamps[5].1.nanos - stamps[0].1.nanos, 9 * 40_000_000);
    // The new log knows what its images left out.
    let (_, stdout, _) = run("doctor FILE --json", &[&out]);
    let said: Value = serde_json::from_str(&stdout).unwrap();
    assert_eq!(said["frames_lost"].as_u64(), Some(4), "{said}");
}

/// `sensor_msgs/msg/Image` as ROS 2 serialises it, little endian.
fn ros_image(k: u32, encoding: &str, (w, h, step): (u32, u32, u32), data: &[u8]) -> Vec<u8> {
    let mut out = vec![0, 1, 0, 0];
    let number = |out: &mut Vec<u8>, value: u32| {
        out.resize(out.len().next_multiple_of(4), 0);
        out.extend(value.to_le_bytes());
    };
    let text = |out: &mut Vec<u8>, text: &str| {
        number(out, text.len() as u32 + 1);
        out.extend(text.bytes().chain([0]));
    };
    number(&mut out, 1_760_000_000);
    number(&mut out, k * PERIOD_NS as u32);
    text(&mut out, "camera");
    number(&mut out, h);
    number(&mut out, w);
    text(&mut out, encoding);
    out.push(0);
    number(&mut out, step);
    number(&mut out, data.len() as u32);
    out.extend(data);
    out
}

/// Name, encoding, bytes of a row, size and frames.
type Topic<'a> = (&'a str, &'a str, u32, (u32, u32), Vec<&'a Vec<u8>>);

fn write_bag(bag: &Path, topics: &[Topic]) {
    let mut writer = mcap::Writer::new(std::fs::File::create(bag).unwrap()).unwrap();
    let schema = writer
        .add_schema("sensor_msgs/msg/Image", "ros2msg", b"x")
        .unwrap();
    for (topic, encoding, step, (w, h), frames) in topics {
        let channel = writer
            .add_channel(schema, topic, "cdr", &BTreeMap::new())
            .unwrap();
        for (k, data) in (0u32..).zip(frames) {
            let at = T0_NS + u64::from(k) * PERIOD_NS;
            let header = mcap::records::MessageHeader {
                channel_id: channel,
                sequence: 0,
                log_time: at,
                publish_time: at,
            };
            let message = ros_image(k, encoding, (*w, *h, *step), data);
            writer.write_to_known_channel(&header, &message).unwrap();
        }
    }
    writer.finish().unwrap();
}

/// A bag of ROS 2 with the same grey images under each topic.
pub fn ros_bag(bag: &Path, topics: &[&str], images: &[image::GrayImage]) {
    let (w, h) = images[0].dimensions();
    let topics: Vec<Topic> = topics
        .iter()
        .map(|topic| {
            (
                *topic,
                "mono8",
                w,
                (w, h),
                images.iter().map(|i| i.as_raw()).collect(),
            )
        })
        .collect();
    write_bag(bag, &topics);
}

#[test]
fn images_of_a_ros_2_bag_are_replayed_by_topic() {
    let dir = tempfile::tempdir().unwrap();
    let bag = dir.path().join("bag.mcap");
    let light = picture();
    let (uyvy, step) = delivered(PixelFormat::Uyvy, &light);
    let size = light.dimensions();
    write_bag(
        &bag,
        &[
            ("/down/image_raw", "uyvy", step, size, vec![&uyvy; 3]),
            (
                "/front/image_raw",
                "mono8",
                size.0,
                size,
                vec![light.as_raw(); 3],
            ),
        ],
    );
    let out = dir.path().join("out.mcap");
    let (code, _, stderr) = run("replay FILE --rig lshpi --out FILE", &[&bag, &out]);
    assert_eq!(code, 2, "{stderr}");
    for word in [
        "/down/image_raw (sensor_msgs/msg/Image, 3 images, UYVY 720x576)",
        "/front/image_raw (sensor_msgs/msg/Image, 3 images, GREY 720x576)",
        "--image-topic",
    ] {
        assert!(stderr.contains(word), "no `{word}` in {stderr}");
    }
    let line =
        "replay FILE --image-topic /down/image_raw --rig lshpi --keep-images --json --out FILE";
    let (code, stdout, stderr) = run(line, &[&bag, &out]);
    assert_eq!(code, 3, "{stderr}");
    let said: Value = serde_json::from_str(&stdout).unwrap();
    let report = &said["replays"][0]["report"];
    assert_eq!(
        (report["frames"].as_u64(), report["with_stripe"].as_u64()),
        (Some(3), Some(3)),
        "{report}"
    );
    assert_eq!(
        report["foreign"]["/front/image_raw"].as_u64(),
        Some(3),
        "{report}"
    );
    let stripes = profiles(&out);
    assert_eq!(
        stripes.iter().map(|p| p.sequence).collect::<Vec<_>>(),
        [0, 1, 2]
    );
    // A log of ours holds them now.
    let (code, stdout, _) = run("doctor FILE --json", &[&out]);
    assert_eq!(code, 0, "{stdout}");
    // No board in these pictures, but the topic was read.
    let calibration = dir.path().join("c.toml");
    let line = "calibrate FILE --image-topic /front/image_raw --board dots-50 --out FILE";
    let (code, _, stderr) = run(line, &[&bag, &calibration]);
    assert!(
        code == 1 && stderr.contains("in 3 images"),
        "{code}: {stderr}"
    );
}

//! Damaged JPEGs from file to stripe: no points of them, and how many there were is said, whichever way they come.

use crate::formats::{profiles, run};
use hydroline::frame::{Frame, FrameFault, FrameMeta, PixelFormat};
use hydroline::log::doctor::{Grade, doctor};
use hydroline::log::{Entry, FileRecorder, Head, LogReader, Record, SummaryInput, WriteSettings};
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::Path;

const T0_NS: u64 = 1_760_000_000_000_000_000;
const PERIOD_NS: u64 = 40_000_000;

/// A tilted stripe of 320 x 240.
fn sound() -> Vec<u8> {
    with_squares(&[])
}

/// The same with sharp squares of 8 x 8 pixels over it: on the JPEG's grid each of them looks like a damaged block.
fn with_squares(squares: &[[u32; 2]]) -> Vec<u8> {
    let is_over = |x: u32, y: u32| {
        let mut squares = squares.iter();
        squares.any(|[left, top]| (*left..left + 8).contains(&x) && (*top..top + 8).contains(&y))
    };
    let image = image::GrayImage::from_fn(320, 240, |x, y| {
        let z = (f64::from(y) - 120.3 - 0.02 * f64::from(x)) / 2.0;
        let dither = (x * 7 + y * 13) % 5;
        match is_over(x, y) {
            true => image::Luma([220]),
            false => image::Luma([10 + (180.0 * (-0.5 * z * z).exp()) as u8 + dither as u8]),
        }
    });
    let mut bytes = Vec::new();
    let mut encoder = image::codecs::jpeg::JpegEncoder::new_with_quality(&mut bytes, 95);
    encoder.encode_image(&image).unwrap();
    bytes
}

/// Frames by number: sound ones, and what USB, card and copying do to the others.
fn frames() -> (Vec<Vec<u8>>, [u32; 5]) {
    let whole = sound();
    let middle = whole.len() / 2;
    let hole = [&whole[..middle], &whole[middle + 700..]].concat();
    let cut = whole[..whole.len() * 2 / 3].to_vec();
    let zeroed = [&whole[..middle], &[0; 512], &whole[middle + 512..]].concat();
    let head = whole[..30].to_vec();
    let nothing = vec![0; 900];
    let frames = [
        whole.clone(),
        hole,
        whole.clone(),
        cut,
        zeroed,
        whole.clone(),
        head,
        nothing,
        whole,
    ];
    (frames.to_vec(), [1, 3, 4, 6, 7])
}

/// `sensor_msgs/msg/CompressedImage` as ROS 2 serialises it, little endian.
fn message(k: u32, data: &[u8]) -> Vec<u8> {
    let mut out = vec![0, 1, 0, 0];
    out.extend(1_760_000_000u32.to_le_bytes());
    out.extend((k * PERIOD_NS as u32).to_le_bytes());
    for text in ["camera\0\0", "jpeg\0\0\0\0"] {
        let length = text.trim_end_matches('\0').len() as u32 + 1;
        out.extend(length.to_le_bytes());
        out.extend(text.as_bytes());
    }
    out.extend((data.len() as u32).to_le_bytes());
    out.extend(data);
    out
}

fn bag(path: &Path, frames: &[Vec<u8>]) {
    let mut writer = mcap::Writer::new(std::fs::File::create(path).unwrap()).unwrap();
    let schema = writer
        .add_schema("sensor_msgs/msg/CompressedImage", "ros2msg", b"x")
        .unwrap();
    let channel = writer
        .add_channel(schema, "/cam/compressed", "cdr", &BTreeMap::new())
        .unwrap();
    for (k, data) in (0u32..).zip(frames) {
        let at = T0_NS + u64::from(k) * PERIOD_NS;
        let header = mcap::records::MessageHeader {
            channel_id: channel,
            sequence: 0,
            log_time: at,
            publish_time: at,
        };
        writer
            .write_to_known_channel(&header, &message(k, data))
            .unwrap();
    }
    writer.finish().unwrap();
}

/// The report holds these of so many frames for lost, and the new log has a profile of each and no point of them.
fn lost(stdout: &str, log: &Path, frames: usize, damaged: &[u32]) {
    let said: Value = serde_json::from_str(stdout).unwrap();
    let report = &said["replays"][0]["report"];
    assert_eq!(report["frames"], frames, "{report}");
    assert_eq!(report["undecodable"], damaged.len(), "{report}");
    assert_eq!(report["undecodable_frames"], serde_json::json!(damaged));
    let profiles = profiles(log);
    assert_eq!(profiles.len(), frames);
    for profile in profiles {
        let is_damaged = damaged.contains(&profile.sequence);
        assert_eq!(profile.row_px.is_empty(), is_damaged, "{profile:?}");
        assert_eq!(
            profile.fault.contains("damaged JPEG"),
            is_damaged,
            "{profile:?}"
        );
    }
}

#[test]
fn damaged_jpegs_of_a_bag_give_no_points_and_are_counted_and_named() {
    let dir = tempfile::tempdir().unwrap();
    let (log, out) = (dir.path().join("bag.mcap"), dir.path().join("out.mcap"));
    let (frames, damaged) = frames();
    bag(&log, &frames);
    let line = "replay FILE --keep-images --json --out FILE";
    let (code, stdout, stderr) = run(line, &[&log, &out]);
    assert_eq!(code, 3, "{stderr}");
    assert!(
        stderr.contains("5 of 9 frames cannot be read") && stderr.contains("1, 3, 4, 6, 7"),
        "{stderr}"
    );
    lost(&stdout, &out, frames.len(), &damaged);
    // The new log marks them itself.
    let faults = LogReader::open(&out)
        .unwrap()
        .filter_map(|m| match m.unwrap().record {
            Record::FrameInfo(info) => Some((info.sequence, info.fault)),
            _ => None,
        });
    let faults: Vec<(u32, String)> = faults.collect();
    assert_eq!(faults.len(), frames.len());
    for (sequence, fault) in faults {
        let wanted = match damaged.contains(&sequence) {
            true => "broken_jpeg",
            false => "",
        };
        assert_eq!(fault, wanted, "{sequence}");
    }
    // Import takes no images, and says of them what it sees in passing.
    let (_, stdout, stderr) = run("import --guess FILE", &[&log]);
    let said = stdout + &stderr;
    assert!(
        said.contains("images of /cam/compressed") && said.contains("5"),
        "{said}"
    );
    let calibration = dir.path().join("c.toml");
    let line = "calibrate FILE --board dots-50 --out FILE";
    let (code, _, stderr) = run(line, &[&log, &calibration]);
    assert!(code == 1, "{code}: {stderr}");
    assert!(stderr.contains("frame 3: damaged JPEG"), "{stderr}");
}

#[test]
fn damaged_jpegs_of_a_folder_are_left_out_by_name() {
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path().join("frames");
    std::fs::create_dir(&folder).unwrap();
    let (mut frames, _) = frames();
    // Without any trace of an image it is a file that is none.
    frames.pop();
    frames.pop();
    for (k, data) in frames.iter().enumerate() {
        std::fs::write(folder.join(format!("img{k}.jpg")), data).unwrap();
    }
    let (code, stdout, stderr) = run("extract FILE --json", &[&folder]);
    assert_eq!(code, 3, "{stderr}");
    for name in ["img1.jpg", "img3.jpg", "img4.jpg", "img6.jpg"] {
        let of = stderr.lines().find(|l| l.contains(name)).unwrap();
        assert!(of.contains("damaged JPEG"), "{of}");
    }
    assert!(stderr.contains("4 of 7 images are damaged"), "{stderr}");
    let said: Value = serde_json::from_str(&stdout).unwrap();
    assert_eq!(said["images"].as_array().unwrap().len(), 3, "{said}");

    let out = dir.path().join("out.mcap");
    let line = "replay FILE --rate-hz 25 --json --out FILE";
    let (code, stdout, stderr) = run(line, &[&folder, &out]);
    assert_eq!(code, 3, "{stderr}");
    assert!(
        stderr.contains("img1.jpg, img3.jpg, img4.jpg, img6.jpg"),
        "{stderr}"
    );
    lost(&stdout, &out, frames.len(), &[1, 3, 4, 6]);

    // Alone it is bad input.
    let alone = folder.join("img4.jpg");
    let (code, stdout, stderr) = run("extract FILE --csv", &[&alone]);
    assert_eq!((code, stdout.as_str()), (2, ""), "{stderr}");
    assert!(stderr.contains("no image is whole"), "{stderr}");
}

/// Frames of a camera that draws two squares over its picture; the one of number 7 has a damaged block, too.
fn drawn_over(count: u32) -> Vec<Vec<u8>> {
    let drawn = [[40, 40], [200, 40]];
    let damaged = [drawn[0], drawn[1], [120, 200]];
    let frame = |k| match k {
        7 => with_squares(&damaged),
        _ => with_squares(&drawn),
    };
    (0..count).map(frame).collect()
}

/// A recording of our own of these frames, the first of them marked.
fn recording(path: &Path, frames: &[Vec<u8>], first: Option<FrameFault>) {
    let settings = WriteSettings::offline(Some(PixelFormat::Mjpg));
    let mut log = FileRecorder::create(path, false, Head::default(), settings).unwrap();
    for (k, data) in (0u32..).zip(frames) {
        let at_ns = T0_NS + u64::from(k) * PERIOD_NS;
        let frame = Frame {
            format: PixelFormat::Mjpg,
            width_px: 320,
            height_px: 240,
            stride_bytes: 0,
            data: data.clone().into(),
            meta: FrameMeta {
                fault: first.filter(|_| k == 0),
                ..FrameMeta::at(k, at_ns)
            },
        };
        log.write(at_ns, &Entry::frame(&frame, u64::from(k)))
            .unwrap();
    }
    log.finish(&SummaryInput::clean("done")).unwrap();
}

#[test]
fn a_picture_that_is_drawn_over_is_replayed_and_said_and_damage_beside_it_is_damage() {
    let dir = tempfile::tempdir().unwrap();
    let (log, out) = (dir.path().join("bag.mcap"), dir.path().join("out.mcap"));
    let line = "replay FILE --json --out FILE";
    bag(&log, &drawn_over(7));
    let (code, stdout, stderr) = run(line, &[&log, &out]);
    assert_eq!(code, 0, "{stderr}");
    lost(&stdout, &out, 7, &[]);
    let said = stderr.matches("taken for the picture").count();
    assert!(said == 1 && stderr.contains("in 7 of 7 frames"), "{stderr}");

    let (log, out) = (dir.path().join("more.mcap"), dir.path().join("new.mcap"));
    bag(&log, &drawn_over(12));
    let (code, stdout, stderr) = run(line, &[&log, &out]);
    assert_eq!(code, 3, "{stderr}");
    lost(&stdout, &out, 12, &[7]);

    // Damage wanders: what is at another place in each frame is no picture.
    let (log, out) = (dir.path().join("bad.mcap"), dir.path().join("end.mcap"));
    let wandering = (0..8).map(|k| with_squares(&[[40 + 24 * k, 40]]));
    bag(&log, &wandering.collect::<Vec<_>>());
    let (code, stdout, stderr) = run(line, &[&log, &out]);
    assert_eq!(code, 3, "{stderr}");
    lost(&stdout, &out, 8, &[0, 1, 2, 3, 4, 5, 6, 7]);
}

#[test]
fn frames_that_the_recording_marks_as_damaged_are_a_loss_of_the_replay_and_stale_ones_are_not() {
    let dir = tempfile::tempdir().unwrap();
    let sound = [sound(), sound(), sound()];
    let replayed = |name: &str, fault: FrameFault| {
        let (log, out) = (
            dir.path().join(format!("{name}.mcap")),
            dir.path().join(format!("{name}-out.mcap")),
        );
        recording(&log, &sound, Some(fault));
        let line = "replay FILE --rig lshpi --json --out FILE";
        let (code, stdout, stderr) = run(line, &[&log, &out]);
        let said: Value = serde_json::from_str(&stdout).unwrap();
        let marked = said["replays"][0]["report"]["marked_damaged"].clone();
        assert!(code == 3, "no poses: {stderr}");
        (marked, stderr)
    };
    for fault in [
        FrameFault::BrokenJpeg,
        FrameFault::Truncated,
        FrameFault::DriverError,
    ] {
        let (marked, stderr) = replayed(&format!("{fault:?}"), fault);
        assert_eq!(marked, 1);
        assert!(
            stderr.contains("1 of 3 frames are marked as damaged"),
            "{stderr}"
        );
    }
    let (marked, stderr) = replayed("stale", FrameFault::Stale);
    assert!(marked == 0 && !stderr.contains("marked"), "{stderr}");
}

#[test]
fn doctor_calls_a_picture_that_is_drawn_over_no_damage_of_the_log() {
    let dir = tempfile::tempdir().unwrap();
    let log = |name: &str, frames: &[Vec<u8>]| {
        let path = dir.path().join(name);
        recording(&path, frames, None);
        doctor(&path).unwrap()
    };
    let sound = log("sound.mcap", &drawn_over(7));
    assert!(!sound.found("image", Grade::Warning), "{sound}");
    let words = sound.to_string();
    assert!(words.contains("in 7 of 7 images, 2 blocks"), "{words}");
    let damaged = log("damaged.mcap", &drawn_over(12)).to_string();
    assert!(
        damaged.contains("1 images are damaged") && damaged.contains("one of them: frame 7: "),
        "{damaged}"
    );
    let wandering = (0..8).map(|k| with_squares(&[[40 + 24 * k, 40]]));
    let wandering = log("wandering.mcap", &wandering.collect::<Vec<_>>());
    assert!(wandering.found("image", Grade::Error), "{wandering}");
}

#[test]
fn images_of_a_camera_that_draws_over_its_picture_are_extracted_together_and_not_alone() {
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path().join("frames");
    std::fs::create_dir(&folder).unwrap();
    for (k, data) in drawn_over(8).into_iter().enumerate() {
        std::fs::write(folder.join(format!("img{k}.jpg")), data).unwrap();
    }
    let (code, stdout, stderr) = run("extract FILE --json", &[&folder]);
    assert_eq!(code, 3, "{stderr}");
    assert!(stderr.contains("1 of 8 images are damaged"), "{stderr}");
    assert_eq!(stderr.matches("taken for the picture").count(), 1);
    let said: Value = serde_json::from_str(&stdout).unwrap();
    let images = said["images"].as_array().unwrap();
    assert_eq!(images.len(), 7);
    for image in images {
        let points = image["row_px"].as_array().unwrap().len();
        assert!(points > 250, "{points}");
    }
    let alone = folder.join("img0.jpg");
    let (code, _, stderr) = run("extract FILE", &[&alone]);
    assert!(code == 2 && stderr.contains("damaged JPEG"), "{stderr}");
}

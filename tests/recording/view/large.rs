//! Figures of a log of ten gigabytes, through the program itself: how long it takes to open, to seek, to plot, and in how much memory.

use super::{Served, field, list};
use crate::http::picture;
use std::path::Path;

/// A JPEG of a line on a noisy dark floor, with a step where a target would be.
fn line_jpeg(width_px: u32, height_px: u32) -> Vec<u8> {
    let mut state = 1u64;
    let pixels: Vec<u8> = (0..width_px * height_px)
        .map(|k| {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            let (column, row) = (k % width_px, f64::from(k / width_px));
            let middle = (width_px / 3..2 * width_px / 3).contains(&column);
            let at = f64::from(height_px) * if middle { 0.55 } else { 0.6 };
            let line = 180.0 * (-0.5 * ((row - at) / 2.0).powi(2)).exp();
            // Noise of some grey levels, as a camera at its gain has it.
            line as u8 + (state >> 60) as u8
        })
        .collect();
    let mut jpeg = Vec::new();
    image::codecs::jpeg::JpegEncoder::new_with_quality(&mut jpeg, 75)
        .encode(&pixels, width_px, height_px, image::ExtendedColorType::L8)
        .unwrap();
    jpeg
}

/// A log of so many bytes: frames at 50 per second, motion and commands of eight thrusters with each.
fn large(path: &Path, bytes: u64) -> f64 {
    use hydroline::frame::{Frame, FrameMeta, PixelFormat};
    use hydroline::log::messages::{pb, timestamp};
    use hydroline::log::{Entry, FileRecorder, Head, SummaryInput, WriteSettings};
    const BEGIN_NS: u64 = 1_700_000_000_000_000_000;
    let jpeg = bytes::Bytes::from(line_jpeg(1280, 960));
    let frames = bytes / jpeg.len() as u64;
    let head = Head {
        rig_toml: hydroline_rigs::Rig::builtin("lshpi")
            .unwrap()
            .effective_toml,
        ..Head::default()
    };
    let settings = WriteSettings::offline(Some(PixelFormat::Mjpg));
    let mut log = FileRecorder::create(path, false, head, settings).unwrap();
    for k in 0..frames {
        let at_ns = BEGIN_NS + 20_000_000 * k;
        for thruster in 0..8 {
            let command = pb::ThrusterCommand {
                timestamp: Some(timestamp(at_ns)),
                sequence: k as u32,
                thruster: format!("t{thruster}"),
                thrust_n: (k % 100) as f64,
                plan_step: 1,
                ..pb::ThrusterCommand::default()
            };
            log.write(at_ns, &Entry::command(&command)).unwrap();
        }
        let frame = Frame {
            format: PixelFormat::Mjpg,
            width_px: 1280,
            height_px: 960,
            stride_bytes: 0,
            data: jpeg.clone(),
            meta: FrameMeta::at(k as u32, at_ns),
        };
        log.write(at_ns, &Entry::frame(&frame, k)).unwrap();
        let motion = pb::VehicleMotion {
            timestamp: Some(timestamp(at_ns)),
            x_m: Some(k as f64),
            ..pb::VehicleMotion::default()
        };
        log.write(at_ns, &Entry::motion(&motion)).unwrap();
    }
    log.finish(&SummaryInput::clean("done")).unwrap();
    0.02 * frames as f64
}

/// Takes a file out of the system's cache.
fn forget(path: &Path) {
    use std::os::fd::AsRawFd;
    let file = std::fs::File::open(path).unwrap();
    file.sync_all().unwrap();
    // SAFETY: advice on an open file.
    unsafe { libc::posix_fadvise(file.as_raw_fd(), 0, 0, libc::POSIX_FADV_DONTNEED) };
}

/// Processor time of a process so far \[s\].
fn processor_s(process: u32) -> f64 {
    let stat = std::fs::read_to_string(format!("/proc/{process}/stat")).unwrap();
    let fields: Vec<&str> = stat
        .rsplit(')')
        .next()
        .unwrap()
        .split_whitespace()
        .collect();
    let ticks = |k: usize| fields[k].parse::<f64>().unwrap();
    // Of user and system, in hundredths of a second.
    (ticks(11) + ticks(12)) / 100.0
}

/// Highest resident memory of a process \[MB\].
fn peak_mb(process: u32) -> f64 {
    let status = std::fs::read_to_string(format!("/proc/{process}/status")).unwrap();
    let line = status.lines().find_map(|l| l.strip_prefix("VmHWM:"));
    line.unwrap()
        .trim()
        .trim_end_matches(" kB")
        .parse::<f64>()
        .unwrap()
        / 1e3
}

/// Figures of a log of HYDROLINE_VIEW_GB (10) in the folder HYDROLINE_VIEW_FOLDER. By hand, alone on the machine:
/// `cargo test --release --test recording view::a_log_of_ten -- --ignored --nocapture`
#[test]
#[ignore = "ten gigabytes and figures in milliseconds: alone on the machine"]
fn a_log_of_ten_gigabytes_opens_in_a_second_and_seeks_in_150_ms() {
    use std::time::Instant;
    let variable = |name: &str| std::env::var(name).ok();
    let gb: f64 = variable("HYDROLINE_VIEW_GB").map_or(10.0, |t| t.parse().unwrap());
    let folder = match variable("HYDROLINE_VIEW_FOLDER") {
        Some(folder) => tempfile::tempdir_in(folder).unwrap(),
        None => tempfile::tempdir().unwrap(),
    };
    let log = folder.path().join("large.mcap");
    let length_s = large(&log, (gb * 1e9) as u64);
    let bytes = log.metadata().unwrap().len();
    forget(&log);
    let began = Instant::now();
    let served = Served::of(&[&log]);
    let info = served.ask("/info").json();
    let open_s = began.elapsed().as_secs_f64();
    let mut seeks_ms: Vec<f64> = (0..60)
        .map(|k| {
            let t = length_s * f64::from(k * 37 % 60) / 60.0;
            let began = Instant::now();
            let (words, _) = picture(&served.ask(&format!("/frame?t={t}&stripe=1")));
            let ms = began.elapsed().as_secs_f64() * 1e3;
            assert!((words["t"].as_f64().unwrap() - t).abs() <= 0.011, "{words}");
            ms
        })
        .collect();
    seeks_ms.sort_by(f64::total_cmp);
    let x = field(&info, "/vehicle/motion", "", "x_m");
    let of: Vec<String> = (0..8)
        .map(|k| field(&info, "/thruster/command", &format!("t{k}"), "thrust_n").to_string())
        .collect();
    let seeking_s = processor_s(served.child.id());
    let began = Instant::now();
    let path = format!(
        "/series?of={x},{}&from=0&to={length_s}&pixels=1200",
        of.join(",")
    );
    let mut asked = 0;
    let whole = loop {
        asked += 1;
        let series = served.ask(&path).json();
        if series["read"] == 1.0 {
            break series;
        }
    };
    let whole_s = began.elapsed().as_secs_f64();
    let plotting_s = processor_s(served.child.id()) - seeking_s;
    let most = list(&whole, "v").into_iter().fold(0.0, f64::max);
    let memory_mb = peak_mb(served.child.id());
    println!(
        "{:.2} GB, {length_s:.0} s: open {open_s:.3} s; seek with stripe p50 {:.1} p95 {:.1} max {:.1} ms (processor {seeking_s:.1} s of 60 seeks); nine numbers of the whole \
         {whole_s:.2} s (processor {plotting_s:.1} s) in {asked} requests; peak memory {memory_mb:.0} MB",
        bytes as f64 * 1e-9,
        seeks_ms[30],
        seeks_ms[57],
        seeks_ms[59]
    );
    served.end();
    assert_eq!(
        most,
        (length_s / 0.02).round() - 1.0,
        "the last sample is there"
    );
    assert!(open_s <= 1.0 && seeks_ms[57] <= 150.0 && memory_mb <= 200.0);
}

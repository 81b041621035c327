//! Captures from a V4L2 camera and prints every event and the account: one JSON object per line.
//!
//! ```text
//! capture_probe IDENTITY FOURCC WIDTH HEIGHT FPS SECONDS [CONTROL=VALUE]...
//! capture_probe devices
//! IDENTITY: id:NAME | path:NAME | /dev/videoN
//! ```

use std::sync::Arc;
use std::time::{Duration, Instant};

use hydroline::capture::v4l::system::KernelSystem;
use hydroline::capture::{
    CaptureError, CaptureThread, Captured, OpenOptions, V4lSource, devices, frame_channel,
};
use hydroline::clock::SystemClock;
use hydroline_rigs::{
    Camera, CameraBackend, CameraControl, DeviceIdentity, ImageNoise, PixelFormat,
};
use serde_json::json;

fn camera(args: &[String]) -> Option<(Camera, f64)> {
    let identity = match args[0].split_once(':') {
        Some(("id", name)) => DeviceIdentity::ById(name.into()),
        Some(("path", name)) => DeviceIdentity::ByPath(name.into()),
        _ => DeviceIdentity::Node(args[0].clone().into()),
    };
    let pixel_format = match args[1].as_str() {
        "GREY" => PixelFormat::Grey,
        "YUYV" => PixelFormat::Yuyv,
        "MJPG" => PixelFormat::Mjpg,
        _ => return None,
    };
    let controls = args[6..]
        .iter()
        .map(|c| {
            c.split_once('=').and_then(|(n, v)| {
                Some(CameraControl {
                    name: n.into(),
                    value: v.parse().ok()?,
                })
            })
        })
        .collect::<Option<Vec<_>>>()?;
    let camera = Camera {
        backend: CameraBackend::V4l(identity),
        pixel_format,
        width_px: args[2].parse().ok()?,
        height_px: args[3].parse().ok()?,
        rate_fps: args[4].parse().ok()?,
        exposure_s: 0.0,
        fx_px: 1.0,
        fy_px: 1.0,
        cx_px: 0.0,
        cy_px: 0.0,
        controls,
        noise: ImageNoise {
            blur_px: 0.0,
            read_sd: 0.0,
            shot_gain: 0.0,
            ambient: 0.0,
        },
        seed: 0,
        frozen_after_s: 1.0,
    };
    Some((camera, args[5].parse().ok()?))
}

fn run(camera: &Camera, seconds: f64) -> Result<(), CaptureError> {
    let options = OpenOptions {
        allow_unstable_node: true,
        ..OpenOptions::default()
    };
    let source = V4lSource::open(
        camera,
        options,
        Box::new(KernelSystem::default()),
        Arc::new(SystemClock),
    )?;
    println!(
        "{}",
        json!({"described": hydroline::capture::FrameSource::describe(&source)})
    );
    let (sender, receiver) = frame_channel(64);
    let Ok(thread) = CaptureThread::spawn(Box::new(source), move |one| {
        sender.send(one);
    }) else {
        return Ok(());
    };
    let start = Instant::now();
    let (mut frames, mut faults, mut ages) = (0u64, 0u64, Vec::new());
    while start.elapsed().as_secs_f64() < seconds && !thread.is_finished() {
        match receiver.recv(Duration::from_millis(50)) {
            Some(Captured::Frame(f)) => {
                frames += 1;
                faults += u64::from(f.meta.fault.is_some());
                ages.push(
                    (f.meta.received_monotonic_ns as f64 - f.meta.driver_stamp_ns as f64) / 1e6,
                );
                if frames <= 3 || f.meta.fault.is_some() {
                    println!(
                        "{}",
                        json!({"frame": f.meta.sequence, "flags": f.meta.flags, "stamp_ns": f.meta.driver_stamp_ns,
                        "bytes": f.data.len(), "fault": f.meta.fault.map(|x| format!("{x:?}")), "at_s": start.elapsed().as_secs_f64()})
                    );
                }
            }
            Some(Captured::Event(e)) => {
                println!(
                    "{}",
                    json!({"event": e.kind, "message": e.message, "at_s": start.elapsed().as_secs_f64()})
                );
            }
            _ => {}
        }
    }
    let end = thread.stop();
    ages.sort_by(f64::total_cmp);
    let at = |p: f64| {
        ages.get((p * (ages.len().max(1) - 1) as f64) as usize)
            .copied()
            .unwrap_or(f64::NAN)
    };
    println!(
        "{}",
        json!({"delivered": frames, "marked": faults, "dropped_by_channel": receiver.dropped(),
        "age_ms": [at(0.0), at(0.5), at(0.99), at(1.0)], "counts": end.counts, "error": end.error.map(|e| e.to_string())})
    );
    Ok(())
}

fn main() -> std::process::ExitCode {
    let args: Vec<String> = std::env::args().skip(1).collect();
    if args.first().is_some_and(|a| a == "devices") {
        println!("{}", json!(devices::cameras()));
        return 0.into();
    }
    let Some((camera, seconds)) = (args.len() >= 6).then(|| camera(&args)).flatten() else {
        eprintln!(
            "capture_probe IDENTITY FOURCC WIDTH HEIGHT FPS SECONDS [CONTROL=VALUE]... | capture_probe devices"
        );
        return 2.into();
    };
    match run(&camera, seconds) {
        Ok(()) => 0.into(),
        Err(error) => {
            println!("{}", json!({"refused": error.to_string()}));
            1.into()
        }
    }
}

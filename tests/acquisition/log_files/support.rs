//! Frames, commands and small logs.

use std::path::Path;

use bytes::Bytes;
use hydroline::frame::{Frame, FrameMeta, LossBefore, StampClock, StampSource};
use hydroline::log::messages::{ThrusterCommand, timestamp};
use hydroline::log::*;
use hydroline_rigs::PixelFormat;

pub const T0_NS: u64 = 1_760_000_000_000_000_000;

/// xorshift64: seeded, so that every run sees the same "random" cuts and noise.
pub struct Rng(pub u64);

impl Rng {
    pub fn next(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0
    }
    pub fn below(&mut self, n: u64) -> u64 {
        self.next() % n.max(1)
    }
}

/// Grey noise of about 4 bits, like a dark noisy sensor.
pub fn noise(seed: u64, bytes: u32) -> Bytes {
    let mut rng = Rng(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1);
    (0..bytes)
        .map(|_| 8 + (rng.next() >> 60) as u8)
        .collect::<Vec<u8>>()
        .into()
}

pub fn frame(sequence: u32, width_px: u32, height_px: u32, data: Bytes) -> Frame {
    let mid_exposure_ns = T0_NS + u64::from(sequence) * 40_000_000;
    Frame {
        format: PixelFormat::Grey,
        width_px,
        height_px,
        stride_bytes: width_px,
        data,
        meta: FrameMeta {
            sequence,
            driver_stamp_ns: mid_exposure_ns,
            stamp_clock: StampClock::Realtime,
            stamp_source: StampSource::MidExposure,
            flags: 0,
            received_monotonic_ns: 1,
            mid_exposure_ns,
            exposure_s: 0.004,
            fault: None,
            lost_before: LossBefore::default(),
        },
    }
}

pub fn command(sequence: u32) -> ThrusterCommand {
    ThrusterCommand {
        timestamp: Some(timestamp(T0_NS + u64::from(sequence) * 40_000_000)),
        sequence,
        thruster: "surge".into(),
        thrust_n: 4.0,
        ..Default::default()
    }
}

pub fn head() -> Head {
    Head {
        rig_toml: "[rig]\nname = \"t\"\n".into(),
        ..Head::default()
    }
}

/// `n` frames of 64 x 48 with a command each; chunks of `chunk_bytes`.
pub fn small_log(path: &Path, n: u32, chunk_bytes: u64, zstd_level: u32) {
    let mut settings = WriteSettings::offline(Some(PixelFormat::Grey));
    settings.limits.chunk_bytes = chunk_bytes;
    settings.limits.chunk_age_ns = u64::MAX;
    settings.encoding.zstd_level = zstd_level;
    let mut log = FileRecorder::create(path, false, head(), settings).unwrap();
    // Commands, then their frames, as many as fill a chunk: images lie in chunks of their own.
    let (width_px, height_px) = (64, 48);
    // A frame with what is said of it, and the index of both.
    let frame_bytes = u64::from(width_px * height_px) + 512;
    let fill = (chunk_bytes / frame_bytes).clamp(1, n.into()) as u32;
    let at = |i: u32| T0_NS + u64::from(i) * 40_000_000;
    for first in (0..n).step_by(fill as usize) {
        let few = first..n.min(first + fill);
        for i in few.clone() {
            log.write(at(first), &Entry::command(&command(i))).unwrap();
        }
        for i in few {
            let pixels = noise(i.into(), width_px * height_px);
            let frame = frame(i, width_px, height_px, pixels);
            log.write(at(i), &Entry::frame(&frame, i.into())).unwrap();
        }
    }
    log.finish(&SummaryInput::clean("done")).unwrap();
}

/// Everything that can be read, and whether it ended without an error.
pub fn read_all(bytes: &[u8]) -> (Vec<LogMessage>, Vec<LogError>) {
    let reader = match LogReader::from_source(Path::new("bytes.mcap"), std::io::Cursor::new(bytes))
    {
        Ok(reader) => reader,
        Err(error) => return (Vec::new(), vec![error]),
    };
    let (mut messages, mut errors) = (Vec::new(), Vec::new());
    for item in reader {
        match item {
            Ok(m) => messages.push(m),
            Err(e) => errors.push(e),
        }
    }
    (messages, errors)
}

/// Messages by topic as Python's `mcap` counts them; `None` where it is not installed.
pub fn python_counts(path: &Path) -> Option<serde_json::Value> {
    let script = "import sys,json,collections\nfrom mcap.reader import make_reader\n\
        c=collections.Counter(ch.topic for _,ch,_ in make_reader(open(sys.argv[1],'rb'),validate_crcs=True).iter_messages())\n\
        print(json.dumps(c))";
    let out = std::process::Command::new(crate::inputs::python(&["mcap"])?)
        .args(["-c", script])
        .arg(path)
        .output()
        .unwrap();
    assert!(
        out.status.success(),
        "Python's mcap refuses {}: {}",
        path.display(),
        String::from_utf8_lossy(&out.stderr)
    );
    Some(serde_json::from_slice(&out.stdout).unwrap())
}

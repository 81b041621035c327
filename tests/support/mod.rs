//! Support for several tests of the chain: a recording of the built-in rig, assembled as the daemon does.
#![allow(dead_code, clippy::unwrap_used)]

use hydroline::capture::sim::{Scene, SimCamera};
use hydroline::capture::{CaptureError, FrameSource};
use hydroline::clock::{Clock, SystemClock};
use hydroline::log::{
    FileParts, Head, LogReader, MetadataMap, PartOpener, Record, Recorder, WriteSettings,
};
use hydroline::record::{self, Job, Parts, Report};
use hydroline::shutdown::Shutdown;
use hydroline::stripe::ExtractorConfig;
use hydroline_calib::analytic::IdealMap;
use hydroline_rigs::{Camera, Plan, Rig};
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

/// The same frame of noise again and again, which no compression makes smaller: for tests that are not about stripes.
pub struct Noise(Vec<u8>);

impl Scene for Noise {
    fn image_at(&mut self, _: f64, _: u64) -> Result<Vec<u8>, CaptureError> {
        Ok(self.0.clone())
    }
}

/// A camera of noise on the machine's clock.
pub fn noise_camera(camera: &Camera, clock: Arc<dyn Clock>) -> Box<dyn FrameSource> {
    let mut state = 1u64;
    let pixels = (0..camera.width_px * camera.height_px)
        .map(|_| {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            (state >> 56) as u8
        })
        .collect();
    Box::new(SimCamera::new(Noise(pixels), camera, clock))
}

/// A job on the built-in rig.
pub fn job(rig: &Rig, plan: Option<Plan>, length_s: f64) -> Job {
    Job {
        rig: rig.clone(),
        plan,
        length: Some(Duration::from_secs_f64(length_s)),
        ready_within: Duration::from_secs(20),
        extractor: ExtractorConfig::default(),
        calibrate: None,
        unattended: false,
    }
}

/// Starts a recorder into a file.
pub fn recorder(rig: &Rig, opener: Box<dyn PartOpener>, clock: Arc<dyn Clock>) -> Recorder {
    let head = Head {
        rig_toml: rig.effective_toml.clone(),
        calibration_toml: None,
        session: MetadataMap::new(),
        ..Head::default()
    };
    let settings = WriteSettings::live(&rig.log, Some(rig.camera.pixel_format));
    Recorder::start(opener, head, settings, clock).unwrap()
}

/// Records without thrusters from a source into a file.
pub fn record_into(path: &Path, rig: &Rig, source: Box<dyn FrameSource>, length_s: f64) -> Report {
    let clock: Arc<dyn Clock> = Arc::new(SystemClock);
    let recorder = recorder(
        rig,
        Box::new(FileParts {
            path: path.to_owned(),
            replace: false,
        }),
        clock.clone(),
    );
    let parts = Parts {
        source,
        line: None,
        recorder,
        clock,
        map: Some(Arc::new(IdealMap::of(rig))),
        live: None,
    };
    record::run(
        parts,
        &job(rig, None, length_s),
        &Shutdown::new(),
        Box::new(|_| {}),
    )
    .unwrap()
}

/// All records of a log with their kinds counted.
pub fn read(path: &Path) -> (Vec<Record>, BTreeMap<String, MetadataMap>) {
    let mut reader = LogReader::open(path).unwrap();
    let records = reader.by_ref().map(|m| m.unwrap().record).collect();
    (records, reader.metadata().clone())
}

/// The built-in rig over a bare floor, as a file: no pose shows where the vehicle is, and no plan waits for one.
pub fn bare_rig(dir: &Path) -> std::path::PathBuf {
    let text = Rig::builtin("lshpi").unwrap().effective_toml;
    let mut table: toml::Table = toml::from_str(&text).unwrap();
    assert!(table.remove("target").is_some());
    let path = dir.join("bare.toml");
    std::fs::write(&path, toml::to_string(&table).unwrap()).unwrap();
    path
}

/// The binary under test; HYDROLINE_BINARY names another one, to ask what it did.
pub fn hydroline() -> std::process::Command {
    let binary = std::env::var_os("HYDROLINE_BINARY");
    let binary = binary.unwrap_or_else(|| env!("CARGO_BIN_EXE_hydroline").into());
    let mut command = std::process::Command::new(binary);
    command
        .env("XDG_DATA_HOME", data_home())
        .env_remove("RUST_LOG")
        .stdin(std::process::Stdio::null());
    command
}

/// A data folder of its own for each run of the binary: what one remembers no other finds, and nothing of the user's.
pub fn data_home() -> std::path::PathBuf {
    static RUNS: std::sync::atomic::AtomicU32 = std::sync::atomic::AtomicU32::new(0);
    let run = RUNS.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
    Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("data-{}-{run}", std::process::id()))
}

/// One daemon at a time: several that render and fit at once on two cores are slow enough for the
/// thruster link to say, rightly, that it got no answer.
pub fn alone() -> std::sync::MutexGuard<'static, ()> {
    static ALONE: std::sync::Mutex<()> = std::sync::Mutex::new(());
    ALONE
        .lock()
        .unwrap_or_else(std::sync::PoisonError::into_inner)
}

/// A page or a figure as a strict reader takes it in, and nothing in it that must not be: numbers that are none,
/// anything run or fetched.
pub fn read_markup(text: &str) -> roxmltree::Document<'_> {
    let options = roxmltree::ParsingOptions {
        allow_dtd: true,
        ..roxmltree::ParsingOptions::default()
    };
    let document = roxmltree::Document::parse_with_options(text, options).unwrap();
    for node in document.descendants() {
        let attributes = node.attributes().map(|a| a.value());
        for written in attributes.clone().chain(node.text()) {
            assert!(!written.contains("NaN"), "{node:?}: {written}");
        }
        let style = node.text().filter(|_| node.has_tag_name("style"));
        for written in attributes.chain(style) {
            for fetched in ["http", "url(", "@import"] {
                assert!(!written.contains(fetched), "{fetched}: {written}");
            }
        }
        for fetched in ["script", "link", "img", "iframe", "object"] {
            assert!(
                !node.has_tag_name(fetched),
                "{fetched}: it must open offline"
            );
        }
    }
    document
}

/// Number of elements of a name.
pub fn elements(document: &roxmltree::Document<'_>, name: &str) -> usize {
    let named = |n: &roxmltree::Node<'_, '_>| n.tag_name().name() == name;
    document.descendants().filter(named).count()
}

//! `hydroline view`: the page on a finished log, asked as a browser asks and held against the log itself.

use crate::http::{Answer, ask, picture};
use crate::support::hydroline;
use hydroline::log::messages::unix_ns;
use hydroline::log::{LogReader, Record};
use serde_json::Value;
use std::io::{BufRead, BufReader, Read};
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStderr, Stdio};

const PLAN: &str = "name = \"short\"\n[[step]]\nfor_s = 0.4\nwrench = { surge_n = 8.0 }\n";

/// A simulated recording with images.
fn simulated(folder: &Path) -> PathBuf {
    let plan = folder.join("short.toml");
    std::fs::write(&plan, PLAN).unwrap();
    let log = folder.join("sim.mcap");
    let made = hydroline()
        .args(["simulate", "--rig", "lshpi", "--seed", "7", "--plan"])
        .arg(plan)
        .arg("--out")
        .arg(&log)
        .output()
        .unwrap();
    assert!(made.status.success());
    log
}

/// A page that is served; ended with Ctrl-C.
struct Served {
    child: Child,
    address: SocketAddr,
    stderr: Option<ChildStderr>,
}

impl Served {
    fn of(logs: &[&Path]) -> Self {
        let mut child = hydroline()
            .arg("view")
            .args(logs)
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut line = String::new();
        let stdout = child.stdout.as_mut().unwrap();
        BufReader::new(stdout).read_line(&mut line).unwrap();
        let address = line.trim().strip_prefix("http://").unwrap();
        let address = address.trim_end_matches('/').parse().unwrap();
        let stderr = child.stderr.take();
        Self {
            child,
            address,
            stderr,
        }
    }

    fn ask(&self, path: &str) -> Answer {
        let answer = ask(self.address, &format!("GET {path}"), "");
        assert_eq!(answer.status, 200, "{path}: {}", answer.text());
        answer
    }

    /// Ctrl-C; what was said on stderr.
    fn end(mut self) -> String {
        // SAFETY: a signal to a child of this test that was not waited for yet.
        unsafe { libc::kill(self.child.id() as i32, libc::SIGINT) };
        let status = self.child.wait().unwrap();
        assert_eq!(status.code(), Some(0), "Ctrl-C is how it ends");
        let mut said = String::new();
        let mut stderr = self.stderr.take().unwrap();
        stderr.read_to_string(&mut said).unwrap();
        said
    }
}

/// Number of a field in the first log.
fn field(info: &Value, topic: &str, key: &str, path: &str) -> u64 {
    let fields = info["logs"][0]["fields"].as_array().unwrap();
    let found = fields
        .iter()
        .find(|f| f["topic"] == topic && f["key"] == key && f["path"] == path);
    found.unwrap()["number"].as_u64().unwrap()
}

fn list(series: &Value, name: &str) -> Vec<f64> {
    let all = series["series"][0][name].as_array().unwrap();
    all.iter().map(|v| v.as_f64().unwrap()).collect()
}

#[test]
fn what_the_page_shows_is_what_stands_in_the_log() {
    let folder = tempfile::tempdir().unwrap();
    let log = simulated(folder.path());
    let (mut truth, mut frames_ns, mut plan_ns) = (Vec::new(), Vec::new(), u64::MAX);
    for message in LogReader::open(&log).unwrap() {
        let message = message.unwrap();
        match message.record {
            Record::Truth(m) => truth.push((unix_ns(&m.timestamp.unwrap()), m.x_m.unwrap())),
            Record::Frame(frame) => frames_ns.push(frame.meta.mid_exposure_ns),
            Record::Command(c) if c.plan_step > 0 => {
                plan_ns = plan_ns.min(unix_ns(&c.timestamp.unwrap()));
            }
            _ => {}
        }
    }
    let served = Served::of(&[&log]);
    let info = served.ask("/info").json();
    let of = &info["logs"][0];
    assert_eq!(of["zero"], "start of the plan");
    assert_eq!(of["images"][0]["messages"], frames_ns.len());
    assert!(of["about"].as_str().unwrap().contains("plan short"), "{of}");
    let x = field(&info, "/sim/truth", "", "x_m");
    let series = served
        .ask(&format!("/series?of={x}&from=-9&to=9&pixels=4000"))
        .json();
    assert_eq!(series["read"], 1.0);
    let values: Vec<f64> = truth.iter().map(|(_, x)| *x).collect();
    assert_eq!(list(&series, "v"), values);
    for ((ns, _), t) in truth.iter().zip(list(&series, "t")) {
        let own = (*ns as i64 - plan_ns as i64) as f64 * 1e-9;
        assert!((own - t).abs() < 1e-6, "{own} {t}");
    }
    // The fifth frame by its time, with its stripe found in it.
    let t = (frames_ns[4] as i64 - plan_ns as i64) as f64 * 1e-9;
    let (words, jpeg) = picture(&served.ask(&format!("/frame?t={t}&stripe=1")));
    assert_eq!(
        words["at"],
        (frames_ns[4] as i64 - plan_ns as i64).to_string()
    );
    assert_eq!(jpeg[..2], [0xff, 0xd8]);
    assert!(words["overlay"]["stripe_px"].as_array().unwrap().len() > 100);
    assert!(words["overlay"]["profile_m"].as_array().unwrap().len() > 100);
    let png = served.ask(&format!("/picture?t={t}"));
    assert_eq!(png.body[1..4], *b"PNG");
    let table = served.ask(&format!("/table?of={x}&from=-9&to=9")).text();
    assert_eq!(table.lines().count(), truth.len() + 1);
    assert!(
        table
            .lines()
            .nth(1)
            .unwrap()
            .ends_with(&format!(",{:?}", truth[0].1))
    );
    served.ask("/events");
    assert!(served.ask("/").text().contains("hydroline view"));
    served.end();
}

#[test]
fn the_guard_of_the_live_page_stands_before_this_one() {
    let folder = tempfile::tempdir().unwrap();
    let log = simulated(folder.path());
    let served = Served::of(&[&log, &log]);
    assert_eq!(
        served.ask("/info").json()["logs"].as_array().unwrap().len(),
        2
    );
    let address = served.address;
    let status = |line: &str, headers: &str| ask(address, line, headers).status;
    for path in [
        "/",
        "/info",
        "/series?of=0&from=0&to=1",
        "/frame?t=0",
        "/table?of=0&from=0&to=1",
    ] {
        let line = format!("GET http://evil.example{path}");
        assert_eq!(status(&line, ""), 421, "{path}");
        let line = format!("GET {path}");
        assert_eq!(
            status(&line, "Origin: http://evil.example\r\n"),
            403,
            "{path}"
        );
        assert_eq!(
            status(&line, "Sec-Fetch-Site: cross-site\r\n"),
            403,
            "{path}"
        );
        assert_eq!(status(&format!("POST {path}"), ""), 405, "{path}");
    }
    assert_eq!(status("GET /stop", ""), 404);
    assert_eq!(status("GET /../etc/passwd", ""), 404);
    let page = served.ask("/");
    assert!(
        page.head
            .contains("content-security-policy: default-src 'none'; script-src 'nonce-")
    );
    served.end();
}

#[test]
fn a_log_that_was_cut_is_said_and_shown() {
    let folder = tempfile::tempdir().unwrap();
    let log = simulated(folder.path());
    let bytes = std::fs::read(&log).unwrap();
    let cut = folder.path().join("cut.mcap");
    std::fs::write(&cut, &bytes[..bytes.len() * 9 / 10]).unwrap();
    let served = Served::of(&[&cut]);
    served.ask("/frame?t=0");
    let said = served.end();
    assert!(
        said.contains("everything before its end is shown"),
        "{said}"
    );
}

/// A JPEG of noise: what no compression makes smaller.
fn noise_jpeg(width_px: u32, height_px: u32) -> Vec<u8> {
    let mut state = 1u64;
    let pixels: Vec<u8> = (0..width_px * height_px)
        .map(|_| {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            (state >> 56) as u8
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
    let jpeg = bytes::Bytes::from(noise_jpeg(1280, 960));
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
    let most = list(&whole, "v").into_iter().fold(0.0, f64::max);
    let memory_mb = peak_mb(served.child.id());
    println!(
        "{:.2} GB, {length_s:.0} s: open {open_s:.3} s; seek with stripe p50 {:.1} p95 {:.1} max {:.1} ms; nine numbers of the whole \
         {whole_s:.2} s in {asked} requests; peak memory {memory_mb:.0} MB",
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

//! `hydroline view`: the page on a finished log, asked as a browser asks and held against the log itself.

mod browser;
mod large;

use crate::http::{Answer, ask, picture};
use crate::support::hydroline;
use hydroline::log::messages::unix_ns;
use hydroline::log::{LogReader, Record};
use serde_json::Value;
use std::io::{BufRead, BufReader, Read};
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStderr, Stdio};

/// A simulated recording with images.
fn simulated(folder: &Path, length_s: f64) -> PathBuf {
    let plan = folder.join("short.toml");
    let step = format!("for_s = {length_s:?}\nwrench = {{ surge_n = 8.0 }}\n");
    std::fs::write(&plan, format!("name = \"short\"\n[[step]]\n{step}")).unwrap();
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
    let log = simulated(folder.path(), 0.4);
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
    // The rig's model under the commands that were sent is the simulated vehicle.
    let predicted = field(&info, "predicted", "", "x_m");
    let series = served
        .ask(&format!("/series?of={predicted}&from=-9&to=9&pixels=4000"))
        .json();
    assert_eq!(series["read"], 1.0);
    let model: Vec<(f64, f64)> = list(&series, "t")
        .into_iter()
        .zip(list(&series, "v"))
        .collect();
    for (ns, x) in &truth {
        let t = (*ns as i64 - plan_ns as i64) as f64 * 1e-9;
        let after = model.iter().position(|(own, _)| *own >= t - 1e-9).unwrap();
        let (t1, b) = model[after];
        let (t0, a) = model[after.saturating_sub(1)];
        let part = if t1 > t0 { (t - t0) / (t1 - t0) } else { 1.0 };
        assert!((a + part * (b - a) - x).abs() < 1e-4, "{x} at {t}: {a} {b}");
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
    let log = simulated(folder.path(), 0.4);
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
    let log = simulated(folder.path(), 0.4);
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

//! A recording of the built-in rig with one still picture, a simulated controller, and a server beside it.

use crate::http::Viewer;
use hydroline::capture::sim::{Scene, SimCamera};
use hydroline::capture::{CaptureCounts, CaptureError, Captured, FrameSource, SourceDescription};
use hydroline::clock::{Clock, SystemClock};
use hydroline::live::{Feed, Server};
use hydroline::log::FileParts;
use hydroline::record::{self, Parts, Report};
use hydroline::shutdown::{Shutdown, StopReason};
use hydroline::thread_class::step_back;
use hydroline::thruster::controller::{
    ControllerConfig, ControllerEvent, PtyController, SimController,
};
use hydroline::thruster::ports::Roots;
use hydroline::thruster::service::serial_opener;
use hydroline_calib::analytic::IdealMap;
use hydroline_rigs::{LinkPort, Plan, Rig};
use hydroline_sim::{Pose6, Renderer};
use std::io::Write;
use std::net::{SocketAddr, TcpStream};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// One rendered frame again and again: a real stripe, no time to render.
struct Still(Vec<u8>);

impl Scene for Still {
    fn image_at(&mut self, _: f64, _: u64) -> Result<Vec<u8>, CaptureError> {
        Ok(self.0.clone())
    }
}

/// Notes how long the daemon stays away between two calls.
struct Timed {
    inner: SimCamera<Still>,
    returned: Option<Instant>,
    away: Arc<Mutex<Vec<Duration>>>,
}

impl FrameSource for Timed {
    fn describe(&self) -> SourceDescription {
        self.inner.describe()
    }
    fn counts(&self) -> CaptureCounts {
        self.inner.counts()
    }
    fn finish(&mut self) {
        self.inner.finish();
    }
    fn next(&mut self, wait: Duration) -> Result<Captured, CaptureError> {
        if let Some(returned) = self.returned.take() {
            self.away.lock().unwrap().push(returned.elapsed());
        }
        let captured = self.inner.next(wait)?;
        if matches!(captured, Captured::Frame(_)) {
            self.returned = Some(Instant::now());
        }
        Ok(captured)
    }
}

/// Recording with or without a page.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum State {
    Viewed,
    Unseen,
}

/// A recording that runs on a thread of its own.
pub struct Recording {
    server: Option<Server>,
    outputs: Arc<Mutex<Vec<ControllerEvent>>>,
    away: Arc<Mutex<Vec<Duration>>>,
    neutral_us: f64,
    shutdown: Shutdown,
    thread: JoinHandle<Report>,
    _ends: Ends,
    _controller: PtyController,
    _dir: tempfile::TempDir,
}

/// A recording that has ended: its report, the controller's outputs, and the times away from the camera.
pub struct Ended {
    pub report: Report,
    outputs: Vec<ControllerEvent>,
    away: Vec<Duration>,
    neutral_us: f64,
}

/// Ends the recording of a test that fails: going on, it would look for its line under a name that is another test's by then.
struct Ends(Shutdown);

impl Drop for Ends {
    fn drop(&mut self) {
        self.0.raise(StopReason::Finished);
    }
}

impl Recording {
    /// Starts one: surge with 4 N for most of `length_s`.
    pub fn start(state: State, length_s: f64) -> Self {
        let dir = tempfile::tempdir().unwrap();
        let rig = Rig::builtin("lshpi").unwrap();
        let clock: Arc<dyn Clock> = Arc::new(SystemClock);
        let step = format!(
            "[[step]]\nfor_s = {}\nwrench = {{ surge_n = 4.0 }}\n",
            length_s - 1.5
        );
        let plan = Plan::from_toml(&format!("name = \"live\"\n\n{step}"), "live.toml").unwrap();
        let mut job = crate::support::job(&rig, Some(plan), length_s);
        // The picture stands still: no limit may end the run.
        job.rig.limits.x_m = [-100.0, 100.0];
        let [x_m, y_m, z_m, phi_rad, theta_rad, psi_rad] = rig.tank.start_pose;
        let pose = Pose6 {
            x_m,
            y_m,
            z_m,
            phi_rad,
            theta_rad,
            psi_rad,
        };
        let image = Renderer::new(&rig).unwrap().render(&pose, 0).0;
        let away = Arc::new(Mutex::new(Vec::new()));
        let source = Box::new(Timed {
            inner: SimCamera::new(Still(image), &rig.camera, clock.clone()),
            returned: None,
            away: away.clone(),
        });
        let outputs = Arc::new(Mutex::new(Vec::new()));
        let seen = outputs.clone();
        let controller = PtyController::start(
            SimController::new(ControllerConfig::for_rig(&rig.thrusters)),
            None,
            Box::new(move |event| seen.lock().unwrap().push(event)),
        )
        .unwrap();
        let mut set = rig.thrusters.clone();
        set.link.port = LinkPort::Node(controller.path().unwrap().to_owned());
        let line = serial_opener(&set, Roots::default(), clock.clone());
        let path = dir.path().join("live.mcap");
        let opener = Box::new(FileParts {
            path: path.clone(),
            replace: false,
        });
        let (server, live) = match state {
            State::Unseen => (None, None),
            State::Viewed => {
                let feed = Arc::new(Feed::new(true));
                let address = "127.0.0.1:0".parse().unwrap();
                let server = Server::start(address, None, feed.clone()).unwrap();
                let live = hydroline::live_run::Live {
                    feed,
                    title: "test".to_owned(),
                    log: path,
                };
                (Some(server), Some(live))
            }
        };
        let neutral_us = rig.thrusters.neutral_us;
        let parts = Parts {
            source,
            line: Some(line),
            recorder: crate::support::recorder(&rig, opener, clock.clone()),
            clock,
            map: Some(Arc::new(IdealMap::of(&rig))),
            live,
        };
        let shutdown = Shutdown::new();
        let raised = shutdown.clone();
        let thread = std::thread::spawn(move || {
            record::run(parts, &job, &raised, Box::new(|_| {})).unwrap()
        });
        Self {
            server,
            outputs,
            away,
            neutral_us,
            _ends: Ends(shutdown.clone()),
            shutdown,
            thread,
            _controller: controller,
            _dir: dir,
        }
    }

    pub fn address(&self) -> SocketAddr {
        self.server.as_ref().unwrap().address()
    }

    /// Ends it before its time.
    pub fn end(&self) {
        self.shutdown.raise(StopReason::Finished);
    }

    pub fn now_ns(&self) -> u64 {
        SystemClock.monotonic_ns()
    }

    /// From when on every output of the controller was at neutral, since `ns`; `None` while one is not.
    pub fn neutral_since(&self, ns: u64) -> Option<u64> {
        let outputs = self.outputs.lock().unwrap();
        let mut last: [Option<&ControllerEvent>; 24] = [None; 24];
        for event in outputs.iter() {
            // Repeated neutrals change nothing.
            let slot = &mut last[usize::from(event.channel)];
            if slot.is_none_or(|before| before.pulse_us != event.pulse_us) {
                *slot = Some(event);
            }
        }
        let last = last.iter().flatten();
        last.map(|e| (e.pulse_us == self.neutral_us).then_some(e.host_monotonic_ns.max(ns)))
            .try_fold(ns, |all, one| Some(all.max(one?)))
    }
}

/// Waits for the end.
pub fn finish(running: Recording) -> Ended {
    let report = running.thread.join().unwrap();
    let outputs = running.outputs.lock().unwrap().clone();
    let away = running.away.lock().unwrap().clone();
    Ended {
        report,
        outputs,
        away,
        neutral_us: running.neutral_us,
    }
}

impl Ended {
    pub fn lost(&self) -> u64 {
        self.report.capture.lost.total() + self.report.log.counts.frames_dropped
    }

    /// Pulses other than neutral after `ns`.
    pub fn pushes_after(&self, ns: u64) -> Vec<&ControllerEvent> {
        let later = self.outputs.iter().filter(|e| e.host_monotonic_ns > ns);
        later.filter(|e| e.pulse_us != self.neutral_us).collect()
    }

    /// A quantile of how long the capture thread stayed away from its camera \[ms\].
    pub fn away_ms(&self, q: f64) -> f64 {
        let mut sorted = self.away.clone();
        sorted.sort();
        sorted[((sorted.len() - 1) as f64 * q) as usize].as_secs_f64() * 1e3
    }
}

/// Numbers of states and pictures that the viewers got.
#[derive(Debug, Default)]
pub struct Seen {
    pub states: u64,
    pub pictures: u64,
}

/// Eight viewers, one that asks and never reads, and one that sends garbage.
pub struct Crowd {
    stop: Arc<AtomicBool>,
    viewers: Vec<JoinHandle<Seen>>,
    others: Vec<JoinHandle<()>>,
}

impl Crowd {
    pub fn gather(address: SocketAddr) -> Self {
        let stop = Arc::new(AtomicBool::new(false));
        let viewers = (0..8).map(|_| viewer(address, stop.clone())).collect();
        let others = vec![deaf(address, stop.clone()), garbler(address, stop.clone())];
        Self {
            stop,
            viewers,
            others,
        }
    }

    pub fn leave(self) -> Seen {
        self.stop.store(true, Ordering::Release);
        for other in self.others {
            other.join().unwrap();
        }
        let mut all = Seen::default();
        for viewer in self.viewers {
            let seen = viewer.join().unwrap();
            all.states += seen.states;
            all.pictures += seen.pictures;
        }
        all
    }
}

/// As the page does: the newest state, the newest picture, for ever.
fn viewer(address: SocketAddr, stop: Arc<AtomicBool>) -> JoinHandle<Seen> {
    std::thread::spawn(move || {
        // Viewers sit at other computers: what they compute must not take the recording's time.
        step_back(19);
        let mut connection = Viewer::new(address);
        let mut seen = Seen::default();
        let (mut state, mut picture) = (0u64, 0u64);
        while !stop.load(Ordering::Acquire) {
            let Some(answer) = connection.try_ask(&format!("GET /state?after={state}"), "") else {
                return seen;
            };
            if answer.status == 200 {
                state = answer.json()["number"].as_u64().unwrap();
                seen.states += 1;
            }
            let Some(answer) = connection.try_ask(&format!("GET /picture?after={picture}"), "")
            else {
                return seen;
            };
            let number = answer
                .head
                .lines()
                .find_map(|l| l.strip_prefix("x-number: "));
            if let Some(number) = number {
                picture = number.parse().unwrap();
                seen.pictures += 1;
            }
        }
        seen
    })
}

/// Asks for more than a socket holds and takes none of it.
fn deaf(address: SocketAddr, stop: Arc<AtomicBool>) -> JoinHandle<()> {
    std::thread::spawn(move || {
        let request = format!("GET / HTTP/1.1\r\nHost: {address}\r\n\r\n").repeat(500);
        let mut held = TcpStream::connect(address).unwrap();
        held.set_write_timeout(Some(Duration::from_secs(1)))
            .unwrap();
        let _ = held.write_all(request.as_bytes());
        while !stop.load(Ordering::Acquire) {
            std::thread::sleep(Duration::from_millis(50));
        }
    })
}

fn garbler(address: SocketAddr, stop: Arc<AtomicBool>) -> JoinHandle<()> {
    std::thread::spawn(move || {
        let mut state = 7u64;
        while !stop.load(Ordering::Acquire) {
            let bytes: Vec<u8> = (0..4096)
                .map(|_| {
                    state = state
                        .wrapping_mul(6_364_136_223_846_793_005)
                        .wrapping_add(1_442_695_040_888_963_407);
                    (state >> 56) as u8
                })
                .collect();
            if let Ok(mut stream) = TcpStream::connect(address) {
                let _ = stream.write_all(b"POST /stop HTTP/1.1\r\nHost: 127.0.0.1\r\n");
                let _ = stream.write_all(&bytes);
            }
            std::thread::sleep(Duration::from_millis(20));
        }
    })
}

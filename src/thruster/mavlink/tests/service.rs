//! The service on a real socket and a real pseudo-terminal, with the simulated autopilot at the far end.

use super::law;
use crate::controller::open_pty;
use crate::mavlink::Content;
use crate::mavlink::autopilot::{AutopilotConfig, SimAutopilot};
use crate::ports::Roots;
use crate::record::LinkRecord;
use crate::safety::State;
use crate::scheduler::PlannedLoad;
use crate::service::{
    PlanState, ServiceConfig, ThrusterService, serial_opener, wait_for_recording,
};
use hydroline_core::clock::{Clock, SystemClock};
use hydroline_rigs::{
    Link, LinkKind, LinkPort, Mavlink, RecordOn, ThrustCurve, Thruster, ThrusterSet,
};
use std::io::{Read, Write};
use std::net::UdpSocket;
use std::os::fd::AsRawFd;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::{JoinHandle, sleep, spawn};
use std::time::{Duration, Instant};

fn set(port: LinkPort) -> ThrusterSet {
    let thruster = |name: &str, channel| Thruster {
        name: name.into(),
        channel,
        position_m: [0.0; 3],
        direction: [1.0, 0.0, 0.0],
        curve: ThrustCurve {
            points: vec![(1100.0, -40.0), (1900.0, 40.0)],
        },
    };
    ThrusterSet {
        link: Link {
            kind: LinkKind::Mavlink,
            port,
            baud: 115_200,
            rate_hz: 50.0,
            deadline_s: 1.0,
            timeout_s: 3.0,
            mavlink: Some(Mavlink {
                record_on: RecordOn::Arming,
                ..Mavlink::default()
            }),
        },
        thrusters: vec![thruster("port", 0), thruster("starboard", 5)],
        neutral_us: 1500.0,
        min_us: 1100.0,
        max_us: 1900.0,
        max_slew_us_per_s: 50_000.0,
        scale_sd: None,
    }
}

/// The far end of a line: bytes there now, and bytes out.
trait FarEnd: Send + 'static {
    fn take(&mut self) -> Vec<u8>;
    fn put(&mut self, bytes: &[u8]);
}

struct Socket(UdpSocket);

impl FarEnd for Socket {
    fn take(&mut self) -> Vec<u8> {
        let mut buffer = [0; 512];
        let got = self.0.recv(&mut buffer).unwrap_or(0);
        buffer[..got].to_vec()
    }
    fn put(&mut self, bytes: &[u8]) {
        // Nobody may listen yet.
        let _ = self.0.send(bytes);
    }
}

struct Master(std::fs::File);

impl FarEnd for Master {
    fn take(&mut self) -> Vec<u8> {
        let mut buffer = [0; 512];
        let got = self.0.read(&mut buffer).unwrap_or(0);
        buffer[..got].to_vec()
    }
    fn put(&mut self, bytes: &[u8]) {
        let _ = self.0.write_all(bytes);
    }
}

struct Far {
    autopilot: Arc<Mutex<SimAutopilot>>,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Far {
    fn start(mut end: impl FarEnd) -> Self {
        let config = AutopilotConfig {
            armed: true,
            // A pseudo-terminal has no wire: without it an answer would be here before the request has left the UART.
            to_autopilot_ns: 10_000_000,
            to_host_ns: 10_000_000,
            ..AutopilotConfig::default()
        };
        let autopilot = Arc::new(Mutex::new(SimAutopilot::new(config, Box::new(law))));
        let stop = Arc::new(AtomicBool::new(false));
        let (sim, stopped) = (autopilot.clone(), stop.clone());
        let thread = spawn(move || {
            let mut out = Vec::new();
            while !stopped.load(Ordering::Relaxed) {
                let bytes = end.take();
                let now_ns = SystemClock.monotonic_ns();
                let mut sim = sim.lock().unwrap();
                if !bytes.is_empty() {
                    sim.receive(now_ns, &bytes);
                }
                sim.poll(now_ns, &mut out);
                drop(sim);
                out.drain(..).for_each(|bytes| end.put(&bytes));
                sleep(Duration::from_millis(1));
            }
        });
        Self {
            autopilot,
            stop,
            thread: Some(thread),
        }
    }
}

impl Drop for Far {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

fn until(what: &str, mut is_so: impl FnMut() -> bool) {
    let end = Instant::now() + Duration::from_secs(20);
    while !is_so() {
        assert!(Instant::now() < end, "no {what}");
        sleep(Duration::from_millis(5));
    }
}

/// Follows; refuses a plan; sends nothing that moves; ends with the disarming.
fn followed(port: LinkPort, far: &Far) {
    let clock: Arc<dyn Clock> = Arc::new(SystemClock);
    let set = set(port);
    let mut opener = serial_opener(&set, Roots::default(), clock.clone());
    assert!(
        wait_for_recording(&set, &mut opener, &|| false, &mut |_| {}),
        "armed"
    );

    let records = Arc::new(Mutex::new(Vec::new()));
    let taken = records.clone();
    let config = ServiceConfig {
        set: set.clone(),
        resume_after_loss: false,
    };
    let sink = Box::new(move |r| taken.lock().unwrap().push(r));
    let service = ThrusterService::start(config, opener, clock, sink).unwrap();
    until("sets", || service.stats().echoed > 20);
    assert_ne!(service.state(), State::Lost);
    let load = |_: f64| PlannedLoad {
        thrust_n: vec![1.0, 1.0],
        pulses_us: None,
        plan_step: 1,
    };
    service
        .run_plan(SystemClock.monotonic_ns(), 1.0, Box::new(load))
        .unwrap();
    until("refusal", || {
        matches!(service.plan_state(), PlanState::Refused(_))
    });
    service.tell("recording".into()).unwrap();
    until("text", || !far.autopilot.lock().unwrap().texts().is_empty());
    far.autopilot.lock().unwrap().config().armed = false;
    let ended = LinkRecord::Recording { on: false };
    until("end", || records.lock().unwrap().contains(&ended));
    let stats = service.shutdown();
    assert!(!stats.neutral_open && stats.losses == 0, "{stats:?}");

    let records = records.lock().unwrap();
    let commands: Vec<_> = records
        .iter()
        .filter_map(|r| match r {
            LinkRecord::Command(c) => Some(c),
            _ => None,
        })
        .collect();
    assert!(
        commands.iter().all(|c| c.cause == "autopilot"),
        "nothing of our own"
    );
    let bollard = |pulse_us: f64| (pulse_us - 1500.0) * 0.1;
    assert!(
        commands
            .iter()
            .all(|c| (c.thrust_n - bollard(c.pulse_us)).abs() < 1e-9)
    );
    assert!(
        commands
            .iter()
            .any(|c| &*c.thruster == "port" && c.pulse_us > 1500.0)
    );
    let has = |what: fn(&Content) -> bool| {
        records
            .iter()
            .any(|r| matches!(r, LinkRecord::Heard(h) if what(&h.what)))
    };
    assert!(has(
        |w| matches!(w, Content::Motion(m) if m.rates_radps.is_some())
    ));
    assert!(has(
        |w| matches!(w, Content::Motion(m) if m.depth_m.is_some())
    ));
    assert!(has(
        |w| matches!(w, Content::State(s) if s.armed == Some(true))
    ));
    assert!(
        records
            .iter()
            .any(|r| matches!(r, LinkRecord::Clock(c) if c.offset_sd_us > 0.0))
    );
}

#[test]
fn an_autopilot_is_followed_over_udp() {
    let free = UdpSocket::bind("127.0.0.1:0").unwrap();
    let address = free.local_addr().unwrap();
    drop(free);
    let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
    socket.connect(address).unwrap();
    socket.set_nonblocking(true).unwrap();
    let far = Far::start(Socket(socket));
    followed(LinkPort::Udp(address), &far);
}

#[test]
fn an_autopilot_is_followed_over_a_serial_line() {
    let (master, _slave, node) = open_pty().unwrap();
    // SAFETY: fcntl on an open descriptor.
    unsafe { libc::fcntl(master.as_raw_fd(), libc::F_SETFL, libc::O_NONBLOCK) };
    let far = Far::start(Master(master));
    followed(LinkPort::Node(node), &far);
}

//! The service's core on a manual clock and the in-memory controller: every guarantee about neutral, both protocols.

mod line;
mod neutral;
mod obeying;
mod plan;
mod wild;

use super::error::check;
use super::*;
use crate::controller::{ControllerConfig, ControllerEvent, Faults, OutputCause};
use crate::loopback::Loopback;
use crate::record::{CommandRecord, EchoRecord};
use crate::scheduler::PlannedLoad;
use crate::transport::Sent;
use hydroline_core::clock::ManualClock;
use hydroline_core::event::Event;
use hydroline_rigs::{Link, LinkKind, LinkPort, ThrustCurve, Thruster};
use std::sync::atomic::AtomicU32;
use std::time::Duration;

const MS: u64 = 1_000_000;
const KINDS: [LinkKind; 2] = [LinkKind::Maestro, LinkKind::Stamped];

fn set(kind: LinkKind) -> ThrusterSet {
    let curve = ThrustCurve {
        points: vec![
            (1100.0, -40.0),
            (1475.0, 0.0),
            (1525.0, 0.0),
            (1900.0, 50.0),
        ],
    };
    let thruster = |name: &str, channel| Thruster {
        name: name.into(),
        channel,
        position_m: [0.0; 3],
        direction: [1.0, 0.0, 0.0],
        curve: curve.clone(),
    };
    ThrusterSet {
        link: Link {
            kind,
            port: LinkPort::Sim,
            baud: 115_200,
            rate_hz: 50.0,
            deadline_s: 0.03,
            timeout_s: 0.3,
            mavlink: None,
        },
        thrusters: vec![thruster("port", 0), thruster("starboard", 3)],
        neutral_us: 1500.0,
        min_us: 1100.0,
        max_us: 1900.0,
        max_slew_us_per_s: 20_000.0,
        scale_sd: None,
    }
}

/// Counts the lines that are open.
struct Held(Loopback, Arc<AtomicU32>);

impl Held {
    fn new(line: Loopback, alive: &Arc<AtomicU32>) -> Self {
        alive.fetch_add(1, Ordering::Relaxed);
        Self(line, alive.clone())
    }
}

impl Drop for Held {
    fn drop(&mut self) {
        self.1.fetch_sub(1, Ordering::Relaxed);
    }
}

impl Transport for Held {
    fn now_ns(&self) -> u64 {
        self.0.now_ns()
    }
    fn write(&mut self, bytes: &[u8], timeout: Duration) -> std::io::Result<Sent> {
        self.0.write(bytes, timeout)
    }
    fn read(&mut self, buffer: &mut [u8], timeout: Duration) -> std::io::Result<usize> {
        self.0.read(buffer, timeout)
    }
    fn unsent_bytes(&mut self) -> Option<usize> {
        self.0.unsent_bytes()
    }
}

struct Bench {
    core: Core,
    cable: Loopback,
    clock: Arc<ManualClock>,
    orders: SyncSender<Order>,
    shared: Arc<Shared>,
    records: Arc<Mutex<Vec<LinkRecord>>>,
    opens: Arc<AtomicU32>,
}

fn bench(kind: LinkKind, change: impl FnOnce(&mut ServiceConfig)) -> Bench {
    bench_of(kind, change, |_| {})
}

fn bench_of(
    kind: LinkKind,
    change: impl FnOnce(&mut ServiceConfig),
    controller: impl FnOnce(&mut ControllerConfig),
) -> Bench {
    let clock = Arc::new(ManualClock::new(1_000_000_000, 1_700_000_000_000_000_000));
    let mut config = ServiceConfig {
        set: set(kind),
        resume_after_loss: false,
    };
    change(&mut config);
    let mut simulated = ControllerConfig::for_rig(&config.set);
    controller(&mut simulated);
    let cable = Loopback::new(simulated, clock.clone());
    let opens = Arc::new(AtomicU32::new(0));
    let (line, counted, alive) = (cable.clone(), opens.clone(), Arc::new(AtomicU32::new(0)));
    let opener: Opener = Box::new(move || {
        counted.fetch_add(1, Ordering::Relaxed);
        // An open descriptor would make the replugged node another one (ttyUSB0 -> ttyUSB1).
        assert_eq!(
            alive.load(Ordering::Relaxed),
            0,
            "the old line must be closed before the new one is looked for"
        );
        let transport = line.open().map_err(|e| OpenError::Other {
            path: "loopback".into(),
            reason: e.to_string(),
        })?;
        let transport = Held::new(transport, &alive);
        Ok(Opened {
            transport: Box::new(transport),
            name: "loopback".into(),
            low_latency: None,
        })
    });
    let records = Arc::new(Mutex::new(Vec::new()));
    let taken = records.clone();
    let sink: Sink = Box::new(move |r| taken.lock().unwrap().push(r));
    let (orders, inbox) = sync_channel(64);
    let shared = Arc::new(Shared::default());
    let protocol = protocol_for(&config.set);
    let core = Core::new(
        config,
        protocol,
        opener,
        clock.clone(),
        sink,
        inbox,
        shared.clone(),
    );
    Bench {
        core,
        cable,
        clock,
        orders,
        shared,
        records,
        opens,
    }
}

impl Bench {
    fn now(&self) -> u64 {
        self.clock.monotonic_ns()
    }

    fn run_ms(&mut self, ms: u64) {
        let end_ns = self.now() + ms * MS;
        while self.now() < end_ns {
            if self.core.step() == Flow::End {
                return;
            }
        }
    }

    fn plan(&mut self, duration_s: f64, load: impl FnMut(f64) -> PlannedLoad + Send + 'static) {
        // A plan is refused while there is no link: let it open first.
        self.run_ms(60);
        let start_ns = self.now() + 5 * MS;
        self.orders
            .try_send(Order::Plan {
                start_ns,
                duration_s,
                load: Box::new(load),
            })
            .unwrap();
    }

    fn records(&self) -> Vec<LinkRecord> {
        self.records.lock().unwrap().clone()
    }

    fn commands(&self) -> Vec<CommandRecord> {
        self.records()
            .into_iter()
            .filter_map(|r| {
                if let LinkRecord::Command(c) = r {
                    Some(c)
                } else {
                    None
                }
            })
            .collect()
    }

    fn echoes(&self) -> Vec<EchoRecord> {
        self.records()
            .into_iter()
            .filter_map(|r| {
                if let LinkRecord::Echo(e) = r {
                    Some(e)
                } else {
                    None
                }
            })
            .collect()
    }

    fn events(&self, kind: &str) -> Vec<Event> {
        self.records()
            .into_iter()
            .filter_map(|r| {
                if let LinkRecord::Event(e) = r {
                    Some(e)
                } else {
                    None
                }
            })
            .filter(|e| *e.kind == *kind)
            .collect()
    }

    fn at_neutral(&self) -> bool {
        self.cable
            .with(|c| c.outputs().iter().all(|o| o.pulse_us() == 1500.0))
    }

    fn running(&self) -> bool {
        self.cable
            .with(|c| c.outputs().iter().all(|o| o.pulse_us() > 1500.0))
    }
}

fn constant(thrust_n: f64) -> impl FnMut(f64) -> PlannedLoad + Send {
    move |_| PlannedLoad {
        thrust_n: vec![thrust_n; 2],
        pulses_us: None,
        plan_step: 1,
    }
}

#[test]
fn a_plan_is_sent_echoed_in_order_and_ends_at_neutral() {
    for kind in KINDS {
        let mut b = bench(kind, |_| {});
        b.run_ms(100);
        b.plan(1.0, |t_s| PlannedLoad {
            thrust_n: vec![5.0 + t_s, 8.0 - t_s],
            pulses_us: None,
            plan_step: 1 + (t_s >= 0.5) as u32,
        });
        b.run_ms(1500);
        let commands = b.commands();
        let planned: Vec<_> = commands.iter().filter(|c| c.cause == "plan").collect();
        assert_eq!(planned.len(), 100, "{kind:?}");
        assert_eq!(planned.iter().filter(|c| c.plan_step == 2).count(), 50);
        // Every command, neutral ones too, has an echo of the same pulse, in the same order.
        let echoes = b.echoes();
        let sent: Vec<_> = commands
            .iter()
            .map(|c| (c.sequence, c.thruster.clone(), c.pulse_us))
            .collect();
        let heard: Vec<_> = echoes
            .iter()
            .map(|e| (e.sequence, e.thruster.clone(), e.pulse_us))
            .collect();
        assert_eq!(sent, heard, "{kind:?}");
        for (command, echo) in commands.iter().zip(&echoes) {
            let round_ns = (echo.timestamp_ns - command.timestamp_ns) as f64;
            assert!(round_ns > 0.0 && (echo.round_trip_s * 1e9 - round_ns).abs() < 1.0);
            if command.cause == "plan" {
                let late_ns = command.timestamp_ns.checked_sub(command.due_ns).unwrap();
                assert!(late_ns < 20 * MS, "{late_ns}");
            }
            if kind == LinkKind::Stamped {
                assert!(echo.controller_time_us > 0);
            }
        }
        // 5 N at the start: half way between 1525 and 1900 us times 5/50.
        assert!((planned[0].pulse_us - 1562.5).abs() < 1e-9 && planned[0].thrust_n == 5.0);
        assert!(b.at_neutral(), "{kind:?}");
        assert_eq!(b.core.state(), State::Neutral(NeutralReason::Idle));
        assert_eq!(
            commands.last().map(|c| (c.cause, c.pulse_us)),
            Some(("neutral", 1500.0))
        );
        // Records are in order: no echo before its command.
        let mut seen = 0;
        for record in b.records() {
            match record {
                LinkRecord::Command(c) => seen = c.sequence,
                LinkRecord::Echo(e) => assert!(e.sequence <= seen),
                _ => {}
            }
        }
    }
}

#[test]
fn a_thrust_beyond_the_curve_is_refused_before_a_byte_goes_out() {
    for bad in [
        vec![60.0, 1.0],
        vec![1.0],
        vec![1.0, f64::NAN],
        vec![1.0; 3],
    ] {
        let mut b = bench(LinkKind::Stamped, |_| {});
        b.run_ms(100);
        b.cable.take_events();
        let load = bad.clone();
        b.plan(1.0, move |_| PlannedLoad {
            thrust_n: load.clone(),
            pulses_us: None,
            plan_step: 1,
        });
        b.run_ms(200);
        assert_eq!(b.events("thruster.refused").len(), 1, "{bad:?}");
        assert_eq!(b.core.state(), State::Neutral(NeutralReason::Range));
        assert!(
            b.cable.take_events().iter().all(|e| e.pulse_us == 1500.0),
            "{bad:?}"
        );
    }
}

#[test]
fn a_steep_step_is_ramped_and_logged_as_sent() {
    let mut b = bench(LinkKind::Stamped, |c| c.set.max_slew_us_per_s = 1000.0);
    b.run_ms(100);
    b.plan(0.5, constant(20.0));
    b.run_ms(450);
    let pulses: Vec<f64> = b
        .commands()
        .iter()
        .filter(|c| c.cause == "plan" && &*c.thruster == "port")
        .map(|c| c.pulse_us)
        .collect();
    // Two periods (0.04 s) of credit at most, 1 us per ms.
    assert!(pulses.windows(2).all(|w| w[1] - w[0] <= 40.0), "{pulses:?}");
    assert_eq!(pulses.last(), Some(&1675.0));
    assert_eq!(b.events("thruster.slew_limited").len(), 1);
    let first = b
        .commands()
        .iter()
        .find(|c| c.cause == "plan")
        .cloned()
        .unwrap();
    assert!(
        first.thrust_n < 20.0,
        "the thrust logged is the one of the pulse sent"
    );
}

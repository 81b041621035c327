//! The service's core on a manual clock and the in-memory controller: every promise about neutral, both protocols.

use super::*;
use crate::clock::ManualClock;
use crate::event::Event;
use crate::thruster::controller::{
    ControllerConfig, ControllerEvent, Faults, Loopback, OutputCause, SimController,
};
use crate::thruster::record::{CommandRecord, EchoRecord};
use crate::thruster::scheduler::PlannedLoad;
use hydroline_rigs::{Link, LinkKind, LinkPort, ThrustCurve, Thruster};
use proptest::prelude::*;
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
        },
        thrusters: vec![thruster("port", 0), thruster("starboard", 3)],
        neutral_us: 1500.0,
        min_us: 1100.0,
        max_us: 1900.0,
        max_slew_us_per_s: 20_000.0,
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
    let clock = Arc::new(ManualClock::new(1_000_000_000, 1_700_000_000_000_000_000));
    let mut config = ServiceConfig {
        set: set(kind),
        resume_after_loss: false,
    };
    change(&mut config);
    let cable = Loopback::new(
        SimController::new(ControllerConfig::for_rig(&config.set)),
        clock.clone(),
    );
    let opens = Arc::new(AtomicU32::new(0));
    let (line, counted) = (cable.clone(), opens.clone());
    let opener: Opener = Box::new(move || {
        counted.fetch_add(1, Ordering::Relaxed);
        let transport = line.open().map_err(|e| OpenError::Other {
            path: "loopback".into(),
            reason: e.to_string(),
        })?;
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
            .filter(|e| e.kind == kind)
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
fn shutdown_sends_neutral_and_waits_for_its_echo() {
    for kind in KINDS {
        let mut b = bench(kind, |_| {});
        b.plan(60.0, constant(10.0));
        b.run_ms(500);
        assert!(b.running());
        b.shared.stop.store(true, Ordering::Release);
        b.run_ms(1000);
        assert!(b.at_neutral(), "{kind:?}");
        let last = b.commands().last().cloned().unwrap();
        assert_eq!((last.cause, last.pulse_us), ("exit", 1500.0));
        assert_eq!(b.echoes().last().unwrap().sequence, last.sequence);
        assert!(
            b.cable
                .take_events()
                .iter()
                .any(|e: &ControllerEvent| e.pulse_us > 1500.0)
        );
    }
}

#[test]
fn a_request_from_a_signal_handler_stops_within_milliseconds() {
    let mut b = bench(LinkKind::Stamped, |_| {});
    b.plan(60.0, constant(10.0));
    b.run_ms(500);
    b.cable.take_events();
    let asked_ns = b.now();
    NeutralHandle(b.shared.clone()).request(NeutralReason::Limit);
    b.run_ms(100);
    let stopped = b
        .cable
        .take_events()
        .iter()
        .find(|e| e.pulse_us == 1500.0)
        .unwrap()
        .host_monotonic_ns;
    assert!(stopped - asked_ns < 10 * MS, "{}", stopped - asked_ns);
    assert_eq!(b.core.state(), State::Neutral(NeutralReason::Limit));
    assert_eq!(b.commands().last().unwrap().cause, "limit");
    // And stays there.
    b.run_ms(500);
    assert!(b.at_neutral());
}

#[test]
fn a_stalled_plan_misses_its_deadline_and_stops() {
    for kind in KINDS {
        let mut b = bench(kind, |_| {});
        let clock = b.clock.clone();
        b.plan(60.0, move |t_s| {
            if (t_s - 0.4).abs() < 1e-9 {
                // The producer hangs for 100 ms; 30 are allowed.
                clock.advance(Duration::from_millis(100));
            }
            PlannedLoad {
                thrust_n: vec![10.0; 2],
                plan_step: 1,
            }
        });
        b.run_ms(1000);
        assert!(b.at_neutral(), "{kind:?}");
        assert_eq!(b.core.state(), State::Neutral(NeutralReason::Deadline));
        assert_eq!(b.events("thruster.deadline").len(), 1);
        assert_eq!(b.events("thruster.neutral").len(), 1);
        assert_eq!(b.commands().last().unwrap().cause, "deadline");
    }
}

#[test]
fn a_producer_that_falls_silent_misses_its_deadline() {
    let mut b = bench(LinkKind::Stamped, |_| {});
    b.run_ms(100);
    b.orders.try_send(Order::Arm).unwrap();
    for _ in 0..10 {
        let set_point = SetPoint {
            due_ns: b.now(),
            thrust_n: vec![10.0; 2],
            plan_step: 0,
        };
        b.orders.try_send(Order::SetPoint(set_point)).unwrap();
        b.run_ms(20);
    }
    assert!(b.running());
    b.run_ms(100);
    assert!(b.at_neutral());
    assert_eq!(b.core.state(), State::Neutral(NeutralReason::Deadline));
    // One that comes after that is not taken, and said so.
    let set_point = SetPoint {
        due_ns: 0,
        thrust_n: vec![10.0; 2],
        plan_step: 0,
    };
    b.orders.try_send(Order::SetPoint(set_point)).unwrap();
    b.run_ms(50);
    assert!(b.at_neutral());
    assert_eq!(b.events("thruster.refused").len(), 1);
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

#[test]
fn an_unplugged_line_is_closed_found_again_and_neutral_comes_first() {
    for kind in KINDS {
        let mut b = bench(kind, |_| {});
        b.plan(60.0, constant(10.0));
        b.run_ms(500);
        assert!(b.running());
        let (unplugged_ns, opens) = (
            b.clock.triple().realtime_ns,
            b.opens.load(Ordering::Relaxed),
        );
        b.cable.unplug();
        b.run_ms(3000);
        let lost = b.events("serial.lost");
        assert_eq!(lost.len(), 1, "{kind:?}");
        assert!(
            lost[0].timestamp_ns - unplugged_ns < 1_000 * MS,
            "noticed within a second"
        );
        assert_eq!(b.core.state(), State::Lost);
        // No busy loop while it is away: five attempts a second.
        let tried = b.opens.load(Ordering::Relaxed) - opens;
        assert!((10..=16).contains(&tried), "{tried} attempts in 3 s");
        // Meanwhile the controller's own watchdog has acted.
        let trip = b
            .cable
            .take_events()
            .iter()
            .filter(|e| e.cause == OutputCause::Watchdog)
            .count();
        assert!(trip > 0 && b.at_neutral());
        b.cable.replug();
        b.run_ms(1000);
        assert_eq!(b.events("serial.back").len(), 1);
        assert_eq!(b.core.state(), State::Neutral(NeutralReason::Lost));
        let after = b.cable.take_events();
        assert!(
            !after.is_empty() && after.iter().all(|e| e.pulse_us == 1500.0),
            "{kind:?}"
        );
        // Armed again, it runs again.
        b.plan(10.0, constant(10.0));
        b.run_ms(300);
        assert!(b.running(), "{kind:?}");
    }
}

#[test]
fn with_resume_the_plan_goes_on_after_a_confirmed_neutral() {
    let mut b = bench(LinkKind::Stamped, |c| c.resume_after_loss = true);
    b.plan(60.0, constant(10.0));
    b.run_ms(500);
    b.cable.unplug();
    b.run_ms(1000);
    b.cable.take_events();
    b.cable.replug();
    b.run_ms(1000);
    assert!(b.running());
    let after = b.cable.take_events();
    assert_eq!(after[0].pulse_us, 1500.0, "neutral first");
    assert_eq!(b.core.state(), State::Running);
}

#[test]
fn a_mute_controller_is_a_lost_link_and_comes_back_by_itself() {
    for kind in KINDS {
        let mut b = bench(kind, |_| {});
        b.plan(60.0, constant(10.0));
        b.run_ms(500);
        let silent_from = b.clock.triple().realtime_ns;
        b.cable.with(|c| {
            c.set_faults(Faults {
                mute: true,
                ..Faults::default()
            })
        });
        b.run_ms(1000);
        let lost = b.events("serial.lost");
        assert_eq!(lost.len(), 1, "{kind:?}");
        assert!(lost[0].timestamp_ns - silent_from < 1_000 * MS);
        // The line outwards still works, so neutral has arrived without waiting for the watchdog.
        assert!(b.at_neutral(), "{kind:?}");
        b.cable.with(|c| c.set_faults(Faults::default()));
        b.run_ms(1500);
        assert_eq!(b.events("serial.back").len(), 1, "{kind:?}");
        assert_eq!(b.core.state(), State::Neutral(NeutralReason::Lost));
    }
}

#[test]
fn a_panic_in_sink_or_plan_leaves_the_thrusters_at_neutral() {
    for kind in KINDS {
        let mut b = bench(kind, |_| {});
        b.plan(60.0, |t_s| {
            assert!(t_s < 0.4, "the plan breaks");
            PlannedLoad {
                thrust_n: vec![10.0; 2],
                plan_step: 1,
            }
        });
        let panic = catch_unwind(AssertUnwindSafe(|| b.run_ms(1000)));
        assert!(panic.is_err() && b.running());
        b.core.panicked("the plan breaks");
        assert!(b.at_neutral(), "{kind:?}");
        assert_eq!(b.commands().last().unwrap().cause, "panic");
        assert!(
            b.events("thruster.neutral")
                .iter()
                .any(|e| e.message.contains("the plan breaks"))
        );
    }
    // A sink that panics at every record from some point on.
    let mut b = bench(LinkKind::Stamped, |_| {});
    let left = AtomicU32::new(60);
    b.core.replace_sink(Box::new(move |_| {
        assert!(left.fetch_sub(1, Ordering::Relaxed) > 0, "disk full")
    }));
    b.plan(60.0, constant(10.0));
    assert!(catch_unwind(AssertUnwindSafe(|| b.run_ms(5000))).is_err());
    assert!(b.running());
    b.core.panicked("disk full");
    assert!(b.at_neutral());
}

#[test]
fn a_lost_neutral_is_repeated_until_it_is_confirmed() {
    let mut b = bench(LinkKind::Stamped, |_| {});
    b.plan(60.0, constant(10.0));
    b.run_ms(500);
    // The frame does not get through for 100 ms, well inside the watchdog's 300 ms.
    b.cable.with(|c| {
        c.set_faults(Faults {
            deaf: true,
            ..Faults::default()
        })
    });
    NeutralHandle(b.shared.clone()).request(NeutralReason::Request);
    b.run_ms(100);
    assert!(b.running());
    b.cable.with(|c| c.set_faults(Faults::default()));
    b.cable.take_events();
    b.run_ms(100);
    assert!(b.at_neutral());
    assert!(
        b.cable
            .take_events()
            .iter()
            .all(|e| e.cause == OutputCause::Neutral)
    );
}

#[test]
fn the_controllers_clock_is_reported_once_a_second() {
    let mut b = bench(LinkKind::Stamped, |_| {});
    b.run_ms(10_000);
    let clocks: Vec<_> = b
        .records()
        .into_iter()
        .filter_map(|r| {
            if let LinkRecord::Clock(c) = r {
                Some(c)
            } else {
                None
            }
        })
        .collect();
    assert!((9..=11).contains(&clocks.len()), "{}", clocks.len());
    let last = clocks.last().unwrap();
    assert!((last.drift_ppm - 37.0).abs() < 5.0, "{last:?}");
}

#[test]
fn a_line_too_slow_for_the_rate_is_refused_with_the_arithmetic() {
    let mut slow = set(LinkKind::Maestro);
    slow.link.baud = 9600;
    slow.link.rate_hz = 100.0;
    let error = check(&slow, &*protocol_for(&slow)).unwrap_err();
    assert!(
        matches!(error, ServiceError::TooSlow { baud: 9600, .. }),
        "{error}"
    );
    let mut twice = set(LinkKind::Maestro);
    twice.thrusters[1].channel = 0;
    assert!(matches!(
        check(&twice, &*protocol_for(&twice)),
        Err(ServiceError::Channels { .. })
    ));
}

#[test]
fn a_controller_reset_while_running_is_noticed_by_its_next_ack() {
    let mut b = bench(LinkKind::Stamped, |_| {});
    b.plan(60.0, constant(10.0));
    b.run_ms(3000);
    assert!(b.running());
    let now_ns = b.now();
    b.cable.with(|c| c.reset(now_ns, &mut |_| {}));
    b.run_ms(60);
    assert_eq!(b.events("thruster.reset").len(), 1);
    assert!(b.at_neutral());
    b.run_ms(3000);
    assert_eq!(b.events("thruster.reset").len(), 1, "told once");
    // The controller's stamps keep rising within the new generation.
    b.plan(1.0, constant(10.0));
    b.run_ms(900);
    let stamps: Vec<_> = b
        .echoes()
        .iter()
        .rev()
        .take(40)
        .map(|e| e.controller_time_us)
        .collect();
    assert!(stamps.windows(2).all(|w| w[0] >= w[1]));
}

/// A line that returns whatever it is told to: bytes, errors, nothing.
struct Wild {
    clock: Arc<ManualClock>,
    script: std::vec::IntoIter<(u8, Vec<u8>)>,
}

impl Wild {
    fn error(code: u8) -> std::io::Error {
        let raw = [libc::EIO, libc::EPIPE, libc::ENODEV, libc::ETIMEDOUT][usize::from(code % 4)];
        std::io::Error::from_raw_os_error(raw)
    }
}

impl Transport for Wild {
    fn now_ns(&self) -> u64 {
        self.clock.monotonic_ns()
    }
    fn write(
        &mut self,
        bytes: &[u8],
        _timeout: Duration,
    ) -> std::io::Result<crate::thruster::transport::Sent> {
        match self.script.next() {
            Some((code, _)) if code < 10 => Err(Self::error(code)),
            _ => Ok(crate::thruster::transport::Sent {
                last_byte_out_ns: self.now_ns(),
                bytes: bytes.len(),
            }),
        }
    }
    fn read(&mut self, buffer: &mut [u8], timeout: Duration) -> std::io::Result<usize> {
        self.clock.advance(timeout.max(Duration::from_micros(10)));
        match self.script.next() {
            Some((code, _)) if code < 5 => Err(Self::error(code)),
            Some((_, bytes)) => {
                let n = bytes.len().min(buffer.len());
                buffer[..n].copy_from_slice(&bytes[..n]);
                Ok(n)
            }
            None => Ok(0),
        }
    }
    fn unsent_bytes(&mut self) -> Option<usize> {
        self.script.next().map(|(code, _)| usize::from(code % 3))
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn no_bytes_and_no_error_of_the_line_break_the_service(
        maestro: bool, resume: bool,
        script in prop::collection::vec((any::<u8>(), prop::collection::vec(any::<u8>(), 0..40)), 0..300),
    ) {
        let mut b = bench(if maestro { LinkKind::Maestro } else { LinkKind::Stamped }, |c| c.resume_after_loss = resume);
        let (clock, shared_script) = (b.clock.clone(), Arc::new(Mutex::new(script)));
        b.core.replace_opener(Box::new(move || {
            let mut script = shared_script.lock().unwrap();
            let half = script.len() / 2;
            let script = script.split_off(half).into_iter();
            Ok(Opened { transport: Box::new(Wild { clock: clock.clone(), script }), name: "wild".into(), low_latency: None })
        }));
        b.plan(2.0, constant(10.0));
        b.run_ms(3000);
        // Nobody sound ever answered for long, and the plan is over: it must not be running.
        prop_assert!(b.core.state() != State::Running);
        b.shared.stop.store(true, Ordering::Release);
        b.run_ms(2000);
        prop_assert!(b.core.step() == Flow::End);
    }

    #[test]
    fn whatever_is_asked_the_controller_never_sees_a_bad_pulse_or_a_jump(
        asked in prop::collection::vec(-60.0f64..60.0, 1..60), slew in 500.0f64..20_000.0,
    ) {
        let mut b = bench(LinkKind::Stamped, |c| c.set.max_slew_us_per_s = slew);
        b.run_ms(50);
        b.cable.take_events();
        b.orders.try_send(Order::Arm).unwrap();
        for thrust in asked {
            let set_point = SetPoint { due_ns: 0, thrust_n: vec![thrust, -thrust * 0.5], plan_step: 0 };
            b.orders.try_send(Order::SetPoint(set_point)).unwrap();
            b.run_ms(20);
        }
        let mut last = 1500.0;
        for event in b.cable.take_events().iter().filter(|e| e.channel == 0) {
            prop_assert!((1100.0..=1900.0).contains(&event.pulse_us));
            if event.pulse_us != 1500.0 {
                // Two periods of credit at most (0.04 s), and the wire's quarter microsecond.
                prop_assert!((event.pulse_us - last).abs() <= slew * 0.04 + 0.25);
            }
            last = event.pulse_us;
        }
    }
}

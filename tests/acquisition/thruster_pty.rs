//! The thruster service on real descriptors: pseudo-terminals and sockets with the simulated controller at the far end.
//!
//! Nothing here asserts an absolute duration; what is about time is a lower bound of physics (the wire) or a ratio.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use hydroline::clock::{Clock, SystemClock};
use hydroline::event::Event;
use hydroline::thruster::controller::{
    ControllerConfig, ControllerEvent, OutputCause, PtyController, ServeEnd, SimController, serve,
};
use hydroline::thruster::ports::Roots;
use hydroline::thruster::record::{CommandRecord, EchoRecord, LinkRecord};
use hydroline::thruster::safety::{NeutralReason, State};
use hydroline::thruster::scheduler::PlannedLoad;
use hydroline::thruster::service::{ServiceConfig, ThrusterService, serial_opener};
use hydroline::thruster::transport::{SerialTransport, Transport, Wire};
use hydroline_rigs::{Link, LinkKind, LinkPort, ThrustCurve, Thruster, ThrusterSet};
use std::io::{Read, Write};
use std::os::unix::net::UnixStream;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

const KINDS: [LinkKind; 2] = [LinkKind::Maestro, LinkKind::Stamped];

fn set(kind: LinkKind, port: LinkPort) -> ThrusterSet {
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
        // Generous times: the tests share two cores with others, and wall time is not what they are about.
        link: Link {
            kind,
            port,
            baud: 115_200,
            rate_hz: 50.0,
            deadline_s: 1.0,
            timeout_s: 1.0,
            mavlink: None,
        },
        thrusters: vec![thruster("port", 2), thruster("starboard", 5)],
        neutral_us: 1500.0,
        min_us: 1100.0,
        max_us: 1900.0,
        max_slew_us_per_s: 50_000.0,
        scale_sd: None,
    }
}

struct Bench {
    _dir: tempfile::TempDir,
    controller: PtyController,
    set: ThrusterSet,
    outputs: Arc<Mutex<Vec<ControllerEvent>>>,
    records: Arc<Mutex<Vec<LinkRecord>>>,
}

impl Bench {
    fn new(kind: LinkKind) -> Self {
        let dir = tempfile::tempdir().unwrap();
        let path: PathBuf = dir.path().join("controller");
        let set = set(kind, LinkPort::Node(path.clone()));
        let outputs = Arc::new(Mutex::new(Vec::new()));
        let seen = outputs.clone();
        let controller = PtyController::start(
            SimController::new(ControllerConfig::for_rig(&set)),
            Some(path),
            Box::new(move |event| seen.lock().unwrap().push(event)),
        )
        .unwrap();
        Self {
            _dir: dir,
            controller,
            set,
            outputs,
            records: Arc::default(),
        }
    }

    fn service(&self) -> ThrusterService {
        let records = self.records.clone();
        self.service_with(Box::new(move |record| records.lock().unwrap().push(record)))
    }

    fn service_with(&self, sink: Box<dyn FnMut(LinkRecord) + Send>) -> ThrusterService {
        let clock: Arc<dyn Clock> = Arc::new(SystemClock);
        let config = ServiceConfig {
            set: self.set.clone(),
            resume_after_loss: false,
        };
        let opener = serial_opener(&self.set, Roots::default(), clock.clone());
        let service = ThrusterService::start(config, opener, clock, sink).unwrap();
        until("a link", || service.state() != State::Lost);
        service
    }

    fn run(&self, service: &ThrusterService, seconds: f64) {
        let start_ns = SystemClock.monotonic_ns() + 10_000_000;
        let load = |t_s: f64| PlannedLoad {
            thrust_n: vec![5.0 + t_s, 5.0 - t_s],
            pulses_us: None,
            plan_step: 1,
        };
        service.run_plan(start_ns, seconds, Box::new(load)).unwrap();
    }

    fn commands(&self) -> Vec<CommandRecord> {
        let records = self.records.lock().unwrap();
        records
            .iter()
            .filter_map(|r| {
                if let LinkRecord::Command(c) = r {
                    Some(c.clone())
                } else {
                    None
                }
            })
            .collect()
    }

    fn echoes(&self) -> Vec<EchoRecord> {
        let records = self.records.lock().unwrap();
        records
            .iter()
            .filter_map(|r| {
                if let LinkRecord::Echo(e) = r {
                    Some(e.clone())
                } else {
                    None
                }
            })
            .collect()
    }

    fn events(&self, kind: &str) -> Vec<Event> {
        let records = self.records.lock().unwrap();
        records
            .iter()
            .filter_map(|r| {
                if let LinkRecord::Event(e) = r {
                    Some(e.clone())
                } else {
                    None
                }
            })
            .filter(|e| *e.kind == *kind)
            .collect()
    }

    fn pulses_us(&self) -> Vec<f64> {
        self.controller
            .controller()
            .outputs()
            .iter()
            .map(|o| o.pulse_us())
            .collect()
    }

    fn at_neutral(&self) -> bool {
        self.pulses_us().iter().all(|p| *p == 1500.0)
    }
}

/// Waits for something that has to come; the bound only ends a broken test.
fn until(what: &str, mut done: impl FnMut() -> bool) {
    let begin = Instant::now();
    while !done() {
        assert!(begin.elapsed() < Duration::from_secs(20), "never: {what}");
        std::thread::sleep(Duration::from_millis(2));
    }
}

#[test]
fn every_command_is_echoed_in_order_and_dropping_the_service_is_neutral() {
    for kind in KINDS {
        let bench = Bench::new(kind);
        let service = bench.service();
        bench.run(&service, 60.0);
        until("50 commands", || {
            bench
                .commands()
                .iter()
                .filter(|c| c.cause == "plan")
                .count()
                >= 100
        });
        assert!(!bench.at_neutral());
        drop(service);
        assert!(bench.at_neutral(), "{kind:?}");
        let sent: Vec<_> = bench
            .commands()
            .iter()
            .map(|c| (c.sequence, c.thruster.clone(), c.pulse_us))
            .collect();
        let heard: Vec<_> = bench
            .echoes()
            .iter()
            .map(|e| (e.sequence, e.thruster.clone(), e.pulse_us))
            .collect();
        assert_eq!(sent, heard, "{kind:?}");
        assert_eq!(bench.commands().last().unwrap().cause, "exit");
        for (command, echo) in bench.commands().iter().zip(bench.echoes()) {
            assert!(command.timestamp_ns <= echo.timestamp_ns);
        }
        // The controller put out the pulses that were logged, in order.
        let felt: Vec<f64> = bench
            .outputs
            .lock()
            .unwrap()
            .iter()
            .filter(|e| e.channel == 2)
            .map(|e| e.pulse_us)
            .collect();
        let logged: Vec<f64> = bench
            .commands()
            .iter()
            .filter(|c| &*c.thruster == "port")
            .map(|c| c.pulse_us)
            .collect();
        assert_eq!(felt, logged, "{kind:?}");
        // A pseudo-terminal has no low-latency mode: reported, not fatal.
        assert_eq!(bench.events("serial.low_latency").len(), 1);
    }
}

#[test]
fn command_stamps_agree_with_the_moment_the_pulses_took_effect() {
    let bench = Bench::new(LinkKind::Stamped);
    let service = bench.service();
    bench.run(&service, 60.0);
    until("commands", || bench.commands().len() >= 300);
    let began = bench.commands()[0].timestamp_ns;
    let stats = service.shutdown();
    let seconds = (bench.commands().last().unwrap().timestamp_ns - began) as f64 * 1e-9;
    println!(
        "CPU of the service at 50 sets a second: {:.2} %",
        100.0 * stats.cpu_s / seconds
    );
    let triple = SystemClock.triple();
    let felt = bench.outputs.lock().unwrap().clone();
    let took_effect: Vec<u64> = felt
        .iter()
        .filter(|e| e.channel == 2 && e.cause == OutputCause::Command)
        .map(|e| triple.monotonic_to_unix_ns(e.host_monotonic_ns))
        .collect();
    let stamped: Vec<u64> = bench
        .commands()
        .iter()
        .filter(|c| c.cause == "plan" && &*c.thruster == "port")
        .map(|c| c.timestamp_ns)
        .collect();
    assert_eq!(took_effect.len(), stamped.len());
    let mut late_us: Vec<f64> = took_effect
        .iter()
        .zip(&stamped)
        .map(|(felt, sent)| (*felt as f64 - *sent as f64) * 1e-3)
        .collect();
    late_us.sort_by(f64::total_cmp);
    let median = late_us[late_us.len() / 2];
    println!(
        "pulse minus stamp: median {median:.1} us, max {:.1} us of {}",
        late_us[late_us.len() - 1],
        late_us.len()
    );
    // Half a byte's time (43 us) early at most; late only by the far thread's scheduling, in the median below a byte set.
    assert!(late_us[0] > -50.0, "{}", late_us[0]);
    assert!(
        median < Wire::Uart { baud: 115_200 }.time_ns(17) as f64 * 1e-3,
        "{median}"
    );
}

#[test]
fn a_panic_inside_the_service_is_neutral() {
    for kind in KINDS {
        let bench = Bench::new(kind);
        let records = bench.records.clone();
        let service = bench.service_with(Box::new(move |record| {
            let mut records = records
                .lock()
                .unwrap_or_else(std::sync::PoisonError::into_inner);
            records.push(record);
            assert!(records.len() != 200, "the sink breaks");
        }));
        bench.run(&service, 60.0);
        until("the end", || {
            service.state() == State::Neutral(NeutralReason::Panic)
        });
        assert!(bench.at_neutral(), "{kind:?}");
        assert!(
            bench
                .outputs
                .lock()
                .unwrap()
                .iter()
                .any(|e| e.pulse_us != 1500.0)
        );
        until("refusal", || service.arm().is_err());
        drop(service);
        let records = bench
            .records
            .lock()
            .unwrap_or_else(std::sync::PoisonError::into_inner);
        let reported = |r: &LinkRecord| matches!(r, LinkRecord::Event(e) if e.message.contains("the sink breaks"));
        assert!(records.iter().any(reported), "{kind:?}");
    }
}

#[test]
fn a_missed_deadline_is_neutral() {
    for kind in KINDS {
        let mut bench = Bench::new(kind);
        bench.set.link.deadline_s = 0.1;
        let service = bench.service();
        let start_ns = SystemClock.monotonic_ns() + 10_000_000;
        let mut calls = 0;
        let stalls = move |_| {
            calls += 1;
            if calls == 10 {
                std::thread::sleep(Duration::from_millis(400));
            }
            PlannedLoad {
                thrust_n: vec![5.0, 5.0],
                pulses_us: None,
                plan_step: 1,
            }
        };
        service.run_plan(start_ns, 60.0, Box::new(stalls)).unwrap();
        until("neutral", || {
            service.state() == State::Neutral(NeutralReason::Deadline)
        });
        until("neutral at the controller", || bench.at_neutral());
        until("its echo", || {
            bench.echoes().last().is_some_and(|e| e.pulse_us == 1500.0)
        });
        assert_eq!(bench.commands().last().unwrap().cause, "deadline");
        assert_eq!(bench.events("thruster.deadline").len(), 1);
    }
}

#[test]
fn unplug_and_replug_of_the_terminal() {
    for kind in KINDS {
        let mut bench = Bench::new(kind);
        let service = bench.service();
        bench.run(&service, 60.0);
        until("running", || {
            bench
                .commands()
                .iter()
                .filter(|c| c.cause == "plan")
                .count()
                >= 20
        });
        let node = std::fs::read_link(bench.controller.path().unwrap()).unwrap();
        let unplugged = Instant::now();
        bench.controller.unplug();
        until("lost", || service.state() == State::Lost);
        println!("{kind:?}: unplug noticed after {:?}", unplugged.elapsed());
        // Nobody commands any more: the controller's watchdog acts by itself.
        until("watchdog", || {
            let output = |event| bench.outputs.lock().unwrap().push(event);
            let now_ns = SystemClock.monotonic_ns();
            let mut controller = bench.controller.controller();
            controller.poll(now_ns, &mut Vec::new(), &mut { output });
            drop(controller);
            bench.at_neutral()
        });
        assert!(
            bench
                .outputs
                .lock()
                .unwrap()
                .iter()
                .any(|e| e.cause == OutputCause::Watchdog)
        );
        // CPU while away, as a share: the service's own thread clock over wall time.
        let (cpu_s, begin) = (service.stats().cpu_s, Instant::now());
        std::thread::sleep(Duration::from_millis(600));
        let share = (service.stats().cpu_s - cpu_s) / begin.elapsed().as_secs_f64();
        println!("{kind:?}: CPU while unplugged {:.2} %", share * 100.0);
        assert!(share < 0.05, "{share}");
        bench.outputs.lock().unwrap().clear();
        bench.controller.replug().unwrap();
        until("back", || !bench.events("serial.back").is_empty());
        // The old node number is free again only because the service has closed it.
        println!(
            "{kind:?}: {node:?} came back as {:?}",
            std::fs::read_link(bench.controller.path().unwrap()).unwrap()
        );
        assert_eq!(service.state(), State::Neutral(NeutralReason::Lost));
        until("an echo", || {
            bench.echoes().last().is_some_and(|e| e.pulse_us == 1500.0)
        });
        assert!(
            bench
                .outputs
                .lock()
                .unwrap()
                .iter()
                .all(|e| e.pulse_us == 1500.0),
            "neutral first"
        );
        assert_eq!(bench.events("serial.lost").len(), 1);
        bench.run(&service, 60.0);
        until("running again", || !bench.at_neutral());
        assert_eq!(service.shutdown().losses, 1);
        assert!(bench.at_neutral());
    }
}

#[test]
fn bytes_take_the_wires_time() {
    for baud in [9600, 38_400] {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("controller");
        let config = ControllerConfig {
            baud: Some(baud),
            ..ControllerConfig::bench(LinkKind::Maestro)
        };
        let _controller = PtyController::start(
            SimController::new(config),
            Some(path.clone()),
            Box::new(|_| {}),
        )
        .unwrap();
        let mut line = SerialTransport::open(&path, baud, Arc::new(SystemClock)).unwrap();
        // 100 questions of one byte, 200 bytes of answers.
        let begin = Instant::now();
        let sent_ns = line.now_ns();
        let sent = line.write(&[0xA1; 100], Duration::from_secs(1)).unwrap();
        let (mut got, mut buffer) = (0, [0; 256]);
        while got < 200 {
            got += line.read(&mut buffer, Duration::from_secs(5)).unwrap();
            assert!(begin.elapsed() < Duration::from_secs(20));
        }
        // The last answer cannot be here before 100 bytes out and 2 back, nor 200 bytes before 1 out and 200 back.
        let ratio = begin.elapsed().as_secs_f64() / (201.0 * 10.0 / f64::from(baud));
        println!("{baud} baud: {ratio:.3} of the wire's time");
        assert!(ratio >= 1.0, "{ratio}");
        assert!(sent.last_byte_out_ns - sent_ns >= 100 * 10 * 1_000_000_000 / u64::from(baud));
    }
}

#[test]
fn a_stuck_line_times_out_instead_of_hanging() {
    // Nobody reads the master's side: the terminal's buffer fills up.
    let (_master, slave) = serialport::TTYPort::pair().unwrap();
    let path = serialport::SerialPort::name(&slave).unwrap();
    drop(slave);
    let mut line = SerialTransport::open(path.as_ref(), 115_200, Arc::new(SystemClock)).unwrap();
    let error = (0..10_000)
        .find_map(|_| line.write(&[0x55; 100], Duration::from_millis(30)).err())
        .unwrap();
    assert_eq!(error.kind(), std::io::ErrorKind::TimedOut);
}

#[test]
fn the_controller_serves_any_socket_and_ends_with_it() {
    let (mut host, mut far) = UnixStream::pair().unwrap();
    let stop = Arc::new(AtomicBool::new(false));
    let stopped = stop.clone();
    let thread = std::thread::spawn(move || {
        let controller = Mutex::new(SimController::new(ControllerConfig::bench(
            LinkKind::Maestro,
        )));
        serve(&controller, &mut far, &SystemClock, &stopped, &mut |_| {}).unwrap()
    });
    host.set_read_timeout(Some(Duration::from_secs(10)))
        .unwrap();
    host.write_all(&[0x84, 2, 0x40, 0x32, 0x90, 2]).unwrap();
    let mut answer = [0; 2];
    host.read_exact(&mut answer).unwrap();
    assert_eq!(u16::from_le_bytes(answer), 6464);
    drop(host);
    assert_eq!(thread.join().unwrap(), ServeEnd::Closed);
    assert!(!stop.load(Ordering::Relaxed));
}

#[test]
fn a_port_that_is_not_there_says_what_to_do() {
    let mut set = set(
        LinkKind::Stamped,
        LinkPort::Node("/dev/tty-nothing-here".into()),
    );
    let mut opener = serial_opener(&set, Roots::default(), Arc::new(SystemClock));
    let error = opener().err().unwrap().to_string();
    assert!(
        error.contains("/dev/tty-nothing-here") && error.contains("hydroline devices"),
        "{error}"
    );
    set.link.port = LinkPort::ById("usb-Nobody_Nothing-if00".into());
    let mut opener = serial_opener(&set, Roots::default(), Arc::new(SystemClock));
    assert!(
        opener()
            .err()
            .unwrap()
            .to_string()
            .contains("usb-Nobody_Nothing-if00")
    );
}

//! Arbitrary lines and arbitrary set-points.

use super::*;
use proptest::prelude::*;

/// A line that returns whatever is scripted: bytes, errors, nothing.
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
    fn write(&mut self, bytes: &[u8], _timeout: Duration) -> std::io::Result<Sent> {
        match self.script.next() {
            Some((code, _)) if code < 10 => Err(Self::error(code)),
            _ => Ok(Sent {
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
        b.core.opener = Box::new(move || {
            let mut script = shared_script.lock().unwrap();
            let half = script.len() / 2;
            let script = script.split_off(half).into_iter();
            Ok(Opened { transport: Box::new(Wild { clock: clock.clone(), script }), name: "wild".into(), low_latency: None })
        });
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

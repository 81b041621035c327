//! The simulated controller as a [`Transport`] in memory: host and controller on one injected clock, no threads.

#![allow(dead_code)] // the bench uses less of it

use hydroline_core::clock::Clock;
use hydroline_core::lock::Lock;
use hydroline_thruster::controller::{ControllerConfig, ControllerEvent, SimController};
use hydroline_thruster::transport::{LineModel, Sent, Transport, Wire};
use std::collections::VecDeque;
use std::io;
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::Duration;

struct Shared {
    controller: SimController,
    events: Vec<ControllerEvent>,
    arrived: VecDeque<u8>,
    plugged: bool,
    /// Counts every plugging in: an old handle must not work on a new cable.
    generation: u32,
}

/// A cable between a host and a simulated controller.
#[derive(Clone)]
pub struct Loopback {
    shared: Arc<Mutex<Shared>>,
    clock: Arc<dyn Clock>,
    line: LineModel,
    generation: u32,
}

impl Loopback {
    /// A new controller, plugged in.
    pub fn new(config: ControllerConfig, clock: Arc<dyn Clock>) -> Self {
        let wire = config.baud.map_or(Wire::Packet, |baud| Wire::Uart { baud });
        let shared = Shared {
            controller: SimController::new(config),
            events: Vec::new(),
            arrived: VecDeque::new(),
            plugged: true,
            generation: 0,
        };
        Self {
            shared: Arc::new(Mutex::new(shared)),
            clock,
            line: LineModel::new(wire),
            generation: 0,
        }
    }

    /// Opens the host's end anew.
    ///
    /// # Errors
    /// `NotFound` while unplugged.
    pub fn open(&self) -> io::Result<Self> {
        let mut shared = self.shared.held();
        if !shared.plugged {
            return Err(io::ErrorKind::NotFound.into());
        }
        shared.arrived.clear();
        let mut handle = self.clone();
        handle.generation = shared.generation;
        Ok(handle)
    }

    /// Pulls the cable.
    pub fn unplug(&self) {
        let mut shared = self.shared.held();
        shared.plugged = false;
        shared.arrived.clear();
        shared.controller.cable_pulled();
    }

    /// Plugs it in again.
    pub fn replug(&self) {
        let mut shared = self.shared.held();
        shared.plugged = true;
        shared.generation += 1;
    }

    /// The controller, for faults and questions; brought up to the present first.
    pub fn with<R>(&self, f: impl FnOnce(&mut SimController) -> R) -> R {
        let now_ns = self.clock.monotonic_ns();
        let mut shared = self.shared.held();
        Self::run(&mut shared, now_ns);
        f(&mut shared.controller)
    }

    /// Output changes so far, taken out.
    pub fn take_events(&self) -> Vec<ControllerEvent> {
        let now_ns = self.clock.monotonic_ns();
        let mut shared = self.shared.held();
        Self::run(&mut shared, now_ns);
        std::mem::take(&mut shared.events)
    }

    fn run(shared: &mut Shared, now_ns: u64) {
        let mut out = Vec::new();
        let Shared {
            controller,
            events,
            arrived,
            plugged,
            ..
        } = shared;
        controller.poll(now_ns, &mut out, &mut |e| events.push(e));
        if *plugged {
            arrived.extend(out);
        }
    }

    fn checked(&self) -> io::Result<MutexGuard<'_, Shared>> {
        let shared = self.shared.held();
        if shared.plugged && shared.generation == self.generation {
            Ok(shared)
        } else {
            Err(io::ErrorKind::BrokenPipe.into())
        }
    }
}

impl Transport for Loopback {
    fn now_ns(&self) -> u64 {
        self.clock.monotonic_ns()
    }

    fn write(&mut self, bytes: &[u8], _timeout: Duration) -> io::Result<Sent> {
        let now_ns = self.now_ns();
        self.checked()?.controller.receive(now_ns, bytes);
        Ok(Sent {
            last_byte_out_ns: self.line.push(now_ns, bytes.len()),
            bytes: bytes.len(),
        })
    }

    fn read(&mut self, buffer: &mut [u8], timeout: Duration) -> io::Result<usize> {
        let end_ns = self.now_ns().saturating_add(timeout.as_nanos() as u64);
        loop {
            let now_ns = self.now_ns();
            let wake_ns = {
                let mut shared = self.checked()?;
                Self::run(&mut shared, now_ns);
                if !shared.arrived.is_empty() {
                    let n = buffer.len().min(shared.arrived.len());
                    for (slot, byte) in buffer.iter_mut().zip(shared.arrived.drain(..n)) {
                        *slot = byte;
                    }
                    return Ok(n);
                }
                shared.controller.next_wake_ns().unwrap_or(u64::MAX)
            };
            if now_ns >= end_ns {
                return Ok(0);
            }
            // At least 1 us, so that a wake-up due now cannot stop the clock.
            self.clock.sleep(Duration::from_nanos(
                wake_ns.min(end_ns).saturating_sub(now_ns).max(1000),
            ));
        }
    }

    fn unsent_bytes(&mut self) -> Option<usize> {
        Some(0)
    }
}

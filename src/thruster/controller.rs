//! A simulated thruster controller that speaks both protocols, with its own clock, at the wire's pace.
//!
//! [`SimController`] has no I/O: bytes in at time t, bytes out due at time t'. The wire is modelled in both directions
//! (10 bits per byte, one byte after the other), so that a command takes effect at the very nanosecond its last bit
//! would have arrived, however late the thread that carries the bytes was scheduled. [`serve`] runs it over any
//! descriptor (a pseudo-terminal's master, a UNIX socket to QEMU), [`PtyController`] owns a pseudo-terminal
//! and can be unplugged and plugged in again.

mod config;
mod device;
mod faults;
mod pty;
mod serve;

pub use config::ControllerConfig;
pub use faults::Faults;
#[cfg(test)]
pub(crate) use pty::open_pty;
pub use pty::{PtyController, PtyError};
pub use serve::{ServeEnd, serve};

use super::ChannelPulse;
use super::transport::{LineModel, Wire};
use device::Device;
use rand::SeedableRng;
use rand::rngs::StdRng;
use std::collections::VecDeque;

/// An output changed (or was commanded again).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ControllerEvent {
    /// When it took effect, host CLOCK_MONOTONIC \[ns\].
    pub host_monotonic_ns: u64,
    /// Channel of the output.
    pub channel: u8,
    /// Pulse now put out \[us\].
    pub pulse_us: f64,
    /// Cause of the change.
    pub cause: OutputCause,
}

/// Cause of an output's pulse.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum OutputCause {
    /// A command.
    Command,
    /// A neutral command.
    Neutral,
    /// The watchdog ran out.
    Watchdog,
    /// The controller was reset.
    Reset,
}

/// The controller's microsecond counter.
#[derive(Debug, Clone, Copy)]
struct OwnClock {
    /// Host time of its zero \[ns\]; moves at a reset.
    zero_ns: u64,
    offset_us: u32,
    drift_ppm: f64,
}

impl OwnClock {
    fn read_us(self, host_ns: u64) -> u32 {
        let since_us = host_ns.saturating_sub(self.zero_ns) as f64 * 1e-3;
        self.offset_us
            .wrapping_add((since_us * (1.0 + self.drift_ppm * 1e-6)) as u64 as u32)
    }
}

/// The simulated controller, without I/O.
pub struct SimController {
    config: ControllerConfig,
    device: Box<dyn Device>,
    outputs: Vec<ChannelPulse>,
    running: bool,
    clock: OwnClock,
    rx: VecDeque<(u64, u8)>,
    rx_line: LineModel,
    tx: VecDeque<(u64, u8)>,
    tx_line: LineModel,
    last_sound_ns: u64,
    watchdog_ns: u64,
    faults: Faults,
    rng: StdRng,
}

impl SimController {
    /// Outputs neutral.
    pub fn new(config: ControllerConfig) -> Self {
        let wire = config.baud.map_or(Wire::Packet, |baud| Wire::Uart { baud });
        let neutral = |channel: &u8| ChannelPulse::from_us(*channel, config.neutral_us);
        Self {
            device: device::new(&config),
            outputs: config.channels.iter().map(neutral).collect(),
            running: false,
            clock: OwnClock {
                zero_ns: 0,
                offset_us: config.clock_offset_us,
                drift_ppm: config.drift_ppm,
            },
            rx: VecDeque::new(),
            rx_line: LineModel::new(wire),
            tx: VecDeque::new(),
            tx_line: LineModel::new(wire),
            last_sound_ns: 0,
            watchdog_ns: config.watchdog_ns,
            faults: Faults::default(),
            rng: StdRng::seed_from_u64(config.seed),
            config,
        }
    }

    /// Pulses that are put out now.
    pub fn outputs(&self) -> &[ChannelPulse] {
        &self.outputs
    }

    /// New faults from now on.
    pub fn set_faults(&mut self, faults: Faults) {
        self.faults = faults;
    }

    /// Power cut and back: outputs neutral, clock from 0, another boot id, buffers empty.
    pub fn reset(&mut self, now_ns: u64, on_event: &mut dyn FnMut(ControllerEvent)) {
        self.config.boot_id = self.config.boot_id.wrapping_mul(31).wrapping_add(7);
        self.device = device::new(&self.config);
        self.clock = OwnClock {
            zero_ns: now_ns,
            offset_us: 0,
            ..self.clock
        };
        self.rx.clear();
        self.tx.clear();
        self.watchdog_ns = self.config.watchdog_ns;
        self.neutral(now_ns, OutputCause::Reset, on_event);
    }

    /// The cable was pulled: bytes under way are lost. The controller itself runs on.
    pub fn cable_pulled(&mut self) {
        self.rx.clear();
        self.tx.clear();
    }

    /// Bytes were handed to the wire's far end at `now_ns`; each arrives when the wire has carried it.
    pub fn receive(&mut self, now_ns: u64, bytes: &[u8]) {
        for &byte in bytes {
            let at_ns = self.rx_line.push(now_ns, 1);
            if self.faults.deaf {
                continue;
            }
            let byte = self
                .faults
                .corrupt(byte, self.faults.corrupt_rx, &mut self.rng);
            self.rx.push_back((at_ns, byte));
        }
    }

    /// When [`Self::poll`] has something to do next; `None` = only when bytes come.
    ///
    /// Bursts are taken as a whole (their times are kept), but no longer than 1 ms at a time: a driver too
    /// hands over what has arrived every millisecond or so, and one wake-up per byte would eat a core.
    pub fn next_wake_ns(&self) -> Option<u64> {
        let burst = |queue: &VecDeque<(u64, u8)>| {
            let (first, last) = (queue.front()?.0, queue.back()?.0);
            Some(last.min(first + 1_000_000))
        };
        let watchdog = self
            .running
            .then(|| self.last_sound_ns.saturating_add(self.watchdog_ns) + 1);
        [burst(&self.rx), burst(&self.tx), watchdog]
            .into_iter()
            .flatten()
            .min()
    }

    /// Does everything up to `now_ns`; answers' bytes that are out by then are appended to `out`.
    pub fn poll(
        &mut self,
        now_ns: u64,
        out: &mut Vec<u8>,
        on_event: &mut dyn FnMut(ControllerEvent),
    ) {
        while let Some(&(at_ns, byte)) = self.rx.front().filter(|(at_ns, _)| *at_ns <= now_ns) {
            self.rx.pop_front();
            self.watchdog(at_ns, on_event);
            self.take(byte, at_ns, on_event);
        }
        self.watchdog(now_ns, on_event);
        while let Some(&(_, byte)) = self.tx.front().filter(|(at_ns, _)| *at_ns <= now_ns) {
            self.tx.pop_front();
            out.push(byte);
        }
    }

    fn watchdog(&mut self, now_ns: u64, on_event: &mut dyn FnMut(ControllerEvent)) {
        let due_ns = self.last_sound_ns.saturating_add(self.watchdog_ns);
        if self.running && now_ns > due_ns {
            self.neutral(due_ns, OutputCause::Watchdog, on_event);
            self.device.watchdog_tripped();
        }
    }

    fn neutral(
        &mut self,
        at_ns: u64,
        cause: OutputCause,
        on_event: &mut dyn FnMut(ControllerEvent),
    ) {
        self.running = false;
        let quarter_us = ChannelPulse::from_us(0, self.config.neutral_us).quarter_us;
        for output in &mut self.outputs {
            output.quarter_us = quarter_us;
            on_event(ControllerEvent {
                host_monotonic_ns: at_ns,
                channel: output.channel,
                pulse_us: output.pulse_us(),
                cause,
            });
        }
    }

    fn take(&mut self, byte: u8, at_ns: u64, on_event: &mut dyn FnMut(ControllerEvent)) {
        let start_ns = at_ns + self.config.processing_ns;
        let view = device::View {
            clock: self.clock,
            at_ns,
            start_ns,
            tx_line: self.tx_line,
            outputs: &self.outputs,
        };
        self.device.fail(self.faults.errors);
        let reaction = self.device.feed(byte, &view);
        if reaction.sound {
            self.last_sound_ns = at_ns;
        }
        if let Some(watchdog_ns) = reaction.watchdog_ns {
            self.watchdog_ns = watchdog_ns;
        }
        if reaction.neutral {
            self.neutral(at_ns, OutputCause::Neutral, on_event);
        }
        for pulse in &reaction.pulses {
            self.running = true;
            let Some(output) = self.outputs.iter_mut().find(|o| o.channel == pulse.channel) else {
                continue;
            };
            if self.faults.stuck {
                continue;
            }
            output.quarter_us = pulse.quarter_us;
            on_event(ControllerEvent {
                host_monotonic_ns: at_ns,
                channel: pulse.channel,
                pulse_us: pulse.pulse_us(),
                cause: OutputCause::Command,
            });
        }
        if let Some(mut answer) = reaction.answer {
            if self.faults.misnumbered {
                answer.misnumber();
            }
            if self.faults.without_channels {
                answer.unname();
            }
            let bytes = answer.bytes(&self.outputs);
            self.transmit(start_ns, &bytes);
        }
    }

    fn transmit(&mut self, start_ns: u64, bytes: &[u8]) {
        if self.faults.mute {
            return;
        }
        let garbage = self.faults.garbage(&mut self.rng);
        for &byte in garbage.iter().chain(bytes) {
            // A delay in a hub or a driver comes after the controller's own stamp, and keeps the order.
            let at_ns = self.tx_line.push(start_ns, 1) + self.faults.delay_ns;
            let at_ns = at_ns.max(self.tx.back().map_or(0, |(last, _)| *last));
            let byte = self
                .faults
                .corrupt(byte, self.faults.corrupt_tx, &mut self.rng);
            self.tx.push_back((at_ns, byte));
        }
    }
}

#[cfg(test)]
mod tests;

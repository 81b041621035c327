//! The Maestro behind [`Protocol`]: Set Target for all channels, then Get Position for all: the echo.

use super::{Echo, LinkEvent, Protocol};
use crate::ChannelPulse;
use crate::clocksync::Estimate;
use crate::maestro::{self, Request, Response, Responses};
use std::collections::VecDeque;

/// How often the error register is read \[ns\].
const ERRORS_EVERY_NS: u64 = 500_000_000;

#[derive(Debug)]
struct OpenSet {
    sequence: u32,
    sent_ns: u64,
    waiting: usize,
    pulses: Vec<ChannelPulse>,
}

/// Pololu Maestro, compact protocol.
///
/// The controller has no clock and no Ack.
///
/// # Its watchdog is a setting in its own memory
/// The Maestro stops the thrusters on a dead link only if its serial timeout is set. The protocol can neither set it nor
/// read it back; from the factory it is 0 = off, and the last pulse then goes out for ever. In the Pololu Maestro
/// Control Center: *Serial Settings -> Timeout* (0.5 s fits `timeout_s` of the example rigs), and per channel
/// *Channel Settings -> On startup or error -> Go to* the rig's `neutral_us`; *Apply Settings*. "Ignore" keeps the last
/// pulse. To be sure: run at low thrust, pull the cable, and see the thrusters stop.
#[derive(Debug)]
pub struct MaestroProtocol {
    responses: Responses,
    believable: (u16, u16),
    sets: VecDeque<OpenSet>,
    /// Requests encoded but not yet on the wire.
    unsent: Vec<Request>,
    unsent_set: Option<OpenSet>,
    next_errors_ns: u64,
    errors_bits: u16,
}

impl MaestroProtocol {
    /// Positions outside `min_us..=max_us` are not believed; answers later than `timeout_ns` are given up.
    pub fn new(min_us: f64, max_us: f64, timeout_ns: u64) -> Self {
        Self {
            // 10 ms: far longer than the gap between two bytes of an answer, far shorter than a command period.
            responses: Responses::new(timeout_ns, 10_000_000),
            believable: (
                ChannelPulse::from_us(0, min_us).quarter_us,
                ChannelPulse::from_us(0, max_us).quarter_us,
            ),
            sets: VecDeque::new(),
            unsent: Vec::new(),
            unsent_set: None,
            next_errors_ns: 0,
            errors_bits: 0,
        }
    }

    fn give_up(&mut self, events: &mut Vec<LinkEvent>) {
        if let Some(first) = self.sets.front() {
            events.push(LinkEvent::Unanswered {
                sequence: first.sequence,
                sets: self.sets.len(),
            });
        }
        self.sets.clear();
    }

    fn handle(&mut self, response: Response, at_ns: u64, events: &mut Vec<LinkEvent>) {
        match response {
            Response::Answer {
                request: Request::Errors,
                value,
            } => {
                self.errors_bits = value;
                if value == 0 {
                    events.push(LinkEvent::Alive);
                } else {
                    events.push(LinkEvent::Errors {
                        bits: u32::from(value),
                        names: maestro::error_names(value),
                    });
                }
            }
            Response::Answer {
                request: Request::Position { channel, .. },
                value,
            } => {
                let Some(set) = self.sets.front_mut() else {
                    return;
                };
                set.pulses.push(ChannelPulse {
                    channel,
                    quarter_us: value,
                });
                set.waiting -= 1;
                if set.waiting == 0
                    && let Some(set) = self.sets.pop_front()
                {
                    events.push(LinkEvent::Echo(Echo {
                        sequence: set.sequence,
                        pulses: set.pulses,
                        controller_time_us: 0,
                        received_ns: at_ns,
                        round_trip_ns: at_ns.saturating_sub(set.sent_ns),
                        errors: u32::from(self.errors_bits),
                    }));
                }
            }
            Response::Resync { lost, reason } => {
                events.push(LinkEvent::Garbage {
                    reason: format!("{reason:?}: {lost} open answers given up"),
                });
                self.give_up(events);
            }
        }
    }
}

impl Protocol for MaestroProtocol {
    fn bytes_per_set(&self, channels: usize) -> (usize, usize) {
        (channels * 6, channels * 2)
    }

    fn opened(&mut self, now_ns: u64, out: &mut Vec<u8>) {
        self.responses.reset();
        self.sets.clear();
        self.unsent.clear();
        self.unsent_set = None;
        // Two data bytes end a command that the last owner of the line may have left half sent, in the worst case as
        // a protocol error; Get Errors then clears the register and shows that someone is there.
        out.extend_from_slice(&[0, 0, maestro::GET_ERRORS]);
        self.unsent.push(Request::Errors);
        self.next_errors_ns = now_ns + ERRORS_EVERY_NS;
    }

    fn set_pulses(
        &mut self,
        sequence: u32,
        pulses: &[ChannelPulse],
        _neutral: bool,
        out: &mut Vec<u8>,
    ) {
        // Go Home is not used for neutral: the home position is a setting of the controller, the rig's neutral is ours.
        let encoded: Vec<_> = pulses
            .iter()
            .filter_map(|p| {
                Some((
                    p,
                    maestro::set_target(p.channel, p.quarter_us)?,
                    maestro::get_position(p.channel)?,
                ))
            })
            .collect();
        encoded
            .iter()
            .for_each(|(_, set, _)| out.extend_from_slice(set));
        let (min, max) = self.believable;
        for (pulse, _, get) in &encoded {
            out.extend_from_slice(get);
            self.unsent.push(Request::Position {
                channel: pulse.channel,
                min,
                max,
            });
        }
        self.unsent_set = Some(OpenSet {
            sequence,
            sent_ns: 0,
            waiting: encoded.len(),
            pulses: Vec::with_capacity(encoded.len()),
        });
    }

    fn housekeeping(&mut self, now_ns: u64, out: &mut Vec<u8>) {
        if now_ns >= self.next_errors_ns && !self.responses.resyncing(now_ns) {
            self.next_errors_ns = now_ns + ERRORS_EVERY_NS;
            out.push(maestro::GET_ERRORS);
            self.unsent.push(Request::Errors);
        }
    }

    fn sent(&mut self, last_byte_out_ns: u64) {
        for request in self.unsent.drain(..) {
            self.responses.expect(request, last_byte_out_ns);
        }
        if let Some(set) = self.unsent_set.take()
            && set.waiting > 0
        {
            self.sets.push_back(OpenSet {
                sent_ns: last_byte_out_ns,
                ..set
            });
        }
    }

    fn receive(&mut self, bytes: &[u8], at_ns: u64, events: &mut Vec<LinkEvent>) {
        for &byte in bytes {
            if let Some(response) = self.responses.feed(byte, at_ns) {
                self.handle(response, at_ns, events);
            }
        }
    }

    fn tick(&mut self, now_ns: u64, events: &mut Vec<LinkEvent>) {
        if let Some(response) = self.responses.tick(now_ns) {
            self.handle(response, now_ns, events);
        }
    }

    fn clock(&self) -> Option<Estimate> {
        None
    }
}

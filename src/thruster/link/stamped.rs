//! The `stamped` protocol behind [`Protocol`], with clock sync and reset detection.

use super::{Echo, LinkEvent, Protocol};
use crate::ChannelPulse;
use crate::clocksync::{Added, ClockSync, Estimate, Exchange, SyncSettings};
use crate::stamped::{ControllerMessage, Deframer, HostMessage, error};
use std::collections::VecDeque;

/// Settings of [`StampedProtocol`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StampedSettings {
    /// Controller's watchdog \[ms\].
    pub watchdog_ms: u16,
    /// Neutral \[us\].
    pub neutral_us: f64,
    /// Smallest pulse \[us\].
    pub min_us: f64,
    /// Largest pulse \[us\].
    pub max_us: f64,
    /// An answer later than this is given up \[ns\].
    pub timeout_ns: u64,
    /// Clock sync exchanges \[1/s\].
    pub sync_rate_hz: f64,
    /// The estimator.
    pub sync: SyncSettings,
}

/// `stamped` protocol, host side.
#[derive(Debug)]
pub struct StampedProtocol {
    settings: StampedSettings,
    deframer: Deframer,
    clock: ClockSync,
    sets: VecDeque<(u32, u64)>,
    unsent_set: Option<u32>,
    /// Token of the exchange on its way and its t1 (0 until the last byte is out).
    exchange: Option<(u64, u64)>,
    exchange_unsent: bool,
    next_sync_ns: u64,
    boot_id: Option<u16>,
    token: u32,
    /// Configure has to be sent (again).
    configure: bool,
}

impl StampedProtocol {
    /// Nothing sent yet.
    pub fn new(settings: StampedSettings) -> Self {
        Self {
            settings,
            deframer: Deframer::default(),
            clock: ClockSync::new(settings.sync),
            sets: VecDeque::new(),
            unsent_set: None,
            exchange: None,
            exchange_unsent: false,
            next_sync_ns: 0,
            boot_id: None,
            token: 0,
            configure: false,
        }
    }

    fn configure_frame(&mut self, out: &mut Vec<u8>) {
        self.token = self.token.wrapping_add(1);
        let q = |us: f64| ChannelPulse::from_us(0, us).quarter_us;
        HostMessage::Configure {
            token: self.token,
            watchdog_ms: self.settings.watchdog_ms,
            neutral: q(self.settings.neutral_us),
            min: q(self.settings.min_us),
            max: q(self.settings.max_us),
        }
        .encode(out);
        self.configure = false;
    }

    fn errors(bits: u16, events: &mut Vec<LinkEvent>) {
        if bits != 0 {
            events.push(LinkEvent::Errors {
                bits: u32::from(bits),
                names: error::names(bits),
            });
        }
    }

    fn seen_boot_id(&mut self, boot_id: u16, events: &mut Vec<LinkEvent>) {
        if let Some(old) = self.boot_id.replace(boot_id)
            && old != boot_id
        {
            self.configure = true;
            events.push(LinkEvent::Reset {
                reason: format!("boot id {old:#06x} became {boot_id:#06x}"),
            });
        }
    }

    /// A reset shows in the very next Ack, half a second before the next clock exchange would show it.
    ///
    /// The stamp has to lie between the command's departure and the answer's arrival: a host that was asleep
    /// in between is no reset.
    fn check_time(&mut self, time_us: u32, sent_ns: u64, at_ns: u64, events: &mut Vec<LinkEvent>) {
        let Some(estimate) = self.clock.estimate() else {
            return;
        };
        let ahead_us = |host_ns: u64| {
            let expected_us = estimate.controller_at_us(host_ns).max(0.0) as u64 as u32;
            f64::from(time_us.wrapping_sub(expected_us) as i32)
        };
        let allowed_us = self.settings.sync.reset_us + 5.0 * estimate.sd_at_us(at_ns);
        let (early_us, late_us) = (ahead_us(sent_ns), ahead_us(at_ns));
        let jump_us = if early_us < -allowed_us {
            early_us
        } else {
            late_us
        };
        if early_us < -allowed_us || late_us > allowed_us {
            self.clock.restart();
            self.boot_id = None;
            self.exchange = None;
            self.configure = true;
            events.push(LinkEvent::Reset {
                reason: format!("its clock jumped by {:.3} s", jump_us * 1e-6),
            });
        }
    }

    fn handle(&mut self, message: ControllerMessage, at_ns: u64, events: &mut Vec<LinkEvent>) {
        match message {
            ControllerMessage::Ack {
                sequence,
                time_us,
                errors,
                pulses,
            } => {
                Self::errors(errors, events);
                let Some(at) = self.sets.iter().position(|(s, _)| *s == sequence) else {
                    // Late (given up) or not ours: proof of life, but no echo.
                    events.push(LinkEvent::Alive);
                    return;
                };
                if at > 0 {
                    events.push(LinkEvent::Unanswered {
                        sequence: self.sets[0].0,
                        sets: at,
                    });
                }
                let sent_ns = self.sets[at].1;
                self.sets.drain(..=at);
                self.check_time(time_us, sent_ns, at_ns, events);
                events.push(LinkEvent::Echo(Echo {
                    sequence,
                    pulses,
                    controller_time_us: self.clock.unwrap(time_us, at_ns),
                    received_ns: at_ns,
                    round_trip_ns: at_ns.saturating_sub(sent_ns),
                    errors: u32::from(errors),
                }));
            }
            ControllerMessage::TimeSyncReply {
                host_us,
                rx_us,
                tx_us,
                boot_id,
            } => {
                events.push(LinkEvent::Alive);
                self.seen_boot_id(boot_id, events);
                let Some((_, t1_ns)) = self
                    .exchange
                    .take_if(|(token, t1_ns)| *token == host_us && *t1_ns != 0)
                else {
                    return;
                };
                match self.clock.add(Exchange {
                    t1_ns,
                    t2_us: rx_us,
                    t3_us: tx_us,
                    t4_ns: at_ns,
                    boot_id,
                }) {
                    Added::Reset { jump_us } if jump_us.is_finite() => {
                        self.configure = true;
                        events.push(LinkEvent::Reset {
                            reason: format!("its clock jumped by {:.3} s", jump_us * 1e-6),
                        });
                    }
                    Added::Refused { rtt_us } => events.push(LinkEvent::Garbage {
                        reason: format!(
                            "clock exchange with a round trip of {rtt_us:.0} us is impossible"
                        ),
                    }),
                    _ => {}
                }
                if let Some(estimate) = self.clock.estimate() {
                    events.push(LinkEvent::Clock(estimate));
                }
            }
            ControllerMessage::Status {
                boot_id, errors, ..
            } => {
                events.push(LinkEvent::Alive);
                Self::errors(errors, events);
                self.seen_boot_id(boot_id, events);
            }
        }
    }
}

impl Protocol for StampedProtocol {
    fn bytes_per_set(&self, channels: usize) -> (usize, usize) {
        // Raw + COBS code byte + delimiter; see stamped.md.
        (9 + 3 * channels + 2, 15 + 3 * channels + 2)
    }

    fn opened(&mut self, now_ns: u64, out: &mut Vec<u8>) {
        self.deframer = Deframer::default();
        self.sets.clear();
        self.unsent_set = None;
        self.exchange = None;
        self.exchange_unsent = false;
        // First syncs soon and close together: the estimate should be good when a plan starts.
        self.next_sync_ns = now_ns;
        // A delimiter ends whatever the last owner of the line left half sent.
        out.push(0);
        self.configure_frame(out);
    }

    fn set_pulses(
        &mut self,
        sequence: u32,
        pulses: &[ChannelPulse],
        neutral: bool,
        out: &mut Vec<u8>,
    ) {
        if neutral {
            HostMessage::Neutral { sequence }.encode(out);
        } else {
            HostMessage::SetPulses {
                sequence,
                pulses: pulses.to_vec(),
            }
            .encode(out);
        }
        self.unsent_set = Some(sequence);
    }

    fn housekeeping(&mut self, now_ns: u64, out: &mut Vec<u8>) {
        if self.configure {
            self.configure_frame(out);
            return;
        }
        // Not while a command is under way: the reply would wait behind its Ack in the controller's transmitter, and
        // half of that wait would be taken for clock offset.
        if now_ns >= self.next_sync_ns && self.sets.is_empty() {
            let host_us = now_ns / 1000;
            HostMessage::TimeSync { host_us }.encode(out);
            self.exchange = Some((host_us, 0));
            self.exchange_unsent = true;
            let quick = self.clock.estimate().is_none_or(|e| e.samples < 8);
            let period_s =
                1.0 / self.settings.sync_rate_hz.max(0.01) * if quick { 0.25 } else { 1.0 };
            self.next_sync_ns = now_ns + (period_s * 1e9) as u64;
        }
    }

    fn sent(&mut self, last_byte_out_ns: u64) {
        if let Some(sequence) = self.unsent_set.take() {
            self.sets.push_back((sequence, last_byte_out_ns));
        }
        if std::mem::take(&mut self.exchange_unsent)
            && let Some((_, t1_ns)) = &mut self.exchange
        {
            *t1_ns = last_byte_out_ns;
        }
    }

    fn receive(&mut self, bytes: &[u8], at_ns: u64, events: &mut Vec<LinkEvent>) {
        for &byte in bytes {
            match self
                .deframer
                .feed(byte)
                .map(|r| r.and_then(|payload| ControllerMessage::parse(&payload)))
            {
                Some(Ok(message)) => self.handle(message, at_ns, events),
                Some(Err(error)) => events.push(LinkEvent::Garbage {
                    reason: error.to_string(),
                }),
                None => {}
            }
        }
    }

    fn tick(&mut self, now_ns: u64, events: &mut Vec<LinkEvent>) {
        let old = |sent_ns: u64| now_ns > sent_ns.saturating_add(self.settings.timeout_ns);
        let late = self
            .sets
            .iter()
            .take_while(|(_, sent_ns)| old(*sent_ns))
            .count();
        if late > 0 {
            events.push(LinkEvent::Unanswered {
                sequence: self.sets[0].0,
                sets: late,
            });
            self.sets.drain(..late);
        }
    }

    fn clock(&self) -> Option<Estimate> {
        self.clock.estimate()
    }
}

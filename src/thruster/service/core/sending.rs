//! Set-points to bytes, through the gate; neutral past it.

use super::{Core, Outgoing, REPEAT_LOST_NS, REPEAT_NEUTRAL_NS, UNECHOED_SETS, Unechoed};
use crate::ChannelPulse;
use crate::curve::pulse_for_thrust;
use crate::record::CommandRecord;
use crate::safety::{NeutralReason, Refused, State};
use hydroline_core::event::{Severity, kind};

impl Core {
    pub(super) fn run_thrust(
        &mut self,
        thrust_n: &[f64],
        pulses_us: Option<Vec<f64>>,
        due_ns: u64,
        plan_step: u32,
        cause: &'static str,
    ) {
        let wanted = match pulses_us {
            Some(pulses_us) => Ok(pulses_us),
            None => self.invert(thrust_n),
        };
        let admitted = wanted.and_then(|mut wanted_us| {
            // A wrong number of values is the gate's to refuse, in its words.
            wanted_us.extend(thrust_n.iter().skip(wanted_us.len()).map(|_| f64::NAN));
            self.safety
                .admit(self.clock.monotonic_ns(), &wanted_us)
                .map_err(|e| match e {
                    Refused::Range { index, .. } => {
                        format!("{}: {e}", self.names.get(index).map_or("?", |n| n))
                    }
                    _ => e.to_string(),
                })
        });
        let admitted = match admitted {
            Ok(admitted) => admitted,
            Err(why) => {
                self.event(Severity::Error, &kind::THRUSTER_REFUSED, why, &[]);
                self.go_neutral(NeutralReason::Range, "a set-point was refused");
                return;
            }
        };
        if let Some((index, wanted_us)) = admitted.limited.filter(|_| admitted.ramp_begins) {
            let name = self.names[index].clone();
            let sent_us = admitted.pulses_us[index];
            let limit = self.config.set.max_slew_us_per_s;
            self.event(
                Severity::Warning,
                &kind::THRUSTER_SLEW_LIMITED,
                format!("{name}: {wanted_us:.2} us wanted, {sent_us:.2} us sent: ramping at {limit} us/s"),
                &[("wanted_us", wanted_us), ("sent_us", sent_us), ("limit_us_per_s", limit)],
            );
        }
        let thrust_n: Vec<f64> = self
            .config
            .set
            .thrusters
            .iter()
            .zip(&admitted.pulses_us)
            .zip(thrust_n)
            .map(|((t, sent), want)| {
                if admitted.limited.is_some() {
                    t.curve.thrust_n(*sent)
                } else {
                    *want
                }
            })
            .collect();
        if let Some(out_ns) = self.send(
            &admitted.pulses_us,
            &thrust_n,
            due_ns,
            plan_step,
            cause,
            false,
        ) {
            let late_ns = if due_ns == 0 {
                0
            } else {
                out_ns.saturating_sub(due_ns)
            };
            if late_ns > (self.config.set.link.deadline_s * 1e9) as u64 {
                self.missed(late_ns);
            }
        }
    }

    fn invert(&self, thrust_n: &[f64]) -> Result<Vec<f64>, String> {
        let set = &self.config.set;
        set.thrusters
            .iter()
            .zip(thrust_n)
            .map(|(t, thrust)| {
                pulse_for_thrust(&t.curve, set.neutral_us, *thrust)
                    .map_err(|e| format!("thruster {}: {e}", t.name))
            })
            .collect()
    }

    /// Writes one set; when its last byte is out \[ns\].
    pub(super) fn send(
        &mut self,
        pulses_us: &[f64],
        thrust_n: &[f64],
        due_ns: u64,
        plan_step: u32,
        cause: &'static str,
        neutral: bool,
    ) -> Option<u64> {
        let link = self.link.as_mut()?;
        let pulses: Vec<ChannelPulse> = self
            .config
            .set
            .thrusters
            .iter()
            .zip(pulses_us)
            .map(|(t, us)| ChannelPulse::from_us(t.channel, *us))
            .collect();
        self.sequence = self.sequence.wrapping_add(1);
        let sequence = self.sequence;
        let sent = match link.send(sequence, &pulses, neutral) {
            Ok(sent) => sent,
            Err(error) => {
                if !neutral {
                    self.at_rest = Some(false);
                }
                // Its number is taken and perhaps half of it is out: it is named with those queued before it.
                self.outbox.push_back(Outgoing {
                    sequence,
                    out_ns: u64::MAX,
                    records: Vec::new(),
                });
                self.lose(&error.to_string());
                return None;
            }
        };
        let triple = self.clock.triple();
        let records = self
            .names
            .iter()
            .zip(&pulses)
            .zip(thrust_n)
            .map(|((name, pulse), thrust_n)| CommandRecord {
                timestamp_ns: 0,
                sent_monotonic_ns: sent.last_byte_out_ns,
                sequence,
                thruster: name.clone(),
                thrust_n: *thrust_n,
                pulse_us: pulse.pulse_us(),
                due_ns: if due_ns == 0 {
                    0
                } else {
                    triple.monotonic_to_unix_ns(due_ns)
                },
                plan_step,
                cause,
            })
            .collect();
        if neutral {
            // A repeated neutral has a patience of its own.
            self.unechoed_since_ns = None;
            self.at_rest.get_or_insert(false);
        } else {
            self.unechoed_since_ns.get_or_insert(sent.last_byte_out_ns);
            self.at_rest = Some(false);
        }
        if self.unechoed.len() == UNECHOED_SETS {
            self.unechoed.pop_front();
        }
        let before = std::mem::replace(&mut self.last_pulses, pulses.clone());
        self.unechoed.push_back(Unechoed {
            sequence,
            pulses,
            before,
            neutral,
        });
        self.outbox.push_back(Outgoing {
            sequence,
            out_ns: sent.last_byte_out_ns,
            records,
        });
        self.shared.stats(|s| s.sets += 1);
        Some(sent.last_byte_out_ns)
    }

    pub(super) fn send_neutral(&mut self, reason: NeutralReason) {
        if self.config.set.link.follows() {
            return;
        }
        let set = &self.config.set;
        let pulses_us = vec![set.neutral_us; set.thrusters.len()];
        let thrust_n: Vec<f64> = set
            .thrusters
            .iter()
            .map(|t| t.curve.thrust_n(set.neutral_us))
            .collect();
        if self
            .send(&pulses_us, &thrust_n, 0, 0, reason.word(), true)
            .is_some()
        {
            let lost = self.safety.state() == State::Lost;
            let wait_ns = if lost {
                REPEAT_LOST_NS
            } else {
                REPEAT_NEUTRAL_NS
            };
            self.neutral_open = Some((self.sequence, self.now() + wait_ns));
        }
    }

    pub(super) fn go_neutral(&mut self, reason: NeutralReason, why: &str) {
        self.abort_plan(reason);
        self.feed_until_ns = None;
        if self.config.set.link.follows() {
            // The autopilot's thrusters are not ours to stop.
            return;
        }
        let was = self.safety.state();
        let (_, changed) = self.safety.neutral(reason, self.now());
        // First the bytes, then the words.
        self.send_neutral(reason);
        if changed {
            let severity = match reason {
                NeutralReason::Idle | NeutralReason::Request | NeutralReason::Exit => {
                    Severity::Info
                }
                _ if was == State::Running => Severity::Error,
                _ => Severity::Warning,
            };
            self.event(
                severity,
                &kind::THRUSTER_NEUTRAL,
                format!("thrusters to neutral ({reason}): {why}"),
                &[],
            );
        }
    }
}

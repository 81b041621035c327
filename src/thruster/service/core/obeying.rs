//! Does the controller obey? Its answers held against the commands, the errors that it reports, its clock's rate.

use super::{Core, Unechoed};
use crate::ChannelPulse;
use crate::clocksync::Estimate;
use crate::link::Echo;
use crate::safety::{NeutralReason, State};
use hydroline_core::event::{Severity, kind};
use hydroline_rigs::LinkKind;
use std::sync::Arc;

/// Resolution of both wires \[1/4 us\].
const RESOLUTION_QUARTER_US: u16 = 1;
/// Reports of errors without a sound answer between them that stop a plan, besides the time that they have to last: a Maestro
/// is asked twice a second, and two disturbances of its line may follow each other.
const FAULT_REPORTS_MIN: u32 = 3;
/// Rate of the controller's clock against the host's beyond which it is said \[ppm\]: a ceramic resonator is off by that much at
/// most (0.5 %), and its pulses by as much as its clock.
const CLOCK_RATE_MAX_PPM: f64 = 5000.0;
/// Exchanges before the rate is judged.
const CLOCK_SAMPLES_MIN: u32 = 8;

/// Echoes that say otherwise than what was sent.
pub(super) struct Contradiction {
    /// First of them \[ns\].
    since_ns: u64,
    /// The last of them, in words.
    words: String,
    values: Vec<(&'static str, f64)>,
}

/// Errors that every report of the controller has had for some time.
pub(super) struct Standing {
    /// First report \[ns\].
    since_ns: u64,
    /// Last report \[ns\].
    last_ns: u64,
    reports: u32,
    bits: u32,
    names: String,
}

/// How an echo differs from its command.
enum Difference {
    Pulse {
        sent: ChannelPulse,
        got: ChannelPulse,
    },
    /// A channel that was commanded is not in it.
    Missing { sent: ChannelPulse },
    /// A channel is in it that was not commanded.
    Surplus { got: ChannelPulse },
}

/// Difference of an echo from its command. `may_lag` = the pulse of the set before is none.
fn difference(of: &Unechoed, echo: &Echo, may_lag: bool) -> Option<Difference> {
    let near = |a: &ChannelPulse, b: &ChannelPulse| {
        a.quarter_us.abs_diff(b.quarter_us) <= RESOLUTION_QUARTER_US
    };
    for sent in &of.pulses {
        let mut there = false;
        for got in echo.pulses.iter().filter(|p| p.channel == sent.channel) {
            there = true;
            let mut before = of.before.iter().filter(|p| p.channel == sent.channel);
            let lags = may_lag && before.any(|before| near(before, got));
            if !near(sent, got) && !lags {
                return Some(Difference::Pulse {
                    sent: *sent,
                    got: *got,
                });
            }
        }
        if !there {
            return Some(Difference::Missing { sent: *sent });
        }
    }
    // Neutral is answered with all channels that the controller has.
    let commanded = |p: &&ChannelPulse| of.pulses.iter().any(|sent| sent.channel == p.channel);
    let surplus = echo.pulses.iter().find(|p| !of.neutral && !commanded(p));
    surplus.map(|got| Difference::Surplus { got: *got })
}

impl Core {
    /// Pulses that an echo has for a channel.
    fn of_channel(echo: &Echo, channel: u8) -> impl Iterator<Item = &ChannelPulse> {
        echo.pulses.iter().filter(move |p| p.channel == channel)
    }

    /// Whether an echo names every channel that is commanded: one without them confirms nothing.
    pub(super) fn is_in_full(&self, echo: &Echo) -> bool {
        let thrusters = &self.config.set.thrusters;
        thrusters
            .iter()
            .all(|t| Self::of_channel(echo, t.channel).next().is_some())
    }

    /// Whether an echo says of every thruster that it is at neutral.
    pub(super) fn confirms_neutral(&self, echo: &Echo) -> bool {
        let neutral = ChannelPulse::from_us(0, self.config.set.neutral_us).quarter_us;
        let thrusters = &self.config.set.thrusters;
        let rests = |channel| Self::of_channel(echo, channel).all(|p| p.quarter_us == neutral);
        self.is_in_full(echo) && thrusters.iter().all(|t| rests(t.channel))
    }

    /// A controller that talks but never confirms a set-point is not known to obey.
    pub(super) fn check_echoes(&mut self) {
        let Some(since_ns) = self.unechoed_since_ns else {
            return;
        };
        let unechoed_s = self.now().saturating_sub(since_ns) as f64 * 1e-9;
        let timeout_s = self.config.set.link.timeout_s;
        if unechoed_s > timeout_s && self.safety.state() == State::Running {
            self.event(
                Severity::Error,
                &kind::THRUSTER_NO_ECHO,
                format!(
                    "the controller answers, but has not echoed a command for {unechoed_s:.3} s \
                     ({timeout_s:.3} s are allowed): neutral"
                ),
                &[("unechoed_s", unechoed_s), ("allowed_s", timeout_s)],
            );
            self.go_neutral(NeutralReason::Lost, "no echo of the commands");
        }
    }

    /// A controller that goes on saying that it puts out something else does not obey. One wrong echo may be a byte
    /// that was disturbed (the Maestro has no check sum); without a sound one for as long as a silence may last, it is none.
    pub(super) fn check_contradiction(&mut self) {
        let Some(found) = &self.contradicted else {
            return;
        };
        let for_s = self.now().saturating_sub(found.since_ns) as f64 * 1e-9;
        let timeout_s = self.config.set.link.timeout_s;
        if for_s <= timeout_s || self.safety.state() != State::Running {
            return;
        }
        let message = format!(
            "{}: so for {for_s:.3} s ({timeout_s:.3} s are allowed): neutral; \
             check the controller's own limits, speed and acceleration, and that no other program drives it",
            found.words
        );
        let mut values = found.values.clone();
        values.extend([("for_s", for_s), ("allowed_s", timeout_s)]);
        self.event(
            Severity::Error,
            &kind::THRUSTER_CONTRADICTED,
            message,
            &values,
        );
        self.go_neutral(
            NeutralReason::Contradicted,
            "the controller contradicts the commands",
        );
    }

    /// Holds an echo against the command it answers.
    pub(super) fn compare(&mut self, echo: &Echo) {
        // A Maestro is asked for its position right behind the target, and may not have taken it over yet (it
        // refreshes its outputs once per servo frame): the pulse of the set before is no mistake there.
        let may_lag = self.config.set.link.kind == LinkKind::Maestro;
        while let Some(first) = self.unechoed.front()
            && first.sequence.wrapping_sub(echo.sequence) as i32 <= 0
            && let Some(first) = self.unechoed.pop_front()
        {
            if first.sequence != echo.sequence {
                continue;
            }
            let Some(found) = difference(&first, echo, may_lag) else {
                self.contradicted = None;
                continue;
            };
            let (words, values) = self.in_words(&found);
            self.noisy(Severity::Warning, &kind::THRUSTER_ECHO_MISMATCH, |n| {
                let mut values = values.clone();
                values.push(("count", n as f64));
                (format!("{words} ({n} sets like this)"), values)
            });
            let since_ns = self.contradicted.take().map(|c| c.since_ns);
            self.contradicted = Some(Contradiction {
                since_ns: since_ns.unwrap_or(echo.received_ns),
                words,
                values,
            });
        }
    }

    /// A difference in words and numbers.
    fn in_words(&self, found: &Difference) -> (String, Vec<(&'static str, f64)>) {
        let thrusters = &self.config.set.thrusters;
        let name = |channel: u8| {
            let index = thrusters.iter().position(|t| t.channel == channel);
            index.map_or_else(|| Arc::from("?"), |i| self.names[i].clone())
        };
        match found {
            Difference::Pulse { sent, got } => {
                let (sent_us, echo_us) = (sent.pulse_us(), got.pulse_us());
                let words = format!(
                    "{}: {sent_us:.2} us commanded, the controller puts out {echo_us:.2} us",
                    name(sent.channel)
                );
                (words, vec![("sent_us", sent_us), ("echo_us", echo_us)])
            }
            Difference::Missing { sent } => {
                let sent_us = sent.pulse_us();
                let words = format!(
                    "{}: {sent_us:.2} us commanded, the controller's answer says nothing of its channel {}",
                    name(sent.channel),
                    sent.channel
                );
                (words, vec![("sent_us", sent_us)])
            }
            Difference::Surplus { got } => {
                let echo_us = got.pulse_us();
                let words = format!(
                    "the controller answers with {echo_us:.2} us on channel {}, which was not commanded",
                    got.channel
                );
                (words, vec![("echo_us", echo_us)])
            }
        }
    }

    /// Notes errors that the controller reports.
    pub(super) fn reported(&mut self, bits: u32, names: &[&'static str]) {
        let now_ns = self.now();
        let standing = self.standing.get_or_insert_with(|| Standing {
            since_ns: now_ns,
            last_ns: now_ns,
            reports: 0,
            bits,
            names: String::new(),
        });
        standing.last_ns = now_ns;
        standing.reports = standing.reports.saturating_add(1);
        (standing.bits, standing.names) = (bits, names.join(", "));
    }

    /// Errors that every answer reports for longer than a silence may last are no disturbance: whatever the echoes say, what
    /// is put out is not known.
    pub(super) fn check_faults(&mut self) {
        let Some(found) = &self.standing else { return };
        let for_s = found.last_ns.saturating_sub(found.since_ns) as f64 * 1e-9;
        let timeout_s = self.config.set.link.timeout_s;
        let lasts = for_s > timeout_s && found.reports >= FAULT_REPORTS_MIN;
        if !lasts || self.safety.state() != State::Running {
            return;
        }
        let bits = f64::from(found.bits);
        let message = format!(
            "the controller reports {} without a break for {for_s:.3} s ({timeout_s:.3} s are allowed): neutral; check its \
             supply, its outputs and its cable",
            found.names
        );
        self.event(
            Severity::Error,
            &kind::THRUSTER_FAULT,
            message,
            &[("bits", bits), ("for_s", for_s), ("allowed_s", timeout_s)],
        );
        self.go_neutral(
            NeutralReason::Fault,
            "the controller goes on reporting errors",
        );
    }

    /// Says once of each start of the controller that its clock runs at another rate than a sound one does.
    pub(super) fn judge_clock(&mut self, estimate: &Estimate) {
        let Estimate {
            drift_ppm,
            drift_sd_ppm,
            samples,
            generation,
            ..
        } = *estimate;
        let surely_ppm = drift_ppm.abs() - 3.0 * drift_sd_ppm;
        if samples < CLOCK_SAMPLES_MIN
            || surely_ppm <= CLOCK_RATE_MAX_PPM
            || self.rate_said.replace(generation) == Some(generation)
        {
            return;
        }
        let percent = 1e-4 * drift_ppm.abs();
        let (way, pulses) = match drift_ppm > 0.0 {
            true => ("fast", "short"),
            false => ("slow", "long"),
        };
        let message = format!(
            "the controller's clock runs {percent:.2} % {way} against this computer's ({:.1} % are usual at most): its stamps are \
             converted, but its pulses are {percent:.2} % too {pulses} and its watchdog is off by as much: check its oscillator and \
             the clock setting of its firmware",
            1e-4 * CLOCK_RATE_MAX_PPM
        );
        self.event(
            Severity::Warning,
            &kind::THRUSTER_CLOCK_RATE,
            message,
            &[
                ("drift_ppm", drift_ppm),
                ("drift_sd_ppm", drift_sd_ppm),
                ("allowed_ppm", CLOCK_RATE_MAX_PPM),
            ],
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pulses(of: &[(u8, u16)]) -> Vec<ChannelPulse> {
        let pulse = |(channel, quarter_us): &(u8, u16)| ChannelPulse {
            channel: *channel,
            quarter_us: *quarter_us,
        };
        of.iter().map(pulse).collect()
    }

    #[test]
    fn an_answer_has_the_channels_that_were_commanded_no_fewer_and_no_others() {
        let sent = [(0, 6100), (3, 5900)];
        let agrees = |got: &[(u8, u16)], neutral: bool| {
            let of = Unechoed {
                sequence: 1,
                pulses: pulses(&sent),
                before: Vec::new(),
                neutral,
            };
            let echo = Echo {
                sequence: 1,
                pulses: pulses(got),
                controller_time_us: 0,
                received_ns: 0,
                round_trip_ns: 0,
                errors: 0,
            };
            difference(&of, &echo, false).is_none()
        };
        assert!(agrees(&sent, false) && agrees(&[(3, 5901), (0, 6099)], false));
        assert!(
            agrees(&[(0, 6100), (1, 6000), (3, 5900)], true),
            "neutral: all channels"
        );
        for got in [
            &[][..],
            &[(0, 6100)],
            &[(0, 6100), (4, 5900)],
            &[(0, 6100), (1, 6000), (3, 5900)],
            &[(0, 6100), (0, 6000), (3, 5900)],
            &[(0, 6100), (3, 5902)],
        ] {
            assert!(!agrees(got, false), "{got:?}");
        }
    }
}

//! Did the controller put out what it was sent? Commands against echoes, whatever the daemon said of it at the time.

use std::collections::{BTreeMap, VecDeque};

use crate::messages::{pb, unix_ns};

/// Sets remembered until their echo: more than any link leaves open.
const OPEN_SETS: usize = 64;
/// Both wires carry quarters of a microsecond; half a step more covers decimal rounding \[us\].
const SAME_US: f64 = 0.375;
/// Echoes of one thruster that contradict without a break for so long are no disturbed bytes \[s\]: the daemon's own
/// patience (`timeout_s`) is 0.3 s on the example rigs.
const CONTRADICTED_S: f64 = 0.5;

/// One thruster's commands and what came back.
#[derive(Debug, Default)]
struct Thruster {
    /// Sequence, pulse, and the pulse before: a Maestro may answer with that while it takes the new one over.
    open: VecDeque<(u32, f64, f64)>,
    last_pulse_us: Option<f64>,
    /// Of the contradiction that goes on: first stamp \[ns\].
    since_ns: Option<u64>,
    /// The longest so far \[s\], with what was sent and answered.
    worst: Option<(f64, f64, f64)>,
}

/// All thrusters' commands and echoes.
#[derive(Debug, Default)]
pub(super) struct Obeyed {
    thrusters: BTreeMap<String, Thruster>,
    /// Echoes held against their command, and those that differ.
    pub(super) compared: u64,
    pub(super) differ: u64,
}

/// A thruster whose controller went on contradicting.
#[derive(Debug, PartialEq)]
pub(super) struct Contradicted {
    pub(super) thruster: String,
    pub(super) for_s: f64,
    pub(super) sent_us: f64,
    pub(super) echo_us: f64,
}

impl Obeyed {
    pub(super) fn command(&mut self, c: &pb::ThrusterCommand) {
        // 0 = the link has no pulses.
        if !(c.pulse_us.is_finite() && c.pulse_us > 0.0) {
            return;
        }
        let t = self.thrusters.entry(c.thruster.clone()).or_default();
        let before_us = t.last_pulse_us.replace(c.pulse_us).unwrap_or(c.pulse_us);
        if t.open.len() == OPEN_SETS {
            t.open.pop_front();
        }
        t.open.push_back((c.sequence, c.pulse_us, before_us));
    }

    pub(super) fn echo(&mut self, e: &pb::ThrusterEcho) {
        let Some(t) = self.thrusters.get_mut(&e.thruster) else {
            return;
        };
        let Some(at) = t.open.iter().position(|(n, ..)| *n == e.sequence) else {
            return;
        };
        let Some((_, sent_us, before_us)) = t.open.drain(..=at).next_back() else {
            return;
        };
        self.compared += 1;
        let same = |us: f64| (us - e.pulse_us).abs() <= SAME_US;
        if same(sent_us) || same(before_us) {
            t.since_ns = None;
            return;
        }
        self.differ += 1;
        let at_ns = e.timestamp.as_ref().map_or(0, unix_ns);
        let since_ns = *t.since_ns.get_or_insert(at_ns);
        let for_s = at_ns.saturating_sub(since_ns) as f64 * 1e-9;
        if t.worst.is_none_or(|(longest_s, ..)| for_s >= longest_s) {
            t.worst = Some((for_s, sent_us, e.pulse_us));
        }
    }

    /// Thrusters contradicted for longer than disturbed bytes explain.
    pub(super) fn contradicted(&self) -> Vec<Contradicted> {
        let found = self.thrusters.iter().filter_map(|(name, t)| {
            let (for_s, sent_us, echo_us) = t.worst.filter(|w| w.0 >= CONTRADICTED_S)?;
            Some(Contradicted {
                thruster: name.clone(),
                for_s,
                sent_us,
                echo_us,
            })
        });
        found.collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::messages::timestamp;

    /// A set a tenth of a second from 1548 us up; what is answered is made of the set's pulse and the one before.
    fn heard(answer: impl Fn(u32, f64, f64) -> f64) -> Obeyed {
        let mut obeyed = Obeyed::default();
        for n in 0..30u32 {
            let pulse_us = 1548.0 + f64::from(n);
            obeyed.command(&pb::ThrusterCommand {
                sequence: n,
                thruster: "port".to_owned(),
                pulse_us,
                ..Default::default()
            });
            obeyed.echo(&pb::ThrusterEcho {
                timestamp: Some(timestamp(u64::from(n) * 100_000_000)),
                sequence: n,
                thruster: "port".to_owned(),
                pulse_us: answer(n, pulse_us, pulse_us - 1.0),
                ..Default::default()
            });
        }
        obeyed
    }

    #[test]
    fn an_obedient_controller_and_one_that_lags_a_set_are_not_blamed() {
        for obeyed in [heard(|_, now, _| now), heard(|_, _, before| before)] {
            assert_eq!(obeyed.compared, 30);
            // The first lagging answer differs: there was no set before.
            assert!(obeyed.differ <= 1 && obeyed.contradicted().is_empty());
        }
    }

    #[test]
    fn disturbed_bytes_are_counted_and_a_contradiction_is_named() {
        let disturbed = heard(|n, now, _| if n % 3 == 0 { 1900.0 } else { now });
        assert_eq!(disturbed.differ, 10);
        assert!(disturbed.contradicted().is_empty());
        let stuck = heard(|n, now, _| if n < 10 { now } else { 1900.0 });
        let found = stuck.contradicted();
        assert_eq!(found.len(), 1);
        assert!((found[0].for_s - 1.9).abs() < 1e-9, "{found:?}");
        assert_eq!((found[0].sent_us, found[0].echo_us), (1577.0, 1900.0));
    }
}

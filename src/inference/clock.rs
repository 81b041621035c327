//! Clocks of joined logs: how far the commands' stamps may be off those of the motion, as numbers of the likelihood.
//!
//! A command that acts later and a clock that is off by as much make the same motion. So what the joining leaves open of the clock is
//! fitted beside the vehicle, with the sd that the joining states as its prior: intervals hold it, and a latency is named only where
//! it is more than the clock may be off.

use std::borrow::Cow;

use hydroline_core::run::{PerChannel, Run};

use super::body::{Body, Own};

/// sd of the offset where it was estimated from the motion's answer to the commands: any latency is part of it \[s\].
const ESTIMATED_SD_S: f64 = 0.5;
/// sd of an offset of which nothing is known \[s\].
const UNKNOWN_SD_S: f64 = 10.0;
/// Largest sd of a drift \[ppm\]: no clock of a computer is off by more.
const DRIFT_MOST_PPM: f64 = 1000.0;
/// Change of the stamps by which derivatives are taken \[s\].
const STEP_S: f64 = 2e-3;

/// Clock of a joined log's commands against that of its motion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Clock {
    /// The log, by a digest of its name: its stretches have one clock.
    pub log: u64,
    /// sd of the offset \[s\].
    pub offset_sd_s: f64,
    /// sd of the drift \[ppm\]; 0 = none is possible.
    pub drift_sd_ppm: f64,
}

impl Clock {
    /// Of a run; `None` where commands and motion are of one clock, or nothing of it is open.
    pub fn of(run: &Run) -> Option<Clock> {
        let joined = run.joined?;
        let stated = if joined.offset_sd_s.is_finite() {
            joined.offset_sd_s
        } else {
            UNKNOWN_SD_S
        };
        let clock = Clock {
            log: digest(&run.name),
            offset_sd_s: match joined.is_estimated {
                true => stated.max(ESTIMATED_SD_S),
                false => stated,
            },
            drift_sd_ppm: joined.drift_sd_ppm.min(DRIFT_MOST_PPM),
        };
        (clock.offset_sd_s > 0.0 || clock.drift_sd_ppm > 0.0).then_some(clock)
    }

    /// What of it is open, as numbers of a body.
    pub(super) fn numbers(self) -> impl Iterator<Item = Own> {
        let offset = (self.offset_sd_s > 0.0).then_some(Own::ClockOffset(self));
        let drift = (self.drift_sd_ppm > 0.0).then_some(Own::ClockDrift(self));
        offset.into_iter().chain(drift)
    }
}

/// Digest of a log's name, without the stretch behind an `@`.
fn digest(name: &str) -> u64 {
    let log = name.split('@').next().unwrap_or(name);
    let bytes = log.bytes();
    bytes.fold(0xcbf2_9ce4_8422_2325, |h, b| {
        (h ^ u64::from(b)).wrapping_mul(0x0100_0000_01b3)
    })
}

impl Body {
    /// Commands of a run on the motion's clock, where the vehicle's numbers are these.
    pub(super) fn commands(&self, index: usize, natural: &[f64]) -> Cow<'_, [(f64, [f64; 6])]> {
        let r = &self.recording.runs[index];
        let (mut offset_s, mut drift) = (0.0, 0.0);
        for (own, value) in self.own.iter().zip(natural) {
            match own {
                Own::ClockOffset(c) if r.clock == Some(*c) => offset_s += value,
                Own::ClockDrift(c) if r.clock == Some(*c) => drift += value,
                _ => {}
            }
        }
        let Some(((start_s, first), later)) = r.commands.split_first() else {
            return Cow::Borrowed(&r.commands);
        };
        if offset_s == 0.0 && drift == 0.0 {
            return Cow::Borrowed(&r.commands);
        }
        let mut made = vec![(*start_s, *first)];
        for (t_s, wrench) in later {
            let at_s = t_s + offset_s + drift * (t_s - start_s);
            if at_s > *start_s {
                made.push((at_s, *wrench));
            } else {
                // It was in force at the start already.
                made[0].1 = *wrench;
            }
        }
        Cow::Owned(made)
    }

    /// Numbers of a run's clock, by their places, with steps for derivatives.
    pub(super) fn clock_steps(&self, index: usize) -> Vec<(usize, f64)> {
        let r = &self.recording.runs[index];
        let span_s = r.times_s.last().map_or(1.0, |t| (t - r.start_s).max(1.0));
        let own = self.own.iter().enumerate();
        own.filter_map(|(i, own)| match own {
            Own::ClockOffset(c) if r.clock == Some(*c) => Some((i, STEP_S)),
            Own::ClockDrift(c) if r.clock == Some(*c) => Some((i, STEP_S / span_s)),
            _ => None,
        })
        .collect()
    }
}

/// Derivative by a step, sample by sample.
pub(super) fn by_step(
    moved: &[PerChannel<f64>],
    from: &[PerChannel<f64>],
    step: f64,
) -> Vec<PerChannel<f64>> {
    let pairs = moved.iter().zip(from);
    pairs
        .map(|(a, b)| PerChannel::from_fn(|c| (a[c] - b[c]) / step))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fit::{Effort, Problem};
    use crate::hyper::{Cell, Cells};
    use crate::recording::Recording;
    use crate::tests::fixtures::Tank;
    use hydroline_core::run::Joined;

    /// Two surge runs whose commands are stamped `late_s` too early.
    fn joined(late_s: f64, sd_s: f64) -> (Body, Tank) {
        let tank = Tank {
            seconds: 16.0,
            hz: 12.5,
            coloured: 0.0,
            ..Tank::new(&[0], vec![])
        };
        let mut runs = tank.runs(2, 3);
        for run in &mut runs {
            run.joined = Some(Joined {
                is_estimated: false,
                offset_sd_s: sd_s,
                drift_sd_ppm: 0.0,
            });
            for c in &mut run.commands {
                c.t_s = (c.t_s - late_s).max(0.0);
            }
        }
        let recording = Recording::new(&runs, 0.0);
        (Body::plain(recording, &tank.rig, &[0]).unwrap(), tank)
    }

    #[test]
    fn the_derivative_by_the_offset_is_that_of_central_differences() {
        let (body, _) = joined(0.0, 0.02);
        let places: Vec<usize> = (0..body.own.len())
            .filter(|i| matches!(body.own[*i], Own::ClockOffset(_)))
            .collect();
        assert_eq!(places.len(), 2, "one for each log");
        let mut at = body.begin();
        at[places[0]] = 0.7;
        let made = body.simulated(0, &[], &at);
        let (_, column) = made.columns.iter().find(|c| c.0 == places[0]).unwrap();
        let moved = |by: f64| {
            let mut there = at.clone();
            there[places[0]] += by;
            body.values(0, &[], &there)
        };
        let (up, down) = (moved(0.05), moved(-0.05));
        let x = hydroline_core::run::Channel::X;
        let largest = column.iter().fold(0.0_f64, |m, v| m.max(v[x].abs()));
        for k in 0..column.len() {
            let wanted = (up[k][x] - down[k][x]) / 0.1;
            assert!((column[k][x] - wanted).abs() < 0.02 * largest, "{k}");
        }
        // The other log has a clock of its own.
        let other = body.simulated(1, &[], &at);
        let (_, column) = other.columns.iter().find(|c| c.0 == places[0]).unwrap();
        assert!(column.iter().all(|v| v[x] == 0.0));
    }

    #[test]
    fn an_offset_within_its_sd_is_found() {
        let (body, _) = joined(0.03, 0.03);
        let place = body
            .own
            .iter()
            .position(|o| matches!(o, Own::ClockOffset(_)));
        let place = place.unwrap();
        let problem = Problem::of(body, PerChannel::splat(None));
        let begin = problem.body.begin();
        let none = Cells::of([Cell::default(); 6]);
        let fit = problem.fit(&[], &begin, none, Effort::default()).unwrap();
        let (found_s, slope) = problem.body.natural(&[], &fit.point)[place];
        let sd_s = slope * fit.covariance[(place, place)].sqrt();
        assert!(
            (found_s - 0.03).abs() < 4.0 * sd_s.max(5e-4),
            "{found_s} {sd_s}"
        );
        assert!(sd_s < 0.01, "{sd_s}");
    }
}

//! Measurements: all channels of all runs, in the axes in which noise and random forces are described.
//!
//! Errors of x and y are looked at along the body's own axes (rotated by the measured heading): there a DOF's misfit shows
//! in that DOF's channel. The turn is the same for every model, so that likelihoods compare.

use std::collections::BTreeMap;

use hydroline_core::run::Channel::{Psi, X, Y};
use hydroline_core::run::{COMPANIONS, Channel, Companions, PerChannel, Run, Sample, start_s};
use hydroline_numerics::noise::Noise;
use hydroline_numerics::statistics::{median, robust_sd};

use super::clock::Clock;
use super::smooth::fast_sd;

/// Commands that come faster than this on average are averaged over it \[s\]: the impulse stays, and a vehicle with time
/// constants of a tenth of a second and more feels no difference.
const HOLD_S: f64 = 0.02;
/// Samples per second looked at: of denser ones every second, third … \[1/s\]. Slow motion and correlated noise say no
/// more with more of them.
const RATE_MOST_HZ: f64 = 60.0;
/// Samples of all runs from which fewer per second are looked at, and the rate that is left at the least \[1/s\]: what a fit
/// costs goes with them, and minutes of a slow ship at 20 Hz say what they say at 10. Two and a half times four runs of 24 s
/// at 25 Hz.
const SAMPLES_MOST: f64 = 6000.0;
/// See there: an answer of a tenth of a second still shows.
const RATE_LEAST_HZ: f64 = 10.0;

/// Commands as they are, or where they come faster than [`HOLD_S`] the mean load over each such while.
pub fn averaged<const N: usize>(commands: Vec<(f64, [f64; N])>) -> Vec<(f64, [f64; N])> {
    let (Some(first), Some(last)) = (commands.first(), commands.last()) else {
        return commands;
    };
    let (begin_s, span_s) = (first.0, last.0 - first.0);
    if (commands.len() - 1) as f64 * HOLD_S <= span_s {
        return commands;
    }
    let whiles = (span_s / HOLD_S) as usize;
    let mut made: Vec<(f64, [f64; N])> = Vec::with_capacity(whiles + 2);
    let (mut next, mut load) = (0, [0.0; N]);
    let mut push = |t_s: f64, w: [f64; N]| {
        if made.last().is_none_or(|e: &(f64, [f64; N])| e.1 != w) {
            made.push((t_s, w));
        }
    };
    for k in 0..=whiles {
        let from_s = begin_s + HOLD_S * k as f64;
        let to_s = begin_s + HOLD_S * (k + 1) as f64;
        let (mut now_s, mut impulse) = (from_s, [0.0; N]);
        // The last while takes every command that is left: its end may be the last one's time, rounded.
        while let Some((t_s, new)) = commands.get(next).filter(|e| k == whiles || e.0 < to_s) {
            let held_s = (t_s - now_s).max(0.0);
            impulse = std::array::from_fn(|d| impulse[d] + load[d] * held_s);
            now_s = t_s.max(now_s);
            load = *new;
            next += 1;
        }
        push(
            from_s,
            std::array::from_fn(|d| (impulse[d] + load[d] * (to_s - now_s)) / HOLD_S),
        );
    }
    // The load behind the last command holds from the end of its while.
    push(begin_s + HOLD_S * (whiles + 1) as f64, load);
    made
}

/// Samples per second that are looked at.
fn rate_most_hz(runs: &[Run]) -> f64 {
    let long_s = |r: &Run| match r.samples.as_slice() {
        [first, .., last] => last.t_s - first.t_s,
        _ => 0.0,
    };
    let whole_s: f64 = runs.iter().map(long_s).sum();
    (SAMPLES_MOST / whole_s.max(1.0)).clamp(RATE_LEAST_HZ, RATE_MOST_HZ)
}

/// Every n-th of the samples that measure the same channels, where there are more per second: rows of several instruments
/// stand between each other.
fn thinned(run: &Run, most_hz: f64) -> Vec<&Sample> {
    let measured = |s: &Sample| s.values.map(f64::is_finite);
    let mut counts: BTreeMap<PerChannel<bool>, usize> = BTreeMap::new();
    for s in &run.samples {
        *counts.entry(measured(s)).or_default() += 1;
    }
    let long_s = match run.samples.as_slice() {
        [first, .., last] => (last.t_s - first.t_s).max(1e-9),
        _ => return run.samples.iter().collect(),
    };
    let every = |count: usize| {
        let rate_hz = count as f64 / long_s;
        let wanted = (rate_hz / most_hz - 1e-2).ceil();
        wanted
            .min((rate_hz / RATE_LEAST_HZ + 1e-2).floor())
            .max(1.0) as usize
    };
    let every: BTreeMap<PerChannel<bool>, usize> =
        counts.into_iter().map(|(set, n)| (set, every(n))).collect();
    let mut seen: BTreeMap<PerChannel<bool>, usize> = BTreeMap::new();
    let mut kept = Vec::new();
    for s in &run.samples {
        let set = measured(s);
        let place = seen.entry(set).or_default();
        if every.get(&set).is_none_or(|n| place.is_multiple_of(*n)) {
            kept.push(s);
        }
        *place += 1;
    }
    kept
}

/// One run.
#[derive(Debug, Clone)]
pub struct Recorded {
    /// Name of the run.
    pub name: String,
    /// Stamps \[s since the log's first stamp\].
    pub times_s: Vec<f64>,
    /// Where the state is given \[s\].
    pub start_s: f64,
    /// Measured motion \[SI\]; NaN = not measured.
    pub values: Vec<PerChannel<f64>>,
    /// Standard deviation of each pose channel as logged, of x and y along the body's axes; NaN = unknown.
    pub logged_sd: Vec<[f64; 6]>,
    /// The same over the recording's, within [`SD_RATIO_MOST`]: a sample's white noise over the instrument's.
    pub sd_ratio: Vec<[f64; 6]>,
    /// Least noise of each channel as the import states it, along the body's axes the smaller of x and y; 0 = not stated.
    pub stated_sd: PerChannel<f64>,
    /// (time, body wrench), from `start_s` on.
    pub commands: Vec<(f64, [f64; 6])>,
    /// (sine, cosine) of the heading at each stamp.
    pub heading: Vec<(f64, f64)>,
    /// Companions, measured beside the motion.
    pub companions: Companions,
    /// Clock of the commands, where it is another than the motion's and is not known exactly.
    pub clock: Option<Clock>,
}

/// All runs.
#[derive(Debug, Clone)]
pub struct Recording {
    /// Runs; samples denser than are looked at are thinned out.
    pub runs: Vec<Recorded>,
    /// Channels that any run measured.
    pub channels: PerChannel<bool>,
    /// Each pose channel's sd as logged, of a sample that says as much as the mean one: its noise is the instrument's; NaN = unknown.
    pub logged_sd: [f64; 6],
}

/// A logged sd this many times the recording's, or its inverse, counts as that far: one sample that claims to be perfect must
/// not carry a run.
const SD_RATIO_MOST: f64 = 20.0;

impl Recording {
    /// Takes runs over.
    ///
    /// `heading_rad` where psi was not measured.
    pub fn new(runs: &[Run], heading_rad: f64) -> Recording {
        let most_hz = rate_most_hz(runs);
        let each = runs.iter().map(|r| Recorded::new(r, heading_rad, most_hz));
        let runs: Vec<Recorded> = each.collect();
        let channels = PerChannel::from_fn(|c| runs.iter().any(|r| r.has(c)));
        let logged = |d: usize| {
            let of = |r: &Recorded| -> Vec<f64> {
                let each = r.logged_sd.iter().enumerate();
                let there = each.filter(|(k, _)| r.values[*k][Channel::POSES[d]].is_finite());
                there.map(|(_, sd)| sd[d]).collect()
            };
            let mut all: Vec<f64> = runs.iter().flat_map(of).collect();
            all.retain(|sd| sd.is_finite());
            let least = median(&mut all).unwrap_or(f64::NAN) / SD_RATIO_MOST;
            let information: f64 = all.iter().map(|sd| sd.max(least).powi(-2)).sum();
            (all.len() as f64 / information).sqrt()
        };
        let mut made = Recording {
            logged_sd: std::array::from_fn(logged),
            runs,
            channels,
        };
        made.refer_to(made.logged_sd);
        made
    }

    /// Takes logged sds beside those of another recording, whose instruments' noise is known.
    pub fn refer_to(&mut self, logged_sd: [f64; 6]) {
        self.logged_sd = logged_sd;
        for r in &mut self.runs {
            let ratio = |sds: &[f64; 6]| {
                std::array::from_fn(|d| match sds[d] / logged_sd[d] {
                    ratio if ratio.is_finite() => ratio.clamp(1.0 / SD_RATIO_MOST, SD_RATIO_MOST),
                    _ => 1.0,
                })
            };
            r.sd_ratio = r.logged_sd.iter().map(ratio).collect();
        }
    }

    /// Turns every run by its median heading: where yaw does not move, its noise is none of x and y.
    pub fn hold_heading(&mut self) {
        for r in &mut self.runs {
            let mut seen: Vec<f64> = r.heading.iter().map(|(s, c)| s.atan2(*c)).collect();
            let turn = median(&mut seen).unwrap_or(0.0).sin_cos();
            r.heading.iter_mut().for_each(|h| *h = turn);
        }
    }

    /// Whether a DOF is measured, by its pose or its rate.
    pub fn measures(&self, dof: usize) -> bool {
        Channel::of(dof).iter().any(|c| self.channels[*c])
    }

    /// Channel by which a DOF is known: its pose where that is measured, else its rate.
    pub fn channel_of(&self, dof: usize) -> Channel {
        let [place, rate] = Channel::of(dof);
        if self.channels[place] { place } else { rate }
    }

    /// Whether any command drives a DOF.
    fn drives(&self, dof: usize) -> bool {
        let mut commands = self.runs.iter().flat_map(|r| &r.commands);
        commands.any(|c| c.1[dof] != 0.0)
    }
}

/// Robust deviation of a channel's means from their median, over what noise leaves of them, from which a DOF is said to
/// move.
pub const MOVES: f64 = 3.0;
/// Time over which these means are taken \[s\]: an instrument's noise must not hide a slow motion that others feel (a
/// Doppler log's heave, by which surge pitches).
const MEAN_S: f64 = 1.0;

/// Means of the values there are within each [`MEAN_S`], and of how many one is, usually.
fn means(times_s: &[f64], values: &[f64]) -> (Vec<f64>, f64) {
    let mut made: Vec<(i64, f64, f64)> = Vec::new();
    for (t_s, v) in times_s.iter().zip(values).filter(|(_, v)| v.is_finite()) {
        let place = (t_s / MEAN_S).floor() as i64;
        match made.last_mut() {
            Some((at, sum, n)) if *at == place => {
                *sum += v;
                *n += 1.0;
            }
            _ => made.push((place, *v, 1.0)),
        }
    }
    let mut counts: Vec<f64> = made.iter().map(|m| m.2).collect();
    let usual = median(&mut counts).unwrap_or(1.0);
    (made.into_iter().map(|(_, sum, n)| sum / n).collect(), usual)
}

/// Robust sd of values about their median.
fn off_median(mut values: Vec<f64>) -> f64 {
    let middle = median(&mut values).unwrap_or(0.0);
    values.iter_mut().for_each(|v| *v -= middle);
    robust_sd(&values)
}

impl Recording {
    /// DOFs that are driven, or whose values or means over a second move by more than their noise and a third of the tolerance.
    pub fn moving(&self, tolerance: &PerChannel<f64>) -> Vec<usize> {
        let moves = |c: Channel| {
            self.channels[c]
                && self.runs.iter().any(|r| {
                    let all: Vec<f64> = (0..r.values.len()).map(|k| r.measured(k)[c]).collect();
                    let seen: Vec<f64> = all.iter().copied().filter(|v| v.is_finite()).collect();
                    let second: Vec<f64> =
                        seen.windows(3).map(|w| w[0] - 2.0 * w[1] + w[2]).collect();
                    let fast = robust_sd(&second) / 6f64.sqrt();
                    let (slow, of) = means(&r.times_s, &all);
                    let least = tolerance[c] / 3.0;
                    // The means of a swing within a second say nothing: its values are asked as well.
                    off_median(slow) > (MOVES * fast / of.sqrt()).max(least)
                        || off_median(seen) > (MOVES * fast).max(least)
                })
        };
        let asked = |d: &usize| {
            (self.measures(*d) && self.drives(*d)) || Channel::of(*d).into_iter().any(moves)
        };
        (0..6).filter(asked).collect()
    }
}

impl Recording {
    /// DOFs that some command drives in any run.
    pub fn driven(&self) -> Vec<usize> {
        (0..6).filter(|d| self.drives(*d)).collect()
    }

    /// Per run, sample and channel whether a channel with a noise was measured.
    pub fn measured_of(&self, channels: &PerChannel<Option<Noise>>) -> Vec<Vec<PerChannel<bool>>> {
        let each = self.runs.iter().map(|r| {
            let counts = |k: usize| {
                let m = r.measured(k);
                PerChannel::from_fn(|c| channels[c].is_some() && m[c].is_finite())
            };
            (0..r.times_s.len()).map(counts).collect()
        });
        each.collect()
    }

    /// Companions that move in any run: by more than their noise.
    pub fn companions_moving(&self) -> [bool; COMPANIONS.len()] {
        std::array::from_fn(|c| {
            self.runs.iter().any(|r| {
                let (_, values) = r.companions.measured(c);
                let n = values.len().max(1) as f64;
                let mean = values.iter().sum::<f64>() / n;
                let square = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n;
                // A rudder is mostly held: its spread is asked, not its usual one.
                fast_sd(values.into_iter()).is_some_and(|fast| square.sqrt() > MOVES * fast)
            })
        })
    }
}

impl Recorded {
    pub(super) fn new(run: &Run, heading_rad: f64, most_hz: f64) -> Recorded {
        let samples = thinned(run, most_hz);
        let times_s: Vec<f64> = samples.iter().map(|s| s.t_s).collect();
        let start_s = start_s(&times_s);
        let values: Vec<PerChannel<f64>> = samples.iter().map(|s| s.values).collect();
        let both = run.has(X) && run.has(Y);
        let mut last = values.iter().map(|v| v[Psi]).find(|v| v.is_finite());
        let heading = values
            .iter()
            .map(|v| {
                if v[Psi].is_finite() {
                    last = Some(v[Psi]);
                }
                // One coordinate alone cannot be rotated.
                let psi = if both {
                    last.unwrap_or(heading_rad)
                } else {
                    0.0
                };
                psi.sin_cos()
            })
            .collect();
        let headings: &Vec<(f64, f64)> = &heading;
        let logged_sd: Vec<[f64; 6]> = samples
            .iter()
            .zip(headings)
            .map(|(s, (sin, cos))| {
                let mut sds = Channel::POSES.map(|c| s.sd(c).unwrap_or(f64::NAN));
                if let Some(pose) = s.covariance.as_deref().filter(|_| both) {
                    let across = sin * cos * (pose[1] + pose[6]);
                    sds[0] = (cos * cos * pose[0] + across + sin * sin * pose[7]).sqrt();
                    sds[1] = (sin * sin * pose[0] - across + cos * cos * pose[7]).sqrt();
                }
                sds.map(|sd| if sd > 0.0 { sd } else { f64::NAN })
            })
            .collect();
        let mut stated_sd = run.instrument_sd;
        if both {
            // Rotated, either may stand for the other.
            let least = stated_sd[X].min(stated_sd[Y]);
            (stated_sd[X], stated_sd[Y]) = (least, least);
        }
        let mut commands: Vec<(f64, [f64; 6])> = vec![(start_s, run.wrench_at(start_s))];
        let later = run.commands.iter().filter(|c| c.t_s > start_s);
        commands.extend(later.map(|c| (c.t_s, c.wrench)));
        Recorded {
            name: run.name.clone(),
            times_s,
            start_s,
            values,
            sd_ratio: vec![[1.0; 6]; logged_sd.len()],
            logged_sd,
            stated_sd,
            commands: averaged(commands),
            heading,
            companions: run.companions.clone(),
            clock: Clock::of(run),
        }
    }

    /// White sd of a channel at sample `k` over its instrument's, for a filter; 0 = the sample does not count.
    pub fn sd_ratio_of(&self, k: usize, channel: Channel, counts: bool) -> f64 {
        match (counts, channel.is_rate()) {
            (false, _) => 0.0,
            (true, true) => 1.0,
            (true, false) => self.sd_ratio[k][channel.index()],
        }
    }

    /// A state's channels with x and y rotated into the body's axes at sample `k`.
    pub fn rotated<T: hydroline_sim::Real>(
        &self,
        k: usize,
        mut state: PerChannel<T>,
    ) -> PerChannel<T> {
        let (sin, cos) = self.heading[k];
        let (x, y) = (state[X], state[Y]);
        state[X] = x * cos + y * sin;
        state[Y] = y * cos - x * sin;
        state
    }

    /// Channels measured at sample `k`, rotated likewise; a heading of 0 leaves a single coordinate as it is.
    pub fn measured(&self, k: usize) -> PerChannel<f64> {
        let mut v = self.values[k];
        if v[X].is_finite() && v[Y].is_finite() {
            v = self.rotated(k, v);
        } else if self.heading[k].0 != 0.0 {
            // One of two is missing here: neither can be rotated.
            v[X] = f64::NAN;
            v[Y] = f64::NAN;
        }
        v
    }

    /// Values of a channel where it is measured.
    pub fn seen(&self, channel: Channel) -> impl Iterator<Item = f64> + Clone {
        let all = self.values.iter().map(move |v| v[channel]);
        all.filter(|v| v.is_finite())
    }

    /// First of them.
    pub fn first(&self, channel: Channel) -> Option<f64> {
        self.seen(channel).next()
    }

    /// Whether a channel is measured at all.
    pub fn has(&self, channel: Channel) -> bool {
        self.first(channel).is_some()
    }
}

#[cfg(test)]
mod tests {
    use super::{Recording, averaged};
    use hydroline_core::run::{Channel, PerChannel, Run, Sample};
    use proptest::prelude::*;
    use rand::{SeedableRng, rngs::StdRng};
    use rand_distr::{Distribution, StandardNormal};

    fn tolerance() -> PerChannel<f64> {
        PerChannel::splat(2e-3)
    }

    /// Surge and heave rates of a Doppler log, of sd 1.5 mm/s each.
    fn doppler(heave_mps: f64, seconds: f64, seed: u64) -> Run {
        let mut rng = StdRng::seed_from_u64(seed);
        let mut noise = || -> f64 { StandardNormal.sample(&mut rng) };
        let sample = |k: u32| {
            let t_s = f64::from(k) / 25.0;
            let mut values = PerChannel::NAN;
            values[Channel::U] = 0.1 * (0.8 * t_s).sin() + 1.5e-3 * noise();
            values[Channel::W] = heave_mps * (0.9 * t_s).sin() + 1.5e-3 * noise();
            Sample {
                t_s,
                values,
                covariance: None,
            }
        };
        Run {
            samples: (0..(25.0 * seconds) as u32).map(sample).collect(),
            ..Run::default()
        }
    }

    /// Noise as large as the heave hid it, and what heave does to pitch was named fluid memory.
    #[test]
    fn a_doppler_logs_noise_hides_no_heave() {
        for seed in 0..20 {
            let moving = |heave_mps| {
                Recording::new(&[doppler(heave_mps, 24.0, seed)], 0.0).moving(&tolerance())
            };
            assert_eq!(moving(1.8e-3), [0, 2], "{seed}");
            assert_eq!(moving(0.0), [0], "{seed}");
        }
    }

    #[test]
    fn long_runs_are_looked_at_less_often() {
        let count = |runs: &[Run]| -> usize {
            let made = Recording::new(runs, 0.0);
            made.runs.iter().map(|r| r.times_s.len()).sum()
        };
        let short: Vec<Run> = (0..4).map(|s| doppler(0.0, 24.0, s)).collect();
        assert_eq!(count(&short), 2400);
        assert_eq!(count(&[doppler(0.0, 400.0, 1)]), 5000);
        // Never below ten per second.
        assert!(count(&[doppler(0.0, 2000.0, 1)]) >= 20_000);
        // Two instruments row by row: each keeps its own.
        let mut both = doppler(0.0, 400.0, 1);
        for (k, s) in both.samples.iter_mut().enumerate() {
            s.values[if k % 2 == 0 { Channel::U } else { Channel::W }] = f64::NAN;
        }
        let made = Recording::new(&[both], 0.0);
        let seen = |c: Channel| {
            made.runs[0]
                .values
                .iter()
                .filter(|v| v[c].is_finite())
                .count()
        };
        let [surge, heave] = [Channel::U, Channel::W].map(seen);
        assert!(surge > 3000 && heave > 3000, "{surge} {heave}");
    }

    proptest! {
        /// Dense commands keep their impulse and the last load; sparse ones stay.
        #[test]
        fn dense_commands_keep_their_impulse(gap_s in 1e-3..0.019f64, count in 20usize..900, begin_s in 0.0..5.0f64) {
            let load = |k: usize| if k + 1 == count { 0.0 } else { (0.37 * k as f64).sin() };
            let commands: Vec<(f64, [f64; 6])> = (0..count)
                .map(|k| (begin_s + gap_s * k as f64, [load(k), 0.0, 0.0, 0.0, -load(k), 1.0]))
                .collect();
            let made = averaged(commands.clone());
            let end_s = commands[count - 1].0 + 1.0;
            let impulse = |all: &[(f64, [f64; 6])], d: usize| -> f64 {
                let until = all.iter().skip(1).map(|c| c.0).chain([end_s]);
                all.iter().zip(until).map(|(c, to)| c.1[d] * (to - c.0)).sum()
            };
            for d in [0, 4, 5] {
                prop_assert!((impulse(&commands, d) - impulse(&made, d)).abs() < 1e-9 * count as f64);
            }
            prop_assert_eq!(made.last().map(|c| c.1), commands.last().map(|c| c.1));
        }

        #[test]
        fn sparse_commands_stay(gap_s in 0.021..3.0f64, count in 1usize..30) {
            let commands: Vec<(f64, [f64; 6])> = (0..count).map(|k| (gap_s * k as f64, [k as f64; 6])).collect();
            prop_assert_eq!(averaged(commands.clone()), commands);
        }
    }
}

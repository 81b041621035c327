//! Noise of the instruments, before any model and beside one.
//!
//! Each DOF's residuals are taken to be the channels' noise plus a random force of any size (see [`super::filter`]): the
//! force follows whatever a model misses, so that the noise is what is too fast for the vehicle to have done. Maximum of
//! the likelihood times the prior of the table. It is one for all models of a recording; a model that misses does not get
//! a noise of its own.

use hydroline_core::run::{Channel, PerChannel};
use hydroline_numerics::noise::Noise;
use hydroline_numerics::outliers::outliers;
use hydroline_numerics::statistics::robust_sd;
use hydroline_numerics::{parallel, pattern};

use super::body::Body;
use super::filter::{Filter, Force, Instruments};
use super::hyper::Noises;
use super::prior::{Density, PriorTable};

/// An innovation of more than this many sd is an outlier: 6e-7 of normal ones are.
const OUTLIER_SD: f64 = 5.0;
/// Samples on either side within which only the largest innovation is taken for the outlier: those after it are pulled.
const PULLED: usize = 3;
/// Share of a run's sound samples in a channel above which innovations that are too large are no outliers but what a model misses,
/// and none is left out for its innovation: as many outliers of the motion around them are a fault of the data.
const REJECTED_MOST: f64 = 0.05;
/// Spread of a logged sd about the real one (sd of the logarithm).
const LOGGED_LN: f64 = 0.3;
/// Prior of the coloured part over the white one: median and scale of the logarithm.
const COLOUR_RATIO: (f64, f64) = (-0.7, 1.2);
/// Log prior density of a noise's colour, by the logarithms of its size over the white part's and of its correlation time.
pub fn ln_colour(ratio: f64, correlation_s: f64, prior: &PriorTable) -> f64 {
    let size = Density::Student {
        centre: COLOUR_RATIO.0,
        scale: COLOUR_RATIO.1,
        freedom: 4.0,
    };
    let time = Density::normal(prior.colour_s.ln(), prior.colour_ln);
    size.ln(ratio.ln()) + time.ln(correlation_s.ln())
}

/// sds of either beyond which no instrument is looked for: colour that is slower or larger cannot be distinguished from what a
/// vehicle does by its residuals alone, and counts as misfit. A run at rest shows it.
const COLOUR_SDS: f64 = 2.0;
/// In logarithms: steps from a factor e to 6 %, which is finer than an sd of some hundred samples is known. Gains below a
/// thousandth of a nat are not worth a step.
const SEARCH: pattern::Options = pattern::Options {
    step: 1.0,
    finest: 0.06,
    gain: 1e-3,
};

/// One DOF's residuals: (position, rate) per sample, NaN = missing.
pub type Pairs = Vec<Vec<[f64; 2]>>;

/// Samples of a run that count, per channel of a DOF.
type Flags = Vec<Vec<[bool; 2]>>;

/// Residuals of a DOF from predicted channels.
pub fn residuals(body: &Body, predicted: &[Vec<PerChannel<f64>>], dof: usize) -> Pairs {
    let runs = body.recording.runs.iter().zip(predicted);
    runs.map(|(r, p)| {
        let each = p.iter().enumerate();
        each.map(|(k, p)| {
            let m = r.measured(k);
            Channel::of(dof).map(|c| m[c] - p[c])
        })
        .collect()
    })
    .collect()
}

/// sd of a series' fast part: of second differences, robust.
fn fast_sd(series: &Pairs, channel: usize) -> Option<f64> {
    let mut second = Vec::new();
    for run in series {
        let v: Vec<f64> = run
            .iter()
            .map(|p| p[channel])
            .filter(|v| v.is_finite())
            .collect();
        second.extend(v.windows(3).map(|w| w[0] - 2.0 * w[1] + w[2]));
    }
    if second.len() < 8 {
        return None;
    }
    let sd = robust_sd(&second) / 6f64.sqrt();
    // Values that never change, or a resolution coarser than the noise: a hundredth of the range of a step.
    let largest = second.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
    Some(if sd > 0.0 {
        sd
    } else {
        (largest / 100.0).max(1e-12)
    })
}

/// Noise and outliers of every channel that moves, beside what a model predicts.
pub fn estimate(
    body: &Body,
    predicted: &[Vec<PerChannel<f64>>],
    before: Option<&Noises>,
) -> Noises {
    let found = parallel::map_slice(&body.dofs, |&d| {
        let pairs = residuals(body, predicted, d);
        of_dof(body, d, &pairs, before)
    });
    let mut made = Noises {
        channels: PerChannel::splat(None),
        floor_sd: before.map_or(PerChannel::splat(0.0), |b| b.floor_sd),
        has_force: before.is_none_or(|b| b.has_force),
        at_rest: before.map_or(PerChannel::splat(None), |b| b.at_rest),
        used: body
            .recording
            .runs
            .iter()
            .map(|r| vec![PerChannel::splat(false); r.times_s.len()])
            .collect(),
    };
    for (d, (noise, used)) in body.dofs.iter().zip(found) {
        for (c, channel) in Channel::of(*d).into_iter().enumerate() {
            made.channels[channel] = made.no_quieter_than_at_rest(channel, noise[c]);
            for (made, f) in made.used.iter_mut().flatten().zip(used.iter().flatten()) {
                made[channel] = f[c];
            }
        }
    }
    made
}

/// Logarithms of the numbers of a [`Noise`].
#[derive(Debug, Default, Clone, Copy)]
struct LnNoise {
    white_sd: f64,
    coloured_sd: f64,
    correlation_s: f64,
}

/// Numbers of the search, as their logarithms.
#[derive(Debug, Default, Clone, Copy)]
struct Numbers {
    /// Of position and rate.
    noise: [LnNoise; 2],
    /// Acceleration of the random force.
    force_mps2: f64,
    /// Its correlation time.
    force_s: f64,
}

impl Numbers {
    /// Those that are searched, where these channels are there.
    fn free(&mut self, there: [bool; 2]) -> Vec<&mut f64> {
        let noise = self.noise.iter_mut().zip(there).filter(|(_, there)| *there);
        let noise =
            noise.flat_map(|(n, _)| [&mut n.white_sd, &mut n.coloured_sd, &mut n.correlation_s]);
        noise
            .chain([&mut self.force_mps2, &mut self.force_s])
            .collect()
    }

    fn instruments(&self, there: [bool; 2]) -> Instruments {
        std::array::from_fn(|c| {
            there[c].then(|| Noise {
                white_sd: self.noise[c].white_sd.exp(),
                coloured_sd: self.noise[c].coloured_sd.exp(),
                correlation_s: self.noise[c].correlation_s.exp(),
            })
        })
    }
}

/// Residuals of one DOF, and what is known of its instruments.
struct Observed<'a> {
    body: &'a Body,
    dof: usize,
    pairs: &'a Pairs,
    /// sd of the fast part of position and rate.
    fast: [Option<f64>; 2],
    /// sd that the log gives for the position, of a sample that says as much as the mean one.
    logged: Option<f64>,
    /// Logarithms of the least noise of position and rate that any import states; minus infinity where none does.
    stated_ln: [f64; 2],
}

impl<'a> Observed<'a> {
    fn new(body: &'a Body, dof: usize, pairs: &'a Pairs) -> Self {
        Observed {
            body,
            dof,
            pairs,
            fast: [fast_sd(pairs, 0), fast_sd(pairs, 1)],
            logged: Some(body.recording.logged_sd[dof]).filter(|sd| sd.is_finite()),
            stated_ln: Channel::of(dof).map(|c| {
                let runs = body.recording.runs.iter().map(|r| r.stated_sd[c]);
                let least = runs.filter(|sd| *sd > 0.0).reduce(f64::min);
                least.map_or(f64::NEG_INFINITY, f64::ln)
            }),
        }
    }

    /// Samples that are measured and do not stand out of the motion around them.
    fn sound(&self) -> Flags {
        let runs = self.body.recording.runs.iter().zip(self.pairs);
        runs.map(|(r, pairs)| {
            let mut sound = vec![[false; 2]; pairs.len()];
            for (c, channel) in Channel::of(self.dof).into_iter().enumerate() {
                let is_there = |k: &usize| self.fast[c].is_some() && pairs[*k][c].is_finite();
                let there: Vec<usize> = (0..pairs.len()).filter(is_there).collect();
                let times_s: Vec<f64> = there.iter().map(|k| r.times_s[*k]).collect();
                let measured: Vec<f64> = there.iter().map(|k| r.measured(*k)[channel]).collect();
                let out = outliers(&times_s, &measured, self.body.tolerance[channel]);
                for (k, out) in there.into_iter().zip(out) {
                    sound[k][c] = !out;
                }
            }
            sound
        })
        .collect()
    }

    fn there(&self) -> [bool; 2] {
        self.fast.map(|f| f.is_some())
    }

    /// Where the search begins: at the noise before, or at the fast part's.
    fn begin(&self, before: Option<&Noises>) -> Numbers {
        let mut x = Numbers::default();
        for (c, channel) in Channel::of(self.dof).into_iter().enumerate() {
            let stated = self.stated_ln[c];
            let white = self.fast[c].unwrap_or(1.0).ln().max(stated);
            let known = before.and_then(|b| b.channels[channel]);
            let colour = known.filter(|k| k.coloured_sd > 0.0);
            let correlation_s = colour.map_or(self.body.prior.colour_s, |k| k.correlation_s);
            x.noise[c] = LnNoise {
                white_sd: known.map_or(white, |k| k.white_sd.max(1e-12).ln().max(stated)),
                coloured_sd: colour.map_or(white + COLOUR_RATIO.0, |k| k.coloured_sd.ln()),
                correlation_s: correlation_s.ln(),
            };
        }
        // An acceleration that is worth the largest residual within a second.
        let all = self.pairs.iter().flatten().flatten();
        let largest = all.filter(|v| v.is_finite());
        x.force_mps2 = largest.fold(1e-9_f64, |m, v| m.max(v.abs())).ln();
        x
    }

    /// Filter of a run under these numbers.
    fn filter(&self, x: &Numbers, run: usize, used: &[[bool; 2]]) -> Filter {
        let r = &self.body.recording.runs[run];
        let force = Force {
            sd_mps2: x.force_mps2.exp(),
            correlation_s: x.force_s.exp().clamp(0.1, 60.0),
        };
        let response = self.body.responses[self.dof];
        let made = x.instruments(self.there());
        let both = Channel::of(self.dof);
        Filter::new(&r.times_s, r.start_s, response, force, &made, |k, c| {
            r.sd_ratio_of(k, both[c], used[k][c])
        })
    }

    /// Minus the log likelihood of the residuals, and the log prior.
    fn cost(&self, x: &Numbers, used: &Flags) -> f64 {
        let mut sum = 0.0;
        for (run, (p, used)) in self.pairs.iter().zip(used).enumerate() {
            let filter = self.filter(x, run, used);
            let mut series: Vec<[f64; 2]> = p
                .iter()
                .map(|v| v.map(|v| if v.is_finite() { v } else { 0.0 }))
                .collect();
            filter.apply(&mut series);
            sum += 0.5 * (series.iter().flatten().map(|v| v * v).sum::<f64>() + filter.ln_variance);
        }
        let prior = &self.body.prior;
        for c in (0..2).filter(|c| self.fast[*c].is_some()) {
            let x = &x.noise[c];
            let slow = (x.correlation_s - prior.colour_s.ln()) / prior.colour_ln;
            let large = (x.coloured_sd - x.white_sd - COLOUR_RATIO.0) / COLOUR_RATIO.1;
            let finer = self.stated_ln[c] > x.white_sd;
            if finer || slow.abs() > COLOUR_SDS || large > COLOUR_SDS {
                return f64::INFINITY;
            }
            let ratio = Density::Student {
                centre: COLOUR_RATIO.0,
                scale: COLOUR_RATIO.1,
                freedom: 4.0,
            };
            sum -= ratio.ln(x.coloured_sd - x.white_sd);
            sum -= Density::normal(prior.colour_s.ln(), prior.colour_ln).ln(x.correlation_s);
            if let Some(sd) = self.logged.filter(|_| c == 0) {
                sum -= Density::normal(sd.ln(), LOGGED_LN).ln(x.white_sd);
            }
        }
        sum -= Density::normal(0.0, 1.5).ln(x.force_s);
        if sum.is_finite() { sum } else { f64::INFINITY }
    }
}

fn of_dof(body: &Body, dof: usize, pairs: &Pairs, before: Option<&Noises>) -> (Instruments, Flags) {
    let observed = Observed::new(body, dof, pairs);
    let there = observed.there();
    let sound = observed.sound();
    let mut used = sound.clone();
    if !there[0] && !there[1] {
        return ([None; 2], used);
    }
    let mut x = observed.begin(before);
    for round in 0..3 {
        // Whether slow residuals are the instrument's or a force's has two answers; each is begun from.
        let shares: &[f64] = if round == 0 {
            &[0.0, -3.0, -6.0]
        } else {
            &[0.0]
        };
        let tried = shares.iter().map(|share| {
            let mut from = x;
            from.force_mps2 += share;
            descend(from, there, |x| observed.cost(x, &used))
        });
        x = tried
            .min_by(|a, b| a.1.total_cmp(&b.1))
            .map_or(x, |found| found.0);
        let mut changed = false;
        for (run, (p, used)) in pairs.iter().zip(&mut used).enumerate() {
            let before = used.clone();
            reject(p, used, |used| observed.filter(&x, run, used));
            take_back(&sound[run], used);
            changed |= *used != before;
        }
        if !changed || round == 2 {
            break;
        }
    }
    (x.instruments(there), used)
}

/// Takes back what was rejected of a run's channel where that is too much for outliers.
fn take_back(sound: &[[bool; 2]], used: &mut [[bool; 2]]) {
    for c in 0..2 {
        let all = sound.iter().filter(|s| s[c]).count();
        let kept = used.iter().filter(|u| u[c]).count();
        if (all - kept) as f64 > REJECTED_MOST * all as f64 {
            for (used, sound) in used.iter_mut().zip(sound) {
                used[c] = sound[c];
            }
        }
    }
}

/// Marks samples whose innovation is too large, the largest of each neighbourhood first.
fn reject(pairs: &[[f64; 2]], used: &mut [[bool; 2]], filter: impl Fn(&[[bool; 2]]) -> Filter) {
    for _ in 0..8 {
        let mut series: Vec<[f64; 2]> = pairs
            .iter()
            .map(|v| v.map(|v| if v.is_finite() { v } else { 0.0 }))
            .collect();
        filter(used).apply(&mut series);
        let mut any = false;
        for c in 0..2 {
            for k in 0..series.len() {
                let size = series[k][c].abs();
                let around = k.saturating_sub(PULLED)..(k + PULLED + 1).min(series.len());
                if size > OUTLIER_SD && around.clone().all(|j| series[j][c].abs() <= size) {
                    used[k][c] = false;
                    any = true;
                }
            }
        }
        if !any {
            break;
        }
    }
}

/// The place of the least cost found from `x`, and its cost.
fn descend(mut x: Numbers, there: [bool; 2], cost: impl Fn(&Numbers) -> f64) -> (Numbers, f64) {
    let (free, begin) = (x.free(there).len(), cost(&x));
    let moved = |at: &Numbers, k: usize, by: f64| {
        let mut moved = *at;
        *moved.free(there)[k] += by;
        moved
    };
    pattern::minimise(x, begin, free, &SEARCH, moved, cost)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recording::Recording;
    use hydroline_core::run::{Command, Run, Sample};
    use hydroline_rigs::Rig;
    use rand::{SeedableRng, rngs::StdRng};
    use rand_distr::{Distribution, StandardNormal};

    /// A surge run as the rig's model makes it, with noise of .1 mm and .1 mm/s; `off_m` is added to each sample's x.
    fn surge(rig: &Rig, stated: [f64; 2], off_m: impl Fn(usize) -> f64) -> Body {
        let mut run = Run {
            commands: vec![Command {
                t_s: 0.5,
                wrench: [6.0, 0.0, 0.0, 0.0, 0.0, 0.0],
            }],
            ..Run::default()
        };
        [run.instrument_sd[Channel::X], run.instrument_sd[Channel::U]] = stated;
        for k in 0..400_u32 {
            let mut values = PerChannel::NAN;
            (values[Channel::X], values[Channel::U]) = (0.0, 0.0);
            run.samples.push(Sample {
                t_s: 0.04 * f64::from(k),
                values,
                covariance: None,
            });
        }
        let body = |run: &Run| {
            let recording = Recording::new(std::slice::from_ref(run), 0.0);
            Body::plain(recording, rig, &[0]).unwrap()
        };
        let still = body(&run);
        let moved = still.values(0, &[], &still.begin());
        let mut rng = StdRng::seed_from_u64(11);
        for (k, (s, m)) in run.samples.iter_mut().zip(moved).enumerate() {
            let mut noise = || -> f64 { StandardNormal.sample(&mut rng) };
            s.values[Channel::X] = m[Channel::X] + 1e-4 * noise() + off_m(k);
            s.values[Channel::U] = m[Channel::U] + 1e-4 * noise();
        }
        body(&run)
    }

    fn of(body: &Body) -> Noises {
        estimate(body, &[body.values(0, &[], &body.begin())], None)
    }

    /// An sd in the import's map changed nothing.
    #[test]
    fn noise_is_never_below_the_sd_that_the_import_states() {
        let rig = Rig::builtin("lshpi").unwrap();
        let white = |stated: [f64; 2]| {
            let found = of(&surge(&rig, stated, |_| 0.0));
            [Channel::X, Channel::U].map(|c| found.channels[c].unwrap().white_sd)
        };
        let free = white([0.0, 0.0]);
        assert!(free.iter().all(|sd| (3e-5..2e-4).contains(sd)), "{free:?}");
        let floored = white([1e-3, 4e-3]);
        assert!(
            floored[0] >= 0.999e-3 && floored[1] >= 3.99e-3,
            "{floored:?}"
        );
        // One that is finer than what is seen changes nothing.
        let finer = white([1e-6, 0.0]);
        assert!((finer[0] / free[0]).ln().abs() < 0.2, "{finer:?} {free:?}");
    }

    /// Spikes are left out, however many; what is no spike is used.
    #[test]
    fn many_large_innovations_are_used_unless_they_stand_out_of_the_motion() {
        let rig = Rig::builtin("lshpi").unwrap();
        let out = |off: &dyn Fn(usize) -> f64| -> Vec<usize> {
            let found = of(&surge(&rig, [0.0; 2], off));
            let used = found.used[0].iter().map(|u| u[Channel::X]).enumerate();
            used.filter(|(_, used)| !used).map(|(k, _)| k).collect()
        };
        let spiked = |k: usize| k > 20 && k < 380 && k % 9 == 4;
        let spikes = out(&|k| if spiked(k) { 0.3 } else { 0.0 });
        let mut known = (0..400).filter(|k| spiked(*k));
        assert!(known.all(|k| spikes.contains(&k)), "{spikes:?}");
        // Below the tolerance nothing stands out.
        let small = out(&|k| if k % 9 == 4 { 1.5e-3 } else { 0.0 });
        assert!(small.len() <= 20, "{small:?}");
    }
}

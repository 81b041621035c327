//! Loads, speeds, frequencies and places that a run held out has and those fitted lack, in words.

use hydroline_core::run::{COMPANIONS, Channel, PerChannel};
use hydroline_inference::body::Body;
use hydroline_inference::recording::Recorded;
use hydroline_numerics::statistics::extent;
use hydroline_report::Quantity;
use hydroline_rigs::Dof;

/// Share of what was fitted by which a quantity has to go beyond it: within, a law goes on as it was seen.
const MARGIN: f64 = 0.1;
/// Share of a run's largest load from which another DOF's says anything: thrusters leak that much into each other.
const LOAD_SHARE: f64 = 0.02;
/// Sds of a channel's noise by which places have to differ: the extremes of some hundred samples lie that far out.
const NOISE_SDS: f64 = 4.0;
/// Ratio of frequencies from which one lies outside: a vehicle's answer changes over an octave, not within a tenth of it.
const FREQUENCY_RATIO: f64 = 1.5;
/// Share of a load's power left out at either end of its spectrum: of a square wave the first and the third harmonic stay.
const TAIL: f64 = 0.1;
/// Step at which a load is sampled \[s\]: frequencies up to 10 Hz, which no vehicle follows.
const STEP_S: f64 = 0.05;
/// Most of these steps; over a longer run each is longer.
const STEPS_MAX: usize = 2048;

/// A quantity of runs with its range over them.
#[derive(Debug, Clone, PartialEq)]
struct Reached {
    /// Name as a sentence has it.
    name: String,
    unit: &'static str,
    /// Factor from SI to that unit.
    factor: f64,
    /// Smallest difference that says anything \[SI\].
    least: f64,
    /// Whether its size counts whatever its sign.
    is_two_sided: bool,
    range: (f64, f64),
}

/// Three significant digits.
fn short(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return format!("{value}");
    }
    let places = (2 - value.abs().log10().floor() as i32).clamp(0, 6) as usize;
    format!("{value:.places$}")
}

impl Reached {
    fn amount(&self, value: f64) -> String {
        format!("{} {}", short(value * self.factor), self.unit)
    }

    fn between(&self, (low, high): (f64, f64)) -> String {
        format!("{} to {}", short(low * self.factor), self.amount(high))
    }

    /// What of this lies outside of what was fitted, in words; `None` = nothing.
    fn beyond(&self, fitted: &Reached) -> Option<String> {
        let size = |(low, high): (f64, f64)| low.abs().max(high.abs());
        let ((low, high), (from, to)) = (self.range, fitted.range);
        if low > high {
            return None;
        }
        let least = self.least.max(fitted.least);
        if from > to {
            let moves = high - low > least;
            return moves.then(|| {
                let up_to = self.amount(size(self.range));
                format!("{} up to {up_to}, fitted without any", self.name)
            });
        }
        if self.is_two_sided {
            let (here, there) = (size(self.range), size(fitted.range));
            if here > (1.0 + MARGIN) * there && here - there > least {
                let (here, there) = (self.amount(here), self.amount(there));
                return Some(format!("{} up to {here}, fitted up to {there}", self.name));
            }
        }
        let margin = least.max(MARGIN * (to - from));
        (low < from - margin || high > to + margin).then(|| {
            let (here, there) = (self.between(self.range), self.between(fitted.range));
            format!("{} from {here}, fitted from {there}", self.name)
        })
    }
}

/// Frequencies of the load of a DOF: the band that holds its power but for the tails, and the run's resolution \[Hz\].
#[derive(Debug, Clone, Copy, PartialEq)]
struct Spectrum {
    low_hz: f64,
    high_hz: f64,
    resolution_hz: f64,
}

impl Spectrum {
    /// Spectrum of the load of a DOF in a run; `None` where the load is constant.
    fn of(run: &Recorded, dof: usize) -> Option<Spectrum> {
        let long_s = run.times_s.last()? - run.start_s;
        let count = (long_s / STEP_S).ceil().clamp(0.0, STEPS_MAX as f64) as usize;
        if count < 4 {
            return None;
        }
        let step_s = long_s / count as f64;
        let mut loads: Vec<f64> = (0..count)
            .map(|k| {
                let t_s = run.start_s + (k as f64 + 0.5) * step_s;
                let behind = run.commands.partition_point(|c| c.0 <= t_s);
                let last = behind.checked_sub(1).and_then(|i| run.commands.get(i));
                last.map_or(0.0, |c| c.1[dof])
            })
            .collect();
        let mean = loads.iter().sum::<f64>() / count as f64;
        loads.iter_mut().for_each(|v| *v -= mean);
        let power = powers(&loads);
        let total: f64 = power.iter().sum();
        let squares: f64 = loads.iter().map(|v| v * v).sum();
        if squares <= 1e-12 * mean * mean * count as f64 || total <= 0.0 {
            return None;
        }
        let reaches = |share: f64| {
            let mut sum = 0.0;
            let place = power.iter().position(|p| {
                sum += p;
                sum >= share * total
            });
            place.map_or(power.len(), |k| k + 1) as f64 / long_s
        };
        Some(Spectrum {
            low_hz: reaches(TAIL),
            high_hz: reaches(1.0 - TAIL),
            resolution_hz: 1.0 / long_s,
        })
    }

    /// Both together.
    fn with(self, other: Spectrum) -> Spectrum {
        Spectrum {
            low_hz: self.low_hz.min(other.low_hz),
            high_hz: self.high_hz.max(other.high_hz),
            resolution_hz: self.resolution_hz.min(other.resolution_hz),
        }
    }

    /// What of it lies outside of what was fitted, in words; `None` = nothing.
    fn beyond(self, fitted: Spectrum, dof: Dof) -> Option<String> {
        let finest_hz = self.resolution_hz.max(fitted.resolution_hz);
        let apart = |high: f64, low: f64| high > FREQUENCY_RATIO * low && high - low > finest_hz;
        (apart(self.high_hz, fitted.high_hz) || apart(fitted.low_hz, self.low_hz)).then(|| {
            let band = |s: Spectrum| format!("{} to {} Hz", short(s.low_hz), short(s.high_hz));
            format!(
                "{} load that changes at {}, fitted at {}",
                dof.name(),
                band(self),
                band(fitted)
            )
        })
    }
}

/// Power at each multiple of the lowest frequency, the mean left out (Goertzel 1958).
fn powers(values: &[f64]) -> Vec<f64> {
    let count = values.len();
    let one = std::f64::consts::TAU / count as f64;
    let of = |k: usize| {
        let turn = 2.0 * (one * k as f64).cos();
        let (last, before) = values
            .iter()
            .fold((0.0, 0.0), |(a, b), v| (v + turn * a - b, a));
        (last * last + before * before - turn * last * before).max(0.0)
    };
    (1..=count / 2).map(of).collect()
}

/// Loads of these runs, per DOF.
fn loads(runs: &[Recorded]) -> Vec<Reached> {
    let of = |d: usize| {
        let each = runs.iter().flat_map(|r| {
            let end_s = r.times_s.last().copied().unwrap_or(0.0);
            r.commands.iter().filter(move |c| c.0 <= end_s)
        });
        extent(each.map(|c| c.1[d]).chain([0.0]))
    };
    let ranges: [(f64, f64); 6] = std::array::from_fn(of);
    let size = |d: usize| ranges[d].0.abs().max(ranges[d].1.abs());
    let made = (0..6).map(|d| {
        let alike = if d < 3 { 0..3 } else { 3..6 };
        Reached {
            name: format!("{} load", Dof::ALL[d].name()),
            unit: if d < 3 { "N" } else { "N m" },
            factor: 1.0,
            least: LOAD_SHARE * alike.map(size).fold(0.0, f64::max),
            is_two_sided: true,
            range: ranges[d],
        }
    });
    made.collect()
}

/// Rates of a DOF in a predicted motion: as the model has them or, of one DOF along its line, by its positions.
fn rates(run: &Recorded, motion: &[PerChannel<f64>], dof: usize, by_places: bool) -> Vec<f64> {
    let [place, rate] = Channel::of(dof);
    if !by_places {
        return motion.iter().map(|v| v[rate]).collect();
    }
    let stamps = motion.windows(2).zip(run.times_s.windows(2));
    let each = stamps.map(|(v, t)| (v[1][place] - v[0][place]) / (t[1] - t[0]));
    each.filter(|v| v.is_finite()).collect()
}

/// Runs with the motion that the likeliest model predicts of them.
pub struct Moved<'a> {
    /// Body that the runs are of.
    pub body: &'a Body,
    /// The runs.
    pub runs: &'a [Recorded],
    /// Channels per run and sample.
    pub motion: &'a [Vec<PerChannel<f64>>],
    /// sd of each channel's noise \[SI\]; NaN = not known.
    pub noise: PerChannel<f64>,
}

/// Speeds, places and companions of runs.
fn motions(moved: &Moved<'_>) -> Vec<Reached> {
    let Moved {
        body,
        runs,
        motion,
        noise,
    } = *moved;
    let mut made = Vec::new();
    let degrees = 1f64.to_degrees();
    for d in (0..6).filter(|d| body.dofs.contains(d) || body.given.contains(d)) {
        let [place, rate] = Channel::of(d);
        let name = Dof::ALL[d].name();
        let range = if body.dofs.contains(&d) {
            let by_places = !body.lines.is_empty();
            let pairs = runs.iter().zip(motion);
            extent(pairs.flat_map(|(r, m)| rates(r, m, d, by_places)))
        } else {
            extent(runs.iter().flat_map(|r| r.seen(rate)))
        };
        made.push(Reached {
            name: format!("{name} {}", if d < 3 { "speed" } else { "rate" }),
            unit: if d < 3 { "m/s" } else { "deg/s" },
            factor: if d < 3 { 1.0 } else { degrees },
            least: body.tolerance[rate],
            is_two_sided: true,
            range,
        });
        made.push(Reached {
            name: if d < 3 {
                Quantity::of(place.name()).name.to_owned()
            } else {
                format!("{name} angle")
            },
            unit: if d < 3 { "m" } else { "deg" },
            factor: if d < 3 { 1.0 } else { degrees },
            // NaN is passed over.
            least: body.tolerance[place].max(NOISE_SDS * noise[place]),
            is_two_sided: d > 2,
            range: extent(runs.iter().flat_map(|r| r.seen(place))),
        });
    }
    for (c, key) in COMPANIONS.into_iter().enumerate() {
        let shown = Quantity::of(key);
        let seen = runs.iter().flat_map(|r| r.companions.measured(c).1);
        made.push(Reached {
            name: shown.name.to_owned(),
            unit: shown.unit,
            factor: shown.factor,
            least: 0.0,
            is_two_sided: true,
            range: extent(seen),
        });
    }
    made
}

impl Moved<'_> {
    /// Loads first, then speeds, places and companions.
    fn reached(&self) -> Vec<Reached> {
        let mut all = loads(self.runs);
        all.extend(motions(self));
        all
    }

    fn spectrum(&self, dof: usize) -> Option<Spectrum> {
        let each = self.runs.iter().filter_map(|r| Spectrum::of(r, dof));
        each.reduce(Spectrum::with)
    }

    /// What of these runs lies outside of those fitted, a phrase each.
    pub fn beyond(&self, fitted: &Moved<'_>) -> Vec<String> {
        let pairs = self.reached().into_iter().zip(fitted.reached());
        let reached = pairs.filter_map(|(here, there)| here.beyond(&there));
        let spectra = (0..6).filter_map(|d| {
            let (here, there) = (self.spectrum(d)?, fitted.spectrum(d)?);
            here.beyond(there, Dof::ALL[d])
        });
        reached.chain(spectra).collect()
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use hydroline_core::run::{Command, Run, Sample};
    use hydroline_inference::recording::Recording;

    /// A range that holds nothing.
    const NOTHING: (f64, f64) = (f64::INFINITY, f64::NEG_INFINITY);

    fn load(range: (f64, f64)) -> Reached {
        Reached {
            name: "surge load".to_owned(),
            unit: "N",
            factor: 1.0,
            least: 0.1,
            is_two_sided: true,
            range,
        }
    }

    #[test]
    fn what_is_beyond_is_said_with_both_ranges() {
        let beyond = |here, there| load(here).beyond(&load(there));
        assert_eq!(
            beyond((0.0, 24.0), (-4.0, 8.0)).unwrap(),
            "surge load up to 24.0 N, fitted up to 8.00 N"
        );
        assert_eq!(
            beyond((-8.0, 0.0), (0.0, 8.0)).unwrap(),
            "surge load from -8.00 to 0 N, fitted from 0 to 8.00 N"
        );
        assert_eq!(
            beyond((0.0, 3.0), NOTHING).unwrap(),
            "surge load up to 3.00 N, fitted without any"
        );
        assert_eq!(beyond((-8.0, 8.5), (-8.0, 8.0)), None);
        assert_eq!(beyond(NOTHING, (0.0, 8.0)), None);
    }

    /// A run of square waves in surge.
    fn square(period_s: f64) -> Recorded {
        let sample = |k: u32| Sample {
            t_s: 0.1 * f64::from(k),
            values: PerChannel::splat(0.0),
            covariance: None,
        };
        let command = |k: u32| Command {
            t_s: 0.5 * period_s * f64::from(k),
            wrench: [
                if k.is_multiple_of(2) { 4.0 } else { -4.0 },
                0.0,
                0.0,
                0.0,
                0.0,
                0.0,
            ],
        };
        let halves = (80.0 / period_s) as u32;
        let run = Run {
            samples: (0..401).map(sample).collect(),
            commands: (0..halves).map(command).collect(),
            ..Run::default()
        };
        Recording::new(&[run], 0.0).runs.remove(0)
    }

    #[test]
    fn a_load_that_changes_faster_is_seen_in_its_spectrum() {
        let (slow, fast) = (square(10.0), square(1.0));
        let [slow, fast] = [slow, fast].map(|r| Spectrum::of(&r, 0).unwrap());
        assert!((slow.low_hz - 0.1).abs() < 0.03, "{slow:?}");
        assert!((fast.low_hz - 1.0).abs() < 0.03, "{fast:?}");
        let said = fast.beyond(slow, Dof::Surge).unwrap();
        assert!(
            said.starts_with("surge load that changes at 1.00 to "),
            "{said}"
        );
        assert_eq!(slow.beyond(slow.with(fast), Dof::Surge), None);
        assert_eq!(Spectrum::of(&square(10.0), 1), None);
    }
}

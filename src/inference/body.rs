//! The body: Eq. 1 with effects, its free numbers, and what instruments would have measured of it.

mod ask;
mod simulate;

use hydroline_core::run::{Channel, PerChannel};
use hydroline_identify::parameter::Coefficient;
use hydroline_rigs::Vehicle;
use hydroline_sim::Given;
use hydroline_sim::effect::CheckedEffect;
use hydroline_sim::single::Line;

use super::clock::Clock;
use super::filter::Response;
use super::prior::{Density, PriorTable, Scale};
use super::recording::{Recorded, Recording};
use super::size::Size;
use super::term::Candidate;

/// Directions per pass.
const WIDTHS: [usize; 4] = [6, 8, 12, 16];

/// One of the vehicle's own numbers that are fitted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Own {
    /// One of the eighteen, by its ratio to the rig's.
    Coefficient(Coefficient, f64),
    /// One of the eighteen of which the rig says 0, linear, in a unit on the vehicle's scale. It damps or adds mass, or is 0.
    Unsaid(Coefficient, f64),
    /// Restoring moment (GM), by its ratio to the rig's.
    Restoring(f64),
    /// Hydrostatic stiffness, by its place in [`Vehicle::stiffness`] and its ratio to the rig's.
    Stiffness(usize, f64),
    /// Weight minus buoyancy, by its ratio to the rig's.
    NetWeight(f64),
    /// Seconds by which commands act later than a joined log says, in sds of its offset.
    ClockOffset(Clock),
    /// Drift of a joined log's clocks beyond what it says, in sds of that.
    ClockDrift(Clock),
}

/// Names in files of [`Vehicle::stiffness`].
const STIFFNESSES: [&str; 3] = [
    "heave_stiffness_npm",
    "roll_stiffness_nmprad",
    "pitch_stiffness_nmprad",
];

impl Own {
    /// Name in files.
    pub fn name(&self) -> &'static str {
        match self {
            Own::Coefficient(c, _) | Own::Unsaid(c, _) => c.key(),
            Own::Restoring(_) => "restoring_nm",
            Own::Stiffness(place, _) => STIFFNESSES[*place],
            Own::NetWeight(_) => "net_weight_n",
            Own::ClockOffset(_) => "clock_offset_s",
            Own::ClockDrift(_) => "clock_drift",
        }
    }

    /// The coefficient, of one of the eighteen.
    pub fn coefficient(&self) -> Option<Coefficient> {
        match self {
            Own::Coefficient(c, _) | Own::Unsaid(c, _) => Some(*c),
            Own::Restoring(_)
            | Own::Stiffness(..)
            | Own::NetWeight(_)
            | Own::ClockOffset(_)
            | Own::ClockDrift(_) => None,
        }
    }

    /// Whether the rig knows the number.
    pub fn is_said(&self) -> bool {
        !matches!(self, Own::Unsaid(..)) && !self.is_clock()
    }

    /// Whether it is one of a joined log's clock, which belongs to the log and not to the vehicle.
    pub fn is_clock(&self) -> bool {
        matches!(self, Own::ClockOffset(_) | Own::ClockDrift(_))
    }

    /// Number that a scaled one is a ratio to: the rig's, or what stands for it where the rig says 0.
    pub fn unit(&self) -> f64 {
        match self {
            Own::Coefficient(_, unit)
            | Own::Unsaid(_, unit)
            | Own::Restoring(unit)
            | Own::Stiffness(_, unit)
            | Own::NetWeight(unit) => *unit,
            Own::ClockOffset(clock) => clock.offset_sd_s,
            Own::ClockDrift(clock) => 1e-6 * clock.drift_sd_ppm,
        }
    }

    /// Natural number and its derivative by the scaled one, which is 0 where a fit begins.
    pub fn natural(&self, scaled: f64) -> (f64, f64) {
        let unit = self.unit();
        match self {
            // The sum leaves no -0 in a rig.
            Own::Unsaid(..) | Own::ClockOffset(_) | Own::ClockDrift(_) => {
                (0.0 + unit * scaled, unit)
            }
            _ => (unit * scaled.exp(), unit * scaled.exp()),
        }
    }

    /// The scaled number of a natural one; `None` where that has the other sign.
    pub fn scaled(&self, natural: f64) -> Option<f64> {
        let ratio = natural / self.unit();
        match self {
            Own::Unsaid(..) => Some(ratio).filter(|r| *r >= 0.0),
            Own::ClockOffset(_) | Own::ClockDrift(_) => Some(ratio),
            _ => Some(ratio.ln()).filter(|_| ratio > 0.0),
        }
    }

    /// Scale of the scaled number's prior.
    pub fn prior_scale(&self, prior: &PriorTable) -> f64 {
        match self {
            Own::Unsaid(..) => prior.unsaid,
            Own::ClockOffset(_) | Own::ClockDrift(_) => 1.0,
            _ => prior.coefficient_ln,
        }
    }

    /// Prior density of the scaled number. That of a coefficient of which the rig says 0 is largest there.
    fn density(&self, prior: &PriorTable) -> Density {
        if self.is_clock() {
            return Density::normal(0.0, 1.0);
        }
        Density::Student {
            centre: 0.0,
            scale: self.prior_scale(prior),
            freedom: 2.0,
        }
    }

    /// Limits of the scaled number.
    fn bounds(&self) -> (f64, f64) {
        match self {
            // Beyond 0 it would drive the vehicle, or take mass from it.
            Own::Unsaid(..) => (0.0, REACH),
            Own::ClockOffset(_) | Own::ClockDrift(_) => (f64::NEG_INFINITY, f64::INFINITY),
            // A coefficient a hundred times the rig's or a hundredth of it is none that this rig's model can be asked for.
            _ => (-REACH.ln(), REACH.ln()),
        }
    }
}

/// Ratio to the unit up to which a number is looked for.
const REACH: f64 = 100.0;

/// Runs, vehicle and candidate terms that models are fitted with.
#[derive(Debug, Clone)]
pub struct Body {
    /// The runs as they were measured.
    pub recording: Recording,
    /// The rig's vehicle.
    pub vehicle: Vehicle,
    /// Effects that the rig has switched on.
    pub base: Vec<CheckedEffect>,
    /// DOFs that are simulated: those that move and are not given.
    pub dofs: Vec<usize>,
    /// DOFs whose measured motion drives the others instead of being explained.
    pub given: Vec<usize>,
    /// Per run what of its motion is given, and companions; `None` = nothing.
    pub inputs: Vec<Option<Given>>,
    /// The vehicle's numbers.
    pub own: Vec<Own>,
    /// Per run the states that are free at its start.
    pub starts: Vec<Vec<Channel>>,
    /// Values of the states that are not.
    pub rest: Vec<PerChannel<f64>>,
    /// Where one DOF alone moves and its position alone is measured: its line in every run.
    pub lines: Vec<Line>,
    /// Terms that a model may hold beside the vehicle's own.
    pub candidates: Vec<Candidate>,
    /// Prior table.
    pub prior: PriorTable,
    /// Linearised response per DOF to a force per unit of mass.
    pub responses: [Response; 6],
    /// Size of the vehicle by which an effect's size is held for possible.
    pub bearable: Size,
    /// Largest tolerable rms per channel.
    pub tolerance: PerChannel<f64>,
    /// Longest step of the integration \[s\].
    pub step_max_s: f64,
}

/// Numbers of a model, scaled: the vehicle's own, each term's, each run's start.
pub type Point = Vec<f64>;

/// Simulation of one run: the measurements' counterpart (channels per sample, rotated) and, column by column, its
/// derivatives by the scaled numbers.
#[derive(Debug, Clone)]
pub struct Simulated {
    /// Channels per sample.
    pub values: Vec<PerChannel<f64>>,
    /// Per number that acts on this run: (its index in the point, derivative per sample).
    pub columns: Vec<(usize, Vec<PerChannel<f64>>)>,
}

/// Stretch at a run's start from which its rate there is taken \[s\], and the fewest samples of it.
const RATE_OVER_S: f64 = 0.6;
const RATE_SAMPLES: usize = 5;
/// A rate below this many of its own sd is none.
const RATE_SD: f64 = 4.0;

/// Rate of a DOF at a run's start as a straight line over its first samples says; 0 where it does not differ from rest.
/// A log that begins under way is distinguished from one at rest by this: a fit that begins at rest never finds it.
fn under_way(r: &Recorded, dof: usize) -> f64 {
    let [place, rate] = Channel::of(dof);
    if let Some(rate) = r.first(rate) {
        return rate;
    }
    let begin_s = r.times_s.first().copied().unwrap_or(0.0);
    let all: Vec<(f64, f64)> = (0..r.times_s.len())
        .map(|k| (r.times_s[k] - begin_s, r.measured(k)[place]))
        .filter(|(_, v)| v.is_finite())
        .collect();
    let within = all
        .partition_point(|(t, _)| *t <= RATE_OVER_S)
        .max(RATE_SAMPLES);
    let Some(first) = all.get(..within) else {
        return 0.0;
    };
    let n = first.len() as f64;
    let (t, v) = first
        .iter()
        .fold((0.0, 0.0), |s, x| (s.0 + x.0 / n, s.1 + x.1 / n));
    let (tt, tv) = first.iter().fold((0.0, 0.0), |s, x| {
        (s.0 + (x.0 - t).powi(2), s.1 + (x.0 - t) * (x.1 - v))
    });
    if tt <= 0.0 {
        return 0.0;
    }
    let slope = tv / tt;
    let left: f64 = first
        .iter()
        .map(|x| (x.1 - v - slope * (x.0 - t)).powi(2))
        .sum();
    let sd = (left / (n - 2.0) / tt).sqrt();
    if slope.abs() > RATE_SD * sd {
        slope
    } else {
        0.0
    }
}

impl Body {
    /// Index of each term's first number, and the index behind the last.
    pub fn places(&self, terms: &[usize]) -> Vec<usize> {
        let mut at = self.own.len();
        let mut places = vec![at];
        for t in terms {
            at += self.candidates[*t].scales.len();
            places.push(at);
        }
        places
    }

    /// Index of each run's first start number, and the count of all.
    pub fn start_places(&self, terms: &[usize]) -> Vec<usize> {
        let mut at = self.places(terms).last().copied().unwrap_or(0);
        let mut places = vec![at];
        for s in &self.starts {
            at += s.len();
            places.push(at);
        }
        places
    }

    /// Where a fit of the vehicle alone begins: the rig's numbers, at rest at the first samples.
    pub fn begin(&self) -> Point {
        let mut point = vec![0.0; self.own.len()];
        for (run, free) in self.starts.iter().enumerate() {
            let r = &self.recording.runs[run];
            point.extend(free.iter().map(|c| match c.is_rate() {
                false => self.rest[run][*c],
                true => under_way(r, c.dof().index()),
            }));
        }
        point
    }

    /// Prior density of every number.
    pub fn densities(&self, terms: &[usize]) -> Vec<Density> {
        let own = self.own.iter().map(|own| own.density(&self.prior));
        let mut all: Vec<Density> = own.collect();
        for t in terms {
            all.extend(self.candidates[*t].scales.iter().map(|s| s.density));
        }
        for (run, free) in self.starts.iter().enumerate() {
            all.extend(free.iter().map(|c| match c.is_rate() {
                false => Density::normal(self.rest[run][*c], self.prior.start_place),
                true => Density::Student {
                    centre: 0.0,
                    scale: self.prior.start_rate,
                    freedom: 1.0,
                },
            }));
        }
        all
    }

    /// Limits of every scaled number.
    pub fn bounds(&self, terms: &[usize]) -> Vec<(f64, f64)> {
        let mut all: Vec<(f64, f64)> = self.own.iter().map(Own::bounds).collect();
        for t in terms {
            all.extend(self.candidates[*t].scales.iter().map(Scale::bounds));
        }
        all.resize(
            self.start_places(terms).last().copied().unwrap_or(0),
            (f64::NEG_INFINITY, f64::INFINITY),
        );
        all
    }

    /// Natural numbers (coefficients, terms' parameters, starts) and their derivatives by the scaled ones.
    pub fn natural(&self, terms: &[usize], point: &[f64]) -> Vec<(f64, f64)> {
        let places = self.places(terms);
        let mut all = Vec::with_capacity(point.len());
        all.extend(self.own.iter().zip(point).map(|(own, v)| own.natural(*v)));
        for (t, at) in terms.iter().zip(&places) {
            let scales = self.candidates[*t].scales.iter();
            all.extend(scales.zip(&point[*at..]).map(|(s, v)| s.natural(*v)));
        }
        let last = places.last().copied().unwrap_or(0);
        all.extend(point[last..].iter().map(|v| (*v, 1.0)));
        all
    }

    /// Passes of sensitivities that a simulation of a model takes, in those of a model of the vehicle alone or a few effects.
    pub fn passes_of(&self, terms: &[usize]) -> usize {
        let numbers = self.places(terms).last().copied().unwrap_or(0);
        let most = self.starts.iter().map(Vec::len).max().unwrap_or(0);
        (numbers + most).div_ceil(WIDTHS[WIDTHS.len() - 1])
    }
}

#[cfg(test)]
mod tests;

//! Covariance over what the residuals leave open of the noise and of the random force.
//!
//! The fit takes the likeliest noise for the noise. How much colour it has, residuals say poorly: a tenth of the white part is not
//! seen in a minute of samples, and doubles what they leave open of a coefficient. So the covariance is that over a grid of noises and
//! forces by their probabilities (law of total covariance), each with its own level, the mode under it one Newton step away.
//! References: Patterson and Thompson 1971 (numbers integrated out); Hoeting et al. 1999, Statist. Sci. 14 (model averaging).

use std::collections::{BTreeMap, BTreeSet};

use hydroline_core::run::Channel;
use hydroline_inference::body::Simulated;
use hydroline_inference::fit::{Normal, Problem};
use hydroline_inference::hyper::{CORRELATIONS_S, Cell, Noises, SIZES, filters, ln_prior};
use hydroline_inference::noise::ln_colour;
use hydroline_numerics::noise::Noise;
use hydroline_numerics::{cancel, parallel};
use nalgebra::{Cholesky, DMatrix};
use statrs::function::erf::erf;

/// Sizes of the coloured part over the white one: doublings from what a minute of samples does not see.
const RATIOS: [f64; 7] = [0.0, 0.1, 0.2, 0.4, 0.8, 1.6, 3.2];
/// Its correlation times \[s\]: doublings, as far as an instrument's colour is looked for.
const TIMES_S: [f64; 5] = [0.125, 0.25, 0.5, 1.0, 2.0];
/// Place of the time by which a noise without colour is known.
const NO_TIME: usize = 2;
/// Probability that an instrument has no colour: as likely as not.
const WHITE: f64 = 0.5;
/// Probability over the likeliest's below which a state counts for nothing, and is not followed further.
const LEAST: f64 = 2e-3;
/// States that are asked for at the most: with pose and rate of a DOF measured there would be thousands.
const STATES_MOST: usize = 400;

/// Places of a noise in [`RATIOS`] and [`TIMES_S`].
type Colour = (usize, usize);

/// A noise of pose and rate, and a random force.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct State {
    colours: [Option<Colour>; 2],
    cell: Cell,
}

impl State {
    /// The same without what says nothing: the time of no colour, of no force.
    fn plain(mut self) -> State {
        for (ratio, time) in self.colours.iter_mut().flatten() {
            if *ratio == 0 {
                *time = NO_TIME;
            }
        }
        if self.cell.size == 0 {
            self.cell.correlation = 0;
        }
        self
    }

    /// Those one step away.
    fn neighbours(self) -> Vec<State> {
        let around = |at: usize, count: usize| {
            let below = at.checked_sub(1);
            below.into_iter().chain((at + 1 < count).then_some(at + 1))
        };
        let mut made = Vec::new();
        for (which, colour) in self.colours.into_iter().enumerate() {
            let Some((ratio, time)) = colour else {
                continue;
            };
            let others = around(ratio, RATIOS.len()).map(|r| (r, time));
            for other in others.chain(around(time, TIMES_S.len()).map(|t| (ratio, t))) {
                let mut state = self;
                state.colours[which] = Some(other);
                made.push(state.plain());
            }
        }
        let Cell { size, correlation } = self.cell;
        let sizes = around(size, SIZES.len()).flat_map(|size| {
            let all = match self.cell.size {
                0 => 0..CORRELATIONS_S.len(),
                _ => correlation..correlation + 1,
            };
            all.map(move |correlation| Cell { size, correlation })
        });
        let times = around(correlation, CORRELATIONS_S.len());
        let times = times.map(|correlation| Cell { size, correlation });
        made.extend(
            sizes
                .chain(times)
                .map(|cell| State { cell, ..self }.plain()),
        );
        made
    }
}

/// What a state says of the numbers.
struct Weighed {
    ln_weight: f64,
    /// Covariance under it, and the step to its mode.
    covariance: DMatrix<f64>,
    away: nalgebra::DVector<f64>,
}

/// A fit's mode, about which states are looked at.
pub(crate) struct OverNoise<'a, F> {
    pub problem: &'a Problem,
    /// Motion at the mode, with derivatives.
    pub all: &'a [Simulated],
    /// Information there, with the priors', by natural numbers.
    pub whole: &'a DMatrix<f64>,
    /// From scaled numbers to natural ones.
    pub natural: F,
}

impl<F: Fn(Normal) -> Normal + Sync> OverNoise<'_, F> {
    /// Change of the covariance by what is open of a DOF's noise and random force, and the half-width of each number's 95 % interval
    /// over that of a normal error of the same sd; `chosen` = the DOF's normal equations at the mode.
    pub fn change(
        &self,
        dof: usize,
        (cell, chosen): (Cell, &Normal),
        at_mode: &DMatrix<f64>,
    ) -> Option<(DMatrix<f64>, Vec<f64>)> {
        let found = self.states(dof, cell, chosen);
        let best = found.iter().map(|w| w.ln_weight).reduce(f64::max)?;
        let weights: Vec<f64> = found.iter().map(|w| (w.ln_weight - best).exp()).collect();
        let sum: f64 = weights.iter().sum();
        let mut change = DMatrix::zeros(at_mode.nrows(), at_mode.ncols());
        for (w, weight) in found.iter().zip(&weights) {
            let of = &w.covariance - at_mode + &w.away * w.away.transpose();
            change += of * (weight / sum);
        }
        let width = |i: usize| {
            let parts = found.iter().zip(&weights).map(|(w, weight)| Part {
                weight: weight / sum,
                mean: w.away[i],
                sd: w.covariance[(i, i)].sqrt(),
            });
            let parts: Vec<Part> = parts.collect();
            relative_width(&parts)
        };
        let widths = (0..at_mode.nrows()).map(width).collect();
        Some((change, widths))
    }

    /// States that count, from the likeliest noise on.
    fn states(&self, dof: usize, cell: Cell, chosen: &Normal) -> Vec<Weighed> {
        let channels = Channel::of(dof);
        let known = channels.map(|c| self.problem.noises.channels[c]);
        let begin = |colour: fn(Noise) -> Colour, cell: Cell| State {
            colours: known.map(|n| n.map(colour)),
            cell,
        };
        let mut asked: BTreeSet<State> = BTreeSet::new();
        let mut edge = BTreeSet::from([
            begin(nearest, cell).plain(),
            begin(|_| (0, NO_TIME), Cell::default()).plain(),
        ]);
        let mut found: BTreeMap<State, Weighed> = BTreeMap::new();
        while !edge.is_empty() && asked.len() < STATES_MOST {
            cancel::check();
            let next: Vec<State> = edge.iter().copied().collect();
            let made = parallel::map_slice(&next, |s| self.weighed(dof, *s, chosen));
            asked.extend(next.iter().copied());
            let there = next.into_iter().zip(made);
            let new: Vec<(State, Weighed)> = there.filter_map(|(s, w)| Some((s, w?))).collect();
            let all = found.values().chain(new.iter().map(|n| &n.1));
            let best = all.map(|w| w.ln_weight).fold(f64::NEG_INFINITY, f64::max);
            let counts = new.iter().filter(|n| n.1.ln_weight > best + LEAST.ln());
            edge = counts.flat_map(|n| n.0.neighbours()).collect();
            edge.retain(|s| !asked.contains(s));
            found.extend(new);
        }
        found.into_values().collect()
    }

    /// The instruments of a state, as loud as the white part that was found.
    fn noises(&self, dof: usize, state: &State) -> Noises {
        let mut noises = self.problem.noises.clone();
        for (c, colour) in Channel::of(dof).into_iter().zip(state.colours) {
            if let Some((noise, (ratio, time))) = noises.channels[c].as_mut().zip(colour) {
                noise.coloured_sd = RATIOS[ratio] * noise.white_sd;
                noise.correlation_s = TIMES_S[time];
            }
        }
        noises
    }

    /// Log prior of a state.
    fn ln_prior(&self, state: &State) -> f64 {
        let prior = &self.problem.body.prior;
        let of = |(ratio, time): Colour| match ratio {
            0 => WHITE.ln(),
            // A place of the grid is a doubling of either.
            _ => {
                (1.0 - WHITE).ln()
                    + ln_colour(RATIOS[ratio], TIMES_S[time], prior)
                    + 2.0 * 2f64.ln().ln()
            }
        };
        let colours: f64 = state.colours.into_iter().flatten().map(of).sum();
        let force = ln_prior(state.cell, prior);
        let times = match state.cell.size {
            0 => (CORRELATIONS_S.len() as f64).ln(),
            _ => 0.0,
        };
        colours + force + times
    }

    /// Probability of a state, its level chosen, and what it says; `None` where its information is singular.
    fn weighed(&self, dof: usize, state: State, chosen: &Normal) -> Option<Weighed> {
        let (problem, n) = (self.problem, self.whole.nrows());
        let noises = self.noises(dof, &state);
        let filters = filters(&problem.body, &problem.worth, &noises, dof, state.cell);
        let normal = (self.natural)(problem.normal_with(self.all, dof, &filters, n));
        let count = normal.used as f64;
        let ln_variance = 2.0 * normal.cost - normal.energy;
        let least = self.least_level(dof, &noises);
        // Level of noise and force together: its restricted likelihood is the largest where the energy left is one a sample.
        let mut level2 = 1.0_f64;
        let mut made = None;
        for _ in 0..2 {
            let information = self.whole - &chosen.information + &normal.information / level2;
            let root = Cholesky::new(information)?;
            let push = &normal.gradient / level2 - &chosen.gradient;
            let away = root.solve(&push);
            let gain = away.dot(&push);
            let free = away.len() as f64;
            let energy = (normal.energy - gain * level2).max(f64::MIN_POSITIVE);
            let ln_determinant: f64 = root.l_dirty().diagonal().iter().map(|v| 2.0 * v.ln()).sum();
            let cost = energy / level2 + count * level2.ln() + ln_variance + ln_determinant;
            made = Some((cost, root.inverse(), away));
            level2 = (energy / (count - free).max(1.0)).max(least);
        }
        let (cost, covariance, away) = made?;
        Some(Weighed {
            ln_weight: self.ln_prior(&state) - 0.5 * cost,
            covariance,
            away,
        })
    }

    /// Square of the least level: no noise is below what was measured at rest.
    fn least_level(&self, dof: usize, noises: &Noises) -> f64 {
        let each = Channel::of(dof).into_iter().filter_map(|c| {
            let (now, rest) = noises.channels[c].zip(noises.at_rest[c])?;
            Some((rest.total_sd() / now.total_sd()).powi(2))
        });
        each.fold(0.0, f64::max)
    }
}

/// Place of the colour that is nearest to a noise's.
fn nearest(noise: Noise) -> Colour {
    let ratio = noise.coloured_sd / noise.white_sd;
    let near = |all: &[f64], value: f64| {
        let apart = |v: &f64| (v.max(0.05) / value.max(0.05)).ln().abs();
        let each = all.iter().enumerate();
        each.min_by(|a, b| apart(a.1).total_cmp(&apart(b.1)))
            .map_or(0, |(i, _)| i)
    };
    (near(&RATIOS, ratio), near(&TIMES_S, noise.correlation_s))
}

/// Part of a mixture of normal errors.
struct Part {
    weight: f64,
    mean: f64,
    sd: f64,
}

/// Half-width of the interval about 0 that holds 95 % of a mixture's errors, over that of a normal error of the same mean square.
///
/// A random force that is improbable and large makes the mean square, and hardly the interval.
fn relative_width(parts: &[Part]) -> f64 {
    let square: f64 = parts
        .iter()
        .map(|p| p.weight * (p.sd * p.sd + p.mean * p.mean))
        .sum();
    let sd = square.sqrt();
    if !(sd.is_finite() && sd > 0.0) {
        return 1.0;
    }
    let holds = |half: f64| -> f64 {
        let below = |p: &Part, at: f64| erf((at - p.mean) / (2f64.sqrt() * p.sd));
        let each = parts.iter().filter(|p| p.sd > 0.0);
        each.map(|p| 0.5 * p.weight * (below(p, half) - below(p, -half)))
            .sum()
    };
    // By Chebyshev's inequality no 95 % interval is wider.
    let (mut low, mut high) = (0.0, sd / (1.0_f64 - 0.95).sqrt());
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        match holds(middle) < 0.95 {
            true => low = middle,
            false => high = middle,
        }
    }
    high / (NORMAL_95 * sd)
}

/// Half-width of a normal 95 % interval over its sd.
const NORMAL_95: f64 = 1.959_964;
/// Halvings of the interval in which a half-width is looked for: to a millionth of it.
const HALVINGS: usize = 25;

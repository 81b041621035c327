//! Covariance over what the residuals leave open of the noise and of the random force.
//!
//! The fit takes the likeliest noise for the noise. How much colour it has, residuals say poorly: a tenth of the white part is not
//! seen in a minute of samples, and doubles what they leave open of a coefficient. So the covariance is that over a grid of noises and
//! forces by their probabilities (law of total covariance), each with its own level, the mode under it one Newton step away.
//! References: Patterson and Thompson 1971 (numbers integrated out); Hoeting et al. 1999, Statist. Sci. 14 (model averaging).

mod colour;
mod ends;

use std::collections::BTreeSet;

use hydroline_core::run::{Channel, PerChannel};
use hydroline_inference::body::Simulated;
use hydroline_inference::fit::{Normal, Problem};
use hydroline_inference::hyper::{CORRELATIONS_S, Cell, Noises, SIZES, filters, ln_prior};
use hydroline_inference::noise::ln_colour;
use hydroline_numerics::{cancel, parallel};
use nalgebra::{Cholesky, DMatrix, DVector};

use colour::{Colour, Grid};
pub(crate) use ends::NORMAL_95;
use ends::{Part, relative_ends};

/// Probability that an instrument has no colour: as likely as not.
const WHITE: f64 = 0.5;
/// Share of all probability found so far below which a state is not followed further.
const LEAST: f64 = 5e-3;
/// States that are asked for at the most: with pose and rate of a DOF measured there would be thousands.
const STATES_MOST: usize = 400;

/// A noise of pose and rate, and a random force.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct State {
    colours: [Colour; 2],
    cell: Cell,
}

impl State {
    /// The same without the time of no force, which says nothing.
    fn plain(mut self) -> State {
        if self.cell.size == 0 {
            self.cell.correlation = 0;
        }
        self
    }

    /// Those one step away.
    fn neighbours(self, grids: &[Option<Grid>; 2]) -> Vec<State> {
        let mut made = Vec::new();
        for (which, grid) in grids.iter().enumerate() {
            let near = grid.iter().flat_map(|g| g.neighbours(self.colours[which]));
            made.extend(near.map(|colour| {
                let mut state = self;
                state.colours[which] = colour;
                state
            }));
        }
        let around = |at: usize, count: usize| {
            let below = at.checked_sub(1);
            below.into_iter().chain((at + 1 < count).then_some(at + 1))
        };
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
        let cells = sizes.chain(times);
        made.extend(cells.map(|cell| State { cell, ..self }.plain()));
        made
    }
}

/// What a state says of the numbers.
struct Weighed {
    ln_weight: f64,
    /// Covariance under it, and the step to its mode.
    covariance: DMatrix<f64>,
    away: DVector<f64>,
}

/// A fit's mode, about which states are looked at.
pub(crate) struct OverNoise<'a, F> {
    pub problem: &'a Problem,
    /// Motion at the mode, with the derivatives that act in the DOF.
    pub all: Vec<Simulated>,
    pub dof: usize,
    /// Information there, with the priors', by natural numbers.
    pub whole: &'a DMatrix<f64>,
    /// Numbers that are held: as uncertain as that says, and no noise moves them.
    pub held: &'a [usize],
    /// From scaled numbers to natural ones.
    pub natural: F,
}

/// What is open of a DOF's noise and random force does to the numbers.
pub(crate) struct Change {
    /// Of the mean: from the mode under the likeliest noise to that over all.
    pub mean: DVector<f64>,
    /// Of the covariance, about that mean.
    pub covariance: DMatrix<f64>,
    /// Ends of each number's 95 % interval about its mean, over its sd.
    pub ends: Vec<[f64; 2]>,
}

/// Motion with the derivatives that act in a DOF: all others are read in vain for every state.
pub(crate) fn acting(all: &[Simulated], dof: usize) -> Vec<Simulated> {
    let both = Channel::of(dof);
    let acts =
        |column: &[PerChannel<f64>]| column.iter().any(|v| both.iter().any(|c| v[*c] != 0.0));
    let of = |s: &Simulated| Simulated {
        values: s.values.clone(),
        columns: s.columns.iter().filter(|c| acts(&c.1)).cloned().collect(),
    };
    all.iter().map(of).collect()
}

impl<F: Fn(Normal) -> Normal + Sync> OverNoise<'_, F> {
    /// Change by the DOF; `chosen` = its normal equations at the mode, `at_mode` = the covariance there.
    pub fn change(
        &self,
        (cell, chosen): (Cell, &Normal),
        at_mode: &DMatrix<f64>,
    ) -> Option<Change> {
        let found = self.states(cell, chosen);
        let ln_sum = ln_sum(found.iter().map(|w| w.ln_weight));
        let n = at_mode.nrows();
        let (mut mean, mut square) = (DVector::zeros(n), DMatrix::zeros(n, n));
        let weights: Vec<f64> = found.iter().map(|w| (w.ln_weight - ln_sum).exp()).collect();
        for (w, weight) in found.iter().zip(&weights) {
            mean += &w.away * *weight;
            square += (&w.covariance - at_mode + &w.away * w.away.transpose()) * *weight;
        }
        let ends = |i: usize| {
            let parts = found.iter().zip(&weights).map(|(w, weight)| Part {
                weight: *weight,
                mean: w.away[i] - mean[i],
                sd: w.covariance[(i, i)].sqrt(),
            });
            relative_ends(&parts.collect::<Vec<Part>>())
        };
        let ends = (0..n).map(ends).collect();
        (!found.is_empty()).then(|| Change {
            ends,
            covariance: square - &mean * mean.transpose(),
            mean,
        })
    }

    /// States that count, from the likeliest noise and from none of anything on.
    fn states(&self, cell: Cell, chosen: &Normal) -> Vec<Weighed> {
        let grids = Channel::of(self.dof).map(|c| self.problem.noises.channels[c].map(Grid::of));
        let mut asked: BTreeSet<State> = BTreeSet::new();
        let likeliest = State {
            colours: grids.map(|g| g?.likeliest),
            cell,
        };
        let plain = State {
            colours: [None; 2],
            cell: Cell::default(),
        };
        let mut edge = BTreeSet::from([likeliest.plain(), plain]);
        let mut found: Vec<Weighed> = Vec::new();
        while !edge.is_empty() && asked.len() < STATES_MOST {
            cancel::check();
            let next: Vec<State> = edge.iter().copied().collect();
            let made = parallel::map_slice(&next, |s| self.weighed(&grids, *s, chosen));
            asked.extend(next.iter().copied());
            let there = next.into_iter().zip(made);
            let new: Vec<(State, Weighed)> = there.filter_map(|(s, w)| Some((s, w?))).collect();
            let all = found.iter().chain(new.iter().map(|n| &n.1));
            let least = ln_sum(all.map(|w| w.ln_weight)) + LEAST.ln();
            let counts = new.iter().filter(|n| n.1.ln_weight > least);
            edge = counts.flat_map(|n| n.0.neighbours(&grids)).collect();
            edge.retain(|s| !asked.contains(s));
            found.extend(new.into_iter().map(|n| n.1));
        }
        found
    }

    /// The instruments of a state, as loud as the white part that was found.
    fn noises(&self, grids: &[Option<Grid>; 2], state: &State) -> Noises {
        let mut noises = self.problem.noises.clone();
        for (c, (grid, colour)) in Channel::of(self.dof)
            .into_iter()
            .zip(grids.iter().zip(state.colours))
        {
            noises.channels[c] = grid.map(|g| g.noise(colour));
        }
        noises
    }

    /// Log prior of a state.
    fn ln_prior(&self, grids: &[Option<Grid>; 2], state: &State) -> f64 {
        let prior = &self.problem.body.prior;
        let of = |(grid, colour): (&Grid, Colour)| match colour {
            None => WHITE.ln(),
            // A place of the grid is a doubling of either.
            Some(c) => {
                let (ratio, time_s) = grid.at(c);
                (1.0 - WHITE).ln() + ln_colour(ratio, time_s, prior) + 2.0 * 2f64.ln().ln()
            }
        };
        let each = grids.iter().zip(state.colours);
        let colours: f64 = each.filter_map(|(g, c)| Some(of((g.as_ref()?, c)))).sum();
        let force = ln_prior(state.cell, prior);
        let times = match state.cell.size {
            0 => (CORRELATIONS_S.len() as f64).ln(),
            _ => 0.0,
        };
        colours + force + times
    }

    /// Probability of a state, its level chosen, and what it says; `None` where its information is singular.
    fn weighed(&self, grids: &[Option<Grid>; 2], state: State, chosen: &Normal) -> Option<Weighed> {
        let (problem, n) = (self.problem, self.whole.nrows());
        let noises = self.noises(grids, &state);
        let filters = filters(&problem.body, &problem.worth, &noises, self.dof, state.cell);
        let normal = (self.natural)(problem.normal_with(&self.all, self.dof, &filters, n));
        let count = normal.used as f64;
        let ln_variance = 2.0 * normal.cost - normal.energy;
        let least = self.least_level(&noises);
        // Level of noise and force together: its restricted likelihood is the largest where the energy left is one a sample.
        let mut level2 = 1.0_f64;
        let mut made = None;
        for _ in 0..2 {
            let information = self.whole - &chosen.information + &normal.information / level2;
            let mut push = &normal.gradient / level2 - &chosen.gradient;
            let root = Cholesky::new(self.beside_held(&information, &mut push))?;
            let away = root.solve(&push);
            let gain = away.dot(&push);
            let free = (n - self.held.len()) as f64;
            let energy = (normal.energy - gain * level2).max(f64::MIN_POSITIVE);
            let ln_determinant: f64 = root.l_dirty().diagonal().iter().map(|v| 2.0 * v.ln()).sum();
            let cost = energy / level2 + count * level2.ln() + ln_variance + ln_determinant;
            made = Some((cost, information, away));
            level2 = (energy / (count - free).max(1.0)).max(least);
        }
        let (cost, information, away) = made?;
        Some(Weighed {
            ln_weight: self.ln_prior(grids, &state) - 0.5 * cost,
            covariance: Cholesky::new(information)?.inverse(),
            away,
        })
    }

    /// Information and gradient under which what is held stays.
    fn beside_held(&self, information: &DMatrix<f64>, push: &mut DVector<f64>) -> DMatrix<f64> {
        let mut beside = information.clone();
        for i in self.held {
            beside.fill_row(*i, 0.0);
            beside.fill_column(*i, 0.0);
            beside[(*i, *i)] = 1.0;
            push[*i] = 0.0;
        }
        beside
    }

    /// Square of the least level: no noise is below what was measured at rest.
    fn least_level(&self, noises: &Noises) -> f64 {
        let each = Channel::of(self.dof).into_iter().filter_map(|c| {
            let (now, rest) = noises.channels[c].zip(noises.at_rest[c])?;
            Some((rest.total_sd() / now.total_sd()).powi(2))
        });
        each.fold(0.0, f64::max)
    }
}

/// Log of the sum of what these are the logs of.
fn ln_sum(all: impl Iterator<Item = f64> + Clone) -> f64 {
    let most = all.clone().fold(f64::NEG_INFINITY, f64::max);
    most + all.map(|v| (v - most).exp()).sum::<f64>().ln()
}

//! Noise of the instruments, common to all models of a recording, and the random forces that each model has of its own.

use std::collections::BTreeMap;

use hydroline_core::run::{Channel, PerChannel};
use hydroline_numerics::cholesky::{PROJECTION_JITTER, ScaledCholesky};
use hydroline_numerics::noise::Noise;
use hydroline_numerics::parallel;
use nalgebra::{DMatrix, DVector, Dyn};
use rand::{SeedableRng, rngs::StdRng};
use rand_distr::{Distribution, StandardNormal};

use super::body::{Body, Simulated};
use super::filter::{Filter, Force, Instruments, draw};
use super::prior::PriorTable;
use super::table::TableCell;

/// Correlation times of the random force \[s\]: from the shortest that a vehicle follows to as long as a run.
pub const CORRELATIONS_S: [f64; 4] = [0.3, 1.5, 6.0, 25.0];
/// Sizes of the random force, over the tolerance: half-decades.
pub const SIZES: [f64; 15] = [
    0.0, 3e-3, 1e-2, 3e-2, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0, 300.0, 1e3, 3e3, 1e4,
];

/// Noise of every channel, and which samples count.
#[derive(Debug, Clone)]
pub struct Noises {
    /// Per channel; `None` = not measured.
    pub channels: PerChannel<Option<Noise>>,
    /// Per run, sample and channel.
    pub used: Vec<Vec<PerChannel<bool>>>,
    /// sd per channel below which likelihoods do not look: a coarsened likelihood (Miller and Dunson 2019, JASA 114).
    pub floor_sd: PerChannel<f64>,
    /// Whether models have random forces beside it.
    pub has_force: bool,
    /// Noise of each channel at rest: none is quieter in motion; `None` = no run rested.
    pub at_rest: PerChannel<Option<Noise>>,
}

impl Noises {
    /// Noise that a likelihood takes a channel for: the instrument's, its white part no less than the floor.
    pub fn scored(&self, channel: Channel) -> Option<Noise> {
        self.channels[channel].map(|n| Noise {
            white_sd: n.white_sd.max(self.floor_sd[channel]),
            ..n
        })
    }

    /// The same noise over other samples.
    pub fn over(&self, used: Vec<Vec<PerChannel<bool>>>) -> Noises {
        Noises {
            channels: self.channels,
            used,
            floor_sd: self.floor_sd,
            has_force: self.has_force,
            at_rest: self.at_rest,
        }
    }

    /// Channels that are noisier than before stay as they were.
    pub fn no_larger_than(&mut self, before: &Noises) {
        for c in Channel::ALL {
            let (Some(new), Some(old)) = (&self.channels[c], &before.channels[c]) else {
                continue;
            };
            if new.total_sd() <= old.total_sd() {
                continue;
            }
            self.channels[c] = before.channels[c];
            let runs = self.used.iter_mut().zip(&before.used);
            for (new, old) in runs.flat_map(|(new, old)| new.iter_mut().zip(old)) {
                new[c] = old[c];
            }
        }
    }

    /// Nothing measured.
    pub fn none() -> Noises {
        Noises {
            channels: PerChannel::splat(None),
            used: Vec::new(),
            floor_sd: PerChannel::splat(0.0),
            has_force: true,
            at_rest: PerChannel::splat(None),
        }
    }

    /// The louder of a channel's noise beside a model and at rest.
    pub fn no_quieter_than_at_rest(&self, channel: Channel, found: Option<Noise>) -> Option<Noise> {
        let found = found?;
        let rest = self.at_rest[channel].filter(|r| r.total_sd() > found.total_sd());
        Some(rest.unwrap_or(found))
    }
}

/// A size and a correlation time of the random force in a DOF, by their places in the tables.
#[derive(Debug, Default, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Cell {
    /// Place in [`SIZES`].
    pub size: usize,
    /// Place in [`CORRELATIONS_S`].
    pub correlation: usize,
}

impl Cell {
    /// Every one.
    pub fn all() -> impl Iterator<Item = Cell> {
        (0..SIZES.len()).flat_map(|size| {
            (0..CORRELATIONS_S.len()).map(move |correlation| Cell { size, correlation })
        })
    }
}

/// Per DOF the random force's cells with their probabilities.
pub type Forces = Vec<(usize, Vec<(Cell, f64)>)>;
/// Random forces of all DOFs.
pub type Misfit = [Cell; 6];
/// Size and length of each table, by its candidate.
pub type Tables = BTreeMap<usize, TableCell>;

/// Cells that are chosen beside a model's numbers, and summed over.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct Cells {
    /// Random forces.
    pub misfit: Misfit,
    /// Tables; those of other models may stand here as well.
    pub tables: Tables,
}

impl Cells {
    /// These random forces, no table.
    pub fn of(misfit: Misfit) -> Cells {
        Cells {
            misfit,
            tables: Tables::new(),
        }
    }

    /// A table's cell.
    pub fn table(&self, candidate: usize) -> TableCell {
        let known = self.tables.get(&candidate).copied();
        known.unwrap_or(TableCell::BEGIN)
    }
}

/// Realisations of the force from which its worth is taken: the mean square is then known to some 15 %.
const DRAWS: usize = 48;

/// Of every DOF what the force is worth where it is as large as the tolerance: sd of the acceleration per correlation
/// time. Worth is counted as the weight of an effect is: rms of the response over the stamps, what the vehicle's own
/// numbers and the runs' starts can do taken out.
#[derive(Debug, Clone)]
pub struct Worth {
    unit_mps2: [[f64; CORRELATIONS_S.len()]; 6],
}

impl Worth {
    /// Of no recording: forces are not asked of it.
    pub(super) fn none() -> Worth {
        Worth {
            unit_mps2: [[0.0; CORRELATIONS_S.len()]; 6],
        }
    }

    /// Of a body's runs; `all` = their motion without effects, with derivatives.
    pub fn new(body: &Body, all: &[Simulated]) -> Worth {
        let channels = &body.recording.channels;
        let mut unit_mps2 = [[0.0; CORRELATIONS_S.len()]; 6];
        let made = parallel::map_slice(&body.dofs, |&d| {
            // Positions where they are measured, rates else.
            let [place, rate] = Channel::of(d);
            let which = usize::from(!channels[place] && channels[rate]);
            let channel = [place, rate][which];
            let own = Own::new(all, channel);
            std::array::from_fn(|c| {
                let rms = own.worth(body, d, which, CORRELATIONS_S[c]);
                body.tolerance[channel] / rms.max(1e-12)
            })
        });
        for (d, each) in body.dofs.iter().zip(made) {
            unit_mps2[*d] = each;
        }
        Worth { unit_mps2 }
    }

    /// The force of a cell.
    pub fn force(&self, dof: usize, cell: Cell) -> Force {
        Force {
            sd_mps2: SIZES[cell.size] * self.unit_mps2[dof][cell.correlation],
            correlation_s: CORRELATIONS_S[cell.correlation],
        }
    }
}

/// Derivatives of one channel by the vehicle's own numbers and the starts, with the factor of their products.
struct Own {
    derivatives: DMatrix<f64>,
    root: Option<ScaledCholesky<Dyn>>,
}

impl Own {
    fn new(all: &[Simulated], channel: Channel) -> Own {
        let rows: usize = all.iter().map(|s| s.values.len()).sum();
        let size = all
            .iter()
            .flat_map(|s| &s.columns)
            .map(|c| c.0 + 1)
            .max()
            .unwrap_or(0);
        let mut derivatives = DMatrix::zeros(rows, size);
        let mut at = 0;
        for s in all {
            for (i, column) in &s.columns {
                for (k, state) in column.iter().enumerate() {
                    derivatives[(at + k, *i)] = state[channel];
                }
            }
            at += s.values.len();
        }
        let acting: Vec<usize> = (0..size)
            .filter(|i| derivatives.column(*i).norm_squared() > 0.0)
            .collect();
        let derivatives = derivatives.select_columns(&acting);
        let square = derivatives.tr_mul(&derivatives);
        Own {
            root: ScaledCholesky::new(&square, PROJECTION_JITTER),
            derivatives,
        }
    }

    /// rms of the response to a force of sd 1, outside of what these can do.
    fn worth(&self, body: &Body, dof: usize, which: usize, correlation_s: f64) -> f64 {
        let mut rng = StdRng::seed_from_u64(dof as u64);
        let mut sum = 0.0;
        let rows = self.derivatives.nrows();
        for _ in 0..DRAWS {
            let mut drawn = DVector::zeros(rows);
            let mut at = 0;
            for r in &body.recording.runs {
                let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
                let response = body.responses[dof];
                for v in draw(&r.times_s, r.start_s, response, correlation_s, &mut normal) {
                    drawn[at] = v[which];
                    at += 1;
                }
            }
            if let Some(root) = &self.root {
                let part = root.solve(&self.derivatives.tr_mul(&drawn));
                drawn -= &self.derivatives * part;
            }
            sum += drawn.norm_squared() / rows.max(1) as f64;
        }
        (sum / DRAWS as f64).sqrt()
    }
}

/// Log of a sum of exponentials.
pub(super) fn ln_sum(terms: &[f64]) -> f64 {
    let top = terms.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    if top == f64::NEG_INFINITY {
        return top;
    }
    top + terms.iter().map(|t| (t - top).exp()).sum::<f64>().ln()
}

/// Log prior probability of a cell: none with the probability of an exact model, else half-Cauchy sizes; every correlation time alike.
pub fn ln_prior(cell: Cell, prior: &PriorTable) -> f64 {
    let size = ln_half_cauchy(&SIZES, cell.size, prior.misfit_over_tolerance);
    let size = match (prior.exact > 0.0, cell.size) {
        (false, _) => size,
        (true, 0) => (prior.exact + (1.0 - prior.exact) * size.exp()).ln(),
        (true, _) => (1.0 - prior.exact).ln() + size,
    };
    size - (CORRELATIONS_S.len() as f64).ln()
}

/// Log probability of a place in a table of sizes under a half-Cauchy density with this median.
pub fn ln_half_cauchy(sizes: &[f64], place: usize, median: f64) -> f64 {
    // A cell reaches half-way to its neighbours.
    let edge = |i: usize| (sizes[i].max(1e-3) * sizes[i + 1]).sqrt();
    let low = if place == 0 { 0.0 } else { edge(place - 1) };
    let high = if place + 1 < sizes.len() {
        edge(place)
    } else {
        f64::INFINITY
    };
    let below = |v: f64| (v / median).atan() * std::f64::consts::FRAC_2_PI;
    (below(high) - below(low)).max(1e-300).ln()
}

/// The filters of one DOF, one per run.
pub fn filters(body: &Body, worth: &Worth, noises: &Noises, dof: usize, cell: Cell) -> Vec<Filter> {
    let force = worth.force(dof, cell);
    with_force(body, noises, dof, force)
}

/// The same for any force.
pub fn with_force(body: &Body, noises: &Noises, dof: usize, force: Force) -> Vec<Filter> {
    let both = Channel::of(dof);
    let instruments: Instruments = both.map(|c| noises.scored(c));
    body.recording
        .runs
        .iter()
        .zip(&noises.used)
        .map(|(r, used)| {
            Filter::new(
                &r.times_s,
                r.start_s,
                body.responses[dof],
                force,
                &instruments,
                |k, c| r.sd_ratio_of(k, both[c], used[k][both[c]]),
            )
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_cells_share_all_probability() {
        for exact in [0.0, 0.5] {
            let prior = PriorTable {
                exact,
                ..PriorTable::default()
            };
            let each = || Cell::all().map(|cell| (cell.size, ln_prior(cell, &prior).exp()));
            let sum: f64 = each().map(|c| c.1).sum();
            assert!((sum - 1.0).abs() < 1e-9, "{sum}");
            let none: f64 = each().filter(|c| c.0 == 0).map(|c| c.1).sum();
            assert!((exact..exact + 0.02).contains(&none), "{none}");
        }
    }
}

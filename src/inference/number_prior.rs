//! Prior of all numbers of a model: a density each, and one for each table's points together.

use hydroline_sim::vehicle::Hydrodynamics;
use nalgebra::{DMatrix, DVector};

use super::fit::Problem;
use super::hyper::{CORRELATIONS_S, Cell, Cells};
use super::prior::Density;
use super::table::Block;
use super::term::Kind;

/// Information of a number of which neither data nor prior say anything: it keeps a factor from failing.
const INFORMATION_LEAST: f64 = 1e-12;

/// Prior of a model's numbers.
#[derive(Debug, Clone)]
pub struct NumberPrior {
    /// One per number.
    pub densities: Vec<Density>,
    /// Tables among them.
    pub blocks: Vec<Block>,
}

impl NumberPrior {
    /// Log density of a point.
    pub fn ln(&self, point: &[f64], cells: &Cells) -> f64 {
        let each = self.densities.iter().zip(point);
        let tables = self.blocks.iter();
        each.map(|(d, v)| d.ln(*v)).sum::<f64>()
            + tables
                .map(|b| b.ln(cells.table(b.candidate), point))
                .sum::<f64>()
    }

    /// Log prior probability of the tables' sizes and lengths.
    pub fn ln_cells(&self, cells: &Cells) -> f64 {
        let tables = self.blocks.iter();
        tables
            .map(|b| cells.table(b.candidate).ln_prior(b.median))
            .sum()
    }

    /// Adds what it says at a point to normal equations.
    pub fn add(
        &self,
        point: &[f64],
        cells: &Cells,
        information: &mut DMatrix<f64>,
        gradient: &mut DVector<f64>,
    ) {
        self.add_from(0, point, information, gradient);
        self.add_tables(point, cells, information, gradient);
    }

    /// The same of the tables alone.
    pub fn add_tables(
        &self,
        point: &[f64],
        cells: &Cells,
        information: &mut DMatrix<f64>,
        gradient: &mut DVector<f64>,
    ) {
        for b in &self.blocks {
            b.add(cells.table(b.candidate), point, information, gradient);
        }
    }

    /// The same of the numbers from one on, without tables.
    pub fn add_from(
        &self,
        first: usize,
        point: &[f64],
        information: &mut DMatrix<f64>,
        gradient: &mut DVector<f64>,
    ) {
        for (i, (density, v)) in self.densities.iter().zip(point).enumerate().skip(first) {
            let (slope, curvature) = density.step(*v);
            gradient[i] += slope;
            information[(i, i)] += curvature.max(INFORMATION_LEAST);
        }
    }

    /// Log density of the runs' starts, which begin at `first`.
    pub fn ln_starts(&self, first: usize, point: &[f64]) -> f64 {
        let each = self.densities[first..].iter().zip(&point[first..]);
        each.map(|(d, v)| d.ln(*v)).sum()
    }

    /// The same of the runs' starts, which begin at `first`, to equations that hold them alone.
    pub fn add_starts(
        &self,
        first: usize,
        point: &[f64],
        information: &mut DMatrix<f64>,
        gradient: &mut DVector<f64>,
    ) {
        let starts = NumberPrior {
            densities: self.densities[first..].to_vec(),
            blocks: Vec::new(),
        };
        starts.add_from(0, &point[first..], information, gradient);
    }
}

impl Problem {
    /// Prior of a model's numbers.
    pub fn number_prior(&self, terms: &[usize]) -> NumberPrior {
        let places = self.body.places(terms);
        let tables = terms.iter().zip(places);
        let blocks = tables.filter_map(|(t, first)| {
            let (unit, median) = self.unit(*t)?;
            Some(Block {
                candidate: *t,
                first,
                unit,
                median,
                centred: matches!(self.body.candidates[*t].kind, Kind::Trend { .. }),
            })
        });
        NumberPrior {
            densities: self.body.densities(terms),
            blocks: blocks.collect(),
        }
    }

    /// Unit of a table's sizes, and their median in it; `None` where a candidate is no table.
    pub(super) fn unit(&self, candidate: usize) -> Option<(f64, f64)> {
        let prior = &self.body.prior;
        match self.body.candidates[candidate].kind {
            Kind::Effect | Kind::Form { .. } => None,
            Kind::Trend { .. } => Some((1.0, prior.inexact_share)),
            Kind::Force { dof } => {
                // As large as a random force that is worth the tolerance.
                let one = super::hyper::SIZES.iter().position(|s| *s == 1.0)?;
                let each = (0..CORRELATIONS_S.len()).map(|correlation| {
                    let cell = Cell {
                        size: one,
                        correlation,
                    };
                    self.worth.force(dof, cell).sd_mps2.ln()
                });
                let mean = each.sum::<f64>() / CORRELATIONS_S.len() as f64;
                let h: Hydrodynamics<f64> = Hydrodynamics::new(&self.body.vehicle);
                let unit = mean.exp() * h.mass()[dof];
                Some((unit, prior.unnamed_over_tolerance))
            }
        }
    }
}

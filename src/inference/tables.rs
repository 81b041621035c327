//! Gain of a table beside a fitted model: a force of no known effect, or the law of a member that is only nearly the
//! library's.
//!
//! A table has as many directions as points; all are taken at nothing, its size and length are chosen as those of random
//! forces are, and its points integrated out.

use hydroline_numerics::parallel;
use hydroline_rigs::Dof;

use super::equations::Equations;
use super::fit::{Fit, Problem};
use super::hyper::{Cell, Cells, SIZES};
use super::term::{Kind, is_function_of};

/// A random force of at least this many tolerances says that something without a name may act.
const LEFT: f64 = 0.3;
/// One of at least this many says that a law may be inexact: what is left of a law that is nearly right is small.
const LEFT_OF_A_LAW: f64 = 0.03;
/// Probability from which it is looked for.
const ASKED: f64 = 0.5;
/// Places in the table of sizes by which random forces are taken smaller for a second look: they shrink when the right
/// table joins.
const SHRUNK: usize = 3;

/// A table beside a model.
#[derive(Debug, Clone)]
pub(super) struct TableGain {
    pub candidate: usize,
    /// Cells at which it is worth most.
    pub cells: Cells,
    /// Gain in log evidence, all numbers integrated out about where the model is.
    pub gain: f64,
}

impl Problem {
    /// DOFs in which a model leaves a random force of at least this many tolerances.
    fn lacking(&self, fit: &Fit, least: f64) -> Vec<usize> {
        let some = fit.forces.iter().filter(|(_, cells)| {
            let large = cells.iter().filter(|(cell, _)| SIZES[cell.size] >= least);
            large.map(|(_, p)| p).sum::<f64>() >= ASKED
        });
        some.map(|(d, _)| *d).collect()
    }

    /// Known laws that the force of a table may be, nearly: (effect, how it varies) of those that are a function of the same
    /// covariate in the same DOF.
    pub(super) fn nearly(&self, table: usize) -> Vec<(usize, usize)> {
        let all = &self.body.candidates;
        let (Kind::Force { dof }, Some((along, _))) = (all[table].kind, all[table].along) else {
            return Vec::new();
        };
        let here = Some(Dof::ALL[dof].name());
        let each = all.iter().enumerate().filter_map(|(k, c)| {
            let (Kind::Trend { of }, Some(varies)) = (c.kind, c.along) else {
                return None;
            };
            let same = varies.0 == along && c.place() == here;
            (same && is_function_of(&all[of], dof, varies, &self.body.vehicle)).then_some((of, k))
        });
        each.collect()
    }

    /// Tables beside a model, best first; no forces in DOFs in which only laws are asked.
    pub(super) fn tables(&self, fit: &Fit, only_laws: &[bool; 6]) -> Vec<TableGain> {
        let lacking = self.lacking(fit, LEFT);
        if self.lacking(fit, LEFT_OF_A_LAW).is_empty() {
            return Vec::new();
        }
        let asked = |c: &usize| {
            !fit.terms.contains(c)
                && match self.body.candidates[*c].kind {
                    Kind::Effect | Kind::Form { .. } => false,
                    Kind::Force { dof } => lacking.contains(&dof) && !only_laws[dof],
                    // One number varies with one covariate.
                    Kind::Trend { of } => {
                        let member = fit.terms.iter().position(|t| *t == of);
                        member.is_some_and(|m| self.dependants(&fit.terms, m).next().is_none())
                    }
                }
        };
        let asked: Vec<usize> = (0..self.body.candidates.len()).filter(asked).collect();
        let Some(here) = self.simulate(&fit.terms, &fit.point) else {
            return Vec::new();
        };
        let number_prior = self.number_prior(&fit.terms);
        let mut equations = Equations::new(self, fit.point.len());
        let before = equations.restricted(&here, &fit.cells, &number_prior, &fit.point);
        let made = parallel::map_slice(&asked, |&candidate| {
            let nothing = vec![0.0; self.body.candidates[candidate].scales.len()];
            let (terms, point) = self.with(fit, candidate, &nothing);
            let all = self.simulate(&terms, &point)?;
            let number_prior = self.number_prior(&terms);
            let mut equations = Equations::new(self, point.len());
            let from = [0, SHRUNK].map(|by| {
                let mut cells = fit.cells.clone();
                for cell in &mut cells.misfit {
                    *cell = Cell {
                        size: cell.size.saturating_sub(by),
                        ..*cell
                    };
                }
                cells
            });
            let each = from.into_iter();
            let each = each.map(|cells| equations.choose(&all, cells, &number_prior, &point));
            let (cells, after) = each.min_by(|a, b| a.1.total_cmp(&b.1))?;
            // Each number that is integrated out brings its share of the normal density's constant.
            let more = 0.5 * (point.len() - fit.point.len()) as f64 * std::f64::consts::TAU.ln();
            let gain = before - after + more;
            gain.is_finite().then_some(TableGain {
                candidate,
                cells,
                gain,
            })
        });
        let mut made: Vec<TableGain> = made.into_iter().flatten().collect();
        made.sort_by(|a, b| b.gain.total_cmp(&a.gain));
        for p in made.iter().take(4) {
            let c = &self.body.candidates[p.candidate];
            tracing::debug!(
                "{} would gain {:.1} at {:?}, {:?}",
                c.name(),
                p.gain,
                p.cells.table(p.candidate),
                lacking
                    .iter()
                    .map(|d| p.cells.misfit[*d])
                    .collect::<Vec<_>>()
            );
        }
        made
    }
}

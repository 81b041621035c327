//! Forms in a table's place: fitted to the data, with the fit that every model has.

use hydroline_numerics::parallel;
use hydroline_sim::effect::EffectInfo;
use hydroline_sim::effect::covariate_table::POINTS;
use hydroline_sim::effect::written_force::is_a_rate;
use nalgebra::{Cholesky, DMatrix, DVector};

use super::curve::Likelihood;
use super::grammar::{Along, held};
use super::rank::Ranked;
use crate::equations::Equations;
use crate::fit::{Effort, Fit, Problem};
use crate::number_prior::NumberPrior;
use crate::summary::Rms;
use crate::term::{Candidate, Kind};

/// A form predicts worse than its table where the error, in tolerances and noise, is larger by this share: less is what chance
/// makes of four runs.
const WORSE: f64 = 0.1;
/// A form to be fitted.
pub(super) struct Draft {
    pub ranked: Ranked,
    /// Factor on it, by its place among the simulator's words, and the rate at which that factor is one.
    pub times: (usize, f64),
    /// Log prior odds over the table.
    pub ln_odds: f64,
}

fn label(f: &Ranked) -> String {
    let names = f.pieces.each_ref();
    let names = names.map(|p| hydroline_sim::effect::form::FORMS[p.form]);
    format!("{names:?} {:.4?} {:.1}", f.numbers(), f.ln_score())
}

fn candidate(info: &'static EffectInfo, along: &Along, draft: &Draft, kind: Kind) -> Candidate {
    let form = &draft.ranked;
    let [first, second] = form.pieces.each_ref();
    let (times, at) = draft.times;
    Candidate {
        kind,
        info,
        parameters: info.parameters.to_vec(),
        words: vec![along.dof, along.covariate, first.form, second.form, times],
        fixed: Vec::new(),
        along: None,
        scales: [&first.scales[..], &second.scales, &[held(at)]].concat(),
        starts: vec![[&form.numbers()[..], &[at]].concat()],
        nothing: 0.0,
        linear: Vec::new(),
        own: false,
    }
}

impl Problem {
    /// Whether a form predicts held-out runs worse than its table, both in the same units: what a table leaves open where no
    /// other run has been is just what it is worse by.
    pub(super) fn is_worse(&self, form: &Rms, table: &Rms) -> bool {
        let size = |rms: &Rms| -> f64 {
            let each = self.noises.channels.each();
            each.filter_map(|(c, _)| {
                let least = self.noise_or_tolerance(c)?;
                Some((rms[c] / least).powi(2)).filter(|v| v.is_finite())
            })
            .sum()
        };
        let (form, table) = (size(form), size(table));
        // Within noise and tolerance nobody is worse.
        let channels = self.noises.channels.iter().flatten().count() as f64;
        form > channels && form > (1.0 + WORSE) * table
    }

    /// Factors that a form may have: each rate that moves, its size, its sign, but for that along which it runs; with
    /// the rate at which the factor is one.
    pub(super) fn factors(&self, along: &Along) -> Vec<(usize, f64)> {
        const RATES: usize = 6;
        let tables = self.body.candidates.iter().filter_map(|c| match c.kind {
            Kind::Force { dof } if dof == along.dof => c.along,
            _ => None,
        });
        let rates = tables.filter(|(c, _)| is_a_rate(*c) && *c != along.covariate);
        rates
            .flat_map(|(c, (low, high))| {
                let at = 0.5 * low.abs().max(high.abs());
                let rate = c - RATES;
                [0, 1, 2].map(|kind| (1 + kind * RATES + rate, at))
            })
            .collect()
    }

    /// Forms in a table's place: (which draft, its candidate, its fit); they join the candidates.
    pub(super) fn fitted(
        &mut self,
        info: &'static EffectInfo,
        table: usize,
        along: &Along,
        bare: &Fit,
        drafts: &[Draft],
    ) -> Vec<(usize, usize, Fit)> {
        let first = self.body.candidates.len();
        for d in drafts {
            let kind = Kind::Form {
                dof: along.dof,
                table,
                ln_odds: d.ln_odds,
            };
            self.body.candidates.push(candidate(info, along, d, kind));
        }
        let fit = |k: usize| {
            let candidate = first + k;
            let start = &self.body.candidates[candidate].starts[0];
            let (terms, point) = self.with(bare, candidate, start);
            let made = self.fit(&terms, &point, bare.cells.clone(), Effort::default())?;
            tracing::debug!(
                "fitted {} times {:?}: {:.1} {:?}",
                label(&drafts[k].ranked),
                drafts[k].times,
                made.ln_score,
                made.cells.misfit[along.dof]
            );
            Some((k, candidate, made))
        };
        let fits = parallel::map(drafts.len(), fit);
        fits.into_iter().flatten().collect()
    }

    /// Likelihood of a table's points by the data, all other numbers of the model integrated out about where it is.
    pub(super) fn of_table(&self, fit: &Fit, member: usize) -> Option<Likelihood> {
        let all = self.simulate(&fit.terms, &fit.point)?;
        let number_prior = self.number_prior(&fit.terms);
        let table = fit.terms[member];
        // Of this table the data alone.
        let others = NumberPrior {
            blocks: number_prior
                .blocks
                .into_iter()
                .filter(|b| b.candidate != table)
                .collect(),
            densities: number_prior.densities,
        };
        let mut equations = Equations::new(self, fit.point.len());
        let (information, gradient, _) = equations.sum(&all, &fit.cells, &others, &fit.point);
        let first = self.body.places(&fit.terms)[member];
        let mine = |i: &usize| (first..first + POINTS).contains(i);
        let (own, rest): (Vec<usize>, Vec<usize>) = (0..fit.point.len()).partition(mine);
        let part = |rows: &[usize], columns: &[usize]| {
            DMatrix::from_fn(rows.len(), columns.len(), |i, j| {
                information[(rows[i], columns[j])]
            })
        };
        let of =
            |rows: &[usize]| DVector::from_iterator(rows.len(), rows.iter().map(|i| gradient[*i]));
        let root = Cholesky::new(part(&rest, &rest))?;
        let across = part(&rest, &own);
        let solved = root.solve(&across);
        let mut left = part(&own, &own) - across.tr_mul(&solved);
        // Rounding leaves it not quite symmetric.
        left = (&left + left.transpose()) * 0.5;
        let slope = of(&own) - solved.tr_mul(&of(&rest));
        let here = DVector::from_iterator(POINTS, own.iter().map(|i| fit.point[*i]));
        Some(Likelihood {
            slope: slope + &left * here,
            information: left,
        })
    }
}

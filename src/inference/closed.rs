//! The closed form of a force without a name: the simplest expression of its covariate that the data want instead of a table.
//!
//! Of the likeliest model that holds a table, what the data say of the table's points ranks all forms (`rank`) that the
//! grammar has (`grammar`). The best are fitted to the data in the table's place, by the fit and the score that every model
//! has, and compete with the table, which stands for every form that the grammar does not have. Where a form is likely
//! by the evidence it has to foretell runs left out as well as the table does; then it joins the models, and the search
//! goes on beside it.
//!
//! References: Schmidt and Lipson 2009 (laws from data); Duvenaud and others 2013 (Gaussian process to structure).

mod grammar;
mod rank;
#[cfg(test)]
mod tests;

use rayon::prelude::*;

use hydroline_sim::effect::along::{COVARIATES, POINTS};
use hydroline_sim::effect::written_force::is_a_rate;
use hydroline_sim::effect::{EffectInfo, find};
use nalgebra::{Cholesky, DMatrix, DVector};

use super::belief::Belief;
use super::equations::Equations;
use super::fit::{Effort, Fit, Problem};
use super::posterior::{Posterior, UNNAMED};
use super::search::{Found, Options, resumed};
use super::summary::Rms;
use super::term::{Candidate, Kind};
use grammar::{Along, held};
use rank::{Likelihood, Ranked, ranked};

/// Probability from which forms stand in a table's place: then one is the better bet, for what is held against it is no less an
/// assumption. None is called the law for that.
const STANDS: f64 = 0.5;
/// Odds within which forms are told beside the likeliest.
const ODDS: f64 = 20.0;
/// Share of a DOF's unnamed force from which a covariate's table is written down.
const SHARE: f64 = 0.2;
/// Forms fitted per table, and log odds below the best of the ranking at which none is: it is made at the table's own
/// place, not at the form's.
const FITTED: usize = 6;
/// See there.
const BELOW: f64 = 9.0;
/// A form foretells worse than its table where the error, in tolerances and noise, is larger by this share: less is what chance
/// makes of four runs.
const WORSE: f64 = 0.1;
/// Share of a search's cost for which it goes on beside the forms.
const GOES_ON: usize = 6;

/// A form fitted to the data.
#[derive(Debug, Clone)]
pub struct Form {
    /// Its model.
    pub fit: Fit,
    /// Its candidate.
    pub candidate: usize,
    /// Probability among all forms of this table and the table itself.
    pub probability: f64,
}

/// What a table was written down as.
#[derive(Debug, Clone)]
pub struct Closed {
    /// The table's candidate.
    pub table: usize,
    /// Forms within odds of 20 of the likeliest, the table among what they are held against; likeliest first.
    pub forms: Vec<Form>,
    /// Probability that it has no form of the grammar.
    pub none: f64,
    /// Its forms stand in its place: together they are likely, and foretell runs left out as well as the table does.
    pub stands: bool,
    /// Runs left out: (the likeliest form, the table); `None` where that was not asked.
    pub left_out: Option<(Rms, Rms)>,
}

/// Writes down the forces without a name that a search found.
pub fn closed(
    mut found: Found,
    options: Options,
    progress: &(dyn Fn(&str) + Sync),
) -> (Found, Vec<Closed>) {
    let Some(info) = find("written_force") else {
        return (found, Vec::new());
    };
    let visited = found.models.keys().cloned().collect();
    let mut made = Vec::new();
    for (table, terms) in tables(&found) {
        let Some(fit) = found.models.get(&terms).cloned() else {
            continue;
        };
        progress(&format!(
            "closed form of {}",
            found.problem.body.candidates[table].name()
        ));
        if let Some(one) = one(&mut found, info, table, &fit) {
            if one.stands {
                let forms = one.forms.iter().map(|f| &f.fit);
                let fits = forms.map(|f| (f.terms.clone(), f.clone()));
                found.models.extend(fits);
            }
            made.push(one);
        }
    }
    if made.iter().any(|m| m.stands) {
        let options = Options {
            cost: options.cost / GOES_ON,
            ..options
        };
        found = resumed(found, visited, options, progress);
    }
    (found, made)
}

/// Tables that are likely, each with the likeliest model that holds it.
fn tables(found: &Found) -> Vec<(usize, Vec<usize>)> {
    let posterior = Posterior::new(found);
    let all = &found.problem.body.candidates;
    let dof = |c: usize| match all[c].kind {
        Kind::Force { dof } => Some(dof),
        _ => None,
    };
    let of = |wanted: usize| {
        let any = |m: &&(Vec<usize>, f64)| m.0.iter().any(|t| dof(*t) == Some(wanted));
        posterior
            .models
            .iter()
            .filter(any)
            .map(|m| m.1)
            .sum::<f64>()
    };
    let mut made = Vec::new();
    for e in &posterior.effects {
        let Some(d) = dof(e.candidate) else { continue };
        let whole = of(d);
        if whole < UNNAMED || e.probability < SHARE * whole {
            continue;
        }
        let holds = |m: &&(Vec<usize>, f64)| m.0.contains(&e.candidate);
        if let Some((terms, _)) = posterior.models.iter().find(holds) {
            made.push((e.candidate, terms.clone()));
        }
    }
    made
}

/// A form to be fitted.
struct Draft {
    ranked: Ranked,
    /// What it is multiplied by, by its place among the simulator's words, and the rate at which that is one.
    times: (usize, f64),
    /// Log prior odds over the table.
    ln_odds: f64,
}

/// One table, beside the model that holds it.
fn one(found: &mut Found, info: &'static EffectInfo, table: usize, fit: &Fit) -> Option<Closed> {
    let problem = &mut found.problem;
    let member = fit.terms.iter().position(|t| *t == table)?;
    let of = &problem.body.candidates[table];
    let (Kind::Force { dof }, Some((covariate, range))) = (of.kind, of.along) else {
        return None;
    };
    let (unit, median) = problem.unit(table)?;
    let along = Along {
        dof,
        covariate,
        range,
        force: unit * median,
    };
    let likelihood = problem.of_table(fit, member)?;
    let prior = problem.body.prior;
    let mut forms = ranked(&along, &likelihood, prior.second_piece);
    let best = forms.first()?.ln_score();
    forms.retain(|f| f.ln_score() > best - BELOW);
    forms.truncate(FITTED);
    let ln_odds = (prior.closed / (1.0 - prior.closed)).ln();
    let factors = problem.factors(&along);
    let plain = if factors.is_empty() {
        0.0
    } else {
        (1.0 - prior.product).ln()
    };
    let drafts: Vec<Draft> = forms
        .into_iter()
        .map(|ranked| Draft {
            ln_odds: ln_odds + plain + ranked.ln_prior,
            ranked,
            times: (0, 1.0),
        })
        .collect();
    let bare = {
        let (terms, point) = problem.without(fit, member);
        Fit {
            terms,
            point,
            ..fit.clone()
        }
    };
    let mut fits = problem.fitted(info, table, &along, &bare, &drafts);
    // The likeliest once more, times a rate.
    let likeliest = fits
        .iter()
        .max_by(|a, b| a.2.ln_score.total_cmp(&b.2.ln_score))?
        .0;
    let share = prior.product.ln() - (factors.len().max(1) as f64).ln();
    let products: Vec<Draft> = factors
        .into_iter()
        .map(|times| {
            let ranked = drafts[likeliest].ranked.clone();
            Draft {
                ln_odds: ln_odds + share + ranked.ln_prior,
                ranked,
                times,
            }
        })
        .collect();
    fits.extend(problem.fitted(info, table, &along, &bare, &products));
    found.fits += fits.len();
    Some(judged(&found.problem, table, fit, fits))
}

/// Forms against each other and the table; `fit` = the model with the table.
fn judged(problem: &Problem, table: usize, fit: &Fit, fits: Vec<(usize, usize, Fit)>) -> Closed {
    let top = fits
        .iter()
        .map(|f| f.2.ln_score)
        .fold(fit.ln_score, f64::max);
    let share = |score: f64| (score - top).exp();
    let sum = share(fit.ln_score) + fits.iter().map(|f| share(f.2.ln_score)).sum::<f64>();
    let mut forms: Vec<Form> = fits
        .into_iter()
        .map(|(_, candidate, fit)| Form {
            probability: share(fit.ln_score) / sum,
            candidate,
            fit,
        })
        .filter(|f| f.probability * ODDS > 1.0 / sum)
        .collect();
    forms.sort_by(|a, b| b.probability.total_cmp(&a.probability));
    let none = share(fit.ln_score) / sum;
    let mut made = Closed {
        table,
        none,
        stands: 1.0 - none >= STANDS && !forms.is_empty(),
        forms,
        left_out: None,
    };
    // With one run alone there is none to leave out.
    if made.stands && problem.body.recording.runs.len() > 1 {
        let rms = |f: &Fit| Some(problem.left_of(&problem.one_run_out(f)?.values));
        made.left_out = made.forms.first().and_then(|f| rms(&f.fit)).zip(rms(fit));
        made.stands = made
            .left_out
            .is_some_and(|(form, table)| !problem.is_worse(&form, &table));
    }
    made
}

fn told(f: &Ranked) -> String {
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

impl Candidate {
    /// Name of the covariate of a force without a name, be it a table or a form.
    pub fn runs_along(&self) -> Option<&'static str> {
        match self.kind {
            Kind::Form { .. } => self.word("along"),
            Kind::Force { .. } => COVARIATES.get(self.along?.0).copied(),
            _ => None,
        }
    }

    /// DOF of a force without a name.
    pub fn unnamed_in(&self) -> Option<usize> {
        match self.kind {
            Kind::Force { dof } | Kind::Form { dof, .. } => Some(dof),
            _ => None,
        }
    }
}

impl Problem {
    /// Whether a form foretells runs left out worse than its table, both in the same units: what a table leaves open where no
    /// other run has been is just what it is worse by.
    fn is_worse(&self, form: &Rms, table: &Rms) -> bool {
        let size = |rms: &Rms| -> f64 {
            let each = self.noises.channels.iter().enumerate();
            each.filter_map(|(c, noise)| {
                let least = noise.as_ref()?.total_sd().max(self.body.tolerance[c]);
                Some((rms[c] / least).powi(2)).filter(|v| v.is_finite())
            })
            .sum()
        };
        let (form, table) = (size(form), size(table));
        // Within noise and tolerance nobody is worse.
        let channels = self.noises.channels.iter().flatten().count() as f64;
        form > channels && form > (1.0 + WORSE) * table
    }

    /// What a form may be multiplied by: each rate that moves, its size, its sign, but for that along which it runs; with
    /// the rate at which the factor is one.
    fn factors(&self, along: &Along) -> Vec<(usize, f64)> {
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
    fn fitted(
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
                told(&drafts[k].ranked),
                drafts[k].times,
                made.ln_score,
                made.cells.misfit[along.dof]
            );
            Some((k, candidate, made))
        };
        (0..drafts.len()).into_par_iter().filter_map(fit).collect()
    }

    /// What the data say of a table's points, all other numbers of the model integrated out about where it is.
    fn of_table(&self, fit: &Fit, member: usize) -> Option<Likelihood> {
        let all = self.simulate(&fit.terms, &fit.point)?;
        let belief = self.belief(&fit.terms);
        let table = fit.terms[member];
        // Of this table the data alone.
        let others = Belief {
            blocks: belief
                .blocks
                .into_iter()
                .filter(|b| b.candidate != table)
                .collect(),
            densities: belief.densities,
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
        // What rounding leaves of its symmetry.
        left = (&left + left.transpose()) * 0.5;
        let slope = of(&own) - solved.tr_mul(&of(&rest));
        let here = DVector::from_iterator(POINTS, own.iter().map(|i| fit.point[*i]));
        Some(Likelihood {
            slope: slope + &left * here,
            information: left,
        })
    }
}

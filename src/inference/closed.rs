//! The closed form of a force of no known effect: the simplest expression of its covariate that the data want instead of a table.
//!
//! Of the likeliest model that holds a table, what the data say of the table's points ranks all forms (`rank`) that the
//! grammar has (`grammar`). The best are fitted to the data in the table's place, by the fit and the score that every model
//! has, and compete with the table, which stands for every form that the grammar does not have. Where a form is likely
//! by the evidence it has to predict held-out runs as well as the table does; then it joins the models, and the search
//! goes on beside it.
//!
//! References: Schmidt and Lipson 2009 (laws from data); Duvenaud and others 2013 (Gaussian process to structure).

mod curve;
mod grammar;
mod place;
mod rank;
#[cfg(test)]
mod tests;

use hydroline_sim::effect::covariate_table::COVARIATES;
use hydroline_sim::effect::{EffectInfo, find};

use super::fit::{Fit, Problem};
use super::limit::{Limit, Watch};
use super::posterior::{Posterior, UNNAMED};
use super::search::{Found, Options, resumed};
use super::summary::Rms;
use super::term::{Candidate, Kind};
use grammar::Along;
use place::Draft;
use rank::ranked;

/// Probability of all forms together from which they replace the table: the table is no less an assumption. None is called
/// the law for that.
const REPLACEMENT_PROBABILITY: f64 = 0.5;
/// Odds within which forms are reported beside the likeliest.
const ODDS: f64 = 20.0;
/// Share of a DOF's unnamed force from which a covariate's table is written down.
const SHARE: f64 = 0.2;
/// Forms fitted per table, and log odds below the best of the ranking at which none is: it is made at the table's own
/// place, not at the form's.
const FITTED: usize = 6;
const BELOW: f64 = 9.0;
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

/// Closed forms found for a table of an effect.
#[derive(Debug, Clone)]
pub struct Closed {
    /// The table's candidate.
    pub table: usize,
    /// Forms within odds of 20 of the likeliest, the table among what they are held against; likeliest first.
    pub forms: Vec<Form>,
    /// Probability that it has no form of the grammar.
    pub none: f64,
    /// Whether the forms replace the table: together they are likely, and predict each run from the others as well as it does.
    pub replaces_table: bool,
    /// Each run as the others predict it: (the likeliest form, the table); `None` where that was not asked.
    pub one_run_out: Option<(Rms, Rms)>,
    /// Whether all that belongs to it was asked; `false` = the limit was over before.
    pub is_whole: bool,
}

/// Writes down the unnamed forces that a search found, as many as the limit leaves time for.
pub fn closed(mut found: Found, options: Options, watch: Watch<'_>) -> (Found, Vec<Closed>) {
    let Some(info) = find("written_force") else {
        return (found, Vec::new());
    };
    let visited = found.models.keys().cloned().collect();
    let mut made = Vec::new();
    for (table, terms) in tables(&found) {
        let Some(fit) = found.models.get(&terms).cloned() else {
            continue;
        };
        let what = format!(
            "closed form of {}",
            found.problem.body.candidates[table].name()
        );
        if found.account.leaves_open(watch.limit, &what) {
            continue;
        }
        watch.tell(&what);
        if let Some(one) = one(&mut found, info, table, &fit, watch.limit) {
            if !one.is_whole {
                found.account.leaves_open(watch.limit, &what);
            }
            if one.replaces_table {
                let forms = one.forms.iter().map(|f| &f.fit);
                let fits = forms.map(|f| (f.terms.clone(), f.clone()));
                found.models.extend(fits);
            }
            made.push(one);
        }
    }
    if made.iter().any(|m| m.replaces_table) {
        let options = Options {
            cost: options.cost / GOES_ON,
            ..options
        };
        found = resumed(found, visited, options, watch);
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

/// One table, beside the model that holds it.
fn one(
    found: &mut Found,
    info: &'static EffectInfo,
    table: usize,
    fit: &Fit,
    limit: Limit,
) -> Option<Closed> {
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
    let has_time = !limit.is_over();
    let likeliest = fits
        .iter()
        .max_by(|a, b| a.2.ln_score.total_cmp(&b.2.ln_score))?
        .0;
    let share = prior.product.ln() - (factors.len().max(1) as f64).ln();
    let products: Vec<Draft> = factors
        .into_iter()
        .filter(|_| has_time)
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
    let mut made = judged(&found.problem, table, fit, fits, limit);
    made.is_whole &= has_time;
    Some(made)
}

/// Forms against each other and the table; `fit` = the model with the table.
fn judged(
    problem: &Problem,
    table: usize,
    fit: &Fit,
    fits: Vec<(usize, usize, Fit)>,
    limit: Limit,
) -> Closed {
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
        replaces_table: 1.0 - none >= REPLACEMENT_PROBABILITY && !forms.is_empty(),
        forms,
        one_run_out: None,
        is_whole: true,
    };
    // With one run alone there is none to leave out.
    if made.replaces_table && problem.body.recording.runs.len() > 1 {
        let rms = |f: &Fit| Some(problem.left_of(&problem.one_run_out_within(f, limit)?.values));
        made.one_run_out = made.forms.first().and_then(|f| rms(&f.fit)).zip(rms(fit));
        made.replaces_table = made
            .one_run_out
            .is_some_and(|(form, table)| !problem.is_worse(&form, &table));
        made.is_whole = made.one_run_out.is_some() || !limit.is_over();
    }
    made
}

impl Candidate {
    /// Name of the covariate of a force of no known effect, be it a table or a form.
    pub fn runs_along(&self) -> Option<&'static str> {
        match self.kind {
            Kind::Form { .. } => self.word("along"),
            Kind::Force { .. } => COVARIATES.get(self.along?.0).copied(),
            _ => None,
        }
    }

    /// DOF of a force of no known effect.
    pub fn unnamed_in(&self) -> Option<usize> {
        match self.kind {
            Kind::Force { dof } | Kind::Form { dof, .. } => Some(dof),
            _ => None,
        }
    }
}

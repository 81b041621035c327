//! Discrepancies that the library has no name for: forces along a covariate, random forces, laws only nearly the library's.

use std::collections::BTreeSet;

use hydroline_core::run::{Channel, PerChannel};
use hydroline_identify::parameter::Term;
use hydroline_inference::fit::Fit;
use hydroline_inference::hyper::SIZES;
use hydroline_inference::posterior::UNNAMED;
use hydroline_inference::summary::Rms;
use hydroline_inference::term::{Candidate, Kind};
use hydroline_rigs::Dof;
use hydroline_sim::vehicle::Hydrodynamics;

use super::found::{Judged, relative};
use crate::verdict::{Law, Unexplained};

/// Probability from which a law is said to be inexact.
const INEXACT: f64 = 0.5;
/// Share of its largest value from which a force acts somewhere.
const ACTS: f64 = 0.5;

/// Of a model's members those that matter as a verdict names them; `unsure` = share by which a member's weight may be
/// larger. A force of no known effect stands for its DOF whatever it
/// runs along, and how a law varies is no effect of its own.
pub fn mattering(
    candidates: &[Candidate],
    terms: &[usize],
    weights: &[Rms],
    tolerance: &PerChannel<f64>,
    unsure: impl Fn(usize) -> f64,
) -> BTreeSet<usize> {
    let heavy = terms
        .iter()
        .zip(weights)
        .enumerate()
        .filter(|(m, (_, w))| relative(w, tolerance) * (1.0 + unsure(*m)) > 1.0);
    heavy
        .filter_map(|(_, (t, _))| match candidates[*t].kind {
            Kind::Effect => Some(*t),
            Kind::Force { dof } | Kind::Form { dof, .. } => {
                let same = |c: &Candidate| c.kind == Kind::Force { dof };
                candidates.iter().position(same)
            }
            Kind::Trend { .. } => None,
        })
        .collect()
}

impl Judged<'_> {
    fn candidate(&self, term: usize) -> &Candidate {
        &self.found.problem.body.candidates[term]
    }

    /// Likeliest model that holds a term, and the term's place in it.
    fn holding(&self, term: usize) -> Option<(&Fit, usize)> {
        let models = self.posterior.models.iter();
        models
            .filter_map(|(terms, _)| {
                let member = terms.iter().position(|t| *t == term)?;
                Some((self.found.models.get(terms)?, member))
            })
            .next()
    }

    /// Whether an effect's law is the library's: the word, the probability that it is, and what it varies with.
    pub fn law(&self, term: usize) -> (Law, f64, Option<String>) {
        let (mut with, mut inexact) = (0.0, 0.0);
        let mut trends: Vec<(usize, f64)> = Vec::new();
        for (terms, p) in self.posterior.models.iter().filter(|m| m.0.contains(&term)) {
            with += p;
            let of = |t: &&usize| self.candidate(**t).kind == Kind::Trend { of: term };
            if let Some(t) = terms.iter().find(of) {
                inexact += p;
                match trends.iter_mut().find(|x| x.0 == *t) {
                    Some(known) => known.1 += p,
                    None => trends.push((*t, *p)),
                }
            }
        }
        let exact = 1.0 - inexact / f64::max(with, 1e-300);
        if 1.0 - exact < INEXACT {
            return (Law::Exact, exact, None);
        }
        let likeliest = trends.into_iter().max_by(|a, b| a.1.total_cmp(&b.1));
        let note = likeliest.and_then(|(t, _)| self.how_it_varies(t));
        (Law::Inexact, exact, note)
    }

    fn how_it_varies(&self, trend: usize) -> Option<String> {
        let c = self.candidate(trend);
        let (fit, member) = self.holding(trend)?;
        let body = &self.found.problem.body;
        let places = body.places(&fit.terms);
        let at = places[member];
        let shares = &fit.point[at..at + c.scales.len()];
        let low = shares.iter().copied().fold(f64::INFINITY, f64::min);
        let high = shares.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let Kind::Trend { of } = c.kind else {
            return None;
        };
        let own = fit.terms.iter().position(|t| *t == of)?;
        let (value, _) = body.natural(&fit.terms, &fit.point)[places[own]];
        let nothing = self.candidate(of).nothing;
        let at = |share: f64| value + (value - nothing) * share;
        let (_, (from, to)) = c.along?;
        Some(format!(
            "{} lies between {:.4} and {:.4} as {} goes from {from:.3} to {to:.3}",
            c.info.parameters.first()?.name,
            at(low),
            at(high),
            c.covariate()?,
        ))
    }

    /// Probability that something without a name that matters acts in a DOF.
    pub fn unnamed_in(&self, dof: usize) -> f64 {
        let of = |u: &&(usize, f64)| u.0 == dof;
        let random = self.posterior.unnamed.iter().find(of).map_or(0.0, |u| u.1);
        let tolerance = &self.found.problem.body.tolerance;
        let table = self.posterior.models.iter().map(|(terms, p)| {
            let heavy = self.weights.get(terms).is_some_and(|weights| {
                let each = terms.iter().zip(weights);
                let mut forces =
                    each.filter(|(t, _)| self.candidate(**t).unnamed_in() == Some(dof));
                forces.any(|(_, w)| relative(w, tolerance) > 1.0)
            });
            if heavy { *p } else { 0.0 }
        });
        // Where both are in a model they are one finding.
        random.max(table.sum())
    }

    /// Unnamed forces that matter.
    pub fn unnamed(&self) -> Vec<Unexplained> {
        let dofs = self.found.problem.body.dofs.iter();
        let said = dofs.filter(|d| self.unnamed_in(**d) >= UNNAMED);
        said.map(|d| {
            self.along_a_covariate(*d)
                .unwrap_or_else(|| self.at_random(*d))
        })
        .collect()
    }

    fn ln_odds(&self, dof: usize) -> f64 {
        let p = self.unnamed_in(dof);
        (p / (1.0 - p).max(1e-300)).ln()
    }

    /// Probability that a force of no known effect acts in a DOF; along a covariate, or any.
    pub fn force_in(&self, dof: usize, along: Option<&str>) -> f64 {
        let is = |t: &usize| {
            let c = self.candidate(*t);
            c.unnamed_in() == Some(dof) && along.is_none_or(|a| c.runs_along() == Some(a))
        };
        let models = self.posterior.models.iter();
        models.filter(|m| m.0.iter().any(is)).map(|m| m.1).sum()
    }

    /// Probability of a term, for whoever writes it down: of a force of no known effect that of its covariate, be it as a table
    /// or in closed form.
    pub fn stands(&self, term: usize) -> f64 {
        let c = self.candidate(term);
        match c.unnamed_in() {
            Some(dof) => self.force_in(dof, c.runs_along()),
            None => self.probability(term),
        }
    }

    /// The likeliest table in a DOF, where one is likelier than none.
    fn along_a_covariate(&self, dof: usize) -> Option<Unexplained> {
        let body = &self.found.problem.body;
        let all = self.force_in(dof, None);
        if all < UNNAMED {
            return None;
        }
        let tables = (0..body.candidates.len())
            .filter(|c| body.candidates[*c].kind == Kind::Force { dof })
            .map(|c| (c, self.stands(c)));
        let (table, probability) = tables.max_by(|a, b| a.1.total_cmp(&b.1))?;
        let (fit, member) = self.holding(table)?;
        let c = &body.candidates[table];
        let (_, (from, to)) = c.along?;
        let covariate = c.covariate()?;
        let at = body.places(&fit.terms)[member];
        let n = c.scales.len();
        let knots: Vec<f64> = (0..n)
            .map(|k| from + (to - from) * k as f64 / (n - 1) as f64)
            .collect();
        let force_at = fit.point[at..at + n].to_vec();
        let force_sd = (at..at + n)
            .map(|i| fit.covariance[(i, i)].max(0.0).sqrt())
            .collect();
        let closed_form = self.closed_form(table, &knots);
        // A table cannot hold a force that turns with the rate; where a form is the law, it says where the force acts.
        let law = closed_form
            .as_ref()
            .filter(|f| f.sure && !f.force_at.is_empty());
        let shown = law.map_or(&force_at, |f| &f.force_at);
        let (first, top, last) = extent(shown)?;
        let weights = self
            .weights
            .get(&fit.terms)
            .and_then(|w| w.get(member).copied());
        let weights = weights.unwrap_or_else(|| self.found.problem.weights(fit)[member]);
        let channel = heaviest(&weights, &body.tolerance);
        let unit = if dof < 3 { "N" } else { "N m" };
        let force = shown[top];
        Some(Unexplained {
            channel: channel.name().to_owned(),
            weight: Some(weights[channel]).filter(|w| w.is_finite()),
            depends_on: Some(covariate.to_owned()),
            range: Some([knots[first], knots[last]]),
            force: Some(force),
            term: format!(
                "a force of no known effect in {} that depends on {covariate} (probability {:.3} of it that this is the variable): up to {:.3} {unit} at {:.3}, between {:.3} and {:.3}{}",
                Dof::ALL[dof].name(),
                probability / all,
                force,
                knots[top],
                knots[first],
                knots[last],
                closed_form
                    .as_ref()
                    .map_or(String::new(), |f| format!("; {}", f.sentence)),
            ),
            closed_form,
            knots,
            force_at,
            force_sd,
            log_bayes_factor: Some(self.ln_odds(dof)),
        })
    }

    /// Mass of a DOF with the added mass of the likeliest model \[kg, kg m2\].
    fn mass(&self, dof: usize) -> f64 {
        let body = &self.found.problem.body;
        let mut h: Hydrodynamics<f64> = Hydrodynamics::new(&body.vehicle);
        let natural = body.natural(&self.best.terms, &self.best.point);
        for (own, (value, _)) in body.own.iter().zip(natural) {
            if let Some(c) = own.coefficient().filter(|c| c.term == Term::Added) {
                h.added[c.dof.index()] = value;
            }
        }
        h.mass()[dof]
    }

    /// Largest load commanded in a DOF \[N, N m\].
    fn largest_load(&self, dof: usize) -> f64 {
        let runs = self.found.problem.body.recording.runs.iter();
        let loads = runs.flat_map(|r| &r.commands).map(|c| c.1[dof].abs());
        loads.fold(0.0, f64::max)
    }

    fn at_random(&self, dof: usize) -> Unexplained {
        let body = &self.found.problem.body;
        let cell = self.best.cells.misfit[dof];
        let over = SIZES[cell.size];
        let channel = body.recording.channel_of(dof);
        let weight = over * body.tolerance[channel];
        let name = Dof::ALL[dof].name();
        let unit = if dof < 3 { "N" } else { "N m" };
        let force = self.found.problem.worth.force(dof, cell);
        let size = force.sd_mps2 * self.mass(dof);
        let largest = self.largest_load(dof);
        let beyond = match largest > 0.0 && size > largest {
            true => format!(", larger than the largest load commanded ({largest:.3} {unit})"),
            false => String::new(),
        };
        let p = self.unnamed_in(dof);
        Unexplained {
            channel: channel.name().to_owned(),
            weight: Some(weight),
            depends_on: Some("time".to_owned()),
            force: Some(size),
            term: format!(
                "something without a name acts in {name} (probability {p:.3}): as a random force of sd {size:.3} {unit} that changes within {} s{beyond}",
                force.correlation_s
            ),
            log_bayes_factor: Some(self.ln_odds(dof)),
            ..Unexplained::default()
        }
    }
}

/// Where a force acts: first place, that of its largest size, last place.
fn extent(force_at: &[f64]) -> Option<(usize, usize, usize)> {
    let size = |k: &usize| force_at[*k].abs();
    let top = (0..force_at.len()).max_by(|a, b| size(a).total_cmp(&size(b)))?;
    let acts = |k: &usize| size(k) >= ACTS * size(&top);
    let first = (0..=top).rev().take_while(acts).last().unwrap_or(top);
    let last = (top..force_at.len()).take_while(acts).last().unwrap_or(top);
    Some((first, top, last))
}

/// Channel in which a weight is largest over its tolerance.
fn heaviest(weight: &Rms, tolerance: &PerChannel<f64>) -> Channel {
    let over = |c: &Channel| weight[*c] / tolerance[*c];
    let finite = Channel::ALL.into_iter().filter(|c| over(c).is_finite());
    finite
        .max_by(|a, b| over(a).total_cmp(&over(b)))
        .unwrap_or(Channel::X)
}

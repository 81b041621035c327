//! Effects, coefficients and rivals into the verdict's tables.

use std::collections::{BTreeMap, BTreeSet};

use hydroline_identify::adopt::put;
use hydroline_identify::parameter::Coefficient;
use hydroline_inference::body::Own;
use hydroline_inference::fit::Fit;
use hydroline_inference::posterior::UNNAMED;
use hydroline_inference::prediction::Prediction;
use hydroline_inference::summary::Rms;
use hydroline_inference::term::{Candidate, Kind};
use hydroline_rigs::Rig;
use nalgebra::DMatrix;

use super::found::{Judged, relative};
use crate::verdict::{
    self, Alternative, BeforeAfter, ESTABLISHED, Effect, FitTable, Law, LeaveOneRunOut, Parameters,
    PredictedRun, Predictive, Value,
};

/// Probability from which an effect is listed.
const LISTED: f64 = 0.5;
/// Probability of an exchange, over the member's own, from which it is said.
const AS_WELL: f64 = 0.05;
/// Models less probable than this change no number.
const LEAST_SHARE: f64 = 1e-4;
/// Probability from which an effect stands among the candidates.
const PROBABLE: f64 = 0.01;
/// Models listed.
const MODELS: usize = 8;

/// Numbers of several models, by their probabilities: mean, and sd with what the means differ by.
fn mixed(all: &[(f64, BTreeMap<String, Value>)]) -> BTreeMap<String, Value> {
    let sum: f64 = all.iter().map(|a| a.0).sum();
    let Some((_, first)) = all.first() else {
        return BTreeMap::new();
    };
    let of = |name: &String| -> Value {
        let each = || {
            let with = all.iter().filter_map(|(p, values)| {
                let mut v = *values.get(name)?;
                if name.starts_with("phase") {
                    // Of all turns the one nearest to the first model's.
                    let turns = (v.value - first[name].value) / std::f64::consts::TAU;
                    v.value -= turns.round() * std::f64::consts::TAU;
                }
                Some((p / sum, v))
            });
            // A model that does not determine a number says nothing of it.
            with.filter(|(_, v)| v.sd.is_some())
        };
        let share: f64 = each().map(|(p, _)| p).sum();
        if share <= 0.0 {
            return first[name];
        }
        let mean = each().map(|(p, v)| p * v.value).sum::<f64>() / share;
        let variance = each().map(|(p, v)| {
            let sd = v.sd.unwrap_or(0.0);
            p * (sd * sd + (v.value - mean).powi(2))
        });
        Value {
            value: mean,
            sd: Some((variance.sum::<f64>() / share).sqrt()),
        }
    };
    first.keys().map(|name| (name.clone(), of(name))).collect()
}

pub fn words(c: &Candidate) -> BTreeMap<String, String> {
    let each = c.info.words.iter().zip(&c.words);
    each.filter_map(|(w, i)| Some((w.name.to_owned(), (*w.allowed.get(*i)?).to_owned())))
        .collect()
}

/// The DOF that an effect's words name.
pub fn place(c: &Candidate) -> Option<String> {
    c.place().map(str::to_owned)
}

impl Judged<'_> {
    /// Effects that are probable at all.
    pub fn candidates(&self) -> Vec<verdict::Candidate> {
        let all = self.posterior.effects.iter();
        let body = &self.found.problem.body;
        all.filter(|e| {
            e.probability >= PROBABLE && body.candidates[e.candidate].kind == Kind::Effect
        })
        .map(|e| {
            let c = &self.found.problem.body.candidates[e.candidate];
            verdict::Candidate {
                effect: c.info.id.to_owned(),
                words: words(c),
                probability: e.probability,
            }
        })
        .collect()
    }

    /// The likeliest model that holds a term and was weighed, with the weights of its members.
    fn weighed(&self, term: usize) -> Option<(&Fit, &[Rms])> {
        let mut models = self.posterior.models.iter();
        models.find_map(|(terms, _)| {
            let fit = terms
                .contains(&term)
                .then(|| self.found.models.get(terms))??;
            Some((fit, self.weights.get(terms)?.as_slice()))
        })
    }

    /// Effects that are established or not decided, heaviest first.
    pub fn effects(&self) -> Vec<Effect> {
        let body = &self.found.problem.body;
        let mut made: Vec<(f64, Effect)> = Vec::new();
        let first: BTreeSet<usize> = self.groups.first().map(|g| g.0.clone()).unwrap_or_default();
        for e in &self.posterior.effects {
            if e.probability < LISTED && !first.contains(&e.candidate) {
                continue;
            }
            if body.candidates[e.candidate].kind != Kind::Effect {
                continue;
            }
            let Some((fit, weights)) = self.weighed(e.candidate) else {
                continue;
            };
            let Some(member) = fit.terms.iter().position(|t| *t == e.candidate) else {
                continue;
            };
            let c = &body.candidates[e.candidate];
            let weight = &weights[member];
            let size = relative(weight, &body.tolerance);
            let (law, exact, law_note) = self.law(e.candidate);
            made.push((
                size,
                Effect {
                    effect: c.info.id.to_owned(),
                    words: words(c),
                    dof: place(c),
                    probability: e.probability,
                    established: e.probability >= ESTABLISHED,
                    weight: weight.by_name(),
                    matters: size > 1.0,
                    law,
                    law_exact_probability: Some(exact),
                    law_note,
                    parameters: self.averaged(e.candidate),
                    or: self.exchanges(e.candidate),
                    notes: self.unusual(fit, member),
                },
            ));
        }
        made.sort_by(|a, b| b.0.total_cmp(&a.0));
        made.into_iter().map(|m| m.1).collect()
    }

    fn numbers(&self, fit: &Fit, member: usize) -> BTreeMap<String, Value> {
        let body = &self.found.problem.body;
        let at = body.places(&fit.terms)[member];
        let info = body.candidates[fit.terms[member]].info;
        let each = info.parameters.iter().enumerate();
        each.map(|(i, p)| (p.name.to_owned(), self.value(fit, at + i)))
            .collect()
    }

    /// The same over all models that hold the effect: what they differ by is in the sds.
    fn averaged(&self, term: usize) -> BTreeMap<String, Value> {
        let with = self.posterior.models.iter().filter_map(|(terms, p)| {
            let member = terms.iter().position(|t| *t == term)?;
            let fit = self.found.models.get(terms)?;
            Some((*p, self.numbers(fit, member)))
        });
        mixed(&with.collect::<Vec<_>>())
    }

    pub fn value(&self, fit: &Fit, place: usize) -> Value {
        let (value, slope) = self.found.problem.body.natural(&fit.terms, &fit.point)[place];
        let sd = slope.abs() * fit.covariance[(place, place)].sqrt();
        Value {
            value,
            sd: Some(sd).filter(|s| s.is_finite()),
        }
    }

    fn unusual(&self, fit: &Fit, member: usize) -> Vec<String> {
        let body = &self.found.problem.body;
        let numbers = self.numbers(fit, member);
        let each = body.candidates[fit.terms[member]]
            .parameters
            .iter()
            .filter_map(|p| {
                let v = numbers.get(p.name)?.value;
                let (low, high) = p.plausible;
                let outside =
                    (v < low || v > high) && !p.name.starts_with("phase") && !p.bounds_load;
                outside.then(|| {
                format!(
                    "{} = {v:.4} lies outside of what a tank is expected to show ({low} .. {high})",
                    p.name
                )
            })
            });
        each.collect()
    }

    /// Effects that may take an effect's place, all others as they are.
    fn exchanges(&self, term: usize) -> Vec<String> {
        let mut said = BTreeSet::new();
        for (terms, p) in self.posterior.models.iter().filter(|m| m.0.contains(&term)) {
            let rest: BTreeSet<usize> = terms.iter().copied().filter(|t| *t != term).collect();
            for (other, q) in &self.posterior.models {
                if *q < AS_WELL * p || other.len() != terms.len() || other.contains(&term) {
                    continue;
                }
                let new: Vec<usize> = other
                    .iter()
                    .copied()
                    .filter(|t| !rest.contains(t))
                    .collect();
                if let [one] = new[..]
                    && !matches!(
                        self.found.problem.body.candidates[one].kind,
                        Kind::Trend { .. }
                    )
                {
                    said.insert(self.id(one));
                }
            }
        }
        said.into_iter().collect()
    }

    fn own_numbers(&self, fit: &Fit) -> BTreeMap<String, Value> {
        let own = self.found.problem.body.own.iter().enumerate();
        own.map(|(i, own)| (own.name().to_owned(), self.value(fit, i)))
            .collect()
    }

    /// Coefficients of all models, by their probabilities.
    pub fn own_after(&self) -> BTreeMap<String, Value> {
        let all = self.posterior.models.iter().filter(|m| m.1 >= LEAST_SHARE);
        let all = all
            .filter_map(|(terms, p)| Some((*p, self.own_numbers(self.found.models.get(terms)?))));
        mixed(&all.collect::<Vec<_>>())
    }

    /// Coefficients without and with the effects.
    pub fn parameters(&self) -> Parameters {
        let written = &self.written;
        let effect = |m: &usize| {
            let c = &self.found.problem.body.candidates[written.terms[*m]];
            c.kind == Kind::Effect
        };
        let effects = (0..written.terms.len())
            .filter(effect)
            .map(|m| (self.id(written.terms[m]), self.numbers(written, m)));
        Parameters {
            before: self.own_numbers(&self.alone),
            after: self.own_after(),
            written: self.own_numbers(written),
            written_effects: effects.collect(),
        }
    }

    pub fn alternatives(&self) -> Vec<Alternative> {
        let first = self.best.ln_evidence;
        let models = self.posterior.models.iter().take(MODELS);
        models
            .filter_map(|(terms, p)| {
                let fit = self.found.models.get(terms)?;
                Some(Alternative {
                    effects: terms.iter().map(|t| self.label(*t)).collect(),
                    log_evidence: fit.ln_evidence - first,
                    probability: *p,
                    train: self.found.problem.left(terms, &fit.point).by_name(),
                })
            })
            .collect()
    }

    /// rms of the runs fitted, and of those held out.
    pub fn fit(&self) -> FitTable {
        let problem = &self.found.problem;
        let left = |fit: &Fit| problem.left(&fit.terms, &fit.point);
        let mut made = FitTable {
            train: self.before_after(&(left(&self.alone), left(self.best))),
            ..FitTable::default()
        };
        if let Some((over, predicted)) = &self.held {
            let runs = over.body.recording.runs.iter();
            let names: Vec<&str> = runs.map(|r| r.name.as_str()).collect();
            made.held_out = self.before_after(&predicted.rms);
            made.held_out_by = format!("runs held out: {}, not fitted", names.join(", "));
        }
        made
    }

    /// rms by both models, beside the noise.
    fn before_after(&self, (before, after): &(Rms, Rms)) -> BeforeAfter {
        BeforeAfter {
            before: before.by_name(),
            after: after.by_name(),
            noise: self.noise().by_name(),
        }
    }

    /// A term as a list of models shows it.
    fn label(&self, term: usize) -> String {
        let c = &self.found.problem.body.candidates[term];
        if c.kind == Kind::Effect {
            self.id(term)
        } else {
            c.name()
        }
    }

    /// Each run as the others predict it.
    pub fn leave_one_run_out(&self) -> Option<LeaveOneRunOut> {
        let predicted = self.one_run_out.as_ref()?;
        let problem = &self.found.problem;
        let by_run = |of: &Prediction| -> Vec<Predictive> {
            let left = problem.left_by_run(&of.values);
            let each = left.iter().zip(problem.log_density(of));
            let each = each.map(|(rms, log_predictive_density)| Predictive {
                log_predictive_density,
                rms: rms.by_name(),
            });
            each.collect()
        };
        let each = by_run(&predicted.before).into_iter();
        let each = each.zip(by_run(&predicted.after));
        let runs = problem.body.recording.runs.iter().zip(each);
        Some(LeaveOneRunOut {
            runs: runs
                .map(|(run, (before, after))| PredictedRun {
                    run: run.name.clone(),
                    before,
                    after,
                })
                .collect(),
            rms: self.before_after(&predicted.rms),
        })
    }

    /// sd of the instruments \[SI\].
    pub fn noise(&self) -> Rms {
        let channels = &self.found.problem.noises.channels;
        channels.map(|noise| noise.map_or(f64::NAN, |n| n.total_sd()))
    }

    /// Whether a member of the likeliest model goes into a rig: it is established, and it is said. An effect is where it is listed, a
    /// force of no known effect where its DOF is left unexplained, what a law varies with where that law is called inexact.
    pub fn is_written(&self, term: usize) -> bool {
        let is_established = self.stands(term) >= ESTABLISHED;
        match self.found.problem.body.candidates[term].kind {
            Kind::Effect => is_established && self.weighed(term).is_some(),
            Kind::Force { dof } | Kind::Form { dof, .. } => {
                is_established && self.unnamed_in(dof) >= UNNAMED
            }
            Kind::Trend { of } => self.is_written(of) && self.law(of).0 == Law::Inexact,
        }
    }

    /// The model that goes into a rig, fitted: coefficients beside terms that are not written are those of another vehicle.
    pub fn written_model(&self) -> Fit {
        if self.small_effects_fail() {
            return self.alone.clone();
        }
        let terms = self.best.terms.iter().copied();
        let keep: Vec<usize> = terms.filter(|t| self.is_written(*t)).collect();
        if keep.len() == self.best.terms.len() {
            return self.best.clone();
        }
        self.part(&keep).unwrap_or_else(|| self.alone.clone())
    }

    /// Vehicle, effects and forces of the model that goes into a rig.
    pub fn adopt(&self, rig: &mut Rig) {
        let body = &self.found.problem.body;
        let fit = &self.written;
        let natural = body.natural(&fit.terms, &fit.point);
        let mut coefficients = Vec::new();
        for (i, (own, (value, _))) in body.own.iter().zip(&natural).enumerate() {
            match own {
                Own::Coefficient(c, _) | Own::Unsaid(c, _) => coefficients.push((i, *c, *value)),
                Own::Restoring(_) => {
                    let weight_n = rig.vehicle.mass_kg * rig.vehicle.gravity_mps2;
                    rig.vehicle.r_bz_m = value / weight_n;
                }
                Own::Stiffness(place, _) => rig.vehicle.stiffness[*place] = *value,
                Own::NetWeight(_) => rig.vehicle.net_weight_n = *value,
                // A log's, not the rig's.
                Own::ClockOffset(_) | Own::ClockDrift(_) => {}
            }
        }
        // Marginal over the effects' numbers: what is not known of the effects is in it.
        let at: Vec<(usize, f64)> = coefficients
            .iter()
            .map(|(i, ..)| (*i, natural[*i].1))
            .collect();
        let covariance = DMatrix::from_fn(at.len(), at.len(), |a, b| {
            let ((i, by_i), (j, by_j)) = (at[a], at[b]);
            by_i * by_j * 0.5 * (fit.covariance[(i, j)] + fit.covariance[(j, i)])
        });
        let new: Vec<(Coefficient, f64)> = coefficients.iter().map(|(_, c, v)| (*c, *v)).collect();
        put(rig, &new, &covariance);
        rig.physics.extend(self.entries(fit));
    }
}

//! Findings of the posterior that matter.

use std::collections::{BTreeMap, BTreeSet};

use hydroline_core::run::{PerChannel, Run};
use hydroline_inference::closed::Closed;
use hydroline_inference::fit::{Fit, Problem};
use hydroline_inference::limit::Limit;
use hydroline_inference::posterior::Posterior;
use hydroline_inference::prediction::Prediction;
use hydroline_inference::search::Found;
use hydroline_inference::summary::Rms;
use hydroline_inference::term::Kind;
use hydroline_rigs::{Dof, Rig};

use super::discrepancy::mattering;
use super::earned::Left;
use super::held_out;
use crate::verdict::{Contradiction, Unexplained, Word};

/// Probability of what matters together, from which one explanation stands alone.
const DECIDED: f64 = 0.9;
/// Share of the likeliest explanation's probability from which another is listed beside it.
pub const LISTED: f64 = 0.05;
/// Posterior probability below which a model adds nothing to a weight.
const SMALLEST_PROBABILITY: f64 = 0.003;
/// Explanations listed at most.
const SETS: usize = 6;
/// Largest share by which a weight is taken to be larger than it is.
const MOST_UNSURE: f64 = 0.5;

/// Runs that neither model has seen.
#[derive(Debug, Clone)]
pub struct Predicted {
    /// By the vehicle alone.
    pub before: Prediction,
    /// With the likeliest model's effects.
    pub after: Prediction,
    /// rms of what both miss: (before, after).
    pub rms: (Rms, Rms),
}

impl Predicted {
    fn new(
        problem: &Problem,
        predict: impl Fn(&Fit) -> Option<Prediction>,
        alone: &Fit,
        best: &Fit,
    ) -> Option<Predicted> {
        let (before, after) = (predict(alone)?, predict(best)?);
        let rms = (
            problem.left_of(&before.values),
            problem.left_of(&after.values),
        );
        Some(Predicted { before, after, rms })
    }
}

/// The vehicle alone with the least misfit; its covariance is that of the fit beside a random force.
fn plain(problem: &Problem, beside_force: &Fit) -> Fit {
    let from = [beside_force.point.clone(), problem.body.begin()];
    let made = from.iter().filter_map(|at| {
        let fit = problem.least_squares(&[], at, &beside_force.cells.tables)?;
        let left = problem.left(&[], &fit.point);
        Some((relative(&left, &problem.body.tolerance), fit))
    });
    let least = made.min_by(|a, b| a.0.total_cmp(&b.0));
    Fit {
        point: least.map_or_else(|| beside_force.point.clone(), |(_, fit)| fit.point),
        ..beside_force.clone()
    }
}

/// A posterior with its weights.
pub struct Judged<'a> {
    pub found: &'a Found,
    pub posterior: &'a Posterior,
    /// The likeliest model.
    pub best: &'a Fit,
    /// The vehicle alone, by least squares of the motion: beside a random force it drifts, for the force forgives it.
    pub alone: Fit,
    /// Weights of every model's effects, of those that were weighed.
    pub weights: BTreeMap<Vec<usize>, Vec<Rms>>,
    /// Sets of what matters with their probabilities, likeliest first.
    pub groups: Vec<(BTreeSet<usize>, f64)>,
    /// Runs held out, and what both models predict of them.
    pub held: Option<(Problem, Predicted)>,
    /// Whether there are runs held out of which a model gives no finite motion.
    pub is_unpredicted: bool,
    /// Channels of runs held out that the likeliest model does not predict.
    pub contradicted_by: Vec<Contradiction>,
    /// Each run as the others predict it; `None` of one run alone, and where the limit was over before.
    pub one_run_out: Option<Predicted>,
    /// The same by the vehicle alone beside a random force, with the band that it leaves.
    pub alone_run_out: Option<Prediction>,
    /// Residuals of the likeliest model, channel by channel.
    pub left: Vec<Left>,
    /// Unnamed forces that were written down.
    pub closed: &'a [Closed],
    /// Unnamed forces that matter, and what is left that is no noise.
    pub unexplained: Vec<Unexplained>,
    /// The model that goes into a rig: of the likeliest what is established and said, fitted by itself.
    pub written: Fit,
}

impl<'a> Judged<'a> {
    pub fn new(
        found: &'a Found,
        posterior: &'a Posterior,
        closed: &'a [Closed],
        held: &[Run],
        rig: &Rig,
        limit: Limit,
    ) -> Option<Judged<'a>> {
        let best = found.models.get(&posterior.models.first()?.0)?;
        let problem = &found.problem;
        let beside_force = found.models.get(&Vec::new())?;
        let alone = plain(problem, beside_force);
        let mut weights = BTreeMap::new();
        for (terms, _) in posterior
            .models
            .iter()
            .filter(|m| m.1 >= SMALLEST_PROBABILITY)
        {
            let fit = found.models.get(terms)?;
            weights.insert(terms.clone(), problem.weights(fit));
        }
        let mut groups = groups_of(found, posterior, &weights, false);
        // Something matters: whether what may stand in its place matters as well is asked with its sd.
        if groups.first().is_some_and(|g| !g.0.is_empty()) {
            groups = groups_of(found, posterior, &weights, true);
        }
        let runs = problem.body.recording.runs.len();
        let one_run_out = (runs > 1)
            .then(|| {
                if limit.is_over() {
                    return None;
                }
                let predict = |fit: &Fit| match fit.terms.is_empty() {
                    true => problem.one_run_out_by_squares(fit),
                    false => problem.one_run_out_within(fit, limit),
                };
                Predicted::new(problem, predict, &alone, best)
            })
            .flatten();
        let alone_run_out = one_run_out
            .as_ref()
            .and_then(|_| problem.one_run_out_within(beside_force, limit));
        let is_held = !held.is_empty();
        let held = is_held
            .then(|| {
                let over = problem.over(held, rig).ok()?.without_outliers(best);
                let predicted = Predicted::new(&over, |fit| over.predict(fit), &alone, best)?;
                Some((over, predicted))
            })
            .flatten();
        let mut made = Judged {
            found,
            posterior,
            closed,
            best,
            alone,
            weights,
            groups,
            is_unpredicted: is_held && held.is_none(),
            held,
            contradicted_by: Vec::new(),
            one_run_out,
            alone_run_out,
            left: Vec::new(),
            unexplained: Vec::new(),
            written: best.clone(),
        };
        made.left = made.look_at_what_is_left();
        made.unexplained = made.unnamed();
        let left = made.not_noise(&made.unexplained);
        made.unexplained.extend(left);
        made.contradicted_by = made.contradictions();
        made.written = made.written_model();
        Some(made)
    }

    /// Effects of a model that matter.
    pub fn heavy(&self, fit: &Fit) -> BTreeSet<usize> {
        let problem = &self.found.problem;
        let of = |w: &Vec<Rms>| {
            mattering(
                &problem.body.candidates,
                &fit.terms,
                w,
                &problem.body.tolerance,
                |_| 0.0,
            )
        };
        self.weights
            .get(&fit.terms)
            .map_or_else(|| of(&problem.weights(fit)), of)
    }

    /// Probability that an effect is in the model.
    pub fn probability(&self, term: usize) -> f64 {
        let found = self.posterior.effects.iter().find(|e| e.candidate == term);
        found.map_or(0.0, |e| e.probability)
    }

    /// One explanation stands alone.
    fn decided(&self) -> bool {
        self.groups.first().is_none_or(|g| g.1 >= DECIDED)
    }

    pub fn word(&self) -> Word {
        if !self.unexplained.is_empty() {
            return Word::Unknown;
        }
        // A model that predicts worse than the vehicle alone, or ends on a limit, is no explanation of these data.
        if !self.against().is_empty() {
            return Word::Unknown;
        }
        match self.groups.first() {
            _ if !self.decided() => Word::Ambiguous,
            Some((set, _)) if !set.is_empty() => Word::Named,
            _ => Word::None,
        }
    }

    /// Complete sets of what matters that these data cannot distinguish.
    pub fn equivalent(&self) -> Vec<Vec<String>> {
        if self.decided() {
            return Vec::new();
        }
        let first = self.groups.first().map_or(0.0, |g| g.1);
        let sets = self
            .groups
            .iter()
            .filter(|g| g.1 >= LISTED * first)
            .take(SETS);
        sets.map(|(set, _)| set.iter().map(|t| self.id(*t)).collect())
            .collect()
    }

    pub fn id(&self, term: usize) -> String {
        let c = &self.found.problem.body.candidates[term];
        match c.kind {
            Kind::Force { dof } | Kind::Form { dof, .. } => {
                format!("a force of no known effect in {}", Dof::ALL[dof].name())
            }
            _ => c.info.id.to_owned(),
        }
    }

    pub fn notes(&self) -> Vec<String> {
        let mut notes = Vec::new();
        for (name, factor) in self.far_off() {
            let known = factor.sd.map_or(String::new(), |sd| {
                format!(" (known to {:.0} %)", 100.0 * sd / factor.value)
            });
            notes.push(format!(
                "{name} is {:.2} times the rig's{known}",
                factor.value
            ));
        }
        for name in self.no_damping() {
            notes.push(format!("{name} is as good as zero: these runs need no damping of that power (set it to 0 in the rig)"));
        }
        let body = &self.found.problem.body;
        for term in self.best.terms.iter().filter(|_| !self.something_matters()) {
            let candidate = &body.candidates[*term];
            if candidate.kind != Kind::Effect && !self.is_written(*term) {
                notes.push(format!(
                    "a small force that no known effect explains is there: {}; below the tolerance in these runs, and not written into a rig",
                    candidate.name()
                ));
            }
        }
        notes.extend(self.against());
        notes.extend(held_out::notes(&self.contradicted_by));
        if self.is_unpredicted {
            notes.push(
                "the runs held out are not predicted: a model gives no finite motion of them"
                    .to_owned(),
            );
        }
        if self.small_effects_fail() {
            notes.push("runs are predicted worse by the others with the small effects than by the vehicle alone: none of them is written".to_owned());
        }
        notes
    }

    /// Whether the likeliest explanation holds anything that matters.
    fn something_matters(&self) -> bool {
        self.groups.first().is_some_and(|(set, _)| !set.is_empty())
    }

    /// Whether nothing matters, and what does not is contradicted by runs as the others predict them: then it is in no model, and there is
    /// still nothing that matters.
    pub fn small_effects_fail(&self) -> bool {
        !self.best.terms.is_empty() && !self.something_matters() && self.predicts_worse()
    }

    /// Objections to the likeliest model as a whole, in words; empty without any.
    pub fn against(&self) -> Vec<String> {
        let mut notes = Vec::new();
        if self.on_a_limit() {
            notes.push("a coefficient ended a hundredfold off the rig's, which is as far as is looked: the model does not describe this motion".to_owned());
        }
        if self.something_matters() && self.predicts_worse() {
            notes.push("runs are predicted worse by the others with these effects than by the vehicle alone: they are no explanation".to_owned());
        }
        notes
    }
}

/// Sets of what matters with their probabilities, likeliest first.
fn groups_of(
    found: &Found,
    posterior: &Posterior,
    weights: &BTreeMap<Vec<usize>, Vec<Rms>>,
    may: bool,
) -> Vec<(BTreeSet<usize>, f64)> {
    let mut groups: Vec<(BTreeSet<usize>, f64)> = Vec::new();
    let body = &found.problem.body;
    for (terms, p) in &posterior.models {
        let (Some(fit), Some(w)) = (found.models.get(terms), weights.get(terms)) else {
            continue;
        };
        // As well as the number is known that says how large the effect is.
        let unsure = |member: usize| {
            let c = &body.candidates[terms[member]];
            let at = body.places(terms)[member];
            let (value, slope) = body.natural(terms, &fit.point)[at];
            let sd = slope.abs() * fit.covariance[(at, at)].sqrt();
            let share = (sd / (value - c.nothing)).abs();
            if may && !c.is_table() && share.is_finite() {
                share.min(MOST_UNSURE)
            } else {
                0.0
            }
        };
        let set = mattering(&body.candidates, terms, w, &body.tolerance, unsure);
        match groups.iter_mut().find(|g| g.0 == set) {
            Some(g) => g.1 += p,
            None => groups.push((set, *p)),
        }
    }
    groups.sort_by(|a, b| b.1.total_cmp(&a.1));
    groups
}

/// Largest weight over the tolerance of its channel.
pub fn relative(weight: &Rms, tolerance: &PerChannel<f64>) -> f64 {
    let each = weight.iter().zip(tolerance).map(|(w, t)| w / t);
    let finite = each.filter(|v| v.is_finite());
    // An effect that gives no finite motion by itself matters.
    finite.reduce(f64::max).unwrap_or(f64::INFINITY)
}

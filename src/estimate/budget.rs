//! Uncertainty budget of coefficients: what their values hold beside the scatter of samples.
//!
//! Type A is the posterior of the fit: samples, their colour, the random force. Type B are numbers that the fit takes as
//! known and that are not: each is a consider parameter, whose error moves the estimate by the estimator's own gain and is not estimated
//! itself (Schmidt 1966). With C the covariance of the fit and I_k the information that its numbers share with the consider parameter,
//! the estimate moves by -C I_k for each unit of it. An effect that these runs cannot show is one as well, as large as is typical, less
//! what the runs do say of it. Clocks of joined logs are numbers of the fit: their part of C is a line of its own.
//! References: JCGM 100:2008 (GUM), 5.1; ITTC 7.5-02-01-01; Bierman 1977, ch. 8 (consider parameters).

mod sources;
mod unstated;

use std::collections::BTreeMap;

use hydroline_core::run::Run;
use hydroline_identify::{BudgetLine, Identification, curve};
use hydroline_rigs::Rig;
use nalgebra::{Cholesky, DMatrix, DVector};

use super::asked::Asked;
use super::fitted::Fitted;
use super::numbers::Numbers;
use sources::{Consider, Sources};

/// Adds the budget to a result: lines, combined and expanded uncertainty, the largest share of each coefficient.
pub(crate) fn add_budget(
    result: &mut Identification,
    (fitted, numbers): (&Fitted, &Numbers),
    asked: &Asked,
    (rig, runs): (&Rig, &[Run]),
) {
    let whole = Sources {
        fitted,
        rig,
        has_measured_curve: curve::is_measured(rig, runs),
    };
    let all = whole.all(asked);
    let Some(changes) = changes(fitted, numbers, &all) else {
        return;
    };
    let own = &fitted.problem.body.own;
    let places: Vec<Option<usize>> = asked
        .coefficients
        .iter()
        .map(|c| own.iter().position(|o| o.coefficient() == Some(*c)))
        .collect();
    let n = places.len();
    let mut combined = DMatrix::from_fn(n, n, |i, j| {
        result.covariance[i][j].unwrap_or(if i == j { f64::INFINITY } else { 0.0 })
    });
    let mut lines = of_the_fit(result, (fitted, numbers), &places);
    for (consider, (change, chance)) in all.iter().zip(changes) {
        let by: Vec<f64> = places
            .iter()
            .map(|p| p.map_or(0.0, |p| change[p]))
            .collect();
        for i in 0..n {
            for j in 0..n {
                combined[(i, j)] += by[i] * by[j];
            }
        }
        add_line(&mut lines, (consider, chance), &result.order, &by);
    }
    // What moves no coefficient is no source of their uncertainty.
    lines.retain(|l| l.contributions.values().any(|v| *v > 0.0));
    let finite = |v: f64| v.is_finite().then_some(v);
    result.covariance_combined = (0..n)
        .map(|i| (0..n).map(|j| finite(combined[(i, j)])).collect())
        .collect();
    let assumed: Vec<String> = lines
        .iter()
        .filter(|l| l.basis.starts_with("assumed"))
        .map(|l| l.source.clone())
        .collect();
    if !assumed.is_empty() {
        result.notes.push(format!(
            "assumed until measured, and in the combined uncertainty: {} (budget)",
            assumed.join(", ")
        ));
    }
    let unknown = asked.fixed.iter();
    let unknown = unknown.filter(|c| c.identified_sd(rig).is_none());
    let unknown: Vec<&str> = unknown.map(|c| c.key()).collect();
    if !unknown.is_empty() {
        result.notes.push(format!(
            "{}: fixed, and the rig states no sd (no [identified]): taken as exactly known, and nothing of it is in the intervals",
            unknown.join(", ")
        ));
    }
    result.budget = lines;
    result.combine();
}

/// Lines of the fit's own covariance: the clocks of joined logs, and what is left of it, the samples.
fn of_the_fit(
    result: &Identification,
    (fitted, numbers): (&Fitted, &Numbers),
    places: &[Option<usize>],
) -> Vec<BudgetLine> {
    let clocks = Clocks::of(fitted, numbers);
    let (mut samples, mut by_clocks) = (BTreeMap::new(), BTreeMap::new());
    for (key, place) in result.order.iter().zip(places) {
        let Some(sd) = result.parameters.get(key).and_then(|p| p.sd) else {
            continue;
        };
        let clock = place.map_or(0.0, |p| clocks.variance(p, numbers));
        let clock = clock.min(sd * sd);
        samples.insert(key.clone(), (sd * sd - clock).sqrt());
        by_clocks.insert(key.clone(), clock.sqrt());
    }
    let samples = BudgetLine {
        source: "samples, their colour, the random force".to_owned(),
        kind: "A".to_owned(),
        sd: None,
        probability: None,
        unit: String::new(),
        basis: "the fit".to_owned(),
        sensitivities: BTreeMap::new(),
        contributions: samples,
        reduce: "longer runs, or more of them".to_owned(),
    };
    let clock = BudgetLine {
        source: "clocks of joined logs".to_owned(),
        kind: "B".to_owned(),
        sd: clocks.sd(numbers),
        probability: None,
        unit: "s".to_owned(),
        basis: "the joining, and what the runs say of it".to_owned(),
        sensitivities: BTreeMap::new(),
        contributions: by_clocks,
        reduce: "one clock for commands and motion, or an event that both logs show".to_owned(),
    };
    vec![samples, clock]
}

/// Numbers of joined logs' clocks in a fit.
struct Clocks {
    places: Vec<usize>,
    /// Of their covariance; `None` = there are none.
    root: Option<Cholesky<f64, nalgebra::Dyn>>,
}

impl Clocks {
    fn of(fitted: &Fitted, numbers: &Numbers) -> Clocks {
        let own = &fitted.problem.body.own;
        let places: Vec<usize> = (0..own.len()).filter(|i| own[*i].is_clock()).collect();
        let n = places.len();
        let of = |a: usize, b: usize| numbers.covariance[(places[a], places[b])];
        let root = match n {
            0 => None,
            _ => Cholesky::new(DMatrix::from_fn(n, n, of)),
        };
        Clocks { places, root }
    }

    /// Variance that a number of the fit owes to them.
    fn variance(&self, place: usize, numbers: &Numbers) -> f64 {
        let Some(root) = &self.root else {
            return 0.0;
        };
        let each = self.places.iter();
        let shared: Vec<f64> = each.map(|c| numbers.covariance[(place, *c)]).collect();
        let shared = DVector::from_vec(shared);
        shared.dot(&root.solve(&shared)).max(0.0)
    }

    /// sd of the offset, where it is the only number \[s\].
    fn sd(&self, numbers: &Numbers) -> Option<f64> {
        match self.places.as_slice() {
            [one] => Some(numbers.covariance[(*one, *one)].sqrt()),
            _ => None,
        }
    }
}

/// Adds a source to the lines; runs and channels of one source are one line, whose sensitivity is no number.
fn add_line(
    lines: &mut Vec<BudgetLine>,
    (consider, chance): (&Consider, f64),
    keys: &[String],
    by: &[f64],
) {
    let each = || keys.iter().cloned().zip(by).filter(|(_, v)| **v != 0.0);
    if let Some(line) = lines.iter_mut().find(|l| l.source == consider.source) {
        line.sensitivities.clear();
        for (key, v) in each() {
            let sum = line.contributions.entry(key).or_default();
            *sum = sum.hypot(*v);
        }
        // In either place.
        line.probability = line.probability.map(|p| p + chance - p * chance);
        return;
    }
    let per_unit = |sd: f64| each().map(|(key, v)| (key, v / sd)).collect();
    lines.push(BudgetLine {
        source: consider.source.clone(),
        kind: "B".to_owned(),
        sd: consider.sd,
        probability: consider.prior_ln_odds.map(|_| chance),
        unit: consider.unit.to_owned(),
        basis: consider.basis.clone(),
        sensitivities: consider.sd.map_or_else(BTreeMap::new, per_unit),
        contributions: each().map(|(key, v)| (key, v.abs())).collect(),
        reduce: consider.reduce.clone(),
    });
}

/// Change of each natural number of the fit by the standard uncertainty of each consider parameter, and the probability that it acts.
fn changes(fitted: &Fitted, numbers: &Numbers, all: &[Consider]) -> Option<Vec<(Vec<f64>, f64)>> {
    let (problem, fit) = (&fitted.problem, &fitted.fit);
    let n = fit.point.len();
    let mut simulated = problem.simulate(&[], &fit.point)?;
    for (k, consider) in all.iter().enumerate() {
        for (s, moved) in simulated.iter_mut().zip(&consider.moved) {
            s.columns.push((n + k, moved.clone()));
        }
    }
    let size = n + all.len();
    let mut information = DMatrix::<f64>::zeros(size, size);
    let mut gradient = DVector::<f64>::zeros(size);
    for d in &problem.body.dofs {
        let of = problem.normal(&simulated, *d, fit.cells.misfit[*d], size);
        information += of.information;
        gradient += of.gradient;
    }
    let known = numbers.at_mode.map(|v| if v.is_finite() { v } else { 0.0 });
    let each = all.iter().enumerate().map(|(k, consider)| {
        let shared = (0..n).map(|i| information[(i, n + k)] / numbers.slopes[i]);
        let shared = DVector::from_iterator(n, shared);
        let moved = -(&known * &shared);
        // What is left of the effect's own response beside the fit's numbers tells how large it may still be.
        let seen = (information[(n + k, n + k)] + shared.dot(&moved)).max(0.0);
        let (sd, chance) = match consider.prior_ln_odds {
            Some(ln_odds) => of_effect(seen, gradient[n + k], ln_odds),
            None => (1.0, 1.0),
        };
        (moved.iter().map(|v| v * sd).collect(), chance)
    });
    Some(each.collect())
}

/// Largest amplitude that an effect is taken to have, in typical sizes: what asks for more is no effect but what the model misses.
const AMPLITUDE_MOST: f64 = 2.0;

/// Standard uncertainty of an effect's amplitude, in typical sizes, and the probability that it acts: normal about none with the
/// typical size where it does. `seen` = information of the runs beside the fit's numbers, `slope` = gradient of the log likelihood.
fn of_effect(seen: f64, slope: f64, ln_odds: f64) -> (f64, f64) {
    let left = (1.0 + seen).recip();
    let mean = (slope * left).clamp(-AMPLITUDE_MOST, AMPLITUDE_MOST);
    let gain_ln = slope * mean - 0.5 * mean * mean / left + 0.5 * left.ln();
    let chance = (1.0 + (-ln_odds - gain_ln).exp()).recip();
    ((chance * (left + mean * mean)).sqrt(), chance)
}

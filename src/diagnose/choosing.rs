//! What the runs held out that help to choose say for an explanation.
//!
//! Their log density given the runs fitted: with it, log evidence of the runs fitted becomes that of all of them
//! (log p(fitted, held out) = log p(fitted) + log p(held out | fitted)). Numbers stay those of the runs fitted. What
//! these leave open is a normal distribution about the fit (Laplace), from where the runs held out may move it at
//! that price: an effect that is large by a whim of the noise, and known to be, is not refuted by its best value.

use std::collections::BTreeMap;
use std::sync::Mutex;

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::bank::joined;
use super::descent::{Effort, Linear, Linearised, descend};
use super::family::{FamilyFit, Joint};
use super::fit::{Fit, Posed};
use super::predict::{expected, predicted, predicted_beside};
use super::rest::{places, reduced};
use super::setting::{COEFFICIENTS, Setting, Track};
use super::weights::Weights;
use hydroline_identify::forward::ForwardError;

/// Set and cost (its bits) of a fit.
type Key = (Vec<usize>, u64);

/// Runs held out that help to choose; there may be none.
#[derive(Debug, Default)]
pub struct Choosing {
    asked: Option<(Setting, Weights)>,
    /// Effects that only these runs show, which stand beside every set, and where their numbers begin.
    shown: Vec<(usize, Vec<f64>)>,
    known: Mutex<BTreeMap<Key, Option<f64>>>,
}

/// rms of the runs held out over what it may be where a set is right, above which it does not foretell them.
const MISSES: f64 = 2.0;

impl Choosing {
    /// Of these runs, under the noise of the runs fitted; `used` = the samples that count, for every explanation.
    pub fn new(
        setting: &Setting,
        weights: &Weights,
        held: &[Track],
        used: Vec<Vec<bool>>,
    ) -> Choosing {
        if held.is_empty() {
            return Choosing::default();
        }
        let weights = Weights::new(held, weights.noise, used).at_rest(weights.rest_sd);
        Choosing {
            asked: Some((setting.with_tracks(held.to_vec()), weights)),
            ..Choosing::default()
        }
    }

    /// The same, with the samples that are no outliers under this fit.
    pub fn like(setting: &Setting, weights: &Weights, held: &[Track], fit: &Fit) -> Choosing {
        predicted(setting, held, fit, weights.noise).map_or_else(Choosing::default, |p| {
            Choosing::new(setting, weights, held, p.kept())
        })
    }

    /// Whether a set foretells the runs with the numbers of the runs fitted. Where none does, no law is exact: a narrow
    /// distribution about wrong numbers is refuted by more than a wide one, and log densities compare errors of laws.
    pub fn foretold(&self, setting: &Setting, weights: &Weights, fit: &Fit) -> bool {
        let Some((other, _)) = &self.asked else {
            return false;
        };
        let noise = weights.noise;
        predicted(setting, &other.tracks, &self.wider(setting, fit), noise)
            .is_some_and(|p| p.rms < MISSES * expected(setting, &other.tracks, fit, noise))
    }

    /// Whether a set foretells them beside a free function, which must be one that lasts.
    pub fn foretold_beside(
        &self,
        setting: &Setting,
        weights: &Weights,
        fit: &Fit,
        function: &FamilyFit,
    ) -> bool {
        let Some((other, _)) = &self.asked else {
            return false;
        };
        let (noise, fit) = (weights.noise, self.wider(setting, fit));
        predicted_beside(setting, &other.tracks, &fit, function, noise)
            .is_some_and(|p| p.rms < MISSES * noise.total_sd())
    }

    /// The same if one of these sets foretells the runs, else none.
    #[must_use]
    pub fn unless_far(self, setting: &Setting, weights: &Weights, fits: &[&Fit]) -> Choosing {
        let near = |f: &&Fit| self.foretold(setting, weights, f);
        if fits.par_iter().any(near) {
            self
        } else {
            Choosing::default()
        }
    }

    /// The same beside effects that only these runs show, so that no law is bent for them.
    #[must_use]
    pub fn with(mut self, shown: &[(usize, Vec<f64>, f64)]) -> Choosing {
        self.shown = shown.iter().map(|s| (s.0, s.1.clone())).collect();
        self
    }

    /// A fit with them, and with the numbers that they begin with.
    fn wider(&self, setting: &Setting, fit: &Fit) -> Fit {
        let mut wide = fit.clone();
        for (candidate, point) in &self.shown {
            if !wide.set.contains(candidate) {
                (wide.set, wide.at) = joined(setting, &wide, *candidate, point);
            }
        }
        wide
    }

    /// Which samples count, run by run.
    pub fn used(&self) -> &[Vec<bool>] {
        self.asked.as_ref().map_or(&[], |a| &a.1.used)
    }

    /// Log density of the runs under a fit of the runs of `setting` (up to a constant of the runs); 0 where there are none.
    /// A motion that runs off foretells nothing: the least there is.
    pub fn of(&self, setting: &Setting, weights: &Weights, fit: &Fit) -> f64 {
        if self.asked.is_none() {
            return 0.0;
        }
        self.said(setting, weights, fit)
            .unwrap_or(f64::NEG_INFINITY)
    }

    /// The same; `None` where the motion runs off, or without runs.
    pub fn said(&self, setting: &Setting, weights: &Weights, fit: &Fit) -> Option<f64> {
        let asked = self.asked.as_ref()?;
        let key = (fit.set.clone(), fit.cost.to_bits());
        let known = self.known.lock().ok().and_then(|k| k.get(&key).copied());
        known.unwrap_or_else(|| {
            let cost = (!self.shown.is_empty()).then_some(fit.cost);
            let made = plain(setting, weights, asked, &self.wider(setting, fit), cost);
            if let Ok(mut known) = self.known.lock() {
                known.insert(key, made);
            }
            made
        })
    }

    /// The same beside a free function, which must be one that lasts; `None` where the motion runs off, or without runs.
    pub fn beside(
        &self,
        setting: &Setting,
        weights: &Weights,
        fit: &Fit,
        function: &FamilyFit,
    ) -> Option<f64> {
        let (other, theirs) = self.asked.as_ref()?;
        let cost = (!self.shown.is_empty()).then(|| {
            let plain = Joint::new(setting, weights, fit, function);
            plain.residuals(&function.unknowns(fit)).0
        });
        let fit = &self.wider(setting, fit);
        let train = Joint::new(setting, weights, fit, function);
        let globals = fit.globals(setting).len();
        let starts = globals..fit.at.len();
        let known = Known::of(&train, &function.unknowns(fit), starts, cost)?;
        let there = Fit {
            at: begin(other, theirs, fit, globals),
            ..fit.clone()
        };
        let joint = Joint::new(other, theirs, &there, function);
        let (prior, _) = function.prior.precision(&function.family);
        let from = function.unknowns(&there);
        density(&joint, other, theirs, fit, known, prior, from)
    }

    /// Log evidence of all runs under a set.
    pub fn evidence(&self, setting: &Setting, weights: &Weights, fit: &Fit) -> f64 {
        fit.log_evidence + self.of(setting, weights, fit)
    }

    /// The likeliest of some sets.
    pub fn likeliest<'a>(
        &self,
        setting: &Setting,
        weights: &Weights,
        fits: &[&'a Fit],
    ) -> Option<&'a Fit> {
        let all: Vec<(f64, &Fit)> = fits
            .par_iter()
            .map(|f| (self.evidence(setting, weights, f), *f))
            .collect();
        all.into_iter()
            .max_by(|a, b| {
                // Where none foretells anything the runs fitted decide.
                let fitted = a.1.log_evidence.total_cmp(&b.1.log_evidence);
                a.0.total_cmp(&b.0).then(fitted)
            })
            .map(|f| f.1)
    }
}

/// A fit's globals, and where the runs held out begin.
fn begin(other: &Setting, weights: &Weights, fit: &Fit, globals: usize) -> Vec<f64> {
    let mut at = Posed::new(other, weights, &fit.set).start();
    at[..globals].copy_from_slice(&fit.at[..globals]);
    at
}

fn plain(
    setting: &Setting,
    weights: &Weights,
    (other, theirs): &(Setting, Weights),
    fit: &Fit,
    cost: Option<f64>,
) -> Option<f64> {
    let train = Posed::new(setting, weights, &fit.set);
    let globals = fit.globals(setting).len();
    let known = Known::of(&train, &fit.at, globals..fit.at.len(), cost)?;
    let held = Posed::new(other, theirs, &fit.set);
    let from = begin(other, theirs, fit, globals);
    let none = DMatrix::zeros(0, 0);
    density(&held, other, theirs, fit, known, none, from)
}

/// Numbers that all runs share after the runs fitted: half chi-square about a fit, each of these runs' start free to follow.
struct Known {
    at: Vec<f64>,
    gradient: DVector<f64>,
    precision: DMatrix<f64>,
    /// Half chi-square of the runs fitted there over that of the fit.
    worse: f64,
}

impl Known {
    /// About a point; `cost` = half chi-square of the fit, where effects that only the runs held out show have joined it since.
    fn of(
        train: &impl Linearised,
        at: &[f64],
        starts: std::ops::Range<usize>,
        cost: Option<f64>,
    ) -> Option<Known> {
        let linear = train.linearise(at).ok()?;
        let shared: Vec<usize> = (0..at.len()).filter(|i| !starts.contains(i)).collect();
        let (precision, gradient) = reduced(&linear.hessian, &linear.gradient, &shared)?;
        Some(Known {
            at: shared.iter().map(|i| at[*i]).collect(),
            gradient,
            precision,
            worse: cost.map_or(0.0, |cost| linear.cost - cost),
        })
    }
}

fn density(
    held: &impl Linearised,
    other: &Setting,
    weights: &Weights,
    fit: &Fit,
    known: Known,
    prior: DMatrix<f64>,
    from: Vec<f64>,
) -> Option<f64> {
    let globals = fit.globals(other).len();
    let starts = 2 * other.tracks.len();
    let mut before = known.precision.clone();
    let told = Told {
        held,
        posed: Posed::new(other, weights, &fit.set),
        places: (0..globals).chain(globals + starts..from.len()).collect(),
        globals,
        known,
        prior,
    };
    let found = descend(&told, from, Effort::FULL).ok()?;
    let mut after = found.hessian;
    // What data leave open is no wider than its prior, as in the evidence.
    for (i, floor) in fit.prior_floors(other).into_iter().enumerate() {
        before[(COEFFICIENTS + i, COEFFICIENTS + i)] += floor;
        after[(COEFFICIENTS + i, COEFFICIENTS + i)] += floor;
    }
    let (before, after) = (Width::of(&before)?, Width::of(&after)?);
    let made = before.half_log_det - found.cost - after.half_log_det
        + sizes(other, fit, &found.at, &after)
        - sizes(other, fit, &told.known.at, &before)
        - 0.5 * weights.log_variance()
        // Of how still these runs begin, as of their noise: another belief is another density.
        + 0.5 * places(other, 0).len() as f64 * weights.rest_precision(other.tolerance).ln()
        - told.known.worse;
    made.is_finite().then_some(made)
}

/// Log prior of the sizes of a set's members over a flat one: most are small, as in the evidence.
fn sizes(setting: &Setting, fit: &Fit, at: &[f64], width: &Width) -> f64 {
    fit.set
        .iter()
        .zip(setting.places(&fit.set))
        .filter_map(|(c, k)| Some(setting.vocabulary[*c].size?.log_prior(at[k], width.sds[k])))
        .sum()
}

/// How wide a normal distribution is, from its second derivatives, unknowns of any size.
struct Width {
    half_log_det: f64,
    sds: Vec<f64>,
}

impl Width {
    fn of(h: &DMatrix<f64>) -> Option<Width> {
        let n = h.nrows();
        let scale: Vec<f64> = (0..n).map(|i| h[(i, i)].sqrt().max(1e-150)).collect();
        let scaled = DMatrix::from_fn(n, n, |i, j| {
            h[(i, j)] / (scale[i] * scale[j]) + if i == j { 1e-13 } else { 0.0 }
        });
        let root = scaled.cholesky()?;
        let logs: f64 = root.l_dirty().diagonal().iter().map(|d| d.ln()).sum();
        let inverse = root.inverse();
        Some(Width {
            half_log_det: logs + scale.iter().map(|s| s.ln()).sum::<f64>(),
            sds: (0..n).map(|i| inverse[(i, i)].sqrt() / scale[i]).collect(),
        })
    }
}

/// Least squares of runs held out, with what is known of the numbers that they share with the runs fitted in the place of
/// their prior.
struct Told<'a, P> {
    held: &'a P,
    posed: Posed<'a>,
    /// Where the known numbers stand among the unknowns.
    places: Vec<usize>,
    globals: usize,
    known: Known,
    /// Precision of a function's amplitudes, which stand last.
    prior: DMatrix<f64>,
}

/// Half a square's value, first and second derivatives with respect to the known numbers.
struct Share {
    cost: f64,
    gradient: DVector<f64>,
    hessian: DMatrix<f64>,
}

impl<P: Linearised> Told<'_, P> {
    /// What is known less the prior, which is a part of it.
    fn share(&self, at: &[f64]) -> Share {
        let n = self.places.len();
        let step = DVector::from_fn(n, |i, _| at[self.places[i]] - self.known.at[i]);
        let bent = &self.known.precision * &step;
        let mut share = Share {
            cost: self.known.gradient.dot(&step) + 0.5 * step.dot(&bent),
            gradient: &self.known.gradient + bent,
            hessian: self.known.precision.clone(),
        };
        let priors = self.posed.precisions(&at[..at.len() - self.prior.nrows()]);
        for (i, (centre, k)) in priors.into_iter().take(self.globals).enumerate() {
            let away = at[i] - centre;
            share.cost -= 0.5 * k * away * away;
            share.gradient[i] -= k * away;
            share.hessian[(i, i)] -= k;
        }
        let m = self.prior.nrows();
        let amplitudes = DVector::from_column_slice(&at[at.len() - m..]);
        let pull = &self.prior * &amplitudes;
        share.cost -= 0.5 * amplitudes.dot(&pull);
        let first = n - m;
        for i in 0..m {
            share.gradient[first + i] -= pull[i];
            for j in 0..m {
                share.hessian[(first + i, first + j)] -= self.prior[(i, j)];
            }
        }
        share
    }
}

impl<P: Linearised> Linearised for Told<'_, P> {
    fn bounds(&self, i: usize) -> (f64, f64) {
        self.held.bounds(i)
    }

    fn residuals(&self, at: &[f64]) -> (f64, Vec<Vec<f64>>) {
        let (cost, residuals) = self.held.residuals(at);
        (cost + self.share(at).cost, residuals)
    }

    fn linearise(&self, at: &[f64]) -> Result<Linear, ForwardError> {
        let mut all = self.held.linearise(at)?;
        let share = self.share(at);
        all.cost += share.cost;
        for (i, p) in self.places.iter().enumerate() {
            all.gradient[*p] += share.gradient[i];
            for (j, q) in self.places.iter().enumerate() {
                all.hessian[(*p, *q)] += share.hessian[(i, j)];
            }
        }
        Ok(all)
    }

    fn gradient(
        &self,
        at: &[f64],
        residuals: &[Vec<f64>],
        jacobians: &[DMatrix<f64>],
    ) -> DVector<f64> {
        let mut all = self.held.gradient(at, residuals, jacobians);
        let share = self.share(at);
        for (i, p) in self.places.iter().enumerate() {
            all[*p] += share.gradient[i];
        }
        all
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bank::View;
    use crate::family::{Variable, forces};
    use crate::testing::{candidate, setting, surge};

    fn fitted(setting: &Setting, weights: &Weights, set: &[usize]) -> Fit {
        let posed = Posed::new(setting, weights, set);
        posed.fit(posed.start()).unwrap()
    }

    /// Evidence of the runs fitted with what the one held out says given them is evidence of all runs: against
    /// a fit of all of them, set by set.
    #[test]
    fn evidence_of_all_runs_is_that_of_some_and_of_the_others_given_them() {
        let drag: &[(&str, &[(&str, f64)])] = &[("constant_force", &[("bias_n", 0.05)])];
        let runs = [surge(0, drag), surge(1, drag), surge(2, drag)];
        let (some, all) = (setting(&runs[..2]), setting(&runs));
        let held = [all.tracks[2].clone()];
        let still = Some(1e-6);
        let noise = Weights::first(&all.tracks).noise;
        let used = |tracks: &[Track]| tracks.iter().map(|t| vec![true; t.times_s.len()]).collect();
        let weights = |s: &Setting| Weights::new(&s.tracks, noise, used(&s.tracks)).at_rest(still);
        let (own, whole) = (weights(&some), weights(&all));
        let choosing = Choosing::new(&some, &own, &held, used(&held));
        let both = |ids: &[&str]| {
            let mut set: Vec<usize> = ids.iter().map(|i| candidate(&some, i)).collect();
            set.sort_unstable();
            let fit = fitted(&some, &own, &set);
            let apart = choosing.evidence(&some, &own, &fit);
            (apart, fitted(&all, &whole, &set).log_evidence)
        };
        let right = both(&["constant_force"]);
        // Small effects that are not there, and a wrong one that nearly does as well.
        for ids in [
            &["constant_force", "coulomb_friction"][..],
            &["constant_force", "cubic_damping"],
            &["constant_force", "thruster_deadband", "battery_sag"],
            &["current"],
        ] {
            let set = both(ids);
            let (apart, together) = (set.0 - right.0, set.1 - right.1);
            let close = 0.3 + 0.05 * together.abs();
            assert!(
                (apart - together).abs() < close,
                "{ids:?}: {apart} {together}"
            );
        }
        assert!(right.0 > both(&[]).0 + 10.0);
    }

    /// The same of a free function beside the set, under one prior of its amplitudes.
    #[test]
    fn evidence_with_a_free_function_is_that_of_some_runs_and_of_the_others_given_them() {
        let spring: &[(&str, &[(&str, f64)])] =
            &[("tether_spring", &[("stiffness_npm", 0.4), ("slack_m", 0.2)])];
        // The run held out goes no further than those fitted.
        let runs = [surge(0, spring), surge(2, spring), surge(1, spring)];
        let (some, all) = (setting(&runs[..2]), setting(&runs));
        let held = [all.tracks[2].clone()];
        let noise = Weights::first(&all.tracks).noise;
        let used = |tracks: &[Track]| tracks.iter().map(|t| vec![true; t.times_s.len()]).collect();
        let weights =
            |s: &Setting| Weights::new(&s.tracks, noise, used(&s.tracks)).at_rest(Some(1e-6));
        let (own, whole) = (weights(&some), weights(&all));
        let choosing = Choosing::new(&some, &own, &held, used(&held));
        let plain = fitted(&some, &own, &[]);
        let view = View::new(&some, &own, &plain);
        let families = forces(&some, &plain);
        let of_place = families.iter().find(|f| f.variable == Variable::Place);
        let linear = of_place.unwrap().fit(&some, &own, &plain, &view).unwrap();
        let (joint, function) = linear.close(&some, &own, &plain, Effort::FULL).unwrap();
        let said = choosing.beside(&some, &own, &joint, &function).unwrap();
        let from = fitted(&all, &whole, &[]);
        let (both, _) = function.refine(&all, &whole, &from, Effort::FULL).unwrap();
        // Beside the law itself, which comes as near to the noise.
        let set = [candidate(&some, "tether_spring")];
        let law = fitted(&some, &own, &set);
        let apart = joint.log_evidence + said - choosing.evidence(&some, &own, &law);
        let together = both.log_evidence - fitted(&all, &whole, &set).log_evidence;
        assert!(
            (apart - together).abs() < 0.3 + 0.05 * together.abs(),
            "{apart} {together}"
        );
        // Without the function the run held out is missed, and with it one that no spring pulls.
        assert!(choosing.of(&some, &own, &plain) < said - 10.0);
        let free = setting(&[surge(1, &[])]).tracks;
        let other = Choosing::new(&some, &own, &free, used(&free));
        let of_free = other.beside(&some, &own, &joint, &function).unwrap();
        assert!(of_free < said - 10.0, "{of_free} {said}");
    }

    /// Runs that begin stiller than believed were worth the less, by the precision of a rate for each run held out: what is
    /// believed of the start was compared without it.
    #[test]
    fn how_still_runs_begin_is_part_of_what_the_runs_held_out_say() {
        let runs = [surge(0, &[]), surge(1, &[]), surge(2, &[])];
        let (some, all) = (setting(&runs[..2]), setting(&runs));
        let held = [all.tracks[2].clone()];
        let noise = Weights::first(&all.tracks).noise;
        let used = |tracks: &[Track]| tracks.iter().map(|t| vec![true; t.times_s.len()]).collect();
        let apart = |still: f64| {
            let weights =
                |s: &Setting| Weights::new(&s.tracks, noise, used(&s.tracks)).at_rest(Some(still));
            let (own, whole) = (weights(&some), weights(&all));
            let choosing = Choosing::new(&some, &own, &held, used(&held));
            let begin = |runs: f64| 0.5 * runs * own.rest_precision(some.tolerance).ln();
            choosing.evidence(&some, &own, &fitted(&some, &own, &[])) + begin(2.0)
                - fitted(&all, &whole, &[]).log_evidence
                - begin(3.0)
        };
        let (still, drifting) = (apart(1e-6), apart(1e-4));
        assert!((still - drifting).abs() < 0.3, "{still} {drifting}");
    }

    /// Runs that no set foretells choose nothing; beside an effect that only they show they do.
    #[test]
    fn runs_that_no_set_foretells_choose_nothing() {
        let own = setting(&[surge(0, &[]), surge(1, &[])]);
        let weights = Weights::first(&own.tracks);
        let fit = fitted(&own, &weights, &[]);
        let track =
            |effects: &[(&str, &[(&str, f64)])]| setting(&[surge(2, effects)]).tracks[0].clone();
        let (near, far) = (
            [track(&[])],
            [track(&[("constant_force", &[("bias_n", 0.2)])])],
        );
        let used = vec![vec![true; near[0].times_s.len()]];
        let of = |held: &[Track]| Choosing::new(&own, &weights, held, used.clone());
        let chooses = |c: Choosing| {
            c.unless_far(&own, &weights, &[&fit])
                .said(&own, &weights, &fit)
                .is_some()
        };
        let shown = [(candidate(&own, "constant_force"), vec![0.2], 9.0)];
        assert!(chooses(of(&near)));
        assert!(!chooses(of(&far)));
        assert!(chooses(of(&far).with(&shown)));
        assert!(!chooses(of(&near).with(&shown)));
        let density = |c: Choosing| c.of(&own, &weights, &fit);
        // It stands in the runs fitted too, which refute this one.
        assert!(density(of(&near).with(&shown)) < density(of(&near)) - 50.0);
    }

    /// What is known badly may be moved by the run held out; what is known well may not.
    #[test]
    fn a_run_that_does_not_fit_tells_against_what_was_sure() {
        let runs = [surge(0, &[]), surge(1, &[])];
        let own = setting(&runs);
        let weights = Weights::first(&own.tracks);
        let fit = fitted(&own, &weights, &[]);
        let density =
            |held: &[Track]| Choosing::like(&own, &weights, held, &fit).of(&own, &weights, &fit);
        let track =
            |effects: &[(&str, &[(&str, f64)])]| setting(&[surge(2, effects)]).tracks[0].clone();
        let (right, wrong) = (
            density(&[track(&[])]),
            density(&[track(&[("current", &[("vx_mps", 0.01)])])]),
        );
        assert!(right > wrong + 50.0, "{right} {wrong}");
        assert_eq!(Choosing::default().of(&own, &weights, &fit), 0.0);
    }
}

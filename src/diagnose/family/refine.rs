//! A free function fitted together with its set, its knots made denser where it bends.

use nalgebra::DVector;

use super::linear::Smooth;
use super::prior::Prior;
use super::{Acts, Family, FamilyFit, Joint, PENALTY, Variable};
use crate::descent::{Effort, Linearised, descend};
use crate::fit::Fit;
use crate::setting::Setting;
use crate::weights::Weights;
use hydroline_identify::uncertainty::covariance;

/// Times that the knots of a function are made denser.
const SHARPENED: usize = 5;
/// Half chi-square per sample above which a function may need more knots; noise leaves 0.5.
const FAR_FROM_NOISE: f64 = 0.53;
/// Log evidence that they must gain.
const WORTH_KNOTS: f64 = 5.0;
/// Length over which both ends of a line are alike at first, over what lies between them.
const LINE_LENGTH: f64 = 0.6;
/// Bends about which intervals are halved at once.
const BENDS_SPLIT: usize = 6;

impl FamilyFit {
    /// Motion of all runs under a set with this function, runs end to end \[m, rad\].
    pub fn motion(
        &self,
        setting: &Setting,
        set: &[usize],
        globals: &[f64],
        starts: &[(f64, f64)],
    ) -> DVector<f64> {
        let all: Vec<f64> = (0..setting.tracks.len())
            .flat_map(|run| {
                let a = &self.amplitudes;
                self.family
                    .drive(setting, run, set, globals, starts[run], a, &|v, _, _| v)
            })
            .collect();
        DVector::from_vec(all)
    }

    /// Unknowns of a set, then this function's amplitudes.
    pub fn unknowns(&self, fit: &Fit) -> Vec<f64> {
        fit.at.iter().chain(&self.amplitudes).copied().collect()
    }

    /// What a set with this function leaves, predicted minus measured, run by run \[m, rad\].
    pub fn residuals(&self, setting: &Setting, weights: &Weights, fit: &Fit) -> Vec<Vec<f64>> {
        Joint::new(setting, weights, fit, self).raw(&self.unknowns(fit))
    }

    /// As [`FamilyFit::refine`]; a function of what was measured becomes one of the model's motion.
    pub fn close(
        &self,
        setting: &Setting,
        weights: &Weights,
        fit: &Fit,
        effort: Effort,
    ) -> Option<(Fit, FamilyFit)> {
        let (joint, mut found) = self.refine(setting, weights, fit, effort)?;
        if !found.family.measured {
            return Some((joint, found));
        }
        found.family.measured = false;
        let from = Fit {
            at: joint.at,
            ..fit.clone()
        };
        found.refine(setting, weights, &from, effort)
    }

    /// A refined fit with more knots where the function bends most, as long as it is far from the
    /// noise and more knots earn their keep: what begins and ends sharply (a snag) needs them.
    pub fn sharpen(
        setting: &Setting,
        weights: &Weights,
        base: &Fit,
        mut found: (Fit, FamilyFit),
    ) -> (Fit, FamilyFit) {
        for _ in 0..SHARPENED {
            if found.0.cost < FAR_FROM_NOISE * weights.samples() as f64 {
                break;
            }
            let from = Fit {
                at: found.0.at.clone(),
                ..base.clone()
            };
            match found
                .1
                .split()
                .refine(setting, weights, &from, Effort::FULL)
            {
                Some(finer) if finer.0.log_evidence > found.0.log_evidence + WORTH_KNOTS => {
                    found = finer;
                }
                _ => break,
            }
        }
        found
    }

    /// The prior chosen anew where the function has come to: a fit from far off chose it under what was still
    /// missing. The better of both.
    pub fn smooth(
        setting: &Setting,
        weights: &Weights,
        (joint, function): (Fit, FamilyFit),
        effort: Effort,
    ) -> (Fit, FamilyFit) {
        let again = || {
            let problem = Joint::new(setting, weights, &joint, &function);
            let (_, n, m) = problem.sizes;
            let linear = problem.linearise(&function.unknowns(&joint)).ok()?;
            let (h, g) = (linear.hessian, linear.gradient);
            let (precision, _) = function.prior.precision(&function.family);
            // What the data say of the amplitudes, the set's own unknowns integrated out.
            let cross = h.view((0, n), (n, m)).into_owned();
            let mut own = h.view((0, 0), (n, n)).into_owned();
            for i in 0..n {
                // A number that the data say nothing of takes nothing away.
                own[(i, i)] = own[(i, i)] * (1.0 + 1e-9) + 1e-12;
            }
            let own = own.cholesky()?;
            let with_prior = h.view((n, n), (m, m)) - cross.tr_mul(&own.solve(&cross));
            let slope = g.rows(n, m) - cross.tr_mul(&own.solve(&g.rows(0, n).into_owned()));
            let product = slope - &with_prior * DVector::from_column_slice(&function.amplitudes);
            let best = Smooth::best(
                &function.family,
                setting,
                &(with_prior - precision),
                &product,
            )?;
            let other = FamilyFit {
                prior: best.prior(),
                ..function.clone()
            };
            (other.prior != function.prior).then_some(())?;
            other.refine(setting, weights, &joint, effort)
        };
        match again() {
            Some(other) if other.0.log_evidence > joint.log_evidence => other,
            _ => (joint, function),
        }
    }

    /// A law that bends along the tank, or in the course of a log, as a line between the ends of what the runs saw: one
    /// number, and it goes on where they did not go. `None` for what is no such law, or is a line already.
    pub fn straightened(&self) -> Option<FamilyFit> {
        let bends = matches!(self.family.acts, Acts::Bends(_));
        let evenly = matches!(self.family.variable, Variable::Place | Variable::Time);
        if !bends || !evenly || self.family.straight() {
            return None;
        }
        let (first, last) = (*self.family.knots.first()?, *self.family.knots.last()?);
        let family = Family {
            knots: vec![first, last],
            ..self.family.clone()
        };
        // Through the factors at the knots, each as it is known: at the ends hardly.
        let sums = self
            .family
            .knots
            .iter()
            .zip(&self.amplitudes)
            .zip(&self.sds)
            .fold([0.0; 5], |s, ((knot, a), sd)| {
                let (at, factor) = ((knot - first) / (last - first), a.exp());
                let w = (factor * sd.max(f64::EPSILON)).powi(-2);
                let y = factor - 1.0;
                [
                    s[0] + w,
                    s[1] + w * at,
                    s[2] + w * at * at,
                    s[3] + w * y,
                    s[4] + w * at * y,
                ]
            });
        let [w, x, xx, y, xy] = sums;
        let slope = (w * xy - x * y) / (w * xx - x * x);
        let begin = (y - slope * x) / w;
        if !(begin.is_finite() && slope.is_finite()) {
            return None;
        }
        Some(FamilyFit {
            amplitudes: vec![begin, begin + slope],
            prior: Prior {
                length: Prior::length(&family, LINE_LENGTH, 1),
                ..self.prior
            },
            family,
            ..self.clone()
        })
    }

    /// The same function with the intervals around its sharpest bends halved.
    fn split(&self) -> FamilyFit {
        let (k, a) = (&self.family.knots, &self.amplitudes);
        let slope = |i: usize| (a[i + 1] - a[i]) / (k[i + 1] - k[i]);
        let mut bends: Vec<(f64, usize)> = (1..k.len().saturating_sub(1))
            .map(|i| ((slope(i) - slope(i - 1)).abs(), i))
            .collect();
        bends.sort_by(|x, y| y.0.total_cmp(&x.0));
        let halved: std::collections::BTreeSet<usize> = bends
            .iter()
            .take(BENDS_SPLIT)
            .flat_map(|(_, i)| [i - 1, *i])
            // Between two runs nothing is to be seen.
            .filter(|i| !self.family.between_runs(*i))
            .collect();
        let mut finer = self.clone();
        (finer.family.knots, finer.amplitudes) = (Vec::new(), Vec::new());
        let quiet = std::mem::take(&mut finer.family.quiet);
        for i in 0..k.len() {
            finer.family.knots.push(k[i]);
            finer.amplitudes.push(a[i]);
            finer.family.quiet.extend(quiet.get(i));
            if halved.contains(&i) {
                finer
                    .family
                    .quiet
                    .extend(quiet.get(i..i + 2).map(|q| q[0] && q[1]));
                finer.family.knots.push(0.5 * (k[i] + k[i + 1]));
                finer.amplitudes.push(0.5 * (a[i] + a[i + 1]));
            }
        }
        finer
    }

    /// Fits set and function together, nonlinearly, from the linear fit; the set's evidence then
    /// includes the function's. `None` where the motion diverges.
    pub fn refine(
        &self,
        setting: &Setting,
        weights: &Weights,
        fit: &Fit,
        effort: Effort,
    ) -> Option<(Fit, FamilyFit)> {
        let problem = Joint::new(setting, weights, fit, self);
        let (_, n, m) = problem.sizes;
        let mut from = self.unknowns(fit);
        // The linear fit also moves the set's own unknowns: from the old ones it may be worse than nothing.
        let mut still = from.clone();
        still[n..].fill(0.0);
        let cost = problem.residuals(&from).0;
        if cost.is_nan() || cost >= problem.residuals(&still).0 {
            from = still;
        }
        let found = descend(&problem, from, effort).ok()?;
        if !found.cost.is_finite() {
            return None;
        }
        let mut joint = Fit {
            set: fit.set.clone(),
            at: found.at[..n].to_vec(),
            cost: found.cost,
            hessian: found.hessian,
            log_evidence: 0.0,
            rough: found.rough,
        };
        joint.log_evidence = problem.posed.log_evidence(&joint) + problem.prior_half_log
            - PENALTY
            - self.family.choice();
        if !joint.log_evidence.is_finite() {
            return None;
        }
        let spread = covariance(&joint.hessian);
        let made = FamilyFit {
            gain: joint.log_evidence - fit.log_evidence,
            amplitudes: found.at[n..].to_vec(),
            sds: (n..n + m).map(|i| spread[(i, i)].max(0.0).sqrt()).collect(),
            response: problem.response(&found.at),
            ..self.clone()
        };
        // Behind here only the set's own unknowns are asked for: the function's are integrated out.
        let h = &joint.hessian;
        let cross = h.view((0, n), (n, m)).into_owned();
        let own = h.view((n, n), (m, m)).into_owned();
        joint.hessian = h.view((0, 0), (n, n)) - &cross * own.cholesky()?.solve(&cross.transpose());
        Some((joint, made))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Through factors on a line goes that line, whatever a knot says that the runs say nothing of.
    #[test]
    fn a_law_that_varies_evenly_along_the_tank_is_straightened_to_its_line() {
        let knots: Vec<f64> = (0..9).map(|k| -0.5 + 0.25 * f64::from(k)).collect();
        let mut curve = FamilyFit {
            amplitudes: knots.iter().map(|x| (1.0 + 0.4 * x).ln()).collect(),
            sds: vec![0.05; 9],
            gain: 0.0,
            prior: Prior {
                sd: 0.3,
                length: 0.2,
            },
            response: DVector::zeros(0),
            family: Family {
                acts: Acts::Bends(0),
                variable: Variable::Place,
                knots,
                measured: false,
                quiet: Vec::new(),
            },
        };
        let line = curve.straightened().unwrap();
        assert_eq!(line.family.knots, [-0.5, 1.5]);
        let ends = [line.amplitudes[0] - -0.2, line.amplitudes[1] - 0.6];
        assert!(ends.iter().all(|e| e.abs() < 1e-9), "{:?}", line.amplitudes);
        (curve.amplitudes[8], curve.sds[8]) = (-0.9, 50.0);
        let end = curve.straightened().unwrap().amplitudes[1];
        assert!((end - 0.6).abs() < 1e-3, "{end}");
        // In the course of a log as well; a line has no straighter one, and what depends on the load or is a force goes nowhere along the tank.
        assert!(line.straightened().is_none());
        curve.family.variable = Variable::Time;
        assert!(curve.straightened().is_some());
        curve.family.variable = Variable::Load;
        assert!(curve.straightened().is_none());
        curve.family.variable = Variable::Place;
        curve.family.acts = Acts::Force;
        assert!(curve.straightened().is_none());
    }
}

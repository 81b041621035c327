//! Separation of two models: how far one can follow what the other would do in a run that is not there yet.
//!
//! The run is predicted under one model; the other is refitted to it together with what the runs at hand say of its
//! numbers. What it still cannot follow, in half squares of the noise and its own random force, is the log Bayes factor to
//! expect (Kullback–Leibler divergence of the two predictions; Chaloner and Verdinelli 1995).

use hydroline_core::run::{Command, PerChannel, Run, Sample};
use hydroline_rigs::Rig;
use hydroline_sim::effect::EffectError;
use nalgebra::{Cholesky, DMatrix, DVector};

use super::body::Point;
use super::fit::{Fit, Problem};
use super::hyper::filters;

/// Refits of the other model; slow and strong laws need more than one.
const REFITS: usize = 4;

impl Problem {
    /// The same body under commands that were never given, from the rig's start at rest.
    ///
    /// # Errors
    /// [`EffectError`] for a bad `[[physics]]` entry of the rig.
    pub fn planned(
        &self,
        name: &str,
        commands: Vec<Command>,
        times_s: &[f64],
        rig: &Rig,
    ) -> Result<Problem, EffectError> {
        let start = PerChannel::of_state(rig.tank.start_pose, [0.0; 6]);
        let rest = PerChannel::from_fn(|c| match self.body.recording.channels[c] {
            true => start[c],
            false => f64::NAN,
        });
        let sample = |t_s: &f64| Sample {
            t_s: *t_s,
            values: rest,
            covariance: None,
        };
        let run = Run {
            name: name.to_owned(),
            commands,
            samples: times_s.iter().map(sample).collect(),
            ..Run::default()
        };
        let mut made = self.over(&[run], rig)?;
        // Noise along the tank's axes: the body's turn from them in a run that both models move alike.
        for r in &mut made.body.recording.runs {
            r.heading.iter_mut().for_each(|h| *h = (0.0, 1.0));
        }
        Ok(made)
    }

    /// Log Bayes factor to expect for `truth` over `other` from the run of `planned`, which is one of [`Problem::planned`].
    ///
    /// `None` where either gives no finite motion.
    pub fn separation(&self, planned: &mut Problem, truth: &Fit, other: &Fit) -> Option<f64> {
        let globals = |fit: &Fit| self.body.places(&fit.terms).last().copied();
        let start = |problem: &Problem| -> Vec<f64> {
            let (free, rest) = (&problem.body.starts[0], &problem.body.rest[0]);
            free.iter().map(|c| rest[*c]).collect()
        };
        let mut point: Point = truth.point[..globals(truth)?].to_vec();
        point.extend(start(planned));
        let motion = planned.predicted(&truth.terms, &point).pop()?;
        if !motion.iter().flatten().all(|v| v.is_finite()) {
            return None;
        }
        planned.body.recording.runs[0].values = motion;
        let own = globals(other)?;
        // Precision of these numbers by the runs at hand, their starts taken out.
        let known =
            Cholesky::new(other.covariance.view((0, 0), (own, own)).into_owned())?.inverse();
        let mut at: Point = other.point[..own].to_vec();
        at.extend(start(planned));
        let n = at.len();
        let number_prior = planned.number_prior(&other.terms);
        let mut best = f64::INFINITY;
        for _ in 0..REFITS {
            let all = planned.simulate(&other.terms, &at)?;
            let (mut information, mut gradient) = (DMatrix::zeros(n, n), DVector::zeros(n));
            let mut cost = 0.0;
            for &d in &planned.body.dofs {
                let cell = other.cells.misfit[d];
                let filters = filters(&planned.body, &self.worth, &planned.noises, d, cell);
                let normal = planned.normal_with(&all, d, &filters, n);
                information += normal.information;
                gradient += normal.gradient;
                // Without the variances, which are the same for both.
                cost += normal.cost - 0.5 * filters.iter().map(|f| f.ln_variance).sum::<f64>();
            }
            let off = DVector::from_fn(own, |i, _| at[i] - other.point[i]);
            let pull = &known * &off;
            best = best.min(cost + 0.5 * off.dot(&pull));
            for i in 0..own {
                gradient[i] -= pull[i];
                for j in 0..own {
                    information[(i, j)] += known[(i, j)];
                }
            }
            number_prior.add_from(own, &at, &mut information, &mut gradient);
            let step = Cholesky::new(information)?.solve(&gradient);
            at.iter_mut().zip(step.iter()).for_each(|(v, s)| *v += s);
        }
        best.is_finite().then_some(best)
    }
}

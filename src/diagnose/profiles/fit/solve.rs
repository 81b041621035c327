//! Solution of a likelihood about a state with the prior: the step, the motion priors, the floors, the evidence.

use super::super::evidence::inverse_factor;
use super::super::model::Kind;
use super::super::motion_prior::{self, Alone};
use super::super::prior::MotionPriors;
use super::linear::Linear;
use super::work::Work;
use super::{Fitted, Free};
use hydroline_numerics::cholesky::ln_determinant;
use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

/// Rounds through all motion priors in one choice.
const ROUNDS: usize = 3;

/// The point, its log evidence, and the posterior precision's factor.
pub(super) type Solved = (DVector<f64>, f64, Cholesky<f64, Dyn>);

impl Work<'_, '_> {
    /// Prior precision of everything and half the log determinant of its covariance.
    fn prior(&self, motion_priors: &MotionPriors) -> Option<(DMatrix<f64>, f64)> {
        let mut p = DMatrix::identity(self.size(), self.size());
        let mut half = 0.0;
        let mut first = 0;
        for motion in &self.problem.motions {
            for (d, motion_prior) in motion_priors.iter().enumerate() {
                let known = motion.precision(d, motion_prior)?;
                let (own, own_half) = known.as_ref();
                half += own_half;
                for i in 0..motion.frames() {
                    for j in 0..motion.frames() {
                        p[(first + 6 * i + d, first + 6 * j + d)] = own[(i, j)];
                    }
                }
            }
            first += 6 * motion.frames();
        }
        Some((p, half))
    }

    /// log posterior at `x` of the likelihood about its own point.
    pub(super) fn posterior(&self, linear: &Linear, x: &DVector<f64>) -> Option<f64> {
        let (p, half) = self.prior(&self.state.motion_priors)?;
        let q = &linear.quadratic;
        let likelihood = q.c + q.b.dot(x) - 0.5 * x.dot(&(&q.a * x));
        Some(likelihood - 0.5 * x.dot(&(p * x)) - half)
    }

    pub(super) fn solve(&self, linear: &Linear, motion_priors: &MotionPriors) -> Option<Solved> {
        let (p, half) = self.prior(motion_priors)?;
        linear.quadratic.solved(&p, half)
    }

    /// The motion priors by evidence, DOF by DOF; the solution with them.
    pub(super) fn choose(&mut self, linear: &Linear) -> Option<Solved> {
        let mut motion_priors = self.state.motion_priors;
        for _ in 0..ROUNDS {
            let before = motion_priors;
            for d in 0..motion_priors.len() {
                let driven = self.problem.motions.iter().any(|m| m.driven[d]);
                let (prior, _) = self.prior(&motion_priors)?;
                if let Some(alone) = Alone::of(&linear.quadratic, &prior, &self.problem.motions, d)
                {
                    motion_priors[d] =
                        motion_prior::chosen(motion_priors[d], driven, &|w| alone.value(w));
                }
            }
            if motion_priors == before {
                break;
            }
        }
        match self.solve(linear, &motion_priors) {
            Some(solved) => {
                self.state.motion_priors = motion_priors;
                Some(solved)
            }
            // Digits did not suffice there.
            None => self.solve(linear, &self.state.motion_priors),
        }
    }

    /// Floors: what the residuals scatter beyond the measurements' own sds, by as many of them as
    /// the fit has not used up (MacKay 1992). Returns the largest change, as a share.
    pub(super) fn spread(&mut self, linear: &Linear, l: &Cholesky<f64, Dyn>) -> f64 {
        let Some(root) = inverse_factor(l) else {
            return f64::INFINITY;
        };
        let n = root.nrows();
        let tail = 6 * self.frames();
        let end = root.columns(tail, n - tail);
        let end_block = end.tr_mul(&end);
        let mut sums = [[0.0; 4]; 3];
        let mut index = 0;
        let mut last = (usize::MAX, usize::MAX);
        let mut frame = 0;
        let mut block = DMatrix::zeros(0, 0);
        for ((left, w), row) in linear.left.iter().zip(&linear.weights).zip(&linear.rows) {
            if (left.run, left.frame) != last {
                if last.0 != usize::MAX {
                    frame += 1;
                }
                last = (left.run, left.frame);
                let own = root.columns(6 * frame, 6);
                let t = n - tail;
                block = DMatrix::zeros(6 + t, 6 + t);
                block.view_mut((0, 0), (6, 6)).copy_from(&own.tr_mul(&own));
                let cross = own.tr_mul(&end);
                block.view_mut((0, 6), (6, t)).copy_from(&cross);
                block.view_mut((6, 0), (t, 6)).copy_from(&cross.transpose());
                block.view_mut((6, 6), (t, t)).copy_from(&end_block);
            }
            if left.off_px.is_finite() && *w > 1e-6 {
                let unsure = row.dot(&(&block * row));
                let sd2 = left.sd_px.powi(2);
                let sum = &mut sums[left.kind as usize];
                sum[0] += w * left.off_px.powi(2);
                sum[1] += w * (1.0 - w * unsure / sd2);
                sum[2] += w * (sd2 - self.state.floors[left.kind as usize].powi(2));
                sum[3] += w;
            }
            index += 1;
        }
        debug_assert_eq!(index, linear.left.len());
        let mut change = 0.0f64;
        for (kind, [square, free, own2, weight]) in Kind::ALL.into_iter().zip(sums) {
            if weight > 3.0 {
                let found = square / free.max(0.02 * weight) - own2 / weight;
                let floor = &mut self.state.floors[kind as usize];
                // Slowly down: a fit that still moves looks better in one kind than it is.
                let next = found.max(0.0).sqrt().clamp(0.6 * *floor, 3.0 * *floor);
                let next = next.max(kind.floors().0);
                change = change.max((next / *floor - 1.0).abs());
                *floor = next;
            }
        }
        change
    }

    /// An effect whose numbers may be left out of a rig file is each subset of them with the same
    /// prior probability. A subset's evidence is that of all, times the posterior's density over
    /// the prior's where the others do nothing (Savage and Dickey; Verdinelli and Wasserman 1995).
    fn simpler(&self, covariance: &DMatrix<f64>) -> f64 {
        let x = self.x();
        let from = x.len() - covariance.nrows();
        let mut place = 0;
        let mut sum = 0.0;
        for c in &self.chosen {
            let first = place;
            place += c.neutral.len();
            let open: Vec<usize> = (0..c.neutral.len())
                .filter(|k| c.info.parameters[*k].absent == Some(c.neutral[*k]))
                .map(|k| first + k)
                .collect();
            let mut logs = Vec::with_capacity(1 << open.len());
            for mask in 0..1usize << open.len() {
                let out: Vec<usize> = (0..open.len())
                    .filter(|k| mask >> k & 1 == 1)
                    .map(|k| open[k])
                    .collect();
                // All of them left out is no effect.
                if out.len() == c.neutral.len() {
                    continue;
                }
                let v = DMatrix::from_fn(out.len(), out.len(), |i, j| covariance[(out[i], out[j])]);
                let m = DVector::from_iterator(out.len(), out.iter().map(|k| x[from + k]));
                // Both densities at the neutral point; the prior's is (2π)^(-n/2).
                if let Some(l) = Cholesky::new(v) {
                    logs.push(-0.5 * m.dot(&l.solve(&m)) - 0.5 * ln_determinant(&l));
                }
            }
            let top = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            if top.is_finite() {
                let all = logs.iter().map(|v| (v - top).exp()).sum::<f64>() / logs.len() as f64;
                sum += top + all.ln();
            }
        }
        sum
    }

    pub(super) fn finish(
        self,
        linear: Linear,
        log_evidence: f64,
        l: &Cholesky<f64, Dyn>,
        effects: &[usize],
    ) -> Option<Fitted> {
        let n = if self.free == Free::All {
            self.numbers()
        } else {
            0
        };
        let root = inverse_factor(l)?;
        let numbers = root.columns(root.ncols() - n, n);
        let block = numbers.tr_mul(&numbers);
        let mut place = 0;
        let sds = self
            .chosen
            .iter()
            .map(|c| {
                let own = c.prior_sd.iter().enumerate().map(|(k, s)| {
                    let at = place + k;
                    if at < n {
                        s * block[(at, at)].max(0.0).sqrt()
                    } else {
                        f64::NAN
                    }
                });
                let own: Vec<f64> = own.collect();
                place += c.prior_sd.len();
                own
            })
            .collect();
        let simpler = if n > 0 { self.simpler(&block) } else { 0.0 };
        Some(Fitted {
            effects: effects.to_vec(),
            state: self.state,
            log_evidence,
            simpler,
            sds,
            masked: block.try_inverse().unwrap_or_else(|| DMatrix::zeros(n, n)),
            left: linear.left,
            belongs: linear.belongs,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::candidate::{Base, library};
    use super::super::super::prior::{FIRST, Motion, MotionPrior};
    use super::super::Problem;
    use super::*;
    use crate::profiles::observe::{self, ImageRun};
    use hydroline_daemon::simulate::{Options, simulate};
    use hydroline_rigs::{ParameterValue, PhysicsEntry, Plan, Rig};

    /// Two runs of 26 frames, driven in surge alone while every axis is disturbed; the simulated vehicle is, the rig is not.
    fn runs_in_surge(rig: &Rig) -> Vec<ImageRun> {
        let mut tank = rig.clone();
        for (axis, period_s) in [("roll", 3.7), ("pitch", 5.1), ("yaw", 7.3)] {
            let number = ParameterValue::Number;
            let parameters = vec![
                ("axis".to_owned(), ParameterValue::Word(axis.to_owned())),
                ("amp_rad".to_owned(), number(0.003)),
                ("period_s".to_owned(), number(period_s)),
                ("phase_rad".to_owned(), number(period_s - 5.0)),
            ];
            tank.physics.push(PhysicsEntry {
                effect: "attitude_disturbance".to_owned(),
                parameters,
            });
        }
        let folder = tempfile::tempdir().unwrap();
        let mut run = |(seed, name): (u64, &str)| {
            let plan = Plan::load_or_builtin(name).unwrap();
            tank.camera.rate_fps = 26.5 / plan.duration_s();
            let path = folder.path().join(format!("{name}.mcap"));
            let options = Options {
                seed: Some(seed),
                ..Options::default()
            };
            simulate(&tank, &plan, &path, &options, &mut |_, _| {}).unwrap();
            observe::read(&path, rig, 26).unwrap()
        };
        [(1, "reversals"), (2, "two-tone")]
            .into_iter()
            .map(&mut run)
            .collect()
    }

    /// Two runs, driven in surge alone: with the rest integrated out each DOF's motion prior is worth what it is worth
    /// in the whole problem.
    #[test]
    fn one_dof_alone_is_worth_what_it_is_in_the_whole() {
        let rig = Rig::builtin("lshpi").unwrap();
        let runs = runs_in_surge(&rig);
        let base = Base::new(&rig).unwrap();
        let candidates = library(&base);
        let motions = runs.iter().map(|r| Motion::new(r, &rig).unwrap()).collect();
        let problem = Problem::new(&rig, base, &runs, motions);
        let chosen = vec![&candidates[3]];
        let numbers = vec![candidates[3].neutral.clone()];
        let state = problem.placed(&chosen, numbers, false).unwrap();
        let work = Work {
            problem: &problem,
            chosen,
            free: Free::All,
            state,
        };
        let linear = work.linear().unwrap();
        for dof in [0, 2, 4] {
            assert_eq!(problem.motions[0].driven[dof], dof == 0);
            let value = |sd: f64, tau_s: f64| {
                let mut motion_priors = FIRST;
                let motion_prior = MotionPrior {
                    sd,
                    tau_s,
                    drive: 3e-8,
                };
                motion_priors[dof] = motion_prior;
                let (prior, _) = work.prior(&FIRST).unwrap();
                let motions = &problem.motions;
                let alone = Alone::of(&linear.quadratic, &prior, motions, dof).unwrap();
                let whole = work.solve(&linear, &motion_priors).unwrap().1;
                (alone.value(&motion_prior).unwrap(), whole)
            };
            let (a, b) = (value(1e-3, 0.7), value(2e-2, 5.0));
            let (alone, whole) = (a.0 - b.0, a.1 - b.1);
            assert!(whole.abs() > 1.0, "{dof}: nothing is asked");
            assert!(
                (alone - whole).abs() < 1e-3 * whole.abs().max(1.0),
                "{dof}: {alone} {whole}"
            );
        }
    }
}

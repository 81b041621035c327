//! Covariance matrix adaptation (Hansen, The CMA Evolution Strategy: A Tutorial, 2016), with restarts.
//!
//! Own code: the one crate for it (`cmaes` 0.2) stands on older nalgebra and rand and would bring both twice.

use nalgebra::{DMatrix, DVector, SymmetricEigen};
use rand::{SeedableRng, rngs::StdRng};
use rand_distr::{Distribution, StandardNormal};

use super::forward::ForwardError;
use super::method::{Method, MethodError, Solution};
use super::problem::{Objective, Problem};

/// Settings of the search.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cmaes {
    /// Runs with doubled population after each; the best counts.
    pub restarts: usize,
    /// Generations per run.
    pub iterations: usize,
}

impl Default for Cmaes {
    fn default() -> Self {
        Self {
            restarts: 2,
            iterations: 1500,
        }
    }
}

/// First step as a share of the range.
const SIGMA: f64 = 0.25;

impl Method for Cmaes {
    fn name(&self) -> &'static str {
        "cmaes"
    }

    fn minimise(
        &self,
        problem: &Problem<'_>,
        objective: Objective,
        seed: u64,
    ) -> Result<Solution, MethodError> {
        let n = problem.free().len();
        if n == 0 {
            return Err(MethodError::NothingFree);
        }
        let mut best = (f64::INFINITY, Vec::new());
        let (mut evaluations, mut converged) = (0, false);
        for restart in 0..self.restarts.max(1) {
            let lambda = (4 + (3.0 * (n as f64).ln()).floor() as usize) << restart;
            let mut rng =
                StdRng::seed_from_u64(seed.wrapping_mul(1000).wrapping_add(restart as u64));
            let (value, at, used, done) = self.once(problem, objective, lambda, &mut rng);
            evaluations += used;
            converged |= done;
            if value < best.0 {
                best = (value, at);
            }
        }
        if !best.0.is_finite() {
            return Err(MethodError::NoStart(ForwardError {
                run: 0,
                reason: "every candidate diverges".into(),
            }));
        }
        Ok(Solution {
            parameters: best.1,
            objective: best.0,
            evaluations,
            converged,
            tries: self.restarts.max(1),
        })
    }
}

impl Cmaes {
    /// (objective, parameters, evaluations, converged); coordinates are shares of the range.
    fn once(
        &self,
        problem: &Problem<'_>,
        objective: Objective,
        lambda: usize,
        rng: &mut StdRng,
    ) -> (f64, Vec<f64>, usize, bool) {
        let free = problem.free();
        let n = free.len();
        let nf = n as f64;
        let mu = lambda / 2;
        let raw: Vec<f64> = (0..mu)
            .map(|i| (mu as f64 + 0.5).ln() - (i as f64 + 1.0).ln())
            .collect();
        let sum: f64 = raw.iter().sum();
        let weights: Vec<f64> = raw.iter().map(|w| w / sum).collect();
        let mu_eff = 1.0 / weights.iter().map(|w| w * w).sum::<f64>();
        let cc = (4.0 + mu_eff / nf) / (nf + 4.0 + 2.0 * mu_eff / nf);
        let cs = (mu_eff + 2.0) / (nf + mu_eff + 5.0);
        let c1 = 2.0 / ((nf + 1.3).powi(2) + mu_eff);
        let cmu =
            (1.0 - c1).min(2.0 * (mu_eff - 2.0 + 1.0 / mu_eff) / ((nf + 2.0).powi(2) + mu_eff));
        let damps = 1.0 + 2.0 * (((mu_eff - 1.0) / (nf + 1.0)).sqrt() - 1.0).max(0.0) + cs;
        let chi = nf.sqrt() * (1.0 - 1.0 / (4.0 * nf) + 1.0 / (21.0 * nf * nf));

        // A pinned number has no range: its share is any.
        let share = |f: &super::forward::Free| {
            let range = f.high - f.low;
            if range > 0.0 {
                ((f.start - f.low) / range).clamp(0.0, 1.0)
            } else {
                0.5
            }
        };
        let mut mean = DVector::from_iterator(n, free.iter().map(share));
        let mut sigma = SIGMA;
        let mut c = DMatrix::<f64>::identity(n, n);
        let (mut ps, mut pc) = (DVector::<f64>::zeros(n), DVector::<f64>::zeros(n));
        let real = |x: &DVector<f64>| -> Vec<f64> {
            x.iter()
                .zip(free)
                .map(|(s, f)| (f.low + s.clamp(0.0, 1.0) * (f.high - f.low)).clamp(f.low, f.high))
                .collect()
        };
        // Outside the range: the value on the bound plus the squared distance (Hansen, section B.5).
        let outside = |x: &DVector<f64>| {
            x.iter()
                .map(|s| (s - s.clamp(0.0, 1.0)).powi(2))
                .sum::<f64>()
        };
        let mut best = (f64::INFINITY, real(&mean));
        let mut evaluations = 0;
        for generation in 0..self.iterations {
            let eigen = SymmetricEigen::new(c.clone());
            let lengths = eigen.eigenvalues.map(|v| v.max(1e-300).sqrt());
            let spread = &eigen.eigenvectors * DMatrix::from_diagonal(&lengths);
            let inverse_root = &eigen.eigenvectors
                * DMatrix::from_diagonal(&lengths.map(|l| 1.0 / l))
                * eigen.eigenvectors.transpose();
            let mut people: Vec<(f64, DVector<f64>)> = (0..lambda)
                .map(|_| {
                    let z = DVector::from_fn(n, |_, _| StandardNormal.sample(rng));
                    let y = &spread * z;
                    let x = &mean + &y * sigma;
                    let at = real(&x);
                    let value = problem.objective(objective, &at);
                    evaluations += 1;
                    if value < best.0 {
                        best = (value, at);
                    }
                    (value * (1.0 + outside(&x)), y)
                })
                .collect();
            people.sort_by(|a, b| a.0.total_cmp(&b.0));
            let step = people
                .iter()
                .zip(&weights)
                .fold(DVector::zeros(n), |s: DVector<f64>, (p, w)| s + &p.1 * *w);
            mean += &step * sigma;
            ps = ps * (1.0 - cs) + (&inverse_root * &step) * (cs * (2.0 - cs) * mu_eff).sqrt();
            let long =
                ps.norm() / (1.0 - (1.0 - cs).powi(2 * (generation as i32 + 1))).sqrt() / chi;
            let h = if long < 1.4 + 2.0 / (nf + 1.0) {
                1.0
            } else {
                0.0
            };
            pc = pc * (1.0 - cc) + &step * (h * (cc * (2.0 - cc) * mu_eff).sqrt());
            let rank_mu = people
                .iter()
                .zip(&weights)
                .fold(DMatrix::zeros(n, n), |s: DMatrix<f64>, (p, w)| {
                    s + (&p.1 * p.1.transpose()) * *w
                });
            c = &c * (1.0 - c1 - cmu + (1.0 - h) * c1 * cc * (2.0 - cc))
                + (&pc * pc.transpose()) * c1
                + rank_mu * cmu;
            c = (&c + c.transpose()) * 0.5;
            sigma *= ((cs / damps) * (ps.norm() / chi - 1.0)).exp();
            if sigma * lengths.max() < 1e-11 {
                return (best.0, best.1, evaluations, true);
            }
            if !sigma.is_finite() || sigma > 1e3 {
                break;
            }
        }
        (best.0, best.1, evaluations, false)
    }
}

//! The paper's genetic algorithm (section 2.3, Table 8): real-coded, tournament of two,
//! blend crossover, Gaussian mutation that narrows, the best one kept; best of ten runs.
//!
//! The paper gives sizes and probabilities only; the operators are the plain textbook ones
//! (Eshelman and Schaffer 1993 for the blend, Michalewicz 1996 for the narrowing mutation).

use rand::{RngExt, SeedableRng, rngs::StdRng};
use rand_distr::{Distribution, StandardNormal};

use super::forward::ForwardError;
use super::method::{Method, MethodError, Solution};
use super::problem::{Objective, Problem};

/// Settings; the default is Table 8.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Genetic {
    /// Candidates per generation.
    pub population: usize,
    /// Generations per run.
    pub iterations: usize,
    /// Probability that a pair is crossed.
    pub crossover: f64,
    /// Probability that a gene mutates.
    pub mutation: f64,
    /// Independent runs, of which the best counts.
    pub repeats: usize,
}

impl Default for Genetic {
    fn default() -> Self {
        Self {
            population: 500,
            iterations: 2000,
            crossover: 0.8,
            mutation: 0.15,
            repeats: 10,
        }
    }
}

/// Overlap of the blend beyond the parents.
const BLEND: f64 = 0.3;

impl Genetic {
    fn once(
        &self,
        problem: &Problem<'_>,
        objective: Objective,
        seed: u64,
    ) -> (Vec<f64>, f64, usize) {
        let mut rng = StdRng::seed_from_u64(seed);
        let free = problem.free();
        let draw = |rng: &mut StdRng| -> Vec<f64> {
            free.iter()
                .map(|f| f.low + (f.high - f.low) * rng.random::<f64>())
                .collect()
        };
        let mut evaluations = 0;
        let mut score = |genes: &[f64]| {
            evaluations += 1;
            problem.objective(objective, genes)
        };
        let mut people: Vec<(f64, Vec<f64>)> = (0..self.population)
            .map(|_| {
                let genes = draw(&mut rng);
                (score(&genes), genes)
            })
            .collect();
        for generation in 0..self.iterations {
            let done = generation as f64 / self.iterations.max(1) as f64;
            // From a tenth of the range down to 1e-7 of it.
            let width = 0.1 * 10f64.powf(-6.0 * done);
            let mut next: Vec<(f64, Vec<f64>)> = Vec::with_capacity(self.population);
            next.extend(people.iter().min_by(|a, b| a.0.total_cmp(&b.0)).cloned());
            while next.len() < self.population {
                let mut pick = || {
                    let (a, b) = (
                        rng.random_range(0..people.len()),
                        rng.random_range(0..people.len()),
                    );
                    if people[a].0 <= people[b].0 { a } else { b }
                };
                let (mother, father) = (pick(), pick());
                let (mut one, mut two) = (people[mother].1.clone(), people[father].1.clone());
                let crossed = rng.random::<f64>() < self.crossover;
                if crossed {
                    for (a, b) in one.iter_mut().zip(&mut two) {
                        let share = -BLEND + (1.0 + 2.0 * BLEND) * rng.random::<f64>();
                        (*a, *b) = (*a + share * (*b - *a), *b + share * (*a - *b));
                    }
                }
                for (mut child, parent) in [(one, mother), (two, father)] {
                    let mut changed = crossed;
                    for (gene, f) in child.iter_mut().zip(free) {
                        if rng.random::<f64>() < self.mutation {
                            let kick: f64 = StandardNormal.sample(&mut rng);
                            *gene += kick * width * (f.high - f.low);
                            changed = true;
                        }
                        *gene = gene.clamp(f.low, f.high);
                    }
                    if next.len() < self.population {
                        let value = if changed {
                            score(&child)
                        } else {
                            people[parent].0
                        };
                        next.push((value, child));
                    }
                }
            }
            people = next;
        }
        let (value, genes) = people
            .into_iter()
            .min_by(|a, b| a.0.total_cmp(&b.0))
            .unwrap_or((f64::INFINITY, Vec::new()));
        (genes, value, evaluations)
    }
}

impl Method for Genetic {
    fn name(&self) -> &'static str {
        "ga"
    }

    fn minimise(
        &self,
        problem: &Problem<'_>,
        objective: Objective,
        seed: u64,
    ) -> Result<Solution, MethodError> {
        if problem.free().is_empty() || self.population == 0 {
            return Err(MethodError::NothingFree);
        }
        let mut best: Option<(Vec<f64>, f64)> = None;
        let mut evaluations = 0;
        for repeat in 0..self.repeats.max(1) {
            let (genes, value, used) = self.once(
                problem,
                objective,
                seed.wrapping_mul(1000).wrapping_add(repeat as u64),
            );
            evaluations += used;
            if best.as_ref().is_none_or(|b| value < b.1) {
                best = Some((genes, value));
            }
        }
        match best {
            Some((parameters, value)) if value.is_finite() => Ok(Solution {
                parameters,
                objective: value,
                evaluations,
                converged: true,
                tries: self.repeats.max(1),
            }),
            _ => Err(MethodError::NoStart(ForwardError {
                run: 0,
                reason: "every candidate diverges".into(),
            })),
        }
    }
}

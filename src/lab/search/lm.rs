//! Levenberg-Marquardt with exact sensitivities, bounds and several starts; L1 by reweighting.
//!
//! The loop is that of `hydroline-numerics`; here are its bounds, its starts and how far it goes.

use hydroline_numerics::least_squares::{
    Damping, LeastSquares, Normal, Options, minimise as minimise_squares,
};
use nalgebra::{DVector, Dyn};
use rand::{RngExt, SeedableRng, rngs::StdRng};

use super::forward::{ForwardError, Free};
use super::least_absolute::least_absolute;
use super::method::{Method, MethodError, Solution};
use super::problem::{Objective, Problem};

/// Levenberg–Marquardt from several starts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LevenbergMarquardt {
    /// Starting points: the rig's numbers first, then random ones within the bounds.
    pub starts: usize,
}

impl Default for LevenbergMarquardt {
    fn default() -> Self {
        Self { starts: 6 }
    }
}

/// Options of a search that goes to the last digits of its minimum.
///
/// Starts are the rig's numbers, so the first step is nearly undamped (1e-4); sensitivities are exact and cost some
/// ten motions, so a rejected step (one motion) is cheap and damping rises by 8. Damping is always at least 1e-14 of
/// the scaled diagonal: the jitter on top only has to beat rounding.
const SEARCH: Options = Options {
    damping: Some(Damping {
        start: 1e-4,
        rejected: 8.0,
        least: 1e-14,
        ..Damping::DEFAULT
    }),
    iterations_max: 80,
    jitter: 1e-15,
    ..Options::DEFAULT
};
/// A step that moves no parameter by more than this share of it (and of 1e-6 in its unit) is none.
const MOVED: f64 = 1e-10;

impl Method for LevenbergMarquardt {
    fn name(&self) -> &'static str {
        "lm"
    }

    fn minimise(
        &self,
        problem: &Problem<'_>,
        objective: Objective,
        seed: u64,
    ) -> Result<Solution, MethodError> {
        if problem.free().is_empty() {
            return Err(MethodError::NothingFree);
        }
        let mut rng = StdRng::seed_from_u64(seed);
        let mut best: Option<Solution> = None;
        let mut failure = None;
        let mut evaluations = 0;
        let tries = self.starts.max(1);
        for attempt in 0..tries {
            let mut start = problem.start();
            if attempt > 0 {
                for (value, free) in start
                    .iter_mut()
                    .zip(problem.free())
                    .take(problem.forward().globals().len())
                {
                    // Halfway into the range: its far corners are no hulls.
                    let span = 0.5 * (free.high - free.low);
                    let centre = free.start.clamp(
                        free.low + 0.5 * span,
                        (free.high - 0.5 * span).max(free.low + 0.5 * span),
                    );
                    *value =
                        (centre + span * (rng.random::<f64>() - 0.5)).clamp(free.low, free.high);
                }
            }
            // L1 too: the starts are distinguished by least squares, only the best one is reweighted.
            match from(problem, Objective::LeastSquares, start) {
                Ok(found) => {
                    evaluations += found.evaluations;
                    if best.as_ref().is_none_or(|b| found.objective < b.objective) {
                        best = Some(found);
                    }
                }
                Err(error) => failure = Some(error),
            }
        }
        match (best, failure) {
            (Some(best), _) if objective == Objective::SumOfAbsolute => {
                let before = best.evaluations;
                let found = least_absolute(problem, best).map_err(MethodError::NoStart)?;
                Ok(Solution {
                    evaluations: evaluations + found.evaluations - before,
                    tries,
                    ..found
                })
            }
            (Some(best), _) => Ok(Solution {
                evaluations,
                tries,
                ..best
            }),
            (None, Some(error)) => Err(MethodError::NoStart(error)),
            (None, None) => Err(MethodError::NothingFree),
        }
    }
}

/// One search from one point.
///
/// # Errors
/// [`ForwardError`] when the motion diverges already at the start.
pub fn from(
    problem: &Problem<'_>,
    objective: Objective,
    start: Vec<f64>,
) -> Result<Solution, ForwardError> {
    let squares = least_squares(problem, start)?;
    match objective {
        Objective::LeastSquares => Ok(squares),
        Objective::SumOfAbsolute => least_absolute(problem, squares),
    }
}

/// Least squares to the last digits of the minimum.
fn least_squares(problem: &Problem<'_>, mut at: Vec<f64>) -> Result<Solution, ForwardError> {
    for (value, free) in at.iter_mut().zip(problem.free()) {
        *value = value.clamp(free.low, free.high);
    }
    let found = minimise_squares(&mut Bounded(problem), at, &SEARCH)?;
    Ok(Solution {
        parameters: found.at,
        objective: found.normal.cost,
        // Each accepted step was linearised too, and so was the start.
        evaluations: 1 + found.trials + found.iterations,
        converged: found.ended.converged(),
        tries: 1,
    })
}

/// A sum of squares within its bounds.
struct Bounded<'a, 'f>(&'a Problem<'f>);

impl LeastSquares<Dyn> for Bounded<'_, '_> {
    type Point = Vec<f64>;
    type Evaluated = ();
    type Error = ForwardError;

    fn cost(&mut self, at: &Vec<f64>, (): &mut ()) -> Option<f64> {
        Some(self.0.objective(Objective::LeastSquares, at))
    }

    fn begin(&mut self, _: &Vec<f64>, (): &mut ()) -> Result<(), ForwardError> {
        Ok(())
    }

    fn linearise(&mut self, at: &Vec<f64>, (): &()) -> Result<Normal<Dyn>, ForwardError> {
        self.0.normal(at)
    }

    fn moved(&self, at: &Vec<f64>, step: &DVector<f64>) -> Option<Vec<f64>> {
        let clamped = |((value, step), free): ((&f64, &f64), &Free)| {
            (value + step).clamp(free.low, free.high)
        };
        Some(
            at.iter()
                .zip(step)
                .zip(self.0.free())
                .map(clamped)
                .collect(),
        )
    }

    fn moves(&self, at: &Vec<f64>, gradient: &DVector<f64>, k: usize) -> bool {
        // A parameter on its bound that wants out stays for this step.
        let free = &self.0.free()[k];
        let down_and_out = at[k] <= free.low && gradient[k] > 0.0;
        let up_and_out = at[k] >= free.high && gradient[k] < 0.0;
        !(down_and_out || up_and_out)
    }

    fn negligible(&self, from: &Vec<f64>, to: &Vec<f64>, _: &DVector<f64>) -> bool {
        let mut pairs = to.iter().zip(from);
        !pairs.any(|(a, b)| (a - b).abs() > MOVED * (a.abs() + 1e-6))
    }
}

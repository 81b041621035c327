//! The vehicle alone at its likeliest mode.

use hydroline_core::run::PerChannel;
use hydroline_identify::parameter::Coefficient;
use hydroline_inference::body::{Body, Own};
use hydroline_inference::fit::{Effort, Fit, Problem};
use hydroline_inference::limit::Watch;
use hydroline_inference::search::{Options as SearchOptions, vehicle_alone};
use hydroline_numerics::noise::Noise;
use hydroline_rigs::Rig;

use super::numbers::Numbers;
use super::options::EstimateError;

/// sd over the rig's size above which a coefficient is held where no prior says anything of it.
const HOLD_ABOVE: f64 = 2.0;
/// The mode to a few hundredths of an sd.
const FINE: Effort = Effort {
    steps: 40,
    decrement: 1e-3,
    ..Effort::DEFAULT
};

/// A fit of a body's free coefficients.
pub(crate) struct Fitted {
    /// With every coefficient that was asked for free, also those that are held.
    pub problem: Problem,
    /// At the mode; held coefficients at the rig's values.
    pub fit: Fit,
    /// Coefficients at the rig's values, for the runs say nothing of them and neither does a prior.
    pub held: Vec<Coefficient>,
    /// Fits made.
    pub fits: usize,
}

/// Fits a body; `dof` = its name in errors.
///
/// # Errors
/// [`EstimateError`]: nothing to fit to, or no finite motion.
pub(crate) fn fitted(
    body: Body,
    at_rest: PerChannel<Option<Noise>>,
    (rig, dof): (&Rig, &str),
    progress: &(dyn Fn(&str) + Sync),
) -> Result<Fitted, EstimateError> {
    if body.own.iter().all(|o| o.coefficient().is_none()) {
        return Err(EstimateError::NothingFree(dof.to_owned()));
    }
    progress("noise");
    let problem = Problem::of(body, at_rest);
    let samples = problem.samples();
    let samples: f64 = samples.iter().filter(|n| n.is_finite()).sum();
    let free = problem.body.own.len() + problem.body.starts.iter().map(Vec::len).sum::<usize>();
    if samples < 2.0 * free as f64 {
        return Err(EstimateError::TooFew {
            samples: samples as usize,
            free,
            dof: dof.to_owned(),
        });
    }
    progress("coefficients");
    let no_fit = || EstimateError::NoFit(dof.to_owned());
    let watch = Watch::unlimited(progress);
    let found = vehicle_alone(problem, SearchOptions::default(), watch).ok_or_else(no_fit)?;
    let (problem, mut fits) = (found.problem, found.fits + 1);
    let begun = found.models.get(&Vec::new()).ok_or_else(no_fit)?;
    let fit = problem.fit(&[], &begun.point, begun.cells.clone(), FINE);
    let fit = fit.unwrap_or_else(|| begun.clone());
    let mut made = Fitted {
        problem,
        fit,
        held: Vec::new(),
        fits: 0,
    };
    if made.problem.body.prior.is_flat() {
        fits += made.hold_undetermined(rig)?;
    }
    made.fits = fits;
    Ok(made)
}

impl Fitted {
    /// Holds at the rig's value, one after the other, the coefficient that is known worst for its size, while its sd is
    /// above [`HOLD_ABOVE`] of that size. Each one held may determine others: where only a common factor of mass and
    /// damping is open, holding one of them is enough. Returns the fits made.
    fn hold_undetermined(&mut self, rig: &Rig) -> Result<usize, EstimateError> {
        let mut fits = 0;
        loop {
            let numbers = Numbers::at_mode(self, rig).ok_or_else(|| self.diverged())?;
            let mut worst: Option<(usize, f64)> = None;
            for (i, own) in self.problem.body.own.iter().enumerate() {
                let Some(c) = own.coefficient().filter(|c| !self.held.contains(c)) else {
                    continue;
                };
                let sd = numbers.beside_held[(i, i)].sqrt();
                let relative = if sd.is_finite() {
                    sd / c.size(rig)
                } else {
                    f64::INFINITY
                };
                // Of equals the first: the mass rather than the damping.
                if relative > HOLD_ABOVE && worst.is_none_or(|(_, w)| relative > 1.01 * w) {
                    worst = Some((i, relative));
                }
            }
            let Some((i, _)) = worst else {
                return Ok(fits);
            };
            self.held.extend(self.problem.body.own[i].coefficient());
            self.refit()?;
            fits += 1;
        }
    }

    fn diverged(&self) -> EstimateError {
        EstimateError::NoFit(format!("{} run(s)", self.problem.body.recording.runs.len()))
    }

    /// Whether one of the vehicle's numbers is held.
    pub fn is_held(&self, own: &Own) -> bool {
        own.coefficient().is_some_and(|c| self.held.contains(&c))
    }

    /// Fits what is not held beside what is.
    fn refit(&mut self) -> Result<(), EstimateError> {
        let own = self.problem.body.own.clone();
        let is_held: Vec<bool> = own.iter().map(|o| self.is_held(o)).collect();
        let mut part = self.problem.clone();
        part.body.own.retain(|o| !self.is_held(o));
        let place = |i: usize| i < own.len() && is_held[i];
        let from: Vec<f64> = (0..self.fit.point.len())
            .filter(|i| !place(*i))
            .map(|i| self.fit.point[i])
            .collect();
        let cells = self.fit.cells.clone();
        // Values fitted beside the old one may not even stay finite beside the new one.
        let begin = part.body.begin();
        let made = [from, begin]
            .iter()
            .find_map(|from| part.fit(&[], from, cells.clone(), FINE))
            .ok_or_else(|| self.diverged())?;
        let mut free = made.point.iter();
        let point = (0..self.fit.point.len()).map(|i| match place(i) {
            true => 0.0,
            false => free.next().copied().unwrap_or(0.0),
        });
        self.fit = Fit {
            point: point.collect(),
            ..made
        };
        Ok(())
    }
}

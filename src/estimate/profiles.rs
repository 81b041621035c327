//! 95 % intervals by profile: all other numbers fitted anew at each trial value of one coefficient.

use hydroline_identify::Profile;
use hydroline_inference::fit::{Effort, Problem};

use super::fitted::Fitted;
use super::numbers::Numbers;

/// Fits that the profiles of one result may take together, of a model of one DOF; of several as much time.
const FITS: usize = 160;
/// Share of the quantile that an end may be off: the interval's end is known to 1 %.
const END: f64 = 0.01;
/// Trials towards one end at most.
const TRIALS: usize = 12;
/// Fits under the random forces of the mode, as fine as an end is to be.
const ALONG: Effort = Effort {
    steps: 15,
    rounds: 1,
    decrement: 2e-3,
    as_given: true,
    forces_held: true,
};

/// Coefficient whose profile is followed.
#[derive(Clone, Copy)]
struct Ridge<'a> {
    fitted: &'a Fitted,
    numbers: &'a Numbers,
    /// Its place among the vehicle's numbers.
    index: usize,
    /// How all numbers move with it: its column of the covariance.
    column: &'a [f64],
}

impl Ridge<'_> {
    /// The problem with the coefficient at a value; `None` where that is none that the model can have.
    fn beside(&self, value: f64) -> Option<(Problem, f64)> {
        let mut part = self.fitted.problem.clone();
        let density = part.body.densities(&[])[self.index];
        let own = part.body.own.remove(self.index);
        part.body.own.retain(|o| !self.fitted.is_held(o));
        let ln_prior = density.ln(own.scaled(value)?);
        own.coefficient()?.put(&mut part.body.vehicle, value);
        Some((part, ln_prior))
    }

    /// Minus log posterior where the coefficient has a value, and the other scaled numbers there.
    fn cost(&self, value: f64, from: &[f64]) -> Option<(f64, Vec<f64>)> {
        let (part, ln_prior) = self.beside(value)?;
        let cells = self.fitted.fit.cells.clone();
        let fit = part.fit(&[], from, cells, ALONG)?;
        Some((fit.cost - ln_prior, fit.point))
    }

    /// Other scaled numbers as the linear approximation sees them at a value.
    fn linear(&self, value: f64) -> Vec<f64> {
        let by = value - self.numbers.values[self.index];
        let of = |i: usize| {
            let slope = self.column[i] / self.column[self.index];
            self.fitted.fit.point[i] + by * slope / self.numbers.slopes[i]
        };
        let own = &self.fitted.problem.body.own;
        let is_free =
            |i: &usize| *i != self.index && own.get(*i).is_none_or(|o| !self.fitted.is_held(o));
        (0..self.column.len()).filter(is_free).map(of).collect()
    }

    /// One end, whether it is that of the search range, and the fits it took.
    fn end(&self, sign: f64, (sd, wanted): (f64, f64), least: f64) -> (f64, bool, usize) {
        let at = self.numbers.values[self.index];
        let body = &self.fitted.problem.body;
        let (low, high) = body.bounds(&[])[self.index];
        let own = &body.own[self.index];
        let limits = [own.natural(low).0, own.natural(high).0];
        let limit = match sign > 0.0 {
            true => limits[0].max(limits[1]),
            false => limits[0].min(limits[1]),
        };
        let room = (limit - at).abs();
        let (mut inner, mut inner_z) = (0.0, 0.0);
        let mut trial = (wanted * sd).min(room);
        for k in 0..TRIALS {
            let value = at + sign * trial;
            let Some((cost, _)) = self.cost(value, &self.linear(value)) else {
                return (at + sign * trial, false, k + 1);
            };
            let z = (2.0 * (cost - least).max(0.0)).sqrt();
            if (z - wanted).abs() < END * wanted {
                // Nearly linear from here: the rest of the way is a line.
                return (at + sign * (trial * wanted / z).min(room), false, k + 1);
            }
            if z < wanted {
                if trial >= room {
                    return (limit, true, k + 1);
                }
                (inner, inner_z) = (trial, z);
                let ratio = if z > 0.0 {
                    (wanted / z).clamp(1.01, 3.0)
                } else {
                    3.0
                };
                trial = (trial * ratio).min(room);
            } else {
                // z grows nearly linearly between the last point inside and this one.
                let share = ((wanted - inner_z) / (z - inner_z)).clamp(0.1, 0.99);
                trial = inner + (trial - inner) * share;
            }
        }
        (at + sign * trial, false, TRIALS)
    }
}

/// Profiles of the coefficients at these places, in this order; `None` for those that are left when the fits are spent.
/// `quantile` = that of 95 %. Returns the fits made too.
pub(crate) fn profiles(
    fitted: &Fitted,
    numbers: &Numbers,
    weak: &[usize],
    quantile: f64,
) -> (Vec<Option<Profile>>, usize) {
    let passes = fitted.problem.body.passes_of(&[]) * fitted.problem.body.dofs.len().pow(2);
    let budget = FITS / passes.max(1);
    let mut spent = 0;
    let each = weak.iter().map(|&index| {
        if spent >= budget {
            return None;
        }
        let covariance = &numbers.at_mode;
        let column: Vec<f64> = covariance.column(index).iter().copied().collect();
        let ridge = Ridge {
            fitted,
            numbers,
            index,
            column: &column,
        };
        let at = numbers.values[index];
        let (least, _) = ridge.cost(at, &ridge.linear(at))?;
        let sd = covariance[(index, index)].sqrt();
        let (low, low_open, first) = ridge.end(-1.0, (sd, quantile), least);
        let (high, high_open, second) = ridge.end(1.0, (sd, quantile), least);
        spent += 1 + first + second;
        Some(Profile {
            low,
            high,
            low_open,
            high_open,
        })
    });
    let made: Vec<Option<Profile>> = each.collect();
    (made, spent)
}

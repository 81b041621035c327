//! A form as a curve through a table's points: its numbers by least squares, its evidence by Laplace.

use std::convert::Infallible;

use hydroline_numerics::least_squares::{LeastSquares, Normal, Options, minimise};
use hydroline_sim::Dual;
use hydroline_sim::effect::form::{NUMBERS, piece};
use hydroline_sim::effect::written_force::PIECES;
use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

use super::grammar::Piece;
use super::rank::COUNT;
use hydroline_numerics::cholesky::ln_determinant;

/// Steps of a refinement; gain of a step in log density that is the last worth making.
const STEPS: usize = 40;
const LITTLE: f64 = 1e-4;

/// Likelihood of a table's points f: ln p = -f A f / 2 + f h.
#[derive(Debug, Clone)]
pub struct Likelihood {
    /// A: information of the points.
    pub information: DMatrix<f64>,
    /// h: slope of the log likelihood at f = 0.
    pub slope: DVector<f64>,
}

impl Likelihood {
    fn ln(&self, f: &DVector<f64>) -> f64 {
        f.dot(&self.slope) - 0.5 * f.dot(&(&self.information * f))
    }
}

/// A form at work on the points.
struct Curve<'a> {
    pieces: [&'a Piece; PIECES],
    likelihood: &'a Likelihood,
    knots: &'a [f64],
    of_a_rate: bool,
    /// Numbers that are searched.
    free: Vec<usize>,
}

impl Curve<'_> {
    fn scale(&self, number: usize) -> &crate::prior::Scale {
        &self.pieces[number / NUMBERS].scales[number % NUMBERS]
    }

    fn forces(&self, scaled: &[f64; COUNT]) -> (DVector<f64>, DMatrix<f64>) {
        let natural: [(f64, f64); COUNT] =
            std::array::from_fn(|i| self.scale(i).natural(scaled[i]));
        let mut f = DVector::zeros(self.knots.len());
        let mut j = DMatrix::zeros(self.knots.len(), self.free.len());
        let duals: [Dual<COUNT>; COUNT] = std::array::from_fn(|i| Dual::variable(natural[i].0, i));
        for (k, c) in self.knots.iter().enumerate() {
            for (p, at) in self.pieces.iter().zip((0..).step_by(NUMBERS)) {
                let numbers = [duals[at], duals[at + 1], duals[at + 2]];
                let made = piece(p.form, numbers, Dual::constant(*c), self.of_a_rate);
                f[k] += made.value;
                for (column, i) in self.free.iter().enumerate() {
                    j[(k, column)] += made.slope[*i] * natural[*i].1;
                }
            }
        }
        (f, j)
    }
}

impl LeastSquares<Dyn> for Curve<'_> {
    type Point = [f64; COUNT];
    type Evaluated = ();
    type Error = Infallible;

    fn cost(&mut self, at: &[f64; COUNT], (): &mut ()) -> Option<f64> {
        let natural: [f64; COUNT] = std::array::from_fn(|i| self.scale(i).natural(at[i]).0);
        let f = DVector::from_fn(self.knots.len(), |k, _| {
            let each = self.pieces.iter().zip((0..).step_by(NUMBERS));
            each.map(|(p, i)| {
                let numbers = [natural[i], natural[i + 1], natural[i + 2]];
                piece(p.form, numbers, self.knots[k], self.of_a_rate)
            })
            .sum::<f64>()
        });
        let prior: f64 = self
            .free
            .iter()
            .map(|i| self.scale(*i).density.ln(at[*i]))
            .sum();
        let cost = -self.likelihood.ln(&f) - prior;
        cost.is_finite().then_some(cost)
    }

    fn begin(&mut self, _at: &[f64; COUNT], (): &mut ()) -> Result<(), Infallible> {
        Ok(())
    }

    fn linearise(&mut self, at: &[f64; COUNT], (): &()) -> Result<Normal<Dyn>, Infallible> {
        let (f, j) = self.forces(at);
        let pull = &self.likelihood.information * &f - &self.likelihood.slope;
        let mut gradient = j.tr_mul(&pull);
        let mut hessian = j.tr_mul(&(&self.likelihood.information * &j));
        for (k, i) in self.free.iter().enumerate() {
            let (slope, curvature) = self.scale(*i).density.step(at[*i]);
            gradient[k] -= slope;
            hessian[(k, k)] += curvature;
        }
        Ok(Normal {
            cost: self.cost(at, &mut ()).unwrap_or(f64::INFINITY),
            gradient,
            hessian,
        })
    }

    fn moved(&self, at: &[f64; COUNT], step: &DVector<f64>) -> Option<[f64; COUNT]> {
        let mut next = *at;
        for (k, i) in self.free.iter().enumerate() {
            let (low, high) = self.scale(*i).bounds();
            next[*i] = (at[*i] + step[k]).clamp(low, high);
        }
        Some(next)
    }
}

/// The mode of a form from a start, and its log evidence.
pub fn refined(
    pieces: [&Piece; PIECES],
    start: &[f64; COUNT],
    likelihood: &Likelihood,
    knots: &[f64],
    of_a_rate: bool,
) -> Option<([f64; COUNT], f64)> {
    let free = |i: &usize| pieces[i / NUMBERS].is_free(i % NUMBERS);
    let mut curve = Curve {
        pieces,
        likelihood,
        knots,
        of_a_rate,
        free: (0..COUNT).filter(free).collect(),
    };
    let from: [f64; COUNT] = std::array::from_fn(|i| {
        let scale = curve.scale(i);
        let (low, high) = scale.bounds();
        scale.scaled(start[i]).clamp(low, high)
    });
    let options = Options {
        iterations_max: STEPS,
        // A log density has no zero that a share of it could be taken of.
        decrease_relative: 0.0,
        decrease_absolute: LITTLE,
        ..Options::DEFAULT
    };
    let found = match minimise(&mut curve, from, &options) {
        Ok(found) => found,
        Err(never) => match never {},
    };
    let root = Cholesky::new(found.normal.hessian)?;
    let count = curve.free.len() as f64;
    let ln = -found.normal.cost + 0.5 * (count * std::f64::consts::TAU.ln())
        - 0.5 * ln_determinant(&root);
    ln.is_finite().then_some((found.at, ln))
}

//! One nonlinear least-squares loop: Levenberg–Marquardt, with Gauss–Newton as its undamped case.
//!
//! A problem says what it costs at a point, gives its normal equations there and moves a point by a step; the loop
//! damps, tries, accepts or rejects and says why it ended. Points may be anything (a vector, a pose), steps are
//! vectors of a size known at compile time (nothing is allocated) or at run time.
//!
//! References: Levenberg 1944; Marquardt 1963; Moré 1978 (scaling); Nocedal and Wright, Numerical Optimization,
//! 2nd ed., chapter 10; Madsen, Nielsen and Tingleff, Methods for Non-Linear Least Squares Problems, 2nd ed., 2004.

mod differences;
mod options;
#[cfg(test)]
mod tests;

use nalgebra::allocator::Allocator;
use nalgebra::{DefaultAllocator, Dim, Dyn, OMatrix, OVector, U1};

use crate::cholesky::ScaledCholesky;
pub use crate::cholesky::Scaling;
pub use differences::{Differences, NotFinite};
pub use options::{Damping, Options};

/// Normal equations at a point.
#[derive(Debug, Clone)]
pub struct Normal<D: Dim>
where
    DefaultAllocator: Allocator<D> + Allocator<D, D>,
{
    /// Half the weighted sum of squares.
    pub cost: f64,
    /// Jᵀ W r.
    pub gradient: OVector<f64, D>,
    /// Jᵀ W J, Gauss and Newton's second derivatives of the cost.
    pub hessian: OMatrix<f64, D, D>,
}

/// A sum of squares to be made small, with `D` unknowns.
pub trait LeastSquares<D: Dim>
where
    DefaultAllocator: Allocator<D> + Allocator<D, D>,
{
    /// Values of the unknowns.
    type Point;
    /// Result of evaluating the cost that [`LeastSquares::linearise`] uses, such as the residuals.
    type Evaluated: Default;
    /// Why a start or a linearisation may fail.
    type Error;

    /// Half the weighted sum of squares at a point; `None` where the model is not defined. Not asked for without
    /// damping ([`Options::damping`]): a problem that is only solved so need not say it.
    fn cost(&mut self, _at: &Self::Point, _evaluated: &mut Self::Evaluated) -> Option<f64> {
        None
    }

    /// Evaluates the start. A problem whose linearisation needs no evaluation before it does nothing here.
    ///
    /// # Errors
    /// Where the model is not defined at the start.
    fn begin(
        &mut self,
        at: &Self::Point,
        evaluated: &mut Self::Evaluated,
    ) -> Result<(), Self::Error>;

    /// Normal equations at a point, which has just been evaluated where costs are asked for.
    ///
    /// # Errors
    /// Where the model has no derivatives.
    fn linearise(
        &mut self,
        at: &Self::Point,
        evaluated: &Self::Evaluated,
    ) -> Result<Normal<D>, Self::Error>;

    /// The point a step away from where the problem was linearised last; bounds are kept here. `None` where there
    /// is no such point.
    fn moved(&self, at: &Self::Point, step: &OVector<f64, D>) -> Option<Self::Point>;

    /// Whether unknown `k` takes part in the next step: not when it is held, or stands on a bound that the
    /// descent would leave.
    fn moves(&self, _at: &Self::Point, _gradient: &OVector<f64, D>, _k: usize) -> bool {
        true
    }

    /// The squared decrement that [`Options::decrement_enough`] is held against, where the problem knows better than gᵀH⁻¹g: in
    /// unknowns in which it is linear a step of any length leaves nothing.
    fn left(&self, _normal: &Normal<D>) -> Option<f64> {
        None
    }

    /// Whether a step just accepted is so short that the point counts as the minimum.
    fn negligible(&self, _from: &Self::Point, _to: &Self::Point, _step: &OVector<f64, D>) -> bool {
        false
    }
}

/// Why a search ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ended {
    /// The last step was negligible.
    Step,
    /// The last steps gained nothing worth having ([`Options::decrease_relative`]).
    Decrease,
    /// The gain left is below [`Options::decrement_enough`]; the last step was taken without being evaluated.
    Decrement,
    /// The sum of squares is zero.
    Exact,
    /// Every unknown is held or stands on a bound.
    Held,
    /// No step downhill at any damping, and none expected: the minimum to rounding.
    Rounding,
    /// A step was rejected where little was left to gain ([`Options::decrement_smooth`]): the cost is not
    /// smooth on that scale.
    PoorModel,
    /// No step downhill at any damping although the linear model expects one: the derivatives are not those of the
    /// cost, or the model ends here.
    Stuck,
    /// The last steps gained nothing worth having, but damping made them shorter than half and the linear model
    /// expects more: a strongly curved narrow minimum, or the border of where the model is defined.
    Creeping,
    /// The normal equations could not be solved: not positive definite, or not finite.
    Singular,
    /// The next step leaves where the model is defined, whatever its length.
    Outside,
    /// [`Options::iterations_max`] or [`Options::trials_max`] is reached.
    Budget,
}

impl Ended {
    /// Whether the point is a minimum (with the bounds, and as sharp as asked for).
    pub fn converged(self) -> bool {
        match self {
            Ended::Step
            | Ended::Decrease
            | Ended::Decrement
            | Ended::Exact
            | Ended::Held
            | Ended::Rounding
            | Ended::PoorModel => true,
            Ended::Stuck | Ended::Creeping | Ended::Singular | Ended::Outside | Ended::Budget => {
                false
            }
        }
    }
}

/// Where a search ended.
pub struct Found<D: Dim, P: LeastSquares<D>>
where
    DefaultAllocator: Allocator<D> + Allocator<D, D>,
{
    /// The point.
    pub at: P::Point,
    /// The last evaluation: of this point, but after [`Ended::Decrement`] of the one before.
    pub evaluated: P::Evaluated,
    /// The last linearisation, of the same point as the last evaluation.
    pub normal: Normal<D>,
    /// Steps taken.
    pub iterations: usize,
    /// Steps tried.
    pub trials: usize,
    /// Why it ended.
    pub ended: Ended,
}

/// Least squares from a start.
///
/// # Errors
/// The problem's own: a start outside the model, or a point without derivatives. A search that ends without a
/// minimum is no error, it says so in [`Found::ended`].
pub fn minimise<D, P>(
    problem: &mut P,
    start: P::Point,
    options: &Options,
) -> Result<Found<D, P>, P::Error>
where
    D: Dim,
    P: LeastSquares<D>,
    DefaultAllocator: Allocator<D> + Allocator<D, D>,
{
    let mut at = start;
    let (mut evaluated, mut tried) = (P::Evaluated::default(), P::Evaluated::default());
    problem.begin(&at, &mut evaluated)?;
    let mut normal = problem.linearise(&at, &evaluated)?;
    let mut search = Search::new(options);
    let (mut iterations, mut flat) = (0, 0);
    let ended = loop {
        if iterations >= options.iterations_max {
            break Ended::Budget;
        }
        let size = normal.gradient.shape_generic().0;
        let moves = OVector::<bool, D>::from_fn_generic(size, U1, |k, _| {
            problem.moves(&at, &normal.gradient, k)
        });
        if !moves.iter().any(|m| *m) {
            break Ended::Held;
        }
        let (next, step, decrease) =
            match search.downhill(problem, &at, &normal, &moves, &mut tried) {
                Tried::Lower(next, step, decrease) => (next, step, decrease),
                Tried::Last(next) => {
                    at = next;
                    break Ended::Decrement;
                }
                Tried::Nothing(why) => break why,
            };
        let negligible = problem.negligible(&at, &next, &step);
        let little = decrease <= options.little(normal.cost);
        flat = if little { flat + 1 } else { 0 };
        at = next;
        std::mem::swap(&mut evaluated, &mut tried);
        normal = problem.linearise(&at, &evaluated)?;
        let shortened = search.accept();
        iterations += 1;
        if negligible {
            break Ended::Step;
        }
        if flat >= options.decrease_times {
            let at_rest = !shortened || nothing_expected(&normal, &moves, options);
            break if at_rest {
                Ended::Decrease
            } else {
                Ended::Creeping
            };
        }
        if normal.cost == 0.0 {
            break Ended::Exact;
        }
    };
    Ok(Found {
        at,
        evaluated,
        normal,
        iterations,
        trials: search.trials,
        ended,
    })
}

/// Outcome of the steps tried from one point.
enum Tried<Point, Step> {
    /// A point downhill, the step there, and what it gains.
    Lower(Point, Step, f64),
    /// A point so near the minimum that it need not be evaluated.
    Last(Point),
    /// No point: the search ends here.
    Nothing(Ended),
}

/// Damping, and how often it was tried.
struct Search<'a> {
    options: &'a Options,
    damping: f64,
    trials: usize,
}

impl<'a> Search<'a> {
    fn new(options: &'a Options) -> Self {
        Search {
            options,
            damping: options.damping.map_or(0.0, |d| d.start),
            trials: 0,
        }
    }

    /// Shorter and shorter steps until one goes downhill.
    fn downhill<D, P>(
        &mut self,
        problem: &mut P,
        at: &P::Point,
        normal: &Normal<D>,
        moves: &OVector<bool, D>,
        tried: &mut P::Evaluated,
    ) -> Tried<P::Point, OVector<f64, D>>
    where
        D: Dim,
        P: LeastSquares<D>,
        DefaultAllocator: Allocator<D> + Allocator<D, D>,
    {
        let options = self.options;
        let Normal {
            hessian, gradient, ..
        } = normal;
        let mut decrement = None;
        let mut left =
            || *decrement.get_or_insert_with(|| squared_decrement(normal, moves, options));
        loop {
            crate::cancel::check();
            if self.trials >= options.trials_max {
                return Tried::Nothing(Ended::Budget);
            }
            let Some(step) = damped_step(hessian, gradient, moves, self.damping, options) else {
                if self.raise(|d| d.rejected) {
                    continue;
                }
                return Tried::Nothing(Ended::Singular);
            };
            self.trials += 1;
            let Some(next) = problem.moved(at, &step) else {
                if self.raise(|d| d.outside) {
                    continue;
                }
                return Tried::Nothing(Ended::Outside);
            };
            if options.damping.is_none() {
                return Tried::Lower(next, step, f64::INFINITY);
            }
            if options.decrement_enough > 0.0 {
                match problem.left(normal).or_else(&mut left) {
                    None => return Tried::Nothing(Ended::Singular),
                    Some(left) if left < options.decrement_enough => return Tried::Last(next),
                    Some(_) => {}
                }
            }
            let cost = problem.cost(&next, tried).unwrap_or(f64::INFINITY);
            if cost <= normal.cost * (1.0 + options.cost_slack) {
                return Tried::Lower(next, step, normal.cost - cost);
            }
            let smooth = options.decrement_smooth;
            if smooth > 0.0 && left().is_some_and(|left| left < smooth) {
                return Tried::Nothing(Ended::PoorModel);
            }
            if !self.raise(|d| d.rejected) {
                let at_rest = nothing_expected(normal, moves, options);
                return Tried::Nothing(if at_rest {
                    Ended::Rounding
                } else {
                    Ended::Stuck
                });
            }
        }
    }

    /// Raises the damping by one of its factors; `false` where that is no use.
    fn raise(&mut self, factor: impl Fn(&Damping) -> f64) -> bool {
        self.options.damping.is_some_and(|d| {
            self.damping *= factor(&d);
            self.damping <= d.most
        })
    }

    /// Lowers the damping after an accepted step; whether it had made that step shorter than half.
    fn accept(&mut self) -> bool {
        let shortened = self.damping > 1.0;
        if let Some(d) = self.options.damping {
            self.damping = (self.damping * d.accepted).max(d.least);
        }
        shortened
    }
}

/// gᵀ H⁻¹ g over the unknowns that move: twice what a full step gains in the linear model.
fn squared_decrement<D: Dim>(
    normal: &Normal<D>,
    moves: &OVector<bool, D>,
    options: &Options,
) -> Option<f64>
where
    DefaultAllocator: Allocator<D> + Allocator<D, D>,
{
    let Normal {
        hessian, gradient, ..
    } = normal;
    Some(-damped_step(hessian, gradient, moves, 0.0, options)?.dot(gradient))
}

/// Whether the linear model expects nothing that rounding of the cost could not hide.
fn nothing_expected<D: Dim>(normal: &Normal<D>, moves: &OVector<bool, D>, options: &Options) -> bool
where
    DefaultAllocator: Allocator<D> + Allocator<D, D>,
{
    squared_decrement(normal, moves, options)
        .is_some_and(|left| 0.5 * left <= options.hidden(normal.cost))
}

/// (H + damping diag H) step = -g over the unknowns that move, the others stay; `None` where H is not
/// positive definite there. Scaling and jitter are those of the options.
pub fn damped_step<D: Dim>(
    hessian: &OMatrix<f64, D, D>,
    gradient: &OVector<f64, D>,
    moves: &OVector<bool, D>,
    damping: f64,
    options: &Options,
) -> Option<OVector<f64, D>>
where
    DefaultAllocator: Allocator<D> + Allocator<D, D>,
{
    let Options {
        scaling, jitter, ..
    } = *options;
    let size = gradient.shape_generic().0;
    if D::try_to_usize().is_some() || moves.iter().all(|m| *m) {
        // A size known to the compiler is kept: what is held becomes a row of the identity.
        let row = |k: usize| moves[k].then_some(k);
        let factor = ScaledCholesky::of_rows(hessian, size, row, scaling, damping, jitter)?;
        let right =
            OVector::<f64, D>::from_fn_generic(
                size,
                U1,
                |k, _| {
                    if moves[k] { -gradient[k] } else { 0.0 }
                },
            );
        return Some(factor.solve(&right));
    }
    let rows: Vec<usize> = (0..moves.len()).filter(|k| moves[*k]).collect();
    let few = Dyn(rows.len());
    let row = |k: usize| rows.get(k).copied();
    let factor = ScaledCholesky::<Dyn>::of_rows(hessian, few, row, scaling, damping, jitter)?;
    let right = OVector::<f64, Dyn>::from_fn_generic(few, U1, |k, _| -gradient[rows[k]]);
    let short = factor.solve(&right);
    let mut step = OVector::<f64, D>::zeros_generic(size, U1);
    for (k, value) in rows.into_iter().zip(short.iter()) {
        step[k] = *value;
    }
    Some(step)
}

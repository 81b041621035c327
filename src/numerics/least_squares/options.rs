//! How a search damps, what it accepts and when it ends.

use crate::cholesky::{JITTER, Scaling};

/// Options of [`super::minimise`]. The defaults are those of a dense problem in any units that starts near its
/// minimum; a caller that departs from one says why.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Options {
    /// Damping of the steps; `None` = Gauss–Newton: every step is taken, its cost is not asked for. For problems whose
    /// weights change between steps (reweighting), where the costs of two steps are not of the same sum.
    pub damping: Option<Damping>,
    /// Steps taken at most. Default 100: near a minimum convergence is linear at worst with the share of curvature that
    /// Gauss and Newton leave out (Nocedal and Wright, section 10.3), a search that takes longer has another problem.
    pub iterations_max: usize,
    /// Steps tried at most, rejected ones included. Default: no limit but the damping's, which allows
    /// some 25 in a row.
    pub trials_max: usize,
    /// A step counts as downhill when it raises the cost by less than this share of it. Default 0. Where a cost is
    /// summed over samples that come and go with the point, its own last digits decide otherwise.
    pub cost_slack: f64,
    /// A step that gains at most this share of the cost (plus [`Self::decrease_absolute`]) gained nothing. Default
    /// 1e-12: rounding of a sum of some thousand squares (ε √n to ε n; Higham, section 4.2), so that the minimum is
    /// as sharp as the arithmetic allows.
    pub decrease_relative: f64,
    /// The same in the cost's own unit. Default 0; with residuals in sds 0.005 is a tenth of an sd.
    pub decrease_absolute: f64,
    /// So many such steps in a row end the search. Default 2: the first may have been short because it was damped.
    pub decrease_times: usize,
    /// Ends when the squared Newton decrement gᵀH⁻¹g falls below this (Boyd and Vandenberghe, Convex Optimization, section
    /// 9.5.1): with residuals in sds the squared distance to the minimum in sds. The step at hand is then taken without
    /// being evaluated. Default 0: not asked for. For costs that are dear to evaluate.
    pub decrement_enough: f64,
    /// A step rejected where the squared decrement is below this ends the search. Default 0: never. For costs with
    /// kinks smaller than this.
    pub decrement_smooth: f64,
    /// Scaling of the normal equations. Default [`Scaling::UnitDiagonal`] (Moré 1978: steps do not depend on units).
    pub scaling: Scaling,
    /// Added to the scaled diagonal in every solve. Default [`JITTER`].
    pub jitter: f64,
}

impl Default for Options {
    fn default() -> Self {
        Self::DEFAULT
    }
}

impl Options {
    /// The defaults, for constants.
    pub const DEFAULT: Options = Options {
        damping: Some(Damping::DEFAULT),
        iterations_max: 100,
        trials_max: usize::MAX,
        cost_slack: 0.0,
        decrease_relative: 1e-12,
        decrease_absolute: 0.0,
        decrease_times: 2,
        decrement_enough: 0.0,
        decrement_smooth: 0.0,
        scaling: Scaling::UnitDiagonal,
        jitter: JITTER,
    };

    /// A gain that is none, of this cost.
    pub(super) fn little(&self, cost: f64) -> f64 {
        self.decrease_absolute + self.decrease_relative * cost
    }

    /// A gain that may be there and not be seen: below √ε of the cost its rounding may hide it (Gill, Murray and Wright,
    /// Practical Optimization, section 8.2.2).
    pub(super) fn hidden(&self, cost: f64) -> f64 {
        self.little(cost).max(f64::EPSILON.sqrt() * cost)
    }
}

/// Damping of Levenberg and Marquardt, λ in (H + λ diag H) step = -g.
///
/// Multiplied and divided (Marquardt 1963). Nielsen's rule (1999), which follows the ratio of gain to expectation, saves
/// rejected steps on curved minima; the problems of this project start near their minimum and reject few.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Damping {
    /// At the start. Default 1e-3: Madsen, Nielsen and Tingleff, section 3.2, from 1e-6 for a start believed to be good
    /// to 1 for one that is not.
    pub start: f64,
    /// Factor after an accepted step. Default 0.1 (Marquardt's ν = 10).
    pub accepted: f64,
    /// Factor after a step uphill, and where the damped equations have no solution. Default 10.
    pub rejected: f64,
    /// Factor after a step to where the model is not defined. Default 10. More saves trials where a point far
    /// outside says nothing of how far.
    pub outside: f64,
    /// Not lowered further. Default 1e-12: below it a step is the undamped one to its last digits, and the way back up
    /// costs trials.
    pub least: f64,
    /// The search ends when it would be raised further. Default 1e12: such a step is rounding.
    pub most: f64,
}

impl Damping {
    /// The defaults, for constants.
    pub const DEFAULT: Damping = Damping {
        start: 1e-3,
        accepted: 0.1,
        rejected: 10.0,
        outside: 10.0,
        least: 1e-12,
        most: 1e12,
    };
}

impl Default for Damping {
    fn default() -> Self {
        Self::DEFAULT
    }
}

//! Levenberg–Marquardt steps of a fit, until it has converged.

use super::super::photometric::{
    BACKGROUND, BLACK, BRIGHTNESS, Column, EdgeModelError, LOCAL, PARAMETERS, PRIOR_SD,
    Photometric, Picture, Plan, State, Sums, THICKNESS, TONE, UNEVEN, Weighting,
};
use super::PoseFitter;
use super::camera;
use super::solve::{equations, in_si, squared_decrement};
use super::weak_direction::WeakDirection;
use hydroline_numerics::cholesky::Scaling;
use hydroline_numerics::least_squares::{
    Damping, Ended, LeastSquares, Normal, Options, damped_step, minimise,
};
use nalgebra::Const;
use std::convert::Infallible;

/// Options of a frame's fit.
///
/// Starts are within millimetres and the model is nearly linear in [`WeakDirection`]'s coordinates, so the first step is an
/// undamped one but for rounding (1e-9). A comparison of a frame is dear and few steps are rejected: where one is,
/// something is far off, and damping rises by 30, after a state that no sheet and camera can have by 100. Pixels come
/// and go with the edges: a cost higher by 1e-7 of itself is no rise. The unknowns come in units of their size.
const STEPS: Options = Options {
    damping: Some(Damping {
        start: 1e-9,
        accepted: 0.1,
        rejected: 30.0,
        outside: 100.0,
        least: 1e-12,
        most: 3e4,
    }),
    iterations_max: usize::MAX,
    cost_slack: 1e-7,
    decrease_times: usize::MAX,
    decrement_smooth: KINKS,
    scaling: Scaling::AsGiven,
    jitter: 0.0,
    ..Options::DEFAULT
};

/// The squared Newton decrement, in sds, below which one more step is taken unchecked.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Convergence {
    /// In all that is free.
    All(f64),
    /// In what the light is nonlinear in, the linear unknowns eliminated.
    Nonlinear(f64),
}

/// Where a step that gains no more than this (a third of an sd) turns out to gain nothing, the rest
/// is kinks of the light at corners.
const KINKS: f64 = 0.1;

/// Linear parameters: a step of any length leaves nothing there. (Brightness multiplies what moves the line, by a hundredth.)
const LINEAR: [usize; 2 + UNEVEN] = {
    let mut linear = [BRIGHTNESS; 2 + UNEVEN];
    linear[1] = BACKGROUND;
    let mut k = 0;
    while k < UNEVEN {
        linear[2 + k] = LOCAL + k;
        k += 1;
    }
    linear
};

/// Most by which a step is longer than the weights imply.
const STRIDE_MOST: f64 = 1.5;

impl PoseFitter {
    /// The fit of the free parameters, in so many steps at most and so near to the end: the state, and the sums that near to
    /// it.
    #[allow(clippy::too_many_arguments)]
    pub(super) fn converge(
        &self,
        model: &Photometric,
        plan: &Plan,
        picture: &Picture<'_>,
        start: State,
        free: &[bool; PARAMETERS],
        weighting: &Weighting,
        model_error: &mut EdgeModelError,
        (iterations, converged): (usize, Convergence),
    ) -> Option<(State, Sums)> {
        let mut frame = Frame {
            fitter: self,
            model,
            plan,
            picture,
            free,
            weighting,
            model_error,
            linear_too: matches!(converged, Convergence::All(_)),
            here: None,
        };
        let (Convergence::All(enough) | Convergence::Nonlinear(enough)) = converged;
        let options = Options {
            trials_max: iterations,
            decrement_enough: enough,
            ..STEPS
        };
        let found = minimise(&mut frame, start, &options).ok()?;
        let solved = found.ended != Ended::Singular && found.evaluated.tally.pixels > 200;
        solved.then_some((found.at, found.evaluated))
    }

    /// Adds the priors of light and camera, and what the run has shown of the sheet's thickness.
    pub(super) fn add_priors(&self, sums: &mut Sums, state: &State) {
        let mut weigh = |k: usize, off: f64, weight: f64| {
            sums.information[(k, k)] += weight;
            sums.gradient[k] += weight * off;
            sums.cost += 0.5 * weight * off * off;
        };
        for (k, (found, sd)) in state.uneven.iter().zip(PRIOR_SD).enumerate() {
            weigh(LOCAL + k, -found, 1.0 / (sd * sd));
        }
        let known = &self.response_prior;
        let off = known.mean - camera::of_run(state);
        for (k, off) in off.iter().enumerate() {
            weigh(TONE + k, *off, known.information[(k, k)]);
        }
        if let Some([thickness_m, sd_m]) = self.sheet.thickness_m {
            weigh(
                THICKNESS,
                thickness_m - state.thickness_m,
                1.0 / (sd_m * sd_m),
            );
        }
        // Where the rig states γ and b, their errors are correlated.
        let both = known.information[(0, 1)];
        if both != 0.0 {
            sums.information[(TONE, BLACK)] += both;
            sums.information[(BLACK, TONE)] += both;
            sums.gradient[TONE] += both * off[1];
            sums.gradient[BLACK] += both * off[0];
            sums.cost += both * off[0] * off[1];
        }
    }
}

/// The first step of a fit, in units of the parameters' sizes.
pub(super) fn first_step(
    equations: &Normal<Const<PARAMETERS>>,
    free: &[bool; PARAMETERS],
) -> Option<Column> {
    let start = STEPS.damping.map_or(0.0, |d| d.start);
    let Normal {
        gradient, hessian, ..
    } = equations;
    damped_step(hessian, gradient, &(*free).into(), start, &STEPS)
}

/// A frame against the model.
struct Frame<'a> {
    fitter: &'a PoseFitter,
    model: &'a Photometric,
    plan: &'a Plan,
    picture: &'a Picture<'a>,
    free: &'a [bool; PARAMETERS],
    weighting: &'a Weighting,
    model_error: &'a mut EdgeModelError,
    /// Whether what the light is linear in counts in the decrement.
    linear_too: bool,
    /// Coordinates of the last linearisation, and the factor by which steps are lengthened.
    here: Option<(WeakDirection, f64)>,
}

impl LeastSquares<Const<PARAMETERS>> for Frame<'_> {
    type Point = State;
    type Evaluated = Sums;
    type Error = Infallible;

    fn cost(&mut self, state: &State, sums: &mut Sums) -> Option<f64> {
        let (model, picture) = (self.model, self.picture);
        *sums = model.compare(
            self.plan,
            picture,
            state,
            self.weighting,
            self.model_error,
            true,
        );
        self.fitter.add_priors(sums, state);
        Some(sums.cost)
    }

    fn begin(&mut self, state: &State, sums: &mut Sums) -> Result<(), Infallible> {
        self.cost(state, sums);
        Ok(())
    }

    fn linearise(
        &mut self,
        state: &State,
        sums: &Sums,
    ) -> Result<Normal<Const<PARAMETERS>>, Infallible> {
        let weak_direction = WeakDirection::new(&state.pose, &self.fitter.mounts);
        let equations = equations(sums, &weak_direction);
        self.here = Some((weak_direction, stride(sums)));
        Ok(equations)
    }

    fn left(&self, normal: &Normal<Const<PARAMETERS>>) -> Option<f64> {
        let free = |k: &usize| self.free[*k];
        let linear = LINEAR.into_iter().filter(free);
        let nonlinear = (0..PARAMETERS).filter(|k| free(k) && !LINEAR.contains(k));
        squared_decrement(normal, linear, nonlinear).map(|[linear, nonlinear]| {
            if self.linear_too {
                linear + nonlinear
            } else {
                nonlinear
            }
        })
    }

    fn moves(&self, _: &State, _: &Column, k: usize) -> bool {
        self.free[k]
    }

    fn moved(&self, state: &State, step: &Column) -> Option<State> {
        let (weak_direction, stride) = self.here.as_ref()?;
        let next = weak_direction.moved(state, &(in_si(step) * *stride));
        plausible(&next).then_some(next)
    }
}

/// By how much a step is longer than the weights imply: they fall as a residual grows, so that its pull
/// changes by less than its weight (Tukey's at 6 noise sds: 0.84 instead of 0.95). A step as long as the
/// weights imply stops an eighth short of its goal.
fn stride(sums: &Sums) -> f64 {
    let found = sums.tally.weights / sums.tally.slopes;
    if found.is_finite() {
        found.clamp(1.0, STRIDE_MOST)
    } else {
        1.0
    }
}

/// A state that a sheet and a camera can have.
pub(super) fn plausible(state: &State) -> bool {
    let p = &state.pose;
    state.pose.to_array().iter().all(|v| v.is_finite())
        && p.phi_rad.abs() < 0.7
        && p.theta_rad.abs() < 0.7
        && (2e-4..0.02).contains(&state.thickness_m)
        && state.brightness > 1.0
        && state.background > -20.0
}

/// Noise of the lit pixels away from edges \[grey levels\].
pub(super) fn lit_noise(sums: &Sums) -> Option<f64> {
    (sums.tally.bright_count > 100)
        .then(|| (sums.tally.bright_square / (sums.tally.bright_count as f64 - 4.0)).sqrt())
}

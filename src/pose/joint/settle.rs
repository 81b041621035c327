//! Steps of a fit, until it has settled.

use super::super::photometric::{
    Doubts, PARAMETERS, Photometric, Plan, State, Sums, THICKNESS, Weighting,
};
use super::PoseFitter;
use super::solve::solve;
use super::valley::Valley;
use hydroline_core::frame::GreyImage;

/// Where a step that gains no more than this (a third of an sd) turns out to gain nothing, the rest
/// is kinks of the light at corners.
const KINKS: f64 = 0.1;

/// No step is longer than the weights say by more than this.
const STRIDE_MOST: f64 = 1.5;

impl PoseFitter {
    /// Levenberg–Marquardt on the free parameters, in so many steps at most and so near to the end:
    /// the state, and the sums that near to it.
    #[allow(clippy::too_many_arguments)]
    pub(super) fn settle(
        &self,
        model: &Photometric,
        plan: &Plan,
        image: &GreyImage,
        start: State,
        free: &[bool; PARAMETERS],
        weighting: &Weighting,
        doubts: &mut Doubts,
        (iterations, settled): (usize, f64),
    ) -> Option<(State, Sums)> {
        let mut look = |state: &State| {
            let mut sums = model.compare(plan, &image.pixels, state, weighting, doubts, true);
            self.know_thickness(&mut sums, state);
            sums
        };
        let mut state = start;
        let mut sums = look(&state);
        let mut damping = 1e-9;
        for _ in 0..iterations {
            let valley = Valley::new(&state.pose, &self.mounts);
            let turned = valley.turn(&sums);
            let step = solve(&turned, free, damping)? * stride(&sums);
            let next = valley.moved(&state, &step);
            if !sane(&next) {
                damping *= 100.0;
                continue;
            }
            // Twice the cost that a full step would still gain = the squared way to go, in sds.
            let expected = solve(&turned, free, 0.0)?.dot(&turned.gradient);
            if expected < settled {
                // So little is left that the step need not be looked at.
                state = next;
                break;
            }
            let tried = look(&next);
            if tried.cost <= sums.cost * (1.0 + 1e-7) {
                state = next;
                sums = tried;
                damping = (damping * 0.1).max(1e-12);
            } else {
                if damping > 1e3 || expected < KINKS {
                    break;
                }
                damping *= 30.0;
            }
        }
        (sums.pixels > 200).then_some((state, sums))
    }

    /// Adds what the run has shown of the sheet's thickness.
    fn know_thickness(&self, sums: &mut Sums, state: &State) {
        let Some([thickness_m, sd_m]) = self.sheet.thickness_m else {
            return;
        };
        let weight = 1.0 / (sd_m * sd_m);
        let off_m = thickness_m - state.thickness_m;
        sums.information[(THICKNESS, THICKNESS)] += weight;
        sums.gradient[THICKNESS] += weight * off_m;
        sums.cost += 0.5 * weight * off_m * off_m;
    }
}

/// By how much a step is longer than the weights say: they fall as a residual grows, so that its pull
/// changes by less than its weight (Tukey's at 6 noise sds: 0.84 instead of 0.95). A step as long as the
/// weights say stops an eighth short of its goal.
fn stride(sums: &Sums) -> f64 {
    let found = sums.weights / sums.slopes;
    if found.is_finite() {
        found.clamp(1.0, STRIDE_MOST)
    } else {
        1.0
    }
}

/// A state that a sheet and a camera can have.
pub(super) fn sane(state: &State) -> bool {
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
    (sums.bright_count > 100)
        .then(|| (sums.bright_square / (sums.bright_count as f64 - 4.0)).sqrt())
}

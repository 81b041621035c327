//! From one start to the pose, with covariance.

use super::super::photometric::{
    Choice, EdgeModelError, LINE, LOCAL, PARAMETERS, Photometric, Picture, Plan, RunParameters,
    State, Sums, Weighting, light_per_grey,
};
use super::lm_loop::{Convergence, lit_noise, plausible};
use super::solve::{covariances, loadings, response_seen};
use super::{
    CameraResponse, JointPose, LightSeen, PoseCaveat, PoseFault, PoseFitter, ResponseSeen,
};
use hydroline_calib::Pose;
use hydroline_stripe::Profile;

/// Final robust cut in noise sds.
pub(super) const CUT: f64 = 6.0;
/// Residual per pixel beyond which a fit does not explain the frame.
const MISFIT: f64 = 4.0;
/// Share of pixels set aside beyond which a fit does not explain the frame; where what is left does not hang together, light of many
/// grains, whose brightness has a long tail.
const REJECTED_MOST: f64 = 0.05;
const GRAIN_REJECTED_MOST: f64 = 0.15;
/// Pixels that residuals which hang together over eight columns make one, less the one (Newey and West 1987, eight lags).
const STRUCTURE_COLUMNS: f64 = 8.0;
const ITERATIONS: usize = 14;
/// Of the camera's curve, what of ln γ and, as far as light is not left as it is, of the black level \[grey levels\] may be
/// left straight: at an approach, and at the end.
const RESPONSE_APPROACHED: [f64; 2] = [0.1, 4.0];
const RESPONSE_CONVERGED: [f64; 2] = [0.02, 0.5];
/// Where more of the columns than this are clipped at their peak, the flanks that are left are fitted by a Gaussian: what of the
/// line they show follows from there.
const CLIPPED_LINE: f64 = 0.3;
/// Most times that pixels are chosen, where a pose leaves the room that they were chosen for.
const PLANS: usize = 4;
/// The same where the camera's curve is sought too.
const PLANS_OPEN: usize = 12;
/// The squared Newton decrement, in sds, below which one more step is taken unchecked. What a
/// step of n sds leaves is the nonlinearity of the light over it, found to be n²/60 sds: of three sds a
/// seventh at most, by which the estimate scatters a hundredth more. The edges' model error and the
/// covariance are those of before that step.
const CONVERGED: f64 = 9.0;
/// The same for a state that only starts the next fit, of other pixels: it need not be better than these pixels determine it.
const NEARLY: f64 = 100.0;
const APPROACHED: f64 = 100.0;
/// Where the noise is known well enough to go on with.
const COARSE: f64 = 1000.0;
/// Of the columns without edges every so many, until the last look.
const FEW: usize = 3;
const TO_APPROACH: Choice = Choice {
    step: 3,
    keep: 4,
    room_m: 0.003,
};
/// The same where the camera's curve is sought too.
const TO_APPROACH_OPEN: Choice = Choice {
    keep: 2,
    ..TO_APPROACH
};
/// After that it moves by its sd.
const TO_FINISH: Choice = Choice {
    room_m: 0.001,
    ..Choice::ALL
};

/// Whether the camera's curve has changed by more than this between two states.
fn response_changed(a: &State, b: &State, [tone, black]: [f64; 2]) -> bool {
    // Without a curve the black level is one with the background, and moves nothing.
    let curved = (1.0 - b.tone.exp()).abs();
    (a.tone - b.tone).abs() > tone || (a.black - b.black).abs() * curved > black
}

impl PoseFitter {
    /// The whole fit from a start, with covariance.
    pub(super) fn finish(
        &self,
        model: &Photometric,
        picture: &Picture<'_>,
        profile: &Profile,
        start: State,
        free: [bool; PARAMETERS],
        mut caveats: Vec<PoseCaveat>,
    ) -> Result<JointPose, PoseFault> {
        let all_free = free;
        let mut free = free;
        if picture.clipped_share > CLIPPED_LINE {
            free[LINE..LOCAL].fill(false);
        }
        let considered = self.camera.as_ref().and_then(CameraResponse::considered);
        let [run_parameters, run_parameters_at_last] = match (self.camera, considered) {
            (None, _) => [RunParameters::Estimated; 2],
            (_, Some(_)) => [RunParameters::Known, RunParameters::Considered],
            _ => [RunParameters::Known; 2],
        };
        let mut weighting = Weighting {
            noise_sd: profile.noise_sd.max(0.3),
            cut: 4.0,
            redescending: false,
            response: self.response(picture.ceiling),
            run_parameters,
            even: false,
        };
        let (mut from, mut sums) = self
            .approach(model, picture, start, &free, &mut weighting)
            .ok_or(PoseFault::NotConverged)?;
        weighting.cut = CUT;
        weighting.redescending = true;
        // Only what the fit ends with says how a pose hangs on the map.
        let stating = model.with_map_errors(self.map_errors.clone());
        let mut again = self.plans();
        let (state, sums, edge_model_error) = loop {
            again -= 1;
            let plan = model.plan(&from, TO_FINISH);
            let mut converge =
                |model, plan: &Plan, from: State, sums: &Sums, converged: f64, run_parameters| {
                    weighting.run_parameters = run_parameters;
                    weighting.noise_sd = lit_noise(sums).unwrap_or(weighting.noise_sd).max(0.3);
                    let model_error = &mut EdgeModelError::found(&sums.edges, weighting.noise_sd);
                    let limits = (ITERATIONS, Convergence::Nonlinear(converged));
                    weighting.respond(&from, picture.ceiling);
                    self.converge(
                        model,
                        plan,
                        picture,
                        from,
                        &free,
                        &weighting,
                        model_error,
                        limits,
                    )
                    .ok_or(PoseFault::NotConverged)
                };
            // All pixels of the edges, and how good the edges are by the way.
            let few = plan.thinned(FEW);
            let (near, edges) = converge(model, &few, from, &sums, NEARLY, run_parameters)?;
            let (state, all) = converge(
                &stating,
                &plan,
                near,
                &edges,
                CONVERGED,
                run_parameters_at_last,
            )?;
            let response_changed = response_changed(&near, &state, RESPONSE_CONVERGED);
            let moved = self.shift_m(&from.pose, &state.pose) > TO_FINISH.room_m;
            if again == 0 || !(moved || response_changed) {
                let edge_model_error = edges.edges.model_error_sd(weighting.noise_sd);
                break (state, all, edge_model_error);
            }
            (from, sums) = (state, all);
        };
        let rejected = sums.tally.rejected as f64
            / (sums.tally.edge_count + sums.tally.bright_count).max(1) as f64;
        // Relative to the frame's own dark noise the residual shows whether the model holds at all. Under a curve the sensor's
        // noise is as large in the light everywhere, that of rounding and compression in the grey levels: the larger counts.
        let lit = match picture.clipped_share > CLIPPED_LINE {
            // What is seen of the line are its flanks.
            true => state.background,
            false => state.background + state.brightness.max(0.0),
        };
        let per_grey = [state.background, lit].map(|l| light_per_grey(state.tone, l));
        let dark_sd = profile.noise_sd.max(1.0) * per_grey[0].max(per_grey[1]);
        let mut chi = lit_noise(&sums).unwrap_or(0.0) / dark_sd;
        let mut rejected_most = REJECTED_MOST;
        let mut wider_sds = 1.0;
        // Where pitch is held, x and z are off by what it is off, and no noise states that.
        if free[4] && (chi > 0.5 * MISFIT || rejected > rejected_most) {
            // More than the dark's noise: is it noise of the light itself, or something that the model does not know?
            let plan = model.plan(&state, TO_FINISH).uncut();
            let structure_sd = model.structure_sd(&plan, picture, &state, &weighting);
            chi = 1.0_f64.hypot(structure_sd / dark_sd);
            let correlated = (structure_sd / weighting.noise_sd).powi(2);
            wider_sds = (1.0 + STRUCTURE_COLUMNS * correlated).sqrt();
            if chi <= 0.5 * MISFIT {
                rejected_most = GRAIN_REJECTED_MOST;
            }
        }
        let light = LightSeen::of(picture, &state);
        if chi > MISFIT || !plausible(&state) {
            return Err(PoseFault::Unexplained { chi, light });
        }
        if rejected > rejected_most || chi > 0.5 * MISFIT {
            caveats.push(PoseCaveat::Misfit);
        }
        let [alone, with_response] =
            covariances(&sums, &free, considered).ok_or(PoseFault::NotConverged)?;
        let loadings = loadings(&sums, &free).ok_or(PoseFault::NotConverged)?;
        let covariance_with_thickness = with_response + alone * (sums.edges.birge2() - 1.0);
        let response = match self.camera {
            None => self.response_seen(model, picture, &state, &weighting, &all_free),
            Some(_) => None,
        };
        let mut measured = [false; 6];
        measured.copy_from_slice(&free[..6]);
        let mut fitted = JointPose {
            pose: state.pose,
            covariance: covariance_with_thickness.fixed_view::<6, 6>(0, 0).into(),
            covariance_with_thickness,
            loadings,
            theta_sd_alone_rad: alone[(4, 4)].max(0.0).sqrt(),
            measured,
            thickness_m: state.thickness_m,
            brightness: state.brightness,
            background: state.background,
            tone: state.tone,
            black: state.black,
            across: state.across,
            response,
            light,
            uneven: state.uneven,
            noise_sd: weighting.noise_sd,
            rejected,
            edge_model_error,
            edges_alike: sums.edges.alike(weighting.noise_sd),
            pixels: sums.tally.pixels,
            caveats,
            carried: None,
        };
        if wider_sds > 1.0 {
            fitted.widen(wider_sds);
        }
        Ok(fitted)
    }

    /// A frame's estimate of the camera's response, from light that no edge cuts: edges lie off by a hundredth of a pixel, and
    /// along the line that looks like a curve of a few hundredths of ln γ.
    fn response_seen(
        &self,
        model: &Photometric,
        picture: &Picture<'_>,
        state: &State,
        weighting: &Weighting,
        free: &[bool; PARAMETERS],
    ) -> Option<ResponseSeen> {
        let plan = model.plan(state, TO_FINISH).uncut();
        let none = &mut EdgeModelError::default();
        let mut sums = model.compare(&plan, picture, state, weighting, none, true);
        self.add_priors(&mut sums, state);
        // Without edges there is no x, y and ψ.
        let mut free = *free;
        [free[0], free[1], free[5]] = [false; 3];
        response_seen(&sums, state, &free, &self.response_prior)
    }

    /// From a start to about the pose, on some of the pixels; these are chosen anew as long as the pose leaves the room
    /// that they were chosen for: beyond it edges cut light that the plan takes for whole.
    fn approach(
        &self,
        model: &Photometric,
        picture: &Picture<'_>,
        start: State,
        free: &[bool; PARAMETERS],
        weighting: &mut Weighting,
    ) -> Option<(State, Sums)> {
        let choice = match self.camera {
            Some(_) => TO_APPROACH,
            None => TO_APPROACH_OPEN,
        };
        let mut from = start;
        for again in (0..self.plans()).rev() {
            let plan = model.plan(&from, choice);
            let mut converge = |from: State, converged: f64| {
                let none = &mut EdgeModelError::default();
                let limits = (6, Convergence::All(converged));
                weighting.respond(&from, picture.ceiling);
                let found =
                    self.converge(model, &plan, picture, from, free, weighting, none, limits);
                // Noise in the lit pixels: dark ones are clipped at zero, and have no shot noise. It is
                // known once the fit is about there.
                let noise_sd = found.as_ref().and_then(|(_, sums)| lit_noise(sums));
                weighting.noise_sd = noise_sd.unwrap_or(weighting.noise_sd).max(0.3);
                found
            };
            let in_room = |state: &State| {
                let moved = self.shift_m(&from.pose, &state.pose) > choice.room_m;
                again == 0 || !(moved || response_changed(&from, state, RESPONSE_APPROACHED))
            };
            let (coarse, _) = converge(from, COARSE)?;
            from = if in_room(&coarse) {
                let (state, sums) = converge(coarse, APPROACHED)?;
                if in_room(&state) {
                    return Some((state, sums));
                }
                state
            } else {
                coarse
            };
        }
        None
    }

    /// Most times that pixels are chosen anew, and the camera's curve is made straight.
    fn plans(&self) -> usize {
        match self.camera {
            Some(_) => PLANS,
            None => PLANS_OPEN,
        }
    }

    /// Largest shift of the sheet's line on the floor over the target between two poses \[m\].
    pub(super) fn shift_m(&self, a: &Pose, b: &Pose) -> f64 {
        // η of the floor, θ and φ small: η₀ = h_centre − (l sin θ − z).
        let eta_m =
            |p: &Pose| self.mounts.h_centre_m - self.mounts.l_laser_m * p.theta_rad.sin() + p.z_m;
        [-0.5, 0.0, 0.5]
            .map(|xi_m| {
                let at = |p: &Pose| {
                    p.body_to_tank(&hydroline_calib::frames::plane_to_body(
                        &self.mounts,
                        xi_m,
                        eta_m(p),
                    ))
                };
                let (a, b) = (at(a), at(b));
                (a.x - b.x).hypot(a.y - b.y)
            })
            .into_iter()
            .fold(0.0, f64::max)
    }
}

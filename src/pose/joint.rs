//! All six degrees of freedom from one frame.
//!
//! The grey levels along the stripe are compared with [`super::photometric`]'s closed form under
//! the pose, the brightness, the thickness of the sheet and the background, brightness and background uneven, by
//! Gauss–Newton with a robust weight. The covariance is that of the fit with light and thickness free, so the weak
//! direction (δz = l δθ, δx = −H δθ; theory/geometry.md, one frame) carries its own large sd; what is not known of the camera's response
//! ([`CameraResponse`]) adds to it.

use super::initial;
use super::outline::Surfaces;
use super::photometric::{
    self, BACKGROUND, BRIGHTNESS, PARAMETERS, Photometric, Picture, Response, State, THICKNESS,
};
use super::segments::{self, Levels};
use super::sheet::SheetTable;
use hydroline_calib::Pose;
use hydroline_calib::plane::{ImageSize, MapErrors, PlaneMap};
use hydroline_core::frame::GreyImage;
use hydroline_rigs::{Mounts, Rig};
use hydroline_stripe::Profile;
use std::sync::Arc;

mod bound;
mod camera;
mod choose;
mod finish;
mod lm_loop;
pub mod refine;
mod result;
mod seen;
mod solve;
mod speculative;
mod starts;
mod weak_direction;

pub use super::photometric::OF_RUN;
pub use bound::Light;
pub use camera::{CameraResponse, ResponsePrior, ResponseSeen};
use refine::Sheet;
pub(crate) use result::total_covariance;
pub use result::{JointPose, PoseCaveat, PoseFault};
pub use seen::LightSeen;
pub use speculative::Speculative;
use starts::Starts;
pub use weak_direction::squared_distance;

/// Largest sd of θ with which a frame counts as having shown it \[rad\] (0.6°).
const THETA_SHOWN_RAD: f64 = 0.01;

/// Edges that leave more than this of the light that they cut are not where the target has them: edges of frames that the
/// model holds for leave 0.01 to 0.03, those of a pose one edge off 0.1 and more.
pub(crate) const EDGES_OFF: f64 = 0.06;
/// Below this other places need not be tried.
pub(crate) const EDGES_SOUND: f64 = 0.035;
/// Where an edge's pixels have more than this of their squared model error alike, the edge as a whole lies elsewhere: of scatter, as
/// compression leaves it, they have 0 to 0.3 alike, under a wrong curve of the camera 0.5 to 0.9.
pub(crate) const EDGES_ALIKE: f64 = 0.5;
/// From here on edges are not where the target has them, whatever the frame is compressed by.
pub(crate) const EDGES_NOWHERE: f64 = 0.1;
/// Where a line lies on a corner of the target, the pose a little before the corner and that as far behind it are minima of the same
/// cost, and a start on the wrong side does not cross: of a pose whose edges are off the other sides are tried \[m\].
const ACROSS_CORNER_M: [f64; 4] = [-0.012, -0.006, 0.006, 0.012];
/// Places on the target that are fitted to convergence before all are rejected.
const PLACES_MOST: usize = 4;

/// From here on the brightest levels of eight bits are clipped, whatever the camera \[grey levels\].
const CEILING: u8 = 254;

/// Of (x, y, z, φ, θ, ψ, thickness).
pub type Matrix7 = nalgebra::SMatrix<f64, 7, 7>;

/// Of (x, y, z, φ, θ, ψ, thickness) \[m, rad\], by each error that the map's points share, of one standard deviation.
pub type MapLoadings = nalgebra::SMatrix<f64, 7, { MapErrors::MOST }>;

/// Prior knowledge of a frame's pose.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Hint {
    /// About where the CG is along X \[m\]: decides only between repetitions of the target.
    pub x_m: Option<f64>,
    /// Degrees of freedom that are known and held (paper's 1-D motions).
    pub held: Held,
}

/// Degrees of freedom held at a given value.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Held {
    /// θ \[rad\].
    pub theta_rad: Option<f64>,
    /// Sheet's thickness known: held at the rig's.
    pub thickness: bool,
}

/// Fits poses for one rig. Cheap to clone: the tables are shared.
#[derive(Clone)]
pub struct PoseFitter {
    model: Arc<Photometric>,
    bare: Arc<Photometric>,
    map_errors: Arc<MapErrors>,
    map: Arc<dyn PlaneMap>,
    mounts: Mounts,
    heights_m: Vec<f64>,
    thickness_m: f64,
    /// Sheet as a run has shown it.
    sheet: Sheet,
    /// The camera's response; `None`: each frame's own unknown.
    camera: Option<CameraResponse>,
    response_prior: ResponsePrior,
    /// Level from which a pixel counts as clipped.
    ceiling: u8,
}

impl PoseFitter {
    /// A fitter for a rig and its map from image to laser plane: of a camera whose response is as the rig states it, else
    /// one that leaves light as it is, and a line that is a Gaussian.
    pub fn new(rig: &Rig, map: Arc<dyn PlaneMap>) -> Self {
        let surfaces = Surfaces::new(rig.target.as_ref());
        let heights_m = surfaces.heights_m();
        let table = Arc::new(SheetTable::new(map.as_ref(), &rig.camera, &rig.mounts));
        let map_errors = MapErrors::of(map.as_ref(), ImageSize::of(&rig.camera));
        let model = Photometric::new(surfaces, table, rig.camera.noise.blur_px, rig.laser.fan_rad);
        let stated = rig.camera.response.as_ref();
        let response_prior = ResponsePrior::of_rig(stated);
        let ceiling = stated.and_then(|s| s.ceiling_levels);
        PoseFitter {
            bare: Arc::new(model.bare()),
            model: Arc::new(model),
            map_errors: Arc::new(map_errors),
            map,
            mounts: rig.mounts,
            heights_m,
            thickness_m: rig.laser.sigma_m,
            sheet: Sheet::AS_THE_RIG,
            camera: Some(response_prior.of_gaussian_line()),
            response_prior,
            ceiling: ceiling.unwrap_or(CEILING).min(CEILING),
        }
    }

    /// The same fitter for a camera of this response.
    pub fn with_response(&self, response: CameraResponse) -> PoseFitter {
        PoseFitter {
            camera: Some(response),
            ..self.clone()
        }
    }

    /// The same with the camera's response each frame's own unknown: each then gives its own estimate of it.
    pub fn with_response_open(&self) -> PoseFitter {
        PoseFitter {
            camera: None,
            ..self.clone()
        }
    }

    /// The prior of the camera's response, and the level from which on it clips light.
    pub fn response_prior(&self) -> (&ResponsePrior, u8) {
        (&self.response_prior, self.ceiling)
    }

    /// The map from image to laser plane.
    pub fn map(&self) -> &dyn PlaneMap {
        self.map.as_ref()
    }

    /// Floor and target.
    pub fn surfaces(&self) -> &Surfaces {
        &self.model.surfaces
    }

    /// Where camera and laser sit.
    pub fn mounts(&self) -> &Mounts {
        &self.mounts
    }

    /// The stripe of a frame sorted into levels, steps to a fraction of a pixel.
    ///
    /// # Errors
    /// [`PoseFault`]: no stripe, too little of it, or another image size.
    pub fn levels(&self, image: &GreyImage, profile: &Profile) -> Result<Levels, PoseFault> {
        if !self.model.table.holds(image) {
            return Err(PoseFault::Size {
                got_px: (image.width_px, image.height_px),
                wanted_px: (self.model.table.width_px, self.model.table.height_px),
            });
        }
        if let Some(fault) = &profile.fault {
            return Err(PoseFault::NoStripe(fault.to_string()));
        }
        let points = segments::plane_points(profile, self.map.as_ref());
        Ok(segments::sort(
            &points,
            &self.heights_m,
            Some(image),
            self.map.as_ref(),
        )?)
    }

    /// The pose of a frame.
    ///
    /// # Errors
    /// [`PoseFault`]: why there is none.
    pub fn fit(
        &self,
        image: &GreyImage,
        profile: &Profile,
        hint: &Hint,
    ) -> Result<JointPose, PoseFault> {
        let levels = self.levels(image, profile)?;
        self.fit_levels(image, profile, &levels, hint)
    }

    /// The pose of a frame whose stripe is already sorted.
    ///
    /// # Errors
    /// [`PoseFault`]: why there is none.
    pub fn fit_levels(
        &self,
        image: &GreyImage,
        profile: &Profile,
        levels: &Levels,
        hint: &Hint,
    ) -> Result<JointPose, PoseFault> {
        let all = initial::guesses(levels, &self.model.surfaces, &self.mounts);
        let starts = self.starts(image, profile, levels, &all, hint)?;
        self.fit_from(image, profile, starts, hint)
    }

    fn fit_from(
        &self,
        image: &GreyImage,
        profile: &Profile,
        mut starts: Starts,
        hint: &Hint,
    ) -> Result<JointPose, PoseFault> {
        for state in &mut starts.states {
            *state = self.sheet.upright(*state);
        }
        let fit = self.fit_upright(image, profile, starts, hint)?;
        Ok(self.sheet.of_body(fit))
    }

    /// The same seen from the frame in which the sheet stands upright.
    fn fit_upright(
        &self,
        image: &GreyImage,
        profile: &Profile,
        starts: Starts,
        hint: &Hint,
    ) -> Result<JointPose, PoseFault> {
        let Starts {
            states,
            bare,
            mut caveats,
        } = starts;
        let picture = &Picture::of(image, profile, self.ceiling);
        let theta = hint.held.theta_rad.is_none();
        if let (true, Some(state)) = (bare, states.first()) {
            let free = self.free([false, false, true, true, false, false], hint);
            // On a bare floor the target's edges are not there to be compared.
            return self.finish(&self.bare, picture, profile, *state, free, caveats);
        }
        let free = self.free([true, true, true, true, theta, true], hint);
        let states = self.choose(picture, profile, states, &free, &mut caveats);
        let (state, fitted) = self.held_to_edges(picture, profile, &states, free, &caveats)?;
        if !theta || fitted.theta_sd_alone_rad < THETA_SHOWN_RAD {
            return Ok(fitted);
        }
        caveats.push(PoseCaveat::PitchHeld);
        let free = self.free([true, true, true, true, false, true], hint);
        let fitted = self.finish(&self.model, picture, profile, state, free, caveats)?;
        Ok(edges_held(fitted))
    }

    /// Of some starts, the likeliest first, that from which the target's edges come to lie where the frame has them.
    fn held_to_edges(
        &self,
        picture: &Picture<'_>,
        profile: &Profile,
        states: &[State],
        free: [bool; PARAMETERS],
        caveats: &[PoseCaveat],
    ) -> Result<(State, JointPose), PoseFault> {
        let mut fault = PoseFault::NotConverged;
        let mut best: Option<(State, JointPose)> = None;
        for (k, state) in states.iter().take(PLACES_MOST).enumerate() {
            let fitted = match self.finish(
                &self.model,
                picture,
                profile,
                *state,
                free,
                caveats.to_vec(),
            ) {
                Ok(fitted) => fitted,
                Err(found) => {
                    if k == 0 {
                        fault = found;
                    }
                    continue;
                }
            };
            if best
                .as_ref()
                .is_none_or(|(_, b)| fitted.edge_model_error < b.edge_model_error)
            {
                best = Some((*state, fitted));
            }
            if best
                .as_ref()
                .is_some_and(|(_, b)| b.edge_model_error < EDGES_SOUND)
            {
                break;
            }
        }
        if let Some((_, off)) = best
            .as_ref()
            .filter(|(_, b)| b.edge_model_error >= EDGES_OFF)
        {
            let off = (off.pose, off.edge_model_error);
            let across = ACROSS_CORNER_M.into_iter().filter_map(|by_m| {
                let x_m = off.0.x_m + by_m;
                let start = states.first()?.at(Pose { x_m, ..off.0 });
                let found =
                    self.finish(&self.model, picture, profile, start, free, caveats.to_vec());
                Some((start, found.ok()?))
            });
            let found = across.min_by(|a, b| a.1.edge_model_error.total_cmp(&b.1.edge_model_error));
            best = found.filter(|(_, f)| f.edge_model_error < off.1).or(best);
        }
        best.map(|(state, fitted)| (state, edges_held(fitted)))
            .ok_or(fault)
    }

    /// The camera's response as far as it is known, for a frame that is clipped from a level on.
    fn response(&self, ceiling: u8) -> Response {
        let known = self
            .camera
            .map_or(self.response_prior.curve(), |c| [c.mean[0], c.mean[1]]);
        Response::new(known, ceiling)
    }

    fn free(&self, pose: [bool; 6], hint: &Hint) -> [bool; PARAMETERS] {
        let mut free = [true; PARAMETERS];
        free[..6].copy_from_slice(&pose);
        free[THICKNESS] = !hint.held.thickness;
        free[photometric::TONE..photometric::LOCAL].fill(self.camera.is_none());
        free
    }
}

/// The same, with the caveat where its edges are not where the target has them.
fn edges_held(mut fitted: JointPose) -> JointPose {
    if fitted.edges_are_off() {
        fitted.caveats.push(PoseCaveat::EdgesOff);
    }
    fitted
}

const _: () = assert!(BRIGHTNESS == 6 && THICKNESS == 7 && BACKGROUND == 8);

#[cfg(test)]
mod tests;

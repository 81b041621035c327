//! Geometry that is only nearly known, refined over the frames of a run.
//!
//! What all frames share: the sheet's tilt (x_b = l_laser + a z_b + b y_b) and its thickness; each
//! frame has its own pose, brightness and background. These are eliminated frame by frame (each is
//! fitted anew under every geometry tried, so that its least cost is a function of the geometry
//! alone), and the sum over the frames is brought to its minimum by Newton's method with central
//! differences. The inverse of its second derivatives is the geometry's covariance.
//!
//! Seen from a body frame turned so that its x axis is the sheet's normal, a tilted sheet is an
//! upright one in front of a camera that sits and looks otherwise: nothing else changes.
//!
//! Not among what is refined, since frames of the target alone do not show it: where the target lies
//! in the tank and how the floor slopes turn and shift all poses together and leave every image as it is.

use super::super::photometric::{
    Choice, Doubts, PARAMETERS, Photometric, Plan, State, THICKNESS, Weighting,
};
use super::super::sheet::SheetTable;
use super::{CUT, Hint, PoseFitter, lit_noise};
use crate::frame::GreyImage;
use crate::pose::initial;
use crate::stripe::Profile;
use hydroline_calib::Pose;
use nalgebra::{Matrix3, Rotation3, Unit, Vector3};
use rayon::prelude::*;
use std::sync::Arc;

/// Fewest frames with a pose.
pub const FRAMES_MIN: usize = 3;
/// Differences by which a geometry is tried at first \[rad\], \[rad\], \[m\].
const TRIED: [f64; 3] = [5e-4, 5e-4, 2e-6];
const ITERATIONS: usize = 8;
/// Way to go, squared, in sds, at which the fit of a frame ends: its cost is right to a thousandth.
const FRAME_SETTLED: f64 = 1e-3;
const FRAME_ITERATIONS: usize = 12;
/// Half of the columns without edges; the poses move little.
const COLUMNS: Choice = Choice {
    step: 1,
    keep: 2,
    room_m: 0.003,
};
/// A step of less than this share of the sd ends it.
const SETTLED_SD: f64 = 0.1;
/// Tilt beyond which the sheet is not nearly where the rig says \[rad\] (6°).
const TILT_MOST_RAD: f64 = 0.1;

/// What the frames of a run share.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Geometry {
    /// a of x_b = l_laser + tan a z_b + tan b y_b \[rad\].
    pub tilt_pitch_rad: f64,
    /// b \[rad\].
    pub tilt_yaw_rad: f64,
    /// The sheet's standard deviation \[m\].
    pub thickness_m: f64,
}

/// Refined geometry.
#[derive(Debug, Clone, PartialEq)]
pub struct Refined {
    /// As found.
    pub geometry: Geometry,
    /// Covariance of the two tilts and the thickness \[rad², m²\].
    pub covariance: Matrix3<f64>,
    /// Mean brightness of the line \[grey levels\], and its standard deviation from frame to frame.
    pub brightness: [f64; 2],
    /// Poses of the frames under it, in their order; `None` where a frame has none.
    pub poses: Vec<Option<Pose>>,
}

/// Why nothing is refined.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum RefineError {
    /// Frames.
    #[error("{frames} frames with a pose, at least {FRAMES_MIN} over the target are needed")]
    TooFew {
        /// Frames with a pose.
        frames: usize,
    },
    /// Newton.
    #[error(
        "the frames do not settle on a geometry: do they show the target, and does the vehicle move over it?"
    )]
    Unsettled,
    /// Far off.
    #[error(
        "the sheet would have to be tilted by more than {:.0} deg: is it the rig's?",
        TILT_MOST_RAD.to_degrees()
    )]
    Tilted,
}

impl Geometry {
    fn moved(self, by: [f64; 3]) -> Self {
        Geometry {
            tilt_pitch_rad: self.tilt_pitch_rad + by[0],
            tilt_yaw_rad: self.tilt_yaw_rad + by[1],
            thickness_m: self.thickness_m + by[2],
        }
    }

    /// From the body to a frame whose x axis is the sheet's normal.
    fn turn(self) -> Rotation3<f64> {
        let (a, b) = (self.tilt_pitch_rad.tan(), self.tilt_yaw_rad.tan());
        let normal = Unit::new_normalize(Vector3::new(1.0, -b, -a));
        Rotation3::rotation_between(&normal, &Vector3::x()).unwrap_or_else(Rotation3::identity)
    }

    /// What pixels see of the tilted sheet, in that frame.
    fn table(self, upright: &SheetTable) -> SheetTable {
        let normal_length =
            (1.0 + self.tilt_pitch_rad.tan().powi(2) + self.tilt_yaw_rad.tan().powi(2)).sqrt();
        upright.turned(&self.turn(), upright.l_laser_m / normal_length)
    }
}

/// The body's pose from that of the turned frame, or back with the inverse.
fn turned(pose: &Pose, turn: &Rotation3<f64>) -> Pose {
    let rotation = Rotation3::from_matrix_unchecked(pose.body_to_tank_rotation()) * turn;
    let (phi_rad, theta_rad, psi_rad) = rotation.euler_angles();
    Pose {
        phi_rad,
        theta_rad,
        psi_rad,
        ..*pose
    }
}

/// A frame with a pose: its place among the frames, and its state with the body's pose.
struct Own {
    index: usize,
    state: State,
}

/// A Newton step, and what it was found from.
struct Step {
    by: [f64; 3],
    covariance: Matrix3<f64>,
}

/// Refines the geometry over frames of a run, each with its hint.
///
/// # Errors
/// [`RefineError`].
pub fn refine(
    fitter: &PoseFitter,
    frames: &[(GreyImage, Profile, Hint)],
) -> Result<Refined, RefineError> {
    let fits: Vec<Option<State>> = frames
        .par_iter()
        .map(|(image, profile, hint)| fitter.begun(image, profile, hint))
        .collect();
    let own = fits.into_iter().enumerate();
    let mut own: Vec<Own> = own
        .filter_map(|(index, state)| {
            Some(Own {
                index,
                state: state?,
            })
        })
        .collect();
    if own.len() < FRAMES_MIN {
        return Err(RefineError::TooFew { frames: own.len() });
    }
    let mut thicknesses_m: Vec<f64> = own.iter().map(|o| o.state.thickness_m).collect();
    thicknesses_m.sort_by(f64::total_cmp);
    let mut geometry = Geometry {
        tilt_pitch_rad: 0.0,
        tilt_yaw_rad: 0.0,
        thickness_m: thicknesses_m[thicknesses_m.len() / 2],
    };
    let mut tried = TRIED;
    for _ in 0..ITERATIONS {
        let step =
            newton(fitter, frames, &mut own, geometry, tried).ok_or(RefineError::Unsettled)?;
        let in_sds = |i: usize| (step.by[i] / step.covariance[(i, i)].sqrt()).abs();
        geometry = geometry.moved(step.by);
        let tilt_rad = geometry
            .tilt_pitch_rad
            .abs()
            .max(geometry.tilt_yaw_rad.abs());
        // NaN is no geometry either.
        let nearly = tilt_rad <= TILT_MOST_RAD && geometry.thickness_m > 0.0;
        if !nearly {
            return Err(RefineError::Tilted);
        }
        // Differences of a few sds next: wider ones see the cost's bends, narrower ones its noise.
        for (i, tried) in tried.iter_mut().enumerate() {
            let sd = step.covariance[(i, i)].sqrt();
            *tried = (4.0 * sd).min(TRIED[i]).max(0.1 * TRIED[i]);
        }
        if (0..3).all(|i| in_sds(i) < SETTLED_SD) {
            return Ok(finished(geometry, step.covariance, &own, frames.len()));
        }
    }
    Err(RefineError::Unsettled)
}

fn finished(geometry: Geometry, covariance: Matrix3<f64>, own: &[Own], frames: usize) -> Refined {
    let n = own.len() as f64;
    let mean = own.iter().map(|o| o.state.brightness).sum::<f64>() / n;
    let square: f64 = own
        .iter()
        .map(|o| (o.state.brightness - mean).powi(2))
        .sum();
    let mut poses = vec![None; frames];
    for o in own {
        if let Some(pose) = poses.get_mut(o.index) {
            *pose = Some(o.state.pose);
        }
    }
    Refined {
        geometry,
        covariance,
        brightness: [mean, (square / (n - 1.0)).sqrt()],
        poses,
    }
}

/// One Newton step from a geometry; the frames' states are brought to it.
fn newton(
    fitter: &PoseFitter,
    frames: &[(GreyImage, Profile, Hint)],
    own: &mut [Own],
    geometry: Geometry,
    sizes: [f64; 3],
) -> Option<Step> {
    // Where it is, a difference on and back along each axis, and on along two axes at once.
    let mut places = vec![[0.0; 3]];
    for i in 0..3 {
        for sign in [1.0, -1.0] {
            let mut by = [0.0; 3];
            by[i] = sign;
            places.push(by);
        }
    }
    const PAIRS: [[usize; 2]; 3] = [[0, 1], [0, 2], [1, 2]];
    for [i, j] in PAIRS {
        let mut by = [0.0; 3];
        (by[i], by[j]) = (1.0, 1.0);
        places.push(by);
    }
    let tried: Vec<(Geometry, Photometric)> = places
        .par_iter()
        .map(|by| {
            let here = geometry.moved(std::array::from_fn(|i| by[i] * sizes[i]));
            (here, fitter.tilted(here))
        })
        .collect();
    let costs: Vec<Option<Vec<f64>>> = own
        .par_iter_mut()
        .map(|own| {
            let (image, profile, _) = frames.get(own.index)?;
            fitter.costs(image, profile, own, &tried)
        })
        .collect();
    let mut sums = vec![0.0; places.len()];
    for costs in costs {
        for (sum, cost) in sums.iter_mut().zip(costs?) {
            *sum += cost;
        }
    }
    // In units of what is tried.
    let (on, back) = (|i: usize| sums[1 + 2 * i], |i: usize| sums[2 + 2 * i]);
    let gradient = Vector3::from_fn(|i, _| 0.5 * (on(i) - back(i)));
    let mut bend = Matrix3::from_fn(|i, j| {
        if i == j {
            on(i) + back(i) - 2.0 * sums[0]
        } else {
            0.0
        }
    });
    for (k, [i, j]) in PAIRS.into_iter().enumerate() {
        let cross = sums[7 + k] - on(i) - on(j) + sums[0];
        (bend[(i, j)], bend[(j, i)]) = (cross, cross);
    }
    let inverse = bend.cholesky()?.inverse();
    let by = -inverse * gradient;
    Some(Step {
        by: std::array::from_fn(|i| by[i] * sizes[i]),
        covariance: Matrix3::from_fn(|i, j| inverse[(i, j)] * sizes[i] * sizes[j]),
    })
}

impl PoseFitter {
    /// Where a frame's fit starts, the place on the target chosen: under a wrong geometry no fit may hold.
    fn begun(&self, image: &GreyImage, profile: &Profile, hint: &Hint) -> Option<State> {
        let levels = self.levels(image, profile).ok()?;
        let all = initial::guesses(&levels, &self.model.surfaces, &self.mounts);
        let starts = self.starts(image, profile, &levels, &all, hint).ok()?;
        if starts.bare {
            return None;
        }
        let free = self.free([true; 6], hint);
        let start = self.choose(image, profile, starts.states, &free, &mut Vec::new())?;
        let plan = self.model.plan(&start, COLUMNS);
        let huber = self.first_weighting(profile);
        let none = &mut Doubts::default();
        let limits = (FRAME_ITERATIONS, FRAME_SETTLED);
        let settled = self.settle(
            &self.model,
            &plan,
            image,
            start,
            &free,
            &huber,
            none,
            limits,
        )?;
        Some(settled.0)
    }

    fn first_weighting(&self, profile: &Profile) -> Weighting {
        Weighting {
            noise_sd: profile.noise_sd.max(0.3),
            cut: 4.0,
            redescending: false,
            saturation: self.saturation,
        }
    }

    /// The model with a tilted sheet, seen from the frame in which it is upright.
    fn tilted(&self, geometry: Geometry) -> Photometric {
        self.model
            .seen_by(Arc::new(geometry.table(&self.model.table)))
    }

    /// Least cost of a frame under each geometry, with the pixels, their noise and the edges' doubts of
    /// the first, to which the frame's state is brought.
    fn costs(
        &self,
        image: &GreyImage,
        profile: &Profile,
        own: &mut Own,
        tried: &[(Geometry, Photometric)],
    ) -> Option<Vec<f64>> {
        let (here, model) = tried.first()?;
        let at = |state: &State, geometry: &Geometry| State {
            pose: turned(&state.pose, &geometry.turn().inverse()),
            thickness_m: geometry.thickness_m,
            ..*state
        };
        let start = at(&own.state, here);
        let plan = model.plan(&start, COLUMNS);
        let huber = self.first_weighting(profile);
        let none = &mut Doubts::default();
        let (near, seen) = self.frame(model, &plan, image, start, &huber, none)?;
        let weighting = Weighting {
            noise_sd: lit_noise(&seen).unwrap_or(huber.noise_sd).max(0.3),
            cut: CUT,
            redescending: true,
            ..huber
        };
        let mut doubts = Doubts::found(&seen.edges, weighting.noise_sd);
        let (state, first) = self.frame(model, &plan, image, near, &weighting, &mut doubts)?;
        own.state = State {
            pose: turned(&state.pose, &here.turn()),
            ..state
        };
        let mut costs = vec![first.cost];
        for (geometry, model) in tried.iter().skip(1) {
            let start = at(&own.state, geometry);
            let (_, sums) = self.frame(model, &plan, image, start, &weighting, &mut doubts)?;
            costs.push(sums.cost);
        }
        Some(costs)
    }

    /// Fits pose, brightness and background of a frame.
    fn frame(
        &self,
        model: &Photometric,
        plan: &Plan,
        image: &GreyImage,
        start: State,
        weighting: &Weighting,
        doubts: &mut Doubts,
    ) -> Option<(State, super::Sums)> {
        let mut free = [true; PARAMETERS];
        free[THICKNESS] = false;
        let limits = (FRAME_ITERATIONS, FRAME_SETTLED);
        self.settle(model, plan, image, start, &free, weighting, doubts, limits)
    }
}

#[cfg(test)]
mod tests;

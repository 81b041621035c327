//! Geometry that is only nearly known, refined over the frames of a run.
//!
//! All frames share the sheet's tilt (x_b = l_laser + a z_b + b y_b) and its thickness; each
//! frame has its own pose, brightness and background. These are eliminated frame by frame (each is
//! fitted anew under every geometry tried, so that its least cost is a function of the geometry
//! alone), and the sum over the frames is brought to its minimum by Newton's method with central
//! differences. The inverse of its second derivatives is the geometry's covariance.
//!
//! Seen from a body frame rotated so that its x axis is the sheet's normal, a tilted sheet is an
//! upright one in front of a camera that sits and looks otherwise: nothing else changes.
//!
//! [`PoseFitter::refined`] then fits single frames under it.
//!
//! Not among what is refined, since frames of the target alone do not show it: where the target lies
//! in the tank and how the floor slopes turn and shift all poses together and leave every image as it is.

use super::super::photometric::{
    Choice, EdgeModelError, PARAMETERS, Photometric, Picture, RunParameters, State, THICKNESS,
    Weighting,
};
use super::super::sheet::SheetTable;
use super::finish::CUT;
use super::lm_loop::{Convergence, lit_noise};
use super::{Hint, PoseFitter};
use crate::initial;
use hydroline_calib::Pose;
use hydroline_core::frame::GreyImage;
use hydroline_numerics::parallel;
use hydroline_stripe::Profile;
use nalgebra::{Matrix3, Rotation3, Unit, Vector3};
use std::sync::Arc;

mod applied;

pub(super) use applied::Sheet;

/// Fewest frames with a pose.
pub const FRAMES_MIN: usize = 3;
/// Differences by which a geometry is tried at first \[rad\], \[rad\], \[m\].
const TRIED: [f64; 3] = [5e-4, 5e-4, 2e-6];
const ITERATIONS: usize = 8;
/// Most iterations of the fit of a frame's own (pose, brightness and background), and the squared Newton decrement, in sds,
/// at which it ends: its cost is right to a thousandth.
const FRAME_LIMITS: (usize, Convergence) = (12, Convergence::All(1e-3));
/// Half of the columns without edges; the poses move little.
const COLUMNS: Choice = Choice {
    step: 1,
    keep: 2,
    room_m: 0.003,
};
/// A step of less than this share of the sd ends it.
const CONVERGED_SD: f64 = 0.1;
/// Tilt beyond which the sheet is not nearly where the rig says \[rad\] (6°).
const TILT_MOST_RAD: f64 = 0.1;

/// Parts of the geometry to refine.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Wanted {
    /// The sheet's tilt, both ways.
    pub tilt: bool,
    /// The sheet's thickness; the brightness, each frame's own, comes with it.
    pub thickness: bool,
}

impl Wanted {
    /// All that frames of a target show.
    pub const ALL: Wanted = Wanted {
        tilt: true,
        thickness: true,
    };

    /// Of the two tilts and the thickness.
    fn axes(self) -> [bool; 3] {
        [self.tilt, self.tilt, self.thickness]
    }
}

/// Geometry of the sheet that the frames of a run share.
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
    /// Parts that were to be refined.
    pub wanted: Wanted,
    /// As found; what was not wanted is as the rig has it.
    pub geometry: Geometry,
    /// Covariance of the two tilts and the thickness \[rad², m²\]; zero where not wanted.
    pub covariance: Matrix3<f64>,
    /// Mean brightness of the line \[grey levels\], and its standard deviation from frame to frame.
    pub brightness: [f64; 2],
    /// Poses of the frames under it, in their order; `None` where a frame has none.
    pub poses: Vec<Option<Pose>>,
}

/// Failure to refine.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[allow(missing_docs)] // Each message names its fields.
pub enum RefineError {
    #[error("{frames} frames with a pose, at least {FRAMES_MIN} over the target are needed")]
    TooFew { frames: usize },
    #[error(
        "the frames do not converge to a geometry: do they show the target, and does the vehicle move over it?"
    )]
    NotConverged,
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

    /// Table of the tilted sheet's points, in that frame.
    fn table(self, upright: &SheetTable) -> SheetTable {
        let normal_length =
            (1.0 + self.tilt_pitch_rad.tan().powi(2) + self.tilt_yaw_rad.tan().powi(2)).sqrt();
        upright.rotated(&self.turn(), upright.l_laser_m / normal_length)
    }
}

/// The body's pose from that of the rotated frame, or back with the inverse.
fn rotated(pose: &Pose, turn: &Rotation3<f64>) -> Pose {
    let rotation = Rotation3::from_matrix_unchecked(pose.body_to_tank_rotation()) * turn;
    let (phi_rad, theta_rad, psi_rad) = rotation.euler_angles();
    Pose {
        phi_rad,
        theta_rad,
        psi_rad,
        ..*pose
    }
}

/// A frame with a pose: its place among the frames, its state with the body's pose, and what of it
/// is free beside what is refined.
struct Own {
    index: usize,
    state: State,
    free: [bool; PARAMETERS],
}

/// A Newton step, and what it was found from.
struct Step {
    by: [f64; 3],
    covariance: Matrix3<f64>,
}

/// Refines the geometry over frames of a run, each with its hint. A frame that has no pose under some
/// geometry on the way is discarded.
pub fn refine(
    fitter: &PoseFitter,
    frames: &[(GreyImage, Profile, Hint)],
    wanted: Wanted,
) -> Result<Refined, RefineError> {
    let axes = wanted.axes();
    let fits = parallel::map_slice(frames, |(image, profile, hint)| {
        fitter.begun(image, profile, hint, wanted)
    });
    let own = fits.into_iter().zip(frames).enumerate();
    let mut own: Vec<Own> = own
        .filter_map(|(index, (state, (_, _, hint)))| {
            let mut free = fitter.free_of(hint);
            free[THICKNESS] = false;
            let state = state?;
            Some(Own { index, state, free })
        })
        .collect();
    enough(&own)?;
    let mut thicknesses_m: Vec<f64> = own.iter().map(|o| o.state.thickness_m).collect();
    thicknesses_m.sort_by(f64::total_cmp);
    let mut geometry = Geometry {
        tilt_pitch_rad: 0.0,
        tilt_yaw_rad: 0.0,
        thickness_m: thicknesses_m[thicknesses_m.len() / 2],
    };
    let mut tried = TRIED;
    for _ in 0..ITERATIONS {
        let step = newton(fitter, frames, &mut own, geometry, tried, axes);
        enough(&own)?;
        let step = step.ok_or(RefineError::NotConverged)?;
        let in_sds = |i: usize| {
            let sd = step.covariance[(i, i)].sqrt();
            if axes[i] {
                (step.by[i] / sd).abs()
            } else {
                0.0
            }
        };
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
        // Differences of a few sds next: wider ones see the cost's higher derivatives, narrower ones its noise.
        for (i, tried) in tried.iter_mut().enumerate() {
            if !axes[i] {
                continue;
            }
            let sd = step.covariance[(i, i)].sqrt();
            *tried = (4.0 * sd).min(TRIED[i]).max(0.1 * TRIED[i]);
        }
        if (0..3).all(|i| in_sds(i) < CONVERGED_SD) {
            let found = Found {
                wanted,
                geometry,
                covariance: step.covariance,
            };
            return Ok(finished(found, &own, frames.len()));
        }
    }
    Err(RefineError::NotConverged)
}

fn enough(own: &[Own]) -> Result<(), RefineError> {
    if own.len() < FRAMES_MIN {
        return Err(RefineError::TooFew { frames: own.len() });
    }
    Ok(())
}

/// Parts that were to be refined, and the geometry found.
struct Found {
    wanted: Wanted,
    geometry: Geometry,
    covariance: Matrix3<f64>,
}

fn finished(found: Found, own: &[Own], frames: usize) -> Refined {
    let Found {
        wanted,
        geometry,
        covariance,
    } = found;
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
        wanted,
        geometry,
        covariance,
        brightness: [mean, (square / (n - 1.0)).sqrt()],
        poses,
    }
}

/// One Newton step from a geometry along some of its axes; the frames' states are brought to it, and
/// frames that cannot be are discarded.
fn newton(
    fitter: &PoseFitter,
    frames: &[(GreyImage, Profile, Hint)],
    own: &mut Vec<Own>,
    geometry: Geometry,
    sizes: [f64; 3],
    axes: [bool; 3],
) -> Option<Step> {
    // Where it is, a difference on and back along each axis, and on along two axes at once.
    let mut places = vec![[0.0; 3]];
    for i in (0..3).filter(|i| axes[*i]) {
        for sign in [1.0, -1.0] {
            let mut by = [0.0; 3];
            by[i] = sign;
            places.push(by);
        }
    }
    const PAIRS: [[usize; 2]; 3] = [[0, 1], [0, 2], [1, 2]];
    for [i, j] in PAIRS.into_iter().filter(|[i, j]| axes[*i] && axes[*j]) {
        let mut by = [0.0; 3];
        (by[i], by[j]) = (1.0, 1.0);
        places.push(by);
    }
    let tried = parallel::map_slice(&places, |by| {
        let here = geometry.moved(std::array::from_fn(|i| by[i] * sizes[i]));
        (here, fitter.tilted(here))
    });
    let costs = parallel::map_owned(own.iter_mut().collect(), |own: &mut Own| {
        let (image, profile, _) = frames.get(own.index)?;
        fitter.costs(image, profile, own, &tried)
    });
    let mut sums = vec![0.0; places.len()];
    let mut kept = costs.iter();
    own.retain(|_| kept.next().is_some_and(Option::is_some));
    for costs in costs.iter().flatten() {
        for (sum, cost) in sums.iter_mut().zip(costs) {
            *sum += cost;
        }
    }
    let at = |by: [f64; 3]| {
        let tried = places.iter().zip(&sums).find(|(place, _)| **place == by);
        tried.map_or(0.0, |(_, sum)| sum - sums[0])
    };
    // In units of what is tried; an axis that is not wanted has a second derivative of one and stays.
    let along = |i: usize, sign: f64| {
        let mut by = [0.0; 3];
        by[i] = sign;
        at(by)
    };
    let gradient = Vector3::from_fn(|i, _| 0.5 * (along(i, 1.0) - along(i, -1.0)));
    let mut hessian = Matrix3::from_fn(|i, j| match (i == j, axes[i]) {
        (true, true) => along(i, 1.0) + along(i, -1.0),
        (true, false) => 1.0,
        _ => 0.0,
    });
    for [i, j] in PAIRS.into_iter().filter(|[i, j]| axes[*i] && axes[*j]) {
        let mut both = [0.0; 3];
        (both[i], both[j]) = (1.0, 1.0);
        let cross = at(both) - along(i, 1.0) - along(j, 1.0);
        (hessian[(i, j)], hessian[(j, i)]) = (cross, cross);
    }
    let inverse = hessian.cholesky()?.inverse();
    let by = -inverse * gradient;
    Some(Step {
        by: std::array::from_fn(|i| by[i] * sizes[i]),
        covariance: Matrix3::from_fn(|i, j| {
            let wanted = axes[i] && axes[j];
            if wanted {
                inverse[(i, j)] * sizes[i] * sizes[j]
            } else {
                0.0
            }
        }),
    })
}

impl PoseFitter {
    /// Where a frame's fit starts, the place on the target chosen: under a wrong geometry no fit may hold.
    fn begun(
        &self,
        image: &GreyImage,
        profile: &Profile,
        hint: &Hint,
        wanted: Wanted,
    ) -> Option<State> {
        let levels = self.levels(image, profile).ok()?;
        let all = initial::guesses(&levels, &self.model.surfaces, &self.mounts);
        let starts = self.starts(image, profile, &levels, &all, hint).ok()?;
        if starts.bare {
            return None;
        }
        let mut free = self.free_of(hint);
        free[THICKNESS] &= wanted.thickness;
        let picture = &Picture::of(image, profile, self.ceiling);
        let places = self.choose(picture, profile, starts.states, &free, &mut Vec::new());
        let start = *places.first()?;
        let plan = self.model.plan(&start, COLUMNS);
        let huber = self.first_weighting(picture, profile);
        let none = &mut EdgeModelError::default();
        let converged = self.converge(
            &self.model,
            &plan,
            picture,
            start,
            &free,
            &huber,
            none,
            FRAME_LIMITS,
        )?;
        Some(converged.0)
    }

    fn first_weighting(&self, picture: &Picture<'_>, profile: &Profile) -> Weighting {
        Weighting {
            noise_sd: profile.noise_sd.max(0.3),
            cut: 4.0,
            redescending: false,
            response: self.response(picture.ceiling),
            run_parameters: RunParameters::Known,
            even: false,
        }
    }

    /// The model with a tilted sheet, seen from the frame in which it is upright.
    fn tilted(&self, geometry: Geometry) -> Photometric {
        self.model
            .seen_by(Arc::new(geometry.table(&self.model.table)))
    }

    /// Least cost of a frame under each geometry, with the pixels, their noise and the edges' model error of
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
            pose: rotated(&state.pose, &geometry.turn().inverse()),
            thickness_m: geometry.thickness_m,
            ..*state
        };
        let start = at(&own.state, here);
        let picture = &Picture::of(image, profile, self.ceiling);
        let plan = model.plan(&start, COLUMNS);
        let huber = self.first_weighting(picture, profile);
        let none = &mut EdgeModelError::default();
        let free = &own.free;
        let (near, seen) = self.converge(
            model,
            &plan,
            picture,
            start,
            free,
            &huber,
            none,
            FRAME_LIMITS,
        )?;
        let weighting = Weighting {
            noise_sd: lit_noise(&seen).unwrap_or(huber.noise_sd).max(0.3),
            cut: CUT,
            redescending: true,
            ..huber
        };
        let mut model_error = EdgeModelError::found_apart(&seen.edges, weighting.noise_sd);
        let (state, first) = self.converge(
            model,
            &plan,
            picture,
            near,
            free,
            &weighting,
            &mut model_error,
            FRAME_LIMITS,
        )?;
        own.state = State {
            pose: rotated(&state.pose, &here.turn()),
            ..state
        };
        let mut costs = vec![first.cost];
        for (geometry, model) in tried.iter().skip(1) {
            let start = at(&own.state, geometry);
            let (_, sums) = self.converge(
                model,
                &plan,
                picture,
                start,
                free,
                &weighting,
                &mut model_error,
                FRAME_LIMITS,
            )?;
            costs.push(sums.cost);
        }
        Some(costs)
    }

    /// Whether each parameter of a frame over its target is free under a hint.
    fn free_of(&self, hint: &Hint) -> [bool; PARAMETERS] {
        let theta = hint.held.theta_rad.is_none();
        self.free([true, true, true, true, theta, true], hint)
    }
}

#[cfg(test)]
mod tests;

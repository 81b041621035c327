//! All six degrees of freedom from one frame.
//!
//! The grey levels along the stripe are compared with [`super::photometric`]'s closed form under
//! the pose, the brightness, the thickness of the sheet and the background, by Gauss–Newton with a
//! robust weight. The covariance is that of the fit with light and thickness free, so the weak
//! direction (δz = l δθ, δx = −H δθ; geometry.md) carries its own large sd.

use super::initial::{self, Guess};
use super::outline::Surfaces;
use super::photometric::{
    self, BACKGROUND, BRIGHTNESS, Choice, Doubts, PARAMETERS, Photometric, Plan, State, Sums,
    THICKNESS, Weighting,
};
use super::segments::{self, Caveat, Levels, SegmentError};
use super::sheet::SheetTable;
use crate::frame::GreyImage;
use crate::stripe::Profile;
use hydroline_calib::Pose;
use hydroline_calib::plane::PlaneMap;
use hydroline_rigs::{Mounts, Rig};
use nalgebra::Matrix6;
use std::sync::Arc;

mod ahead;
mod bound;
pub mod refine;
mod solve;
mod valley;

pub use ahead::Ahead;
pub use bound::Light;
use solve::{covariance, solve};
use valley::Valley;
pub use valley::squared_distance;

/// Largest sd of θ with which a frame counts as having shown it \[rad\] (0.6°).
const THETA_SHOWN_RAD: f64 = 0.01;
/// Guesses are rounded to this before the fit, so that equal guesses give equal bits \[m\], \[rad\].
const ROUND: f64 = 1e-4;
/// Final robust cut in noise sds.
const CUT: f64 = 6.0;
/// Residual per pixel beyond which a fit does not explain the frame.
const MISFIT: f64 = 4.0;
/// Cost by which the best guess must beat a different one: log-likelihood ratio.
const CLEAR_COST: f64 = 12.0;
const ITERATIONS: usize = 14;
/// How often pixels are chosen at most, where a pose leaves the room that they were chosen for.
const PLANS: usize = 4;
/// The squared way to go, in sds, from which one more step is enough without looking at it again:
/// a fit of grey levels comes nearer by a factor of ten at each. What is only a start for the next
/// fit need not come as near.
const SETTLED: f64 = 4.0;
const NEARLY: f64 = 100.0;
const APPROACHED: f64 = 60.0;
/// Of the columns without edges every so many, until the last look.
const FEW: usize = 2;
/// And where only edges and noise are looked at.
const FEWER: usize = 8;
/// Where a step that gains no more than this (a third of an sd) turns out to gain nothing, the rest
/// is kinks of the light at corners.
const KINKS: f64 = 0.1;
/// Places are told apart, and a pose is first settled, on some of the columns.
const TO_CHOOSE: Choice = Choice {
    step: 5,
    keep: 3,
    room_m: 0.003,
};
/// Tops far apart in height offer many places that differ little.
const TO_CHOOSE_TALL: Choice = Choice {
    step: 3,
    keep: 4,
    room_m: 0.003,
};
const TO_APPROACH: Choice = Choice {
    step: 3,
    keep: 2,
    room_m: 0.003,
};
/// After that it moves by its sd.
const TO_FINISH: Choice = Choice {
    room_m: 0.001,
    ..Choice::ALL
};
/// How far from the hint a place on a target without repetitions may lie \[m\], and how many are tried.
const NEAR_M: f64 = 0.06;
const GUESSES_NEAR: usize = 10;
/// Of those with pitch, where tops lie far apart in height.
const GUESSES_ASSIGNED: usize = 60;
/// How many are tried where there is no hint.
const GUESSES_ANYWHERE: usize = 60;
/// A start whose cost is this many times the best one's is none.
const BEHIND: f64 = 3.0;
/// Tops this far apart in height show θ by their edges alone \[m\].
const TALL_M: f64 = 0.05;

/// Of (x, y, z, φ, θ, ψ, thickness).
pub type Matrix7 = nalgebra::SMatrix<f64, 7, 7>;

/// What is known beforehand.
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

/// Why a number is missing or larger in its sd than usual.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum PoseCaveat {
    /// About the stripe.
    #[error(transparent)]
    Stripe(#[from] Caveat),
    /// No target in sight: x, y, ψ are not measured, θ is taken as zero (or as held) and z hangs on it.
    #[error(
        "a bare floor shows z and roll only: x, y and yaw are not measured, z holds for the pitch assumed"
    )]
    BareFloor,
    /// θ taken as known.
    #[error("pitch is not shown by this frame: held, and x and z hold for that pitch")]
    PitchHeld,
    /// The target repeats itself and no hint said which repetition.
    #[error("the target looks the same one hexagon on: x is known up to that, a hint is needed")]
    WhichHexagon,
    /// Two different poses explain the frame about equally well.
    #[error("another pose explains the frame nearly as well")]
    Ambiguous,
    /// Many pixels were set aside.
    #[error(
        "many pixels do not fit and were set aside: particles, haze, or a target that is not the rig's"
    )]
    Misfit,
}

/// The pose of one frame.
#[derive(Debug, Clone, PartialEq)]
pub struct JointPose {
    /// CG in the tank frame.
    pub pose: Pose,
    /// Covariance of (x, y, z, φ, θ, ψ) \[m², rad²\]; meaningful where `measured`.
    pub covariance: Matrix6<f64>,
    /// The same with the thickness \[m\] as seventh: it goes with the weak direction, and is the
    /// same in all frames of a run. Zero where held.
    pub covariance_with_thickness: Matrix7,
    /// Which of x, y, z, φ, θ, ψ the frame determines.
    pub measured: [bool; 6],
    /// Sheet's thickness as fitted \[m\].
    pub thickness_m: f64,
    /// Brightness as fitted \[grey levels\].
    pub brightness: f64,
    /// Background as fitted \[grey levels\].
    pub background: f64,
    /// Pixel noise as found \[grey levels\].
    pub noise_sd: f64,
    /// Share of pixels set aside.
    pub rejected: f64,
    /// Doubt of the edges' pixels as found, share of a pixel cut in half.
    pub edge_doubt: f64,
    /// Pixels compared.
    pub pixels: usize,
    /// What to mind.
    pub caveats: Vec<PoseCaveat>,
}

/// Why a frame gives no pose.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PoseFault {
    /// The stripe.
    #[error("no stripe: {0}")]
    NoStripe(String),
    /// Sorting it.
    #[error(transparent)]
    Segments(#[from] SegmentError),
    /// The image is not the map's.
    #[error(
        "image is {got_px:?}, the calibration holds for {wanted_px:?}: use the camera's own calibration"
    )]
    Size {
        /// Width, height there \[px\].
        got_px: (usize, usize),
        /// Of the map \[px\].
        wanted_px: (usize, usize),
    },
    /// Steps were seen, but not so that they lie on the target.
    #[error(
        "{steps} steps of the stripe lie nowhere on the target: is it the rig's target, and does it lie where the rig says?"
    )]
    Nowhere {
        /// Steps.
        steps: usize,
    },
    /// None near the hint.
    #[error(
        "the steps fit the target only {away_m:.3} m or more from where the vehicle is known to be ({hint_m:.3} m)"
    )]
    FarFromHint {
        /// Nearest place, distance from the hint \[m\].
        away_m: f64,
        /// The hint \[m\].
        hint_m: f64,
    },
    /// The fit does not explain the frame.
    #[error(
        "the best pose leaves {chi:.1} times the noise in the pixels: glare, haze, or another target than the rig's"
    )]
    Unexplained {
        /// Residual over noise, rms.
        chi: f64,
    },
    /// The fit went astray.
    #[error("the fit of the pose did not settle")]
    Unsettled,
}

/// Where a fit starts, and what was found on the way there.
#[derive(Debug, Clone, PartialEq)]
struct Starts {
    states: Vec<State>,
    /// No target in sight.
    bare: bool,
    caveats: Vec<PoseCaveat>,
}

/// Fits poses for one rig. Cheap to clone: the tables are shared.
#[derive(Clone)]
pub struct PoseFitter {
    model: Arc<Photometric>,
    bare: Arc<Photometric>,
    map: Arc<dyn PlaneMap>,
    mounts: Mounts,
    heights_m: Vec<f64>,
    thickness_m: f64,
    saturation: u8,
}

impl PoseFitter {
    /// A fitter for a rig and its map from image to laser plane.
    pub fn new(rig: &Rig, map: Arc<dyn PlaneMap>) -> Self {
        let surfaces = Surfaces::new(rig.target.as_ref());
        let heights_m = surfaces.heights_m();
        let table = Arc::new(SheetTable::new(map.as_ref(), &rig.camera, &rig.mounts));
        let model = Photometric::new(surfaces, table, rig.camera.noise.blur_px, rig.laser.fan_rad);
        PoseFitter {
            bare: Arc::new(model.bare()),
            model: Arc::new(model),
            map,
            mounts: rig.mounts,
            heights_m,
            thickness_m: rig.laser.sigma_m,
            saturation: 254,
        }
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
    /// [`PoseFault`] says why there is none.
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
    /// [`PoseFault`] says why there is none.
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

    /// Where the fit of a frame is to start, and what is to be minded of it: all that a hint decides.
    fn starts(
        &self,
        image: &GreyImage,
        profile: &Profile,
        levels: &Levels,
        all: &[Guess],
        hint: &Hint,
    ) -> Result<Starts, PoseFault> {
        let light = self.first_light(image, profile);
        let mut caveats: Vec<PoseCaveat> = levels
            .caveats
            .iter()
            .filter(|c| **c != Caveat::OneLevel)
            .map(|c| PoseCaveat::from(*c))
            .collect();
        let theta_rad = hint.held.theta_rad.unwrap_or(0.0);
        if levels.steps.is_empty() {
            caveats.retain(|c| *c != PoseCaveat::Stripe(Caveat::EdgeMissing));
            caveats.push(PoseCaveat::BareFloor);
            let state = State {
                pose: initial::level_pose(levels, &self.mounts, theta_rad),
                ..light
            };
            return Ok(Starts {
                states: vec![state],
                bare: true,
                caveats,
            });
        }
        let with_pitch = if hint.held.theta_rad.is_none() && self.tall() {
            let near = hint.x_m.map(|x_m| (x_m, NEAR_M));
            initial::assigned::guesses(levels, &self.model.surfaces, &self.mounts, near)
        } else {
            Vec::new()
        };
        let level = match self.near_hint(levels, all, hint, &mut caveats) {
            // With pitch taken for zero the steps may fit nowhere.
            Err(_) if !with_pitch.is_empty() => Vec::new(),
            found => found?,
        };
        let level = level
            .iter()
            .map(|g| rounded(&g.pose, theta_rad, levels, &self.mounts));
        let with_pitch = with_pitch.iter().take(GUESSES_ASSIGNED);
        let states = level
            .chain(with_pitch.map(|g| to_grid(&g.pose)))
            .map(|pose| State { pose, ..light })
            .collect();
        Ok(Starts {
            states,
            bare: false,
            caveats,
        })
    }

    fn fit_from(
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
        let theta = hint.held.theta_rad.is_none();
        if let (true, Some(state)) = (bare, states.first()) {
            let free = self.free([false, false, true, true, false, false], hint);
            // On a bare floor the target's edges are not there to be compared.
            return self.finish(&self.bare, image, profile, *state, free, caveats);
        }
        let free = self.free([true, true, true, true, theta, true], hint);
        let state = self
            .choose(image, profile, states, &free, &mut caveats)
            .ok_or(PoseFault::Unsettled)?;
        let fitted = self.finish(&self.model, image, profile, state, free, caveats.clone())?;
        if !theta || fitted.covariance[(4, 4)].sqrt() < THETA_SHOWN_RAD {
            return Ok(fitted);
        }
        caveats.push(PoseCaveat::PitchHeld);
        let free = self.free([true, true, true, true, false, true], hint);
        self.finish(&self.model, image, profile, state, free, caveats)
    }

    fn free(&self, pose: [bool; 6], hint: &Hint) -> [bool; PARAMETERS] {
        let mut free = [true; PARAMETERS];
        free[..6].copy_from_slice(&pose);
        free[THICKNESS] = !hint.held.thickness;
        free
    }

    /// Brightness, thickness and background to start from.
    fn first_light(&self, image: &GreyImage, profile: &Profile) -> State {
        let mut peaks: Vec<f64> = profile.points.iter().map(|p| p.peak).collect();
        let middle = peaks.len() / 2;
        let peak = if peaks.is_empty() {
            100.0
        } else {
            *peaks.select_nth_unstable_by(middle, f64::total_cmp).1
        };
        State {
            pose: Pose::default(),
            // The point spread lowers the line by about a tenth.
            brightness: 1.1 * peak,
            thickness_m: self.thickness_m,
            background: segments::background_level(image).max(0.0),
        }
    }

    /// Guesses among which the frame may decide: near the hint, or the first repetition.
    fn near_hint(
        &self,
        levels: &Levels,
        all: &[Guess],
        hint: &Hint,
        caveats: &mut Vec<PoseCaveat>,
    ) -> Result<Vec<Guess>, PoseFault> {
        let Some(best) = all.first() else {
            return Err(PoseFault::Nowhere {
                steps: levels.steps.len(),
            });
        };
        let Some(period_m) = self.model.surfaces.period_m else {
            return self.one_of_a_kind(all, hint);
        };
        let centre_m = match hint.x_m {
            Some(x_m) => x_m,
            None => {
                let repeats =
                    |g: &Guess| ((g.pose.x_m - best.pose.x_m).abs() - period_m).abs() < 0.01;
                if all.iter().any(repeats) {
                    caveats.push(PoseCaveat::WhichHexagon);
                }
                best.pose.x_m
            }
        };
        let away = |g: &Guess| (g.pose.x_m - centre_m).abs();
        let mut near: Vec<Guess> = all
            .iter()
            .copied()
            .filter(|g| away(g) <= 0.5 * period_m)
            .collect();
        if near.is_empty() {
            let away_m = all.iter().map(away).fold(f64::INFINITY, f64::min);
            return Err(PoseFault::FarFromHint {
                away_m,
                hint_m: centre_m,
            });
        }
        near.truncate(4);
        // Where the hint lies half way between two repetitions it decides nothing.
        let margin = 0.42 * period_m;
        if hint.x_m.is_some() && near.iter().all(|g| away(g) > margin) {
            caveats.push(PoseCaveat::WhichHexagon);
        }
        Ok(near)
    }

    /// Guesses on a target that is nowhere like elsewhere: near the hint, or anywhere.
    fn one_of_a_kind(&self, all: &[Guess], hint: &Hint) -> Result<Vec<Guess>, PoseFault> {
        let Some(hint_m) = hint.x_m else {
            return Ok(all.iter().take(GUESSES_ANYWHERE).copied().collect());
        };
        let away = |g: &Guess| (g.pose.x_m - hint_m).abs();
        let near: Vec<Guess> = all.iter().copied().filter(|g| away(g) < NEAR_M).collect();
        if near.is_empty() {
            return Err(PoseFault::FarFromHint {
                away_m: all.iter().map(away).fold(f64::INFINITY, f64::min),
                hint_m,
            });
        }
        Ok(near.into_iter().take(GUESSES_NEAR).collect())
    }

    /// Whether the tops lie so far apart in height that edges alone show θ.
    fn tall(&self) -> bool {
        let heights = || self.model.surfaces.tops.iter().map(|t| t.height_m);
        heights().fold(0.0, f64::max) - heights().fold(f64::INFINITY, f64::min) > TALL_M
    }

    /// Settles every start a little and keeps the best.
    fn choose(
        &self,
        image: &GreyImage,
        profile: &Profile,
        mut starts: Vec<State>,
        free: &[bool; PARAMETERS],
        caveats: &mut Vec<PoseCaveat>,
    ) -> Option<State> {
        if starts.len() < 2 {
            return starts.pop();
        }
        let weighting = Weighting {
            noise_sd: profile.noise_sd.max(1.0),
            cut: 8.0,
            redescending: true,
            saturation: self.saturation,
        };
        // θ is settled later, and cannot tell flanks apart; unless the tops are so far apart in
        // height that a degree moves their edges by millimetres against each other.
        let tall = self.tall();
        let mut held = *free;
        held[4] = free[4] && tall;
        let (choice, tries) = if tall {
            (TO_CHOOSE_TALL, (6, 4e-4))
        } else {
            (TO_CHOOSE, (2, 0.04))
        };
        let huber = Weighting {
            cut: 4.0,
            redescending: false,
            ..weighting
        };
        // A start is judged by the cost that it would come down to if the light were linear in what
        // is free: half the gradient's way (Gauss–Newton) below its own.
        let judged = |start: State| {
            let plan = self.model.plan(&start, choice);
            let none = &mut Doubts::default();
            let sums = self
                .model
                .compare(&plan, &image.pixels, &start, &huber, none, true);
            let turned = Valley::new(&start.pose, &self.mounts).turn(&sums);
            let gain = solve(&turned, &held, 1e-9).map_or(0.0, |s| 0.5 * s.dot(&turned.gradient));
            let least = 0.1 * sums.cost;
            let pixels = sums.pixels.max(1) as f64;
            ((sums.cost - gain).max(least) / pixels, start, plan)
        };
        let mut first: Vec<(f64, State, Plan)> = starts.into_iter().map(judged).collect();
        first.sort_by(|a, b| a.0.total_cmp(&b.0));
        // Near a corner of the hexagons the steps are off by up to a millimetre and so are all
        // guesses: those that do not fall far behind are settled a little before they are compared.
        let limit = first.first().map_or(0.0, |f| BEHIND * f.0);
        first.retain(|f| f.0 <= limit);
        if let [(_, only, _)] = first.as_slice() {
            return Some(*only);
        }
        let mut tried: Vec<(f64, State, f64)> = first
            .into_iter()
            .filter_map(|(_, start, plan)| {
                let none = &mut Doubts::default();
                let (state, _) =
                    self.settle(&self.model, &plan, image, start, &held, &huber, none, tries)?;
                let sums =
                    self.model
                        .compare(&plan, &image.pixels, &state, &weighting, none, false);
                let pixels = sums.pixels.max(1) as f64;
                Some((sums.cost / pixels, state, pixels))
            })
            .collect();
        tried.sort_by(|a, b| a.0.total_cmp(&b.0));
        // Several guesses may have come to the same place: the rival is the best of another one.
        if let Some((best, rest)) = tried.split_first() {
            let elsewhere = |t: &&(f64, State, f64)| (best.1.pose.x_m - t.1.pose.x_m).abs() > 0.002;
            let rival = rest.iter().find(elsewhere);
            if rival
                .is_some_and(|next| (next.0 - best.0) * best.2 * (choice.step as f64) < CLEAR_COST)
            {
                caveats.push(PoseCaveat::Ambiguous);
            }
        }
        tried.first().map(|t| t.1)
    }

    /// The whole fit from a start, with covariance.
    fn finish(
        &self,
        model: &Photometric,
        image: &GreyImage,
        profile: &Profile,
        start: State,
        free: [bool; PARAMETERS],
        mut caveats: Vec<PoseCaveat>,
    ) -> Result<JointPose, PoseFault> {
        let mut weighting = Weighting {
            noise_sd: profile.noise_sd.max(0.3),
            cut: 4.0,
            redescending: false,
            saturation: self.saturation,
        };
        let (state, sums) = self
            .settle_where_planned(
                model,
                TO_APPROACH,
                image,
                start,
                &free,
                &weighting,
                &mut Doubts::default(),
                (6, APPROACHED),
            )
            .ok_or(PoseFault::Unsettled)?;
        // Noise in the lit pixels: dark ones are clipped at zero, and have no shot noise.
        weighting.noise_sd = lit_noise(&sums).unwrap_or(weighting.noise_sd).max(0.3);
        let huber = weighting;
        let mut from = state;
        let mut again = PLANS;
        let (state, sums, edge_doubt) = loop {
            again -= 1;
            let plan = model.plan(&from, TO_FINISH);
            let few = plan.thinned(FEW);
            // How good the edges are, on all of their pixels.
            let none = &mut Doubts::default();
            let edges = plan.thinned(FEWER);
            let seen = model.compare(&edges, &image.pixels, &from, &huber, none, false);
            weighting = Weighting {
                noise_sd: lit_noise(&seen).unwrap_or(huber.noise_sd).max(0.3),
                cut: CUT,
                redescending: true,
                ..huber
            };
            let edge_doubt = seen.edges.doubt(weighting.noise_sd);
            let doubts = &mut Doubts::found(&seen.edges, weighting.noise_sd);
            let mut settle = |plan: &Plan, from: State, settled: f64| {
                let limits = (ITERATIONS, settled);
                self.settle(model, plan, image, from, &free, &weighting, doubts, limits)
                    .ok_or(PoseFault::Unsettled)
            };
            let (near, _) = settle(&few, from, NEARLY)?;
            let (state, sums) = settle(&plan, near, SETTLED)?;
            if again == 0 || self.shift_m(&from.pose, &state.pose) <= TO_FINISH.room_m {
                break (state, sums, edge_doubt);
            }
            from = state;
        };
        let rejected = sums.rejected as f64 / (sums.edge_count + sums.bright_count).max(1) as f64;
        // Relative to the frame's own dark noise the residual says whether the model holds at all.
        let chi = lit_noise(&sums).unwrap_or(0.0) / profile.noise_sd.max(1.0);
        if chi > MISFIT || !sane(&state) {
            return Err(PoseFault::Unexplained { chi });
        }
        if rejected > 0.05 || chi > 0.5 * MISFIT {
            caveats.push(PoseCaveat::Misfit);
        }
        let covariance_with_thickness = covariance(&sums, &free).ok_or(PoseFault::Unsettled)?;
        let mut measured = [false; 6];
        measured.copy_from_slice(&free[..6]);
        Ok(JointPose {
            pose: state.pose,
            covariance: covariance_with_thickness.fixed_view::<6, 6>(0, 0).into(),
            covariance_with_thickness,
            measured,
            thickness_m: state.thickness_m,
            brightness: state.brightness,
            background: state.background,
            noise_sd: weighting.noise_sd,
            rejected,
            edge_doubt,
            pixels: sums.pixels,
            caveats,
        })
    }

    /// [`Self::settle`] with the pixels that the state calls for, chosen anew as long as it leaves the room that they
    /// were chosen for: beyond it edges cut light that the plan takes for whole.
    #[allow(clippy::too_many_arguments)]
    fn settle_where_planned(
        &self,
        model: &Photometric,
        choice: Choice,
        image: &GreyImage,
        start: State,
        free: &[bool; PARAMETERS],
        weighting: &Weighting,
        doubts: &mut Doubts,
        limits: (usize, f64),
    ) -> Option<(State, Sums)> {
        let mut from = start;
        for again in (0..PLANS).rev() {
            let plan = model.plan(&from, choice);
            doubts.forget_pixels();
            let (state, sums) =
                self.settle(model, &plan, image, from, free, weighting, doubts, limits)?;
            if again == 0 || self.shift_m(&from.pose, &state.pose) <= choice.room_m {
                return Some((state, sums));
            }
            from = state;
        }
        None
    }

    /// How far the sheet's line on the floor has moved over the target between two poses, at most \[m\].
    fn shift_m(&self, a: &Pose, b: &Pose) -> f64 {
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

    /// Levenberg–Marquardt on the free parameters, in so many steps at most and so near to the end:
    /// the state, and the sums that near to it.
    #[allow(clippy::too_many_arguments)]
    fn settle(
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
        let mut state = start;
        let mut sums = model.compare(plan, &image.pixels, &state, weighting, doubts, true);
        let mut damping = 1e-9;
        for _ in 0..iterations {
            let valley = Valley::new(&state.pose, &self.mounts);
            let turned = valley.turn(&sums);
            let step = solve(&turned, free, damping)?;
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
            let tried = model.compare(plan, &image.pixels, &next, weighting, doubts, true);
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
}

/// A state that a sheet and a camera can have.
fn sane(state: &State) -> bool {
    let p = &state.pose;
    state.pose.to_array().iter().all(|v| v.is_finite())
        && p.phi_rad.abs() < 0.7
        && p.theta_rad.abs() < 0.7
        && (2e-4..0.02).contains(&state.thickness_m)
        && state.brightness > 1.0
        && state.background > -20.0
}

/// The guess with θ as held; rounded, so that the same place found from two starts gives the same bits.
fn rounded(guess: &Pose, theta_rad: f64, levels: &Levels, mounts: &Mounts) -> Pose {
    let round = |v: f64| (v / ROUND).round() * ROUND;
    let level = initial::level_pose(levels, mounts, theta_rad);
    // With θ ≠ 0 the sheet meets the floor l cos θ + H tan θ … ahead: keep that point.
    let ahead_m = mounts.l_laser_m * (1.0 - theta_rad.cos())
        - (mounts.h_centre_m - levels.eta0_m) * theta_rad.sin();
    Pose {
        x_m: round(guess.x_m + ahead_m * guess.psi_rad.cos()),
        y_m: round(guess.y_m + ahead_m * guess.psi_rad.sin()),
        psi_rad: round(guess.psi_rad),
        ..level
    }
}

/// A pose on the grid that starts are rounded to.
fn to_grid(pose: &Pose) -> Pose {
    Pose::from_array(pose.to_array().map(|v| (v / ROUND).round() * ROUND))
}

/// Noise of the lit pixels away from edges \[grey levels\].
fn lit_noise(sums: &Sums) -> Option<f64> {
    (sums.bright_count > 100)
        .then(|| (sums.bright_square / (sums.bright_count as f64 - 4.0)).sqrt())
}

const _: () =
    assert!(BRIGHTNESS == 6 && THICKNESS == 7 && BACKGROUND == 8 && photometric::PARAMETERS == 9);

#[cfg(test)]
mod tests;

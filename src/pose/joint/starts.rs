//! Where on the target a fit starts: all that a hint decides.

use super::super::initial::{self, Guess};
use super::super::photometric::{ACROSS, State, UNEVEN};
use super::super::segments::{self, Caveat, Levels};
use super::{Hint, PoseCaveat, PoseFault, PoseFitter};
use hydroline_calib::Pose;
use hydroline_core::frame::GreyImage;
use hydroline_rigs::Mounts;
use hydroline_stripe::Profile;

/// Guesses are rounded to this before the fit, so that equal guesses give equal bits \[m\], \[rad\].
const ROUND: f64 = 1e-4;
/// How far from the hint a place on a target without repetitions may lie \[m\], and how many are tried.
const NEAR_M: f64 = 0.06;
const GUESSES_NEAR: usize = 10;
/// Of those with pitch, where upper faces lie far apart in height.
const GUESSES_ASSIGNED: usize = 60;
/// How many are tried where there is no hint.
const GUESSES_ANYWHERE: usize = 60;
/// Farthest that a vehicle is taken to head from the target's line: a line on an upper face is then no longer than this makes it.
const YAW_MOST_RAD: f64 = 0.25 * std::f64::consts::PI;
/// Upper faces this far apart in height show θ by their edges alone \[m\].
const TALL_M: f64 = 0.05;

/// Where a fit starts, and what was found on the way there.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Starts {
    pub states: Vec<State>,
    /// No target in sight.
    pub bare: bool,
    pub caveats: Vec<PoseCaveat>,
}

impl PoseFitter {
    /// Where the fit of a frame is to start, and what is to be minded of it: all that a hint decides.
    pub(super) fn starts(
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
            self.is_floor(levels)?;
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
            .map(|pose| light.at(pose))
            .collect();
        Ok(Starts {
            states,
            bare: false,
            caveats,
        })
    }

    /// Whether a line without a step is longer than any on an upper face of the target.
    fn is_floor(&self, levels: &Levels) -> Result<(), PoseFault> {
        let faces = &self.model.surfaces.faces;
        if faces.is_empty() {
            return Ok(());
        }
        let widest_m = faces
            .iter()
            .fold(0.0_f64, |w, face| w.max(face.outline.width_m()));
        let face_m = widest_m / YAW_MOST_RAD.cos();
        let ends = levels.segments.iter().flat_map(|s| s.xi_m);
        let (low, high) = ends.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| {
            (l.min(v), h.max(v))
        });
        let line_m = (high - low).max(0.0);
        if line_m > face_m {
            Ok(())
        } else {
            Err(PoseFault::FloorOrFace { line_m, face_m })
        }
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
        let response = self.response(u8::MAX);
        let dark = segments::background_level(image).max(0.0);
        let background = response.between(dark);
        State {
            pose: Pose::default(),
            // The point spread lowers the line by about a tenth.
            brightness: 1.1 * (response.between(dark + peak) - background),
            thickness_m: self.thickness_m,
            background,
            tone: response.tone,
            black: response.black,
            across: self.across(),
            uneven: [0.0; UNEVEN],
        }
    }

    /// The line's transverse profile as far as it is known.
    fn across(&self) -> [f64; ACROSS] {
        self.camera.map_or([0.0; ACROSS], |c| c.across())
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

    /// Whether the upper faces lie so far apart in height that edges alone show θ.
    pub(super) fn tall(&self) -> bool {
        let heights = || self.model.surfaces.faces.iter().map(|t| t.height_m);
        heights().fold(0.0, f64::max) - heights().fold(f64::INFINITY, f64::min) > TALL_M
    }
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

#[cfg(test)]
mod tests {
    use super::super::super::segments::Segment;
    use super::*;
    use hydroline_calib::analytic::IdealMap;
    use hydroline_rigs::Rig;
    use std::sync::Arc;

    fn line(half_m: f64) -> Levels {
        Levels {
            eta0_m: 0.0,
            slope: 0.0,
            eta0_sd_m: 1e-4,
            slope_sd: 1e-4,
            rms_m: 1e-4,
            points: 100,
            segments: vec![Segment {
                height_m: 0.0,
                columns_px: [0.0, 100.0],
                xi_m: [half_m, -half_m],
            }],
            steps: Vec::new(),
            caveats: Vec::new(),
        }
    }

    #[test]
    fn a_flat_line_that_an_upper_face_could_hold_is_no_floor() {
        let mut rig = Rig::builtin("lshpi").unwrap();
        let fitter = |rig: &Rig| PoseFitter::new(rig, Arc::new(IdealMap::of(rig)));
        // The board is 0.30 m wide; across it at 45 deg lie 0.42 m.
        assert!(fitter(&rig).is_floor(&line(0.25)).is_ok());
        let Err(PoseFault::FloorOrFace { line_m, face_m }) = fitter(&rig).is_floor(&line(0.2))
        else {
            panic!("0.4 m lie on the board");
        };
        assert!((line_m - 0.4).abs() < 1e-12 && (face_m - 0.3 * 2f64.sqrt()).abs() < 1e-9);
        rig.target = None;
        assert!(fitter(&rig).is_floor(&line(0.01)).is_ok());
    }
}

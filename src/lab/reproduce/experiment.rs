//! One-DOF experiments through rendered frames: motion → images → positions → a run to identify.
//!
//! The vehicle moves by the paper's Eq. 7 (or its like in the other DOFs), disturbances are added to its
//! attitude as the paper adds them (section 3.6.1), every position is rendered, extracted and
//! estimated twice from the same image: by the paper's formula, which takes the other five DOFs as
//! still, and by the joint pose, which does not.

use std::sync::Arc;

use hydroline_calib::IdealMap;
use hydroline_rigs::{Dof, Rig, Vehicle, VehicleModel};
use hydroline_sim::model::{Model, ModelState};
use hydroline_sim::vehicle::Hydrodynamics;
use hydroline_sim::{EffectStack, Pose6, Renderer, Trajectory};
use nalgebra::{Matrix2, Vector2};

use super::ReproduceError;
use hydroline_core::frame::GreyImage;
use hydroline_core::run::{Channel, Command, PerChannel, Run, Sample};
use hydroline_identify::parameter::Coefficient;
use hydroline_pose::Pose;
use hydroline_pose::estimators::{self, Chain, ChainFix, Crossing};
use hydroline_pose::joint::{JointPose, PoseCaveat};
use hydroline_pose::run::{PoseRun, RunPose};
use hydroline_pose::segments::Levels;
use hydroline_stripe::{Extractor, ExtractorConfig};

/// Frames per second, the camera's of the built-in rig.
const RATE_HZ: f64 = 25.0;
/// Grid of the true motion \[s\]: RK4, error far below a micrometre.
const STEP_S: f64 = 0.002;

/// An attitude that swings although the experiment assumes it still:
/// mean + amp·sin(2π t / period + phase), the library's `attitude_disturbance` about a mean.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Swing {
    /// Place in a pose: 3 = φ, 4 = θ, 5 = ψ.
    pub index: usize,
    pub mean_rad: f64,
    pub amp_rad: f64,
    pub period_s: f64,
    pub phase_rad: f64,
}

impl Swing {
    fn at(&self, t_s: f64) -> f64 {
        let turn = std::f64::consts::TAU * t_s / self.period_s + self.phase_rad;
        self.mean_rad + self.amp_rad * turn.sin()
    }
}

/// One run.
#[derive(Debug, Clone)]
pub struct Experiment {
    pub name: String,
    /// DOF that moves.
    pub dof: Dof,
    /// Pose of the CG at rest; in surge ψ is also the direction of the path.
    pub start: Pose,
    /// (time \[s\], load \[N, N m\]), each held until the next.
    pub loads: Vec<(f64, f64)>,
    pub length_s: f64,
    /// Disturbances of the attitude.
    pub swings: Vec<Swing>,
}

/// Results from one run's images, one entry per frame.
#[derive(Debug, Clone, Default)]
pub struct Seen {
    /// Stamps \[s\].
    pub t_s: Vec<f64>,
    /// Displacement in the DOF as it was \[m, rad\].
    pub truth: Vec<f64>,
    /// The paper's estimator; NaN = no answer.
    pub formula: Vec<f64>,
    /// Joint pose; NaN = no answer.
    pub joint: Vec<f64>,
    /// ψ_S as the paper finds it: the mean of ψ_S,i \[rad\]; surge only.
    pub psi_s_rad: Option<f64>,
}

impl Seen {
    /// Errors of one estimator's positions; those without an answer are left out.
    pub fn finite_errors(&self, positions: &[f64]) -> Vec<f64> {
        let errors = positions.iter().zip(&self.truth).map(|(p, t)| p - t);
        errors.filter(|e| e.is_finite()).collect()
    }
}

impl Experiment {
    /// Displacement and pose at every frame.
    fn motion(&self, vehicle: &Vehicle) -> Result<Vec<(f64, f64, Pose)>, ReproduceError> {
        let mut vehicle = vehicle.clone();
        vehicle.model = VehicleModel::Decoupled;
        let model = Model {
            hydrodynamics: Hydrodynamics::new(&vehicle),
            effects: EffectStack::empty(),
        };
        let i = self.dof.index();
        // Roll and pitch have a zero of their own (restoring); the rest only move away from the start.
        let mut path = Trajectory::new(model, ModelState::at_rest([0.0; 6]), STEP_S)?;
        for (t_s, load) in &self.loads {
            path.command(
                *t_s,
                std::array::from_fn(|k| if k == i { *load } else { 0.0 }),
            )?;
        }
        (0..=(self.length_s * RATE_HZ).round() as usize)
            .map(|k| {
                let t_s = k as f64 / RATE_HZ;
                let moved = path.state_at(t_s)?.vehicle.eta[i];
                let mut pose = self.start.to_array();
                if self.dof == Dof::Surge {
                    let (sin, cos) = self.start.psi_rad.sin_cos();
                    pose[0] += moved * cos;
                    pose[1] += moved * sin;
                } else {
                    pose[i] += moved;
                }
                for swing in &self.swings {
                    pose[swing.index] += swing.at(t_s);
                }
                Ok((t_s, moved, Pose::from_array(pose)))
            })
            .collect()
    }

    /// Sees the runs of one experiment, each with noise of its own.
    ///
    /// # Errors
    /// [`ReproduceError`].
    pub fn see_all(runs: &[Experiment], rig: &Rig, seed: u64) -> Result<Vec<Seen>, ReproduceError> {
        let each = runs.iter().zip(1000 * seed..);
        each.map(|(run, own)| run.see(rig, own)).collect()
    }

    /// Renders the run with the noise of `seed` and measures every frame both ways.
    ///
    /// # Errors
    /// [`ReproduceError`].
    pub fn see(&self, rig: &Rig, seed: u64) -> Result<Seen, ReproduceError> {
        let mut rig = rig.clone();
        rig.camera.seed = seed;
        rig.tank.start_pose = self.start.to_array();
        let renderer = Renderer::new(&rig)?;
        let mut eye = Eye::new(&rig, self);
        let mut seen = Seen::default();
        let mut image = GreyImage {
            width_px: renderer.width_px(),
            height_px: renderer.height_px(),
            pixels: vec![0; renderer.width_px() * renderer.height_px()],
        };
        for (index, (t_s, moved, pose)) in self.motion(&rig.vehicle)?.into_iter().enumerate() {
            renderer.render_into(
                &Pose6::from(pose.to_array()),
                index as u64,
                &mut image.pixels,
            );
            eye.look((t_s * 1e9) as u64, &image);
            seen.t_s.push(t_s);
            seen.truth.push(moved);
        }
        seen.joint = eye.joint_positions();
        (seen.formula, seen.psi_s_rad) = eye.formula_positions();
        Ok(seen)
    }

    /// The commands and one of the two series as a run to identify.
    pub fn run(&self, seen: &Seen, positions: &[f64]) -> Run {
        let i = self.dof.index();
        let only =
            |v: f64| PerChannel::from_fn(|c| if c == Channel::POSES[i] { v } else { f64::NAN });
        Run {
            name: self.name.clone(),
            commands: self
                .loads
                .iter()
                .map(|(t_s, load)| Command {
                    t_s: *t_s,
                    wrench: std::array::from_fn(|k| if k == i { *load } else { 0.0 }),
                })
                .collect(),
            samples: seen
                .t_s
                .iter()
                .zip(positions)
                .filter(|(_, v)| v.is_finite())
                .map(|(t_s, v)| Sample {
                    t_s: *t_s,
                    values: only(*v),
                    covariance: None,
                })
                .collect(),
            ..Run::default()
        }
    }
}

/// A rig that knows its own coefficients 30 % wrongly: where a search may start from in a tank.
pub fn guess_of(rig: &Rig) -> Rig {
    let mut guess = rig.clone();
    guess.vehicle.model = VehicleModel::Decoupled;
    for (k, c) in Dof::ALL.into_iter().flat_map(Coefficient::of).enumerate() {
        let wrong = if k % 2 == 0 { 1.3 } else { 0.7 };
        c.put(&mut guess.vehicle, wrong * c.of_vehicle(&rig.vehicle));
    }
    guess
}

/// Both estimators on the frames of one run, as they come. What of a frame a formula uses is kept,
/// since ψ_S is known only when the run is over.
struct Eye {
    dof: Dof,
    run: PoseRun,
    extractor: Extractor,
    chain: Option<Chain>,
    heights_m: Vec<f64>,
    eta_level_m: f64,
    /// Place that is meant of those that fit l and r: X_S and ψ_S to within centimetres and degrees,
    /// from the start, then from where the vehicle was seen last. Near a joint the formula alone cannot
    /// tell a place from its mirror image.
    near: (f64, f64),
    ahead_m: f64,
    levels: Vec<Option<Levels>>,
    crossings: Vec<Option<Crossing>>,
    fixes: Vec<Option<ChainFix>>,
    poses: Vec<Option<JointPose>>,
}

impl Eye {
    fn new(rig: &Rig, experiment: &Experiment) -> Self {
        let run = PoseRun::new(rig, Arc::new(IdealMap::of(rig)));
        let start = experiment.start;
        let ahead_m = rig.mounts.l_laser_m;
        Eye {
            dof: experiment.dof,
            heights_m: run.fitter().surfaces().heights_m(),
            run,
            extractor: Extractor::new(ExtractorConfig::default()),
            chain: rig.target.as_ref().and_then(Chain::new),
            // Eq. 5's level line: H = h_centre − η_level, at the start's height.
            eta_level_m: rig.mounts.h_centre_m + start.z_m,
            near: crossing_of(&start, ahead_m),
            ahead_m,
            levels: Vec::new(),
            crossings: Vec::new(),
            fixes: Vec::new(),
            poses: Vec::new(),
        }
    }

    fn look(&mut self, stamp_ns: u64, image: &GreyImage) {
        let profile = self.extractor.extract(image);
        let levels = self.run.fitter().levels(image, &profile).ok();
        let crossing = levels.as_ref().map(|l| Crossing::new(l, &self.heights_m));
        let pose = match self.run.pose(stamp_ns, image, &profile) {
            RunPose::Good(fit) => {
                self.near = crossing_of(&fit.pose, self.ahead_m);
                Some(*fit)
            }
            // The choice of the hexagon moves x by whole hexagons and nothing else.
            RunPose::Flagged(fit) if self.dof != Dof::Surge && only_which_hexagon(&fit) => {
                Some(*fit)
            }
            RunPose::Flagged(_) | RunPose::None(_) => None,
        };
        let fix = self
            .chain
            .as_ref()
            .zip(crossing.as_ref())
            .and_then(|(chain, c)| chain.fix(c, self.near).ok());
        self.levels.push(levels);
        self.crossings.push(crossing);
        self.fixes.push(fix);
        self.poses.push(pose);
    }

    /// The DOF's displacement by the paper's formula, and ψ_S in surge.
    fn formula_positions(&self) -> (Vec<f64>, Option<f64>) {
        let or_nan = |v: Option<f64>| v.unwrap_or(f64::NAN);
        if self.dof == Dof::Surge {
            let Some(chain) = &self.chain else {
                return (vec![f64::NAN; self.levels.len()], None);
            };
            let (psi_s_rad, places) =
                estimators::surge_positions(chain, &self.crossings, &self.fixes);
            return (places.into_iter().map(or_nan).collect(), Some(psi_s_rad));
        }
        let first_levels = self.levels.iter().flatten().next();
        let first_crossing = self.crossings.iter().flatten().next();
        let first_fix = self.fixes.iter().flatten().next();
        let value = |k: usize| -> Option<f64> {
            let levels = self.levels[k].as_ref()?;
            match self.dof {
                Dof::Surge => None,
                Dof::Sway => {
                    let found = estimators::sway_m(self.crossings[k].as_ref()?, first_crossing?);
                    Some(found.ok()?.value)
                }
                Dof::Heave => Some(estimators::heave_m(levels, first_levels?).value),
                Dof::Roll => Some(estimators::roll_rad(levels).value),
                Dof::Pitch => {
                    let mounts = self.run.fitter().mounts();
                    let found = estimators::pitch_rad(levels, self.eta_level_m, mounts);
                    Some(found.ok()?.value)
                }
                Dof::Yaw => Some(estimators::yaw_rad(self.fixes[k].as_ref()?, first_fix?)),
            }
        };
        (
            (0..self.levels.len()).map(|k| or_nan(value(k))).collect(),
            None,
        )
    }

    /// The DOF's coordinate of the joint pose; in surge the way along the track, whose direction is
    /// that of the positions themselves: the heading may swing, the path does not.
    fn joint_positions(&self) -> Vec<f64> {
        let i = self.dof.index();
        let coordinate = |p: &JointPose, c: usize| {
            if p.measured[c] {
                p.pose.to_array()[c]
            } else {
                f64::NAN
            }
        };
        let each = |f: &dyn Fn(&JointPose) -> f64| -> Vec<f64> {
            let poses = self.poses.iter();
            poses.map(|p| p.as_ref().map_or(f64::NAN, f)).collect()
        };
        let of = |c: usize| each(&|p| coordinate(p, c));
        if self.dof == Dof::Surge {
            one_sheet(
                &along_track(&of(0), &of(1)),
                &each(&|p| p.thickness_m),
                &each(&|p| p.brightness),
            )
        } else {
            of(i)
        }
    }
}

/// Whether nothing else is wrong with a pose that should not be used.
fn only_which_hexagon(fit: &JointPose) -> bool {
    !fit.caveats
        .iter()
        .any(|c| matches!(c, PoseCaveat::Ambiguous | PoseCaveat::Misfit))
}

/// Positions under one thickness and one brightness for the whole run.
///
/// Every frame fits both anew, and what it gets wrong there it gets wrong in x too: near θ = 0 the stripe's
/// thickness is what fixes the weak direction. A laser has one sheet, so their deviations from the run's
/// means are errors, and the part of the position's error that goes with them comes off:
/// x − β·(thickness, brightness − mean). β is the regression of third differences, in which the
/// motion itself (smooth over four frames) drops out.
fn one_sheet(position: &[f64], thickness_m: &[f64], brightness: &[f64]) -> Vec<f64> {
    let about_mean = |v: &[f64]| -> Vec<f64> {
        let (sum, n) = v
            .iter()
            .filter(|x| x.is_finite())
            .fold((0.0, 0usize), |(s, n), x| (s + x, n + 1));
        let mean = sum / n.max(1) as f64;
        v.iter().map(|x| x - mean).collect()
    };
    let third = |v: &[f64]| -> Vec<f64> {
        v.windows(4)
            .map(|w| w[3] - 3.0 * w[2] + 3.0 * w[1] - w[0])
            .collect()
    };
    let (t, b) = (about_mean(thickness_m), about_mean(brightness));
    let (dx, dt, db) = (third(position), third(&t), third(&b));
    let mut normal = Matrix2::zeros();
    let mut right = Vector2::zeros();
    for ((x, t), b) in dx.iter().zip(&dt).zip(&db) {
        // Thickness in tenths of a millimetre: a sum of squares of its own size.
        let j = Vector2::new(t * 1e4, *b);
        if x.is_finite() && j.iter().all(|v| v.is_finite()) {
            normal += j * j.transpose();
            right += j * *x;
        }
    }
    let Some(beta) = normal.cholesky().map(|c| c.solve(&right)) else {
        return position.to_vec();
    };
    position
        .iter()
        .zip(t.iter().zip(&b))
        .map(|(x, (t, b))| x - beta.x * t * 1e4 - beta.y * b)
        .collect()
}

/// (X_S, ψ_S): where the sheet's middle meets the floor, carried along the stripe to the centre line.
fn crossing_of(pose: &Pose, ahead_m: f64) -> (f64, f64) {
    // θ swings the sheet about the CG: H tan θ farther on.
    let reach_m = ahead_m * pose.theta_rad.cos() - pose.z_m * pose.theta_rad.tan();
    let (sin, cos) = pose.psi_rad.sin_cos();
    let (x_m, y_m) = (pose.x_m + reach_m * cos, pose.y_m + reach_m * sin);
    (x_m + y_m * pose.psi_rad.tan(), pose.psi_rad)
}

/// Way along the straight line that fits the positions best (smallest squares across it).
fn along_track(x_m: &[f64], y_m: &[f64]) -> Vec<f64> {
    let both: Vec<(f64, f64)> = x_m
        .iter()
        .zip(y_m)
        .filter(|(x, y)| x.is_finite() && y.is_finite())
        .map(|(x, y)| (*x, *y))
        .collect();
    let n = both.len().max(1) as f64;
    let (mx, my) = (
        both.iter().map(|p| p.0).sum::<f64>() / n,
        both.iter().map(|p| p.1).sum::<f64>() / n,
    );
    let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
    for (x, y) in &both {
        xx += (x - mx) * (x - mx);
        xy += (x - mx) * (y - my);
        yy += (y - my) * (y - my);
    }
    // Principal axis of the scatter, taken in the direction of travel.
    let mut angle = 0.5 * (2.0 * xy).atan2(xx - yy);
    let travelled = both.first().zip(both.last()).map_or(0.0, |(a, b)| {
        (b.0 - a.0) * angle.cos() + (b.1 - a.1) * angle.sin()
    });
    if travelled < 0.0 {
        angle += std::f64::consts::PI;
    }
    x_m.iter()
        .zip(y_m)
        .map(|(x, y)| x * angle.cos() + y * angle.sin())
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{SeedableRng, rngs::StdRng};
    use rand_distr::{Distribution, StandardNormal};

    #[test]
    fn errors_that_come_with_the_sheets_thickness_come_off_and_the_motion_stays() {
        let mut rng = StdRng::seed_from_u64(5);
        let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
        let (mut x, mut thickness, mut bright, mut truth) = (vec![], vec![], vec![], vec![]);
        for k in 0..400 {
            let t_s = 0.04 * f64::from(k);
            truth.push(0.006 * t_s * t_s);
            let (d, e) = (2e-5 * normal(), 0.5 * normal());
            x.push(truth[truth.len() - 1] + 25.0 * d - 4e-4 * e + 1e-4 * normal());
            thickness.push(2e-3 + d);
            bright.push(200.0 + e);
        }
        x[100] = f64::NAN;
        thickness[100] = f64::NAN;
        bright[100] = f64::NAN;
        let bound = one_sheet(&x, &thickness, &bright);
        assert!(bound[100].is_nan());
        let rms = |v: &[f64]| {
            let e: Vec<f64> = v
                .iter()
                .zip(&truth)
                .map(|(a, b)| a - b)
                .filter(|e| e.is_finite())
                .collect();
            let mean = e.iter().sum::<f64>() / e.len() as f64;
            (e.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / e.len() as f64).sqrt()
        };
        assert!(
            rms(&x) > 4e-4 && rms(&bound) < 1.2e-4,
            "{} {}",
            rms(&x),
            rms(&bound)
        );
    }

    #[test]
    fn the_place_of_a_crossing_follows_pitch_and_yaw() {
        let pose = Pose {
            x_m: 0.3,
            y_m: 0.02,
            z_m: -0.8,
            theta_rad: 0.03,
            psi_rad: -0.07,
            ..Pose::default()
        };
        let (x_m, psi) = crossing_of(&pose, 0.27);
        // By the pose's own rotation: along the sheet's middle down to the floor, then along the stripe.
        let floor = (0..2000)
            .map(|k| pose.body_to_tank(&nalgebra::Vector3::new(0.27, 0.0, 5e-4 * f64::from(k))))
            .min_by(|a, b| a.z.abs().total_cmp(&b.z.abs()))
            .unwrap();
        let by_hand = floor.x + floor.y * (-0.07_f64).tan();
        assert!(
            (x_m - by_hand).abs() < 1e-3 && psi == -0.07,
            "{x_m} {by_hand}"
        );
    }

    #[test]
    fn a_track_is_measured_along_itself_in_the_direction_of_travel() {
        for degrees in [-4.0_f64, 170.0, 91.0] {
            let (sin, cos) = degrees.to_radians().sin_cos();
            let (mut x, mut y): (Vec<f64>, Vec<f64>) = (0..50)
                .map(|k| 0.02 * f64::from(k))
                .map(|s| (0.3 + s * cos, -0.1 + s * sin))
                .unzip();
            (x[7], y[7]) = (f64::NAN, f64::NAN);
            let along = along_track(&x, &y);
            assert!(along[7].is_nan());
            assert!((along[49] - along[0] - 0.98).abs() < 1e-12, "{degrees}");
        }
    }
}

//! Motion of a vehicle between frames: the rig's own motion, its coefficients uncertain, and a
//! disturbance whose size and correlation time the data decide.
//!
//! Per run and DOF the pose at the frames' stamps is normal about what the rig's model does with
//! the logged commands, with covariance
//!
//! K = a² 1 + Σ s² b bᵀ + w² exp(−|Δt|/τ) + q (spline of accelerations)
//!
//! b: a constant, the derivatives to the DOF's coefficients, the shift in time that any latency is.
//! Without this a stretched target would only shift x, and a sloping floor only z and θ.

use super::evidence::precision;
use super::fit::UNIT;
use super::observe::ImageRun;
use hydroline_identify::parameter::Coefficient;
use hydroline_rigs::{Dof, Rig, Wrench};
use hydroline_sim::{SimError, World};
use nalgebra::{DMatrix, DVector};
use std::collections::HashMap;
use std::sync::{Arc, RwLock};

/// Floor of the prior sd of any DOF: far below what frames can show \[m\], \[rad\].
const SMALLEST_SD: f64 = 2e-6;
/// Where a run starts, standard deviations: x may be a hexagon off, z and the attitude are set by hand.
const START_SD: [f64; 6] = [0.3, 0.05, 0.02, 0.02, 0.005, 0.1];
/// Share by which a coefficient may be off.
const COEFFICIENT_SD: f64 = 0.25;
/// Shift in time that may be there \[s\].
const SHIFT_SD_S: f64 = 0.1;
/// The path's direction against the rig's \[rad\].
const HEADING_SD: f64 = 0.1;

/// Disturbance of one DOF, as the data decide it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MotionPrior {
    /// Standard deviation \[m\], \[rad\].
    pub sd: f64,
    /// Correlation time \[s\].
    pub tau_s: f64,
    /// Intensity of unmodelled acceleration \[m²/s³\]; used where the DOF is driven.
    pub drive: f64,
}

/// MotionPriors of the six DOFs.
pub type MotionPriors = [MotionPrior; 6];

/// Where a search for them starts.
pub const FIRST: MotionPriors = {
    // Wide, so that a first guess far off is given up.
    let position = MotionPrior {
        sd: 0.03,
        tau_s: 2.0,
        drive: 1e-7,
    };
    let angle = MotionPrior {
        sd: 0.1,
        tau_s: 2.0,
        drive: 1e-7,
    };
    [position, position, position, angle, angle, angle]
};

/// Prior of one run.
#[derive(Debug, Clone)]
pub struct Motion {
    times_s: Vec<f64>,
    /// Pose by the rig's model, per frame.
    pub mean: Vec<[f64; 6]>,
    /// Per DOF: regressors with their spread already in them.
    regressors: [Vec<DVector<f64>>; 6],
    /// DOFs that commands drive.
    pub driven: [bool; 6],
    /// Precisions asked for before, by DOF and motion prior: fits walk the same few steps of each number.
    asked: Arc<RwLock<HashMap<Asked, Arc<Precision>>>>,
}

/// A DOF and the bits of its motion prior.
type Asked = (usize, [u64; 3]);

/// Inverse of a DOF's covariance in the fit's units, and half the covariance's log determinant.
pub type Precision = (DMatrix<f64>, f64);

/// Numbers kept of precisions at most, per run: 64 MB.
const KEPT: usize = 8_000_000;

impl Motion {
    /// From the rig's model and the log's commands.
    ///
    /// # Errors
    /// [`SimError`] where the rig's model cannot be run.
    pub fn new(run: &ImageRun, rig: &Rig) -> Result<Self, SimError> {
        let times_s: Vec<f64> = run.frames.iter().map(|f| f.t_s).collect();
        let end_s = times_s.last().copied().unwrap_or(0.0);
        let loaded: [bool; 6] = std::array::from_fn(|d| {
            run.commands
                .iter()
                .any(|c| c.t_s <= end_s && c.wrench[d].abs() > 1e-9)
        });
        let mean = path(run, rig, &times_s, 0.0)?;
        let mut regressors: [Vec<DVector<f64>>; 6] =
            std::array::from_fn(|d| vec![DVector::from_element(times_s.len(), START_SD[d])]);
        let mut driven = loaded;
        if loaded.iter().any(|l| *l) {
            let later = path(run, rig, &times_s, SHIFT_SD_S)?;
            push(&mut regressors, &mean, &later);
            for dof in Dof::ALL.into_iter().filter(|d| loaded[d.index()]) {
                for coefficient in Coefficient::of(dof) {
                    let mut other = rig.clone();
                    let value = coefficient.of_vehicle(&rig.vehicle);
                    coefficient.put(&mut other.vehicle, value * (1.0 + COEFFICIENT_SD));
                    push(&mut regressors, &mean, &path(run, &other, &times_s, 0.0)?);
                }
            }
            let ahead = mean.iter().map(|m| HEADING_SD * (m[0] - mean[0][0]));
            regressors[1].push(DVector::from_iterator(times_s.len(), ahead));
            // Driven along a heading of its own the vehicle sways too.
            driven[1] |= loaded[0];
        }
        Ok(Motion {
            times_s,
            mean,
            regressors,
            driven,
            asked: Arc::default(),
        })
    }

    /// Number of frames.
    pub fn frames(&self) -> usize {
        self.times_s.len()
    }

    /// Precision of a DOF in the fit's units; `None` where the covariance is none.
    pub fn precision(&self, dof: usize, motion_prior: &MotionPrior) -> Option<Arc<Precision>> {
        let key = (
            dof,
            [motion_prior.sd, motion_prior.tau_s, motion_prior.drive].map(f64::to_bits),
        );
        if let Ok(asked) = self.asked.read()
            && let Some(known) = asked.get(&key)
        {
            return Some(Arc::clone(known));
        }
        let found = Arc::new(precision(
            self.covariance(dof, motion_prior) / (UNIT * UNIT),
        )?);
        if let Ok(mut asked) = self.asked.write()
            && asked.len() * self.frames().pow(2) < KEPT
        {
            asked.insert(key, Arc::clone(&found));
        }
        Some(found)
    }

    /// Covariance of a DOF \[m²\], \[rad²\].
    fn covariance(&self, dof: usize, motion_prior: &MotionPrior) -> DMatrix<f64> {
        let n = self.times_s.len();
        let start_s = self.times_s.first().copied().unwrap_or(0.0);
        let mut k = DMatrix::from_fn(n, n, |i, j| {
            let (a, b) = (self.times_s[i], self.times_s[j]);
            let mut v =
                motion_prior.sd * motion_prior.sd * (-(a - b).abs() / motion_prior.tau_s).exp();
            if self.driven[dof] {
                // Twice integrated white noise (Wahba 1978): t²(3T − t)/6, t the earlier.
                let (early, late) = (a.min(b) - start_s, a.max(b) - start_s);
                v += motion_prior.drive * early * early * (3.0 * late - early) / 6.0;
            }
            if i == j {
                v + SMALLEST_SD * SMALLEST_SD
            } else {
                v
            }
        });
        for b in &self.regressors[dof] {
            k.ger(1.0, b, b, 1.0);
        }
        k
    }
}

fn push(into: &mut [Vec<DVector<f64>>; 6], mean: &[[f64; 6]], other: &[[f64; 6]]) {
    for (d, regressors) in into.iter_mut().enumerate() {
        let change =
            DVector::from_iterator(mean.len(), mean.iter().zip(other).map(|(a, b)| b[d] - a[d]));
        if change.amax() > 1e-9 {
            regressors.push(change);
        }
    }
}

/// The rig's motion under the run's commands, `late_s` later.
fn path(
    run: &ImageRun,
    rig: &Rig,
    times_s: &[f64],
    late_s: f64,
) -> Result<Vec<[f64; 6]>, SimError> {
    let mut world = World::new(rig, rig.tank.start_pose)?;
    let mut next = 0;
    let mut out = Vec::with_capacity(times_s.len());
    for t_s in times_s {
        while let Some(c) = run.commands.get(next).filter(|c| c.t_s + late_s <= *t_s) {
            world.command(c.t_s + late_s, &Wrench::from_array(c.wrench))?;
            next += 1;
        }
        out.push(world.state_at(*t_s)?.eta);
    }
    Ok(out)
}

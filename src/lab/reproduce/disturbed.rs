//! Tables 4 and 5: what another motion does to a formula; and what joint pose makes of all at once.

use super::chain::{Bench, Reading, Seen};
use super::{Motion, ReproduceError};
use hydroline_pose::Pose;
use hydroline_pose::joint::{Held, Light, squared_distance};
use hydroline_rigs::{Rig, Target};
use rand::{RngExt, SeedableRng, rngs::StdRng};
use serde::Serialize;

/// One cell of Table 4 or 5.
#[derive(Debug, Clone, PartialEq, Serialize, schemars::JsonSchema)]
pub struct Disturbed {
    /// Motion that the formula measures.
    pub motion: Motion,
    /// Motion that disturbs it.
    pub by: Motion,
    /// Its range, mm or degrees.
    pub from_to: [f64; 2],
    /// The paper's words; `None` where its text is lost.
    pub paper: Option<&'static str>,
    /// Condition on top of the disturbance.
    pub condition: &'static str,
    /// Largest change of the formula's result, mm or degrees.
    pub ours: f64,
    /// Its unit.
    pub unit: &'static str,
    /// Frames without an answer.
    pub missing: usize,
}

/// Joint pose under all disturbances at once.
#[derive(Debug, Clone, Default, PartialEq, Serialize, schemars::JsonSchema)]
pub struct JointAccuracy {
    /// Number of frames.
    pub frames: usize,
    /// Frames without a pose.
    pub failed: usize,
    /// x, y, z \[mm\], φ, θ, ψ \[°\].
    pub rms: [f64; 6],
    /// Reported standard deviations, rms.
    pub reported_sd: [f64; 6],
    /// Cramér–Rao bound with thickness and brightness free, rms.
    pub bound: [f64; 6],
    /// Largest error in units of its own reported sd.
    pub worst_in_sd: f64,
    /// Share of frames whose error lies in the 95 % region of its covariance.
    pub covered_95: f64,
    /// Share of frames whose error in each degree of freedom lies within 1.96 of its own reported sd.
    pub covered_95_each: [f64; 6],
}

/// Formula, disturbance, extra (index, degrees) and its words, the paper's entry.
type Cell = (
    Motion,
    Motion,
    Option<(usize, f64)>,
    &'static str,
    Option<&'static str>,
);

const CELLS: [Cell; 30] = {
    use Motion::{Heave, Pitch, Roll, Surge, Sway, Yaw};
    [
        (Surge, Sway, Some((5, 5.0)), "yaw 5 deg", Some("2.9 mm")),
        (Surge, Heave, Some((4, 1.0)), "pitch 1 deg", Some("0.5 mm")),
        (Surge, Roll, None, "", Some("1.5 mm")),
        (Surge, Pitch, None, "", Some("15 mm")),
        (Surge, Yaw, None, "Y_S = 0, psi_S = 0", Some("2 mm")),
        (Sway, Surge, Some((5, 5.0)), "psi_S 5 deg", Some("0.9 mm")),
        (Sway, Heave, None, "", Some("no effect")),
        (Sway, Roll, None, "", Some("15 mm")),
        (Sway, Pitch, Some((5, 5.0)), "psi_S 5 deg", Some("1.5 mm")),
        (Sway, Yaw, None, "", Some("23 mm")),
        (Heave, Surge, None, "", None),
        (Heave, Sway, None, "", None),
        (Heave, Roll, None, "", None),
        (Heave, Pitch, None, "", None),
        (Heave, Yaw, None, "", None),
        (Roll, Surge, None, "", None),
        (Roll, Sway, None, "", None),
        (Roll, Heave, None, "", None),
        (Roll, Pitch, None, "", None),
        (Roll, Yaw, None, "", None),
        (Pitch, Surge, None, "", Some("no effect")),
        (Pitch, Sway, None, "", Some("no effect")),
        (Pitch, Heave, None, "", Some("Figure 12")),
        (Pitch, Roll, None, "", Some("0.5 deg")),
        (Pitch, Yaw, None, "", Some("no effect")),
        (Yaw, Surge, None, "", Some("no effect")),
        (Yaw, Sway, None, "", Some("no effect")),
        (Yaw, Heave, None, "", None),
        (Yaw, Roll, None, "", Some("1.1 deg")),
        (Yaw, Pitch, None, "", Some("no effect")),
    ]
};

/// Computes the cells of Table 4 (surge, sway, heave) or 5 (roll, pitch, yaw).
///
/// # Errors
/// [`ReproduceError`].
pub fn disturbed(table5: bool) -> Result<Vec<Disturbed>, ReproduceError> {
    CELLS
        .iter()
        .filter(|c| (c.0.index() >= 3) == table5)
        .map(cell)
        .collect()
}

fn cell(&(motion, by, extra, condition, paper): &Cell) -> Result<Disturbed, ReproduceError> {
    let bench = Bench::of(motion)?;
    let (low, high) = match by {
        Motion::Surge | Motion::Sway | Motion::Heave => (-10.0, 10.0),
        Motion::Roll | Motion::Pitch => (-1.0, 1.0),
        Motion::Yaw => (0.0, 5.0),
    };
    let mut missing = 0;
    let mut worst: f64 = 0.0;
    for (start, values) in motions(motion) {
        let mut start = start.to_array();
        if let Some((index, degrees)) = extra {
            start[index] += degrees.to_radians();
        }
        for value in values {
            let mut base = start;
            base[motion.index()] += value / motion.per_si();
            // The same place without and with the disturbance: what it adds, whatever the noise of the rest.
            let poses: Vec<Pose> = std::iter::once(0.0)
                .chain((0..=4).map(|k| low + (high - low) * f64::from(k) / 4.0))
                .map(|d| {
                    let mut p = base;
                    let by_m = d / by.per_si();
                    if motion == Motion::Sway && by == Motion::Surge {
                        // The vehicle surges along its own heading, aslant to the board.
                        p[0] += by_m * p[5].cos();
                        p[1] += by_m * p[5].sin();
                    } else {
                        p[by.index()] += by_m;
                    }
                    Pose::from_array(p)
                })
                .collect();
            let seen = bench.see(&poses, Reading::SubPixel, None);
            let path_psi = if motion == Motion::Surge {
                start[5]
            } else {
                0.0
            };
            let still = Pose::from_array(start);
            let reference = bench.see(&[still], Reading::SubPixel, None);
            let result = |s: &Seen, p: &Pose| {
                bench.formula(motion, s, reference.first()?, p, &still, path_psi)
            };
            let Some(undisturbed) = seen.first().and_then(|s| result(s, &poses[0])) else {
                missing += poses.len();
                continue;
            };
            for (s, p) in seen.iter().zip(&poses).skip(1) {
                match result(s, p) {
                    Some(v) => worst = worst.max((v - undisturbed).abs() * motion.per_si()),
                    None => missing += 1,
                }
            }
        }
    }
    Ok(Disturbed {
        motion,
        by,
        from_to: [low, high],
        paper,
        condition,
        ours: worst,
        unit: motion.unit(),
        missing,
    })
}

/// Start of a motion and places along its range (mm or degrees).
fn motions(motion: Motion) -> Vec<(Pose, Vec<f64>)> {
    let at = |x_m: f64, height_m: f64, psi_deg: f64| Pose {
        x_m,
        z_m: -height_m,
        psi_rad: psi_deg.to_radians(),
        ..Pose::default()
    };
    match motion {
        Motion::Surge => vec![(at(-0.20, 0.83, 0.0), vec![0.0, 20.0, 90.0, 130.0, 180.0])],
        Motion::Sway => vec![(at(0.2, 0.83, 0.0), vec![0.0, 70.0, 140.0])],
        Motion::Heave => vec![(at(0.2, 0.93, 0.0), vec![0.0, 210.0, 400.0])],
        Motion::Roll | Motion::Pitch => vec![(at(0.2, 0.68, 0.0), vec![-15.0, 0.0, 15.0])],
        Motion::Yaw => vec![(at(0.30, 0.83, -17.0), vec![0.0, 10.0, 20.0, 28.0])],
    }
}

fn light(rig: &Rig) -> Light {
    Light {
        brightness: rig.laser.peak,
        thickness_m: rig.laser.sigma_m,
        background: rig.camera.noise.ambient,
        noise_sd: rig.camera.noise.read_sd,
    }
}

/// Joint pose of `frames` random frames under all of the tables' disturbances at once
/// (±10 mm, ±1° roll and pitch, 0–5° yaw) along the surge run.
///
/// # Errors
/// [`ReproduceError`].
pub fn joint_accuracy(
    frames: usize,
    seed: u64,
    target: &str,
) -> Result<JointAccuracy, ReproduceError> {
    let mut rig = Rig::builtin("lshpi")?;
    rig.target = Some(Target::load_or_builtin(target)?);
    let bench = Bench::new(rig)?;
    let mut random = StdRng::seed_from_u64(seed);
    let poses: Vec<Pose> = (0..frames)
        .map(|_| {
            let mut within = |low: f64, high: f64| low + (high - low) * random.random::<f64>();
            let tilt = 1f64.to_radians();
            Pose {
                x_m: within(-0.2, 0.7),
                y_m: within(-0.01, 0.01),
                z_m: -0.83 + within(-0.01, 0.01),
                phi_rad: within(-tilt, tilt),
                theta_rad: within(-tilt, tilt),
                psi_rad: within(0.0, 5.0 * tilt),
            }
        })
        .collect();
    let seen = bench.see(&poses, Reading::SubPixel, Some(Held::default()));
    let mut out = JointAccuracy {
        frames,
        ..JointAccuracy::default()
    };
    for (seen, truth) in seen.iter().zip(&poses) {
        let Some(joint) = seen.joint.as_ref().filter(|j| j.measured == [true; 6]) else {
            out.failed += 1;
            continue;
        };
        let error = nalgebra::Vector6::from(joint.pose.to_array())
            - nalgebra::Vector6::from(truth.to_array());
        for (i, motion) in Motion::ALL.iter().enumerate() {
            let sd = joint.covariance[(i, i)].sqrt();
            out.rms[i] += (error[i] * motion.per_si()).powi(2);
            out.reported_sd[i] += (sd * motion.per_si()).powi(2);
            out.worst_in_sd = out.worst_in_sd.max(error[i].abs() / sd);
            // A normal's middle 95 %.
            out.covered_95_each[i] += f64::from(u8::from(error[i].abs() < 1.959_964 * sd));
        }
        // χ² with six degrees of freedom: 95 % below 12.592.
        let distance = squared_distance(&joint.pose, &joint.covariance, truth, &bench.rig.mounts);
        out.covered_95 += f64::from(u8::from(distance.is_some_and(|d| d < 12.592)));
        if let Some(bound) = bench.fitter.bound(truth, &light(&bench.rig), false) {
            for (i, motion) in Motion::ALL.iter().enumerate() {
                out.bound[i] += bound[(i, i)] * motion.per_si().powi(2);
            }
        }
    }
    let n = (frames - out.failed).max(1) as f64;
    for v in out
        .rms
        .iter_mut()
        .chain(&mut out.reported_sd)
        .chain(&mut out.bound)
    {
        *v = (*v / n).sqrt();
    }
    out.covered_95 /= n;
    out.covered_95_each.iter_mut().for_each(|c| *c /= n);
    Ok(out)
}

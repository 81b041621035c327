//! Table 7 and Figure 17: six surge runs, by the paper's formulas and by joint pose smoothed over the run.

use super::chain::{Bench, Reading, Seen};
use super::paper::TABLE7;
use super::{Motion, ReproduceError};
use hydroline_pose::Pose;
use hydroline_pose::estimators::{Chain, ChainFix, Crossing, surge_positions};
use hydroline_pose::joint::Held;
use hydroline_pose::smooth::{Dynamics, MeasuredFrame, smooth};
use hydroline_rigs::Rig;
use serde::Serialize;

/// Angle between path and centre line (paper, 3.6.2) \[°\].
const PSI_S_DEG: f64 = -4.0;
/// Length of a run (paper, Fig. 14) \[m\].
const LENGTH_M: f64 = 1.0;
/// Frames per second; the paper does not say.
const RATE_HZ: f64 = 25.0;
/// First CG, so that sheet and path stay over the target: 0.07 m into it, aslant across its middle.
const START_M: [f64; 3] = [-0.2, 0.02, -0.83];
/// Period of the pitch disturbance \[s\]: chosen, near the vehicle's own (Figs 15 and 16 are lost).
const PITCH_PERIOD_S: f64 = 6.0;
/// Noise of a fix by the formulas \[m\], fastest change of speed \[m/s²\], and greatest change of yaw from
/// frame to frame \[rad\] that continuity expects.
const NOISE_M: f64 = 1e-3;
const ACCELERATION_MPS2: f64 = 0.2;
const TURN_RAD: f64 = 0.02;
/// The vehicle that binds the frames is not the true one: its coefficients are this much off, and
/// nothing is known of its thrust. Smoothing must not need what identification is to find.
const COEFFICIENTS_OFF: f64 = 1.2;

/// Disturbance added to the motion.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Disturbance {
    /// No disturbance.
    None,
    /// Pitch alone.
    Pitch,
    /// Pitch and yaw.
    PitchAndYaw,
}

impl Disturbance {
    /// All three, in the paper's order.
    pub const ALL: [Disturbance; 3] = [
        Disturbance::None,
        Disturbance::Pitch,
        Disturbance::PitchAndYaw,
    ];
}

/// One of the six runs. Errors are the greatest along the path, of the displacement from the first frame.
#[derive(Debug, Clone, PartialEq, Serialize, schemars::JsonSchema)]
pub struct SurgeRun {
    /// X \[N\].
    pub thrust_n: f64,
    /// Disturbance added to the run.
    pub disturbance: Disturbance,
    /// Number of frames.
    pub frames: usize,
    /// The paper's ψ_S \[°\].
    pub paper_psi_s_deg: f64,
    /// The paper's greatest error \[mm\].
    pub paper_max_mm: f64,
    /// ψ_S by the formulas on whole-pixel stripes \[°\].
    pub whole_pixel_psi_s_deg: f64,
    /// Greatest error of the formulas on whole-pixel stripes \[mm\].
    pub whole_pixel_max_mm: f64,
    /// ψ_S by the formulas on ours \[°\].
    pub formula_psi_s_deg: f64,
    /// Greatest error of the formulas on ours \[mm\].
    pub formula_max_mm: f64,
    /// Joint pose, single frames: rms and greatest error of x along the path \[mm\].
    pub joint_mm: [f64; 2],
    /// Joint pose smoothed over the run: rms and greatest error \[mm\].
    pub smoothed_mm: [f64; 2],
    /// Its reported sd of x, rms \[mm\].
    pub smoothed_sd_mm: f64,
    /// Frames without an answer: whole-pixel, formula, joint.
    pub missing: [usize; 3],
}

/// ψ_S,i of one run, for Figure 17.
pub(super) struct Angles {
    pub t_s: Vec<f64>,
    pub psi_deg: Vec<Option<f64>>,
}

/// The six runs, every `every`-th frame.
///
/// # Errors
/// [`ReproduceError`].
pub fn table7(every: usize) -> Result<Vec<SurgeRun>, ReproduceError> {
    let bench = Bench::of(Motion::Surge)?;
    let mut out = Vec::new();
    for disturbance in Disturbance::ALL {
        for thrust_n in [4.0, 8.0] {
            out.push(run(&bench, thrust_n, disturbance, every.max(1))?);
        }
    }
    Ok(out)
}

/// ψ_S,i at 4 N without and with disturbances, as the paper reads them.
pub(super) fn angles(disturbance: Disturbance, every: usize) -> Result<Angles, ReproduceError> {
    let bench = Bench::of(Motion::Surge)?;
    let chain = bench.chain.as_ref().ok_or(ReproduceError::NoChain)?;
    let moved = motion(&bench.rig, 4.0, disturbance, every.max(1));
    let poses: Vec<Pose> = moved.iter().map(|m| m.pose).collect();
    let (_, fixes) = places(
        &bench,
        chain,
        &bench.see(&poses, Reading::WholePixel, None),
        step_s(every),
    );
    Ok(Angles {
        t_s: moved.iter().map(|m| m.t_s).collect(),
        psi_deg: fixes
            .iter()
            .map(|f| f.map(|f| f.psi_s_rad.to_degrees()))
            .collect(),
    })
}

struct Moved {
    t_s: f64,
    /// Along the path \[m\].
    s_m: f64,
    pose: Pose,
}

/// Time from frame to frame \[s\].
fn step_s(every: usize) -> f64 {
    every.max(1) as f64 / RATE_HZ
}

/// Eq. 7 from rest (RK4), with the artificial disturbance on top, as the paper does.
fn motion(rig: &Rig, thrust_n: f64, disturbance: Disturbance, every: usize) -> Vec<Moved> {
    let surge = rig.vehicle.coefficients[0];
    let mass_kg = rig.vehicle.mass_kg - surge.added;
    let rate = |u: f64| ((surge.linear + surge.quadratic * u.abs()) * u + thrust_n) / mass_kg;
    let dt = step_s(every);
    let h = dt / 40.0;
    let (mut s_m, mut u, mut t_s) = (0.0, 0.0f64, 0.0);
    let mut out = Vec::new();
    // Greatest pitch by which the formula comes to the paper's error: 790 mm tan θ (theory/geometry.md, the paper's tables).
    // Mean yaw by which ψ_S comes to the paper's mean.
    let (pitch_deg, yaw_deg) = if thrust_n < 6.0 {
        (1.06, 2.5)
    } else {
        (2.15, 1.65)
    };
    while s_m <= LENGTH_M && out.len() < 10_000 {
        let turn = 2.0 * std::f64::consts::PI * t_s / PITCH_PERIOD_S;
        let pitch = match disturbance {
            Disturbance::None => 0.0,
            _ => f64::to_radians(pitch_deg) * turn.sin(),
        };
        let yaw = match disturbance {
            Disturbance::PitchAndYaw => f64::to_radians(yaw_deg) * (1.0 - (0.5 * turn).cos()),
            _ => 0.0,
        };
        let path = PSI_S_DEG.to_radians();
        out.push(Moved {
            t_s,
            s_m,
            pose: Pose {
                x_m: START_M[0] + s_m * path.cos(),
                y_m: START_M[1] + s_m * path.sin(),
                z_m: START_M[2],
                theta_rad: pitch,
                psi_rad: path + yaw,
                ..Pose::default()
            },
        });
        for _ in 0..40 {
            let k1 = rate(u);
            let k2 = rate(u + 0.5 * h * k1);
            let k3 = rate(u + 0.5 * h * k2);
            let k4 = rate(u + h * k3);
            // The displacement by the same stages: u, u + h k1/2, u + h k2/2, u + h k3.
            s_m += h * (u + h * (k1 + k2 + k3) / 6.0);
            u += h * (k1 + 2.0 * k2 + 2.0 * k3 + k4) / 6.0;
        }
        t_s += dt;
    }
    out
}

/// Crossings and fixes of a run, each fix where continuity with the last one puts it.
fn places(
    bench: &Bench,
    chain: &Chain,
    seen: &[Seen],
    dt_s: f64,
) -> (Vec<Option<Crossing>>, Vec<Option<ChainFix>>) {
    let path = PSI_S_DEG.to_radians();
    let l = bench.rig.mounts.l_laser_m;
    let mut near = (
        START_M[0] + l * path.cos() + (START_M[1] + l * path.sin()) * path.tan(),
        path,
    );
    // Continuity: on with the speed so far. One fix beside a corner may lie on the wrong flank, as far
    // behind the corner as the vehicle is past it; so no fix moves the expectation by more than noise
    // and acceleration can, and the next fixes tell on which side of the corner the vehicle is.
    let surprise_m = NOISE_M + 0.5 * ACCELERATION_MPS2 * dt_s * dt_s;
    let mut speed_mps = 0.0;
    let crossings: Vec<Option<Crossing>> = seen.iter().map(|s| s.crossing).collect();
    let fixes = crossings
        .iter()
        .enumerate()
        .map(|(k, c)| {
            if k > 0 {
                near.0 += speed_mps * dt_s;
            }
            let fix = chain.fix(c.as_ref()?, near).ok()?;
            let off_m = (fix.x_s_m - near.0).clamp(-surprise_m, surprise_m);
            near.0 += 0.5 * off_m;
            speed_mps += 0.2 * off_m / dt_s;
            near.1 += 0.5 * (fix.psi_s_rad - near.1).clamp(-TURN_RAD, TURN_RAD);
            Some(fix)
        })
        .collect();
    (crossings, fixes)
}

/// ψ_S \[°\], greatest error \[mm\], frames without an answer.
fn by_formula(
    bench: &Bench,
    chain: &Chain,
    seen: &[Seen],
    moved: &[Moved],
    every: usize,
) -> (f64, f64, usize) {
    let (crossings, fixes) = places(bench, chain, seen, step_s(every));
    let (psi_s_rad, x) = surge_positions(chain, &crossings, &fixes);
    let first = x.iter().position(Option::is_some).unwrap_or(0);
    let errors = x
        .iter()
        .zip(moved)
        .filter_map(|(x, m)| Some(((*x)? - (m.s_m - moved[first].s_m)).abs()));
    let most = errors.fold(0.0, f64::max);
    (
        psi_s_rad.to_degrees(),
        most * 1e3,
        x.iter().filter(|x| x.is_none()).count(),
    )
}

fn run(
    bench: &Bench,
    thrust_n: f64,
    disturbance: Disturbance,
    every: usize,
) -> Result<SurgeRun, ReproduceError> {
    let chain = bench.chain.as_ref().ok_or(ReproduceError::NoChain)?;
    let moved = motion(&bench.rig, thrust_n, disturbance, every);
    let poses: Vec<Pose> = moved.iter().map(|m| m.pose).collect();
    let whole = bench.see(&poses, Reading::WholePixel, None);
    let fine = bench.see(&poses, Reading::SubPixel, Some(Held::default()));
    let (whole_psi, whole_max, whole_missing) = by_formula(bench, chain, &whole, &moved, every);
    let (formula_psi, formula_max, formula_missing) =
        by_formula(bench, chain, &fine, &moved, every);
    let (sin, cos) = PSI_S_DEG.to_radians().sin_cos();
    // Error of the place along the path: absolute, nothing is set to zero at the first frame.
    let along = |eta: [f64; 6], truth: &Pose| {
        ((eta[0] - truth.x_m) * cos + (eta[1] - truth.y_m) * sin) * 1e3
    };
    let single = fine
        .iter()
        .zip(&poses)
        .filter_map(|(s, p)| Some(along(s.joint.as_ref()?.pose.to_array(), p)));
    let frames: Vec<MeasuredFrame> = fine
        .iter()
        .zip(&moved)
        .map(|(s, m)| MeasuredFrame {
            stamp_ns: (m.t_s * 1e9).round() as u64,
            measured: s.joint.as_ref().map(Into::into),
        })
        .collect();
    let smoothed = smooth(&frames, &Dynamics::new(&unknown(&bench.rig)))?;
    let errors = smoothed.frames.iter().zip(&poses);
    let smoothed_mm = summary(errors.map(|(s, p)| along(s.eta, p)));
    let variance = smoothed.frames.iter().map(|f| f.covariance[(0, 0)]);
    let is_strong = thrust_n >= 6.0;
    let (paper_psi_s_deg, paper_max_mm) = TABLE7[disturbance as usize][usize::from(is_strong)];
    Ok(SurgeRun {
        thrust_n,
        disturbance,
        frames: poses.len(),
        paper_psi_s_deg,
        paper_max_mm,
        whole_pixel_psi_s_deg: whole_psi,
        whole_pixel_max_mm: whole_max,
        formula_psi_s_deg: formula_psi,
        formula_max_mm: formula_max,
        joint_mm: summary(single),
        smoothed_mm,
        smoothed_sd_mm: (variance.sum::<f64>() / poses.len().max(1) as f64).sqrt() * 1e3,
        missing: [
            whole_missing,
            formula_missing,
            fine.iter().filter(|s| s.joint.is_none()).count(),
        ],
    })
}

/// The rig with a vehicle that is not yet identified.
fn unknown(rig: &Rig) -> Rig {
    let mut rig = rig.clone();
    for c in &mut rig.vehicle.coefficients {
        c.added *= COEFFICIENTS_OFF;
        c.linear *= COEFFICIENTS_OFF;
        c.quadratic *= COEFFICIENTS_OFF;
    }
    rig
}

/// Rms and greatest.
fn summary(errors: impl Iterator<Item = f64>) -> [f64; 2] {
    let (mut square, mut most, mut n) = (0.0, 0.0f64, 0.0);
    for e in errors {
        square += e * e;
        most = most.max(e.abs());
        n += 1.0;
    }
    [(square / f64::max(n, 1.0)).sqrt(), most]
}

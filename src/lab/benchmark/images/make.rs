//! An image-level case: two logs of frames, and the key.

use super::super::error::ProveError;
use super::super::magnitudes;
use super::size::{Moved, moved};
use hydroline_daemon::simulate::{Options, simulate};
use hydroline_diagnose::profiles::known::Poses;
use hydroline_diagnose::profiles::observe::{self, ImageRun};
use hydroline_identify::data::LoadError;
use hydroline_log::messages::Stamped;
use hydroline_log::{LogReader, Record};
use hydroline_rigs::{ParameterValue, PhysicsEntry, Plan, Rig};
use hydroline_sim::EffectStack;
use hydroline_sim::effect::{EffectInfo, find};
use rand::{RngExt, SeedableRng, rngs::StdRng};
use std::path::{Path, PathBuf};

/// Effects of camera, sheet, target, water and light that a case may have.
pub const EFFECTS: [&str; 14] = [
    "refraction",
    "laser_plane_tilt",
    "camera_shift",
    "target_scale",
    "floor_slope",
    "backscatter_haze",
    "lens_distortion",
    "laser_cone",
    "lens_shading",
    "line_profile",
    "ambient_gradient",
    "tone_curve",
    "range_clipping",
    "mains_banding",
];
/// Truth of a case without an effect.
pub const NONE: &str = "none";

const PLANS: [&str; 2] = ["reversals", "two-tone"];
/// Frames of each run.
const FRAMES: usize = 26;
/// Least size \[sd of the pose\].
const LEAST_SDS: f64 = 3.0;
/// Largest command of the plans \[N\].
const TOP_N: f64 = 24.0;

/// A case.
#[derive(Debug, Clone)]
pub struct ImageCase {
    /// Number of the case.
    pub index: usize,
    /// The rig file, for the diagnosis to see ...
    pub rig: Rig,
    /// ... and the logs' frames and commands.
    pub runs: Vec<ImageRun>,
    /// The effects that are there.
    pub truth: Vec<PhysicsEntry>,
    /// Shift of a pose by the effect that moves it most.
    pub moved: Moved,
    /// Poses that the camera saw, run by run.
    pub poses: Vec<Poses>,
    /// The same runs without the effects.
    pub clean: Vec<ImageRun>,
}

/// A folder that goes when the case is read.
struct Scratch(PathBuf);

impl Drop for Scratch {
    fn drop(&mut self) {
        // Nothing depends on it; the system clears its temporary folder itself.
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// Makes case `index`.
///
/// # Errors
/// [`ProveError`].
pub fn make(seed: u64, index: usize) -> Result<ImageCase, ProveError> {
    let mut rng = StdRng::seed_from_u64(seed.wrapping_mul(1_000_003).wrapping_add(index as u64));
    let rig = Rig::builtin("lshpi")?;
    let broken = |reason: String| ProveError::Images { index, reason };
    let (mut truth, mut size): (Vec<PhysicsEntry>, Moved) = Default::default();
    for id in ids(index, &mut rng) {
        let info = find(id).ok_or_else(|| broken(format!("no effect is called {id}")))?;
        let (entry, own) = drawn(info, &rig, &mut rng);
        truth.push(entry);
        if own.any_sds > size.any_sds {
            size = own;
        }
    }
    let mut tank = rig.clone();
    for c in &mut tank.vehicle.coefficients {
        let mut off = || 1.0 + 0.2 * (2.0 * rng.random::<f64>() - 1.0);
        (c.added, c.linear, c.quadratic) = (c.added * off(), c.linear * off(), c.quadratic * off());
    }
    tank.physics = background(&mut rng)?;
    let mut between = |low: f64, high: f64| low + (high - low) * rng.random::<f64>();
    tank.camera.noise.read_sd = between(1.5, 2.5);
    tank.camera.noise.ambient = between(0.0, 12.0);
    // Lasers, lenses and sheets as they are delivered: within what a rig file leaves open.
    tank.laser.peak *= between(0.8, 1.15);
    tank.laser.sigma_m *= between(0.97, 1.03);
    tank.camera.noise.blur_px *= between(0.9, 1.1);
    // Set down by hand: not quite where the rig says.
    tank.tank.start_pose[0] += between(-0.02, 0.02);
    tank.tank.start_pose[1] += between(-0.005, 0.005);
    tank.tank.start_pose[2] += between(-0.01, 0.01);
    tank.tank.start_pose[5] = between(-0.08, 0.08);
    let folder = std::env::temp_dir().join(format!(
        "hydroline-prove-{}-{seed}-{index}",
        std::process::id()
    ));
    std::fs::create_dir_all(&folder).map_err(|e| broken(format!("{}: {e}", folder.display())))?;
    let scratch = Scratch(folder);
    let (mut runs, mut poses, mut clean) = (Vec::new(), Vec::new(), Vec::new());
    for (k, name) in PLANS.iter().enumerate() {
        let plan = Plan::load_or_builtin(name)?;
        tank.camera.rate_fps = (FRAMES as f64 + 0.5) / plan.duration_s();
        let path = |what: &str| scratch.0.join(format!("{name}-{what}.mcap"));
        let run = |tank: &Rig, path: &Path| -> Result<ImageRun, ProveError> {
            let options = Options {
                seed: Some(seed.wrapping_mul(7919).wrapping_add((2 * index + k) as u64)),
                ..Options::default()
            };
            simulate(tank, &plan, path, &options, &mut |_, _| {})
                .map_err(|e| broken(e.to_string()))?;
            Ok(observe::read(path, &rig, FRAMES)?)
        };
        clean.push(run(&tank, &path("clean"))?);
        let mut lit = tank.clone();
        lit.physics.extend(truth.iter().cloned());
        let lit_path = path("lit");
        let made = run(&lit, &lit_path)?;
        poses.push(seen_poses(&lit_path, &tank, made.start_ns).map_err(|e| broken(e.to_string()))?);
        runs.push(made);
    }
    Ok(ImageCase {
        index,
        rig,
        runs,
        truth,
        moved: size,
        poses,
        clean,
    })
}

/// One effect, two, none, in turn.
fn ids(index: usize, rng: &mut StdRng) -> Vec<&'static str> {
    let one = EFFECTS[(index / 3) % EFFECTS.len()];
    match index % 3 {
        0 => vec![one],
        1 => {
            let others: Vec<&str> = EFFECTS.into_iter().filter(|e| *e != one).collect();
            vec![one, others[rng.random_range(0..others.len())]]
        }
        _ => Vec::new(),
    }
}

/// Poses at which the camera looked at the scene, by the log's truth.
fn seen_poses(path: &Path, tank: &Rig, start_ns: u64) -> Result<Poses, LoadError> {
    let stack = EffectStack::build(&tank.physics).unwrap_or_else(|_| EffectStack::empty());
    let (mut poses, mut first_ns) = (Poses::new(), None);
    for message in LogReader::open(path)? {
        if let Record::Truth(m) = message?.record {
            let Some(ns) = m.stamp_ns() else { continue };
            let begun = *first_ns.get_or_insert(ns);
            let since = |from: u64| (ns as f64 - from as f64) * 1e-9;
            let state = [m.x_m, m.y_m, m.z_m, m.phi_rad, m.theta_rad, m.psi_rad];
            let pose = stack.scene_pose(since(begun), state.map(Option::unwrap_or_default));
            poses.push((since(start_ns), pose));
        }
    }
    Ok(poses)
}

/// Four motion effects at 3–8 % of their practical size, and a disturbance about each axis.
fn background(rng: &mut StdRng) -> Result<Vec<PhysicsEntry>, ProveError> {
    let mut ids: Vec<&str> = Vec::new();
    while ids.len() < 4 {
        let id = magnitudes::EFFECTS[rng.random_range(0..magnitudes::EFFECTS.len())];
        if !ids.contains(&id) {
            ids.push(id);
        }
    }
    let mut all: Vec<PhysicsEntry> = ids
        .into_iter()
        .map(|id| {
            let share = 0.03 + 0.05 * rng.random::<f64>();
            magnitudes::entry(id, share, TOP_N, rng)
        })
        .collect::<Result<_, _>>()?;
    for axis in ["roll", "pitch", "yaw"] {
        let number = |v: f64| ParameterValue::Number(v);
        all.push(PhysicsEntry {
            effect: "attitude_disturbance".to_owned(),
            parameters: vec![
                ("axis".to_owned(), ParameterValue::Word(axis.to_owned())),
                (
                    "amp_rad".to_owned(),
                    number(0.001 + 0.005 * rng.random::<f64>()),
                ),
                (
                    "period_s".to_owned(),
                    number(3.0 + 6.0 * rng.random::<f64>()),
                ),
                (
                    "phase_rad".to_owned(),
                    number(6.0 * rng.random::<f64>() - 3.0),
                ),
            ],
        });
    }
    Ok(all)
}

/// An effect in a random direction of its parameters, its size between what moves the pose by
/// three sds and the largest that a tank may show, evenly in the logarithm.
fn drawn(info: &'static EffectInfo, rig: &Rig, rng: &mut StdRng) -> (PhysicsEntry, Moved) {
    let directions: Vec<f64> = info
        .parameters
        .iter()
        .map(|_| 2.0 * rng.random::<f64>() - 1.0)
        .collect();
    let largest = directions
        .iter()
        .map(|d| d.abs())
        .fold(0.0, f64::max)
        .max(1e-9);
    let entry = |share: f64| PhysicsEntry {
        effect: info.id.to_owned(),
        parameters: info
            .parameters
            .iter()
            .zip(&directions)
            .map(|(p, d)| {
                let (low, high) = p.plausible;
                let usual = p.absent.filter(|v| (low..=high).contains(v));
                // The mains is where the tank is, and its phase is each frame's own.
                if let Some(usual) = usual.filter(|_| ["Hz", "rad"].contains(&p.unit)) {
                    return (p.name.to_owned(), ParameterValue::Number(usual));
                }
                let middle = if let Some(usual) = usual {
                    usual
                } else if low < 0.0 {
                    0.0
                } else if low < 1.0 && high > 1.0 {
                    1.0
                } else {
                    low
                };
                let value = if middle == low {
                    // One-sided: a fraction, a length, an index; lengths and times do not grow with size.
                    if ["m", "s"].contains(&p.unit) {
                        low + (high - low) * d.abs()
                    } else {
                        low + (high - low) * (0.5 + 0.5 * d.abs()) * share
                    }
                } else if *d < 0.0 {
                    middle + (middle - low) * d / largest * share
                } else {
                    middle + (high - middle) * d / largest * share
                };
                (p.name.to_owned(), ParameterValue::Number(value))
            })
            .collect(),
    };
    // The least share that is enough, by bisection. Roll alone is known to a thousandth of a degree,
    // so that next to anything moves it by three sds: what counts is where the vehicle is put.
    let enough = |share: f64| moved(rig, &entry(share)).position_sds >= LEAST_SDS;
    if !enough(1.0) {
        // Light hardly moves a fitted pose at all: then from a tenth of what a tank may show.
        let entry = entry(0.1f64.powf(rng.random::<f64>()));
        let size = moved(rig, &entry);
        return (entry, size);
    }
    let (mut low, mut high) = (1.0 / 1024.0, 1.0);
    if enough(low) {
        high = low;
    }
    for _ in 0..5 {
        let middle = f64::sqrt(low * high);
        if high / low < 1.2 {
            break;
        }
        if enough(middle) {
            high = middle
        } else {
            low = middle
        }
    }
    let share = high * (1.0 / high).powf(rng.random::<f64>());
    let entry = entry(share);
    let size = moved(rig, &entry);
    (entry, size)
}

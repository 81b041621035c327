//! An image-level case: two logs of frames, and the key.

use super::super::error::ProveError;
use super::super::sizes;
use super::size::{Moved, moved};
use hydroline_daemon::simulate::{Options, simulate};
use hydroline_diagnose::profiles::observe::{self, ImageRun};
use hydroline_rigs::{ParameterValue, PhysicsEntry, Plan, Rig};
use hydroline_sim::effect::{EffectInfo, find};
use rand::{RngExt, SeedableRng, rngs::StdRng};
use std::path::PathBuf;

/// The effects of must-show 5; a case with none comes after each round of them.
pub const EFFECTS: [&str; 6] = [
    "refraction",
    "laser_plane_tilt",
    "camera_shift",
    "target_scale",
    "floor_slope",
    "backscatter_haze",
];
/// Truth of a case without an effect.
pub const NONE: &str = "none";

/// Plans of the two runs.
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
    /// Number.
    pub index: usize,
    /// What the diagnosis may see: the rig file ...
    pub rig: Rig,
    /// ... and the logs' frames and commands.
    pub runs: Vec<ImageRun>,
    /// The effect, if there is one.
    pub truth: Option<PhysicsEntry>,
    /// What it does to a pose.
    pub moved: Moved,
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
    let effect = EFFECTS
        .get(index % (EFFECTS.len() + 1))
        .and_then(|id| find(id));
    let broken = |reason: String| ProveError::Images { index, reason };
    let (truth, size) = match effect {
        Some(info) => {
            let (entry, size) = drawn(info, &rig, &mut rng);
            (Some(entry), size)
        }
        None => (None, Moved::default()),
    };
    let mut tank = rig.clone();
    for c in &mut tank.vehicle.coefficients {
        let mut off = || 1.0 + 0.2 * (2.0 * rng.random::<f64>() - 1.0);
        (c.added, c.linear, c.quadratic) = (c.added * off(), c.linear * off(), c.quadratic * off());
    }
    tank.physics = background(&mut rng);
    tank.physics.extend(truth.clone());
    let mut between = |low: f64, high: f64| low + (high - low) * rng.random::<f64>();
    tank.camera.noise.read_sd = between(1.5, 2.5);
    tank.camera.noise.ambient = between(0.0, 12.0);
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
    let mut runs = Vec::new();
    for (k, name) in PLANS.iter().enumerate() {
        let plan = Plan::load_or_builtin(name)?;
        tank.camera.rate_fps = (FRAMES as f64 + 0.5) / plan.duration_s();
        let path = scratch.0.join(format!("{name}.mcap"));
        let options = Options {
            seed: Some(seed.wrapping_mul(7919).wrapping_add((2 * index + k) as u64)),
            ..Options::default()
        };
        simulate(&tank, &plan, &path, &options, &mut |_, _| {})
            .map_err(|e| broken(e.to_string()))?;
        runs.push(observe::read(&path, &rig, FRAMES)?);
    }
    Ok(ImageCase {
        index,
        rig,
        runs,
        truth,
        moved: size,
    })
}

/// Four motion effects at 3–8 % of their practical size, and a wobble about each axis.
fn background(rng: &mut StdRng) -> Vec<PhysicsEntry> {
    let mut ids: Vec<&str> = Vec::new();
    while ids.len() < 4 {
        let id = sizes::EFFECTS[rng.random_range(0..sizes::EFFECTS.len())];
        if !ids.contains(&id) {
            ids.push(id);
        }
    }
    let mut all: Vec<PhysicsEntry> = ids
        .into_iter()
        .map(|id| {
            let share = 0.03 + 0.05 * rng.random::<f64>();
            sizes::entry(id, share, TOP_N, rng)
        })
        .collect();
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
    all
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
                let middle = if low < 0.0 {
                    0.0
                } else if low < 1.0 && high > 1.0 {
                    1.0
                } else {
                    low
                };
                let value = if middle == low {
                    // One-sided: a fraction, a length, an index; lengths do not grow with size.
                    if p.unit == "m" {
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
        // Haze hardly moves a fitted pose at all: then what a tank may show.
        let entry = entry(1.0);
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

//! One chain: board run, calibration, runs, poses, coefficients.

use super::setup::{Drawn, Group, keys, plan};
use crate::support::{hydroline, read};
use hydroline::identify::parameter::Coefficient;
use hydroline::log::Record;
use hydroline::log::messages::{pb::VehicleMotion, unix_ns};
use hydroline::simulate::{Options, simulate};
use hydroline_rigs::Plan;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Behind the sheet, as a person sets it up \[m\].
const BOARD_OFFSET_M: f64 = 0.0005;

/// A coefficient and its interval.
#[derive(Debug, Clone)]
pub struct Found {
    pub key: String,
    pub truth: f64,
    /// Value, sd, ends of the 95 % interval; `None` where the chain gave none.
    pub given: Option<[f64; 4]>,
}

impl Found {
    pub fn inside(&self) -> bool {
        self.given
            .is_some_and(|[_, _, low, high]| (low..=high).contains(&self.truth))
    }

    /// Error in sds.
    pub fn sds(&self) -> f64 {
        self.given
            .map_or(f64::INFINITY, |[value, sd, ..]| (value - self.truth) / sd)
    }
}

/// Results of a chain.
#[derive(Debug, Clone, Default)]
pub struct Outcome {
    pub coefficients: Vec<Found>,
    pub frames: usize,
    pub poses: usize,
    /// Sum of squared errors of the poses in sds: x, y, z, φ, θ, ψ.
    pub square_sds: [f64; 6],
    /// Sum of errors in sds: their mean is what all poses have alike.
    pub sum_sds: [f64; 6],
    /// Worst error of a pose in sds, and where.
    pub worst_sds: f64,
    pub worst_at: String,
    /// Failures and misfits that the commands reported.
    pub words: Vec<String>,
}

impl Outcome {
    pub fn json(&self, key: &str) -> Value {
        let found = |c: &Found| json!({ "key": c.key, "truth": c.truth, "given": c.given });
        json!({
            "key": key,
            "coefficients": self.coefficients.iter().map(found).collect::<Vec<_>>(),
            "frames": self.frames,
            "poses": self.poses,
            "square_sds": self.square_sds,
            "sum_sds": self.sum_sds,
            "worst_sds": self.worst_sds,
            "worst_at": self.worst_at,
            "words": self.words,
        })
    }

    pub fn read(v: &Value) -> Option<Self> {
        let numbers =
            |v: &Value| -> Option<Vec<f64>> { v.as_array()?.iter().map(Value::as_f64).collect() };
        let found = |c: &Value| {
            Some(Found {
                key: c["key"].as_str()?.to_owned(),
                truth: c["truth"].as_f64()?,
                given: numbers(&c["given"]).and_then(|n| n.try_into().ok()),
            })
        };
        Some(Outcome {
            coefficients: v["coefficients"]
                .as_array()?
                .iter()
                .map(found)
                .collect::<Option<_>>()?,
            frames: v["frames"].as_u64()? as usize,
            poses: v["poses"].as_u64()? as usize,
            square_sds: numbers(&v["square_sds"])?.try_into().ok()?,
            sum_sds: numbers(&v["sum_sds"])?.try_into().ok()?,
            worst_sds: v["worst_sds"].as_f64()?,
            worst_at: v["worst_at"].as_str()?.to_owned(),
            words: v["words"]
                .as_array()?
                .iter()
                .map(|w| Some(w.as_str()?.to_owned()))
                .collect::<Option<_>>()?,
        })
    }

    pub fn print(&self, name: &str) {
        let n = self.poses.max(1) as f64;
        let mean = self.sum_sds.map(|sum| sum / n);
        let rms = self.square_sds.map(|sum| (sum / n).sqrt());
        println!(
            "  {name}: {} of {} frames with a pose; in sds, x y z φ θ ψ: mean {mean:.1?}, rms {rms:.1?}, worst {:.1} ({})",
            self.poses, self.frames, self.worst_sds, self.worst_at
        );
        for c in &self.coefficients {
            match c.given {
                Some([value, _, low, high]) => println!(
                    "  {name}: {:<7} truth {:>9.3}  found {value:>9.3}  95 % {low:>9.3} .. {high:>9.3}  {:+.1} sd {}",
                    c.key,
                    c.truth,
                    c.sds(),
                    if c.inside() { "" } else { "OUTSIDE" }
                ),
                None => println!("  {name}: {:<7} truth {:>9.3}  not found", c.key, c.truth),
            }
        }
        self.words.iter().for_each(|w| println!("  {name}: {w}"));
    }
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// A command's exit code, output and last words.
fn command(args: &[&str]) -> (Option<i32>, String, String) {
    let output = hydroline().args(args).output().unwrap();
    let words = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(!words.contains("panicked"), "{args:?}: {words}");
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    (output.status.code(), said, words)
}

/// Runs a chain in an empty folder.
pub fn run(dir: &Path, drawn: &Drawn, lit: bool, groups: &[Group]) -> Outcome {
    let mut outcome = Outcome::default();
    let rig = dir.join("rig.toml");
    std::fs::write(&rig, &drawn.rig.effective_toml).unwrap();
    let calibration = calibrated(dir, drawn, lit, &mut outcome);
    for (g, group) in groups.iter().enumerate() {
        let mut motions = Vec::new();
        for (p, (name, steps)) in group.plans.iter().enumerate() {
            let seed = 1000 * drawn.chain + 10 * g as u64 + p as u64 + 1;
            let log = simulated(dir, drawn, lit, name, &plan(steps), seed, false);
            outcome.frames += frames(&log);
            let motion = dir.join(format!("{name}-motion.mcap"));
            let mut args = vec!["replay", text(&log), "--out", text(&motion)];
            if let Some(file) = &calibration {
                args.extend(["--calibration", text(file)]);
            }
            let (code, _, words) = command(&args);
            if code != Some(0) {
                outcome
                    .words
                    .push(format!("replay {name}: {code:?} {words}"));
            }
            if motion.exists() {
                judge(&log, &motion, name, &mut outcome);
                motions.push(motion);
            }
            std::fs::remove_file(&log).unwrap();
        }
        let given = identified(&rig, group, &motions, &mut outcome);
        for key in keys(group.model) {
            let coefficient = Coefficient::find(&key).unwrap();
            outcome.coefficients.push(Found {
                truth: coefficient.of_vehicle(&drawn.world.vehicle),
                given: given.get(&key).copied(),
                key,
            });
        }
    }
    outcome
}

/// A log of the tank, or of the board in the sheet.
fn simulated(
    dir: &Path,
    drawn: &Drawn,
    lit: bool,
    name: &str,
    plan: &str,
    seed: u64,
    board: bool,
) -> PathBuf {
    let rig = drawn.simulated(lit);
    let log = dir.join(format!("{name}.mcap"));
    let options = Options {
        seed: Some(seed),
        board: board.then(|| (rig.board.clone().unwrap(), BOARD_OFFSET_M)),
        ..Options::default()
    };
    let plan = Plan::from_toml(plan, name).unwrap();
    simulate(&rig, &plan, &log, &options, &mut |_, _| {}).unwrap();
    log
}

/// The calibration file of a board run, if one is accepted.
fn calibrated(dir: &Path, drawn: &Drawn, lit: bool, outcome: &mut Outcome) -> Option<PathBuf> {
    let log = simulated(
        dir,
        drawn,
        lit,
        "board",
        &plan(&[]),
        1000 * drawn.chain + 999,
        true,
    );
    let file = dir.join("calibration.toml");
    let (code, said, words) = command(&["calibrate", text(&log), "--json", "--out", text(&file)]);
    let report: Value = serde_json::from_str(&said).unwrap_or_default();
    if code != Some(0) || report["accepted"] != true {
        outcome
            .words
            .push(format!("calibrate: {code:?} {words} {said}"));
    }
    file.exists().then_some(file)
}

fn frames(log: &Path) -> usize {
    let (records, _) = read(log);
    records
        .iter()
        .filter(|r| matches!(r, Record::Frame(_)))
        .count()
}

fn numbers(m: &VehicleMotion) -> [f64; 6] {
    [m.x_m, m.y_m, m.z_m, m.phi_rad, m.theta_rad, m.psi_rad].map(|v| v.unwrap_or(f64::NAN))
}

fn stamp_ns(m: &VehicleMotion) -> u64 {
    m.timestamp.as_ref().map_or(0, unix_ns)
}

/// Poses against the truth.
fn judge(log: &Path, motion: &Path, name: &str, outcome: &mut Outcome) {
    let truth: BTreeMap<u64, [f64; 6]> = read(log)
        .0
        .iter()
        .filter_map(|r| match r {
            Record::Truth(t) => Some((stamp_ns(t), numbers(t))),
            _ => None,
        })
        .collect();
    for record in read(motion).0 {
        let Record::Motion(m) = record else { continue };
        let (seen, truth) = (numbers(&m), truth[&stamp_ns(&m)]);
        outcome.poses += 1;
        for i in 0..6 {
            let sds = (seen[i] - truth[i]) / m.covariance[7 * i].sqrt();
            outcome.square_sds[i] += sds * sds;
            outcome.sum_sds[i] += sds;
            if sds.abs() > outcome.worst_sds {
                outcome.worst_sds = sds.abs();
                let what = ["x", "y", "z", "φ", "θ", "ψ"][i];
                outcome.worst_at = format!("{what} in {name}, pose {}", outcome.poses);
            }
        }
    }
}

/// Value, sd and interval per key.
fn identified(
    rig: &Path,
    group: &Group,
    motions: &[PathBuf],
    outcome: &mut Outcome,
) -> BTreeMap<String, [f64; 4]> {
    let mut args = vec!["identify"];
    args.extend(motions.iter().map(|m| text(m)));
    args.extend([
        "--rig",
        text(rig),
        "--model",
        group.model,
        "--from-rest",
        "--json",
    ]);
    let (code, said, words) = command(&args);
    let found: Value = serde_json::from_str(&said).unwrap_or_default();
    if code != Some(0) {
        outcome
            .words
            .push(format!("identify {}: {code:?} {words}", group.model));
    }
    for misfit in found["misfit"].as_array().into_iter().flatten() {
        outcome
            .words
            .push(format!("identify {}: {misfit}", group.model));
    }
    let given = |p: &Value| -> Option<[f64; 4]> {
        let of = |k: &str| p[k].as_f64();
        Some([of("value")?, of("sd")?, of("low")?, of("high")?])
    };
    let parameters = found["parameters"].as_object().into_iter().flatten();
    parameters
        .filter_map(|(key, p)| Some((key.clone(), given(p)?)))
        .collect()
}

//! Cases as tables for other tools: `CASE/run-K.csv` and `held-K.csv` (what was measured and commanded, the motion smoothed,
//! its acceleration), `laws-K.csv` (what each candidate law adds to the acceleration along that run, at typical numbers),
//! `laws.json` (which law a column is), `rig.toml`. The keys lie apart, in `keys/CASE.json`.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use hydroline_core::run::{Channel, Run};
use hydroline_diagnose::Source;
use hydroline_inference::body::Body;
use hydroline_inference::given::given;
use hydroline_inference::prior::PriorTable;
use hydroline_inference::recording::{Recorded, Recording};
use hydroline_inference::term::{Candidate, Kind};
use hydroline_rigs::{Dof, Rig};
use hydroline_sim::effect::{CheckedEffect, EffectStack};
use hydroline_sim::model::{Model, ModelState};
use hydroline_sim::vehicle::Hydrodynamics;
use hydroline_sim::{Given, VehicleState};

use super::case::Case;
use super::coupled::CoupledCase;
use super::error::ProveError;

/// Half of the step of a numerical derivative \[s\].
const STEP_S: f64 = 1e-3;
/// A column below this share of the largest acceleration is rounding.
const NOTHING: f64 = 1e-9;

/// A case without its key.
struct Sealed<'a> {
    id: &'a str,
    fitted: &'a [Source],
    held: &'a [Source],
    rig: &'a Rig,
}

fn not_kept(path: &Path, e: &std::io::Error) -> ProveError {
    ProveError::NotKept {
        path: path.display().to_string(),
        reason: e.to_string(),
    }
}

fn write(path: PathBuf, text: &str) -> Result<(), ProveError> {
    let made = path.parent().map_or(Ok(()), std::fs::create_dir_all);
    made.and_then(|()| std::fs::write(&path, text))
        .map_err(|e| not_kept(&path, &e))
}

/// Lays a case of one DOF down; its key apart.
///
/// # Errors
/// [`ProveError`].
pub fn case(folder: &Path, case: &Case, key: &serde_json::Value) -> Result<(), ProveError> {
    let sealed = Sealed {
        id: &case.id,
        fitted: &case.sealed.sources,
        held: &case.sealed.held,
        rig: &case.sealed.rig,
    };
    sealed.write(folder, key)
}

/// The same of a coupled case.
///
/// # Errors
/// [`ProveError`].
pub fn coupled(folder: &Path, case: &CoupledCase) -> Result<(), ProveError> {
    let sealed = Sealed {
        id: &format!("coupled-{}", case.index),
        fitted: &case.sources,
        held: &[],
        rig: &case.rig,
    };
    let key = serde_json::json!({ "truth": case.truth, "rig_factor": case.rig_factor });
    sealed.write(folder, &key)
}

impl Sealed<'_> {
    fn write(&self, folder: &Path, key: &serde_json::Value) -> Result<(), ProveError> {
        let here = folder.join(self.id);
        write(here.join("rig.toml"), &self.rig.to_toml())?;
        let runs = |all: &[Source]| -> Vec<Run> { all.iter().map(|s| s.run.clone()).collect() };
        let heading_rad = self.rig.tank.start_pose[5];
        let fitted = Recording::new(&runs(self.fitted), heading_rad);
        let dofs = fitted.moving(&self.rig.tolerance.channels());
        let body = Body::new(fitted, self.rig, &dofs, &[], PriorTable::default())?;
        let laws: Vec<&Candidate> = body
            .candidates
            .iter()
            .filter(|c| c.kind == Kind::Effect)
            .collect();
        let mut columns = Columns::default();
        let mut tables = |body: &Body, table: &str, of_laws: &str| -> Result<(), ProveError> {
            for (k, r) in body.recording.runs.iter().enumerate() {
                let along = Along::new(body, r, k);
                write(here.join(format!("{table}-{k}.csv")), &along.table())?;
                let laws = along.laws(&laws, &mut columns)?;
                write(here.join(format!("{of_laws}-{k}.csv")), &laws)?;
            }
            Ok(())
        };
        tables(&body, "run", "laws")?;
        let held = body.over(Recording::new(&runs(self.held), heading_rad), self.rig)?;
        tables(&held, "held", "held-laws")?;
        let text = serde_json::Value::Object(columns.said).to_string();
        write(here.join("laws.json"), &text)?;
        let key = key.to_string();
        write(folder.join("keys").join(format!("{}.json", self.id)), &key)
    }
}

/// Descriptions of the laws' columns.
#[derive(Default)]
struct Columns {
    said: serde_json::Map<String, serde_json::Value>,
}

/// A run with its motion smoothed.
struct Along<'a> {
    body: &'a Body,
    run: &'a Recorded,
    motion: Given,
    rest: [f64; 6],
}

impl<'a> Along<'a> {
    fn new(body: &'a Body, run: &'a Recorded, place: usize) -> Self {
        let rest = &body.rest[place];
        Along {
            body,
            run,
            motion: given(run, &body.dofs, &[], rest, &body.tolerance),
            rest: rest.pose(),
        }
    }

    fn state(&self, t_s: f64) -> VehicleState<f64> {
        let Given { rates, places, .. } = &self.motion;
        VehicleState {
            eta: std::array::from_fn(|d| places[d].as_ref().map_or(self.rest[d], |c| c.at(t_s))),
            nu: std::array::from_fn(|d| rates[d].as_ref().map_or(0.0, |c| c.at(t_s))),
        }
    }

    fn load(&self, t_s: f64) -> [f64; 6] {
        let after = self.run.commands.partition_point(|c| c.0 <= t_s);
        let last = after.checked_sub(1).and_then(|i| self.run.commands.get(i));
        last.map_or([0.0; 6], |c| c.1)
    }

    fn table(&self) -> String {
        let measured: Vec<Channel> = Channel::ALL
            .into_iter()
            .filter(|c| self.body.recording.channels[*c])
            .collect();
        let dofs = &self.body.dofs;
        let mut text = "t_s".to_owned();
        for c in &measured {
            let _ = write!(text, ",{}", c.name());
        }
        for d in dofs {
            let [place, rate] = Channel::of(*d).map(Channel::name);
            let _ = write!(text, ",smooth_{place},smooth_{rate},smooth_d_{rate}2");
        }
        for d in dofs {
            let unit = if *d < 3 { "n" } else { "nm" };
            let _ = write!(text, ",load_{}_{unit}", Dof::ALL[*d].name());
        }
        text.push('\n');
        for (k, t_s) in self.run.times_s.iter().enumerate() {
            let _ = write!(text, "{t_s:.6}");
            for c in &measured {
                let v = self.run.values[k][*c];
                let _ = match v.is_finite() {
                    true => write!(text, ",{v:.9}"),
                    false => write!(text, ","),
                };
            }
            let [before, now, after] = [-STEP_S, 0.0, STEP_S].map(|by| self.state(t_s + by));
            for d in dofs {
                let slope = (after.nu[*d] - before.nu[*d]) / (2.0 * STEP_S);
                let _ = write!(text, ",{:.9},{:.9},{slope:.9}", now.eta[*d], now.nu[*d]);
            }
            let load = self.load(*t_s);
            for d in dofs {
                let _ = write!(text, ",{:.9}", load[*d]);
            }
            text.push('\n');
        }
        text
    }

    /// Acceleration in the moving DOFs at every stamp along the measured motion, the effects' own states carried on.
    fn accelerations(&self, on: &[CheckedEffect]) -> Result<Vec<Vec<f64>>, ProveError> {
        let model = Model {
            hydrodynamics: Hydrodynamics::new(&self.body.vehicle),
            effects: EffectStack::assemble(on, |_, _, v| v)?,
        };
        let mut own = ModelState::at_rest([0.0; 6]).own;
        let mut made = Vec::with_capacity(self.run.times_s.len());
        let mut last_s = self.run.start_s;
        for t_s in &self.run.times_s {
            let at = |t_s: f64, own| {
                let state = ModelState {
                    vehicle: self.state(t_s),
                    own,
                };
                model.rate(t_s, last_s, &state, &self.load(t_s))
            };
            // Heun in steps that a fast lag bears.
            let steps = ((t_s - last_s) / self.body.step_max_s).ceil().max(1.0);
            let step_s = (t_s - last_s) / steps;
            for k in 0..steps as usize {
                let from_s = last_s + step_s * k as f64;
                let first = at(from_s, own).own;
                let tried = std::array::from_fn(|i| own[i] + step_s * first[i]);
                let second = at(from_s + step_s, tried).own;
                own = std::array::from_fn(|i| own[i] + 0.5 * step_s * (first[i] + second[i]));
            }
            let rate = at(*t_s, own).vehicle.nu;
            made.push(self.body.dofs.iter().map(|d| rate[*d]).collect());
            last_s = *t_s;
        }
        Ok(made)
    }

    fn laws(&self, laws: &[&Candidate], columns: &mut Columns) -> Result<String, ProveError> {
        let none = self.accelerations(&[])?;
        let largest = none.iter().flatten().fold(0.0_f64, |m, v| m.max(v.abs()));
        let mut made: Vec<(String, Vec<f64>)> = Vec::new();
        for c in laws {
            let numbers = c.starts.first().cloned().unwrap_or_default();
            let with = self.accelerations(&[c.checked(&numbers)])?;
            for (place, d) in self.body.dofs.iter().enumerate() {
                let each = with.iter().zip(&none);
                let column: Vec<f64> = each.map(|(a, b)| a[place] - b[place]).collect();
                if column.iter().all(|v| v.abs() <= NOTHING * largest) {
                    continue;
                }
                let name = format!("{} @ {}", c.name(), Dof::ALL[*d].name());
                let said = c.info.parameters.iter().map(|p| p.name).zip(&numbers);
                let said: serde_json::Map<String, serde_json::Value> = said
                    .map(|(name, v)| (name.to_owned(), (*v).into()))
                    .collect();
                let law = serde_json::json!({
                    "effect": c.info.id, "law": c.info.law, "numbers": said, "acts_in": Dof::ALL[*d].name(),
                    "linear_in_first": c.linear.first() == Some(&0),
                });
                columns.said.insert(name.clone(), law);
                made.push((name, column));
            }
        }
        let mut text = "t_s".to_owned();
        for (name, _) in &made {
            let _ = write!(text, ",{name}");
        }
        text.push('\n');
        for (k, t_s) in self.run.times_s.iter().enumerate() {
            let _ = write!(text, "{t_s:.6}");
            for (_, column) in &made {
                let _ = write!(text, ",{:.9e}", column[k]);
            }
            text.push('\n');
        }
        Ok(text)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::benchmark::{Category, make};

    /// The tables hold all that another tool needs, in columns of one length, and nothing of the key.
    #[test]
    fn a_case_lies_there_without_its_key() {
        let folder = tempfile::tempdir().unwrap();
        let made = make(5, Category::Single, 0).unwrap();
        case(
            folder.path(),
            &made,
            &serde_json::json!({ "truth": made.key.truth }),
        )
        .unwrap();
        let here = folder.path().join(&made.id);
        let text = |name: &str| std::fs::read_to_string(here.join(name)).unwrap();
        let head = |name: &str| text(name).lines().next().unwrap().to_owned();
        let has = |name: &str, column: &str| head(name).split(',').any(|c| c == column);
        for column in [
            "t_s",
            "x_m",
            "smooth_x_m",
            "smooth_u_mps",
            "smooth_d_u_mps2",
            "load_surge_n",
        ] {
            assert!(has("run-0.csv", column), "{column}: {}", head("run-0.csv"));
        }
        assert!(has("laws-0.csv", "cubic_damping surge @ surge"));
        let rows = |name: &str| text(name).lines().count();
        assert_eq!(rows("run-0.csv"), rows("laws-0.csv"));
        let laws: serde_json::Value = serde_json::from_str(&text("laws.json")).unwrap();
        assert_eq!(laws["cubic_damping surge @ surge"]["linear_in_first"], true);
        for name in std::fs::read_dir(&here).unwrap() {
            let name = name.unwrap().file_name().into_string().unwrap();
            assert!(!text(&name).contains("\"truth\""), "{name}");
        }
        assert!(
            folder
                .path()
                .join("keys")
                .join(format!("{}.json", made.id))
                .exists()
        );
    }
}

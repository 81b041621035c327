//! Coefficients of a rig or of a result, with what is known of each.

use hydroline_identify::parameter::Coefficient;
use hydroline_identify::predict::{Identified, PredictError};
use hydroline_rigs::{Dof, Rig, RigError};
use serde::Deserialize;
use std::collections::BTreeMap;

use super::regime::Seen;

/// Standard deviations to either side of a central interval of 95 % of a normal distribution.
const NORMAL_95: f64 = 1.959_964;

/// One coefficient.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Row {
    /// The coefficient.
    pub coefficient: Coefficient,
    /// Its value, SI.
    pub value: f64,
    /// Standard deviation; `None` = nothing is known of it.
    pub sd: Option<f64>,
    /// 95 % interval.
    pub interval: Option<[f64; 2]>,
}

/// Coefficients in SNAME order, and what stood beside them.
#[derive(Debug, Clone, PartialEq)]
pub struct Fitted {
    /// What they were read from: `identify`, `diagnose`, or the rig's name.
    pub source: String,
    /// One per coefficient that is there.
    pub rows: Vec<Row>,
    /// Coefficients of which the covariance is known, in its order.
    pub order: Vec<Coefficient>,
    /// Covariance of them, SI: of the whole budget where one was made, else by the samples; empty = the source holds none.
    pub covariance: Vec<Vec<f64>>,
    /// Coefficients that the runs of the source do not determine: what stands there is the prior's.
    pub undetermined: Vec<Coefficient>,
    /// The fit stood beside the rig's numbers as prior.
    pub beside_prior: bool,
    /// Mass of the vehicle \[kg\], where the source says it.
    pub mass_kg: Option<f64>,
    /// Gravitational acceleration \[m/s2\], where the source says it.
    pub gravity_mps2: Option<f64>,
    /// Motion of each run by DOF, where the source says it.
    pub runs: Vec<(String, Vec<(Dof, Seen)>)>,
    /// Where the uncertainty comes from when runs of the vehicle did not give it, as the spread of published sets.
    pub basis: Option<String>,
    /// What the source does not hold, with the next step; one sentence each.
    pub missing: Vec<String>,
}

/// Failure to read coefficients.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)] // Each message names its fields.
pub enum FittedError {
    #[error(
        "{file}: {reason}; give a rig (.toml), or the output of hydroline identify --json or diagnose --json"
    )]
    Json { file: String, reason: String },
    #[error(transparent)]
    Rig(#[from] RigError),
    #[error(transparent)]
    Identified(#[from] PredictError),
}

#[derive(Deserialize)]
struct Estimate {
    value: f64,
    sd: Option<f64>,
    low: Option<f64>,
    high: Option<f64>,
    /// Determined by the runs; `None` = the source does not say.
    excited: Option<bool>,
}

#[derive(Deserialize)]
struct OfRun {
    name: String,
    #[serde(default)]
    seen: BTreeMap<String, Seen>,
}

#[derive(Deserialize)]
struct Parameters {
    after: BTreeMap<String, Estimate>,
    #[serde(default)]
    written: BTreeMap<String, Estimate>,
}

/// The parts of `identify --json` that are read here.
#[derive(Deserialize)]
struct OfIdentify {
    parameters: BTreeMap<String, Estimate>,
    #[serde(default)]
    runs: Vec<OfRun>,
    #[serde(default)]
    flat_priors: Option<bool>,
    #[serde(default)]
    order: Vec<String>,
    #[serde(default)]
    covariance: Vec<Vec<Option<f64>>>,
    #[serde(default)]
    covariance_combined: Vec<Vec<Option<f64>>>,
}

impl OfIdentify {
    /// Coefficients that are determined, and their covariance.
    fn covariance(&self) -> (Vec<Coefficient>, Vec<Vec<f64>>) {
        let whole = match self.covariance_combined.is_empty() {
            true => &self.covariance,
            false => &self.covariance_combined,
        };
        let at = |i: usize, k: usize| whole.get(i)?.get(k).copied().flatten();
        let determined: Vec<(usize, Coefficient)> = (self.order.iter().enumerate())
            .filter_map(|(i, key)| {
                at(i, i).filter(|v| *v > 0.0)?;
                Some((i, Coefficient::find(key)?))
            })
            .collect();
        let rows = determined.iter().map(|(i, _)| {
            let row = determined.iter().map(|(k, _)| at(*i, *k).unwrap_or(0.0));
            row.collect()
        });
        let rows = rows.collect();
        (determined.into_iter().map(|(_, c)| c).collect(), rows)
    }
}

/// The parts of `diagnose --json`.
#[derive(Deserialize)]
struct OfDiagnose {
    parameters: Parameters,
}

impl Fitted {
    /// Coefficients of a rig, with the uncertainty in its `[identified]`.
    ///
    /// # Errors
    /// [`FittedError::Identified`] where that belongs to other values.
    pub fn of_rig(rig: &Rig) -> Result<Fitted, FittedError> {
        let known = Identified::of_rig(rig)?;
        let sd = |c: Coefficient| {
            let known = known.as_ref()?;
            let place = known.values.iter().position(|(k, _)| *k == c)?;
            let variance = known.covariance[(place, place)];
            (variance > 0.0).then(|| variance.sqrt())
        };
        let rows = all().map(|coefficient| {
            let value = coefficient.of_vehicle(&rig.vehicle);
            let sd = sd(coefficient);
            Row {
                coefficient,
                value,
                sd,
                interval: sd.map(|sd| [value - NORMAL_95 * sd, value + NORMAL_95 * sd]),
            }
        });
        let mut missing = Vec::new();
        if known.is_none() {
            missing.push("no uncertainty: the rig has no [identified]; hydroline identify LOG... --write-rig writes one".to_owned());
        }
        let (order, covariance) = known.as_ref().map_or_else(Default::default, |known| {
            let order: Vec<Coefficient> = known.values.iter().map(|(c, _)| *c).collect();
            let row = |i| (0..order.len()).map(move |k| (i, k));
            let rows = (0..order.len()).map(|i| row(i).map(|at| known.covariance[at]).collect());
            let rows = rows.collect();
            (order, rows)
        });
        let basis = rig.identified.as_ref().and_then(|k| k.source.clone());
        if let Some(basis) = &basis {
            missing.push(format!("the intervals are of no run of this vehicle: {basis}; hydroline identify LOG... --write-rig puts measured ones there"));
        }
        missing.push("no speeds, amplitudes and frequencies: a rig does not say of which runs its coefficients are; give the result of hydroline identify --json".to_owned());
        Ok(Fitted {
            source: rig.name.clone(),
            rows: rows.collect(),
            order,
            covariance,
            undetermined: Vec::new(),
            beside_prior: false,
            mass_kg: Some(rig.vehicle.mass_kg),
            gravity_mps2: Some(rig.vehicle.gravity_mps2),
            runs: Vec::new(),
            basis,
            missing,
        })
    }

    /// Coefficients of the JSON that `identify` or `diagnose` printed.
    ///
    /// # Errors
    /// [`FittedError::Json`].
    pub fn from_json(text: &str, file: &str) -> Result<Fitted, FittedError> {
        let bad = |reason: String| FittedError::Json {
            file: file.to_owned(),
            reason,
        };
        let json: serde_json::Value =
            serde_json::from_str(text).map_err(|e| bad(format!("no JSON: {e}")))?;
        let is_verdict = json.get("verdict").is_some();
        let mut beside_prior = false;
        let (source, parameters, runs, (order, covariance)) = if is_verdict {
            let of: OfDiagnose =
                serde_json::from_value(json).map_err(|e| bad(format!("no verdict: {e}")))?;
            let Parameters { after, written } = of.parameters;
            let chosen = if written.is_empty() { after } else { written };
            ("diagnose", chosen, Vec::new(), Default::default())
        } else {
            let of: OfIdentify =
                serde_json::from_value(json).map_err(|e| bad(format!("no identification: {e}")))?;
            let known = of.covariance();
            beside_prior = of.flat_priors == Some(false);
            ("identify", of.parameters, of.runs, known)
        };
        if let Some(key) = parameters.keys().find(|k| Coefficient::find(k).is_none()) {
            return Err(bad(format!("`{key}` is no coefficient")));
        }
        let row = |coefficient: Coefficient| {
            let of = parameters.get(coefficient.key())?;
            let by_sd = of
                .sd
                .map(|sd| [of.value - NORMAL_95 * sd, of.value + NORMAL_95 * sd]);
            Some(Row {
                coefficient,
                value: of.value,
                sd: of.sd,
                interval: of.low.zip(of.high).map(|(l, h)| [l, h]).or(by_sd),
            })
        };
        let rows: Vec<Row> = all().filter_map(row).collect();
        if rows.is_empty() {
            return Err(bad("no coefficient in `parameters`".to_owned()));
        }
        let undetermined = all().filter(|c| {
            let of = parameters.get(c.key());
            of.is_some_and(|p| p.excited == Some(false))
        });
        let undetermined = undetermined.collect();
        let seen = |run: OfRun| {
            let by_dof = Dof::ALL
                .into_iter()
                .filter_map(|d| Some((d, *run.seen.get(d.name())?)));
            (run.name, by_dof.collect::<Vec<_>>())
        };
        let runs: Vec<_> = runs
            .into_iter()
            .map(seen)
            .filter(|r| !r.1.is_empty())
            .collect();
        let mut missing = Vec::new();
        if runs.is_empty() {
            missing.push(format!("no speeds, amplitudes and frequencies: {file} holds none of its runs; hydroline identify --json prints them"));
        }
        Ok(Fitted {
            source: source.to_owned(),
            rows,
            order,
            covariance,
            undetermined,
            beside_prior,
            mass_kg: None,
            gravity_mps2: None,
            runs,
            basis: None,
            missing,
        })
    }
}

/// The eighteen in SNAME order.
fn all() -> impl Iterator<Item = Coefficient> {
    Dof::ALL.into_iter().flat_map(Coefficient::of)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rig_gives_all_eighteen_and_the_sd_of_those_identified() {
        let mut rig = Rig::builtin("lshpi").unwrap();
        let bare = Fitted::of_rig(&rig).unwrap();
        assert_eq!(bare.rows.len(), 18);
        assert!(bare.rows.iter().all(|r| r.sd.is_none()));
        assert!(bare.missing.iter().any(|m| m.contains("[identified]")));
        rig.identified = Some(hydroline_rigs::Identified {
            coefficients: vec!["x_u".into()],
            values: vec![-20.0],
            sd: vec![2.0],
            covariance: vec![vec![4.0]],
            source: None,
        });
        let known = Fitted::of_rig(&rig).unwrap();
        let x_u = known.rows.iter().find(|r| r.coefficient.key() == "x_u");
        let [low, high] = x_u.unwrap().interval.unwrap();
        assert!((low + 23.919_928).abs() < 1e-6 && (high + 16.080_072).abs() < 1e-6);
    }

    #[test]
    fn a_spread_of_published_sets_does_not_pass_for_a_measurement() {
        let known = Fitted::of_rig(&Rig::builtin("bluerov2").unwrap()).unwrap();
        assert!(known.rows.iter().all(|r| r.sd.is_some()));
        assert!(known.basis.unwrap().contains("no measurement"));
        let said = known
            .missing
            .iter()
            .any(|m| m.contains("no run of this vehicle"));
        assert!(said, "{:?}", known.missing);
    }

    #[test]
    fn results_of_both_commands_are_read_and_others_are_refused() {
        let identify = r#"{"parameters":{"x_u":{"value":-20,"sd":1,"low":-22.5,"high":-18.0}},
            "runs":[{"name":"a","seen":{"surge":{"speed":0.3,"amplitude":0.1,"frequency_hz":0.2}}}]}"#;
        let of = Fitted::from_json(identify, "r.json").unwrap();
        assert_eq!(of.rows[0].interval, Some([-22.5, -18.0]));
        assert_eq!(of.runs[0].1[0].1.speed, 0.3);
        assert!(of.missing.is_empty());
        let diagnose = r#"{"verdict":"named","parameters":{"before":{},"after":{"x_u":{"value":-21,"sd":1}},
            "written":{"x_u":{"value":-20,"sd":null}}}}"#;
        let of = Fitted::from_json(diagnose, "d.json").unwrap();
        assert_eq!((of.rows[0].value, of.rows[0].sd), (-20.0, None));
        for (text, word) in [
            ("not json", "no JSON"),
            (r#"{"a":1}"#, "parameters"),
            (r#"{"parameters":{"x_zz":{"value":1,"sd":null}}}"#, "x_zz"),
            (r#"{"parameters":{}}"#, "no coefficient"),
        ] {
            let words = Fitted::from_json(text, "r.json").unwrap_err().to_string();
            assert!(
                words.contains(word) && words.contains("identify --json"),
                "{words}"
            );
        }
    }
}

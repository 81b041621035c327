//! The motion a plan will make, with its band.
//!
//! The plan goes through the same setpoints as `record` and `simulate`; the band is first order
//! in the coefficients' covariance, with the integrator's exact sensitivities:
//! variance(t) = g(t) C g(t)^T. Numbers that the rig holds without an uncertainty add none; those of them that
//! the plan's motion depends on are named.

pub mod report;
pub mod residuals;

use hydroline_numerics::cancel;
use hydroline_rigs::{Dof, Plan, Rig};
use hydroline_sim::effect::{EffectError, check};
use hydroline_sim::model::{Model, ModelState};
use hydroline_sim::vehicle::Hydrodynamics;
use hydroline_sim::{Allocation, Dual, Real, ThrustError, Trajectory, TrajectoryError};
use nalgebra::DMatrix;
use serde::Serialize;

use crate::parameter::{Coefficient, Term};
use hydroline_core::run::{Channel, PerChannel};
use hydroline_plan::setpoint::{SetpointError, setpoint};

/// Coefficients with their covariance (rows and columns in the same order).
#[derive(Debug, Clone, PartialEq)]
pub struct Identified {
    /// Coefficients and their values \[SI\].
    pub values: Vec<(Coefficient, f64)>,
    /// Covariance of the values \[SI\].
    pub covariance: DMatrix<f64>,
}

/// Motion over time.
#[derive(Debug, Clone, PartialEq, Serialize, schemars::JsonSchema)]
pub struct Prediction {
    /// Names of the columns below.
    #[schemars(with = "[String; 12]")]
    pub channels: PerChannel<&'static str>,
    /// Since the plan's start \[s\].
    pub t_s: Vec<f64>,
    /// Pose in the tank frame, rates in the body frame, SI.
    #[schemars(with = "Vec<[f64; 12]>")]
    pub motion: Vec<PerChannel<f64>>,
    /// sd of the same from the coefficients' covariance; empty = no covariance was given.
    #[schemars(with = "Vec<[f64; 12]>")]
    pub sd: Vec<PerChannel<f64>>,
    /// Body wrench of the plan from each time on, only changes \[s; N, N m\].
    #[serde(skip)]
    pub commands: Vec<(f64, [f64; 6])>,
    /// Coefficients of the DOFs that move which carry no uncertainty: their uncertainty is not in the band.
    pub without_uncertainty: Vec<&'static str>,
}

impl Prediction {
    /// When the plan asks for a load for the first time \[s\]; `None` = never.
    pub fn first_load_s(&self) -> Option<f64> {
        let loaded = |c: &&(f64, [f64; 6])| c.1.iter().any(|v| *v != 0.0);
        self.commands.iter().find(loaded).map(|c| c.0)
    }
}

/// Failure to predict.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)] // Each message names its fields.
pub enum PredictError {
    /// A step asks for what the thrusters cannot do.
    #[error(transparent)]
    Plan(#[from] SetpointError),
    #[error(transparent)]
    Thrust(#[from] ThrustError),
    #[error(transparent)]
    Effect(#[from] EffectError),
    #[error(transparent)]
    Trajectory(#[from] TrajectoryError),
    #[error("{file}: {reason}; give the output of hydroline identify --json")]
    Identified { file: String, reason: String },
    #[error(
        "[identified] of rig {rig}: {reason}; mend or take out that table, or write the rig anew (hydroline identify LOG... --write-rig)"
    )]
    OfRig { rig: String, reason: String },
}

/// All eighteen at once.
const N: usize = 18;
/// Grid of the integration \[s\].
const STEP_S: f64 = 0.02;

impl Identified {
    /// Reads the JSON of `identify --json`.
    ///
    /// # Errors
    /// [`PredictError::Identified`].
    pub fn from_json(text: &str, file: &str) -> Result<Identified, PredictError> {
        let bad = |reason: String| PredictError::Identified {
            file: file.to_owned(),
            reason,
        };
        let json: serde_json::Value = serde_json::from_str(text).map_err(|e| bad(e.to_string()))?;
        let order = json["order"]
            .as_array()
            .ok_or_else(|| bad("no `order`".into()))?;
        let mut values = Vec::new();
        for key in order {
            let key = key.as_str().unwrap_or_default();
            let coefficient =
                Coefficient::find(key).ok_or_else(|| bad(format!("`{key}` is no coefficient")))?;
            if values.iter().any(|(c, _)| *c == coefficient) {
                return Err(bad(format!("`{key}` stands twice in `order`")));
            }
            let value = json["parameters"][key]["value"]
                .as_f64()
                .ok_or_else(|| bad(format!("no value of `{key}`")))?;
            values.push((coefficient, value));
        }
        if values.is_empty() {
            return Err(bad("`order` is empty: no coefficient".into()));
        }
        let whole = match json["covariance_combined"].is_array() {
            true => "covariance_combined",
            false => "covariance",
        };
        let cell = |i: usize, j: usize| json[whole][i][j].as_f64();
        let n = values.len();
        for (i, (coefficient, _)) in values.iter().enumerate() {
            if cell(i, i).is_none() {
                return Err(bad(format!(
                    "{} was not determined (no variance): its band is unbounded; fix it (--fix) or run the experiment that excites it",
                    coefficient.key()
                )));
            }
            if cell(i, i).is_some_and(|v| v < 0.0) {
                return Err(bad(format!(
                    "the variance of {} is negative",
                    coefficient.key()
                )));
            }
        }
        Ok(Identified {
            covariance: DMatrix::from_fn(n, n, |i, j| cell(i, j).unwrap_or(0.0)),
            values,
        })
    }

    /// Coefficients and covariance in the rig's own `[identified]`; `Ok(None)` = it has none.
    ///
    /// # Errors
    /// [`PredictError::OfRig`] where it belongs to other coefficients than `[vehicle]` has, or names none.
    pub fn of_rig(rig: &Rig) -> Result<Option<Identified>, PredictError> {
        let Some(known) = &rig.identified else {
            return Ok(None);
        };
        let bad = |reason: String| PredictError::OfRig {
            rig: rig.name.clone(),
            reason,
        };
        let mut values = Vec::new();
        for (key, value) in known.coefficients.iter().zip(&known.values) {
            let coefficient =
                Coefficient::find(key).ok_or_else(|| bad(format!("`{key}` is no coefficient")))?;
            let said = coefficient.of_vehicle(&rig.vehicle);
            if said != *value {
                return Err(bad(format!(
                    "its covariance belongs to {key} = {value}, but [vehicle] says {said}"
                )));
            }
            if values.iter().any(|(c, _)| *c == coefficient) {
                return Err(bad(format!("`{key}` stands there twice")));
            }
            values.push((coefficient, *value));
        }
        let n = values.len();
        Ok((n > 0).then(|| Identified {
            covariance: DMatrix::from_fn(n, n, |i, j| known.covariance[i][j]),
            values,
        }))
    }

    /// Values that no hull has: damping that drives, added mass that takes mass away. One sentence each.
    pub fn implausible(&self) -> Vec<String> {
        let positive = self.values.iter().filter(|(_, value)| *value > 0.0);
        positive
            .map(|(c, value)| {
                let what = match c.term {
                    Term::Added => "added mass that makes the hull lighter",
                    Term::Linear | Term::Quadratic => "damping that drives the motion",
                };
                format!(
                    "{} is {value}: positive is {what}, which no hull has",
                    c.key()
                )
            })
            .collect()
    }
}

/// Predicts a plan from rest at the rig's start pose, at `rate_hz`, until `tail_s` after its end.
///
/// # Errors
/// [`PredictError`].
pub fn predict(
    rig: &Rig,
    plan: &Plan,
    identified: Option<&Identified>,
    rate_hz: f64,
    tail_s: f64,
) -> Result<Prediction, PredictError> {
    let allocation = Allocation::new(&rig.thrusters)?;
    let mut hydrodynamics: Hydrodynamics<Dual<N>> = Hydrodynamics::new(&rig.vehicle);
    for (i, (c, value)) in identified.iter().flat_map(|k| &k.values).enumerate() {
        let place = match c.term {
            Term::Added => &mut hydrodynamics.added,
            Term::Linear => &mut hydrodynamics.linear,
            Term::Quadratic => &mut hydrodynamics.quadratic,
        };
        place[c.dof.index()] = Dual::variable(*value, i);
    }
    let model = Model::assemble(hydrodynamics, &check(&rig.physics)?, |_, _, v| {
        Dual::from_f64(v)
    })?;
    let mut path = Trajectory::new(
        model,
        ModelState::at_rest(rig.tank.start_pose.map(Dual::from_f64)),
        STEP_S,
    )?;
    let length_s = plan.duration_s() + tail_s;
    let command_rate_hz = rig.thrusters.link.rate_hz;
    let (mut next, mut last) = (0u64, None);
    let mut out = Prediction {
        channels: PerChannel::from_fn(Channel::name),
        t_s: Vec::new(),
        motion: Vec::new(),
        sd: Vec::new(),
        commands: Vec::new(),
        without_uncertainty: Vec::new(),
    };
    // Way (turn) of each DOF from start to end, there and back again.
    let mut travelled = [0.0; 6];
    let samples = (length_s * rate_hz).floor() as u64;
    for k in 0..=samples {
        cancel::check();
        let t_s = k as f64 / rate_hz;
        while next as f64 / command_rate_hz <= t_s {
            let command_s = next as f64 / command_rate_hz;
            let set = setpoint(rig, &allocation, plan, command_s)?;
            let wrench = allocation.wrench(&set.thrust_n)?.to_array();
            if last != Some(wrench) {
                path.command(Dual::from_f64(command_s), wrench.map(Dual::from_f64))?;
                out.commands.push((command_s, wrench));
                last = Some(wrench);
            }
            next += 1;
        }
        let state = path.state_at(Dual::from_f64(t_s))?.vehicle;
        let all = PerChannel::of_state(state.eta, state.nu);
        for (way, rate) in travelled.iter_mut().zip(&state.nu) {
            *way += rate.value.abs() / rate_hz;
        }
        out.t_s.push(t_s);
        out.motion.push(all.map(|d| d.value));
        if let Some(known) = identified {
            out.sd
                .push(all.map(|d| spread(&d.slope, &known.covariance)));
        }
    }
    if let Some(known) = identified {
        out.without_uncertainty = without_uncertainty(rig, known, &travelled);
    }
    Ok(out)
}

/// Coefficients without a variance, of the DOFs that travel farther than the rig's tolerance of a pose.
fn without_uncertainty(rig: &Rig, known: &Identified, travelled: &[f64; 6]) -> Vec<&'static str> {
    let carries = |c: &Coefficient| {
        let place = known.values.iter().position(|(k, _)| k == c);
        place.is_some_and(|i| known.covariance[(i, i)] > 0.0)
    };
    let tolerance = rig.tolerance.channels().pose();
    let moves = |dof: &Dof| travelled[dof.index()] > tolerance[dof.index()];
    Dof::ALL
        .into_iter()
        .filter(moves)
        .flat_map(Coefficient::of)
        .filter(|c| !carries(c))
        .map(Coefficient::key)
        .collect()
}

fn spread(slope: &[f64; N], covariance: &DMatrix<f64>) -> f64 {
    let n = covariance.nrows();
    let mut variance = 0.0;
    for i in 0..n {
        for j in 0..n {
            variance += slope[i] * covariance[(i, j)] * slope[j];
        }
    }
    variance.max(0.0).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_identification_without_sense_is_refused_or_named() {
        let read = |order: &str, value: f64, covariance: &str| {
            let text = format!(
                r#"{{"order":{order},"parameters":{{"x_u":{{"value":{value}}}}},"covariance":{covariance}}}"#
            );
            Identified::from_json(&text, "fit.json")
        };
        for (order, covariance, word) in [
            ("[]", "[]", "empty"),
            (r#"["x_u","x_u"]"#, "[[1,0],[0,1]]", "twice"),
            (r#"["x_u"]"#, "[[-1]]", "negative"),
        ] {
            let words = read(order, -20.0, covariance).unwrap_err().to_string();
            assert!(words.contains(word), "{words}");
        }
        let sound = |value: f64| read(r#"["x_u"]"#, value, "[[1]]").unwrap().implausible();
        assert!(sound(-20.0).is_empty());
        assert!(sound(20.0)[0].contains("x_u"), "{:?}", sound(20.0));
    }

    #[test]
    fn coefficients_that_move_the_vehicle_without_an_uncertainty_are_named() {
        let rig = Rig::builtin("lshpi").unwrap();
        let plan = Plan::builtin("surge-8n").unwrap();
        let named = |keys: &[&str], variances: &[f64]| {
            let known = Identified {
                values: keys
                    .iter()
                    .map(|k| Coefficient::find(k).unwrap())
                    .map(|c| (c, c.of_vehicle(&rig.vehicle)))
                    .collect(),
                covariance: DMatrix::from_diagonal(&nalgebra::DVector::from_row_slice(variances)),
            };
            predict(&rig, &plan, Some(&known), 5.0, 0.0)
                .unwrap()
                .without_uncertainty
        };
        // Held by --fix, written with a variance of nothing: all the same. The push along x moves nothing else.
        assert_eq!(named(&["x_udot", "x_uu"], &[1.0, 9.0]), ["x_u"]);
        assert_eq!(named(&["x_udot", "x_u", "x_uu"], &[1.0, 0.0, 9.0]), ["x_u"]);
        assert!(named(&["x_udot", "x_u", "x_uu"], &[1.0, 0.04, 9.0]).is_empty());
        // Without any covariance there is no band to leave something out of.
        let bare = predict(&rig, &plan, None, 5.0, 0.0).unwrap();
        assert!(bare.without_uncertainty.is_empty());
    }

    #[test]
    fn a_rig_whose_identification_is_not_its_own_says_what_to_do_with_the_rig() {
        let mut rig = Rig::builtin("lshpi").unwrap();
        let value = rig.vehicle.coefficients[0].linear;
        rig.identified = Some(hydroline_rigs::Identified {
            coefficients: vec!["x_u".into()],
            values: vec![value],
            sd: vec![1.0],
            covariance: vec![vec![1.0]],
            source: None,
        });
        assert!(Identified::of_rig(&rig).unwrap().is_some());
        rig.vehicle.coefficients[0].linear = value - 1.0;
        let words = Identified::of_rig(&rig).unwrap_err().to_string();
        for word in ["[identified]", "x_u = ", "[vehicle]", "--write-rig"] {
            assert!(words.contains(word), "no {word:?} in {words}");
        }
        assert!(!words.contains("--json"), "{words}");
    }

    #[test]
    fn a_rig_file_and_an_identification_name_coefficients_alike() {
        for dof in Dof::ALL {
            assert_eq!(
                Coefficient::of(dof).map(Coefficient::key),
                dof.coefficient_names()
            );
        }
    }

    #[test]
    fn a_prediction_is_the_simulation_and_its_band_the_spread_of_draws() {
        let rig = Rig::builtin("lshpi").unwrap();
        let plan = Plan::builtin("surge-8n").unwrap();
        let keys = ["x_udot", "x_u", "x_uu"];
        let values: Vec<_> = keys
            .iter()
            .map(|k| Coefficient::find(k).unwrap())
            .map(|c| (c, c.of_vehicle(&rig.vehicle)))
            .collect();
        let covariance =
            DMatrix::from_row_slice(3, 3, &[1.0, 0.1, 0.5, 0.1, 0.04, -0.3, 0.5, -0.3, 9.0]);
        let known = Identified {
            values,
            covariance: covariance.clone(),
        };
        let p = predict(&rig, &plan, Some(&known), 10.0, 0.0).unwrap();
        assert!(
            (p.motion.last().unwrap()[Channel::X] - (rig.tank.start_pose[0] + 1.0)).abs() < 0.02,
            "1 m at 8 N in 10.42 s"
        );
        // Finite differences along the three square-root directions of the covariance.
        let root = covariance.cholesky().unwrap().l();
        let end = |column: Option<usize>| {
            let mut moved = rig.clone();
            if let Some(j) = column {
                for (i, (c, value)) in known.values.iter().enumerate() {
                    c.put(&mut moved.vehicle, value + 0.01 * root[(i, j)]);
                }
            }
            predict(&moved, &plan, None, 10.0, 0.0)
                .unwrap()
                .motion
                .last()
                .unwrap()[Channel::X]
        };
        let by_hand = (0..3)
            .map(|j| ((end(Some(j)) - end(None)) / 0.01).powi(2))
            .sum::<f64>()
            .sqrt();
        let band = p.sd.last().unwrap()[Channel::X];
        assert!(
            band > 1e-5 && (band / by_hand - 1.0).abs() < 0.01,
            "{band} {by_hand}"
        );
    }
}

//! Joint draws from what is known of a vehicle: coefficients and effects, over the models of a posterior.

use hydroline_identify::parameter::Coefficient;
use hydroline_identify::predict::{Identified, PredictError};
use hydroline_rigs::{ParameterValue, PhysicsEntry, Rig, Vehicle};
use hydroline_sim::EffectError;
use hydroline_sim::effect::check;
use nalgebra::{DMatrix, DVector, SymmetricEigen};
use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};
use rand_distr::StandardNormal;
use serde::Deserialize;

/// Share of the largest variance (at unit variances) below which a direction has none.
const NEGLIGIBLE: f64 = 1e-12;

/// A model with the joint distribution of its numbers.
#[derive(Debug, Clone, PartialEq)]
pub struct Weighted {
    /// Probability, up to a common factor.
    pub probability: f64,
    /// Its effects; `None` = those of the rig.
    pub physics: Option<Vec<PhysicsEntry>>,
    /// Names: coefficients and other numbers of the vehicle, and `PLACE.PARAMETER` of an effect, counted from 1.
    pub names: Vec<String>,
    /// Values about which is drawn, SI.
    pub values: Vec<f64>,
    /// Whether the logarithm of the number's size is normal.
    pub logarithmic: Vec<bool>,
    /// Covariance, of the logarithms where those are normal.
    pub covariance: DMatrix<f64>,
}

/// Draws, one row each.
#[derive(Debug, Clone, PartialEq)]
pub struct Draws {
    /// Names of the columns; those of an effect are EFFECT_DOF.PARAMETER.
    pub names: Vec<String>,
    /// Place of each row's model, most probable first.
    pub models: Vec<usize>,
    /// Values, SI; NaN = the row's model has no such number.
    pub rows: Vec<Vec<f64>>,
}

/// Failure to draw.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)] // Each message names its fields.
pub enum DrawError {
    #[error(
        "rig {rig} says no uncertainty: nothing to draw from; write it with hydroline identify LOG... --write-rig, or give the result of identify --json or diagnose --json (--from RESULT.json)"
    )]
    Certain { rig: String },
    #[error(transparent)]
    Identified(#[from] PredictError),
    #[error("{file}: {reason}; give the output of hydroline identify --json or diagnose --json")]
    Json { file: String, reason: String },
    #[error(
        "draw {draw} (seed {seed}): {name} = {value}, which no rig has: {reason}; take another draw"
    )]
    Outside {
        draw: usize,
        seed: u64,
        name: String,
        value: f64,
        reason: String,
    },
    #[error("draw {draw} (seed {seed}): its effects are of no rig: {source}; take another draw")]
    Effects {
        draw: usize,
        seed: u64,
        source: EffectError,
    },
}

#[derive(Deserialize)]
struct OfPosterior {
    probability: f64,
    physics: String,
    numbers: Vec<String>,
    values: Vec<f64>,
    logarithmic: Vec<bool>,
    covariance: Vec<Vec<f64>>,
}

fn normal(known: &Identified) -> Vec<Weighted> {
    vec![Weighted {
        probability: 1.0,
        physics: None,
        names: known
            .values
            .iter()
            .map(|(c, _)| c.key().to_owned())
            .collect(),
        values: known.values.iter().map(|(_, v)| *v).collect(),
        logarithmic: vec![false; known.values.len()],
        covariance: known.covariance.clone(),
    }]
}

/// The one model of a rig: the coefficients in its `[identified]`, beside its effects as they are.
///
/// # Errors
/// [`DrawError::Certain`], [`DrawError::Identified`].
pub fn of_rig(rig: &Rig) -> Result<Vec<Weighted>, DrawError> {
    let known = Identified::of_rig(rig)?;
    let known = known.ok_or_else(|| DrawError::Certain {
        rig: rig.name.clone(),
    })?;
    Ok(normal(&known))
}

/// Models of the JSON that `identify` (one) or `diagnose` (those of its posterior) printed.
///
/// # Errors
/// [`DrawError::Json`], [`DrawError::Identified`].
pub fn of_json(text: &str, file: &str) -> Result<Vec<Weighted>, DrawError> {
    let bad = |reason: String| DrawError::Json {
        file: file.to_owned(),
        reason,
    };
    let json: serde_json::Value =
        serde_json::from_str(text).map_err(|e| bad(format!("no JSON: {e}")))?;
    if json.get("verdict").is_none() {
        return Ok(normal(&Identified::from_json(text, file)?));
    }
    let posterior = json.get("posterior").cloned().unwrap_or_default();
    let models: Vec<OfPosterior> = serde_json::from_value(posterior)
        .map_err(|e| bad(format!("no `posterior` with models: {e}")))?;
    if models.is_empty() {
        return Err(bad("its `posterior` holds no model".to_owned()));
    }
    models
        .into_iter()
        .map(|m| weighted(m).map_err(bad))
        .collect()
}

fn weighted(model: OfPosterior) -> Result<Weighted, String> {
    let n = model.numbers.len();
    let is_square = model.covariance.len() == n && model.covariance.iter().all(|r| r.len() == n);
    if model.values.len() != n || model.logarithmic.len() != n || !is_square {
        return Err(format!(
            "a model of `posterior` has {n} numbers, but {} values and {} rows of covariance",
            model.values.len(),
            model.covariance.len()
        ));
    }
    Ok(Weighted {
        probability: model.probability,
        physics: Some(entries(&model.physics)?),
        values: model.values,
        logarithmic: model.logarithmic,
        covariance: DMatrix::from_fn(n, n, |i, j| model.covariance[i][j]),
        names: model.numbers,
    })
}

/// `[[physics]]` tables of a text.
fn entries(text: &str) -> Result<Vec<PhysicsEntry>, String> {
    let table: toml::Table = text.parse().map_err(|e| format!("its `physics`: {e}"))?;
    let list = table.get("physics").and_then(toml::Value::as_array);
    let entry = |value: &toml::Value| {
        let table = value
            .as_table()
            .ok_or("an entry of `physics` is no table")?;
        let effect = table.get("effect").and_then(toml::Value::as_str);
        let mut made = PhysicsEntry {
            effect: effect
                .ok_or("an entry of `physics` names no effect")?
                .to_owned(),
            parameters: Vec::new(),
        };
        for (name, value) in table.iter().filter(|(name, _)| *name != "effect") {
            let value = match (
                value.as_float().or(value.as_integer().map(|i| i as f64)),
                value.as_str(),
            ) {
                (Some(number), _) => ParameterValue::Number(number),
                (None, Some(word)) => ParameterValue::Word(word.to_owned()),
                (None, None) => {
                    return Err(format!(
                        "{name} of `physics` is neither a number nor a word"
                    ));
                }
            };
            made.parameters.push((name.clone(), value));
        }
        Ok(made)
    };
    list.into_iter().flatten().map(entry).collect()
}

/// Name of a column: an effect's number by the effect and where it acts.
fn column(model: &Weighted, name: &str) -> String {
    let found = name.split_once('.').and_then(|(place, parameter)| {
        let entry = model
            .physics
            .as_ref()?
            .get(place.parse::<usize>().ok()? - 1)?;
        let dof = entry.parameters.iter().find_map(|(n, v)| match v {
            ParameterValue::Word(word) if n == "dof" => Some(format!("_{word}")),
            _ => None,
        });
        Some(format!(
            "{}{}.{parameter}",
            entry.effect,
            dof.unwrap_or_default()
        ))
    });
    found.unwrap_or_else(|| name.to_owned())
}

/// A matrix R with R R^T = the covariance; directions of a negative variance by rounding have none.
fn root(covariance: &DMatrix<f64>) -> DMatrix<f64> {
    let n = covariance.nrows();
    let scale: Vec<f64> = (0..n).map(|i| covariance[(i, i)].max(0.0).sqrt()).collect();
    let one = |v: f64| if v > 0.0 { v } else { 1.0 };
    let unit = DMatrix::from_fn(n, n, |i, j| {
        0.5 * (covariance[(i, j)] + covariance[(j, i)]) / (one(scale[i]) * one(scale[j]))
    });
    let eigen = SymmetricEigen::new(unit);
    let largest = eigen.eigenvalues.iter().copied().fold(0.0, f64::max);
    DMatrix::from_fn(n, n, |i, k| {
        let variance = eigen.eigenvalues[k];
        let kept = if variance > NEGLIGIBLE * largest {
            variance.sqrt()
        } else {
            0.0
        };
        scale[i] * eigen.eigenvectors[(i, k)] * kept
    })
}

/// Numbers of one draw, by its model's names.
#[derive(Debug, Clone, PartialEq)]
pub struct Draw {
    /// Place of its model.
    pub model: usize,
    /// Values in the order of the model's names.
    pub values: Vec<f64>,
}

/// The first `count` draws of a seed; a model is chosen by its probability for each. The same seed gives the same draws, however many.
pub fn drawn(models: &[Weighted], count: usize, seed: u64) -> Vec<Draw> {
    let roots: Vec<DMatrix<f64>> = models.iter().map(|m| root(&m.covariance)).collect();
    let total: f64 = models.iter().map(|m| m.probability).sum();
    let mut random = StdRng::seed_from_u64(seed);
    let one = |_| {
        let mut left = random.random::<f64>() * total;
        let chosen = models.iter().position(|m| {
            left -= m.probability;
            left < 0.0
        });
        let model = chosen.unwrap_or(models.len() - 1);
        let of = &models[model];
        let white = DVector::from_fn(of.names.len(), |_, _| {
            random.sample::<f64, _>(StandardNormal)
        });
        let moved = &roots[model] * white;
        let value = |i: usize| {
            if of.logarithmic[i] {
                of.values[i] * moved[i].exp()
            } else {
                of.values[i] + moved[i]
            }
        };
        Draw {
            model,
            values: (0..of.names.len()).map(value).collect(),
        }
    };
    (0..if models.is_empty() { 0 } else { count })
        .map(one)
        .collect()
}

/// The same as a table.
pub fn table(models: &[Weighted], drawn: &[Draw]) -> Draws {
    let mut names: Vec<String> = Vec::new();
    let mut places = Vec::new();
    for model in models {
        let of = model.names.iter().map(|name| {
            let name = column(model, name);
            names.iter().position(|n| *n == name).unwrap_or_else(|| {
                names.push(name);
                names.len() - 1
            })
        });
        places.push(of.collect::<Vec<usize>>());
    }
    let row = |draw: &Draw| {
        let mut row = vec![f64::NAN; names.len()];
        for (place, value) in places[draw.model].iter().zip(&draw.values) {
            row[*place] = *value;
        }
        row
    };
    Draws {
        models: drawn.iter().map(|d| d.model).collect(),
        rows: drawn.iter().map(row).collect(),
        names,
    }
}

/// The rig of a draw; `place` and `seed` are for messages.
///
/// # Errors
/// [`DrawError::Outside`], [`DrawError::Effects`] where a number is beyond what a rig may have.
pub fn applied(
    rig: &Rig,
    models: &[Weighted],
    draw: &Draw,
    place: usize,
    seed: u64,
) -> Result<Rig, DrawError> {
    let mut rig = changed(rig, models, draw, place, seed)?;
    rig.effective_toml = rig.to_toml();
    Ok(rig)
}

/// Number of draws that are of no rig: their numbers alone are looked at, so that a million takes seconds.
pub fn refused(rig: &Rig, models: &[Weighted], drawn: &[Draw]) -> usize {
    let each = drawn.iter();
    each.filter(|d| changed(rig, models, d, 0, 0).is_err())
        .count()
}

/// The rig of a draw, its text still that of the rig before.
fn changed(
    rig: &Rig,
    models: &[Weighted],
    draw: &Draw,
    place: usize,
    seed: u64,
) -> Result<Rig, DrawError> {
    let model = &models[draw.model];
    let outside = |name: &str, value: f64, reason: String| DrawError::Outside {
        draw: place,
        seed,
        name: name.to_owned(),
        value,
        reason,
    };
    let mut rig = rig.clone();
    if let Some(physics) = &model.physics {
        rig.physics.clone_from(physics);
    }
    for (name, value) in model.names.iter().zip(&draw.values) {
        if let Some((entry, parameter)) = name.split_once('.') {
            let entry = entry
                .parse::<usize>()
                .ok()
                .and_then(|k| rig.physics.get_mut(k.checked_sub(1)?));
            let found = entry.and_then(|e| e.parameters.iter_mut().find(|(n, _)| n == parameter));
            match found {
                Some((_, old)) => *old = ParameterValue::Number(*value),
                None => {
                    return Err(outside(
                        name,
                        *value,
                        "its model has no such effect".to_owned(),
                    ));
                }
            }
        } else if !put(&mut rig.vehicle, name, *value) {
            return Err(outside(
                name,
                *value,
                "no number of a vehicle has this name".to_owned(),
            ));
        }
    }
    for c in hydroline_rigs::Dof::ALL
        .into_iter()
        .flat_map(Coefficient::of)
    {
        let value = c.of_vehicle(&rig.vehicle);
        if value > 0.0 {
            let reason = "damping and added mass are negative in SNAME's signs".to_owned();
            return Err(outside(c.key(), value, reason));
        }
    }
    check(&rig.physics).map_err(|source| DrawError::Effects {
        draw: place,
        seed,
        source,
    })?;
    // Drawn numbers carry no uncertainty of their own.
    rig.identified = None;
    Ok(rig)
}

/// Puts a number into a vehicle; `false` = it has none of this name.
fn put(vehicle: &mut Vehicle, name: &str, value: f64) -> bool {
    if let Some(coefficient) = Coefficient::find(name) {
        coefficient.put(vehicle, value);
        return true;
    }
    match name {
        "restoring_nm" => vehicle.r_bz_m = value / (vehicle.mass_kg * vehicle.gravity_mps2),
        "heave_stiffness_npm" => vehicle.stiffness[0] = value,
        "roll_stiffness_nmprad" => vehicle.stiffness[1] = value,
        "pitch_stiffness_nmprad" => vehicle.stiffness[2] = value,
        "net_weight_n" => vehicle.net_weight_n = value,
        _ => return false,
    }
    true
}

#[cfg(test)]
mod tests;

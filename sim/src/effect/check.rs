//! From a `[[physics]]` entry as typed to checked values.

use super::error::nearest;
use super::registry::{ALL, find};
use super::varying::{self, Typed};
use super::{EffectError, EffectInfo};
use hydroline_rigs::{ParameterValue, PhysicsEntry};

/// A number of an effect that depends on a covariate: value + (value - nothing) share, within the number's limits.
///
/// A law of which only the mechanism is known: friction that grows near rest, a lag that is another one at another load.
#[derive(Debug, Clone, PartialEq)]
pub struct Trend {
    /// Index of the number among the effect's.
    pub parameter: usize,
    /// Its value where the effect is not there: that stays, whatever the share.
    pub nothing: f64,
    /// Place in [`super::covariate_table::COVARIATES`].
    pub along: usize,
    /// Covariate at the first and the last point.
    pub range: (f64, f64),
    /// Share at equally spaced points.
    pub shares: Vec<f64>,
}

/// A checked entry: ready to become a law in any scalar.
#[derive(Debug, Clone, PartialEq)]
pub struct CheckedEffect {
    /// The effect.
    pub info: &'static EffectInfo,
    /// One number per `info.parameters`.
    pub numbers: Vec<f64>,
    /// One index into `allowed` per `info.words`.
    pub words: Vec<usize>,
    /// One of its numbers depends on where the motion is.
    pub trend: Option<Trend>,
    /// Notes on unusual values, e.g. a number outside of its plausible range.
    pub notes: Vec<String>,
}

impl CheckedEffect {
    /// An effect at its typical values: where a search starts. Words that must be given take the first one.
    pub fn typical(info: &'static EffectInfo) -> Self {
        let word = |w: &super::WordInfo| {
            let absent = w
                .absent
                .and_then(|a| w.allowed.iter().position(|x| *x == a));
            absent.unwrap_or(0)
        };
        CheckedEffect {
            info,
            numbers: info.parameters.iter().map(|p| p.typical).collect(),
            words: info.words.iter().map(word).collect(),
            trend: None,
            notes: Vec::new(),
        }
    }

    /// Index in SNAME order of the DOF that its words name; surge where none does.
    pub(super) fn dof(&self) -> usize {
        let named = self.info.words.iter().zip(&self.words);
        let mut dofs = named.filter(|(w, _)| w.name == super::info::DOF.name);
        dofs.next().map_or(0, |(w, i)| w.dof(*i))
    }

    /// The `[[physics]]` entry that reads back to this, every parameter written out.
    pub fn entry(&self) -> PhysicsEntry {
        let numbers = self.info.parameters.iter().zip(&self.numbers);
        let words = self.info.words.iter().zip(&self.words);
        let number = numbers.map(|(p, v)| (p.name.to_owned(), ParameterValue::Number(*v)));
        let word = words.filter_map(|(w, i)| {
            let word = w.allowed.get(*i)?;
            Some((w.name.to_owned(), ParameterValue::Word((*word).to_owned())))
        });
        let trend = self.trend.iter().flat_map(|t| varying::keys(self.info, t));
        PhysicsEntry {
            effect: self.info.id.to_owned(),
            parameters: number.chain(word).chain(trend).collect(),
        }
    }
}

/// Checks all entries of a rig.
///
/// # Errors
/// The first [`EffectError`] in file order.
pub fn check(entries: &[PhysicsEntry]) -> Result<Vec<CheckedEffect>, EffectError> {
    let mut checked: Vec<CheckedEffect> = Vec::with_capacity(entries.len());
    for entry in entries {
        let one = check_one(entry)?;
        if checked
            .iter()
            .any(|c| c.info.id == one.info.id && c.words == one.words)
        {
            let words = one.info.words.iter().zip(&one.words);
            return Err(EffectError::Duplicate {
                effect: one.info.id,
                words: words
                    .map(|(w, &i)| format!("{} = {}", w.name, w.allowed[i]))
                    .collect(),
            });
        }
        checked.push(one);
    }
    Ok(checked)
}

fn check_one(entry: &PhysicsEntry) -> Result<CheckedEffect, EffectError> {
    let info = find(&entry.effect).ok_or_else(|| EffectError::UnknownEffect {
        effect: entry.effect.clone(),
        nearest: nearest(&entry.effect, ALL.iter().map(|i| i.id)),
        known: ALL.iter().map(|i| i.id).collect(),
    })?;
    let mut numbers: Vec<Option<f64>> = vec![None; info.parameters.len()];
    let mut words: Vec<Option<usize>> = vec![None; info.words.len()];
    let mut trend = Typed::default();
    for (name, value) in &entry.parameters {
        if let Some(i) = info.parameter_index(name) {
            let number = number_of(info, i, value)?;
            if numbers[i].replace(number).is_some() {
                return Err(EffectError::Repeated {
                    effect: info.id,
                    parameter: info.parameters[i].name,
                });
            }
        } else if let Some(i) = info.words.iter().position(|w| w.name == name) {
            let word = word_of(info, i, value)?;
            if words[i].replace(word).is_some() {
                return Err(EffectError::Repeated {
                    effect: info.id,
                    parameter: info.words[i].name,
                });
            }
        } else if !trend.take(info, name, value)? {
            let known: Vec<&'static str> = info
                .parameters
                .iter()
                .map(|p| p.name)
                .chain(info.words.iter().map(|w| w.name))
                .collect();
            return Err(EffectError::UnknownParameter {
                effect: info.id,
                parameter: name.clone(),
                nearest: nearest(name, known.iter().copied()),
                known,
            });
        }
    }
    let mut notes = Vec::new();
    let mut final_numbers = Vec::with_capacity(numbers.len());
    for (p, given) in info.parameters.iter().zip(numbers) {
        let value = given.or(p.absent).ok_or(EffectError::Missing {
            effect: info.id,
            parameter: p.name,
            unit: p.unit,
            low: p.plausible.0,
            high: p.plausible.1,
        })?;
        if given.is_some() && !(p.plausible.0..=p.plausible.1).contains(&value) {
            notes.push(format!(
                "{}: {} = {value} {} lies outside of the plausible {} .. {}",
                info.id, p.name, p.unit, p.plausible.0, p.plausible.1
            ));
        }
        final_numbers.push(value);
    }
    let mut final_words = Vec::with_capacity(words.len());
    for (w, given) in info.words.iter().zip(words) {
        let absent = w
            .absent
            .and_then(|a| w.allowed.iter().position(|word| *word == a));
        final_words.push(given.or(absent).ok_or(EffectError::MissingWord {
            effect: info.id,
            parameter: w.name,
            allowed: w.allowed,
        })?);
    }
    Ok(CheckedEffect {
        info,
        numbers: final_numbers,
        words: final_words,
        trend: trend.checked(info)?,
        notes,
    })
}

fn number_of(
    info: &'static EffectInfo,
    i: usize,
    value: &ParameterValue,
) -> Result<f64, EffectError> {
    let p = &info.parameters[i];
    match value {
        // NaN fails the range test as well.
        ParameterValue::Number(v) if (p.limits.0..=p.limits.1).contains(v) => Ok(*v),
        ParameterValue::Number(v) => Err(EffectError::OutOfLimits {
            effect: info.id,
            parameter: p.name,
            value: *v,
            unit: p.unit,
            low: p.limits.0,
            high: p.limits.1,
        }),
        ParameterValue::Word(word) => Err(EffectError::WrongKind {
            effect: info.id,
            parameter: p.name,
            expected: format!("a number [{}]", p.unit),
            found: format!("\"{word}\""),
        }),
    }
}

fn word_of(
    info: &'static EffectInfo,
    i: usize,
    value: &ParameterValue,
) -> Result<usize, EffectError> {
    let w = &info.words[i];
    let found = match value {
        ParameterValue::Word(word) => match w.allowed.iter().position(|a| a == word) {
            Some(index) => return Ok(index),
            None => format!("\"{word}\""),
        },
        ParameterValue::Number(v) => v.to_string(),
    };
    Err(EffectError::WrongKind {
        effect: info.id,
        parameter: w.name,
        expected: format!("one of {}", w.allowed.join(", ")),
        found,
    })
}

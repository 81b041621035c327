//! Errors of a `[[physics]]` entry.

use std::fmt::Write;

/// A `[[physics]]` entry that cannot be used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[allow(missing_docs)] // Each message names its fields.
pub enum EffectError {
    #[error("[[physics]] effect = \"{effect}\": no such effect{}; known: {}", suggest(.nearest), .known.join(", "))]
    UnknownEffect {
        effect: String,
        /// Closest id, if one is close.
        nearest: Option<&'static str>,
        known: Vec<&'static str>,
    },
    #[error("[[physics]] {effect}: no parameter \"{parameter}\"{}; it takes: {}", suggest(.nearest), .known.join(", "))]
    UnknownParameter {
        effect: &'static str,
        parameter: String,
        /// Closest name, if one is close.
        nearest: Option<&'static str>,
        known: Vec<&'static str>,
    },
    #[error("[[physics]] {effect}: \"{parameter}\" [{unit}] is missing; typically {low} to {high}")]
    Missing {
        effect: &'static str,
        parameter: &'static str,
        unit: &'static str,
        low: f64,
        high: f64,
    },
    #[error("[[physics]] {effect}: \"{parameter}\" is missing; one of: {}", .allowed.join(", "))]
    MissingWord {
        effect: &'static str,
        parameter: &'static str,
        allowed: &'static [&'static str],
    },
    #[error("[[physics]] {effect}: {parameter} = {value} {unit}; it must lie in {low} .. {high}")]
    OutOfLimits {
        effect: &'static str,
        parameter: &'static str,
        value: f64,
        unit: &'static str,
        low: f64,
        high: f64,
    },
    #[error("[[physics]] {effect}: {parameter} must be {expected}, not {found}")]
    WrongKind {
        effect: &'static str,
        parameter: &'static str,
        expected: String,
        found: String,
    },
    #[error("[[physics]] {effect}: {parameter} is given twice; keep one")]
    Repeated {
        effect: &'static str,
        parameter: &'static str,
    },
    #[error("[[physics]] {effect} is switched on twice for the same {}; keep one entry", list(.words))]
    Duplicate {
        effect: &'static str,
        /// Its words, e.g. `dof = surge`.
        words: Vec<String>,
    },
    #[error(
        "the [[physics]] entries need {needed} states of their own, at most {limit} fit; switch some off"
    )]
    TooManyStates { needed: usize, limit: usize },
}

fn suggest(nearest: &Option<&'static str>) -> String {
    let mut text = String::new();
    if let Some(name) = nearest {
        let _ = write!(text, ", did you mean \"{name}\"?");
    }
    text
}

fn list(words: &[String]) -> String {
    if words.is_empty() {
        "rig".to_owned()
    } else {
        words.join(", ")
    }
}

/// The candidate closest to `typed`, if it is close enough to be meant (a third of its letters wrong at most).
pub(super) fn nearest(
    typed: &str,
    known: impl Iterator<Item = &'static str>,
) -> Option<&'static str> {
    known
        .map(|name| (edit_distance(typed, name), name))
        .min()
        .filter(|(distance, name)| *distance <= 1 + name.len() / 3)
        .map(|(_, name)| name)
}

/// Levenshtein distance in characters, two rows of the table at a time.
fn edit_distance(a: &str, b: &str) -> usize {
    let b: Vec<char> = b.chars().collect();
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, ca) in a.chars().take(80).enumerate() {
        let mut diagonal = row[0];
        row[0] = i + 1;
        for (j, cb) in b.iter().enumerate() {
            let substitute = diagonal + usize::from(ca != *cb);
            diagonal = row[j + 1];
            row[j + 1] = substitute.min(row[j] + 1).min(diagonal + 1);
        }
    }
    row[b.len()]
}

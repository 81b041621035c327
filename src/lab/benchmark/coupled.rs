//! Coupled cases: surge, sway and yaw driven at once, all six DOFs measured, effects in one of them, in a cross term or in
//! a DOF that nobody commanded, or none.
//!
//! A verdict is right where what matters is named with its effect and its DOF (or stands, complete, among sets that tie),
//! and where nothing that matters is there, `none`.

mod drawn;
mod make;

pub use make::{CoupledCase, Instruments, There, make};
pub(super) use make::{Measured, commands, motion};

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;

use hydroline_diagnose::diagnose;
use hydroline_diagnose::verdict::{Effect, Verdict, Word};

use super::cache::Kept;
use super::error::ProveError;
use super::score::{Rate, Z95};

/// A case after its diagnosis.
#[derive(Debug, Clone, serde::Serialize, schemars::JsonSchema, serde::Deserialize)]
pub struct CoupledJudged {
    /// Index of the case.
    pub index: usize,
    /// Effects that are there, heaviest first.
    pub truth: Vec<There>,
    /// Factor on the rig's coefficients.
    pub rig_factor: f64,
    /// Measurements that its logs hold.
    pub instruments: Instruments,
    /// The verdict's word.
    pub word: Word,
    /// The verdict's sentence.
    pub sentence: String,
    /// Effects found that matter: effect and words.
    pub found: Vec<String>,
    /// Right as the module says.
    pub right: bool,
    /// Numbers of what was found and is there, in their sds.
    pub errors_sds: Vec<(String, f64)>,
    /// (effect and words, probability, there) of everything that was reported.
    pub probabilities: Vec<(String, f64, bool)>,
    /// Fits made.
    pub fits: usize,
    /// Seconds of the diagnosis; not part of what is reproducible.
    pub seconds: f64,
}

/// Makes, diagnoses and scores cases one after the other, each on all cores; `done` is called with each. With `kept`, a case
/// that lies there is not run again, and each that was run is laid there.
///
/// # Errors
/// [`ProveError`].
pub fn run(
    seed: u64,
    indices: &[usize],
    kept: Option<&Kept>,
    done: &(dyn Fn(&CoupledJudged) + Sync),
) -> Result<Vec<CoupledJudged>, ProveError> {
    let one = |index: &usize| -> Result<CoupledJudged, ProveError> {
        let judged = Kept::or_run(kept, &format!("coupled-{index}"), || {
            Ok(judge(&make(seed, *index)?)?.0)
        })?;
        done(&judged);
        Ok(judged)
    };
    indices.iter().map(one).collect()
}

/// Effect and words, e.g. `thruster_lag yaw`.
pub(super) fn named(effect: &str, words: &BTreeMap<String, String>) -> String {
    let words = words.values().map(String::as_str);
    let all: Vec<&str> = std::iter::once(effect).chain(words).collect();
    all.join(" ")
}

fn name(effect: &Effect) -> String {
    named(&effect.effect, &effect.words)
}

/// Diagnoses and scores a case; the verdict beside it.
///
/// # Errors
/// [`ProveError`].
pub fn judge(case: &CoupledCase) -> Result<(CoupledJudged, Verdict), ProveError> {
    let began = std::time::Instant::now();
    let verdict = diagnose(&case.sources, &[], &case.rig, &|_| {})
        .map_err(|source| ProveError::Diagnose {
            id: format!("coupled-{}", case.index),
            source,
        })?
        .verdict;
    let seconds = began.elapsed().as_secs_f64();
    let wanted: BTreeSet<&str> = case
        .truth
        .iter()
        .filter(|t| t.matters())
        .map(|t| t.name.as_str())
        .collect();
    let found: BTreeSet<String> = verdict
        .effects
        .iter()
        .filter(|e| e.matters)
        .map(name)
        .collect();
    let alike = found.iter().map(String::as_str).eq(wanted.iter().copied());
    // Sets hold ids only.
    let mut ids: Vec<&str> = wanted.iter().filter_map(|n| n.split(' ').next()).collect();
    ids.sort_unstable();
    let in_a_set = verdict.equivalent.iter().any(|set| {
        let mut set: Vec<&str> = set.iter().map(String::as_str).collect();
        set.sort_unstable();
        set == ids
    });
    let right = match verdict.verdict {
        Word::None => wanted.is_empty() && found.is_empty(),
        Word::Named => alike && !wanted.is_empty(),
        Word::Ambiguous => in_a_set,
        _ => false,
    };
    let there = |n: &str| case.truth.iter().find(|t| t.name == n);
    let errors_sds = verdict
        .effects
        .iter()
        .filter_map(|e| Some((e, there(&name(e))?)));
    let errors_sds = errors_sds.flat_map(|(e, truth)| {
        let each = truth.numbers.iter().filter_map(|(p, v)| {
            let found = e.parameters.get(p)?;
            Some((format!("{}.{p}", e.effect), (found.value - v) / found.sd?))
        });
        each.collect::<Vec<_>>()
    });
    let probabilities = verdict.candidates.iter().map(|c| {
        let n = named(&c.effect, &c.words);
        let is_there = there(&n).is_some();
        (n, c.probability, is_there)
    });
    let judged = CoupledJudged {
        index: case.index,
        truth: case.truth.clone(),
        rig_factor: case.rig_factor,
        instruments: case.instruments,
        word: verdict.verdict,
        sentence: verdict.sentence.clone(),
        found: found.iter().cloned().collect(),
        right,
        errors_sds: errors_sds.collect(),
        probabilities: probabilities.collect(),
        fits: verdict.sets_looked_at,
        seconds,
    };
    Ok((judged, verdict))
}

/// Complaint about a case that is not right, in a line.
pub fn complaint(j: &CoupledJudged) -> Option<String> {
    let truth: Vec<String> = j
        .truth
        .iter()
        .map(|t| format!("{} {:.1} tolerances", t.name, t.weight_tolerances))
        .collect();
    (!j.right).then(|| {
        format!(
            "coupled-{} (rig x {:.2}): there: {} | {}",
            j.index,
            j.rig_factor,
            truth.join(", "),
            j.sentence
        )
    })
}

/// The score in words.
pub fn words(all: &[CoupledJudged]) -> String {
    let mut s = String::new();
    let with: Vec<&CoupledJudged> = all
        .iter()
        .filter(|j| j.truth.iter().any(There::matters))
        .collect();
    let without: Vec<&CoupledJudged> = all
        .iter()
        .filter(|j| !j.truth.iter().any(There::matters))
        .collect();
    let mut line = |what: &str, rate: Rate| {
        // Writing to a String cannot fail.
        let _ = writeln!(
            s,
            "{what:44} {:>5.1} % ({}/{}; {:.1}-{:.1})",
            100.0 * rate.share,
            rate.hits,
            rate.count,
            100.0 * rate.low,
            100.0 * rate.high
        );
    };
    line(
        "named with its DOF, or in a set",
        Rate::of(with.iter().map(|j| j.right)),
    );
    let matters = |j: &CoupledJudged, n: &str| j.truth.iter().any(|t| t.matters() && t.name == n);
    let recall = with.iter().flat_map(|j| {
        let wanted = j.truth.iter().filter(|t| t.matters());
        wanted.map(|t| j.found.contains(&t.name) || (j.word == Word::Ambiguous && j.right))
    });
    line("recall of what matters", Rate::of(recall));
    let precision = all.iter().flat_map(|j| {
        let right = |n: &String| matters(j, n) || (j.word == Word::Ambiguous && j.right);
        j.found.iter().map(right).collect::<Vec<_>>()
    });
    line("precision of what is said to matter", Rate::of(precision));
    line(
        "nothing that matters -> none",
        Rate::of(without.iter().map(|j| j.right)),
    );
    let covered = all
        .iter()
        .flat_map(|j| &j.errors_sds)
        .map(|e| e.1.abs() <= Z95);
    line("95 % intervals of numbers", Rate::of(covered));
    let mut seconds: Vec<f64> = all.iter().map(|j| j.seconds).collect();
    seconds.sort_by(f64::total_cmp);
    let at = |values: &[f64], share: f64| {
        let last = values.len().saturating_sub(1);
        values
            .get((share * last as f64) as usize)
            .copied()
            .unwrap_or(f64::NAN)
    };
    let mut fits: Vec<f64> = all.iter().map(|j| j.fits as f64).collect();
    fits.sort_by(f64::total_cmp);
    let _ = writeln!(
        s,
        "seconds: median {:.0}, worst {:.0}; fits: median {:.0}, most {:.0}",
        at(&seconds, 0.5),
        at(&seconds, 1.0),
        at(&fits, 0.5),
        at(&fits, 1.0)
    );
    s
}

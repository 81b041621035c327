//! What must not matter to a verdict: the scale of the rig, whether a run is given whole or cut in two, and the order of the runs.
//!
//! Each case, of one DOF or coupled, is diagnosed as it is and in each of these variants. Asked are the same word, the same effects
//! that matter, and numbers within a tenth of their sd; and everywhere that the vehicle alone (`before`) leaves what a plain
//! least-squares fit of it leaves, which is made here by the means of `identify` and not by those of the diagnosis.

mod base;
mod compare;
mod plain;
mod variant;
mod words;

pub use base::{Base, make};
pub use variant::Variant;
pub use words::{InvarianceScore, complaint, score, words};

use std::collections::BTreeMap;

use hydroline_diagnose::diagnose;
use hydroline_diagnose::verdict::{Verdict, Word};

use self::compare::{Compared, compare, mattering};
use super::cache::Kept;
use super::error::ProveError;

/// Largest shift of a number, in its sds.
pub const SHIFT_SDS: f64 = 0.1;
/// Largest share by which `before` differs from what maximum likelihood leaves.
pub const BEFORE: f64 = 0.05;

/// A variant beside the case as it is.
#[derive(Debug, Clone, PartialEq, serde::Serialize, schemars::JsonSchema, serde::Deserialize)]
pub struct Varied {
    /// The variant.
    pub variant: Variant,
    /// Its verdict's word.
    pub word: Word,
    /// Its verdict's sentence.
    pub sentence: String,
    /// The same word, and the same effects that matter; of an ambiguous verdict the same sets.
    pub is_same: bool,
    /// Largest shift of a coefficient, or of a number of an effect that matters, over its sd in the case as it is; scaled back.
    pub shift_sds: f64,
    /// The number that shifts most; empty = there is none.
    pub shifted: String,
    /// Its sd in this variant over that in the case as it is: above 1 the variant says less of it; absent = it has none.
    pub sd_ratio: Option<f64>,
    /// `before` over what maximum likelihood leaves, channel by channel.
    pub before_over_plain: BTreeMap<String, f64>,
}

impl Varied {
    /// The same verdict with the same numbers.
    pub fn is_right(&self) -> bool {
        self.is_same && self.shift_sds <= SHIFT_SDS
    }
}

/// A case after its diagnoses.
#[derive(Debug, Clone, serde::Serialize, schemars::JsonSchema, serde::Deserialize)]
pub struct InvarianceJudged {
    /// Index of the case.
    pub index: usize,
    /// Case of the other proofs that it is.
    pub of: String,
    /// Word of the verdict on the case as it is.
    pub word: Word,
    /// Its sentence.
    pub sentence: String,
    /// Its effects that matter.
    pub mattering: Vec<String>,
    /// `before` over what maximum likelihood leaves, channel by channel.
    pub before_over_plain: BTreeMap<String, f64>,
    /// The variants.
    pub varied: Vec<Varied>,
    /// Seconds of all diagnoses; not part of what is reproducible.
    pub seconds: f64,
}

impl InvarianceJudged {
    /// All ratios of `before` to maximum likelihood: (variant, channel, ratio), `None` = of the case as it is.
    pub fn ratios(&self) -> impl Iterator<Item = (Option<Variant>, &str, f64)> {
        let own = self
            .before_over_plain
            .iter()
            .map(|(c, v)| (None, c.as_str(), *v));
        let varied = self.varied.iter().flat_map(|varied| {
            let each = varied.before_over_plain.iter();
            each.map(|(c, v)| (Some(varied.variant), c.as_str(), *v))
        });
        own.chain(varied)
    }
}

/// Whether `before` is what maximum likelihood leaves.
pub fn is_plain(ratio: f64) -> bool {
    (ratio - 1.0).abs() <= BEFORE
}

/// Makes, diagnoses and compares cases one after the other, each on all cores; `done` is called with each. With `kept`, a case
/// that lies there is not run again, and each that was run is laid there.
///
/// # Errors
/// [`ProveError`].
pub fn run(
    seed: u64,
    indices: &[usize],
    kept: Option<&Kept>,
    done: &(dyn Fn(&InvarianceJudged) + Sync),
) -> Result<Vec<InvarianceJudged>, ProveError> {
    let one = |index: &usize| -> Result<InvarianceJudged, ProveError> {
        let judged = Kept::or_run(kept, &format!("invariance-{index}"), || {
            Ok(judge(&make(seed, *index)?, &Variant::ALL)?.0)
        })?;
        done(&judged);
        Ok(judged)
    };
    indices.iter().map(one).collect()
}

/// Verdict on a case, and `before` over what maximum likelihood leaves.
fn diagnosed(base: &Base) -> Result<(Verdict, BTreeMap<String, f64>), ProveError> {
    let sources = base.sources();
    let made = diagnose(&sources, &[], &base.rig, &|_| {});
    let verdict = made
        .map_err(|source| ProveError::Diagnose {
            id: format!("invariance-{}", base.index),
            source,
        })?
        .verdict;
    let plain = plain::left(base, &verdict)?;
    let before = verdict.fit.train.before.iter();
    let ratios = before.filter_map(|(c, v)| Some((c.clone(), v / plain.get(c)?)));
    // JSON has no NaN.
    let ratios = ratios.filter(|r| r.1.is_finite()).collect();
    Ok((verdict, ratios))
}

/// Diagnoses a case as it is and in variants; the verdict on it as it is beside that.
///
/// # Errors
/// [`ProveError`].
pub fn judge(base: &Base, variants: &[Variant]) -> Result<(InvarianceJudged, Verdict), ProveError> {
    let began = std::time::Instant::now();
    let (verdict, before_over_plain) = diagnosed(base)?;
    let mut varied = Vec::new();
    for variant in variants {
        let (other, before_over_plain) = diagnosed(&base.varied(*variant)?)?;
        let Compared {
            is_same,
            shift_sds,
            shifted,
            sd_ratio,
        } = compare(&verdict, &other, variant.scale());
        varied.push(Varied {
            variant: *variant,
            word: other.verdict,
            sentence: other.sentence.clone(),
            is_same,
            shift_sds,
            shifted,
            sd_ratio,
            before_over_plain,
        });
    }
    let judged = InvarianceJudged {
        index: base.index,
        of: base.of.clone(),
        word: verdict.verdict,
        sentence: verdict.sentence.clone(),
        mattering: mattering(&verdict).into_iter().collect(),
        before_over_plain,
        varied,
        seconds: began.elapsed().as_secs_f64(),
    };
    Ok((judged, verdict))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The order of the runs changes no bit, the scale no word; and the vehicle alone leaves what maximum likelihood leaves.
    #[test]
    fn a_case_is_compared_with_its_variants_and_with_plain_least_squares() {
        // Nothing, over no background.
        let base = make(1, 10).unwrap();
        assert_eq!(base.of, "nothing-10");
        let variants = [Variant::Reordered, Variant::Scaled];
        let (judged, _) = judge(&base, &variants).unwrap();
        let [reordered, scaled] = judged.varied.as_slice() else {
            panic!("{judged:?}");
        };
        assert!(
            reordered.is_right() && reordered.shift_sds == 0.0,
            "{reordered:?}"
        );
        assert!(scaled.is_same, "{scaled:?}");
        assert!(!scaled.shifted.is_empty(), "no number was compared");
        let ratios: Vec<_> = judged.ratios().collect();
        assert_eq!(ratios.len(), 3);
        assert!(ratios.iter().all(|r| is_plain(r.2)), "{ratios:?}");
    }
}

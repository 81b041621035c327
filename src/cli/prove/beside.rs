//! Proofs beside the sealed cases: runs held out (`--held-out`), and what must not matter (`--invariance`).

use hydroline_diagnose::verdict::Verdict;
use hydroline_lab::benchmark::Kept;
use hydroline_lab::benchmark::held_out::{self, HeldOutJudged, HeldOutScore};
use hydroline_lab::benchmark::invariance::{self, InvarianceJudged, InvarianceScore, Variant};
use schemars::JsonSchema;
use serde::Serialize;

use super::{Args, Done, printed, under_bar};
use crate::print::{self, out};
use crate::{CliError, Outcome};

/// Output of `--held-out N --json`.
#[derive(Debug, Serialize, JsonSchema)]
pub struct ProvedHeldOut<'a> {
    /// Seed of all cases.
    seed: u64,
    /// The score.
    score: &'a HeldOutScore,
    /// Every case.
    held_out: &'a [HeldOutJudged],
}

/// Output of `--only held_out-N`.
#[derive(Debug, Serialize, JsonSchema)]
pub struct OneHeldOut<'a> {
    /// Id of the case.
    id: &'a str,
    /// Seed of the case.
    seed: u64,
    /// The whole verdict, as `diagnose --json` prints it.
    verdict: &'a Verdict,
    /// The case with its score, as `prove --held-out N --json` prints each of its `held_out`.
    judged: &'a HeldOutJudged,
}

/// Output of `--invariance N --json`.
#[derive(Debug, Serialize, JsonSchema)]
pub struct ProvedInvariance<'a> {
    /// Seed of all cases.
    seed: u64,
    /// The score.
    score: &'a InvarianceScore,
    /// Every case.
    invariance: &'a [InvarianceJudged],
}

/// Output of `--only invariance-N`.
#[derive(Debug, Serialize, JsonSchema)]
pub struct OneInvariance<'a> {
    /// Id of the case.
    id: &'a str,
    /// Seed of the case.
    seed: u64,
    /// The whole verdict on the case as it is, as `diagnose --json` prints it.
    verdict: &'a Verdict,
    /// The case with its score, as `prove --invariance N --json` prints each of its `invariance`.
    judged: &'a InvarianceJudged,
}

/// Cases with a run held out.
pub fn held_out(args: &Args, count: usize, kept: Option<&Kept>) -> Result<Outcome, CliError> {
    let indices: Vec<usize> = (0..count).collect();
    let run = |done: Done<'_, HeldOutJudged>| held_out::run(args.seed, &indices, kept, done);
    let what = "cases with a run held out";
    let judged = under_bar(count, what, kept, held_out::complaint, run)?;
    if args.json {
        let (seed, held_out) = (args.seed, judged.as_slice());
        let score = &held_out::score(&judged);
        print::json(&ProvedHeldOut {
            seed,
            score,
            held_out,
        })?;
    } else {
        out!("{}", held_out::words(&judged));
    }
    Ok(Outcome::Done)
}

/// One of them, with its whole verdict.
pub fn only_held_out(args: &Args, index: usize) -> Result<Outcome, CliError> {
    let (judged, verdict) = held_out::draw_and_judge(args.seed, index)?;
    let object = OneHeldOut {
        id: &format!("held_out-{index}"),
        seed: args.seed,
        verdict: &verdict,
        judged: &judged,
    };
    printed(args, &object)?;
    Ok(Outcome::Done)
}

/// Cases in variants that must not matter.
pub fn invariance(args: &Args, count: usize, kept: Option<&Kept>) -> Result<Outcome, CliError> {
    let indices: Vec<usize> = (0..count).collect();
    let run = |done: Done<'_, InvarianceJudged>| invariance::run(args.seed, &indices, kept, done);
    let what = "cases in four variants";
    let judged = under_bar(count, what, kept, invariance::complaint, run)?;
    if args.json {
        let (seed, invariance) = (args.seed, judged.as_slice());
        let score = &invariance::score(&judged);
        print::json(&ProvedInvariance {
            seed,
            score,
            invariance,
        })?;
    } else {
        out!("{}", invariance::words(&judged));
    }
    Ok(Outcome::Done)
}

/// One of them, with its whole verdict as it is.
pub fn only_invariance(args: &Args, index: usize) -> Result<Outcome, CliError> {
    let base = invariance::make(args.seed, index)?;
    let (judged, verdict) = invariance::judge(&base, &Variant::ALL)?;
    let object = OneInvariance {
        id: &format!("invariance-{index}"),
        seed: args.seed,
        verdict: &verdict,
        judged: &judged,
    };
    printed(args, &object)?;
    Ok(Outcome::Done)
}

//! Proof: sealed cases made by the simulator, diagnosed blind, then the key is opened and scored.
//!
//! `plans` -> `tank` (true vehicle, effects of practical size over a background, laws the vocabulary
//! has not: `strange`; `motion` integrates them, `disturbance` measures them) -> `case` (what the
//! diagnosis may see, and the key) -> `judge` (diagnosis without the key, then with it; beside the
//! ideal `observer`) -> `score` (Wilson intervals, confusion, coverage) -> `table`.
//!
//! The motion is integrated here and not by the diagnosis' one-DOF model, so that an error of that
//! model cannot hide on both sides.

pub mod case;
pub mod coupled;
pub mod disturbance;
pub mod error;
pub mod faulty;
pub mod images;
pub mod judge;
pub mod keep;
pub mod motion;
pub mod observer;
pub mod paper;
pub mod plans;
pub mod score;
pub mod sizes;
pub mod strange;
pub mod table;
pub mod tank;

pub use case::{Case, Category, catalogue, make};
pub use error::ProveError;
pub use judge::{How, Judged, judge};
pub use keep::Kept;
pub use score::{Score, score};

use rayon::prelude::*;

/// Makes, diagnoses and scores cases in parallel; `done` is told of each as it ends. The result
/// does not depend on the number of threads: each case has its own seed. With `kept`, a case that lies
/// there is not run again, and each that was run is laid there.
///
/// # Errors
/// [`ProveError`], the first in the order of the catalogue.
pub fn run(
    seed: u64,
    ids: &[(Category, usize)],
    how: How,
    kept: Option<&Kept>,
    done: &(dyn Fn(&Judged) + Sync),
) -> Result<Vec<Judged>, ProveError> {
    ids.par_iter()
        .map(|(category, index)| {
            let id = format!("{}-{index}", category.name());
            let known = kept
                .map(|k| k.read(&id, how.observe))
                .transpose()?
                .flatten();
            let judged = match known {
                Some(judged) => judged,
                None => {
                    let judged = judge(&make(seed, *category, *index)?, how)?;
                    if let Some(kept) = kept {
                        kept.write(&judged, how.observe)?;
                    }
                    judged
                }
            };
            done(&judged);
            Ok(judged)
        })
        .collect()
}

#[cfg(test)]
mod eyes {
    #![allow(clippy::unwrap_used)]
    //! Cases for eyes: `SEED=77 CATEGORY=unnamed COUNT=8 cargo test -p hydroline-benchmark --lib -- --ignored --nocapture of_cases`,
    //! or `ONLY="unnamed-2 single-3"`.
    use super::*;

    #[test]
    #[ignore = "for eyes"]
    fn of_cases() {
        let var = |n: &str| std::env::var(n).ok();
        let seed: u64 = var("SEED").map_or(1, |s| s.parse().unwrap());
        let ids: Vec<(Category, usize)> = match var("ONLY") {
            Some(only) => only
                .split_whitespace()
                .map(|id| case::parse(id).unwrap())
                .collect(),
            None => {
                let named = |n: String| Category::ALL.into_iter().find(|c| c.name() == n).unwrap();
                let count: usize = var("COUNT").map_or(8, |s| s.parse().unwrap());
                let from: usize = var("FROM").map_or(0, |s| s.parse().unwrap());
                let ids = catalogue(from + count, var("CATEGORY").map(named));
                ids.into_iter().filter(|i| i.1 >= from).collect()
            }
        };
        for (category, index) in ids {
            let made = make(seed, category, index).unwrap();
            let begun = std::time::Instant::now();
            let v = hydroline_diagnose::diagnose_by(
                hydroline_diagnose::Engine::Body,
                &made.sealed.sources,
                &made.sealed.held,
                &made.sealed.rig,
                &|what| {
                    if std::env::var("TELL").is_ok() {
                        println!("   {:.1} s {what}", begun.elapsed().as_secs_f64());
                    }
                },
            )
            .unwrap()
            .verdict;
            let seconds = begun.elapsed().as_secs_f64();
            let truth: Vec<String> = made
                .key
                .truth
                .iter()
                .filter(|t| t.weight_m > 2e-4)
                .map(|t| {
                    let near = if t.exact { "" } else { "~" };
                    format!("{}{near} {:.2}", t.effect, t.weight_m * 1e3)
                })
                .collect();
            println!(
                "== {}-{index} {seconds:.1} s {} fits | there: {} {:?}\n   {:?}: {}",
                category.name(),
                v.sets_looked_at,
                truth.join(", "),
                made.key.tank.strange,
                v.verdict,
                v.sentence
            );
            for e in &v.effects {
                println!(
                    "   {} p {:.3} {:?} {:?} exact {:?} {:?}",
                    e.effect, e.probability, e.words, e.weight, e.law_exact_probability, e.law_note
                );
            }
            for a in v.alternatives.iter().take(4) {
                println!(
                    "   {:.3} {:.1} {:?} {:?}",
                    a.probability, a.log_evidence, a.effects, a.train
                );
            }
            println!(
                "   unnamed {:?} noise {:?} held out {:?}",
                v.unnamed, v.noise, v.fit.held_out
            );
        }
    }
}

//! Proof: sealed cases made by the simulator, diagnosed blind, then the key is opened and scored.
//!
//! `plans` -> `tank` (true vehicle, effects of practical size over a background, laws the library
//! has not: `external_law`; `motion` integrates them, `disturbance` measures them) -> `case` (what the
//! diagnosis may see, and the key) -> `judge` (diagnosis without the key, then with it; beside the
//! ideal `observer`) -> `score` (Wilson intervals, confusion, coverage) -> `table`.
//!
//! Beside them `held_out` asks whether runs that a verdict does not predict are said, and `invariance` whether what must not matter
//! to a verdict does not.
//!
//! The motion is integrated here and not by the diagnosis' one-DOF model, so that an error of that
//! model cannot hide on both sides.

pub mod cache;
pub mod case;
pub mod composed;
pub mod coupled;
pub mod disturbance;
pub mod error;
pub mod experiment;
pub mod export;
pub mod external_law;
pub mod faulty;
pub mod held_out;
pub mod images;
pub mod instrument;
pub mod invariance;
pub mod judge;
pub mod magnitudes;
pub mod modulated;
pub mod motion;
pub mod observer;
pub mod paper;
pub mod plans;
pub mod score;
pub mod table;
pub mod unsteady;

pub use cache::Kept;
pub use case::{Case, Category, catalogue, make};
pub use error::ProveError;
pub use judge::{How, Judged, judge};
pub use score::{Score, score};

use hydroline_numerics::parallel;

/// Makes, diagnoses and scores cases in parallel; `done` is called with each as it ends. The result
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
    parallel::try_map_slice(ids, |(category, index)| {
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
}

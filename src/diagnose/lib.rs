//! Missing physics: where simulation and recording differ, which physics explains it, and proof.
//!
//! `source` (a log, and with `faults` what is wrong with its data) -> `body` (the models of `hydroline_inference`, weighed: what matters, how
//! sure, where, what else it may be, which run would tell) -> `verdict` -> `report`. `profiles` asks the same of frames, and
//! [`diagnose`] joins both: every command that gives a verdict calls it.
//!
//! Nothing here knows a single effect: laws, ranges and stages come from `sim`'s registry.
//!
//! ```
//! use hydroline_daemon::simulate::{Options, simulate};
//! use hydroline_diagnose::{diagnose, read, verdict::Word};
//! use hydroline_rigs::{Plan, Rig};
//!
//! // A vehicle whose thrusters lag, and a rig that does not know.
//! let rig = Rig::builtin("lshpi")?;
//! let lag = "[[physics]]\neffect = \"thruster_lag\"\nlag_s = 0.25\n";
//! let water = Rig::from_toml(&format!("{}\n{lag}", rig.effective_toml), "water.toml", None)?;
//! let folder = tempfile::tempdir()?;
//! let log = folder.path().join("run.mcap");
//! let options = Options { motion_only: true, ..Options::default() };
//! simulate(&water, &Plan::load_or_builtin("two-tone")?, &log, &options, &mut |_, _| ())?;
//!
//! let verdict = diagnose(&[read(&log, &rig)?], &[], &rig, &|_| ())?.verdict;
//! assert_eq!(verdict.verdict, Word::Named);
//! assert_eq!(verdict.effects[0].effect, "thruster_lag");
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub mod body;
mod conclude;
pub mod faults;
mod joined;
pub mod profiles;
pub mod report;
mod single_run_split;
mod source;
pub mod until;
pub mod verdict;

#[cfg(test)]
#[path = "../../tests/support/lshpi_rig.rs"]
mod fixture;

pub use conclude::{DiagnoseError, Diagnosis};
pub use hydroline_inference::limit::{Limit, Watch};
pub use source::{Part, Source, read};
pub use verdict::Verdict;

use std::collections::BTreeSet;
use std::path::PathBuf;

use hydroline_calib::Calibration;
use hydroline_rigs::{Dof, Rig};
use profiles::observe::has_images;
use profiles::{ImageError, level};
use verdict::Word;

/// Knowledge beside logs and rig.
#[derive(Debug, Clone, Copy, Default)]
pub struct Beside<'a> {
    /// DOFs whose measured motion is an input.
    pub given: &'a [Dof],
    /// By which the next run will be seen; `None` = the rig's ideal camera.
    pub calibration: Option<&'a Calibration>,
    /// Whether the plan of the next run is chosen although the time limit is over: somebody waits for it.
    pub needs_plan: bool,
}

/// Diagnoses logs against a rig by their motion and by their frames, without a limit; `held` are predicted only.
///
/// # Errors
/// [`DiagnoseError`].
pub fn diagnose(
    sources: &[Source],
    held: &[Source],
    rig: &Rig,
    progress: &(dyn Fn(&str) + Sync),
) -> Result<Diagnosis, DiagnoseError> {
    let watch = Watch::unlimited(progress);
    diagnose_beside(sources, held, rig, &Beside::default(), watch)
}

/// Work on the frames that a limit leaves open.
const FRAMES: &str = "effects of camera, sheet, target and water in the frames";

/// The same with what is known beside them, and under a limit: a verdict as far as the search has come by then, marked so.
///
/// # Errors
/// [`DiagnoseError`].
pub fn diagnose_beside(
    sources: &[Source],
    held: &[Source],
    rig: &Rig,
    beside: &Beside<'_>,
    watch: Watch<'_>,
) -> Result<Diagnosis, DiagnoseError> {
    let mut found = by_motion_and_frames(sources, held, rig, beside, watch)?;
    found.verdict.mark_truncated(&found.account);
    Ok(found)
}

fn by_motion_and_frames(
    sources: &[Source],
    held: &[Source],
    rig: &Rig,
    beside: &Beside<'_>,
    watch: Watch<'_>,
) -> Result<Diagnosis, DiagnoseError> {
    let moving = |all: &[Source]| -> Vec<Source> {
        let with = all.iter().filter(|s| s.has_motion());
        with.cloned().collect()
    };
    let runs = moving(sources);
    let mut found = match runs.is_empty() {
        true => None,
        false => Some(body::diagnose(&runs, &moving(held), rig, beside, watch)?),
    };
    if let Some(fault) = found.take_if(|f| f.verdict.verdict == Word::DataFault) {
        return Ok(fault);
    }
    let logs: BTreeSet<&PathBuf> = sources.iter().filter_map(|s| s.frames.as_ref()).collect();
    let has_frames = || logs.iter().any(|log| has_images(log).unwrap_or(false));
    if let Some(mut found) = found.take_if(|_| watch.limit.is_over() && has_frames()) {
        found.account.leaves_open(watch.limit, FRAMES);
        return Ok(found);
    }
    let images = level(logs, rig, watch);
    let cut = images.as_ref().ok().and_then(|i| i.as_ref()?.cut);
    let noted = |mut found: Diagnosis| {
        if let Some(cause) = cut {
            found.account.cut(cause, FRAMES);
        }
        found
    };
    match (found, images) {
        (Some(found), Ok(None)) => Ok(found),
        (Some(found), Ok(Some(images))) => Ok(noted(images.join(found))),
        // The motion has its verdict whatever the frames are.
        (Some(mut found), Err(error @ (ImageError::Few { .. } | ImageError::NoPose))) => {
            found.verdict.notes.push(error.to_string());
            Ok(found)
        }
        (_, Err(error)) => Err(error.into()),
        (None, Ok(Some(images))) => Ok(noted(images.alone(rig))),
        (None, Ok(None)) => Err(DiagnoseError::NothingMoves(sources.len())),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hydroline_daemon::simulate::{Options, simulate};
    use hydroline_rigs::Plan;
    use std::time::Duration;

    #[test]
    fn a_limit_that_is_over_gives_the_verdict_of_the_vehicle_alone_marked_so() {
        let rig = Rig::builtin("lshpi").unwrap();
        let folder = tempfile::tempdir().unwrap();
        let log = folder.path().join("run.mcap");
        let options = Options {
            motion_only: true,
            ..Options::default()
        };
        let plan = Plan::load_or_builtin("two-tone").unwrap();
        simulate(&rig, &plan, &log, &options, &mut |_, _| ()).unwrap();
        let sources = [read(&log, &rig).unwrap()];
        let watch = Watch {
            progress: &|_| (),
            limit: Limit::after(Duration::ZERO),
        };
        let found = diagnose_beside(&sources, &[], &rig, &Beside::default(), watch).unwrap();
        let v = &found.verdict;
        assert!(v.effects.is_empty() && v.leave_one_run_out.is_none());
        assert!(v.next_experiment.is_none());
        let truncated = v.truncated.as_ref().unwrap();
        assert_eq!(
            (truncated.steps, truncated.after.as_str()),
            (0, "the vehicle alone")
        );
        for what in [
            "beside the vehicle alone",
            "each run as the others predict it",
            "the plan of the next run",
        ] {
            assert!(truncated.open.iter().any(|o| o == what), "{truncated:?}");
        }
        assert!(v.sentence.starts_with("So far: "), "{}", v.sentence);
        assert!(!v.fit.train.before.is_empty() && !v.fit.train.after.is_empty());
        let page = report::pages(&found, "hydroline diagnose").page.html();
        assert!(page.contains("This is the verdict so far"));
        // Whoever waits for the next run gets its plan all the same, where there is a rival to separate.
        let beside = Beside {
            needs_plan: true,
            ..Beside::default()
        };
        let found = diagnose_beside(&sources, &[], &rig, &beside, watch).unwrap();
        let open = &found.account.open;
        assert!(
            !open.iter().any(|o| o == "the plan of the next run"),
            "{open:?}"
        );
    }
}

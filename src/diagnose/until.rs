//! Run after run until the verdict is decided: what to run next, or why to stop.
//!
//! No I/O: runs go in, the next step comes out. Whoever asks records what is proposed and asks again with one run more; so a
//! session that was cut off goes on from its logs.

use std::cell::OnceCell;

use hydroline_calib::Calibration;
use hydroline_core::run::Command;
use hydroline_design::{
    DesignError, Designed, Options as DesignOptions, Purpose, Set, design, not_shown_yet,
};
use hydroline_inference::limit::Watch;
use hydroline_rigs::{Dof, Rig};

use super::Beside;
use super::body::next::Offer;
use super::conclude::{DiagnoseError, Diagnosis};
use super::source::Source;
use super::verdict::{TruncatedBy, Word};

/// When to stop.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// Probability of what matters together from which it is decided: odds of 19 to 1, as is usual.
    pub probability: f64,
    /// Length of the first plan \[s\].
    pub length_s: f64,
    /// DOFs that the first plan drives; empty = all that the thrusters can.
    pub dofs: Vec<Dof>,
    /// By which the runs will be seen; `None` = the rig's ideal camera.
    pub calibration: Option<Calibration>,
}

impl Default for Options {
    fn default() -> Self {
        Options {
            probability: 0.95,
            length_s: 30.0,
            dofs: Vec::new(),
            calibration: None,
        }
    }
}

/// Next step of a series.
#[derive(Debug, Clone)]
pub enum Step {
    /// One of these plans, the best first.
    Run(Box<Proposal>),
    /// The verdict stands.
    Decided(Box<Diagnosis>),
    /// It does not, and no run that may still be made is expected to change that.
    Undecided {
        /// Reason, in words.
        why: String,
        /// As far as it goes; none before any run.
        diagnosis: Option<Box<Diagnosis>>,
    },
}

/// A plan to run, with its reason.
#[derive(Debug, Clone)]
pub struct Proposal {
    /// Plans on offer, by expected information, largest first.
    pub offers: Vec<Offer>,
    /// Reason, in words.
    pub reason: String,
    /// Verdict on the runs so far; `None` before the first.
    pub diagnosis: Option<Diagnosis>,
}

/// Why there is no step.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)] // Each message names its fields.
pub enum UntilError {
    #[error(transparent)]
    Diagnose(#[from] DiagnoseError),
    #[error(transparent)]
    Design(#[from] DesignError),
}

/// Effort of the first plan's design: it is made while somebody waits at the tank.
fn first_plan(options: &Options) -> DesignOptions {
    DesignOptions {
        purpose: Purpose::Diagnose,
        plans: 1,
        length_s: options.length_s,
        dofs: options.dofs.clone(),
        calibration: options.calibration.clone(),
        drawn: 24,
        improved: 1,
        sweeps: 1,
        ..DesignOptions::default()
    }
}

/// A series of runs on one rig.
#[derive(Debug)]
pub struct Series<'a> {
    rig: &'a Rig,
    options: Options,
    /// The plan that shows most before any run: designed once, whether a series begins with it or goes on from its logs.
    designed: OnceCell<Set>,
}

impl<'a> Series<'a> {
    /// Before its first step.
    pub fn new(rig: &'a Rig, options: Options) -> Series<'a> {
        Series {
            rig,
            options,
            designed: OnceCell::new(),
        }
    }

    /// Next step behind these runs, when so many more may be made. The limit is one of the diagnosis.
    ///
    /// # Errors
    /// [`UntilError`].
    pub fn step(
        &self,
        sources: &[Source],
        runs_left: usize,
        watch: Watch<'_>,
    ) -> Result<Step, UntilError> {
        if sources.is_empty() {
            return self.begin(runs_left, watch.progress);
        }
        let beside = Beside {
            calibration: self.options.calibration.as_ref(),
            needs_plan: true,
            ..Beside::default()
        };
        let found = super::diagnose_beside(sources, &[], self.rig, &beside, watch)?;
        match judge(found, &self.options, runs_left) {
            Step::Decided(found) => self.look_closer(sources, runs_left, *found, watch.progress),
            other => Ok(other),
        }
    }

    fn designed(&self, progress: &(dyn Fn(&str) + Sync)) -> Result<&Set, DesignError> {
        if let Some(set) = self.designed.get() {
            return Ok(set);
        }
        let set = design(self.rig, &first_plan(&self.options), progress)?;
        Ok(self.designed.get_or_init(|| set))
    }

    /// Effects that runs cannot show are in no verdict: before one is final, effects of typical size have to show in these runs as they
    /// would in a plan made for that.
    fn look_closer(
        &self,
        sources: &[Source],
        runs_left: usize,
        found: Diagnosis,
        progress: &(dyn Fn(&str) + Sync),
    ) -> Result<Step, UntilError> {
        let set = self.designed(progress)?;
        progress("what these runs would have shown");
        let runs: Vec<(&[Command], Vec<f64>)> = sources
            .iter()
            .map(|s| {
                let times_s = s.run.samples.iter().map(|s| s.t_s);
                (&s.run.commands[..], times_s.collect())
            })
            .collect();
        let missing = not_shown_yet(self.rig, &first_plan(&self.options), set, &runs)?;
        let Some(plan) = set.plans.first().filter(|_| !missing.is_empty()) else {
            return Ok(Step::Decided(Box::new(found)));
        };
        let missing = missing.join(", ");
        if runs_left == 0 {
            return Ok(Step::Undecided {
                why: format!("no run is left, and these would not show {missing} of typical size"),
                diagnosis: Some(Box::new(found)),
            });
        }
        if let Some(run) = sources.iter().find(|s| was_run(plan, s)) {
            return Ok(Step::Undecided {
                why: format!(
                    "{} was made to show {missing}, and its poses do not: see where they are missing (`hydroline replay`), keep the vehicle where target and calibration hold, or drive fewer DOFs (--dof)",
                    run.run.name
                ),
                diagnosis: Some(Box::new(found)),
            });
        }
        Ok(Step::Run(Box::new(Proposal {
            reason: format!(
                "these runs would not show {missing} of typical size, and this plan does"
            ),
            offers: vec![offer(plan, "shows-more")],
            diagnosis: Some(found),
        })))
    }

    fn begin(
        &self,
        runs_left: usize,
        progress: &(dyn Fn(&str) + Sync),
    ) -> Result<Step, UntilError> {
        if runs_left == 0 {
            return Ok(Step::Undecided {
                why: "no run is there, and none may be made".to_owned(),
                diagnosis: None,
            });
        }
        let set = self.designed(progress)?;
        Ok(Step::Run(Box::new(Proposal {
            reason:
                "no run is there yet: this plan is expected to say most of what the rig may leave out"
                    .to_owned(),
            offers: set.plans.iter().map(|p| offer(p, "first")).collect(),
            diagnosis: None,
        })))
    }
}

/// Open work of a search that its limit ended, named in the reason why nothing is decided.
const OPEN: usize = 3;

/// Loads of a run are those of its plan to this share: each thruster's pulse is rounded to the wire's grid.
const SAME_LOAD: f64 = 0.05;

/// Whether a run was made by a plan, as far as its largest loads tell.
fn was_run(plan: &Designed, source: &Source) -> bool {
    let mut largest = [0.0_f64; 6];
    for command in &source.run.commands {
        largest = std::array::from_fn(|d| largest[d].max(command.wrench[d].abs()));
    }
    let pairs = plan.largest.iter().zip(largest);
    let driven: Vec<(f64, f64)> = pairs
        .filter(|(p, _)| **p > 0.0)
        .map(|(p, l)| (*p, l))
        .collect();
    driven.iter().all(|(p, l)| (l - p).abs() <= SAME_LOAD * p)
}

fn offer(designed: &Designed, name: &str) -> Offer {
    let mut plan = designed.plan.clone();
    name.clone_into(&mut plan.name);
    plan.source_toml = plan.to_toml();
    Offer {
        plan,
        gain_nats: designed.gain_nats,
    }
}

fn judge(found: Diagnosis, options: &Options, runs_left: usize) -> Step {
    let word = found.verdict.verdict;
    let undecided = |why: String, found: Diagnosis| Step::Undecided {
        why,
        diagnosis: Some(Box::new(found)),
    };
    if word == Word::DataFault {
        let why = format!("{}; mend it, then record anew", found.verdict.sentence);
        return undecided(why, found);
    }
    let truncated = found.verdict.truncated.as_ref();
    if truncated.is_some_and(|t| t.by == TruncatedBy::Interrupt) {
        return undecided("Ctrl-C ended the diagnosis".to_owned(), found);
    }
    let settled = |word| matches!(word, Word::None | Word::Named);
    if settled(found.by_motion) && found.probability >= options.probability {
        // What was not looked at may be as likely.
        if let Some(truncated) = truncated {
            let why = format!(
                "{} A longer --time-limit goes on from these runs",
                truncated.sentence(OPEN)
            );
            return undecided(why, found);
        }
        if settled(word) {
            return Step::Decided(Box::new(found));
        }
        let why = format!(
            "the motion is explained, and no run changes what the frames leave open: {}",
            found.verdict.sentence
        );
        return undecided(why, found);
    }
    if runs_left == 0 {
        let why = format!("no run is left; {}", open(&found, options));
        return undecided(why, found);
    }
    let Some(best) = found.offers.first() else {
        let why = format!(
            "no plan that the rig runs would separate what is left; {}",
            open(&found, options)
        );
        return undecided(why, found);
    };
    let wanted = wanted_nats(&found, options);
    let most = best.gain_nats * runs_left as f64;
    if most < wanted {
        let why = format!(
            "the best plan that the rig runs ({}) is expected to gain {:.1} nats a run, {} run(s) may still be made, and {wanted:.1} nats are wanted; {}",
            best.plan.name,
            best.gain_nats,
            runs_left,
            open(&found, options)
        );
        return undecided(why, found);
    }
    let next = found.verdict.next_experiment.as_ref();
    Step::Run(Box::new(Proposal {
        offers: found.offers.clone(),
        reason: next.map_or_else(String::new, |n| n.reason.clone()),
        diagnosis: Some(found),
    }))
}

/// Log Bayes factor that is wanting between the verdict and all else.
fn wanted_nats(found: &Diagnosis, options: &Options) -> f64 {
    let odds = |p: f64| (p / (1.0 - p)).ln();
    let p = found.probability.clamp(1e-6, 1.0 - 1e-6);
    (odds(options.probability) - odds(p)).max(0.0)
}

/// Distance to a decision, in words.
fn open(found: &Diagnosis, options: &Options) -> String {
    format!(
        "the likeliest explanation has probability {:.2}, {:.2} is asked",
        found.probability, options.probability
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::verdict::Verdict;
    use hydroline_inference::limit::{Account, Cause};
    use hydroline_rigs::Plan;

    fn found(word: Word, probability: f64, gains: &[f64]) -> Diagnosis {
        let plan = Plan::load_or_builtin("surge-4n").unwrap();
        Diagnosis {
            verdict: Verdict {
                verdict: word,
                ..Verdict::default()
            },
            rig: Rig::builtin("lshpi").unwrap(),
            shown: Vec::new(),
            probability,
            by_motion: word,
            images: None,
            offers: gains
                .iter()
                .map(|g| Offer {
                    plan: plan.clone(),
                    gain_nats: *g,
                })
                .collect(),
            account: Account::default(),
        }
    }

    /// A search that the limit had ended beside the vehicle alone was sure of it.
    #[test]
    fn a_search_that_a_limit_ended_decides_nothing() {
        let step = |cause, word| {
            let mut found = found(word, 0.99, &[5.0]);
            let mut account = Account::default();
            account.cut(cause, "beside the vehicle alone");
            found.verdict.mark_truncated(&account);
            judge(found, &Options::default(), 8)
        };
        let Step::Undecided { why, .. } = step(Cause::Time, Word::None) else {
            panic!("decided without a look");
        };
        assert!(
            why.contains("still open: beside the vehicle alone"),
            "{why}"
        );
        // What is not settled anyway is left to the next run; whoever pressed Ctrl-C wants none.
        assert!(matches!(step(Cause::Time, Word::Ambiguous), Step::Run(_)));
        assert!(matches!(
            step(Cause::Interrupt, Word::Ambiguous),
            Step::Undecided { .. }
        ));
    }

    #[test]
    fn a_verdict_is_decided_by_its_probability_not_by_its_word() {
        let options = Options::default();
        let step = |f| judge(f, &options, 8);
        assert!(matches!(
            step(found(Word::Named, 0.97, &[1.0])),
            Step::Decided(_)
        ));
        assert!(matches!(
            step(found(Word::None, 0.97, &[])),
            Step::Decided(_)
        ));
        assert!(matches!(
            step(found(Word::Named, 0.92, &[1.0])),
            Step::Run(_)
        ));
        assert!(matches!(
            step(found(Word::Ambiguous, 0.6, &[5.0])),
            Step::Run(_)
        ));
        // Something without a name is never decided by being likely.
        assert!(matches!(
            step(found(Word::Unknown, 0.99, &[])),
            Step::Undecided { .. }
        ));
    }

    #[test]
    fn what_frames_leave_open_no_run_decides() {
        let mut left = found(Word::Ambiguous, 0.97, &[5.0]);
        left.by_motion = Word::Named;
        let Step::Undecided { why, .. } = judge(left, &Options::default(), 8) else {
            panic!("goes on for nothing");
        };
        assert!(why.contains("frames"), "{why}");
    }

    #[test]
    fn it_ends_where_the_runs_that_are_left_cannot_decide() {
        let options = Options::default();
        // From even odds to 19 to 1 are 2.9 nats.
        let step = |gain, left| judge(found(Word::Ambiguous, 0.5, &[gain]), &options, left);
        assert!(matches!(step(1.5, 2), Step::Run(_)));
        let Step::Undecided { why, .. } = step(1.0, 2) else {
            panic!("goes on for nothing");
        };
        assert!(
            why.contains("1.0 nats") && why.contains("2.9 nats"),
            "{why}"
        );
        assert!(matches!(step(9.0, 0), Step::Undecided { .. }));
        let none = judge(found(Word::Ambiguous, 0.5, &[]), &options, 8);
        assert!(matches!(none, Step::Undecided { .. }));
    }
}

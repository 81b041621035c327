//! The search under a limit: what it tells, where it ends, and what it left open then.

use super::{Job, Search};
use crate::fit::{Effort, Fit};

/// Models named of those that were still to be looked at.
const NAMED: usize = 6;

impl Search<'_> {
    /// Fits the jobs that begin before the limit is over.
    pub(super) fn fit_in_time(&mut self, jobs: Vec<Job>, effort: Effort) {
        self.fit_within(jobs, effort, self.watch.limit);
    }

    /// Whether optional work is left open since the limit is over; it is noted then.
    pub(super) fn leaves_open(&mut self, what: &str) -> bool {
        self.account.leaves_open(self.watch.limit, what)
    }

    /// A model's name, as progress and account say it.
    pub(super) fn label(&self, fit: &Fit) -> String {
        match fit.terms.is_empty() {
            true => "the vehicle alone".to_owned(),
            false => self.names(fit).join(" + "),
        }
    }

    /// Progress before a step: share of the budget that is spent, and the likeliest model so far.
    pub(super) fn tell(&self, beside: &Fit) {
        let best = self.best().map_or_else(String::new, |b| self.label(b));
        self.watch.tell(&format!(
            "beside {} ({} of at most {} fits; best so far: {best})",
            self.label(beside),
            self.cost,
            self.options.cost
        ));
    }

    /// Whether no further step is made; the models that would have come are noted then.
    pub(super) fn ends_here(&mut self) -> bool {
        let Some(cause) = self.watch.limit.cause() else {
            return false;
        };
        let names: Vec<String> = self.pending().iter().map(|f| self.label(f)).collect();
        for name in names.iter().take(NAMED) {
            self.account.cut(cause, &format!("beside {name}"));
        }
        if names.len() > NAMED {
            let more = format!("beside {} more models", names.len() - NAMED);
            self.account.cut(cause, &more);
        }
        true
    }

    /// Accounts for a step beside a model. One of which fits have not begun is none: the model was not looked at.
    pub(super) fn end_step(&mut self, terms: &[usize], beside: &str) {
        let step = format!("beside {beside}");
        if std::mem::take(&mut self.not_begun) > 0 {
            self.expanded.remove(terms);
            self.leaves_open(&step);
            return;
        }
        self.account.steps += 1;
        self.account.did(&step);
    }

    /// Whether so little was looked at that a DOF which no model follows yet says nothing.
    pub(super) fn is_cut_early(&self) -> bool {
        self.account.cause.is_some() && self.fits < self.options.give_up_after
    }
}

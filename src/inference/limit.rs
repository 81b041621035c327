//! Limit of a computation, a time or a word of the user, and the account of what it left open.
//!
//! A limit truncates and changes nothing else: a computation asks it between two steps, whose order no clock decides. What is
//! optional is left out then, and noted; what a result cannot do without is computed whatever the limit says.
//!
//! ```
//! use std::time::Duration;
//! use hydroline_inference::limit::{Account, Limit};
//!
//! let limit = Limit::after(Duration::ZERO);
//! let mut account = Account::default();
//! account.did("the vehicle alone");
//! assert!(account.leaves_open(limit, "tables"));
//! assert_eq!((account.last.as_str(), account.open), ("the vehicle alone", vec!["tables".to_owned()]));
//! ```

use std::time::{Duration, Instant};

/// Reason why a computation ended before its end.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Cause {
    /// Its time was over.
    Time,
    /// The user asked for the result so far.
    Interrupt,
}

/// Time at which a computation ends with what it has, and whether the user wants that sooner. Once over, it stays over.
#[derive(Debug, Clone, Copy, Default)]
pub struct Limit {
    deadline: Option<Instant>,
    is_interrupted: Option<fn() -> bool>,
}

impl Limit {
    /// No limit: the computation goes on to its end.
    pub const NONE: Limit = Limit {
        deadline: None,
        is_interrupted: None,
    };

    /// Limit that is over so long from now.
    pub fn after(length: Duration) -> Limit {
        Limit {
            // A time later than the clock counts never comes.
            deadline: Instant::now().checked_add(length),
            is_interrupted: None,
        }
    }

    /// The same limit, over as well once this says so; a word that was given must not be taken back.
    #[must_use]
    pub fn interrupted_by(self, is_interrupted: fn() -> bool) -> Limit {
        Limit {
            is_interrupted: Some(is_interrupted),
            ..self
        }
    }

    /// The same limit without its time: only the user ends it.
    #[must_use]
    pub fn without_time(self) -> Limit {
        Limit {
            deadline: None,
            ..self
        }
    }

    /// The same limit, over when this share of what is left of its time has passed.
    #[must_use]
    pub fn earlier(self, share: f64) -> Limit {
        let now = Instant::now();
        let deadline = self.deadline.map(|at| {
            let left = at.saturating_duration_since(now);
            now + left.mul_f64(share.clamp(0.0, 1.0))
        });
        Limit { deadline, ..self }
    }

    /// Reason why the limit is over; `None` = it is not.
    pub fn cause(&self) -> Option<Cause> {
        if self.is_interrupted.is_some_and(|asked| asked()) {
            return Some(Cause::Interrupt);
        }
        let is_late = self.deadline.is_some_and(|at| Instant::now() >= at);
        is_late.then_some(Cause::Time)
    }

    /// Whether no further step is to begin.
    pub fn is_over(&self) -> bool {
        self.cause().is_some()
    }
}

/// Progress and limit of a computation that takes long.
#[derive(Clone, Copy)]
pub struct Watch<'a> {
    /// Receiver of what begins, in words.
    pub progress: &'a (dyn Fn(&str) + Sync),
    /// Limit that is asked between two steps.
    pub limit: Limit,
}

impl<'a> Watch<'a> {
    /// Progress without a limit.
    pub fn unlimited(progress: &'a (dyn Fn(&str) + Sync)) -> Watch<'a> {
        Watch {
            progress,
            limit: Limit::NONE,
        }
    }

    /// Says what begins.
    pub fn tell(&self, what: &str) {
        (self.progress)(what);
    }
}

impl std::fmt::Debug for Watch<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let mut shown = f.debug_struct("Watch");
        shown.field("limit", &self.limit).finish_non_exhaustive()
    }
}

/// Account of a computation under a limit: how far it came, and what it left open.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Account {
    /// Steps of the search that were made whole.
    pub steps: usize,
    /// Last work that was done before anything was left open, in words; empty = none.
    pub last: String,
    /// Reason why something was left open; `None` = nothing was.
    pub cause: Option<Cause>,
    /// Work that was left open, in words, in the order in which it would have come.
    pub open: Vec<String>,
}

impl Account {
    /// Notes work that is done.
    pub fn did(&mut self, what: &str) {
        if self.cause.is_none() {
            what.clone_into(&mut self.last);
        }
    }

    /// Notes optional work as open if the limit is over; whether it is.
    pub fn leaves_open(&mut self, limit: Limit, what: &str) -> bool {
        let Some(cause) = limit.cause() else {
            return false;
        };
        self.cut(cause, what);
        true
    }

    /// Notes work as left open.
    pub fn cut(&mut self, cause: Cause, what: &str) {
        self.cause.get_or_insert(cause);
        if !self.open.iter().any(|known| known == what) {
            self.open.push(what.to_owned());
        }
    }

    /// Adds what another part of the same computation left open.
    pub fn join(&mut self, other: &Account) {
        let Some(cause) = other.cause else { return };
        for what in &other.open {
            self.cut(cause, what);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_limit_is_over_by_its_time_or_by_a_word() {
        assert_eq!(Limit::NONE.cause(), None);
        let now = Limit::after(Duration::ZERO);
        assert_eq!(now.cause(), Some(Cause::Time));
        assert_eq!(now.without_time().cause(), None);
        let soon = Limit::after(Duration::from_secs(3600));
        assert_eq!(soon.earlier(0.0).cause(), Some(Cause::Time));
        assert_eq!(soon.earlier(0.5).cause(), None);
        assert_eq!(Limit::NONE.earlier(0.0).cause(), None);
        let never = Limit::after(Duration::MAX);
        assert_eq!(never.cause(), None);
        assert_eq!(never.interrupted_by(|| false).cause(), None);
        let asked = Limit::NONE.interrupted_by(|| true);
        assert_eq!(asked.cause(), Some(Cause::Interrupt));
    }

    #[test]
    fn an_account_keeps_the_first_cause_and_each_open_work_once() {
        let mut account = Account::default();
        account.did("one");
        assert!(!account.leaves_open(Limit::NONE, "two"));
        assert_eq!(account.cause, None);
        account.cut(Cause::Time, "two");
        account.cut(Cause::Interrupt, "two");
        account.did("three");
        let mut other = Account::default();
        other.cut(Cause::Interrupt, "four");
        account.join(&other);
        account.join(&Account::default());
        assert_eq!(account.cause, Some(Cause::Time));
        assert_eq!((account.last.as_str(), account.open.len()), ("one", 2));
    }
}

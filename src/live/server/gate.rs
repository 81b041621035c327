//! The guard of every request, with the account of wrong tokens.

use super::super::guard::{Asked, Guard, Refusal};
use super::super::guesses::Guesses;
use super::open::Connection;
use hydroline_core::lock::Lock;
use std::sync::Mutex;
use std::time::Instant;

pub(super) struct Gate {
    guard: Guard,
    guesses: Mutex<Guesses>,
}

impl Gate {
    pub(super) fn new(guard: Guard) -> Self {
        Self {
            guard,
            guesses: Mutex::default(),
        }
    }

    pub(super) fn guard(&self) -> &Guard {
        &self.guard
    }

    /// The guard's answer `by` one of its rules; a computer that guesses tokens does not learn whether its next one is right.
    pub(super) fn check<R>(
        &self,
        connection: &Connection,
        asked: &Asked<'_>,
        by: impl Fn(&Guard, &Asked<'_>) -> Result<R, Refusal>,
    ) -> Result<R, Refusal> {
        let guessing = !connection.is_kept() && !self.guard.has_key(asked);
        let offered = self.guard.offered(asked).filter(|_| guessing);
        let Some(offered) = offered else {
            return by(&self.guard, asked);
        };
        let (peer, now) = (connection.peer(), Instant::now());
        self.guesses.held().admit(peer, offered, now)?;
        let checked = by(&self.guard, asked);
        if checked.as_ref().err() == Some(&Refusal::Token) {
            self.guesses.held().wrong(peer, offered, now);
        }
        checked
    }
}

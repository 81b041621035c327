//! A mailbox that holds only the newest item: how analysis runs at its own pace
//! without ever making the capture thread wait.

use hydroline_core::lock::Lock;
use std::sync::{Condvar, Mutex, PoisonError};
use std::time::Duration;

#[derive(Debug)]
struct State<T> {
    newest: Option<T>,
    skipped: u64,
    closed: bool,
}

/// A one-place mailbox; a new item replaces one that was not fetched, and the loss is counted.
#[derive(Debug)]
pub struct Mailbox<T> {
    state: Mutex<State<T>>,
    ready: Condvar,
}

/// Result of [`Mailbox::take`].
#[derive(Debug, PartialEq, Eq)]
pub enum Taken<T> {
    /// The newest item.
    Item(T),
    /// Nothing within the wait.
    Nothing,
    /// The giver has closed and everything was fetched.
    Closed,
}

impl<T> Default for Mailbox<T> {
    fn default() -> Self {
        Self {
            state: Mutex::new(State {
                newest: None,
                skipped: 0,
                closed: false,
            }),
            ready: Condvar::new(),
        }
    }
}

impl<T> Mailbox<T> {
    /// Leaves an item; never blocks on the taker's work.
    pub fn put(&self, item: T) {
        let mut state = self.state.held();
        if state.newest.replace(item).is_some() {
            state.skipped += 1;
        }
        drop(state);
        self.ready.notify_one();
    }

    /// Fetches the newest item, waiting up to `wait`.
    pub fn take(&self, wait: Duration) -> Taken<T> {
        let state = self.state.held();
        let (mut state, _) = self
            .ready
            .wait_timeout_while(state, wait, |s| s.newest.is_none() && !s.closed)
            .unwrap_or_else(PoisonError::into_inner);
        match state.newest.take() {
            Some(item) => Taken::Item(item),
            None if state.closed => Taken::Closed,
            None => Taken::Nothing,
        }
    }

    /// No more items will come; the taker gets what is left, then [`Taken::Closed`].
    pub fn close(&self) {
        self.state.held().closed = true;
        self.ready.notify_all();
    }

    /// Items that were replaced before anyone fetched them.
    pub fn skipped(&self) -> u64 {
        self.state.held().skipped
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_newest_wins_and_the_rest_is_counted() {
        let mailbox = Mailbox::default();
        for i in 0..5 {
            mailbox.put(i);
        }
        assert_eq!(mailbox.take(Duration::ZERO), Taken::Item(4));
        assert_eq!(mailbox.skipped(), 4);
        assert_eq!(mailbox.take(Duration::ZERO), Taken::Nothing);
    }

    #[test]
    fn what_is_left_at_closing_is_still_handed_out() {
        let mailbox = Mailbox::default();
        mailbox.put(1);
        mailbox.close();
        assert_eq!(mailbox.take(Duration::from_secs(10)), Taken::Item(1));
        assert_eq!(mailbox.take(Duration::from_secs(10)), Taken::Closed);
    }

    #[test]
    fn every_item_is_either_taken_or_counted() {
        let mailbox = std::sync::Arc::new(Mailbox::default());
        let taker = {
            let mailbox = mailbox.clone();
            std::thread::spawn(move || {
                let mut taken = 0u64;
                loop {
                    match mailbox.take(Duration::from_secs(5)) {
                        Taken::Item(_) => taken += 1,
                        Taken::Closed => return taken,
                        Taken::Nothing => {}
                    }
                }
            })
        };
        for i in 0..10_000 {
            mailbox.put(i);
        }
        mailbox.close();
        let taken = taker.join().unwrap();
        assert_eq!(taken + mailbox.skipped(), 10_000);
    }
}

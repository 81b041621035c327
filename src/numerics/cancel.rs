//! Ending a long computation from outside, between two of its steps.
//!
//! Whoever starts the computation gives the threads on which it runs a [`Token`] ([`Token::bind`]); the loops that may
//! take long ask [`check`] once a step. After [`Token::cancel`] the next question ends the computation: it unwinds,
//! so that every guard on the way is dropped (files half written go, locks are released), up to [`catch`], which
//! returns [`Cancelled`]. No result of a cancelled computation can be taken for a whole one, as it could if each loop
//! stopped early and went on with what it has. A thread without a token is never cancelled, and the question costs it
//! a look at one thread-local variable.
//!
//! Threads of a pool do not inherit anything: a pool of its own whose threads are bound when they start
//! (`rayon::ThreadPoolBuilder::start_handler`) belongs to each computation that can be cancelled.
//!
//! ```
//! use hydroline_numerics::cancel::{self, Cancelled, Token};
//!
//! let token = Token::default();
//! let found = cancel::catch(|| {
//!     let _bound = token.bind();
//!     for step in 0.. {
//!         cancel::check();
//!         if step == 3 {
//!             token.cancel(); // as another thread would
//!         }
//!     }
//! });
//! assert_eq!(found, Err(Cancelled));
//! ```

use std::cell::RefCell;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

thread_local! {
    static BOUND: RefCell<Option<Token>> = const { RefCell::new(None) };
}

/// Says whether a computation is to end. Clones are the same token.
#[derive(Debug, Clone, Default)]
pub struct Token(Arc<AtomicBool>);

/// The computation was ended by its token before it had a result.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("cancelled before there was a result")]
pub struct Cancelled;

/// A thread's token, until this is dropped; then the one before it.
#[derive(Debug)]
pub struct Bound(Option<Token>);

impl Token {
    /// Ends what runs under this token, at its next [`check`].
    pub fn cancel(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    /// Whether [`Token::cancel`] was called.
    pub fn is_cancelled(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }

    /// Makes this the token of the calling thread.
    #[must_use = "the thread is bound until this is dropped"]
    pub fn bind(&self) -> Bound {
        Bound(BOUND.with_borrow_mut(|bound| bound.replace(self.clone())))
    }
}

impl Drop for Bound {
    fn drop(&mut self) {
        let before = self.0.take();
        // A thread that ends has no variables any more.
        let _ = BOUND.try_with(|bound| *bound.borrow_mut() = before);
    }
}

/// Goes on, or ends the computation if this thread's token says so.
#[inline]
pub fn check() {
    let cancelled = BOUND.with_borrow(|bound| bound.as_ref().is_some_and(Token::is_cancelled));
    if cancelled {
        // Past the panic hook: nothing is printed, nothing is wrong.
        resume_unwind(Box::new(Cancelled));
    }
}

/// Runs a computation up to its end or to its cancellation; a panic goes on as it is.
///
/// # Errors
/// [`Cancelled`] by the token of a thread on which it ran.
pub fn catch<T>(computation: impl FnOnce() -> T) -> Result<T, Cancelled> {
    catch_unwind(AssertUnwindSafe(computation)).map_err(|payload| {
        if payload.is::<Cancelled>() {
            Cancelled
        } else {
            resume_unwind(payload)
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_threads_with_the_token_end_and_guards_are_dropped() {
        let (mine, other) = (Token::default(), Token::default());
        other.cancel();
        let _bound = mine.bind();
        check();
        let dropped = AtomicBool::new(false);
        struct Guard<'a>(&'a AtomicBool);
        impl Drop for Guard<'_> {
            fn drop(&mut self) {
                self.0.store(true, Ordering::Relaxed);
            }
        }
        let found = catch(|| {
            let _guard = Guard(&dropped);
            let _bound = other.bind();
            check();
            1
        });
        assert_eq!(found, Err(Cancelled));
        assert!(dropped.load(Ordering::Relaxed));
        // The thread has its own token again.
        check();
        assert_eq!(catch(|| 2), Ok(2));
    }
}

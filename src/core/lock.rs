//! Locks that outlive a panic of whoever held them: what they guard is whole between any two statements.

use std::sync::{Mutex, MutexGuard, PoisonError};

/// A lock that is taken whether or not a thread has panicked with it.
pub trait Lock<T> {
    /// Waits for the lock and holds it.
    fn held(&self) -> MutexGuard<'_, T>;
}

impl<T> Lock<T> for Mutex<T> {
    fn held(&self) -> MutexGuard<'_, T> {
        self.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

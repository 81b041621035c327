//! Maps on all cores, results in the order of their items.
//!
//! For jobs of milliseconds and more. Rayon is compiled once, here: its own maps are compiled anew for every closure,
//! some 5 000 lines of LLVM IR each. As with them, jobs run on the threads of the caller's pool (a single one on the
//! calling thread), and what unwinds in a job, a panic or [`cancel::check`](crate::cancel::check), unwinds in the caller.
//!
//! ```
//! use hydroline_numerics::parallel;
//!
//! assert_eq!(parallel::map(4, |k| k * k), [0, 1, 4, 9]);
//! assert_eq!(parallel::map_slice(&["one", "three"], |word| word.len()), [3, 5]);
//! ```

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};

use rayon::prelude::*;

/// Least pieces of a map for each thread: the last piece alone is waited for, an eighth of a thread's share.
const PIECES_PER_THREAD: usize = 8;

/// Runs a job for each index below `count`.
fn each(count: usize, job: &(dyn Fn(usize) + Sync)) {
    // By itself rayon stops at a piece per thread, and long jobs in one piece wait for each other. Single jobs out of many would
    // pile up: a thread whose job waits for a map of its own begins the next piece on top of it.
    let piece = count.div_ceil(PIECES_PER_THREAD * rayon::current_num_threads());
    let jobs = (0..count).into_par_iter().with_max_len(piece.max(1));
    jobs.for_each(job);
}

fn lock<T>(shared: &Mutex<T>) -> MutexGuard<'_, T> {
    shared.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Results of a job for each index below `count`.
pub fn map<T: Send>(count: usize, job: impl Fn(usize) -> T + Sync) -> Vec<T> {
    let slots = Mutex::new((0..count).map(|_| None).collect::<Vec<Option<T>>>());
    each(count, &|k| {
        // Before the lock is taken, which the job's own maps would wait for.
        let made = job(k);
        lock(&slots)[k] = Some(made);
    });
    let slots = slots.into_inner().unwrap_or_else(PoisonError::into_inner);
    slots.into_iter().flatten().collect()
}

/// Results of a job for each item of a slice.
pub fn map_slice<I: Sync, T: Send>(items: &[I], job: impl Fn(&I) -> T + Sync) -> Vec<T> {
    map(items.len(), |k| job(&items[k]))
}

/// Results of a job that takes each item of a vector.
pub fn map_owned<I: Send, T: Send>(items: Vec<I>, job: impl Fn(I) -> T + Sync) -> Vec<T> {
    let count = items.len();
    let items = Mutex::new(items.into_iter().map(Some).collect::<Vec<_>>());
    let made = map(count, |k| {
        let item = lock(&items)[k].take();
        item.map(&job)
    });
    made.into_iter().flatten().collect()
}

/// Results of a job for each index below `count`. After an error no further job is begun.
///
/// # Errors
/// The job's; of several, which depends on the threads.
pub fn try_map<T: Send, E: Send>(
    count: usize,
    job: impl Fn(usize) -> Result<T, E> + Sync,
) -> Result<Vec<T>, E> {
    let failed = AtomicBool::new(false);
    let made = map(count, |k| {
        if failed.load(Ordering::Relaxed) {
            return None;
        }
        let made = job(k);
        if made.is_err() {
            failed.store(true, Ordering::Relaxed);
        }
        Some(made)
    });
    made.into_iter().flatten().collect()
}

/// Results of a job for each item of a slice. After an error no further job is begun.
///
/// # Errors
/// The job's; of several, which depends on the threads.
pub fn try_map_slice<I: Sync, T: Send, E: Send>(
    items: &[I],
    job: impl Fn(&I) -> Result<T, E> + Sync,
) -> Result<Vec<T>, E> {
    try_map(items.len(), |k| job(&items[k]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cancel::{self, Cancelled, Token};
    use std::panic::{AssertUnwindSafe, catch_unwind};
    use std::sync::atomic::AtomicUsize;

    /// Later ones end sooner.
    fn slow(k: usize, of: usize) -> usize {
        std::thread::sleep(std::time::Duration::from_micros(50 * (of - k) as u64));
        k
    }

    #[test]
    fn results_are_in_the_order_of_the_items() {
        let all: Vec<usize> = (0..50).collect();
        assert_eq!(map(50, |k| slow(k, 50)), all);
        assert_eq!(map_slice(&all, |k| slow(*k, 50)), all);
        let boxed: Vec<Box<usize>> = all.iter().copied().map(Box::new).collect();
        assert_eq!(map_owned(boxed, |k| slow(*k, 50)), all);
        assert_eq!(
            try_map_slice(&all, |k| Ok::<_, ()>(slow(*k, 50))),
            Ok(all.clone())
        );
    }

    #[test]
    fn nothing_maps_to_nothing() {
        assert!(map(0, |k| k).is_empty());
        assert!(map_slice(&[], |k: &u8| *k).is_empty());
        assert!(map_owned(Vec::new(), |k: String| k).is_empty());
        assert_eq!(try_map_slice(&[], |k: &u8| Err::<u8, u8>(*k)), Ok(vec![]));
    }

    #[test]
    fn a_single_job_runs_on_the_calling_thread() {
        let here = std::thread::current().id();
        assert_eq!(map(1, |_| std::thread::current().id()), [here]);
    }

    #[test]
    fn a_panic_of_a_job_is_the_callers_and_results_are_dropped() {
        let made = AtomicUsize::new(0);
        struct Counted<'a>(&'a AtomicUsize);
        impl Drop for Counted<'_> {
            fn drop(&mut self) {
                self.0.fetch_sub(1, Ordering::Relaxed);
            }
        }
        let caught = catch_unwind(AssertUnwindSafe(|| {
            map(20, |k| {
                assert_ne!(k, 7, "the seventh");
                made.fetch_add(1, Ordering::Relaxed);
                Counted(&made)
            })
        }));
        let words = caught.err().and_then(|p| p.downcast::<String>().ok());
        assert!(words.is_some_and(|w| w.contains("the seventh")));
        assert_eq!(made.load(Ordering::Relaxed), 0);
        // Of an item that was taken, too.
        let caught = catch_unwind(|| map_owned(vec![1, 2, 3], |k| assert_ne!(k, 2)));
        assert!(caught.is_err());
    }

    #[test]
    fn a_cancelled_job_ends_the_map() {
        let token = Token::default();
        let found = cancel::catch(|| {
            map(20, |k| {
                let _bound = token.bind();
                if k == 3 {
                    token.cancel();
                }
                cancel::check();
                k
            })
        });
        assert_eq!(found, Err(Cancelled));
    }

    #[test]
    fn maps_within_maps_do_not_wait_for_each_other() {
        let sums = map(30, |a| {
            let inner = map_owned((0..30).collect(), |b: usize| {
                map_slice(&[1, 2, 3], |c| a * b + slow(*c, 4)).iter().sum()
            });
            inner.iter().sum::<usize>()
        });
        let expected: Vec<usize> = (0..30).map(|a| 3 * a * 435 + 180).collect();
        assert_eq!(sums, expected);
    }

    #[test]
    fn an_error_is_returned_and_ends_what_is_not_begun() {
        let begun = AtomicUsize::new(0);
        let all: Vec<usize> = (0..10_000).collect();
        let found = try_map_slice(&all, |k| {
            begun.fetch_add(1, Ordering::Relaxed);
            Err::<(), usize>(*k)
        });
        assert!(found.is_err());
        // One for each thread at most.
        assert!(begun.load(Ordering::Relaxed) <= rayon::current_num_threads());
        let found = try_map_slice(&[1, 2, 3, 4], |k| if *k < 3 { Ok(*k) } else { Err(*k) });
        assert!(found.is_err_and(|k| k >= 3));
    }
}

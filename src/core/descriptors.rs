//! Files, sockets and devices that the process may have open at once (`RLIMIT_NOFILE`, `ulimit -n`).
//!
//! Libraries take it for granted that a descriptor more is there, and end the program where it is not. So the limit is looked at
//! before any work, and set as high as is needed where the system lets us.

use std::io;

/// Descriptors that a command needs, with some to spare: a recording has about 30 (camera, line, parts of the log, signals), a
/// campaign as many logs as there are cores.
pub const NEEDED: u64 = 64;
/// Descriptors that the live page may use as well, and that most systems give anyway.
const WANTED: u64 = 1024;

/// Why no work begins.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)] // Each message names its fields.
pub enum TooFew {
    #[error(
        "this process may open {limit} files (`ulimit -n`), {NEEDED} are needed: `ulimit -n {WANTED}` in this shell, or LimitNOFILE={WANTED} \
         in the service's unit"
    )]
    Limit { limit: u64 },
    #[error("the limit on open files cannot be read: {0}")]
    Unknown(#[from] io::Error),
}

/// Makes room for what commands need; the number of descriptors there may be then.
///
/// # Errors
/// [`TooFew`] where the system allows fewer than [`NEEDED`].
pub fn make_room() -> Result<u64, TooFew> {
    let mut limit = libc::rlimit {
        rlim_cur: 0,
        rlim_max: 0,
    };
    // SAFETY: a valid structure that lives through the call.
    if unsafe { libc::getrlimit(libc::RLIMIT_NOFILE, &raw mut limit) } != 0 {
        return Err(io::Error::last_os_error().into());
    }
    if limit.rlim_cur < WANTED {
        let raised = libc::rlimit {
            rlim_cur: WANTED.min(limit.rlim_max),
            ..limit
        };
        // SAFETY: a valid structure that is only read.
        if unsafe { libc::setrlimit(libc::RLIMIT_NOFILE, &raw const raised) } == 0 {
            limit = raised;
        }
    }
    enough(limit.rlim_cur)
}

fn enough(limit: u64) -> Result<u64, TooFew> {
    match limit {
        limit if limit < NEEDED => Err(TooFew::Limit { limit }),
        limit => Ok(limit),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn too_few_descriptors_are_said_with_the_number_and_what_to_do() {
        assert_eq!(enough(NEEDED).ok(), Some(NEEDED));
        let words = enough(8).unwrap_err().to_string();
        assert!(
            words.contains("may open 8 files") && words.contains("ulimit -n 1024"),
            "{words}"
        );
        assert!(make_room().unwrap() >= NEEDED);
    }
}

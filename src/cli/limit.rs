//! Time limit of a diagnosis, and Ctrl-C that ends it with the verdict so far.

use super::{CliError, call, inputs};
use hydroline_daemon::signals::listen;
use hydroline_diagnose::Limit;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// Time limit of each diagnosis of a command.
#[derive(Debug, Clone, Copy, clap::Args)]
pub struct LimitArgs {
    /// Time after which a diagnosis ends with the verdict so far, marked so and with what was still open; none = it goes
    /// on to its end
    #[arg(long, value_parser = time_limit, allow_hyphen_values = true, default_value = "120s", value_name = "TIME")]
    time_limit: TimeLimit,
}

impl LimitArgs {
    /// Length of the limit; `None` = there is none.
    pub fn length(self) -> Option<Duration> {
        self.time_limit.0
    }

    /// Limit of a diagnosis that begins now.
    pub fn begin(self) -> Limit {
        self.length().map_or(Limit::NONE, Limit::after)
    }
}

/// A length of time, or none.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct TimeLimit(Option<Duration>);

fn time_limit(text: &str) -> Result<TimeLimit, String> {
    if text == "none" {
        return Ok(TimeLimit(None));
    }
    let length = inputs::duration(text).map_err(|e| format!("{e}, or none"))?;
    Ok(TimeLimit(Some(length)))
}

/// Whether Ctrl-C was pressed since [`until_ctrl_c`].
static PRESSED: AtomicBool = AtomicBool::new(false);

/// Words on the first Ctrl-C: what is begun may take seconds to its end.
const ENDING: &[u8] =
    b"\nhydroline: ending with the verdict so far; Ctrl-C again ends without one\n";

extern "C" fn pressed(_: libc::c_int) {
    PRESSED.store(true, Ordering::Relaxed);
    // SAFETY: write may be called in a handler, and the words live as long as the program. What it returns is of no use here.
    unsafe { libc::write(libc::STDERR_FILENO, ENDING.as_ptr().cast(), ENDING.len()) };
}

/// The limit, over as well after the first Ctrl-C from now on; the second one ends the program as ever. Where Ctrl-C is ignored
/// (a job in the background), or another program calls this one, it stays as it was.
pub fn until_ctrl_c(limit: Limit) -> Limit {
    if call::listener().is_some() {
        return limit;
    }
    // SAFETY: zero is a valid sigaction: the default action, no flags, an empty mask. With a null pointer the second call only
    // reads; the handler of the third does nothing but what signal-safety(7) allows, and is taken out as it is called.
    let is_heard = unsafe {
        let mut before: libc::sigaction = std::mem::zeroed();
        let is_read = libc::sigaction(libc::SIGINT, std::ptr::null(), &raw mut before) == 0;
        let mut action: libc::sigaction = std::mem::zeroed();
        let handler: extern "C" fn(libc::c_int) = pressed;
        action.sa_sigaction = handler as *const () as libc::sighandler_t;
        action.sa_flags = libc::SA_RESETHAND | libc::SA_RESTART;
        is_read
            && before.sa_sigaction != libc::SIG_IGN
            && libc::sigaction(libc::SIGINT, &raw const action, std::ptr::null_mut()) == 0
    };
    match is_heard {
        true => limit.interrupted_by(|| PRESSED.load(Ordering::Relaxed)),
        false => limit,
    }
}

/// The limit, over as well after the first signal that ends a recording.
pub fn until_signal(limit: Limit) -> Result<Limit, CliError> {
    // Here, once: the threads that ask below would begin to listen one beside the other.
    listen().map_err(CliError::run)?;
    Ok(limit.interrupted_by(|| listen().is_ok_and(|signals| signals.heard().is_some())))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_time_limit_is_a_length_of_time_or_none() {
        assert_eq!(time_limit("none"), Ok(TimeLimit(None)));
        let two = Some(Duration::from_secs(120));
        for text in ["120s", "2min", "2m", "120"] {
            assert_eq!(time_limit(text), Ok(TimeLimit(two)), "{text}");
        }
        assert_eq!(time_limit("0s"), Ok(TimeLimit(Some(Duration::ZERO))));
        for text in ["-1s", "soon", "", "None"] {
            let words = time_limit(text).unwrap_err();
            assert!(words.ends_with("or none"), "{words}");
        }
    }
}

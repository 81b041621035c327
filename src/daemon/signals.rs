//! Every signal that would end or stop the process and can be caught, for the whole process.
//!
//! One thread listens from the first [`listen`] on. The first signal is latched: it brings every
//! attached thruster line to neutral at once, by one atomic store and whatever the rest of the
//! program is waiting for, and stays visible to every loop that asks. The second one ends the process.

use hydroline_core::lock::Lock;
use hydroline_thruster::NeutralHandle;
use hydroline_thruster::safety::NeutralReason;
use std::io;
use std::sync::{Mutex, OnceLock};
use tokio::signal::unix::{SignalKind, signal};

/// Names of signals that end a recording in order, as people know them; of others [`ending`] makes one.
const NAMES: [(&str, i32); 16] = [
    ("Ctrl-C", libc::SIGINT),
    ("SIGTERM", libc::SIGTERM),
    ("SIGHUP", libc::SIGHUP),
    ("SIGQUIT", libc::SIGQUIT),
    ("SIGABRT", libc::SIGABRT),
    ("SIGUSR1", libc::SIGUSR1),
    ("SIGUSR2", libc::SIGUSR2),
    ("SIGALRM", libc::SIGALRM),
    ("SIGVTALRM", libc::SIGVTALRM),
    ("SIGPROF", libc::SIGPROF),
    ("SIGXCPU", libc::SIGXCPU),
    ("SIGPWR", libc::SIGPWR),
    ("SIGIO", libc::SIGIO),
    ("SIGSYS", libc::SIGSYS),
    ("SIGTRAP", libc::SIGTRAP),
    ("SIGSTKFLT", libc::SIGSTKFLT),
];
/// Name of all that have none of their own.
const REAL_TIME: &str = "a real-time signal";
/// Signals that are left alone: they cannot be caught, they say that the program itself is broken (to return from their handler
/// would run into the same instruction again), or they end nothing by default. SIGPIPE is ignored from the start.
const LEFT_ALONE: [i32; 11] = [
    libc::SIGKILL,
    libc::SIGSTOP,
    libc::SIGSEGV,
    libc::SIGBUS,
    libc::SIGILL,
    libc::SIGFPE,
    libc::SIGCHLD,
    libc::SIGCONT,
    libc::SIGURG,
    libc::SIGWINCH,
    libc::SIGPIPE,
];
/// Signals that must not touch the process: a write beyond a limit on a file's size (the log goes on in its next part), and a
/// terminal that would stop it for reading or writing from the background, or at Ctrl-Z.
const IGNORED: [i32; 4] = [libc::SIGXFSZ, libc::SIGTTIN, libc::SIGTTOU, libc::SIGTSTP];

/// Every signal that ends a recording in order, thrusters first: left at its default it would kill the process at once and
/// leave the thrusters running. All that the system has, but for those that are ignored or left alone. systemd's watchdog sends
/// SIGABRT; SIGHUP is a dropped ssh session.
fn ending() -> impl Iterator<Item = (&'static str, i32)> {
    // Between the two the threads library keeps some for itself.
    let numbers = (1..=libc::SIGSYS).chain(libc::SIGRTMIN()..=libc::SIGRTMAX());
    let numbers = numbers.filter(|n| !IGNORED.contains(n) && !LEFT_ALONE.contains(n));
    numbers.map(|number| {
        let name = NAMES.iter().find(|(_, n)| *n == number);
        (name.map_or(REAL_TIME, |(name, _)| *name), number)
    })
}

/// First signal heard, and the lines that it puts at neutral.
#[derive(Debug, Default)]
pub struct Signals {
    heard: OnceLock<&'static str>,
    lines: Mutex<Vec<NeutralHandle>>,
}

static SIGNALS: OnceLock<Signals> = OnceLock::new();

/// Starts to listen (once per process) and returns the latch.
///
/// # Errors
/// When the handlers or the thread cannot be set up.
pub fn listen() -> io::Result<&'static Signals> {
    if let Some(signals) = SIGNALS.get() {
        return Ok(signals);
    }
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()?;
    let mut arrivals = {
        let _inside = runtime.enter();
        let (to, arrivals) = tokio::sync::mpsc::unbounded_channel();
        for ending in ending() {
            let mut signal = signal(SignalKind::from_raw(ending.1))?;
            let to = to.clone();
            runtime.spawn(async move {
                while signal.recv().await.is_some() && to.send(ending).is_ok() {}
            });
        }
        arrivals
    };
    for number in IGNORED {
        // SAFETY: SIG_IGN runs no code of ours.
        if unsafe { libc::signal(number, libc::SIG_IGN) } == libc::SIG_ERR {
            return Err(io::Error::last_os_error());
        }
    }
    let signals = SIGNALS.get_or_init(Signals::default);
    std::thread::Builder::new()
        .name("signals".to_owned())
        .spawn(move || {
            runtime.block_on(async {
                while let Some((name, number)) = arrivals.recv().await {
                    signals.neutral();
                    if signals.heard.set(name).is_err() {
                        // Asked twice: something hangs. 128 + n is what a shell shows for a killed process.
                        std::process::exit(128 + number);
                    }
                }
            });
        })?;
    Ok(signals)
}

impl Signals {
    /// The first signal, once there was one.
    pub fn heard(&self) -> Option<&'static str> {
        self.heard.get().copied()
    }

    /// From now on the first signal brings this line to neutral by itself.
    pub fn attach(&self, line: NeutralHandle) {
        self.lines.held().push(line);
    }

    /// Forgets all lines: their services have ended.
    pub fn detach_all(&self) {
        self.lines.held().clear();
    }

    fn neutral(&self) {
        for line in self.lines.held().iter() {
            // For good: a plan that is just about to begin must not take it back.
            line.bar(NeutralReason::Exit);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Signals whose default is to end the process, by signal(7), and that can be caught without being a broken program's.
    #[test]
    fn every_signal_that_would_end_the_process_is_heard() {
        let heard: Vec<i32> = ending().map(|(_, number)| number).collect();
        let standard = [
            1, 2, 3, 5, 6, 10, 12, 14, 15, 16, 24, 26, 27, 29, 30, 31, // x86 and ARM
        ];
        let real_time = libc::SIGRTMIN()..=libc::SIGRTMAX();
        let missing: Vec<i32> = standard
            .into_iter()
            .chain(real_time)
            .filter(|n| !heard.contains(n))
            .collect();
        assert!(missing.is_empty(), "{missing:?}");
        // Each standard one by its name.
        let unnamed = ending().filter(|(name, n)| *name == REAL_TIME && *n < libc::SIGRTMIN());
        assert_eq!(unnamed.count(), 0);
    }
}

//! Ctrl-C, SIGTERM, SIGHUP (a dropped ssh session) and SIGQUIT, for the whole process.
//!
//! One thread listens from the first [`listen`] on. The first signal is latched: it brings every
//! attached thruster line to neutral at once, by one atomic store and whatever the rest of the
//! program is waiting for, and stays visible to every loop that asks. The second one ends the process.

use hydroline_thruster::NeutralHandle;
use hydroline_thruster::safety::NeutralReason;
use std::io;
use std::sync::{Mutex, OnceLock, PoisonError};
use tokio::signal::unix::{Signal, SignalKind, signal};

/// What has been heard.
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
    let [mut interrupt, mut terminate, mut hangup, mut quit] = {
        let _inside = runtime.enter();
        let on = |kind: SignalKind| -> io::Result<Signal> { signal(kind) };
        [
            on(SignalKind::interrupt())?,
            on(SignalKind::terminate())?,
            on(SignalKind::hangup())?,
            on(SignalKind::quit())?,
        ]
    };
    let signals = SIGNALS.get_or_init(Signals::default);
    std::thread::Builder::new()
        .name("signals".to_owned())
        .spawn(move || {
            runtime.block_on(async {
                loop {
                    let (name, number) = tokio::select! {
                        _ = interrupt.recv() => ("Ctrl-C", libc::SIGINT),
                        _ = terminate.recv() => ("SIGTERM", libc::SIGTERM),
                        _ = hangup.recv() => ("SIGHUP", libc::SIGHUP),
                        _ = quit.recv() => ("SIGQUIT", libc::SIGQUIT),
                    };
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
        self.lock().push(line);
    }

    /// Forgets all lines: their services have ended.
    pub fn detach_all(&self) {
        self.lock().clear();
    }

    fn neutral(&self) {
        for line in self.lock().iter() {
            // For good: a plan that is just about to begin must not take it back.
            line.bar(NeutralReason::Exit);
        }
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, Vec<NeutralHandle>> {
        self.lines.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

//! Ctrl-C and SIGTERM for commands that loop by themselves.

use super::CliError;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Raised by the first Ctrl-C or SIGTERM; a second one kills as usual.
#[derive(Debug, Clone, Default)]
pub struct StopFlag(Arc<AtomicBool>);

impl StopFlag {
    /// Whether the user asked to stop.
    pub fn is_raised(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}

/// Starts to listen, on a thread of its own.
pub fn stop_flag() -> Result<StopFlag, CliError> {
    use tokio::signal::unix::{SignalKind, signal};
    let flag = StopFlag::default();
    let raise = flag.clone();
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .map_err(CliError::run)?;
    let (mut interrupt, mut terminate) = {
        let _inside = runtime.enter();
        (
            signal(SignalKind::interrupt()).map_err(CliError::run)?,
            signal(SignalKind::terminate()).map_err(CliError::run)?,
        )
    };
    std::thread::Builder::new()
        .name("signals".to_owned())
        .spawn(move || {
            runtime.block_on(async {
                tokio::select! { _ = interrupt.recv() => {}, _ = terminate.recv() => {} }
            });
            raise.0.store(true, Ordering::Relaxed);
        })
        .map_err(CliError::run)?;
    Ok(flag)
}

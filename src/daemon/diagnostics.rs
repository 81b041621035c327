//! Diagnostics: to stderr, and while recording into the log's `/daemon/log`.
//!
//! Levels: error = something was lost or stopped; warn = degraded, nothing lost; info = milestones of
//! a run; debug = one line per event; trace = one line per frame. stderr shows warn and worse unless
//! RUST_LOG says otherwise; the log gets info and worse.

use hydroline_log::Recorder;
use hydroline_log::trace::LogLayer;
use std::sync::OnceLock;
use tracing_appender::non_blocking::WorkerGuard;
use tracing_subscriber::EnvFilter;
use tracing_subscriber::filter::LevelFilter;
use tracing_subscriber::layer::{Layer, SubscriberExt};
use tracing_subscriber::util::SubscriberInitExt;

static LAYER: OnceLock<LogLayer> = OnceLock::new();

/// Writes what is left to stderr when dropped: keep it until the process ends.
#[must_use = "lines still waiting are written when this is dropped"]
pub struct Diagnostics(#[allow(dead_code)] WorkerGuard);

/// Sets up stderr and the way into a recording's log. A second call keeps the first set-up.
///
/// stderr is written by a thread of its own through a bounded queue: a terminal that stands still (Ctrl-S, a
/// dropped connection) must not hold up capture or thrusters. What it cannot take is dropped there; the
/// recording's own log has it.
pub fn init() -> Diagnostics {
    let filter = EnvFilter::try_from_default_env().unwrap_or_else(|_| EnvFilter::new("warn"));
    let (writer, guard) = tracing_appender::non_blocking(std::io::stderr());
    let stderr = tracing_subscriber::fmt::layer()
        // tracing-subscriber is built without its feature `ansi`: asked for colours it panics in a debug build.
        .with_ansi(false)
        .with_writer(writer)
        .with_target(false)
        .with_filter(filter);
    let into_log = LAYER
        .get_or_init(LogLayer::new)
        .clone()
        .with_filter(LevelFilter::INFO);
    let _ = tracing_subscriber::registry()
        .with(stderr)
        .with(into_log)
        .try_init();
    Diagnostics(guard)
}

/// While this lives, diagnostics go into that recording too.
#[must_use = "the log gets lines only while this lives"]
pub struct LogLines(());

/// Sends diagnostics into `recorder` until the returned guard is dropped.
pub fn into_log(recorder: &Recorder) -> LogLines {
    LAYER.get_or_init(LogLayer::new).attach(recorder);
    LogLines(())
}

impl Drop for LogLines {
    fn drop(&mut self) {
        if let Some(layer) = LAYER.get() {
            layer.detach();
        }
    }
}

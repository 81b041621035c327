//! Diagnostics: to stderr, and while recording into the log's `/daemon/log`.
//!
//! Levels: error = something was lost or stopped; warn = degraded, nothing lost; info = milestones of
//! a run; debug = one line per event; trace = one line per frame. stderr shows warn and worse unless
//! RUST_LOG says otherwise; the log gets info and worse.

use crate::log::Recorder;
use crate::log::trace::LogLayer;
use std::sync::OnceLock;
use tracing_subscriber::EnvFilter;
use tracing_subscriber::filter::LevelFilter;
use tracing_subscriber::layer::{Layer, SubscriberExt};
use tracing_subscriber::util::SubscriberInitExt;

static LAYER: OnceLock<LogLayer> = OnceLock::new();

/// Sets up stderr and the way into a recording's log. A second call keeps the first set-up.
pub fn init() {
    let filter = EnvFilter::try_from_default_env().unwrap_or_else(|_| EnvFilter::new("warn"));
    let stderr = tracing_subscriber::fmt::layer()
        .with_writer(std::io::stderr)
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

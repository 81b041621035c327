//! What goes to stderr. Levels: error = something was lost or stopped; warn = degraded, nothing
//! lost; info = milestones of a run; debug = one line per event; trace = one line per frame.

use tracing_subscriber::{EnvFilter, layer::SubscriberExt, util::SubscriberInitExt};

/// Diagnostics to stderr, `warn` unless RUST_LOG says otherwise, and into a recording's `/daemon/log`.
pub fn init() {
    let filter = EnvFilter::try_from_default_env().unwrap_or_else(|_| EnvFilter::new("warn"));
    let stderr = tracing_subscriber::fmt::layer().with_writer(std::io::stderr).with_target(false);
    // A second initialisation (tests) is harmless and keeps the first.
    let _ = tracing_subscriber::registry().with(filter).with(stderr).try_init();
}

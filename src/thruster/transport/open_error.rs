//! Reasons why a serial port does not open, each with what to do about it.

use std::path::PathBuf;

/// Reason why a port did not open.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)] // Each message names its fields.
pub enum OpenError {
    /// Not there (unplugged, wrong identity).
    #[error("serial port {wanted} is not there: {hint}")]
    NotFound {
        wanted: String,
        /// Ports that are there instead, or what to do.
        hint: String,
    },
    #[error("{0}")]
    Permission(String),
    #[error("serial port {path} is in use by another process (lsof {path} names it)")]
    Busy { path: PathBuf },
    #[error("serial port {path} does not open: {reason}")]
    Other { path: PathBuf, reason: String },
}

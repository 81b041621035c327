//! Why capture cannot go on: each error says what, where, with which numbers, and what to do.

use std::path::PathBuf;

/// What a source cannot mend by itself.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CaptureError {
    /// A scripted or replayed source broke.
    #[error("{source_name}: {reason}")]
    Source {
        /// Which source.
        source_name: String,
        /// What happened.
        reason: String,
    },
    /// No device with this identity.
    #[error(
        "no camera matches {identity}; present: {present}; `hydroline devices` lists what can be named"
    )]
    NotFound {
        /// As in the rig.
        identity: String,
        /// What is there.
        present: String,
    },
    /// A file could not be reached.
    #[error("{path}: {reason}")]
    Access {
        /// Path.
        path: PathBuf,
        /// Owner, group, mode and the command that mends it.
        reason: String,
    },
}

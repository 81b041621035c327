//! Why capture cannot go on: each error says what, where, with which numbers, and what to do.

use std::path::PathBuf;

/// Error that a source cannot mend by itself.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[allow(missing_docs)] // Each message names its fields.
pub enum CaptureError {
    #[error("{source_name}: {reason}")]
    Source { source_name: String, reason: String },
    #[error(
        "no camera matches {identity}; present: {present}; `hydroline devices` lists what can be named"
    )]
    NotFound { identity: String, present: String },
    #[error(
        "{node} is not a stable name; name the camera by id or by path (`hydroline devices` prints both), or set camera.allow_unstable_node = true"
    )]
    UnstableNode { node: PathBuf },
    #[error("the rig's camera is simulated; only a V4L2 camera can be opened here")]
    NotV4l,
    #[error("{node}: {reason}")]
    Access {
        node: PathBuf,
        /// Owner, group, mode and the command that mends it.
        reason: String,
    },
    #[error("{node} is busy: open in {holders}; stop that first")]
    Busy { node: PathBuf, holders: String },
    #[error(
        "{node} ({card}) cannot stream video: capabilities {caps:#010x} lack {missing}; a camera often has a second node for metadata"
    )]
    NotACamera {
        node: PathBuf,
        card: String,
        /// V4L2_CAP_*.
        caps: u32,
        missing: &'static str,
    },
    #[error("{node}: asked for {asked}, the device gives {got}; it offers: {offers}")]
    Format {
        node: PathBuf,
        asked: String,
        got: String,
        /// Formats, sizes and rates.
        offers: String,
    },
    #[error(
        "{node}: {format} comes in {planes} planes of memory, and one is read; choose a format whose planes lie together (NV12 instead of NM12); it offers: {offers}"
    )]
    Planes {
        node: PathBuf,
        format: String,
        planes: u32,
        /// Formats, sizes and rates.
        offers: String,
    },
    #[error(
        "{node}: laser.channel asks for a colour of {format}, whose levels are {said} range as the driver says; set camera.yuv_range = \"{said}\" (or \"limited\" where the driver is wrong)"
    )]
    YuvRange {
        node: PathBuf,
        format: String,
        said: &'static str,
    },
    #[error(
        "{node}: asked for {asked_fps} frames/s, the device gives {got_fps:.4}; it offers: {offers}"
    )]
    Rate {
        node: PathBuf,
        asked_fps: f64,
        got_fps: f64,
        /// Formats, sizes and rates.
        offers: String,
    },
    #[error("control `{name}`: {node} has none of this name; it has: {present}")]
    NoControl {
        node: PathBuf,
        name: String,
        present: String,
    },
    #[error(
        "control `{name}` of {node}: asked {asked}, {got}; allowed {min}..={max} in steps of {step}{hint}"
    )]
    Control {
        node: PathBuf,
        name: String,
        asked: i64,
        /// Read back, or the error.
        got: String,
        min: i64,
        max: i64,
        step: u64,
        /// Advice, or empty.
        hint: &'static str,
    },
    /// STREAMON: ENOSPC.
    #[error(
        "{node}: not enough USB bandwidth for {format} at {rate_fps:.3} frames/s: {mbit_s:.1} Mbit/s of pixels alone, and a high-speed bus carries at most 196.6 Mbit/s in one isochronous endpoint (3 x 1024 B each 125 us) shared with what else is on it; use MJPG, a lower rate or size, or another host controller"
    )]
    Bandwidth {
        node: PathBuf,
        format: String,
        rate_fps: f64,
        mbit_s: f64,
    },
    /// A call failed in a way without a better name.
    #[error("{node}: {call}: {reason} (errno {errno})")]
    Call {
        node: PathBuf,
        call: String,
        errno: i32,
        reason: String,
    },
    #[error("{node}: no frame after {attempts} attempts to start the stream; last: {last}")]
    NeverStarted {
        node: PathBuf,
        attempts: u32,
        last: String,
    },
}

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
    /// The rig names a node that may mean another camera after the next boot.
    #[error(
        "{node} is not a stable name; name the camera by id or by path (`hydroline devices` prints both), or set camera.allow_unstable_node = true"
    )]
    UnstableNode {
        /// The node.
        node: PathBuf,
    },
    /// The rig's camera is not a V4L2 device.
    #[error("the rig's camera is simulated; only a V4L2 camera can be opened here")]
    NotV4l,
    /// The node may not be opened.
    #[error("{node}: {reason}")]
    Access {
        /// Path.
        node: PathBuf,
        /// Owner, group, mode and the command that mends it.
        reason: String,
    },
    /// Somebody else has it.
    #[error("{node} is busy: open in {holders}; stop that first")]
    Busy {
        /// Path.
        node: PathBuf,
        /// Process ids and names.
        holders: String,
    },
    /// Not a camera node.
    #[error(
        "{node} ({card}) cannot stream video: capabilities {caps:#010x} lack {missing}; a camera often has a second node for metadata"
    )]
    NotACamera {
        /// Path.
        node: PathBuf,
        /// Card name.
        card: String,
        /// V4L2_CAP_*.
        caps: u32,
        /// What is missing.
        missing: &'static str,
    },
    /// The device changed the format.
    #[error("{node}: asked for {asked}, the device gives {got}; it offers: {offers}")]
    Format {
        /// Path.
        node: PathBuf,
        /// As in the rig.
        asked: String,
        /// What came back.
        got: String,
        /// Formats, sizes and rates.
        offers: String,
    },
    /// An image in several pieces.
    #[error(
        "{node}: {format} comes in {planes} planes of memory, and one is read; choose a format whose planes lie together (NV12 instead of NM12); it offers: {offers}"
    )]
    Planes {
        /// Path.
        node: PathBuf,
        /// Format.
        format: String,
        /// Planes.
        planes: u32,
        /// Formats, sizes and rates.
        offers: String,
    },
    /// A colour channel over levels that nobody named.
    #[error(
        "{node}: laser.channel asks for a colour of {format}, whose levels are {said} range as the driver says; set camera.yuv_range = \"{said}\" (or \"limited\" where the driver is wrong)"
    )]
    YuvRange {
        /// Path.
        node: PathBuf,
        /// Format.
        format: String,
        /// The driver's word.
        said: &'static str,
    },
    /// The device changed the rate.
    #[error(
        "{node}: asked for {asked_fps} frames/s, the device gives {got_fps:.4}; it offers: {offers}"
    )]
    Rate {
        /// Path.
        node: PathBuf,
        /// As in the rig.
        asked_fps: f64,
        /// What came back.
        got_fps: f64,
        /// Formats, sizes and rates.
        offers: String,
    },
    /// No such control.
    #[error("control `{name}`: {node} has none of this name; it has: {present}")]
    NoControl {
        /// Path.
        node: PathBuf,
        /// As in the rig.
        name: String,
        /// Names it has.
        present: String,
    },
    /// A control did not take its value.
    #[error(
        "control `{name}` of {node}: asked {asked}, {got}; allowed {min}..={max} in steps of {step}{hint}"
    )]
    Control {
        /// Path.
        node: PathBuf,
        /// As in the rig.
        name: String,
        /// Asked.
        asked: i64,
        /// Read back, or the error.
        got: String,
        /// Least.
        min: i64,
        /// Largest.
        max: i64,
        /// Step.
        step: u64,
        /// What to do, or empty.
        hint: &'static str,
    },
    /// STREAMON: ENOSPC.
    #[error(
        "{node}: not enough USB bandwidth for {format} at {rate_fps:.3} frames/s: {mbit_s:.1} Mbit/s of pixels alone, and a high-speed bus carries at most 196.6 Mbit/s in one isochronous endpoint (3 x 1024 B each 125 us) shared with what else is on it; use MJPG, a lower rate or size, or another host controller"
    )]
    Bandwidth {
        /// Path.
        node: PathBuf,
        /// Format.
        format: String,
        /// Rate \[1/s\].
        rate_fps: f64,
        /// Mbit/s.
        mbit_s: f64,
    },
    /// A call failed in a way without a better name.
    #[error("{node}: {call}: {reason} (errno {errno})")]
    Call {
        /// Path.
        node: PathBuf,
        /// ioctl.
        call: String,
        /// errno.
        errno: i32,
        /// Its words.
        reason: String,
    },
    /// The stream never started.
    #[error("{node}: no frame after {attempts} attempts to start the stream; last: {last}")]
    NeverStarted {
        /// Path.
        node: PathBuf,
        /// Attempts.
        attempts: u32,
        /// Last failure.
        last: String,
    },
}

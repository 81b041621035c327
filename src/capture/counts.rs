//! Frames received, frames lost by cause, and frames due by time.

use serde::{Deserialize, Serialize};

/// Frames that never came, by how that was noticed. All numbers are whole frames.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, schemars::JsonSchema, Deserialize,
)]
pub struct Losses {
    /// Gap in the driver's sequence numbers: the host had no buffer free, or the driver dropped.
    pub sequence_gap: u64,
    /// Missing periods in the stamps with no gap in the sequence: dropped inside the device.
    pub time_gap: u64,
    /// Periods during which the stream stood still without an error.
    pub frozen: u64,
    /// Periods during which the device was gone.
    pub unplugged: u64,
    /// Periods during which the stream was being restarted after an error of the driver.
    pub restarted: u64,
}

impl Losses {
    /// All causes together.
    pub fn total(&self) -> u64 {
        self.sequence_gap + self.time_gap + self.frozen + self.unplugged + self.restarted
    }
}

/// Frames that came and are kept, but say nothing that can be trusted.
///
/// The first four are part of `received`. The others have no place in time of their own and are
/// neither received nor lost; void buffers hold nothing to keep, the other two are kept in the log, which
/// therefore holds `received + leftover + repeated` frames.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, schemars::JsonSchema, Deserialize,
)]
pub struct Excluded {
    /// Frames that the driver marked as damaged (V4L2_BUF_FLAG_ERROR).
    pub driver_error: u64,
    /// Fewer bytes than the format needs.
    pub truncated: u64,
    /// MJPG that is not whole: without its markers, or with coded data that do not decode to the last block.
    pub broken_jpeg: u64,
    /// First buffers after STREAMON.
    pub stale: u64,
    /// Buffers the driver gave back without a frame in them: ERROR, no bytes, no stamp.
    pub void: u64,
    /// A frame left over from before the stream was started (v4l2loopback's first).
    pub leftover: u64,
    /// A frame with the number and the period of the one before it: handed out twice.
    pub repeated: u64,
}

/// About one second of the account: from one frame (not counted) to the first frame at least 1 s later
/// (counted) that is on time; a silence or a stretch of late frames makes it longer.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, schemars::JsonSchema, Deserialize)]
pub struct SecondCounts {
    /// Stamp of the frame it starts after, from the first frame of the recording \[s\].
    pub from_s: f64,
    /// Its length \[s\].
    pub span_s: f64,
    /// Frames received in it.
    pub received: u64,
    /// Frames lost in it.
    pub lost: u64,
    /// Frames that time says there should have been.
    pub expected: u64,
}

/// The whole account. `received + lost.total() = expected` when `disagreement` is 0.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, schemars::JsonSchema, Deserialize)]
pub struct CaptureCounts {
    /// Frames received, marked ones included.
    pub received: u64,
    /// Marked ones by cause.
    pub excluded: Excluded,
    /// Frames that never came.
    pub lost: Losses,
    /// Frames that must have been due from the first stamp to the last (once finished: to the stop), by time alone
    /// (see `capture::gaps::expected`).
    pub expected: u64,
    /// `received + lost.total() - expected`: 0 when both ways of counting agree.
    pub disagreement: i64,
    /// Period as measured from the stamps \[s\]; 0 = not known yet.
    pub period_s: f64,
    /// Times the stream was restarted or the device re-opened.
    pub restarts: u64,
    /// Part of `lost` that no frame is marked with: what fell due between the last frame and the stop.
    pub lost_at_end: u64,
}

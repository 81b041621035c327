//! Frames of noise, made in memory: fixtures for the tests of what carries frames.

use bytes::Bytes;
use hydroline_core::frame::{Frame, FrameMeta, LossBefore, StampClock, StampSource};
use hydroline_rigs::PixelFormat;

/// Mid-exposure of frame 0, UNIX \[ns\].
pub const T0_NS: u64 = 1_760_000_000_000_000_000;

/// A noisy grey frame: bytes from a fixed xorshift, so that zstd has real work.
pub fn grey_frame(sequence: u32, width_px: u32, height_px: u32) -> Frame {
    let mut state = 0x9E37_79B9_7F4A_7C15u64 ^ (u64::from(sequence) << 20);
    let data: Vec<u8> = (0..width_px * height_px)
        .map(|_| {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            8 + (state >> 60) as u8
        })
        .collect();
    let mid_exposure_ns = T0_NS + u64::from(sequence) * 40_000_000;
    Frame {
        format: PixelFormat::Grey,
        width_px,
        height_px,
        stride_bytes: width_px,
        data: Bytes::from(data),
        meta: FrameMeta {
            sequence,
            driver_stamp_ns: mid_exposure_ns - T0_NS,
            stamp_clock: StampClock::Monotonic,
            stamp_source: StampSource::StartOfExposure,
            flags: 0x2001,
            received_monotonic_ns: mid_exposure_ns - T0_NS + 3_000_000,
            mid_exposure_ns,
            exposure_s: 0.004,
            fault: None,
            lost_before: LossBefore::default(),
        },
    }
}

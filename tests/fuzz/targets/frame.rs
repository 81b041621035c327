//! The bytes of an image under the geometry that a log states: a grey image or an error, never a panic.
#![no_main]

use hydroline::frame::{Channel, Frame, FrameMeta, GreyRule, LossBefore, PixelFormat, StampClock, StampSource};
use libfuzzer_sys::fuzz_target;

#[path = "support/memory.rs"]
mod memory;
use memory::bounded;

fuzz_target!(|input: (u8, u32, u32, u32, &[u8])| {
    let (format, width_px, height_px, stride_bytes, bytes) = input;
    let rule = GreyRule {
        channel: Channel::ALL[usize::from(format / 32 % 4)].1,
        ..GreyRule::default()
    };
    let format = PixelFormat::of_cameras()
        .nth(usize::from(format % 32))
        .unwrap_or(PixelFormat::Png);
    let frame = Frame {
        meta: FrameMeta {
            sequence: 0,
            driver_stamp_ns: 0,
            stamp_clock: StampClock::Monotonic,
            stamp_source: StampSource::EndOfFrame,
            flags: 0,
            received_monotonic_ns: 0,
            mid_exposure_ns: 0,
            exposure_s: 0.0,
            fault: None,
            lost_before: LossBefore::default(),
        },
        format,
        width_px,
        height_px,
        stride_bytes,
        data: bytes.to_vec().into(),
    };
    // A compressed image may unpack to `COMPRESSED_MAX_PX`, in colours and once more in grey.
    bounded(bytes.len(), 1 << 29, 4, || {
        if let Ok(grey) = frame.to_grey(&rule) {
            assert_eq!(grey.pixels.len(), grey.width_px * grey.height_px);
        }
    });
});

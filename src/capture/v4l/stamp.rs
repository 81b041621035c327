//! When a frame was true.
//!
//! Assumptions, all of them constant offsets that a rig's own latency measurement can remove:
//! * start of exposure (SOE): mid-exposure = stamp + exposure / 2. uvcvideo flags SOE but, with its default
//!   `hwtimestamps=0`, stamps the first USB packet of the frame, which leaves the camera after the exposure of its first
//!   rows: the true time is earlier by that delay.
//! * end of frame (EOF): the frame is read out row by row over one period, so the middle row was read half a period
//!   before the stamp: mid-exposure = stamp - period / 2 - exposure / 2. A readout shorter than the period makes the
//!   true time later by up to half a period.

use hydroline_core::clock::ClockTriple;
use hydroline_core::frame::{StampClock, StampSource};

/// V4L2_BUF_FLAG_* bits (videodev2.h).
pub mod flags {
    /// The frame is damaged.
    pub const ERROR: u32 = 0x40;
    /// Clock of the stamp.
    pub const CLOCK_MASK: u32 = 0xe000;
    /// Stamp on CLOCK_MONOTONIC.
    pub const MONOTONIC: u32 = 0x2000;
    /// Copied from an output buffer.
    pub const COPY: u32 = 0x4000;
    /// Event of the stamp.
    pub const SOURCE_MASK: u32 = 0x7_0000;
    /// Start of exposure.
    pub const SOE: u32 = 0x1_0000;
}

/// A stamp that does not say its clock is believed to be CLOCK_MONOTONIC within this distance of now \[ns\].
const UNKNOWN_PLAUSIBLE_NS: i64 = 1_000_000_000;
/// A declared monotonic stamp may be as old as a stopped process \[ns\].
const OLDEST_NS: i64 = 60_000_000_000;
/// Beyond this a stamp counts as lying in the future: clock reads are not that far apart \[ns\].
const FUTURE_NS: i64 = 2_000_000;

/// Oddity of a stamp.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Trouble {
    /// Its clock is not declared; taken for CLOCK_MONOTONIC because it is near.
    Undeclared,
    /// It lies after its own arrival; used as it is.
    Future,
    /// Not near now on CLOCK_MONOTONIC: the time of arrival is used.
    Implausible,
}

/// A stamp, understood.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Placed {
    /// Declared clock.
    pub clock: StampClock,
    /// Declared event.
    pub source: StampSource,
    /// The stamp on CLOCK_MONOTONIC, or the time of arrival \[ns\]: what frames are counted by.
    pub monotonic_ns: u64,
    /// Mid-exposure, UNIX \[ns\].
    pub mid_exposure_ns: u64,
    /// Oddity of the stamp; `None` = it is sound.
    pub trouble: Option<Trouble>,
    /// Arrival minus stamp \[s\].
    pub age_s: f64,
}

/// Understands a stamp. `exposure_s` and `period_s` are 0 where not known.
pub fn place(
    stamp_ns: u64,
    flag_bits: u32,
    received_ns: u64,
    exposure_s: f64,
    period_s: f64,
    triple: &ClockTriple,
) -> Placed {
    let clock = match flag_bits & flags::CLOCK_MASK {
        flags::MONOTONIC => StampClock::Monotonic,
        flags::COPY => StampClock::Copy,
        _ => StampClock::Unknown,
    };
    let source = if flag_bits & flags::SOURCE_MASK == flags::SOE {
        StampSource::StartOfExposure
    } else {
        StampSource::EndOfFrame
    };
    let age_ns = (i128::from(received_ns) - i128::from(stamp_ns))
        .clamp(i64::MIN.into(), i64::MAX.into()) as i64;
    let oldest = if clock == StampClock::Monotonic {
        OLDEST_NS
    } else {
        UNKNOWN_PLAUSIBLE_NS
    };
    let trouble = if age_ns > oldest || age_ns < -UNKNOWN_PLAUSIBLE_NS {
        Some(Trouble::Implausible)
    } else if age_ns < -FUTURE_NS {
        Some(Trouble::Future)
    } else if clock != StampClock::Monotonic {
        Some(Trouble::Undeclared)
    } else {
        None
    };
    let monotonic_ns = if trouble == Some(Trouble::Implausible) {
        received_ns
    } else {
        stamp_ns
    };
    let to_middle_s = match source {
        StampSource::StartOfExposure => exposure_s / 2.0,
        _ => -(exposure_s + period_s) / 2.0,
    };
    let mid_exposure_ns = triple
        .monotonic_to_unix_ns(monotonic_ns)
        .saturating_add_signed((to_middle_s * 1e9).round() as i64);
    Placed {
        clock,
        source,
        monotonic_ns,
        mid_exposure_ns,
        trouble,
        age_s: age_ns as f64 / 1e9,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const NOW: u64 = 500_000_000_000;
    const TRIPLE: ClockTriple = ClockTriple {
        monotonic_ns: NOW,
        realtime_ns: NOW + 1_000_000_000_000,
        boottime_ns: NOW,
        bracket_ns: 0,
    };

    #[test]
    fn start_of_exposure_adds_half_the_exposure() {
        let p = place(
            NOW - 3_000_000,
            flags::MONOTONIC | flags::SOE,
            NOW,
            0.010,
            0.04,
            &TRIPLE,
        );
        assert_eq!(
            p.mid_exposure_ns,
            TRIPLE.realtime_ns - 3_000_000 + 5_000_000
        );
        assert_eq!(
            (p.clock, p.source, p.trouble),
            (StampClock::Monotonic, StampSource::StartOfExposure, None)
        );
    }

    #[test]
    fn end_of_frame_goes_back_half_a_period_and_half_the_exposure() {
        let p = place(NOW, flags::MONOTONIC, NOW, 0.010, 0.04, &TRIPLE);
        assert_eq!(p.mid_exposure_ns, TRIPLE.realtime_ns - 25_000_000);
    }

    #[test]
    fn vivids_future_is_flagged_and_kept() {
        let p = place(NOW + 34_000_000, flags::MONOTONIC, NOW, 0.0, 0.0, &TRIPLE);
        assert_eq!(
            (p.trouble, p.monotonic_ns),
            (Some(Trouble::Future), NOW + 34_000_000)
        );
    }

    #[test]
    fn an_undeclared_clock_is_believed_only_nearby() {
        assert_eq!(
            place(NOW - 900_000_000, 0, NOW, 0.0, 0.0, &TRIPLE).trouble,
            Some(Trouble::Undeclared)
        );
        for far in [0, NOW - 1_100_000_000, NOW + 1_100_000_000, u64::MAX] {
            let p = place(far, 0, NOW, 0.0, 0.0, &TRIPLE);
            assert_eq!(
                (p.trouble, p.monotonic_ns),
                (Some(Trouble::Implausible), NOW)
            );
        }
    }

    #[test]
    fn a_declared_stamp_may_be_old_but_not_absurd() {
        assert_eq!(
            place(
                NOW - 5_000_000_000,
                flags::MONOTONIC,
                NOW,
                0.0,
                0.0,
                &TRIPLE
            )
            .trouble,
            None
        );
        assert_eq!(
            place(
                9_223_372_020_000_000_000,
                flags::MONOTONIC,
                NOW,
                0.0,
                0.0,
                &TRIPLE
            )
            .trouble,
            Some(Trouble::Implausible)
        );
    }
}

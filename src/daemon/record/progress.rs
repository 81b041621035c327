//! How far a recording is: frames received, usable and analysed.
//!
//! Capture sees at once that a frame came and whether it is marked; whether it can be read is seen by the analysis, later and
//! not of every frame. A frame counts as good while the newest one that was looked at could be read.

use super::unusable::Unusable;
use hydroline_capture::CaptureCounts;
use hydroline_core::frame::FrameMeta;

/// Counters that the threads of a recording share.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Progress {
    pub counts: CaptureCounts,
    /// Arrival of the first frame that could be read, CLOCK_MONOTONIC \[ns\].
    pub first_good_ns: Option<u64>,
    /// Arrival of the last good frame, CLOCK_MONOTONIC \[ns\].
    pub last_good_ns: Option<u64>,
    /// Whether the newest frame that the analysis looked at could be read.
    readable: bool,
    pub analysed: u64,
    /// Frames that nothing marks and that the analysis could not read.
    pub damaged: u64,
    /// Points in the newest stripe.
    pub points: usize,
}

impl Progress {
    /// Takes in a frame as it came from the camera.
    pub fn received(&mut self, meta: &FrameMeta, counts: CaptureCounts) {
        self.counts = counts;
        if meta.fault.is_none() && self.readable {
            self.last_good_ns = self.last_good_ns.max(Some(meta.received_monotonic_ns));
        }
    }

    /// Takes in whether the analysis could make grey levels of a frame. Of a marked one this says nothing.
    pub fn looked_at(&mut self, meta: &FrameMeta, could_read: bool) {
        if meta.fault.is_some() {
            return;
        }
        self.readable = could_read;
        if could_read {
            let at_ns = meta.received_monotonic_ns;
            self.first_good_ns.get_or_insert(at_ns);
            self.last_good_ns = self.last_good_ns.max(Some(at_ns));
        }
    }

    /// Frames that cannot be used, by cause.
    pub fn unusable(&self) -> Unusable {
        Unusable {
            marked: self.counts.excluded,
            damaged: self.damaged,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hydroline_core::frame::FrameFault;

    fn meta(received_monotonic_ns: u64, fault: Option<FrameFault>) -> FrameMeta {
        FrameMeta {
            received_monotonic_ns,
            fault,
            ..FrameMeta::at(0, 0)
        }
    }

    #[test]
    fn a_frame_that_cannot_be_read_is_not_good_although_nothing_marks_it() {
        let mut p = Progress::default();
        let counts = CaptureCounts::default();
        for ns in 1..10 {
            p.received(&meta(ns, None), counts);
            p.looked_at(&meta(ns, None), false);
        }
        assert_eq!((p.first_good_ns, p.last_good_ns), (None, None));
        p.received(&meta(10, None), counts);
        p.looked_at(&meta(10, None), true);
        assert_eq!((p.first_good_ns, p.last_good_ns), (Some(10), Some(10)));
        // The analysis is slow: frames count on as it last saw them.
        p.received(&meta(11, None), counts);
        p.received(&meta(12, Some(FrameFault::BrokenJpeg)), counts);
        assert_eq!(p.last_good_ns, Some(11));
        p.looked_at(&meta(12, Some(FrameFault::BrokenJpeg)), false);
        p.received(&meta(13, None), counts);
        assert_eq!(p.last_good_ns, Some(13));
        p.looked_at(&meta(13, None), false);
        p.received(&meta(14, None), counts);
        assert_eq!((p.first_good_ns, p.last_good_ns), (Some(10), Some(13)));
    }
}

//! Log times that never go back, and steps of the realtime clock.

use hydroline_core::clock::ClockTriple;

/// A step of CLOCK_REALTIME against CLOCK_MONOTONIC beyond this is an event.
const STEP_NS: i128 = 10_000_000;

/// Log times: the host's realtime, held where it would go back.
#[derive(Debug, Clone, Default)]
pub struct LogTime {
    last_ns: u64,
    offset_ns: Option<i128>,
}

impl LogTime {
    /// The log time for a reading of the clocks, and the step since the last reading
    /// \[ns\] if the realtime clock was set by more than 10 ms. Slewing stays below that.
    pub fn stamp(&mut self, clocks: &ClockTriple) -> (u64, Option<i128>) {
        let offset = i128::from(clocks.realtime_ns) - i128::from(clocks.monotonic_ns);
        let step = self.offset_ns.replace(offset).map(|before| offset - before);
        self.last_ns = self.last_ns.max(clocks.realtime_ns);
        (self.last_ns, step.filter(|s| s.abs() > STEP_NS))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn log_time_never_goes_back(readings in proptest::collection::vec((0u64..1u64<<40, 0u64..1u64<<40), 1..100)) {
            let mut time = LogTime::default();
            let mut last = 0;
            let mut offset: Option<i128> = None;
            for (monotonic_ns, realtime_ns) in readings {
                let triple = ClockTriple { monotonic_ns, realtime_ns, ..ClockTriple::default() };
                let (log, step) = time.stamp(&triple);
                prop_assert!(log >= last && log >= realtime_ns);
                prop_assert!(log == last || log == realtime_ns);
                let now = i128::from(realtime_ns) - i128::from(monotonic_ns);
                let truth = offset.map(|o| now - o).filter(|s| s.abs() > STEP_NS);
                prop_assert_eq!(step, truth);
                offset = Some(now);
                last = log;
            }
        }
    }
}

//! Clocks, injected everywhere so that tests and simulation own the time.
//!
//! All absolute times in hydroline are UNIX nanoseconds (`u64`, names end in `_ns`)
//! on the host's realtime clock; drivers stamp on CLOCK_MONOTONIC, so every stamp
//! is converted in one place: [`ClockTriple::monotonic_to_unix_ns`].

use std::sync::Mutex;
use std::time::Duration;

/// First stamp of a simulated log, UNIX \[s\]: 2020-09-13 12:26:40 UTC, recognisable and before any real log.
pub const SIMULATION_START_UNIX_S: u64 = 1_600_000_000;

/// Earliest start of a log that is believed, UNIX \[s\]: 2001-01-01. Computers whose clock was never set begin in 1970, 1980 or
/// 2000.
const EARLIEST_UNIX_S: u64 = 978_307_200;
/// A log may have been made this much later than now \[s\]: a day, as clocks of other zones are kept as UTC.
const AHEAD_MAX_S: u64 = 86_400;

/// Fault of the clock that a log was stamped by.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ClockError {
    /// Before any such log was made: the clock was never set.
    NeverSet,
    /// Later than now.
    Future,
}

impl std::fmt::Display for ClockError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            ClockError::NeverSet => "before 2001, as of a clock that was never set",
            ClockError::Future => "later than now",
        })
    }
}

/// Whether a log's start can be no date, seen from `now_ns` (UNIX); what a clock that is wrong itself says of the future is
/// not believed.
pub fn clock_error(start_ns: u64, now_ns: u64) -> Option<ClockError> {
    let [start_s, now_s] = [start_ns, now_ns].map(|ns| ns / 1_000_000_000);
    if start_s < EARLIEST_UNIX_S {
        Some(ClockError::NeverSet)
    } else if now_s >= EARLIEST_UNIX_S && start_s > now_s.saturating_add(AHEAD_MAX_S) {
        Some(ClockError::Future)
    } else {
        None
    }
}

/// The host's three clocks, read together.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ClockTriple {
    /// CLOCK_MONOTONIC \[ns\].
    pub monotonic_ns: u64,
    /// CLOCK_REALTIME, UNIX \[ns\].
    pub realtime_ns: u64,
    /// CLOCK_BOOTTIME \[ns\].
    pub boottime_ns: u64,
    /// Width of the bracket: monotonic read after minus monotonic read before the other two \[ns\].
    pub bracket_ns: u64,
}

impl ClockTriple {
    /// A CLOCK_MONOTONIC stamp on the UNIX time scale, by this triple's offset.
    pub fn monotonic_to_unix_ns(&self, stamp_ns: u64) -> u64 {
        let offset = i128::from(self.realtime_ns) - i128::from(self.monotonic_ns);
        (i128::from(stamp_ns) + offset).clamp(0, i128::from(u64::MAX)) as u64
    }
}

/// A source of time.
pub trait Clock: Send + Sync {
    /// All three clocks, tightly bracketed.
    fn triple(&self) -> ClockTriple;
    /// CLOCK_MONOTONIC \[ns\].
    fn monotonic_ns(&self) -> u64 {
        self.triple().monotonic_ns
    }
    /// Blocks for `duration` of this clock's time.
    fn sleep(&self, duration: Duration);
}

/// The machine's clocks.
#[derive(Debug, Clone, Copy, Default)]
pub struct SystemClock;

fn read(id: libc::clockid_t) -> u64 {
    let mut t = libc::timespec {
        tv_sec: 0,
        tv_nsec: 0,
    };
    // SAFETY: `t` is a valid timespec; these clock ids exist on every Linux the daemon runs on.
    unsafe { libc::clock_gettime(id, &mut t) };
    t.tv_sec as u64 * 1_000_000_000 + t.tv_nsec as u64
}

impl Clock for SystemClock {
    fn triple(&self) -> ClockTriple {
        // Best of five: a pre-emption between the reads would otherwise look like a clock step.
        let mut best = ClockTriple {
            bracket_ns: u64::MAX,
            ..ClockTriple::default()
        };
        for _ in 0..5 {
            let before = read(libc::CLOCK_MONOTONIC);
            let realtime_ns = read(libc::CLOCK_REALTIME);
            let boottime_ns = read(libc::CLOCK_BOOTTIME);
            let after = read(libc::CLOCK_MONOTONIC);
            let bracket_ns = after - before;
            if bracket_ns < best.bracket_ns {
                best = ClockTriple {
                    monotonic_ns: before + bracket_ns / 2,
                    realtime_ns,
                    boottime_ns,
                    bracket_ns,
                };
            }
        }
        best
    }

    fn monotonic_ns(&self) -> u64 {
        read(libc::CLOCK_MONOTONIC)
    }

    fn sleep(&self, duration: Duration) {
        std::thread::sleep(duration);
    }
}

/// A clock that moves only when set: tests and offline simulation.
#[derive(Debug)]
pub struct ManualClock {
    now: Mutex<ClockTriple>,
}

impl ManualClock {
    /// Starts at the given monotonic and realtime readings.
    pub fn new(monotonic_ns: u64, realtime_ns: u64) -> Self {
        Self {
            now: Mutex::new(ClockTriple {
                monotonic_ns,
                realtime_ns,
                boottime_ns: monotonic_ns,
                bracket_ns: 0,
            }),
        }
    }

    /// Moves all clocks forward.
    pub fn advance(&self, duration: Duration) {
        let ns = duration.as_nanos() as u64;
        let mut now = self.lock();
        now.monotonic_ns += ns;
        now.realtime_ns += ns;
        now.boottime_ns += ns;
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, ClockTriple> {
        self.now
            .lock()
            .unwrap_or_else(std::sync::PoisonError::into_inner)
    }
}

impl Clock for ManualClock {
    fn triple(&self) -> ClockTriple {
        *self.lock()
    }

    fn sleep(&self, duration: Duration) {
        self.advance(duration);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn starts_in_1970_and_2099_are_errors_and_a_host_that_is_in_1970_itself_finds_none_in_the_future()
     {
        let ns = |s: u64| s * 1_000_000_000;
        let now = ns(1_790_000_000);
        for early in [0, 45, 315_964_800, 946_684_800] {
            assert_eq!(
                clock_error(ns(early), now),
                Some(ClockError::NeverSet),
                "{early}"
            );
        }
        for late in [
            1_790_100_000,
            2_147_483_647,
            4_085_942_400,
            u64::MAX / 1_000_000_000,
        ] {
            assert_eq!(
                clock_error(ns(late), now),
                Some(ClockError::Future),
                "{late}"
            );
            assert_eq!(clock_error(ns(late), ns(60)), None, "{late}");
        }
        assert_eq!(clock_error(u64::MAX, now), Some(ClockError::Future));
        for right in [SIMULATION_START_UNIX_S, 1_789_999_999, 1_790_050_000] {
            assert_eq!(clock_error(ns(right), now), None, "{right}");
        }
    }
}

//! Which stamps go on from those before: one that is wrong, a clock that was set, an autopilot that restarted.

/// A stamp that steps so much further than the log's own time, or back, orders nothing \[ns\]: it is wrong, or a clock was
/// set.
pub(crate) const STEP_NS: i128 = 60_000_000_000;
/// A stamp that goes back by more is no message that was long under way \[ns\].
pub(crate) const BACK_NS: i128 = 1_000_000_000;

/// Whether a stamp follows another as rows do: no gap to speak of, and no step back \[ns\].
pub(crate) fn follows(own_ns: i128, before_ns: i128) -> bool {
    (-BACK_NS..=STEP_NS).contains(&(own_ns - before_ns))
}

/// A message's times \[ns\].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Times {
    /// By its own stamp, or whatever the map takes for it.
    pub own_ns: i128,
    /// When it was recorded.
    pub log_ns: i128,
}

impl Times {
    /// Whether the stamp goes on from the one before as the log's own time does, or by itself while that is set.
    pub fn goes_on_from(self, before: Times) -> bool {
        let own_ns = self.own_ns - before.own_ns;
        let log_ns = self.log_ns - before.log_ns;
        (own_ns - log_ns).abs() <= STEP_NS || (0..=STEP_NS).contains(&own_ns)
    }
}

/// Cause of a stamp that does not follow, by the next one of its topic.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Cause {
    /// The clock was started anew.
    Restart,
    /// It alone is wrong: the next one follows those before it.
    Wrong,
    /// A gap, a clock that was set, or nothing that is known.
    Other,
}

impl Cause {
    /// Of a suspect between the stamp before and the next one \[ns\].
    pub fn of(suspect_ns: i128, before_ns: i128, next_ns: i128) -> Cause {
        let nearer = (next_ns - before_ns).abs() <= (next_ns - suspect_ns).abs();
        if follows(next_ns, before_ns) && nearer {
            Cause::Wrong
        } else if next_ns > suspect_ns
            && follows(next_ns, suspect_ns)
            && before_ns - suspect_ns > BACK_NS
        {
            Cause::Restart
        } else {
            Cause::Other
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_restart_is_distinguished_from_a_wrong_stamp_and_from_a_clock_that_was_set() {
        let ns = |s: f64| (s * 1e9) as i128;
        let before_s = 395.0;
        for (suspect_s, next_s, cause) in [
            (30.0, 30.04, Cause::Restart),
            (390.0, 390.04, Cause::Restart),
            (0.012, 395.04, Cause::Wrong),
            (1e9, 395.04, Cause::Wrong),
            (5000.0, 5000.04, Cause::Other),
            (30.0, 30.0, Cause::Other),
            (30.0, 7.0, Cause::Other),
        ] {
            assert!(!follows(ns(suspect_s), ns(before_s)));
            let found = Cause::of(ns(suspect_s), ns(before_s), ns(next_s));
            assert_eq!(found, cause, "{suspect_s} {next_s}");
        }
        assert!(follows(ns(394.9), ns(before_s)), "long under way");
        // NTP set the ground station's clock, 53 years on.
        let at = |own_s, log_s| Times {
            own_ns: ns(own_s),
            log_ns: ns(log_s),
        };
        assert!(at(395.04, 1.7e9).goes_on_from(at(395.0, 45.0)));
    }
}

//! The wall clock is set while recording (the first NTP contact of a vehicle's computer): supervision goes on by
//! CLOCK_MONOTONIC.

use super::record_command::recorded;
use hydroline::clock::{Clock, ClockTriple, SystemClock};
use hydroline::log::Record;
use hydroline::shutdown::StopReason;
use hydroline_rigs::{Plan, Rig};
use std::sync::Arc;

const HOUR_NS: i64 = 3_600_000_000_000;

/// The machine's clocks, but the wall clock is set once.
struct Set {
    /// When, CLOCK_MONOTONIC \[ns\].
    at_ns: u64,
    by_ns: i64,
}

impl Set {
    fn in_seconds(s: f64, by_ns: i64) -> Arc<Self> {
        let at_ns = SystemClock.monotonic_ns() + (s * 1e9) as u64;
        Arc::new(Self { at_ns, by_ns })
    }
}

impl Clock for Set {
    fn triple(&self) -> ClockTriple {
        let mut now = SystemClock.triple();
        if now.monotonic_ns >= self.at_ns {
            now.realtime_ns = now.realtime_ns.saturating_add_signed(self.by_ns);
        }
        now
    }

    fn sleep(&self, duration: std::time::Duration) {
        SystemClock.sleep(duration);
    }
}

/// Ahead with 8 N for three seconds.
fn ahead() -> Plan {
    let text = "name = \"ahead\"\n[[step]]\nfor_s = 3.0\nwrench = { surge_n = 8.0 }\n";
    Plan::from_toml(text, "ahead.toml").unwrap()
}

fn stepped(records: &[Record]) -> bool {
    records
        .iter()
        .any(|r| matches!(r, Record::Event(e) if e.kind == "clock.step"))
}

#[test]
fn supervision_on_the_wall_clock_a_step_ahead_aborts_no_plan() {
    let _alone = crate::support::alone();
    let dir = tempfile::tempdir().unwrap();
    let clock = Set::in_seconds(2.5, 3 * HOUR_NS);
    let (stop, records) = recorded(dir.path(), (Some(ahead()), 5.0), |_| {}, clock);
    assert!(stepped(&records), "the clock was set while recording");
    assert_eq!(stop, StopReason::Finished);
}

#[test]
fn supervision_on_the_wall_clock_a_step_back_leaves_the_limits_watched() {
    let _alone = crate::support::alone();
    let dir = tempfile::tempdir().unwrap();
    let start_x_m = Rig::builtin("lshpi").unwrap().tank.start_pose[0];
    let clock = Set::in_seconds(1.5, -3 * HOUR_NS);
    let near = |limits: &mut hydroline_rigs::Limits| limits.x_m = [-1.0, start_x_m + 0.03];
    let (stop, records) = recorded(dir.path(), (Some(ahead()), 20.0), near, clock);
    assert!(stepped(&records), "the clock was set while recording");
    assert!(
        matches!(&stop, StopReason::Limit(words) if words.contains("x = ")),
        "{stop:?}"
    );
}

//! A run of two logs: how well the clock of its commands is known.

use std::collections::BTreeMap;

/// Clocks of a joined log (`hydroline join`), as its metadata states them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Joined {
    /// The offset was estimated from the motion's answer to the commands: a latency is part of it.
    pub is_estimated: bool,
    /// Standard deviation of the commands' clock against the motion's \[s\].
    pub offset_sd_s: f64,
    /// Of its drift.
    pub drift_sd_ppm: f64,
}

impl Joined {
    /// From the session's metadata; `None` = the log is of one clock.
    pub fn of(session: &BTreeMap<String, String>) -> Option<Joined> {
        let from = session.get("join.offset_from")?;
        // A value that cannot be read is not known at all.
        let sd = |key: &str| {
            let own = session.get(key).and_then(|v| v.parse::<f64>().ok());
            own.filter(|v| *v >= 0.0).unwrap_or(f64::INFINITY)
        };
        Some(Joined {
            is_estimated: from == "estimated",
            offset_sd_s: sd("join.offset_sd_s"),
            drift_sd_ppm: sd("join.drift_sd_ppm"),
        })
    }
}

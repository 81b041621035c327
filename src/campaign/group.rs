//! Groups of logs that belong together: one rig, one calibration, one water; and their days.

use crate::store::Key;
use crate::survey::{Found, Identity, RigToml};
use chrono::{DateTime, Utc};
use hydroline_core::clock::{Clock, SystemClock, clock_error};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Logs that one fit may hold.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Group {
    /// Short name, stable as long as rig, calibration and water are: `small-rov-3f21`.
    pub id: String,
    /// The rig's name.
    pub vehicle: String,
    /// The rig.
    pub rig_toml: RigToml,
    /// Water, as the sessions say.
    pub water: String,
    /// Days, in order.
    pub days: Vec<Day>,
    /// Logs whose clock is wrong, by place in the list of logs: they are of no day.
    pub undated: Vec<usize>,
}

/// A group's logs of one day (UTC).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Day {
    /// `2026-11-27`.
    pub date: String,
    /// Places in the list of logs, by time.
    pub logs: Vec<usize>,
}

/// Date of a UNIX time \[ns\], UTC.
pub fn date(unix_ns: u64) -> String {
    let at = DateTime::<Utc>::from_timestamp_nanos(i64::try_from(unix_ns).unwrap_or(i64::MAX));
    at.format("%Y-%m-%d").to_string()
}

/// Groups of the logs that can be used, the first seen first, by the host's clock.
pub fn groups(logs: &[Found]) -> Vec<Group> {
    groups_at(logs, SystemClock.triple().realtime_ns)
}

/// The same at a time: logs from before any clock that was set, or from after `now_ns`, have no day.
pub fn groups_at(logs: &[Found], now_ns: u64) -> Vec<Group> {
    let mut found: BTreeMap<String, Vec<(usize, &Identity)>> = BTreeMap::new();
    for (k, log) in logs.iter().enumerate() {
        let Ok(is) = &log.is else { continue };
        let key = Key::of("group")
            .with(&is.rig_toml)
            .with(&is.calibration)
            .with(&is.water)
            .name();
        found.entry(key).or_default().push((k, is));
    }
    let mut groups: Vec<(u64, Group)> = found
        .into_iter()
        .map(|(key, mut members)| {
            members.sort_by_key(|(k, is)| (is.start_ns, *k));
            let (mut days, mut undated): (Vec<Day>, Vec<usize>) = (Vec::new(), Vec::new());
            for (k, is) in &members {
                if clock_error(is.start_ns, now_ns).is_some() {
                    undated.push(*k);
                    continue;
                }
                let date = date(is.start_ns);
                match days.last_mut().filter(|d| d.date == date) {
                    Some(day) => day.logs.push(*k),
                    None => days.push(Day {
                        date,
                        logs: vec![*k],
                    }),
                }
            }
            let (_, first) = members[0];
            let group = Group {
                id: format!("{}-{}", first.vehicle, &key[..4]),
                vehicle: first.vehicle.clone(),
                rig_toml: first.rig_toml.clone(),
                water: first.water.clone(),
                days,
                undated,
            };
            (first.start_ns, group)
        })
        .collect();
    groups.sort_by(|a, b| (a.0, &a.1.id).cmp(&(b.0, &b.1.id)));
    groups.into_iter().map(|(_, g)| g).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::PathBuf;

    fn log(rig: &str, water: &str, start_s: u64) -> Found {
        Found {
            name: String::new(),
            path: PathBuf::new(),
            hash: String::new(),
            is: Ok(Identity {
                vehicle: rig.to_owned(),
                rig_toml: rig.to_owned().into(),
                calibration: String::new(),
                water: water.to_owned(),
                start_ns: start_s * 1_000_000_000,
                plan: String::new(),
                note: String::new(),
            }),
        }
    }

    /// Days from here on \[s\]: 2026-01-01.
    const NEW_YEAR_S: u64 = 1_767_225_600;
    const NOW_NS: u64 = (NEW_YEAR_S + 10 * 86_400) * 1_000_000_000;

    /// They came before and behind all days, and what changed since was said of them.
    #[test]
    fn logs_of_a_clock_that_was_never_set_or_is_ahead_have_no_day() {
        let logs = [
            log("a", "fresh", 45),
            log("a", "fresh", NEW_YEAR_S),
            log("a", "fresh", 4_085_942_400),
            log("b", "fresh", 7),
        ];
        let found = groups_at(&logs, NOW_NS);
        let of = |vehicle: &str| found.iter().find(|g| g.vehicle == vehicle).unwrap();
        assert_eq!(of("a").undated, [0, 2]);
        assert_eq!(of("a").days.len(), 1);
        assert_eq!(of("a").days[0].logs, [1]);
        assert_eq!(
            (of("b").undated.as_slice(), of("b").days.len()),
            (&[3][..], 0)
        );
    }

    #[test]
    fn vehicles_and_waters_are_apart_and_days_are_in_order() {
        let day_s = 86_400;
        let bad = Found {
            is: Err("cut".to_owned()),
            ..log("a", "", 0)
        };
        let logs = [
            log("a", "fresh", NEW_YEAR_S + day_s + 5),
            log("b", "fresh", NEW_YEAR_S + 10),
            log("a", "fresh", NEW_YEAR_S + 7),
            log("a", "salt", NEW_YEAR_S + 8),
            bad,
            log("a", "fresh", NEW_YEAR_S + day_s + 1),
        ];
        let found = groups_at(&logs, NOW_NS);
        let shape: Vec<(&str, &str, Vec<&[usize]>)> = found
            .iter()
            .map(|g| {
                let days = g.days.iter().map(|d| d.logs.as_slice()).collect();
                (g.vehicle.as_str(), g.water.as_str(), days)
            })
            .collect();
        assert_eq!(
            shape,
            [
                ("a", "fresh", vec![&[2][..], &[5, 0]]),
                ("a", "salt", vec![&[3]]),
                ("b", "fresh", vec![&[1]]),
            ]
        );
        assert_eq!(found[0].days[1].date, "2026-01-02");
    }
}

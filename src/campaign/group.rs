//! Groups of logs that belong together: one rig, one calibration, one water; and their days.

use crate::store::Key;
use crate::survey::{Found, Identity, RigToml};
use chrono::{DateTime, Utc};
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

/// Groups of the logs that can be used, the first seen first.
pub fn groups(logs: &[Found]) -> Vec<Group> {
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
            let mut days: Vec<Day> = Vec::new();
            for (k, is) in &members {
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

    #[test]
    fn vehicles_and_waters_are_apart_and_days_are_in_order() {
        let day_s = 86_400;
        let bad = Found {
            is: Err("cut".to_owned()),
            ..log("a", "", 0)
        };
        let logs = [
            log("a", "fresh", day_s + 5),
            log("b", "fresh", 10),
            log("a", "fresh", 7),
            log("a", "salt", 8),
            bad,
            log("a", "fresh", day_s + 1),
        ];
        let found = groups(&logs);
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
        assert_eq!(found[0].days[1].date, "1970-01-02");
    }
}

//! Units of work: what there is to do, what each depends on, and the key of its sheet.

use crate::group::Group;
use crate::store::Key;
use crate::survey::{Found, Identity};
use std::collections::{BTreeMap, BTreeSet};

/// Versions of what a unit finds: a new number where the same build would find something else than before.
const RUN: &str = "run/3";
const SET: &str = "set/4";
const CHANGES: &str = "changes/6";

/// Kind of work, and the log or the group that it is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Task {
    /// One log: is it sound, its motion, coefficients and diagnosis by itself.
    Run {
        /// Place among the logs.
        log: usize,
    },
    /// A group's logs of one day together.
    Day {
        /// Place among the groups.
        group: usize,
        /// Place among its days.
        day: usize,
    },
    /// All logs of a group since the last change, together.
    Group {
        /// Place among the groups.
        group: usize,
    },
    /// Changes between a group's days.
    Changes {
        /// Place among the groups.
        group: usize,
    },
}

/// A unit of work.
#[derive(Debug, Clone, PartialEq)]
pub struct Unit {
    /// Name, the same on every machine: `run-1f00c0ffee15600d`.
    pub name: String,
    /// Key of its sheet.
    pub key: String,
    /// Work to do, and for which log or group.
    pub task: Task,
    /// Units whose sheets it needs, by place in the list.
    pub needs: Vec<usize>,
}

/// All units, each behind those that it needs. `build` = the program's version and commit.
pub fn units(logs: &[Found], groups: &[Group], build: &str) -> Vec<Unit> {
    let mut units: Vec<Unit> = Vec::new();
    let mut by_key: BTreeMap<String, usize> = BTreeMap::new();
    let mut of_log: Vec<Option<usize>> = vec![None; logs.len()];
    for (k, log) in logs.iter().enumerate() {
        let Ok(is) = &log.is else { continue };
        let key = run_key(log, is, build);
        // A copy of a log is the same unit.
        let place = *by_key.entry(key.clone()).or_insert_with(|| {
            units.push(Unit {
                name: format!("run-{key}"),
                key,
                task: Task::Run { log: k },
                needs: Vec::new(),
            });
            units.len() - 1
        });
        of_log[k] = Some(place);
    }
    for (g, group) in groups.iter().enumerate() {
        let mut all: Vec<usize> = Vec::new();
        let mut days: Vec<usize> = Vec::new();
        for (d, day) in group.days.iter().enumerate() {
            let needs = needed(&day.logs, &of_log);
            all.extend(&needs);
            if group.days.len() > 1 {
                let key = joint_key(SET, &units, &needs, build);
                units.push(Unit {
                    name: format!("day-{}-{}", group.id, day.date),
                    key,
                    task: Task::Day { group: g, day: d },
                    needs,
                });
                days.push(units.len() - 1);
            }
        }
        let undated = needed(&group.undated, &of_log);
        all.extend(&undated);
        if group.days.len() > 1 {
            let mut key = Key::of(CHANGES).with(build);
            for day in &group.days {
                key = key.with(&day.date);
                for unit in needed(&day.logs, &of_log) {
                    key = key.with(&units[unit].key);
                }
            }
            units.push(Unit {
                name: format!("changes-{}", group.id),
                key: key.name(),
                task: Task::Changes { group: g },
                needs: all.clone(),
            });
            days.push(units.len() - 1);
        }
        let mut key = Key::of(SET).with(build).with(CHANGES);
        for day in &group.days {
            key = key.with(&joint_key(SET, &units, &needed(&day.logs, &of_log), build));
        }
        if !undated.is_empty() {
            key = key.with(&joint_key(SET, &units, &undated, build));
        }
        units.push(Unit {
            name: format!("group-{}", group.id),
            key: key.name(),
            task: Task::Group { group: g },
            needs: all.into_iter().chain(days).collect(),
        });
    }
    units
}

/// Units of logs, each once: a copy of a log counts once.
fn needed(logs: &[usize], of_log: &[Option<usize>]) -> Vec<usize> {
    let mut seen = BTreeSet::new();
    let all = logs.iter().filter_map(|k| of_log[*k]);
    all.filter(|unit| seen.insert(*unit)).collect()
}

fn run_key(log: &Found, is: &Identity, build: &str) -> String {
    Key::of(RUN)
        .with(build)
        .with(&log.hash)
        .with(&is.rig_toml)
        .name()
}

fn joint_key(kind: &str, units: &[Unit], needs: &[usize], build: &str) -> String {
    // In any order the same logs are the same work.
    let mut keys: Vec<&str> = needs.iter().map(|k| units[*k].key.as_str()).collect();
    keys.sort_unstable();
    keys.into_iter()
        .fold(Key::of(kind).with(build), Key::with)
        .name()
}

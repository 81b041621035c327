//! One unit of work done: from its logs and the sheets that it needs to its own sheet.

use crate::change::change;
use crate::evenly;
use crate::group::Group;
use crate::overlay::motion_key;
use crate::sheet::{
    ChangeSheet, Coefficients, Diagnosed, End, Finding, Motion, RunSheet, SetSheet,
};
use crate::store::{Store, StoreError};
use crate::survey::Found;
use crate::unit::{Task, Unit};
use hydroline_core::run::{Channel, Run};
use hydroline_diagnose::{Beside, Limit, Source, Watch, diagnose_beside, read};
use hydroline_estimate::{Options, identify};
use hydroline_identify::data::{LoadError, load, memory_s};
use hydroline_log::AtomicFile;
use hydroline_log::doctor::{Grade, doctor};
use hydroline_numerics::parallel;
use hydroline_numerics::statistics::extent;
use hydroline_numerics::statistics::median;
use hydroline_rigs::{Dof, Rig};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Runs of one fit at most: beyond, time grows with their number and intervals shrink with its root. Chosen evenly over time,
/// and reported.
const RUNS_MAX: usize = 12;
/// A run is called an outlier where the others predict it this many times worse than the median run.
const OUTLIER: f64 = 3.0;

/// Poses of a log's images into a new log.
pub type Replay<'a> = dyn Fn(&Path, &Path) -> Result<(), String> + Sync + 'a;

/// Data that all units of a campaign share.
pub struct Campaign<'a> {
    /// Files named like logs, usable or not.
    pub logs: &'a [Found],
    /// Groups of them.
    pub groups: &'a [Group],
    /// Units of work.
    pub units: &'a [Unit],
    /// Store of the units' sheets.
    pub store: &'a Store,
    /// From images to poses.
    pub replay: &'a Replay<'a>,
    /// Time limit of each diagnosis; `None` = there is none.
    pub time_limit: Option<Duration>,
}

impl std::fmt::Debug for Campaign<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Campaign of {} logs", self.logs.len())
    }
}

/// Why a unit was not done; what a log lacks is no error but stands in its sheet.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)] // Each message names its fields.
pub enum WorkError {
    #[error(transparent)]
    Store(#[from] StoreError),
    #[error("{unit} needs the sheet of {needs} first: run `campaign --only {needs}`")]
    Needs { unit: String, needs: String },
    #[error("{path}: is being written by another process: run `campaign` again when it has ended")]
    BeingWritten { path: PathBuf },
    /// The rig, which was read before.
    #[error("{0}")]
    Rig(String),
}

impl Campaign<'_> {
    /// Whether a unit's sheet is there, and no shorter time limit than this one ended its diagnosis.
    pub fn is_done(&self, unit: &Unit) -> bool {
        let end = self.store.get::<End>(&unit.key);
        end.is_some_and(|end| !end.falls_short_of(self.time_limit))
    }

    /// Of each unit whether its sheet is there.
    pub fn done(&self) -> Vec<bool> {
        parallel::map_slice(self.units, |u| self.is_done(u))
    }

    /// Does a unit and keeps its sheet.
    ///
    /// # Errors
    /// [`WorkError`].
    pub fn work(&self, unit: &Unit) -> Result<(), WorkError> {
        if let Some(missing) = unit.needs.iter().find(|k| !self.is_done(&self.units[**k])) {
            return Err(WorkError::Needs {
                unit: unit.name.clone(),
                needs: self.units[*missing].name.clone(),
            });
        }
        match unit.task {
            Task::Run { log } => self.store.put(&unit.key, &self.run(unit, log)?)?,
            Task::Day { group, .. } => {
                self.store
                    .put(&unit.key, &self.set(&unit.needs, group, Vec::new())?)?;
            }
            Task::Group { group } => self.store.put(&unit.key, &self.group(unit, group)?)?,
            Task::Changes { group } => self.store.put(&unit.key, &self.changes(group)?)?,
        }
        Ok(())
    }

    fn rig(&self, toml: &str) -> Result<Rig, WorkError> {
        Rig::from_toml(toml, "the campaign's rig", None).map_err(|e| WorkError::Rig(e.to_string()))
    }

    fn run(&self, unit: &Unit, log: usize) -> Result<RunSheet, WorkError> {
        let found = &self.logs[log];
        let mut sheet = RunSheet {
            sound: false,
            findings: Vec::new(),
            frames_lost: 0,
            duration_s: 0.0,
            samples: 0,
            replayed: false,
            range: BTreeMap::new(),
            largest_load: BTreeMap::new(),
            identified: Err(String::new()),
            diagnosed: Err(String::new()),
        };
        match doctor(&found.path) {
            Ok(diagnosis) => {
                sheet.sound = diagnosis.complete();
                sheet.frames_lost = diagnosis.frames_lost;
                let worse = diagnosis.findings.iter().filter(|f| f.grade > Grade::Note);
                sheet.findings = worse
                    .map(|f| {
                        let words = format!("{}: {}", f.check, f.message);
                        match f.grade {
                            Grade::Error => Finding::Error(words),
                            Grade::Warning | Grade::Note => Finding::Warning(words),
                        }
                    })
                    .collect();
            }
            Err(e) => sheet.findings.push(Finding::Error(e.to_string())),
        }
        let own = found.is.as_ref().map_err(Clone::clone);
        let rig = match own.and_then(|is| self.rig(&is.rig_toml).map_err(|e| e.to_string())) {
            Ok(rig) => rig,
            // What its group needs is a sheet that says so.
            Err(words) => {
                sheet.identified = Err(words.clone());
                sheet.diagnosed = Err(words);
                return Ok(sheet);
            }
        };
        let mut path = found.path.clone();
        let run = match load(&path, &rig) {
            Err(LoadError::NoMotion { frames, .. }) if frames > 0 => {
                path = self.store.poses_path(&unit.key);
                match self.poses(&found.path, &path)? {
                    Ok(()) => {
                        sheet.replayed = true;
                        load(&path, &rig).map_err(|e| e.to_string())
                    }
                    Err(words) => Err(words),
                }
            }
            other => other.map_err(|e| e.to_string()),
        };
        match run {
            Err(words) => {
                sheet.identified = Err(words.clone());
                sheet.diagnosed = Err(words);
            }
            Ok(run) => {
                sheet.duration_s = run.end_s();
                sheet.samples = run.samples.len() as u64;
                sheet.range = range(&run);
                self.store.put(&motion_key(&unit.key), &Motion::of(&run))?;
                sheet.largest_load = Dof::ALL
                    .iter()
                    .zip(run.largest_wrench())
                    .filter(|(_, load)| *load > 0.0)
                    .map(|(dof, load)| (dof.name().to_owned(), load))
                    .collect();
                sheet.identified = identified(&[run], &rig, false);
                sheet.diagnosed = diagnosed(&[(found.path.as_path(), path)], &rig, self.time_limit);
            }
        }
        Ok(sheet)
    }

    /// Poses of a log, or the reason for its sheet why there are none; those that are there stay.
    fn poses(&self, log: &Path, out: &Path) -> Result<Result<(), String>, WorkError> {
        if out.exists() {
            return Ok(Ok(()));
        }
        let made = (self.replay)(log, out);
        let is_begun = AtomicFile::is_begun(out);
        match made {
            // Another process of this campaign was sooner.
            Err(_) if out.exists() => Ok(Ok(())),
            // No fault of the log, which a sheet would keep.
            Err(_) if is_begun => Err(WorkError::BeingWritten {
                path: out.to_owned(),
            }),
            made => Ok(made),
        }
    }

    /// Where a run's motion stands, or why it is not used beside others.
    fn motion(&self, unit: usize) -> Result<(usize, PathBuf), String> {
        let unit = &self.units[unit];
        let Task::Run { log } = unit.task else {
            return Err(format!("{} is no run", unit.name));
        };
        let name = &self.logs[log].name;
        let Some(sheet) = self.store.get::<RunSheet>(&unit.key) else {
            return Err(format!("{name}: its sheet is gone"));
        };
        if sheet.samples == 0 {
            let why = sheet.identified.err().unwrap_or_default();
            return Err(format!("{name}: {why}"));
        }
        let mut findings = sheet.findings.iter();
        if let Some(bad) = findings.find(|f| matches!(f, Finding::Error(_))) {
            return Err(format!("{name}: {bad}"));
        }
        Ok((
            log,
            match sheet.replayed {
                true => self.store.poses_path(&unit.key),
                false => self.logs[log].path.clone(),
            },
        ))
    }

    /// Motion of the runs that can be used, at most [`RUNS_MAX`], and the others with their reasons.
    fn usable(&self, units: &[usize]) -> (Vec<(usize, PathBuf)>, Vec<String>) {
        let (mut kept, mut left) = (Vec::new(), Vec::new());
        for unit in units {
            match self.motion(*unit) {
                Ok(run) => kept.push(run),
                Err(why) => left.push(why),
            }
        }
        let all = kept.len();
        if all > RUNS_MAX {
            kept = evenly(kept, RUNS_MAX);
            left.push(format!(
                "{} more: {RUNS_MAX} runs of {all}, evenly over time, are fitted together",
                all - RUNS_MAX
            ));
        }
        (kept, left)
    }

    /// Runs since the last change: those before it are another body.
    fn group(&self, unit: &Unit, group: usize) -> Result<SetSheet, WorkError> {
        let of = &self.groups[group];
        let needs = |wanted: Task| -> Option<&Unit> {
            let mut all = unit.needs.iter().map(|k| &self.units[*k]);
            all.find(|u| u.task == wanted)
        };
        let changes = needs(Task::Changes { group });
        let sheet = changes.and_then(|u| self.store.get::<ChangeSheet>(&u.key));
        let last = sheet
            .iter()
            .flat_map(|s| s.changes.iter().flatten())
            .rfind(|c| c.is_one());
        let first = last.map_or(0, |c| {
            let at = of.days.iter().position(|d| d.date == c.date);
            at.unwrap_or(0)
        });
        let earlier = last.map(|c| format!("runs before {}: {}", c.date, c.sentence));
        let mut left: Vec<String> = earlier.into_iter().collect();
        if last.is_some() && !of.undated.is_empty() {
            left.push(format!(
                "{} run(s) without a day, as their clock is wrong: before or since the last change, nobody knows",
                of.undated.len()
            ));
        }
        let alone = Task::Day { group, day: first };
        if first > 0
            && first + 1 == of.days.len()
            && let Some(day) = needs(alone).and_then(|u| self.store.get::<SetSheet>(&u.key))
        {
            // One day since: what that day's own sheet says.
            left.extend(day.left);
            return Ok(SetSheet { left, ..day });
        }
        let mut runs: Vec<usize> = match of.days.len() {
            0 | 1 => unit.needs.clone(),
            days => (first..days)
                .filter_map(|day| needs(Task::Day { group, day }))
                .flat_map(|u| u.needs.clone())
                .collect(),
        };
        if of.days.len() > 1 && last.is_none() {
            // Without a change all runs are of one body, whenever they were.
            let is_undated = |k: &&usize| matches!(self.units[**k].task, Task::Run { log } if of.undated.contains(&log));
            runs.extend(unit.needs.iter().filter(is_undated));
        }
        // A copy of a log counts once.
        let mut seen = std::collections::BTreeSet::new();
        runs.retain(|k| seen.insert(*k));
        self.set(&runs, group, left)
    }

    /// Runs together; `left` = what was left for another reason.
    fn set(
        &self,
        runs: &[usize],
        group: usize,
        mut left: Vec<String>,
    ) -> Result<SetSheet, WorkError> {
        let rig = self.rig(&self.groups[group].rig_toml)?;
        let (kept, unusable) = self.usable(runs);
        left.extend(unusable);
        let runs: Result<Vec<Run>, String> = kept
            .iter()
            .map(|(log, path)| {
                let mut run = load(path, &rig).map_err(|e| e.to_string())?;
                run.name.clone_from(&self.logs[*log].name);
                Ok(run)
            })
            .collect();
        let identified = runs.and_then(|runs| identified(&runs, &rig, true));
        let recorded = kept.iter();
        let recorded: Vec<(&Path, PathBuf)> = recorded
            .map(|(log, path)| (self.logs[*log].path.as_path(), path.clone()))
            .collect();
        let diagnosed = match recorded.is_empty() {
            true => Err("no run of this set can be used".to_owned()),
            false => diagnosed(&recorded, &rig, self.time_limit),
        };
        Ok(SetSheet {
            runs: kept
                .iter()
                .map(|(log, _)| self.logs[*log].name.clone())
                .collect(),
            left,
            outliers: identified.as_ref().map_or(Vec::new(), outliers),
            identified,
            diagnosed,
        })
    }

    fn changes(&self, group: usize) -> Result<ChangeSheet, WorkError> {
        let of = &self.groups[group];
        let rig = self.rig(&of.rig_toml)?;
        let day_runs: Vec<Vec<(usize, PathBuf)>> = (0..of.days.len())
            .map(|day| {
                let unit = self
                    .units
                    .iter()
                    .find(|u| u.task == Task::Day { group, day });
                unit.map_or(Vec::new(), |u| self.usable(&u.needs).0)
            })
            .collect();
        let mut changes = Vec::new();
        let mut since: Vec<usize> = Vec::new();
        for (day, runs) in day_runs.iter().enumerate() {
            if runs.is_empty() {
                if day > 0 {
                    changes.push(Err(format!(
                        "{}: no run of it can be used",
                        of.days[day].date
                    )));
                }
                continue;
            }
            if since.is_empty() {
                since.push(day);
                continue;
            }
            let load_all = |rig: &Rig, days: &[usize]| -> Result<Vec<Run>, String> {
                let mut all = Vec::new();
                let of_days = days.iter().flat_map(|d| &day_runs[*d]).cloned();
                for (log, path) in &evenly(of_days.collect(), RUNS_MAX) {
                    let mut run = load(path, rig).map_err(|e| e.to_string())?;
                    run.name.clone_from(&self.logs[*log].name);
                    all.extend(run.stretches(memory_s(&rig.vehicle)));
                }
                Ok(all)
            };
            let dates: Vec<String> = since.iter().map(|d| of.days[*d].date.clone()).collect();
            let found = change(&rig, &of.days[day].date, &dates, &|rig, this| {
                if this {
                    load_all(rig, &[day])
                } else {
                    load_all(rig, &since)
                }
            });
            match &found {
                Ok(c) if c.is_one() => since = vec![day],
                _ => since.push(day),
            }
            changes.push(found.map_err(|e| format!("{}: {e}", of.days[day].date)));
        }
        Ok(ChangeSheet { changes })
    }
}

fn identified(runs: &[Run], rig: &Rig, cross_validate: bool) -> Result<Coefficients, String> {
    let options = Options {
        cross_validate,
        budget: false,
        ..Options::default()
    };
    identify(runs, rig, &options)
        .map(|found| Coefficients::of(&found))
        .map_err(|e| e.to_string())
}

/// Of logs, each with where its motion stands: in itself, or in its replay.
fn diagnosed(
    logs: &[(&Path, PathBuf)],
    rig: &Rig,
    time_limit: Option<Duration>,
) -> Result<Diagnosed, String> {
    let source = |(log, motion): &(&Path, PathBuf)| {
        let source = read(motion, rig)?;
        Ok(match motion == log {
            true => source,
            false => source.with_frames_of(log),
        })
    };
    let sources: Result<Vec<Source>, LoadError> = logs.iter().map(source).collect();
    let sources = sources.map_err(|e| e.to_string())?;
    let watch = Watch {
        progress: &|_| (),
        limit: time_limit.map_or(Limit::NONE, Limit::after),
    };
    let found = diagnose_beside(&sources, &[], rig, &Beside::default(), watch);
    let found = found.map_err(|e| e.to_string())?;
    Ok(Diagnosed::of(&found.verdict, time_limit))
}

/// Least and greatest of what was measured.
fn range(run: &Run) -> BTreeMap<String, [f64; 2]> {
    let mut found = BTreeMap::new();
    for c in Channel::ALL {
        let (low, high) = extent(run.measured(c));
        if low <= high {
            found.insert(c.name().to_owned(), [low, high]);
        }
    }
    found
}

/// Runs that the others predict far worse than the median run, by the worst channel.
fn outliers(found: &Coefficients) -> Vec<(String, f64)> {
    let mut by_channel: BTreeMap<&str, Vec<f64>> = BTreeMap::new();
    for (channel, rms) in found.leave_one_run_out_rms.values().flatten() {
        by_channel.entry(channel).or_default().push(*rms);
    }
    let medians: BTreeMap<&str, f64> = by_channel
        .into_iter()
        .filter_map(|(c, mut rms)| Some((c, median(&mut rms)?)))
        .collect();
    let mut odd: Vec<(String, f64)> = found
        .leave_one_run_out_rms
        .iter()
        .filter_map(|(run, rms)| {
            let ratio = rms
                .iter()
                .filter_map(|(c, v)| Some(v / medians.get(c.as_str()).filter(|m| **m > 0.0)?))
                .fold(0.0, f64::max);
            (ratio > OUTLIER).then(|| (run.clone(), ratio))
        })
        .collect();
    odd.sort_by(|a, b| b.1.total_cmp(&a.1));
    odd
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::group::groups_at;
    use crate::sheet::{Change, Truncated};
    use crate::survey::Identity;
    use crate::unit::units;
    use hydroline_diagnose::verdict::Word;

    const DAY_NS: u64 = 86_400_000_000_000;
    /// 2026-01-01.
    const NEW_YEAR_NS: u64 = 20_454 * DAY_NS;

    fn log(name: &str, start_ns: u64) -> Found {
        Found {
            name: name.to_owned(),
            path: PathBuf::from(name),
            hash: name.to_owned(),
            is: Ok(Identity {
                vehicle: "rov".to_owned(),
                rig_toml: "a rig".to_owned().into(),
                calibration: String::new(),
                water: "fresh".to_owned(),
                start_ns,
                plan: String::new(),
                note: String::new(),
            }),
        }
    }

    /// The sheet of the one day since the change was taken as it was.
    #[test]
    fn runs_without_a_day_are_said_where_one_day_is_left_since_the_last_change() {
        let logs = [
            log("before.mcap", NEW_YEAR_NS),
            log("since.mcap", NEW_YEAR_NS + DAY_NS),
            log("never-set.mcap", 45_000_000_000),
        ];
        let groups = groups_at(&logs, NEW_YEAR_NS + 9 * DAY_NS);
        let units = units(&logs, &groups, "build");
        let unit = |task: Task| units.iter().find(|u| u.task == task).unwrap();
        let dir = tempfile::tempdir().unwrap();
        let store = Store::open(dir.path()).unwrap();
        let change = Change {
            date: "2026-01-02".to_owned(),
            since: vec!["2026-01-01".to_owned()],
            same_probability: 0.01,
            causes: Vec::new(),
            chi2_per_dof: [9.0, 1.0],
            sentence: "heavier".to_owned(),
        };
        let changes = ChangeSheet {
            changes: vec![Ok(change)],
        };
        let day = SetSheet {
            runs: vec!["since.mcap".to_owned()],
            left: vec!["of the day".to_owned()],
            identified: Err("not fitted here".to_owned()),
            diagnosed: Err("not fitted here".to_owned()),
            outliers: Vec::new(),
        };
        let key = |task: Task| &unit(task).key;
        store
            .put(key(Task::Changes { group: 0 }), &changes)
            .unwrap();
        store
            .put(key(Task::Day { group: 0, day: 1 }), &day)
            .unwrap();
        let campaign = Campaign {
            logs: &logs,
            groups: &groups,
            units: &units,
            store: &store,
            replay: &|_: &Path, _: &Path| Ok(()),
            time_limit: None,
        };
        let whole = unit(Task::Group { group: 0 });
        let sheet = campaign.group(whole, 0).unwrap();
        assert_eq!(sheet.runs, day.runs);
        assert_eq!(sheet.left.len(), 3, "{:?}", sheet.left);
        assert_eq!(sheet.left[0], "runs before 2026-01-02: heavier");
        assert!(sheet.left[1].starts_with("1 run(s) without a day"));
        assert_eq!(sheet.left[2], "of the day");
    }

    /// Under `--time-limit none` a day kept the verdict that a limit had ended.
    #[test]
    fn what_a_time_limit_ended_is_done_again_under_a_longer_one() {
        let logs = [log("a.mcap", NEW_YEAR_NS)];
        let groups = groups_at(&logs, NEW_YEAR_NS + DAY_NS);
        let units = units(&logs, &groups, "build");
        let dir = tempfile::tempdir().unwrap();
        let store = Store::open(dir.path()).unwrap();
        let sheet = |truncated| SetSheet {
            runs: Vec::new(),
            left: Vec::new(),
            identified: Err(String::new()),
            diagnosed: Ok(Diagnosed {
                verdict: Word::None,
                sentence: String::new(),
                effects: Vec::new(),
                predicted: BTreeMap::new(),
                faults: Vec::new(),
                next_plan: String::new(),
                truncated,
            }),
            outliers: Vec::new(),
        };
        let done = |seconds: Option<u64>| {
            let campaign = Campaign {
                logs: &logs,
                groups: &groups,
                units: &units,
                store: &store,
                replay: &|_: &Path, _: &Path| Ok(()),
                time_limit: seconds.map(Duration::from_secs),
            };
            campaign.is_done(&units[0])
        };
        assert!(!done(None));
        store.put(&units[0].key, &sheet(None)).unwrap();
        assert!(done(None) && done(Some(1)));
        let end = Truncated {
            limit_s: 120.0,
            steps: 3,
            after: "beside the vehicle alone".to_owned(),
            open: vec!["beside thruster_lag surge".to_owned()],
        };
        store.put(&units[0].key, &sheet(Some(end))).unwrap();
        assert!(done(Some(120)) && done(Some(1)));
        assert!(!done(None) && !done(Some(121)));
        // Why there is no diagnosis is no end by a limit, and changes have none.
        let failed = SetSheet {
            diagnosed: Err("nothing moves".to_owned()),
            ..sheet(None)
        };
        store.put(&units[0].key, &failed).unwrap();
        assert!(done(None));
        let changes = ChangeSheet {
            changes: Vec::new(),
        };
        store.put(&units[0].key, &changes).unwrap();
        assert!(done(None));
    }

    /// Whether the replay gives poses, for the sheet; an error is of the unit.
    fn poses(out: &Path, is_finished: bool) -> Result<Result<(), String>, WorkError> {
        let folder = tempfile::tempdir().unwrap();
        let replay = |_: &Path, out: &Path| {
            let file = AtomicFile::begin(out).map_err(|e| e.to_string())?;
            match is_finished {
                true => file.finish().map_err(|e| e.to_string()),
                false => Err("no image in it".to_owned()),
            }
        };
        let campaign = Campaign {
            logs: &[],
            groups: &[],
            units: &[],
            store: &Store::open(folder.path()).unwrap(),
            replay: &replay,
            time_limit: None,
        };
        campaign.poses(Path::new("run.mcap"), out)
    }

    /// A kill left `KEY.PID.part.part`, which no later campaign cleared.
    #[test]
    fn poses_that_a_killed_campaign_left_unfinished_are_made_in_their_place() {
        let dir = tempfile::tempdir().unwrap();
        let (out, part) = (dir.path().join("k.mcap"), dir.path().join("k.mcap.part"));
        std::fs::write(&part, "half").unwrap();
        assert_eq!(poses(&out, true).unwrap(), Ok(()));
        assert!(out.exists() && !part.exists());
        // Those that are there stay.
        assert_eq!(poses(&out, false).unwrap(), Ok(()));
    }

    #[test]
    fn poses_that_another_process_writes_are_no_fault_of_their_log() {
        let dir = tempfile::tempdir().unwrap();
        let out = dir.path().join("k.mcap");
        let other = AtomicFile::begin(&out).unwrap();
        let busy = poses(&out, true).unwrap_err();
        assert!(matches!(busy, WorkError::BeingWritten { .. }), "{busy}");
        drop(other);
        assert_eq!(
            poses(&out, false).unwrap(),
            Err("no image in it".to_owned())
        );
    }
}

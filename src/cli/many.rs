//! Parts common to commands that take one log or many: folders opened up, a bad log reported and skipped, finished ones left.

use super::print::{self, errln};
use super::{CliError, Outcome};
use hydroline_log::Closing;
use hydroline_numerics::parallel;
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

/// Name of a log's file.
pub const LOG: &[&str] = &["mcap"];
/// Logs of other programs too.
pub const RECORDINGS: &[&str] = &["mcap", "db3", "bin", "tlog", "ulg"];

/// Logs as they were named: one, or several.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Many {
    /// In the order given, those of a folder by their names.
    pub logs: Vec<PathBuf>,
    /// Name of each where results of several lie together: its path in the folder that was named, or its file name.
    names: Vec<PathBuf>,
    /// One log that was named itself: a command says of it what it always said, and ends as it ends.
    pub single: bool,
}

/// Line of one log of several with --json.
#[derive(Serialize, schemars::JsonSchema)]
struct Line<'a, T> {
    /// The log.
    log: &'a Path,
    /// Output of one log.
    #[serde(flatten)]
    result: T,
}

/// Output for a log that could not be used.
#[derive(Serialize, schemars::JsonSchema)]
struct Refused {
    /// Why there is nothing else.
    error: String,
}

/// Where each log's result goes.
pub type Results = BTreeMap<PathBuf, PathBuf>;

impl Many {
    /// The files named, and in a folder's place all files in it and below it that end like a log; hidden ones are left.
    ///
    /// # Errors
    /// A folder that cannot be read, or holds none.
    pub fn of(named: &[PathBuf], endings: &[&str]) -> Result<Self, CliError> {
        Self::but(named, endings, |_| false)
    }

    /// The same, but for folders that stand for themselves.
    ///
    /// # Errors
    /// As [`Self::of`].
    pub fn but(
        named: &[PathBuf],
        endings: &[&str],
        is_whole: impl Fn(&Path) -> bool,
    ) -> Result<Self, CliError> {
        let is_folder = |path: &Path| path.is_dir() && !is_whole(path);
        let (mut logs, mut names) = (Vec::new(), Vec::new());
        for path in named {
            if is_folder(path) {
                let found = below(path, endings)?;
                names.extend(
                    found
                        .iter()
                        .map(|f| f.strip_prefix(path).unwrap_or(f).to_owned()),
                );
                logs.extend(found);
            } else {
                names.push(PathBuf::from(path.file_name().unwrap_or(path.as_os_str())));
                logs.push(path.clone());
            }
        }
        let single = matches!(named, [one] if !is_folder(one));
        Ok(Self {
            logs,
            names,
            single,
        })
    }

    /// Each log's result in the place that `place` names.
    pub fn each_to(&self, place: impl Fn(&Path) -> PathBuf) -> Results {
        let logs = self.logs.iter();
        logs.map(|log| (log.clone(), place(log))).collect()
    }

    /// Where each log's result goes in a folder for all of them, each by its log's name as `ended` ends it.
    ///
    /// # Errors
    /// Two logs of one name.
    pub fn results(
        &self,
        folder: &Path,
        ended: impl Fn(&Path) -> PathBuf,
    ) -> Result<Results, CliError> {
        let mut taken: BTreeMap<PathBuf, &Path> = BTreeMap::new();
        let mut results = Results::new();
        for (log, name) in self.logs.iter().zip(&self.names) {
            let result = folder.join(ended(name));
            if let Some(other) = taken.insert(result.clone(), log) {
                return Err(CliError::Config(format!(
                    "{} and {} would both become {}: give them in two calls, or the folder above both",
                    other.display(),
                    log.display(),
                    result.display()
                )));
            }
            results.insert(log.clone(), result);
        }
        Ok(results)
    }

    /// Does each log: `of` several at a time, `report` one after the other in their order. A log that cannot be used is said on
    /// stderr, given to `refused`, and skipped, unless it is the only one that was named.
    ///
    /// # Errors
    /// The single log's; of several, that none could be used.
    pub fn each<T: Send>(
        &self,
        at_a_time: usize,
        of: impl Fn(&Path) -> Result<T, CliError> + Sync,
        mut report: impl FnMut(&Path, T) -> Result<Outcome, CliError>,
        mut refused: impl FnMut(&Path, &CliError) -> Result<(), CliError>,
    ) -> Result<Outcome, CliError> {
        if let ([log], true) = (self.logs.as_slice(), self.single) {
            return report(log, of(log)?);
        }
        let mut outcome = Outcome::Done;
        let mut bad: Vec<CliError> = Vec::new();
        for logs in self.logs.chunks(at_a_time.max(1)) {
            let done = parallel::map_slice(logs, |log| of(log));
            for (log, done) in logs.iter().zip(done) {
                match done.and_then(|made| report(log, made)) {
                    Ok(Outcome::Done) => {}
                    Ok(Outcome::Lossy) => outcome = Outcome::Lossy,
                    Err(error) => {
                        let error = error.about(log);
                        errln!("hydroline: {error}");
                        refused(log, &error)?;
                        bad.push(error);
                    }
                }
            }
            if !print::is_read() {
                break;
            }
        }
        let n = self.logs.len();
        match bad.first() {
            None => Ok(outcome),
            Some(first) if bad.len() == n => {
                let words = format!("none of the {n} logs could be used, as said above");
                Err(match first {
                    CliError::Config(_) => CliError::Config(words),
                    CliError::Run(_) => CliError::Run(words),
                })
            }
            Some(_) => {
                errln!(
                    "hydroline: {} of {n} logs could not be used, as said above",
                    bad.len()
                );
                Ok(Outcome::Lossy)
            }
        }
    }

    /// The line of a log that could not be used, where lines are printed.
    pub fn refused_line(
        &self,
        json: bool,
    ) -> impl FnMut(&Path, &CliError) -> Result<(), CliError> + '_ {
        move |log, error| match json {
            true => self.json(
                log,
                &Refused {
                    error: error.to_string(),
                },
            ),
            false => Ok(()),
        }
    }

    /// One object on a line; with several logs it begins with its log.
    ///
    /// # Errors
    /// It cannot be written as JSON.
    pub fn json(
        &self,
        log: &Path,
        result: &(impl Serialize + schemars::JsonSchema),
    ) -> Result<(), CliError> {
        match self.single {
            true => print::json(result),
            false => print::json(&Line { log, result }),
        }
    }
}

/// Files below a folder that end like one of these, by name.
///
/// # Errors
/// A folder that cannot be read, or holds none.
pub fn below(folder: &Path, endings: &[&str]) -> Result<Vec<PathBuf>, CliError> {
    let mut found = Vec::new();
    let mut open = vec![folder.to_owned()];
    while let Some(dir) = open.pop() {
        let failed =
            |e: std::io::Error| CliError::reading(&dir, &e, "name a folder that can be read");
        for entry in std::fs::read_dir(&dir).map_err(failed)? {
            let entry = entry.map_err(failed)?;
            let path = entry.path();
            if entry.file_name().to_string_lossy().starts_with('.') {
                continue;
            }
            // A link to a folder may lead back here.
            if entry.file_type().map_err(failed)?.is_dir() {
                open.push(path);
            // A pipe of such a name is said where it is read.
            } else if path.metadata().is_ok_and(|m| !m.is_dir()) && ends_like(&path, endings) {
                found.push(path);
            }
        }
    }
    if found.is_empty() {
        let words: Vec<String> = endings.iter().map(|e| format!("*.{e}")).collect();
        return Err(CliError::Config(format!(
            "{}: no log ({}) in it or below it; name logs, or a folder that holds some",
            folder.display(),
            words.join(", ")
        )));
    }
    found.sort();
    Ok(found)
}

fn ends_like(path: &Path, endings: &[&str]) -> bool {
    let ending = path.extension().and_then(|e| e.to_str());
    ending.is_some_and(|e| endings.iter().any(|known| e.eq_ignore_ascii_case(known)))
}

/// Whether a result is there and no older than what it is made of.
pub fn is_up_to_date(result: &Path, of: &Path) -> bool {
    let changed = |path: &Path| -> Option<SystemTime> { path.metadata().ok()?.modified().ok() };
    match (changed(result), changed(of)) {
        (Some(made), Some(source)) => made >= source,
        _ => false,
    }
}

/// The same of a log: one that was broken off is not done.
pub fn is_log_up_to_date(result: &Path, of: &Path) -> bool {
    is_up_to_date(result, of) && Closing::of(result).is_some()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs::write;

    #[test]
    fn a_folder_stands_for_the_logs_in_it_and_below_it() {
        let dir = tempfile::tempdir().unwrap();
        let at = |name: &str| dir.path().join(name);
        std::fs::create_dir_all(at("day/.cache")).unwrap();
        for name in [
            "b.mcap",
            "a.MCAP",
            "day/c.mcap",
            "day/d.ulg",
            "day/.cache/e.mcap",
            ".f.mcap",
        ] {
            write(at(name), "").unwrap();
        }
        std::os::unix::fs::symlink(dir.path(), at("day/back")).unwrap();
        let found = Many::of(&[dir.path().to_owned()], LOG).unwrap();
        assert_eq!(found.logs, [at("a.MCAP"), at("b.mcap"), at("day/c.mcap")]);
        assert!(!found.single);
        let found = Many::of(&[dir.path().to_owned()], RECORDINGS).unwrap();
        assert_eq!(found.logs.len(), 4);
        let none = Many::of(&[at("day/.cache")], &["ulg"]).unwrap_err();
        assert!(none.to_string().contains("no log (*.ulg)"), "{none}");
        assert!(Many::of(&[at("b.mcap")], LOG).unwrap().single);
        let csv = |name: &Path| name.with_extension("csv");
        let found = Many::of(&[dir.path().to_owned()], LOG).unwrap();
        let results = found.results(Path::new("out"), csv).unwrap();
        let results: Vec<PathBuf> = results.into_values().collect();
        assert_eq!(
            results,
            ["out/a.csv", "out/b.csv", "out/day/c.csv"].map(PathBuf::from)
        );
        let twice = Many::of(&[at("b.mcap"), at("day/../b.mcap")], LOG).unwrap();
        let clash = twice.results(Path::new("out"), csv).unwrap_err();
        assert!(clash.to_string().contains("out/b.csv"), "{clash}");
    }

    #[test]
    fn a_bad_log_is_passed_and_only_bad_ones_are_a_failure() {
        let many = Many {
            logs: ["a", "b", "c"].map(PathBuf::from).to_vec(),
            names: ["a", "b", "c"].map(PathBuf::from).to_vec(),
            single: false,
        };
        let run = |bad: &[&str]| {
            let mut reported = Vec::new();
            let of = |log: &Path| match bad.contains(&log.to_str().unwrap()) {
                true => Err(CliError::Run("cut".to_owned())),
                false => Ok(()),
            };
            let mut refused = 0;
            let report = |log: &Path, ()| {
                reported.push(log.to_owned());
                Ok(Outcome::Done)
            };
            let outcome = many.each(2, of, report, |_, _| {
                refused += 1;
                Ok(())
            });
            assert_eq!(refused, bad.len());
            (outcome, reported.len())
        };
        assert!(matches!(run(&[]), (Ok(Outcome::Done), 3)));
        assert!(matches!(run(&["b"]), (Ok(Outcome::Lossy), 2)));
        assert!(matches!(run(&["a", "b", "c"]), (Err(CliError::Run(_)), 0)));
    }

    #[test]
    fn what_is_older_than_its_source_is_not_done() {
        let dir = tempfile::tempdir().unwrap();
        let (source, result) = (dir.path().join("a"), dir.path().join("b"));
        write(&source, "").unwrap();
        assert!(!is_up_to_date(&result, &source));
        write(&result, "").unwrap();
        assert!(is_up_to_date(&result, &source));
        assert!(!is_log_up_to_date(&result, &source));
        let later = SystemTime::now() + std::time::Duration::from_secs(60);
        let file = std::fs::File::options().write(true).open(&source).unwrap();
        file.set_modified(later).unwrap();
        assert!(!is_up_to_date(&result, &source));
    }
}

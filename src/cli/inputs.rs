//! Arguments that several commands share, and how they are read.

use super::CliError;
use crate::print::errln;
use hydroline_log::writable_folder;
use hydroline_rigs::{Plan, Rig, bounded};
use hydroline_sim::EffectStack;
use std::path::Path;
use std::time::Duration;

/// Commands reach the disk within this time \[s\].
const GUARANTEED_FLUSH_S: f64 = 0.05;

/// Longest time that an argument may be: clocks count in nanoseconds since 1970, and ten years on have to fit.
const LONGEST: Duration = Duration::from_secs(3_660 * 86_400);

/// Reads `30s`, `2m`, `1h30m`, `500ms`, or a bare number of seconds.
pub fn duration(text: &str) -> Result<Duration, String> {
    let length = match text.parse::<f64>() {
        Ok(seconds) if seconds > LONGEST.as_secs_f64() => return Err(too_long(text)),
        Ok(seconds) => Duration::try_from_secs_f64(seconds)
            .map_err(|_| format!("'{text}' is not a length of time; write 30s or 2m"))?,
        Err(_) => {
            humantime::parse_duration(text).map_err(|e| format!("{e}; write 30s, 2m or 1h30m"))?
        }
    };
    if length > LONGEST {
        return Err(too_long(text));
    }
    Ok(length)
}

fn too_long(text: &str) -> String {
    format!(
        "'{text}' is longer than {} days",
        LONGEST.as_secs() / 86_400
    )
}

/// Latest second that a log may begin in: 64 bits of nanoseconds end in 2554, and the longest run has to fit.
const LATEST_UNIX_S: u64 = u64::MAX / 1_000_000_000 - LONGEST.as_secs();

/// Reads a time as RFC 3339 in UTC, `2026-05-04T09:30:00Z`; seconds since 1970.
pub fn time(text: &str) -> Result<u64, String> {
    let at = humantime::parse_rfc3339_weak(text)
        .map_err(|e| format!("{e}; write 2026-05-04T09:30:00Z (UTC)"))?;
    let since_s = at
        .duration_since(std::time::UNIX_EPOCH)
        .map(|since| since.as_secs())
        .map_err(|_| format!("'{text}' is before 1970"))?;
    if since_s > LATEST_UNIX_S {
        let latest = std::time::UNIX_EPOCH + Duration::from_secs(LATEST_UNIX_S);
        return Err(format!(
            "'{text}' is later than {}: stamps count nanoseconds since 1970 in 64 bits",
            humantime::format_rfc3339_seconds(latest)
        ));
    }
    Ok(since_s)
}

/// A length of time that is longer than nothing.
pub fn some_duration(text: &str) -> Result<Duration, String> {
    match duration(text)? {
        Duration::ZERO => Err("must be longer than 0".to_owned()),
        length => Ok(length),
    }
}

/// A number that is finite and not negative.
pub fn not_negative(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if value.is_finite() && value >= 0.0 => Ok(value),
        _ => Err(format!("'{text}' is not a number >= 0")),
    }
}

/// A number that is finite and more than 0.
pub fn positive(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if value.is_finite() && value > 0.0 => Ok(value),
        _ => Err(format!("'{text}' is not a number > 0")),
    }
}

/// A rig by file or built-in name.
pub fn rig(argument: &str) -> Result<Rig, CliError> {
    let rig = Rig::load_or_builtin(argument)?;
    // The simulator knows the effects that there are, the rig file does not.
    EffectStack::<f64>::build(&rig.physics)
        .map_err(|e| CliError::Config(format!("{argument}: [[physics]]: {e}")))?;
    Ok(rig)
}

/// A crash is to cost no more than the last command: that holds for commands flushed within 50 ms.
pub fn warn_of_flush(rig: &Rig) {
    let flush_s = rig.log.command_flush_s;
    if flush_s > GUARANTEED_FLUSH_S {
        errln!(
            "hydroline: log.command_flush_s = {flush_s}: a crash may cost the commands of the last {flush_s} s; {GUARANTEED_FLUSH_S} or less keeps the loss to the last one"
        );
    }
}

/// Numbers that are allowed but not plausible together.
pub fn warn_of_implausible(rig: &Rig) {
    for words in hydroline_rigs::plausible::remarks(rig) {
        errln!("remark: {words}");
    }
}

/// A plan by file or built-in name, checked against the rig that is to run it.
pub fn plan(argument: &str, rig: &Rig) -> Result<Plan, CliError> {
    let plan = Plan::load_or_builtin(argument)?;
    plan.check_against(rig)?;
    Ok(plan)
}

/// Refuses to overwrite what is there, and a folder that takes no file, before any work is done; `flag` = how the
/// user named it.
pub fn new_file(flag: &str, path: &Path) -> Result<(), CliError> {
    if path.symlink_metadata().is_ok() {
        return Err(CliError::Config(format!(
            "{} exists; a log is never overwritten: name another {flag} or move it away",
            path.display()
        )));
    }
    takes_file(flag, path)
}

/// Refuses a place for a file in a folder that is not there or takes none.
pub fn takes_file(flag: &str, path: &Path) -> Result<(), CliError> {
    let folder = match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    };
    takes_files(flag, path, folder)
}

/// Refuses a folder for results that is a file or takes no file; one that is not there yet is made later.
pub fn folder(flag: &str, path: &Path) -> Result<(), CliError> {
    match path.ancestors().find(|p| p.exists()) {
        Some(there) => takes_files(flag, path, there),
        None => takes_files(flag, path, Path::new(".")),
    }
}

fn takes_files(flag: &str, path: &Path, folder: &Path) -> Result<(), CliError> {
    writable_folder(folder)
        .map_err(|why| CliError::Config(format!("{flag} {}: {why}", path.display())))
}

/// A text file that was given; `next` = what to do when it cannot be read.
pub fn text(path: &Path, next: &str) -> Result<String, CliError> {
    bounded::read_text(path, bounded::RESULT_BYTES).map_err(|e| CliError::reading(path, &e, next))
}

/// Refuses a file that is not there or cannot be read, before any work is done; `next` = what to do then.
pub fn readable_file(path: &Path, next: &str) -> Result<(), CliError> {
    use std::io::Read;
    // A folder opens like a file and tells only when it is read.
    bounded::open(path)
        .and_then(|mut file| file.read(&mut [0]))
        .map(|_| ())
        .map_err(|e| CliError::reading(path, &e, next))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn durations_are_read_as_people_write_them() {
        assert_eq!(duration("30s").unwrap(), Duration::from_secs(30));
        assert_eq!(duration("90").unwrap(), Duration::from_secs(90));
        assert_eq!(duration("1m30s").unwrap(), Duration::from_secs(90));
        assert!(duration("-3").is_err());
        for endless in ["1e19", "inf", "3661d", "99999999999y"] {
            assert!(duration(endless).is_err(), "{endless}");
        }
        assert!(duration("soon").unwrap_err().contains("30s"));
    }

    #[test]
    fn places_that_take_no_result_are_refused_before_the_work() {
        let dir = tempfile::tempdir().unwrap();
        let file = dir.path().join("file");
        std::fs::write(&file, "").unwrap();
        assert!(new_file("--out", &dir.path().join("new.mcap")).is_ok());
        assert!(folder("--report", &dir.path().join("a/b/c")).is_ok());
        assert!(folder("--report", dir.path()).is_ok());
        for (refused, words) in [
            (new_file("--out", &file), "exists"),
            (
                new_file("--out", &dir.path().join("a/b")),
                "create it first",
            ),
            (new_file("--out", &file.join("b")), "not a folder"),
            (folder("--report", &file), "not a folder"),
            (folder("--report", &file.join("a/b")), "not a folder"),
            // A file system that takes no new files, not even from root.
            (new_file("--out", Path::new("/proc/x")), "cannot be written"),
            (
                folder("--report", Path::new("/proc/x/y")),
                "cannot be written",
            ),
        ] {
            let error = refused.unwrap_err();
            assert!(matches!(error, CliError::Config(_)));
            let error = error.to_string();
            assert!(error.contains(words), "no '{words}' in: {error}");
        }
    }

    #[test]
    fn a_file_that_cannot_be_read_is_an_argument_that_is_wrong() {
        let dir = tempfile::tempdir().unwrap();
        let latin1 = dir.path().join("latin1.csv");
        std::fs::write(&latin1, [b'a', 0xe9]).unwrap();
        assert!(readable_file(&latin1, "").is_ok());
        for error in [
            readable_file(dir.path(), "name a file").unwrap_err(),
            readable_file(&dir.path().join("none"), "name a file").unwrap_err(),
            text(dir.path(), "name a file").unwrap_err(),
            text(&latin1, "name a file").unwrap_err(),
        ] {
            assert!(matches!(error, CliError::Config(_)), "{error}");
            assert!(error.to_string().ends_with("; name a file"), "{error}");
        }
    }
}

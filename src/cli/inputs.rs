//! Arguments that several commands share, and how they are read.

use super::CliError;
use hydroline_rigs::{Plan, Rig};
use hydroline_sim::EffectStack;
use std::time::Duration;

/// Commands reach the disk within this time \[s\].
const PROMISED_FLUSH_S: f64 = 0.05;

/// Reads `30s`, `2m`, `1h30m`, `500ms`, or a bare number of seconds.
pub fn duration(text: &str) -> Result<Duration, String> {
    if let Ok(seconds) = text.parse::<f64>() {
        return Duration::try_from_secs_f64(seconds)
            .map_err(|_| format!("'{text}' is not a length of time; write 30s or 2m"));
    }
    humantime::parse_duration(text).map_err(|e| format!("{e}; write 30s, 2m or 1h30m"))
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

/// A rig by file or built-in name.
pub fn rig(argument: &str) -> Result<Rig, CliError> {
    let rig = Rig::load_or_builtin(argument).map_err(CliError::config)?;
    // Which effects there are is the simulator's knowledge, not the rig file's.
    EffectStack::<f64>::build(&rig.physics)
        .map_err(|e| CliError::Config(format!("{argument}: [[physics]]: {e}")))?;
    Ok(rig)
}

/// A crash is to cost no more than the last command: that holds for commands flushed within 50 ms.
pub fn warn_of_flush(rig: &Rig) {
    let flush_s = rig.log.command_flush_s;
    if flush_s > PROMISED_FLUSH_S {
        eprintln!(
            "hydroline: log.command_flush_s = {flush_s}: a crash may cost the commands of the last {flush_s} s; {PROMISED_FLUSH_S} or less keeps the loss to the last one"
        );
    }
}

/// A plan by file or built-in name, checked against the rig that is to run it.
pub fn plan(argument: &str, rig: &Rig) -> Result<Plan, CliError> {
    let plan = Plan::load_or_builtin(argument).map_err(CliError::config)?;
    plan.check_against(rig).map_err(CliError::config)?;
    Ok(plan)
}

/// Refuses to overwrite what is there; `flag` = how the user named it.
pub fn new_file(flag: &str, path: &std::path::Path) -> Result<(), CliError> {
    if path.exists() {
        return Err(CliError::Config(format!(
            "{} exists; hydroline never overwrites: name another {flag} or move it away",
            path.display()
        )));
    }
    match path.parent() {
        Some(dir) if !dir.as_os_str().is_empty() && !dir.is_dir() => {
            Err(CliError::Config(format!(
                "{flag} {}: the folder {} does not exist; create it first",
                path.display(),
                dir.display()
            )))
        }
        _ => Ok(()),
    }
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
        assert!(duration("soon").unwrap_err().contains("30s"));
    }
}

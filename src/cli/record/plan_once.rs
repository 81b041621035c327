//! A plan that a service starts once: what the service manager starts again by itself records, but drives nothing.
//!
//! After a run that was cut off (a limit, a lost link, a watchdog, a crash) the vehicle is anywhere, and a plan is checked from the
//! rig's start. The unit that ships names a file that outlives such a start and is gone when somebody stops the service.

use super::CliError;
use std::fs::OpenOptions;
use std::io::{ErrorKind, Write};
use std::path::PathBuf;

/// Names the file that says that a plan was begun; set by the unit, and by nobody at a terminal.
const VARIABLE: &str = "HYDROLINE_PLAN_ONCE";

/// The file, where there is one to be.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct PlanOnce(Option<PathBuf>);

impl PlanOnce {
    /// As the service's environment says; without it a plan runs whenever it is asked for.
    pub fn of_service() -> Self {
        let path = std::env::var_os(VARIABLE).filter(|path| !path.is_empty());
        Self(path.map(PathBuf::from))
    }

    /// Whether a service asks for it: then nobody watches where the vehicle is.
    pub fn is_asked(&self) -> bool {
        self.0.is_some()
    }

    /// Notes that a plan begins; in words why it must not, where one has begun before.
    ///
    /// # Errors
    /// [`CliError::Run`] where that cannot be noted: a plan that might be begun twice is not begun.
    pub fn begin(&self, plan: &str) -> Result<Option<String>, CliError> {
        let Some(path) = &self.0 else { return Ok(None) };
        let write = || -> std::io::Result<()> {
            let mut file = OpenOptions::new().write(true).create_new(true).open(path)?;
            file.write_all(format!("plan {plan}\n").as_bytes())?;
            file.sync_all()
        };
        match write() {
            Ok(()) => Ok(None),
            Err(e) if e.kind() == ErrorKind::AlreadyExists => Ok(Some(format!(
                "plan '{plan}' is not run: {} says that one was begun before this start, and the vehicle may be anywhere since; \
                 it is only recorded. {NEXT}",
                path.display()
            ))),
            Err(e) => Err(CliError::Run(format!(
                "{VARIABLE}={}: {e}; a plan that could be begun twice is not begun: name a file in a folder that can be written",
                path.display()
            ))),
        }
    }

    /// Notes that plans begin, of a series that proposes them.
    ///
    /// # Errors
    /// As [`Self::begin`], and [`CliError::Config`] where one has begun before: without a plan there is no such run.
    pub fn refuse_again(&self) -> Result<(), CliError> {
        match self.begin("by proposal")? {
            None => Ok(()),
            Some(words) => Err(CliError::Config(words)),
        }
    }
}

/// Next step of whoever finds that.
const NEXT: &str = "Bring the vehicle to its start, then `systemctl stop hydroline` and `systemctl start hydroline`";

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plan_begins_once_until_the_service_is_stopped() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("plan-begun");
        let once = PlanOnce(Some(path.clone()));
        assert_eq!(once.begin("surge-4n").unwrap(), None);
        let words = once.begin("surge-4n").unwrap().unwrap();
        assert!(
            words.contains("surge-4n") && words.contains("systemctl stop"),
            "{words}"
        );
        assert!(matches!(once.refuse_again(), Err(CliError::Config(_))));
        // systemd removes its folder then.
        std::fs::remove_file(&path).unwrap();
        assert_eq!(once.begin("surge-4n").unwrap(), None);
        // At a terminal nobody keeps count.
        assert_eq!(PlanOnce(None).begin("surge-4n").unwrap(), None);
        assert!(once.is_asked() && !PlanOnce(None).is_asked());
    }

    #[test]
    fn a_plan_that_could_be_begun_twice_is_not_begun() {
        let once = PlanOnce(Some("/no/such/folder/plan-begun".into()));
        let error = once.begin("surge-4n").unwrap_err();
        assert!(matches!(error, CliError::Run(_)));
        assert!(error.to_string().contains("HYDROLINE_PLAN_ONCE"), "{error}");
    }
}

//! Properties of a result at which a script should stop (`--fail-on`): the same in `identify` and `diagnose`.

use super::CliError;
use hydroline_identify::model_test::ModelTest;

/// Property of a result at which a script should stop.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub(super) enum FailOn {
    /// A model that does not explain the runs, by the test that identify and diagnose share
    Misfit,
}

impl FailOn {
    /// Sentences of the test that show it; empty where it does not have it.
    fn found(self, test: &ModelTest) -> Vec<String> {
        match self {
            FailOn::Misfit => test.misfit(),
        }
    }

    fn name(self) -> String {
        use clap::ValueEnum;
        self.to_possible_value()
            .map_or_else(String::new, |v| v.get_name().to_owned())
    }
}

/// Fails where a result has what was asked for, once everything is printed and written; `next_step` = command that says more.
pub(super) fn judged(wanted: &[FailOn], test: &ModelTest, next_step: &str) -> Result<(), CliError> {
    let mut wanted = wanted.to_vec();
    wanted.dedup();
    let found = wanted.iter().filter_map(|what| {
        let words = what.found(test);
        let said = format!("--fail-on {}: {}{next_step}", what.name(), words.join("; "));
        (!words.is_empty()).then_some(said)
    });
    let found: Vec<String> = found.collect();
    match found.is_empty() {
        true => Ok(()),
        false => Err(CliError::Run(found.join("\nhydroline: "))),
    }
}

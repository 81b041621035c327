//! Errors that poses state to share: of the calibration through which they were seen.

use std::collections::BTreeMap;

use hydroline_core::run::{Channel, PerChannel, SharedErrors};

use super::sources::{Consider, Moved, Sources};

impl Sources<'_> {
    fn shared_errors(&self, run: usize) -> Option<&SharedErrors> {
        let stated = self.runs.get(run)?.shared_errors.as_ref();
        stated.filter(|shared| !shared.is_empty())
    }

    /// Whether the poses of a run state what they share.
    pub fn states_shared_errors(&self, run: usize) -> bool {
        self.shared_errors(run).is_some()
    }

    /// Each error of each calibration, in all runs that were seen through it.
    pub fn of_the_calibrations(&self) -> Vec<Consider> {
        let runs = &self.fitted.problem.body.recording.runs;
        let mut owners: BTreeMap<&str, Vec<usize>> = BTreeMap::new();
        for run in 0..runs.len() {
            if let Some(shared) = self.shared_errors(run) {
                owners.entry(&shared.owner).or_default().push(run);
            }
        }
        let of = |mine: &[usize], error: usize| -> Moved {
            let each = runs.iter().enumerate().map(|(run, recorded)| {
                let shared = self.shared_errors(run).filter(|_| mine.contains(&run));
                let at = |t_s: &f64| {
                    let by = shared.map_or([0.0; 6], |shared| shared.at(error, *t_s));
                    PerChannel::from_fn(|c: Channel| match c.is_rate() {
                        true => 0.0,
                        false => by[c.index()],
                    })
                };
                recorded.times_s.iter().map(at).collect()
            });
            each.collect()
        };
        let count = |mine: &[usize]| {
            let each = mine.iter().filter_map(|run| self.shared_errors(*run));
            each.map(SharedErrors::len).max().unwrap_or(0)
        };
        let all = owners.values().flat_map(|mine| {
            (0..count(mine)).map(|error| Consider {
                source: "calibration, which all its poses share".to_owned(),
                sd: None,
                unit: "",
                basis: "the calibration's covariance, as the poses state it".to_owned(),
                reduce: "a calibration of more frames, or of more of the sheet".to_owned(),
                moved: of(mine, error),
                prior_ln_odds: None,
            })
        });
        all.collect()
    }
}

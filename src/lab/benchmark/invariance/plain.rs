//! The vehicle alone by maximum likelihood, as `identify --flat-priors` has it.

use std::collections::BTreeMap;

use hydroline_core::run::Run;
use hydroline_diagnose::verdict::Verdict;
use hydroline_estimate::{EstimateError, ModelChoice, Options, identify};
use hydroline_identify::parameter::Coefficient;
use hydroline_rigs::Dof;

use super::base::Base;

/// rms that the vehicle alone leaves, channel by channel; the same coefficients are free as for the diagnosis.
///
/// # Errors
/// [`EstimateError`].
pub fn left(base: &Base, verdict: &Verdict) -> Result<BTreeMap<String, f64>, EstimateError> {
    let runs: Vec<Run> = base.given.iter().map(|g| g.source.run.clone()).collect();
    let is_fixed = |c: &Coefficient| !verdict.parameters.before.contains_key(c.key());
    let fixed: Vec<Coefficient> = Dof::ALL
        .into_iter()
        .flat_map(Coefficient::of)
        .filter(is_fixed)
        .collect();
    let free = Dof::ALL
        .into_iter()
        .flat_map(Coefficient::of)
        .filter(|c| !is_fixed(c));
    let dofs: Vec<_> = free.map(|c| c.dof).collect();
    let one = dofs.first().filter(|d| dofs.iter().all(|o| o == *d));
    let options = Options {
        model: one.map_or(ModelChoice::Coupled, |d| ModelChoice::Axis(*d)),
        fixed,
        flat_priors: true,
        cross_validate: false,
        budget: false,
        ..Options::default()
    };
    let found = identify(&runs, &base.rig, &options)?;
    let mut sums: BTreeMap<String, (f64, f64)> = BTreeMap::new();
    for r in found.runs {
        for (channel, rms) in r.rms.into_iter().filter(|(_, v)| v.is_finite()) {
            let sum = sums.entry(channel).or_default();
            sum.0 += r.samples as f64 * rms * rms;
            sum.1 += r.samples as f64;
        }
    }
    let rms =
        |(channel, (squares, samples)): (String, (f64, f64))| (channel, (squares / samples).sqrt());
    Ok(sums.into_iter().map(rms).collect())
}

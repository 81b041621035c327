//! The noise of the measurement, from runs at rest or from what a log carries of one.

use crate::identify::data::Run;
use crate::identify::forward::Forward;
use crate::identify::noise::{Noise, Series, estimate as estimate_noise};
use crate::identify::statistics::median;

/// Noise per slot that the logs carry from a stretch at rest: the first log that has a slot's channel.
/// Slots that are combinations of channels have none.
pub(super) fn stored_noise(runs: &[Run], slots: &[String]) -> Option<Vec<Option<(Noise, f64)>>> {
    let of = |slot: &String| {
        runs.iter()
            .filter_map(|r| r.noise_at_rest.as_ref()?.get(slot))
            .map(|n| (n.noise, n.outliers))
            .find(|(noise, _)| noise.total_sd() > 0.0)
    };
    let found: Vec<Option<(Noise, f64)>> = slots.iter().map(of).collect();
    found.iter().any(Option::is_some).then_some(found)
}

/// Noise per slot of runs at rest: deviations from each run's median.
pub(super) fn noise_at_rest(rest: &dyn Forward) -> Vec<Option<(Noise, f64)>> {
    let slots = rest.slots().len();
    (0..slots)
        .map(|slot| {
            let series: Vec<(Vec<f64>, Vec<f64>)> = (0..rest.runs())
                .map(|run| {
                    let values: Vec<f64> = rest
                        .measured(run)
                        .iter()
                        .skip(slot)
                        .step_by(slots)
                        .copied()
                        .collect();
                    let mut present: Vec<f64> =
                        values.iter().copied().filter(|v| v.is_finite()).collect();
                    let middle = median(&mut present).unwrap_or(0.0);
                    (
                        rest.times_s(run).to_vec(),
                        values.iter().map(|v| v - middle).collect(),
                    )
                })
                .collect();
            let views: Vec<Series<'_>> = series
                .iter()
                .map(|(t, v)| Series {
                    times_s: t,
                    values: v,
                    jacobian: None,
                })
                .collect();
            let (noise, used) = estimate_noise(&views)?;
            let kept = used.iter().flatten().filter(|u| **u).count() as f64;
            let present = views
                .iter()
                .flat_map(|s| s.values)
                .filter(|v| v.is_finite())
                .count() as f64;
            Some((noise, 1.0 - kept / present.max(1.0)))
        })
        .collect()
}

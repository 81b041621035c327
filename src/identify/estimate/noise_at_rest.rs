//! The noise of the measurement, from stretches at rest or from what a log carries of one.

use crate::data::is_still;
use crate::forward::Forward;
use crate::problem::precision;
use hydroline_core::run::rest_noise::{RestNoise, Stretch, about_median, at_rest};
use hydroline_core::run::{Channel, Run};

/// Noise per slot that the logs carry from a stretch at rest: the first log that has a slot's channel.
/// Its level belongs to the sd that was logged there; `references` are those of the slots here.
pub(super) fn stored_noise(
    runs: &[Run],
    slots: &[String],
    references: &[Option<f64>],
) -> Option<Vec<Option<RestNoise>>> {
    let of = |(slot, reference): (&String, &Option<f64>)| {
        let stored = runs
            .iter()
            .filter_map(|r| r.noise_at_rest.as_ref()?.get(slot))
            .find(|n| n.noise.total_sd() > 0.0)?;
        let scale = match (reference, stored.logged_sd) {
            (Some(here), Some(there)) if there > 0.0 => here / there,
            _ => 1.0,
        };
        Some(RestNoise {
            noise: stored.noise.times(scale),
            logged_sd: *reference,
            ..stored.clone()
        })
    };
    let found: Vec<Option<RestNoise>> = slots.iter().zip(references).map(of).collect();
    found.iter().any(Option::is_some).then_some(found)
}

/// Noise per slot of `slots` from runs at rest: deviations from each run's median. Slots go by name: a run at
/// rest may have measured other channels than the ones that moved.
pub(super) fn noise_at_rest(
    rest: &dyn Forward,
    slots: &[String],
    references: &[Option<f64>],
) -> Vec<Option<RestNoise>> {
    let own = rest.slots();
    let count = own.len();
    // The references in the order of the rest's own slots.
    let matched: Vec<Option<f64>> = own
        .iter()
        .map(|name| {
            let place = slots.iter().position(|s| s == name)?;
            references.get(place).copied().flatten()
        })
        .collect();
    let factors: Vec<Vec<f64>> = (0..rest.runs())
        .map(|run| precision(rest, run, &matched))
        .collect();
    slots
        .iter()
        .zip(references)
        .map(|(name, reference)| {
            let slot = own.iter().position(|s| s == name)?;
            let stretches: Vec<Stretch> = (0..rest.runs())
                .map(|run| {
                    let values = rest.measured(run).iter().skip(slot).step_by(count);
                    let stamped = rest.times_s(run).iter().zip(values).enumerate();
                    let samples: Vec<(f64, f64, f64)> = stamped
                        .map(|(k, (t_s, value))| {
                            let factor = factors[run].get(k * count + slot).unwrap_or(&1.0);
                            (*t_s, *value, *factor)
                        })
                        .collect();
                    about_median(&samples)
                })
                .collect();
            at_rest(stretches, *reference)
        })
        .collect()
}

/// A run at rest with its pose about zero: combinations of channels that a covariance makes must not turn a
/// place far from zero into noise where that covariance varies. One DOF needs the heading, which says where ahead is.
pub(super) fn centred(run: &Run, keep_heading: bool) -> Run {
    let mut run = run.clone();
    let channels = Channel::POSES.into_iter();
    for channel in channels.filter(|c| !(keep_heading && *c == Channel::Psi)) {
        let middle = run.median(channel).unwrap_or(0.0);
        for sample in &mut run.samples {
            sample.values[channel] -= middle;
        }
    }
    run
}

/// Stretch before the first load of a run that is driven later, if it is at rest and measures noise,
/// and the time of that load \[s\].
pub(super) fn before_the_first_load(run: &Run, tolerance: [f64; 2]) -> Option<(Run, f64)> {
    let first = run
        .commands
        .iter()
        .find(|c| c.wrench.iter().any(|w| *w != 0.0))?;
    let mut stretch = run.clone();
    stretch.commands.clear();
    stretch.samples.retain(|s| s.t_s < first.t_s);
    is_still(&stretch, tolerance).then_some((stretch, first.t_s))
}

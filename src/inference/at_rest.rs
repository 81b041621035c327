//! Noise of every channel as stretches at rest show it: runs at rest, what is before a run's first load, or what a log carries of one.
//!
//! It is the least that a channel has in motion: errors of poses from frames are larger there and of another colour, for the scene
//! changes; those of other instruments are not smaller.

use hydroline_core::run::rest_noise::{about_median, at_rest};
use hydroline_core::run::{Channel, PerChannel, RestNoise, Run};
use hydroline_identify::data::before_the_first_load;
use hydroline_numerics::noise::Noise;
use hydroline_rigs::Rig;

use super::recording::Recording;

/// Fewest samples that measure a channel's noise.
const SAMPLES_MIN: usize = 30;
/// Slowest colour that is taken for the instrument's \[s\]: what a hull at rest does within its tolerance is slower, and no noise.
const SLOWEST_S: f64 = 2.0;

/// A stretch at rest.
#[derive(Debug, Clone, PartialEq)]
pub struct Resting {
    /// Name of its run.
    pub run: String,
    /// Length \[s\].
    pub length_s: f64,
    /// Whether it is what came before the first load of a run that was driven.
    pub is_opening: bool,
    /// Channels of which it measured enough.
    pub measures: PerChannel<bool>,
}

/// Noise at rest.
#[derive(Debug, Clone)]
pub struct AtRest {
    /// Per channel, for a sample whose logged sd is the recording's; `None` = no stretch measured it.
    pub channels: PerChannel<Option<RestNoise>>,
    /// Stretches that were asked.
    pub stretches: Vec<Resting>,
}

impl AtRest {
    /// Of runs at rest, else of the openings of `moving` runs, else of what these carry; `recording` = the moving runs.
    pub fn of(still: &[Run], moving: &[Run], rig: &Rig, recording: &Recording) -> AtRest {
        let tolerance = [rig.tolerance.position_m, rig.tolerance.attitude_rad];
        let openings = || {
            moving
                .iter()
                .filter_map(|r| before_the_first_load(r, tolerance))
        };
        let resting: Vec<Run> = match still.is_empty() {
            true => openings().map(|o| o.0).collect(),
            false => still.to_vec(),
        };
        if resting.is_empty() {
            return AtRest {
                channels: stored(moving, recording),
                stretches: Vec::new(),
            };
        }
        let mut rest = Recording::new(&resting, rig.tank.start_pose[5]);
        rest.hold_heading();
        rest.refer_to(recording.logged_sd);
        let samples = |run: usize, c: Channel| -> Vec<(f64, f64, f64)> {
            let r = &rest.runs[run];
            let all = (0..r.times_s.len()).map(|k| {
                let ratio = r.sd_ratio_of(k, c, true);
                (r.times_s[k], r.measured(k)[c], 1.0 / ratio)
            });
            all.filter(|s| s.1.is_finite()).collect()
        };
        let asked = |c: &Channel| recording.channels[*c];
        let measures =
            |run: usize| PerChannel::from_fn(|c| asked(&c) && samples(run, c).len() >= SAMPLES_MIN);
        let channels = PerChannel::from_fn(|c| {
            let each = (0..rest.runs.len()).map(|run| samples(run, c));
            let each: Vec<_> = each.filter(|s| s.len() >= SAMPLES_MIN).collect();
            if !asked(&c) || each.is_empty() {
                return None;
            }
            let reference = logged(recording, c);
            at_rest(each.iter().map(|s| about_median(s)).collect(), reference)
        });
        let of = |(k, r): (usize, &Run)| Resting {
            run: r.name.clone(),
            length_s: r.end_s() - r.samples.first().map_or(0.0, |s| s.t_s),
            is_opening: still.is_empty(),
            measures: measures(k),
        };
        AtRest {
            channels,
            stretches: resting.iter().enumerate().map(of).collect(),
        }
    }

    /// Least noise of each channel in motion: without the colour that may be the hull's own drift.
    pub fn least(&self) -> PerChannel<Option<Noise>> {
        PerChannel::from_fn(|c| {
            let noise = self.channels[c].as_ref()?.noise;
            Some(if noise.correlation_s > SLOWEST_S {
                Noise::white(noise.white_sd)
            } else {
                noise
            })
        })
    }
}

/// Median of a channel's sd as the recording's logs state it; `None` = they state none.
fn logged(recording: &Recording, channel: Channel) -> Option<f64> {
    let pose = (!channel.is_rate()).then(|| recording.logged_sd[channel.index()]);
    pose.filter(|sd| sd.is_finite())
}

/// Noise that the logs carry from a stretch at rest: of each channel by the first that has it.
fn stored(runs: &[Run], recording: &Recording) -> PerChannel<Option<RestNoise>> {
    PerChannel::from_fn(|c| {
        let each = runs
            .iter()
            .filter_map(|r| r.noise_at_rest.as_ref()?.get(c.name()));
        let stored = each.into_iter().find(|n| n.noise.total_sd() > 0.0)?;
        let reference = logged(recording, c);
        let scale = match (reference, stored.logged_sd) {
            (Some(here), Some(there)) if there > 0.0 => here / there,
            _ => 1.0,
        };
        recording.channels[c].then(|| RestNoise {
            noise: stored.noise.times(scale),
            logged_sd: reference,
            ..stored.clone()
        })
    })
}

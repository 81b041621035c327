//! Runs at rest: they measure the noise and nothing else.

use std::collections::BTreeMap;

use super::super::noise::{Noise, Series, estimate};
use super::{CHANNELS, Run, Sample};
use crate::log::messages::{pb, timestamp, unix_ns};

/// Shortest run at rest that measures a noise's colour \[s\].
pub const STILL_MIN_S: f64 = 20.0;

/// Whether a run is one at rest: no load at all for at least 20 s, and no channel that drifts
/// by more than `[position_m, attitude_rad]` between its first, middle and last third.
///
/// A decay test has no command either, but it moves.
pub fn is_still(run: &Run, tolerance: [f64; 2]) -> bool {
    let span_s = run.end_s() - run.samples.first().map_or(0.0, |s| s.t_s);
    if span_s < STILL_MIN_S
        || run.largest_wrench().iter().any(|w| *w > 0.0)
        || run.samples.len() < 30
    {
        return false;
    }
    // Angles may wrap and rates are noisy; positions and attitude say whether it moved.
    (0..6).all(|channel| {
        let values: Vec<f64> = run
            .samples
            .iter()
            .map(|s| s.values[channel])
            .filter(|v| v.is_finite())
            .collect();
        if values.len() < 30 {
            return true;
        }
        let limit = if channel < 3 {
            tolerance[0]
        } else {
            tolerance[1]
        };
        let mut medians: Vec<f64> = values
            .chunks(values.len() / 8)
            .filter_map(|c| super::super::statistics::median(&mut c.to_vec()))
            .collect();
        medians.sort_by(f64::total_cmp);
        medians
            .last()
            .zip(medians.first())
            .is_some_and(|(high, low)| high - low < limit)
    })
}

/// Noise of one channel as a run at rest measured it.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct ChannelNoise {
    /// Level and colour, SI.
    #[serde(flatten)]
    pub noise: Noise,
    /// Share of samples that were outliers.
    pub outliers: f64,
}

/// Noise by channel name; what a log at rest carries in its metadata (`summary`, key [`NOISE_KEY`]).
pub type StillNoise = BTreeMap<String, ChannelNoise>;

/// Key in the log's metadata `summary`; its value is [`StillNoise`] as JSON.
pub const NOISE_KEY: &str = "noise_at_rest";

/// Fewest samples that measure a channel's noise.
const SAMPLES_MIN: usize = 30;

/// Noise of every channel of a run at rest: deviations from the median.
pub fn still_noise(run: &Run) -> StillNoise {
    let measure = |channel: usize| -> Option<(String, ChannelNoise)> {
        let middle = run.median(channel)?;
        let (times_s, values): (Vec<f64>, Vec<f64>) = run
            .samples
            .iter()
            .map(|s| (s.t_s, s.values[channel] - middle))
            .filter(|(_, v)| v.is_finite())
            .unzip();
        if values.len() < SAMPLES_MIN {
            return None;
        }
        let series = Series {
            times_s: &times_s,
            values: &values,
            jacobian: None,
        };
        let (noise, used) = estimate(&[series])?;
        let kept = used.iter().flatten().filter(|u| **u).count();
        let outliers = 1.0 - kept as f64 / values.len() as f64;
        Some((
            CHANNELS[channel].to_owned(),
            ChannelNoise { noise, outliers },
        ))
    };
    (0..12).filter_map(measure).collect()
}

/// Watches a log being written and measures the noise at its end, if the vehicle was at rest throughout.
#[derive(Debug, Default)]
pub struct StillWatch {
    run: Run,
    driven: bool,
}

impl StillWatch {
    /// A command went by.
    pub fn command(&mut self, command: &pb::ThrusterCommand) {
        if command.thrust_n != 0.0 {
            // A run that is driven measures no noise: nothing more is kept.
            self.driven = true;
            self.run.samples = Vec::new();
        }
    }

    /// A measured pose went by.
    pub fn motion(&mut self, motion: &pb::VehicleMotion) {
        if self.driven {
            return;
        }
        let stamp_ns = unix_ns(motion.timestamp.as_ref().unwrap_or(&timestamp(0)));
        if self.run.samples.is_empty() {
            self.run.start_ns = stamp_ns;
        }
        let t_s = (stamp_ns as f64 - self.run.start_ns as f64) * 1e-9;
        // Stamps that repeat or run backwards measure nothing.
        if self.run.samples.last().is_none_or(|last| t_s > last.t_s) {
            let values = super::load::values(motion).map(|v| v.unwrap_or(f64::NAN));
            self.run.samples.push(Sample {
                t_s,
                values,
                covariance: None,
            });
        }
    }

    /// The metadata entry for the log's end: (key, JSON); `None` unless at rest for long enough.
    pub fn metadata(&self, tolerance: [f64; 2]) -> Option<(String, String)> {
        if self.driven || !is_still(&self.run, tolerance) {
            return None;
        }
        let json = serde_json::to_string(&still_noise(&self.run)).ok()?;
        Some((NOISE_KEY.to_owned(), json))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{SeedableRng, rngs::StdRng};
    use rand_distr::{Distribution, StandardNormal};

    fn watch(length: usize, drift_m: f64) -> StillWatch {
        let mut watch = StillWatch::default();
        let mut rng = StdRng::seed_from_u64(3);
        let (mut slow, decay) = (0.0, (-0.04_f64 / 0.6).exp());
        for k in 0..length {
            let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
            slow = decay * slow + (1.0 - decay * decay).sqrt() * normal();
            let spoilt = if k % 100 == 50 { 5e-3 } else { 0.0 };
            watch.motion(&pb::VehicleMotion {
                timestamp: Some(timestamp(1_760_000_000_000_000_000 + 40_000_000 * k as u64)),
                x_m: Some(1.0 + 2e-4 * normal() + 3e-4 * slow + spoilt + drift_m * k as f64),
                ..Default::default()
            });
        }
        watch
    }

    const TOLERANCE: [f64; 2] = [0.002, 0.0017];

    #[test]
    fn a_log_at_rest_carries_level_colour_and_outliers() {
        let (key, json) = watch(2000, 0.0).metadata(TOLERANCE).unwrap();
        assert_eq!(key, NOISE_KEY);
        let found: StillNoise = serde_json::from_str(&json).unwrap();
        assert_eq!(found.len(), 1);
        let x = found["x_m"];
        assert!((x.noise.white_sd / 2e-4 - 1.0).abs() < 0.1, "{x:?}");
        assert!((x.noise.coloured_sd / 3e-4 - 1.0).abs() < 0.3, "{x:?}");
        assert!((0.3..1.2).contains(&x.noise.correlation_s), "{x:?}");
        assert!((0.008..0.014).contains(&x.outliers), "{x:?}");
    }

    #[test]
    fn what_is_short_drifts_or_is_driven_measures_nothing() {
        assert!(watch(300, 0.0).metadata(TOLERANCE).is_none(), "12 s");
        assert!(watch(2000, 1e-5).metadata(TOLERANCE).is_none(), "20 mm");
        let mut driven = watch(2000, 0.0);
        driven.command(&pb::ThrusterCommand {
            thrust_n: 0.5,
            ..Default::default()
        });
        assert!(driven.metadata(TOLERANCE).is_none());
    }
}

//! Runs at rest: they measure the noise and nothing else.

use hydroline_core::run::rest_noise::{about_median, at_rest};
use hydroline_core::run::{Channel, RestNoise, Run, Sample, StillNoise};
use hydroline_log::messages::{pb, timestamp, unix_ns};
use hydroline_numerics::statistics::{difference_sd, extent, median, robust_sd};

/// Shortest run at rest that measures a noise's colour \[s\].
pub const STILL_MIN_S: f64 = 20.0;

/// Fewest samples that say whether a channel moves.
const JUDGED_MIN: usize = 30;
/// A rate whose mean is above this many tolerances per second is no bias of an instrument at rest.
const BIAS_MAX_PER_S: f64 = 10.0;

/// Whether a run is one at rest: no load at all for at least 20 s, and no position or angle whose
/// medians over eighths of the run differ by more than `[position_m, attitude_rad]`.
///
/// A decay test has no command either, but it moves. A degree of freedom of which only the rate was
/// measured is judged by that rate; a run that measured too little to say is not at rest.
pub fn is_still(run: &Run, tolerance: [f64; 2]) -> bool {
    let span_s = run.end_s() - run.samples.first().map_or(0.0, |s| s.t_s);
    if span_s < STILL_MIN_S
        || run.largest_wrench().iter().any(|w| *w > 0.0)
        || run.samples.len() < 30
    {
        return false;
    }
    let mut judged = false;
    for channels in (0..6).map(Channel::of) {
        let limit = tolerance[usize::from(channels[0].is_angular())];
        // Rates are noisy; where there is a position or an angle it says whether it moved.
        let [pose, rate] = channels.map(|c| run.measured(c).collect::<Vec<f64>>());
        let rests = if pose.len() >= JUDGED_MIN {
            spread_of_medians(&pose) < limit
        } else if rate.len() >= JUDGED_MIN {
            rate_is_noise(&rate, limit)
        } else {
            continue;
        };
        if !rests {
            return false;
        }
        judged = true;
    }
    judged
}

/// Largest less smallest median of the eighths of a series.
fn spread_of_medians(values: &[f64]) -> f64 {
    let medians = values
        .chunks((values.len() / 8).max(1))
        .filter_map(|c| median(&mut c.to_vec()));
    let (low, high) = extent(medians);
    high - low
}

/// Whether a rate is a constant bias and noise: it neither drifts nor swings. A swing several times
/// as fast as an eighth of the run leaves the medians alone, but not the scatter, which is then far
/// above what neighbours differ by (slow noise may be three times that).
fn rate_is_noise(values: &[f64], limit_per_s: f64) -> bool {
    let bias = median(&mut values.to_vec()).unwrap_or(f64::NAN);
    let away: Vec<f64> = values.iter().map(|v| v - bias).collect();
    bias.abs() < BIAS_MAX_PER_S * limit_per_s
        && spread_of_medians(values) < limit_per_s
        && robust_sd(&away) <= 3.0 * difference_sd(values)
}

/// Key in the `summary` that a log at rest carries; its value is [`StillNoise`] as JSON.
pub const NOISE_KEY: &str = "noise_at_rest";

/// Fewest samples that measure a channel's noise.
const SAMPLES_MIN: usize = 30;

/// Logged sd over its median, or its inverse, beyond which a sample counts no less or more.
const RATIO_MOST: f64 = 20.0;

/// Stretch before the first load of a run that is driven later, if it is at rest and measures noise,
/// and the time of that load \[s\].
pub fn before_the_first_load(run: &Run, tolerance: [f64; 2]) -> Option<(Run, f64)> {
    let first = run
        .commands
        .iter()
        .find(|c| c.wrench.iter().any(|w| *w != 0.0))?;
    let mut stretch = run.clone();
    stretch.commands.clear();
    stretch.samples.retain(|s| s.t_s < first.t_s);
    is_still(&stretch, tolerance).then_some((stretch, first.t_s))
}

/// Noise of every channel of a run at rest: deviations from the median, each for the sd that the log says of it.
pub fn still_noise(run: &Run) -> StillNoise {
    let measure = |name: String, samples: &[(f64, f64, f64)]| -> Option<(String, RestNoise)> {
        if samples.len() < SAMPLES_MIN {
            return None;
        }
        let mut sds: Vec<f64> = samples
            .iter()
            .map(|s| s.2)
            .filter(|sd| sd.is_finite())
            .collect();
        let reference = median(&mut sds);
        let weighed: Vec<(f64, f64, f64)> = samples
            .iter()
            .map(|(t_s, value, sd)| {
                let ratio = reference.map_or(1.0, |r| r / sd);
                let weight = if ratio.is_finite() { ratio } else { 1.0 };
                (*t_s, *value, weight.clamp(1.0 / RATIO_MOST, RATIO_MOST))
            })
            .collect();
        Some((name, at_rest(vec![about_median(&weighed)], reference)?))
    };
    let channel = |c: Channel| {
        let samples: Vec<(f64, f64, f64)> = run
            .samples
            .iter()
            .filter(|s| s.values[c].is_finite())
            .map(|s| (s.t_s, s.values[c], s.sd(c).unwrap_or(f64::NAN)))
            .collect();
        measure(c.name().to_owned(), &samples)
    };
    Channel::ALL.into_iter().filter_map(channel).collect()
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
            let values = motion.channels().map(|v| v.unwrap_or(f64::NAN));
            self.run.samples.push(Sample {
                t_s,
                values,
                covariance: super::load::covariance(motion),
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
        let x = &found["x_m"];
        assert!((x.noise.white_sd / 2e-4 - 1.0).abs() < 0.1, "{x:?}");
        assert!((x.noise.coloured_sd / 3e-4 - 1.0).abs() < 0.3, "{x:?}");
        assert!((0.3..1.2).contains(&x.noise.correlation_s), "{x:?}");
        assert!((0.008..0.014).contains(&x.outliers), "{x:?}");
    }

    /// A log that carries only a rate, 120 s at 25/s.
    fn rate_only(rate: impl Fn(f64) -> f64, channel: Channel) -> Run {
        let mut rng = StdRng::seed_from_u64(5);
        let sample = |k: usize| {
            let noise: f64 = StandardNormal.sample(&mut rng);
            let mut values = hydroline_core::run::PerChannel::NAN;
            values[channel] = rate(0.04 * k as f64) + 1e-3 * noise;
            Sample {
                t_s: 0.04 * k as f64,
                values,
                covariance: None,
            }
        };
        Run {
            samples: (0..3000).map(sample).collect(),
            ..Run::default()
        }
    }

    #[test]
    fn a_decay_seen_by_rates_only_is_not_at_rest_and_a_quiet_gyro_is() {
        let swing = |t: f64| 0.3 * (-0.02 * t).exp() * (1.3 * t).sin();
        assert!(!is_still(&rate_only(swing, Channel::P), TOLERANCE));
        assert!(!is_still(
            &rate_only(|t| 0.6 / (1.0 + 0.2 * t), Channel::U),
            TOLERANCE
        ));
        assert!(
            !is_still(&rate_only(|_| 0.3, Channel::R), TOLERANCE),
            "a steady turn"
        );
        assert!(
            is_still(&rate_only(|_| 0.004, Channel::R), TOLERANCE),
            "a bias"
        );
        let mut nothing = rate_only(|_| 0.0, Channel::R);
        for sample in &mut nothing.samples {
            sample.values = hydroline_core::run::PerChannel::NAN;
        }
        assert!(!is_still(&nothing, TOLERANCE), "nothing measured");
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

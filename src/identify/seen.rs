//! Motion that a run showed of each DOF: the largest speed, and amplitude and frequency where it goes back and forth.

use std::collections::BTreeMap;

use hydroline_core::run::{Channel, Run, Sample};
use hydroline_rigs::Dof;
use serde::Serialize;

/// Stretch of positions whose slope is a speed \[s\]: long enough for the noise of poses, short beside a vehicle's time constants.
const SLOPE_S: f64 = 0.4;
/// Share of the largest speed that the motion has to pass on the other side of rest to have turned: less is a tremor on its way.
const TURNED: f64 = 0.15;
/// Standard deviations of the speed that it has to pass, too: 5 are in none of 10^6 samples of noise.
const BEYOND_NOISE: f64 = 5.0;
/// Median of the size of a normal number, in standard deviations.
const MEDIAN_SIZE: f64 = 0.674_489_750_196_082;
/// Rounding of sums, as a share of the largest value.
const ROUNDING: f64 = 64.0 * f64::EPSILON;
/// Turns from which motion goes back and forth: one and a half periods between the first and the last.
const TURNS: usize = 4;

/// Motion of one DOF in one run.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, schemars::JsonSchema)]
pub struct Seen {
    /// Largest speed \[m/s, rad/s\].
    pub speed: f64,
    /// Half of the way between two turns, on average \[m, rad\]; `None` = it does not go back and forth.
    pub amplitude: Option<f64>,
    /// Frequency of going back and forth \[Hz\].
    pub frequency_hz: Option<f64>,
}

/// Motion by DOF, of those that were measured.
pub fn seen(run: &Run) -> BTreeMap<String, Seen> {
    let of = |dof: Dof| {
        let (speeds, sd) = speeds(run, dof)?;
        Some((dof.name().to_owned(), of_speeds(&speeds, sd)?))
    };
    Dof::ALL.into_iter().filter_map(of).collect()
}

/// Speeds over time (time \[s\], speed), and the standard deviation of their noise.
type Speeds = (Vec<(f64, f64)>, f64);

/// Samples of a channel that are numbers.
fn measured(run: &Run, channel: Channel) -> Vec<(f64, f64)> {
    let all = run.samples.iter().map(|s| (s.t_s, s.values[channel]));
    all.filter(|s| s.1.is_finite()).collect()
}

/// Standard deviation of white noise on samples, by the median of their second differences.
fn noise_sd(samples: &[(f64, f64)]) -> f64 {
    let mut sizes: Vec<f64> = samples
        .windows(3)
        .map(|w| (w[0].1 - 2.0 * w[1].1 + w[2].1).abs())
        .collect();
    sizes.sort_by(f64::total_cmp);
    let median = sizes.get(sizes.len() / 2).copied().unwrap_or(0.0);
    let largest = samples.iter().map(|s| s.1.abs()).fold(0.0, f64::max);
    (median / (MEDIAN_SIZE * 6f64.sqrt())).max(ROUNDING * largest)
}

/// Speeds of a DOF: measured, else slopes of the pose; `None` = neither is measured.
fn speeds(run: &Run, dof: Dof) -> Option<Speeds> {
    let [pose, rate] = Channel::of(dof.index());
    if run.has(rate) {
        let samples = measured(run, rate);
        let sd = noise_sd(&samples);
        return Some((samples, sd));
    }
    run.has(pose).then(|| match dof {
        Dof::Surge | Dof::Sway => along_heading(run, dof),
        _ => slopes(run, pose),
    })
}

/// Surge or sway of positions in the tank, turned into the heading where both positions and the heading are measured.
fn along_heading(run: &Run, dof: Dof) -> Speeds {
    let all = [Channel::X, Channel::Y, Channel::Psi];
    if !all.iter().all(|c| run.has(*c)) {
        return slopes(run, Channel::of(dof.index())[0]);
    }
    let ((x, x_sd), (y, y_sd)) = (slopes(run, Channel::X), slopes(run, Channel::Y));
    let heading = |t_s: f64| {
        let after = run.samples.partition_point(|s| s.t_s < t_s);
        let known = |s: &&Sample| s.values[Channel::Psi].is_finite();
        let sample = run.samples[after..].iter().find(known);
        sample.map_or(0.0, |s| s.values[Channel::Psi])
    };
    // Slopes of two channels are at the same stamps where both are measured there.
    let mut south = y.into_iter().peekable();
    let mut turned = Vec::with_capacity(x.len());
    for (t_s, x_mps) in x {
        while south.next_if(|s| s.0 < t_s).is_some() {}
        if let Some((_, y_mps)) = south.next_if(|s| s.0 == t_s) {
            let (sin, cos) = heading(t_s).sin_cos();
            let speed = match dof {
                Dof::Surge => x_mps * cos + y_mps * sin,
                _ => y_mps * cos - x_mps * sin,
            };
            turned.push((t_s, speed));
        }
    }
    (turned, x_sd.max(y_sd))
}

/// Slopes of a channel by straight lines through its samples about each of them; their noise is that of the line of median length.
fn slopes(run: &Run, channel: Channel) -> Speeds {
    let samples = measured(run, channel);
    let slope = |(t_s, _): &(f64, f64)| {
        let from = samples.partition_point(|s| s.0 < t_s - 0.5 * SLOPE_S);
        let to = samples.partition_point(|s| s.0 <= t_s + 0.5 * SLOPE_S);
        let near = &samples[from..to];
        let n = near.len() as f64;
        let mean_t = near.iter().map(|s| s.0).sum::<f64>() / n;
        let mean = near.iter().map(|s| s.1).sum::<f64>() / n;
        let spread: f64 = near.iter().map(|s| (s.0 - mean_t).powi(2)).sum();
        let moved: f64 = near.iter().map(|s| (s.0 - mean_t) * (s.1 - mean)).sum();
        (near.len() > 2 && spread > 0.0).then(|| ((*t_s, moved / spread), spread))
    };
    let (slopes, mut spreads): (Vec<_>, Vec<_>) = samples.iter().filter_map(slope).unzip();
    spreads.sort_by(f64::total_cmp);
    let spread = spreads.get(spreads.len() / 2).copied();
    (slopes, noise_sd(&samples) / spread.unwrap_or(1.0).sqrt())
}

/// `None` without any speed; `sd` = that of the speeds' noise.
fn of_speeds(speeds: &[(f64, f64)], sd: f64) -> Option<Seen> {
    let speed = speeds.iter().map(|s| s.1.abs()).reduce(f64::max)?;
    let other_side = (TURNED * speed).max(BEYOND_NOISE * sd);
    let mut turns: Vec<f64> = Vec::new();
    let mut ways = Vec::new();
    let (mut side, mut way, mut crossed_s) = (0.0, 0.0, speeds[0].0);
    for pair in speeds.windows(2) {
        let ((t0, v0), (t1, v1)) = (pair[0], pair[1]);
        if v0 * v1 < 0.0 || v0 == 0.0 {
            crossed_s = t0 + (t1 - t0) * v0.abs() / (v0.abs() + v1.abs()).max(f64::MIN_POSITIVE);
        }
        if v1.abs() > other_side && v1.signum() != side {
            if side != 0.0 {
                turns.push(crossed_s);
                ways.push(way);
            }
            (side, way) = (v1.signum(), 0.0);
        }
        way += 0.5 * (v0 + v1).abs() * (t1 - t0);
    }
    // The way up to the first turn begins anywhere.
    let whole = ways.get(1..).unwrap_or(&[]);
    let between = turns.first().zip(turns.last()).map(|(a, b)| b - a);
    let swings = (turns.len() >= TURNS).then_some(between).flatten();
    Some(Seen {
        speed,
        amplitude: swings.map(|_| 0.5 * whole.iter().sum::<f64>() / whole.len() as f64),
        frequency_hz: swings.map(|s| 0.5 * (turns.len() - 1) as f64 / s),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use hydroline_core::run::PerChannel;
    use std::f64::consts::TAU;

    fn run(of: impl Fn(f64) -> PerChannel<f64>) -> Run {
        Run {
            samples: (0..500)
                .map(|k| 0.04 * f64::from(k))
                .map(|t_s| Sample {
                    t_s,
                    values: of(t_s),
                    covariance: None,
                })
                .collect(),
            ..Run::default()
        }
    }

    #[test]
    fn a_sine_has_its_amplitude_and_frequency() {
        let sine = run(|t| {
            let mut v = PerChannel::NAN;
            v[Channel::Z] = 0.05 * (TAU * 0.3 * t + 0.4).sin();
            v
        });
        let of = seen(&sine)["heave"];
        assert!((of.speed / (0.05 * TAU * 0.3) - 1.0).abs() < 0.03, "{of:?}");
        assert!((of.amplitude.unwrap() / 0.05 - 1.0).abs() < 0.05, "{of:?}");
        assert!(
            (of.frequency_hz.unwrap() / 0.3 - 1.0).abs() < 0.02,
            "{of:?}"
        );
        assert_eq!(seen(&sine).len(), 1);
    }

    #[test]
    fn steady_motion_has_a_speed_and_no_amplitude_and_follows_the_heading() {
        let heading = 0.6_f64;
        let steady = run(|t| {
            let mut v = PerChannel::NAN;
            v[Channel::X] = 0.2 * t * heading.cos();
            v[Channel::Y] = 0.2 * t * heading.sin();
            v[Channel::Psi] = heading;
            v
        });
        let of = seen(&steady);
        assert!((of["surge"].speed - 0.2).abs() < 1e-9, "{of:?}");
        assert!(of["sway"].speed < 1e-9, "{of:?}");
        assert_eq!(of["surge"].amplitude, None);
        assert_eq!(of["yaw"].frequency_hz, None);
    }

    /// Noise of a pose at rest and of a rate: neither swings.
    #[test]
    fn noise_alone_goes_nowhere_and_back() {
        // Splitmix64 of the sample's number: uniform in -1 .. 1.
        let noise = |t: f64, seed: u64| {
            let k = (25.0 * t).round() as u64 + seed;
            let z = k.wrapping_mul(0x9e37_79b9_7f4a_7c15);
            let z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
            (z ^ (z >> 31)) as f64 / 2f64.powi(63) - 1.0
        };
        let still = run(|t| {
            let mut v = PerChannel::NAN;
            v[Channel::Psi] = 0.3 + 1e-3 * noise(t, 1);
            v[Channel::W] = 2e-3 * noise(t, 1000);
            v
        });
        let of = seen(&still);
        assert_eq!(of["yaw"].frequency_hz, None, "{of:?}");
        assert_eq!(of["heave"].amplitude, None, "{of:?}");
        assert!(of["yaw"].speed < 0.01, "{of:?}");
    }

    #[test]
    fn a_measured_rate_is_taken_as_it_is() {
        let both = run(|t| {
            let mut v = PerChannel::NAN;
            v[Channel::X] = 0.0;
            v[Channel::U] = 0.3 * (TAU * 0.5 * t).sin();
            v
        });
        let of = seen(&both)["surge"];
        assert!((of.speed - 0.3).abs() < 1e-3);
        assert!((of.amplitude.unwrap() - 0.3 / (TAU * 0.5)).abs() < 2e-3);
    }
}

//! A recorded run: commands and measured motion of one log, in plain numbers.

mod companion;
pub mod instrument_sd;
mod joined;
pub mod rest_noise;
mod shared_errors;
mod stretches;
mod windows;

use std::collections::BTreeMap;

use hydroline_numerics::statistics::median;

pub use companion::{COMPANIONS, Companions};
pub use hydroline_rigs::channel::{Channel, PerChannel};
pub use joined::Joined;
pub use rest_noise::RestNoise;
pub use shared_errors::{Loadings, SharedErrors};
pub use stretches::longest_step_s;

/// A body wrench in force from `t_s` until the next command.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Command {
    /// Time since the log's first stamp \[s\].
    pub t_s: f64,
    /// X, Y, Z \[N\], K, M, N \[N m\].
    pub wrench: [f64; 6],
}

/// Measured motion at one time.
#[derive(Debug, Clone, PartialEq)]
pub struct Sample {
    /// Time since the log's first stamp \[s\].
    pub t_s: f64,
    /// SI; NaN = not measured.
    pub values: PerChannel<f64>,
    /// 6 x 6 row-major of the pose's own error, SI; `None` = not known.
    pub covariance: Option<Box<[f64; 36]>>,
}

/// One run.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Run {
    /// File name or what the maker calls it.
    pub name: String,
    /// UNIX time of t = 0 \[ns\].
    pub start_ns: u64,
    /// Ascending in time, only changes; 0 before the first.
    pub commands: Vec<Command>,
    /// Strictly ascending in time.
    pub samples: Vec<Sample>,
    /// Companions measured beside the motion; they drive it and are not explained.
    pub companions: Companions,
    /// Every thruster command carried its pulse: loads come from the rig's curves, not from the log.
    pub from_pulses: bool,
    /// Noise that the log carries from a stretch at rest; used where no run at rest is given itself.
    pub noise_at_rest: Option<StillNoise>,
    /// Motion and commands are of two clocks.
    pub joined: Option<Joined>,
    /// sd of each channel's instrument as the import's map states it \[SI\]: the channel's noise is no smaller; 0 = not stated.
    pub instrument_sd: PerChannel<f64>,
    /// Errors that its poses share; `None` = the log states none.
    pub shared_errors: Option<SharedErrors>,
    /// Oddities of the data, one sentence each.
    pub notes: Vec<String>,
}

/// Noise at rest by channel name.
pub type StillNoise = BTreeMap<String, RestNoise>;

/// Motion that starts this late after the log's first stamp is a window of a longer log: its state is free, and time
/// begins there \[s\].
const START_SLACK_S: f64 = 1.0;

/// Where the state of a run is given whose motion has these stamps \[s\]: the log's first stamp, or that of a window's motion.
pub fn start_s(times_s: &[f64]) -> f64 {
    let first_s = times_s.first().copied().unwrap_or(0.0);
    if first_s > START_SLACK_S {
        first_s
    } else {
        0.0
    }
}

impl Sample {
    /// Variance of a pose channel as the log says it \[SI\]; `None` = it says none.
    pub fn variance(&self, channel: Channel) -> Option<f64> {
        let pose = self.covariance.as_deref().filter(|_| !channel.is_rate())?;
        Some(pose[7 * channel.index()])
    }

    /// Its root; `None` where it is not positive either.
    pub fn sd(&self, channel: Channel) -> Option<f64> {
        let variance = self.variance(channel).filter(|v| *v > 0.0);
        variance.map(f64::sqrt)
    }
}

impl Run {
    /// Values of a channel where it is measured.
    pub fn measured(&self, channel: Channel) -> impl Iterator<Item = f64> + Clone {
        let all = self.samples.iter().map(move |s| s.values[channel]);
        all.filter(|v| v.is_finite())
    }

    /// Whether a channel is measured at all.
    pub fn has(&self, channel: Channel) -> bool {
        self.measured(channel).next().is_some()
    }

    /// Last stamp \[s\].
    pub fn end_s(&self) -> f64 {
        self.samples.last().map_or(0.0, |s| s.t_s)
    }

    /// The wrench in force at `t_s`.
    pub fn wrench_at(&self, t_s: f64) -> [f64; 6] {
        let after = self.commands.partition_point(|c| c.t_s <= t_s);
        after
            .checked_sub(1)
            .and_then(|i| self.commands.get(i))
            .map_or([0.0; 6], |c| c.wrench)
    }

    /// Largest |component| commanded while motion was measured.
    pub fn largest_wrench(&self) -> [f64; 6] {
        let end_s = self.end_s();
        self.commands
            .iter()
            .filter(|c| c.t_s <= end_s)
            .fold([0.0; 6], |m, c| {
                std::array::from_fn(|i| f64::max(m[i], c.wrench[i].abs()))
            })
    }

    /// Only the motion within `from_s ..= to_s`; the commands stay, since the past acts on.
    #[must_use]
    pub fn window(mut self, from_s: f64, to_s: f64) -> Run {
        self.samples.retain(|s| (from_s..=to_s).contains(&s.t_s));
        self
    }

    /// Whether the other run is the same recording: the same start, stamps and measured values, bit for bit.
    pub fn same_recording(&self, other: &Run) -> bool {
        let same = |(a, b): (&Sample, &Sample)| {
            let bits = |v: &PerChannel<f64>| v.map(f64::to_bits);
            a.t_s == b.t_s && bits(&a.values) == bits(&b.values)
        };
        self.start_ns == other.start_ns
            && self.samples.len() == other.samples.len()
            && self.samples.iter().zip(&other.samples).all(same)
    }

    /// Median of a channel; `None` where it was not measured.
    pub fn median(&self, channel: Channel) -> Option<f64> {
        median(&mut self.measured(channel).collect::<Vec<_>>())
    }

    /// Median distance of stamps \[s\]; `None` below two samples.
    pub fn interval_s(&self) -> Option<f64> {
        let mut gaps: Vec<f64> = self
            .samples
            .windows(2)
            .map(|w| w[1].t_s - w[0].t_s)
            .collect();
        median(&mut gaps)
    }
}

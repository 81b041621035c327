//! Runs: commands and measured motion of one log, in plain numbers.

mod companion;
mod joined;
mod load;
mod still;
mod vehicle;

use hydroline_numerics::statistics::median;

pub use companion::{COMPANIONS, Companions};
pub use joined::Joined;
pub use load::{LoadError, capacity, load, load_messages, unwrap_turns};
pub use still::{NOISE_KEY, STILL_MIN_S, StillNoise, StillWatch, is_still, still_noise};
pub use vehicle::{check_vehicle, differences};

/// The twelve channels of `/vehicle/motion`: pose in the tank frame, rates in the body frame.
pub const CHANNELS: [&str; 12] = [
    "x_m",
    "y_m",
    "z_m",
    "phi_rad",
    "theta_rad",
    "psi_rad",
    "u_mps",
    "v_mps",
    "w_mps",
    "p_radps",
    "q_radps",
    "r_radps",
];

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
    /// In the order of [`CHANNELS`]; NaN = not measured.
    pub values: [f64; 12],
    /// 6 x 6 row-major of the pose, SI; `None` = not known.
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
    /// What was measured beside the motion; it drives and is not explained.
    pub companions: Companions,
    /// Every thruster command carried its pulse: loads come from the rig's curves, not from the log.
    pub from_pulses: bool,
    /// Noise that the log carries from a stretch at rest; used where no run at rest is given itself.
    pub noise_at_rest: Option<StillNoise>,
    /// Motion and commands are of two clocks.
    pub joined: Option<Joined>,
    /// What was odd about the data, one sentence each.
    pub notes: Vec<String>,
}

/// What is known of every run's start before it is looked at.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Start {
    /// Nothing: place and velocity are free in each run.
    #[default]
    Free,
    /// At rest: the velocity is 0, the place is free.
    AtRest,
    /// At rest, and positions count from the first frame as the paper's x_i = (X_S,i − X_S,1) cos ψ_S do:
    /// place and velocity are 0. One-DOF models; the coupled one keeps its places free.
    AtRestFromZero,
}

impl Run {
    /// Samples in which this channel is measured.
    pub fn count(&self, channel: usize) -> usize {
        self.samples
            .iter()
            .filter(|s| s.values[channel].is_finite())
            .count()
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
            let bits = |v: &[f64; 12]| v.map(f64::to_bits);
            a.t_s == b.t_s && bits(&a.values) == bits(&b.values)
        };
        self.start_ns == other.start_ns
            && self.samples.len() == other.samples.len()
            && self.samples.iter().zip(&other.samples).all(same)
    }

    /// Median of a channel; `None` where it was not measured.
    pub fn median(&self, channel: usize) -> Option<f64> {
        let mut values: Vec<f64> = self
            .samples
            .iter()
            .map(|s| s.values[channel])
            .filter(|v| v.is_finite())
            .collect();
        median(&mut values)
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

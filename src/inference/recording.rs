//! What was measured: all channels of all runs, in the axes in which noise and random forces are described.
//!
//! Errors of x and y are looked at along the body's own axes (turned by the measured heading): there a DOF's misfit shows
//! in that DOF's channel. The turn is the same for every model, so that likelihoods compare.

use hydroline_identify::data::{CHANNELS, Run};
use hydroline_numerics::statistics::{median, robust_sd};

/// Motion that starts this late after the log's first stamp is a window of a longer log: its state is free, and time
/// begins there \[s\].
const START_SLACK_S: f64 = 1.0;

/// One run.
#[derive(Debug, Clone)]
pub struct Recorded {
    /// Name.
    pub name: String,
    /// Stamps \[s since the log's first stamp\].
    pub times_s: Vec<f64>,
    /// Where the state is given \[s\].
    pub start_s: f64,
    /// Measured channels (identify's order, SI), NaN = not measured.
    pub values: Vec<[f64; 12]>,
    /// Standard deviation of each pose channel as logged; NaN = unknown.
    pub logged_sd: Vec<[f64; 6]>,
    /// (time, body wrench), from `start_s` on.
    pub commands: Vec<(f64, [f64; 6])>,
    /// (sine, cosine) of the heading at each stamp.
    pub heading: Vec<(f64, f64)>,
}

/// All runs.
#[derive(Debug, Clone)]
pub struct Recording {
    /// Runs.
    pub runs: Vec<Recorded>,
    /// Which channels any run measured.
    pub channels: [bool; 12],
}

impl Recording {
    /// Takes runs over.
    ///
    /// `heading_rad` where psi was not measured.
    pub fn new(runs: &[Run], heading_rad: f64) -> Recording {
        let runs: Vec<Recorded> = runs.iter().map(|r| Recorded::new(r, heading_rad)).collect();
        let measured = |c: usize| {
            let any = |r: &Recorded| r.values.iter().any(|v| v[c].is_finite());
            runs.iter().any(any)
        };
        let channels = std::array::from_fn(measured);
        Recording { runs, channels }
    }

    /// Name of a channel.
    pub fn name(channel: usize) -> &'static str {
        CHANNELS[channel]
    }
}

/// Robust deviation of a channel from its median, over that of its fast part, from which a DOF is said to move.
const MOVES: f64 = 3.0;

impl Recording {
    /// DOFs that are driven, or move by more than their noise and a third of the tolerance.
    pub fn moving(&self, tolerance: &[f64; 12]) -> Vec<usize> {
        let driven = |d: usize| {
            let any = |r: &Recorded| r.commands.iter().any(|c| c.1[d] != 0.0);
            (self.channels[d] || self.channels[6 + d]) && self.runs.iter().any(any)
        };
        let moves = |c: usize| {
            self.channels[c]
                && self.runs.iter().any(|r| {
                    let mut seen: Vec<f64> = (0..r.values.len())
                        .map(|k| r.measured(k)[c])
                        .filter(|v| v.is_finite())
                        .collect();
                    let second: Vec<f64> =
                        seen.windows(3).map(|w| w[0] - 2.0 * w[1] + w[2]).collect();
                    let fast = robust_sd(&second) / 6f64.sqrt();
                    let middle = median(&mut seen).unwrap_or(0.0);
                    let off: Vec<f64> = seen.iter().map(|v| v - middle).collect();
                    robust_sd(&off) > (MOVES * fast).max(tolerance[c] / 3.0)
                })
        };
        (0..6)
            .filter(|d| driven(*d) || moves(*d) || moves(6 + d))
            .collect()
    }
}

impl Recorded {
    fn new(run: &Run, heading_rad: f64) -> Recorded {
        let times_s: Vec<f64> = run.samples.iter().map(|s| s.t_s).collect();
        let first_s = times_s.first().copied().unwrap_or(0.0);
        let start_s = if first_s > START_SLACK_S {
            first_s
        } else {
            0.0
        };
        let values: Vec<[f64; 12]> = run.samples.iter().map(|s| s.values).collect();
        let both = run.count(0) > 0 && run.count(1) > 0;
        let mut last = values.iter().map(|v| v[5]).find(|v| v.is_finite());
        let heading = values
            .iter()
            .map(|v| {
                if v[5].is_finite() {
                    last = Some(v[5]);
                }
                // One coordinate alone cannot be turned.
                let psi = if both {
                    last.unwrap_or(heading_rad)
                } else {
                    0.0
                };
                psi.sin_cos()
            })
            .collect();
        let logged_sd = run
            .samples
            .iter()
            .map(|s| {
                std::array::from_fn(|c| {
                    let variance = s.covariance.as_deref().map_or(f64::NAN, |p| p[7 * c]);
                    if variance > 0.0 {
                        variance.sqrt()
                    } else {
                        f64::NAN
                    }
                })
            })
            .collect();
        let mut commands: Vec<(f64, [f64; 6])> = vec![(start_s, run.wrench_at(start_s))];
        let later = run.commands.iter().filter(|c| c.t_s > start_s);
        commands.extend(later.map(|c| (c.t_s, c.wrench)));
        Recorded {
            name: run.name.clone(),
            times_s,
            start_s,
            values,
            logged_sd,
            commands,
            heading,
        }
    }

    /// A state's channels with x and y turned into the body's axes at sample `k`.
    pub fn turned<T: hydroline_sim::Real>(&self, k: usize, mut state: [T; 12]) -> [T; 12] {
        let (sin, cos) = self.heading[k];
        let (x, y) = (state[0], state[1]);
        state[0] = x * cos + y * sin;
        state[1] = y * cos - x * sin;
        state
    }

    /// What was measured at sample `k`, turned likewise; a heading of 0 leaves a single coordinate as it is.
    pub fn measured(&self, k: usize) -> [f64; 12] {
        let mut v = self.values[k];
        if v[0].is_finite() && v[1].is_finite() {
            v = self.turned(k, v);
        } else if self.heading[k].0 != 0.0 {
            // One of two is missing here: neither can be turned.
            v[0] = f64::NAN;
            v[1] = f64::NAN;
        }
        v
    }

    /// First finite value of a channel.
    pub fn first(&self, channel: usize) -> Option<f64> {
        self.values
            .iter()
            .map(|v| v[channel])
            .find(|v| v.is_finite())
    }
}

//! Columns that the kinematics know under another name: velocities of the tank's frame, rates of another angle.
//!
//! Positions are differentiated by the smoothing spline through them, so that noise decides nothing.

use hydroline_core::run::Channel::{P, Psi, U, V, X, Y};
use hydroline_core::run::{Channel, PerChannel, Run};
use hydroline_inference::smooth::smooth;
use hydroline_rigs::Rig;

use super::fault;
use crate::verdict::DataFault;

/// Factor by which a column has to fit another quantity better than the one that it is called.
const BETTER: f64 = 3.0;
/// Samples looked at: of more every second, third …
const SAMPLES: usize = 3000;

/// A run's channels at the samples looked at.
struct Columns {
    times_s: Vec<f64>,
    values: Vec<PerChannel<f64>>,
}

impl Columns {
    fn new(run: &Run) -> Columns {
        let every = run.samples.len().div_ceil(SAMPLES).max(1);
        let (times_s, values) = run
            .samples
            .iter()
            .step_by(every)
            .map(|s| (s.t_s, s.values))
            .unzip();
        Columns { times_s, values }
    }

    /// Whether a channel is measured nearly throughout.
    fn has(&self, channel: Channel) -> bool {
        let seen = self.values.iter().filter(|v| v[channel].is_finite());
        let count = seen.count();
        count > 20 && 2 * count > self.values.len()
    }

    /// Value and rate of a pose channel at each sample.
    fn smoothed(&self, channel: Channel) -> Option<Vec<[f64; 2]>> {
        let samples: Vec<[f64; 2]> = self.values.iter().map(|v| [v[channel], f64::NAN]).collect();
        let made = smooth(&self.times_s, &samples, 0.0)?;
        Some(made.states.iter().map(|s| [s[0], s[1]]).collect())
    }

    /// rms of a column beside what it may be.
    fn off(&self, channel: Channel, expected: impl Fn(usize) -> f64) -> f64 {
        let each = self.values.iter().enumerate();
        let off: Vec<f64> = each
            .map(|(k, v)| v[channel] - expected(k))
            .filter(|v| v.is_finite())
            .collect();
        (off.iter().map(|v| v * v).sum::<f64>() / off.len().max(1) as f64).sqrt()
    }
}

/// Faults of rates whose names kinematics contradict.
pub fn kinematics(run: &Run, rig: &Rig) -> Vec<DataFault> {
    let columns = Columns::new(run);
    let tolerance = rig.tolerance.channels();
    let mut found: Vec<DataFault> = frame(run, &columns, tolerance[U]).into_iter().collect();
    found.extend(other_angles(run, &columns, tolerance[P]));
    found
}

/// u and v that are dx/dt and dy/dt.
fn frame(run: &Run, columns: &Columns, tolerance_mps: f64) -> Option<DataFault> {
    if ![X, Y, Psi, U, V].iter().all(|c| columns.has(*c)) {
        return None;
    }
    let [x, y, psi] = [X, Y, Psi].map(|c| columns.smoothed(c));
    let (x, y, psi) = (x?, y?, psi?);
    let body = |k: usize| {
        let (sin, cos) = psi[k][0].sin_cos();
        (x[k][1] * cos + y[k][1] * sin, y[k][1] * cos - x[k][1] * sin)
    };
    let as_body = columns
        .off(U, |k| body(k).0)
        .hypot(columns.off(V, |k| body(k).1));
    let as_tank = columns
        .off(U, |k| x[k][1])
        .hypot(columns.off(V, |k| y[k][1]));
    (as_body > BETTER * as_tank && as_body > tolerance_mps).then(|| {
        fault(
            run,
            "frame",
            U.name(),
            format!(
                "{} and {} are dx/dt and dy/dt, velocities in the frame of the tank (to {as_tank:.2e} m/s); those of the hull (SNAME) differ from them by {as_body:.2e} m/s. Turn them by psi: u = vx cos psi + vy sin psi, v = vy cos psi - vx sin psi",
                U.name(),
                V.name()
            ),
            true,
        )
    })
}

/// A rate whose own angle is not measured and that is another angle's: with its own angle beside it the table's check finds it.
fn other_angles(run: &Run, columns: &Columns, tolerance_radps: f64) -> Vec<DataFault> {
    let turns = || [3, 4, 5].into_iter().map(Channel::of);
    let rates: Vec<Channel> = turns()
        .filter(|[angle, rate]| !columns.has(*angle) && columns.has(*rate))
        .map(|[_, rate]| rate)
        .collect();
    if rates.is_empty() {
        return Vec::new();
    }
    let angles: Vec<([Channel; 2], Vec<[f64; 2]>)> = turns()
        .filter(|[angle, _]| columns.has(*angle))
        .filter_map(|both| Some((both, columns.smoothed(both[0])?)))
        .collect();
    let is = |rate: Channel, angle: &[[f64; 2]]| {
        let off = columns.off(rate, |k| angle[k][1]);
        let size = columns.off(rate, |_| 0.0);
        size > BETTER * off && size > tolerance_radps
    };
    let mut found = Vec::new();
    for rate in rates {
        let other = angles.iter().find(|([_, own], angle)| {
            // Two columns of one rate: the one that is named like it has it.
            is(rate, angle) && !(columns.has(*own) && is(*own, angle))
        });
        if let Some(([turned, own], angle)) = other {
            let off = columns.off(rate, |k| angle[k][1]);
            let (name, real) = (rate.name(), own.name());
            let evidence = format!(
                "{name} is d({})/dt (to {off:.2e} rad/s), and so the rate {real}: columns swapped?",
                turned.name()
            );
            // Said of the DOF that moves.
            found.push(fault(run, "swapped_columns", real, evidence, true));
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use hydroline_core::run::Sample;

    /// A hull that turns while it drifts, its velocities in either frame, its yaw rate in a column of choice.
    fn run(tank: bool, rate: Channel) -> Run {
        let mut made = Run::default();
        let noise = |k: i32, c: i32| 1e-4 * f64::from((k * 7919 + c * 104_729) % 17 - 8) / 8.0;
        for k in 0..600 {
            let t = 0.05 * f64::from(k);
            let (psi, r) = (0.4 * (0.5 * t).sin(), 0.2 * (0.5 * t).cos());
            let (vx, vy) = (1.0 + 0.1 * (0.3 * t).cos(), 0.2 * (0.4 * t).sin());
            let (x, y) = (t + (0.3 * t).sin() / 3.0, -0.5 * (0.4 * t).cos());
            let (sin, cos) = psi.sin_cos();
            let mut values = PerChannel::NAN;
            (values[X], values[Y], values[Psi]) =
                (x + noise(k, 0), y + noise(k, 1), psi + noise(k, 2));
            (values[U], values[V]) = if tank {
                (vx, vy)
            } else {
                (vx * cos + vy * sin, vy * cos - vx * sin)
            };
            values[rate] = r + noise(k, 3);
            made.samples.push(Sample {
                t_s: t,
                values,
                covariance: None,
            });
        }
        made
    }

    #[test]
    fn velocities_of_the_tank_and_a_yaw_rate_called_p_are_reported() {
        let rig = Rig::builtin("lshpi").unwrap();
        let kinds = |run: &Run| -> Vec<String> {
            kinematics(run, &rig).into_iter().map(|f| f.fault).collect()
        };
        assert!(kinds(&run(false, Channel::R)).is_empty());
        assert_eq!(kinds(&run(true, Channel::R)), ["frame"]);
        assert_eq!(kinds(&run(false, P)), ["swapped_columns"]);
        let both = kinematics(&run(true, P), &rig);
        assert!(both[0].evidence.contains("frame of the tank"));
        assert!(both[1].evidence.contains("r_radps"), "{}", both[1].evidence);
        assert!(both.iter().all(|f| f.fatal));
    }
}

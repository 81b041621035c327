//! Columns that the kinematics know under another name: velocities of the tank's frame, rates of another angle.
//!
//! Positions are differentiated by the smoothing spline through them, so that noise decides nothing.

use hydroline_identify::data::{CHANNELS, Run};
use hydroline_inference::smooth::smooth;
use hydroline_rigs::Rig;

use super::fault;
use crate::verdict::DataFault;

/// How much better a column has to be another thing than what it is called.
const BETTER: f64 = 3.0;
/// Samples looked at: of more every second, third …
const SAMPLES: usize = 3000;

/// A run's channels at the samples looked at.
struct Columns {
    times_s: Vec<f64>,
    values: Vec<[f64; 12]>,
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
    fn has(&self, channel: usize) -> bool {
        let seen = self.values.iter().filter(|v| v[channel].is_finite());
        let count = seen.count();
        count > 20 && 2 * count > self.values.len()
    }

    /// Value and rate of a pose channel at each sample.
    fn smoothed(&self, channel: usize) -> Option<Vec<[f64; 2]>> {
        let samples: Vec<[f64; 2]> = self.values.iter().map(|v| [v[channel], f64::NAN]).collect();
        let made = smooth(&self.times_s, &samples, 0.0)?;
        Some(made.states.iter().map(|s| [s[0], s[1]]).collect())
    }

    /// rms of a column beside what it may be.
    fn off(&self, channel: usize, expected: impl Fn(usize) -> f64) -> f64 {
        let each = self.values.iter().enumerate();
        let off: Vec<f64> = each
            .map(|(k, v)| v[channel] - expected(k))
            .filter(|v| v.is_finite())
            .collect();
        (off.iter().map(|v| v * v).sum::<f64>() / off.len().max(1) as f64).sqrt()
    }
}

/// What kinematics say of the names of rates.
pub fn kinematics(run: &Run, rig: &Rig) -> Vec<DataFault> {
    let columns = Columns::new(run);
    let tolerance = rig.tolerance.channels();
    let mut found: Vec<DataFault> = frame(run, &columns, tolerance[6]).into_iter().collect();
    found.extend(other_angles(run, &columns, tolerance[9]));
    found
}

/// u and v that are dx/dt and dy/dt.
fn frame(run: &Run, columns: &Columns, tolerance_mps: f64) -> Option<DataFault> {
    if ![0, 1, 5, 6, 7].iter().all(|c| columns.has(*c)) {
        return None;
    }
    let [x, y, psi] = [0, 1, 5].map(|c| columns.smoothed(c));
    let (x, y, psi) = (x?, y?, psi?);
    let body = |k: usize| {
        let (sin, cos) = psi[k][0].sin_cos();
        (x[k][1] * cos + y[k][1] * sin, y[k][1] * cos - x[k][1] * sin)
    };
    let as_body = columns
        .off(6, |k| body(k).0)
        .hypot(columns.off(7, |k| body(k).1));
    let as_tank = columns
        .off(6, |k| x[k][1])
        .hypot(columns.off(7, |k| y[k][1]));
    (as_body > BETTER * as_tank && as_body > tolerance_mps).then(|| {
        fault(
            run,
            "frame",
            CHANNELS[6],
            format!(
                "{} and {} are dx/dt and dy/dt, velocities in the frame of the tank (to {as_tank:.2e} m/s); those of the hull (SNAME) differ from them by {as_body:.2e} m/s. Turn them by psi: u = vx cos psi + vy sin psi, v = vy cos psi - vx sin psi",
                CHANNELS[6], CHANNELS[7]
            ),
            true,
        )
    })
}

/// A rate whose own angle is not measured and that is another angle's: with its own angle beside it the table's check finds it.
fn other_angles(run: &Run, columns: &Columns, tolerance_radps: f64) -> Vec<DataFault> {
    let rates: Vec<usize> = (3..6)
        .filter(|d| !columns.has(*d) && columns.has(6 + d))
        .collect();
    if rates.is_empty() {
        return Vec::new();
    }
    let angles: Vec<(usize, Vec<[f64; 2]>)> = (3..6)
        .filter(|d| columns.has(*d))
        .filter_map(|d| Some((d, columns.smoothed(d)?)))
        .collect();
    let is = |rate: usize, angle: &[[f64; 2]]| {
        let (off, size) = (
            columns.off(6 + rate, |k| angle[k][1]),
            columns.off(6 + rate, |_| 0.0),
        );
        size > BETTER * off && size > tolerance_radps
    };
    let mut found = Vec::new();
    for rate in rates {
        let other = angles.iter().find(|(d, angle)| {
            // Two columns of one rate: the one that is named like it has it.
            is(rate, angle) && !(columns.has(6 + d) && is(*d, angle))
        });
        if let Some((d, angle)) = other {
            let off = columns.off(6 + rate, |k| angle[k][1]);
            let (name, real) = (CHANNELS[6 + rate], CHANNELS[6 + d]);
            let evidence = format!(
                "{name} is d({})/dt (to {off:.2e} rad/s), and so the rate {real}: columns swapped?",
                CHANNELS[*d]
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
    use hydroline_identify::data::Sample;

    /// A hull that turns while it drifts, its velocities in either frame, its yaw rate in a column of choice.
    fn run(tank: bool, rate: usize) -> Run {
        let mut made = Run::default();
        let noise = |k: i32, c: i32| 1e-4 * f64::from((k * 7919 + c * 104_729) % 17 - 8) / 8.0;
        for k in 0..600 {
            let t = 0.05 * f64::from(k);
            let (psi, r) = (0.4 * (0.5 * t).sin(), 0.2 * (0.5 * t).cos());
            let (vx, vy) = (1.0 + 0.1 * (0.3 * t).cos(), 0.2 * (0.4 * t).sin());
            let (x, y) = (t + (0.3 * t).sin() / 3.0, -0.5 * (0.4 * t).cos());
            let (sin, cos) = psi.sin_cos();
            let mut values = [f64::NAN; 12];
            (values[0], values[1], values[5]) =
                (x + noise(k, 0), y + noise(k, 1), psi + noise(k, 2));
            (values[6], values[7]) = if tank {
                (vx, vy)
            } else {
                (vx * cos + vy * sin, vy * cos - vx * sin)
            };
            values[6 + rate] = r + noise(k, 3);
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
        assert!(kinds(&run(false, 5)).is_empty());
        assert_eq!(kinds(&run(true, 5)), ["frame"]);
        assert_eq!(kinds(&run(false, 3)), ["swapped_columns"]);
        let both = kinematics(&run(true, 3), &rig);
        assert!(both[0].evidence.contains("frame of the tank"));
        assert!(both[1].evidence.contains("r_radps"), "{}", both[1].evidence);
        assert!(both.iter().all(|f| f.fatal));
    }
}

//! Is the column called r really dψ/dt? Every mapped rate against every pose channel's derivative.

use std::f64::consts::PI;

use super::{Finding, name};
use crate::attitude::to_body;
use crate::table::Imported;
use hydroline_identify::data::unwrap_turns;

/// Rows that are enough to say whether two channels agree.
const ROWS_COMPARED: usize = 20_000;

/// Slower than this velocities are not held against positions \[m/s\].
const SPEED_COMPARED_MPS: f64 = 0.05;

/// What the map says.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Assumed {
    /// Rows may leave channels out: they are compared with lines between the rows that do not.
    pub sparse: bool,
    /// The file's velocities were along the tank's axes, and have been turned.
    pub in_tank: bool,
}

/// What the pose says of each rate.
struct Expected {
    /// Per rate; `None` = its pose is not measured.
    rates: Vec<Option<Vec<f64>>>,
    /// Along the tank's axes.
    tank: Option<[Vec<f64>; 2]>,
    heading: Vec<f64>,
}

pub(super) fn check(data: &Imported, assumed: Assumed, findings: &mut Vec<Finding>) {
    let n = data.times_s.len();
    let has = |c: usize| data.motion[c].len() == n;
    if !(6..12).any(has) {
        wraps(data, findings);
        return;
    }
    let expected = expect(data, assumed, findings);
    // Every so many rows: a long table tells no more.
    let stride = n.div_ceil(ROWS_COMPARED);
    let turned = frame(data, &expected, assumed, stride, findings);
    for rate in (0..6).filter(|r| has(6 + r)) {
        if turned && rate < 3 {
            continue;
        }
        let Some(own) = &expected.rates[rate] else {
            continue;
        };
        let measured = &data.motion[6 + rate];
        let fit = agreement(own, measured, stride);
        let others = (0..6)
            .filter(|o| *o != rate)
            .filter_map(|o| {
                let e = expected.rates[o].as_ref()?;
                Some((o, agreement(e, measured, stride).0))
            })
            .max_by(|a, b| a.1.abs().total_cmp(&b.1.abs()));
        findings.push(words(rate, fit, others));
    }
}

fn words(rate: usize, (fit, gain): (f64, f64), others: Option<(usize, f64)>) -> Finding {
    let (name, pose) = (name(6 + rate), name(rate));
    if let Some((other, other_fit)) =
        others.filter(|(_, f)| f.abs() > 0.7 && f.abs() > fit.abs() + 0.3)
    {
        return Finding::fault(
            "swapped_columns",
            None,
            format!(
                "{name} follows d({})/dt (correlation {other_fit:.2}), not d({pose})/dt ({fit:.2}): columns swapped in the map?",
                self::name(other)
            ),
        );
    }
    if fit.abs() < 0.3 {
        return Finding::warning(
            "kinematics",
            None,
            format!(
                "{name} hardly follows d({pose})/dt (correlation {fit:.2}): wrong column, or noise only"
            ),
        );
    }
    if gain < 0.0 {
        return Finding::fault(
            "sign",
            None,
            format!(
                "{name} is -{:.2} times d({pose})/dt: one of them has the wrong sign",
                -gain
            ),
        );
    }
    if fit > 0.8 && !(0.8..=1.25).contains(&gain) {
        let degrees = 180.0 / PI;
        let hint = [
            (degrees, "degrees against radians"),
            (1.0 / degrees, "radians against degrees"),
            (1000.0, "mm against m"),
            (1e-3, "m against mm"),
            (3600.0 / 1852.0, "knots against m/s"),
            (1852.0 / 3600.0, "m/s against knots"),
            (1.0 / 0.3048, "feet against m"),
            (0.3048, "m against feet"),
            (3.6, "km/h against m/s"),
        ]
        .iter()
        .min_by(|a, b| (gain / a.0).ln().abs().total_cmp(&(gain / b.0).ln().abs()))
        .filter(|(g, _)| (gain / g - 1.0).abs() < 0.2)
        .map_or("a unit or a time unit", |h| h.1);
        return Finding::fault(
            "units",
            None,
            format!("{name} is {gain:.4} times d({pose})/dt: {hint}?"),
        );
    }
    Finding::info(
        "kinematics",
        format!("{name} is d({pose})/dt (correlation {fit:.2}, gain {gain:.3})"),
    )
}

/// An angle that wraps jumps by a whole turn, which is no rate.
fn wraps(data: &Imported, findings: &mut Vec<Finding>) -> Vec<Vec<f64>> {
    let mut pose: Vec<Vec<f64>> = data.motion[..6].to_vec();
    for (c, angle) in pose.iter_mut().enumerate().skip(3) {
        let jumps = unwrap_turns(angle.iter_mut());
        if jumps > 0 {
            findings.push(Finding::info(
                "angle_wraps",
                format!(
                    "{}: {jumps} jump(s) of a whole turn; the log keeps them, rates are compared with the angle continued without them",
                    name(c)
                ),
            ));
        }
    }
    pose
}

fn expect(data: &Imported, assumed: Assumed, findings: &mut Vec<Finding>) -> Expected {
    let n = data.times_s.len();
    let span = (n / 200).clamp(1, 10);
    let mut pose = wraps(data, findings);
    let has = |c: usize| pose[c].len() == n;
    let there: Vec<bool> = (0..6).map(has).collect();
    if assumed.sparse {
        for values in &mut pose {
            fill(values, &data.times_s);
        }
    }
    let derivative = |c: usize| -> Vec<f64> {
        (0..n)
            .map(|i| {
                let (a, b) = (i.saturating_sub(span), (i + span).min(n - 1));
                (pose[c][b] - pose[c][a]) / (data.times_s[b] - data.times_s[a])
            })
            .collect()
    };
    // Which frame velocities are in is told by the heading alone.
    let heading = if there[5] {
        pose[5].clone()
    } else {
        vec![0.0; n]
    };
    let mut rates: Vec<Option<Vec<f64>>> = vec![None; 6];
    let mut tank = None;
    // A vehicle that pitches heaves along its own axis while it surges; what is not measured of the attitude is 0.
    let angle = |c: usize, i: usize| if there[c] { pose[c][i] } else { 0.0 };
    if there[0] && there[1] {
        let (dx, dy) = (derivative(0), derivative(1));
        let dz = there[2].then(|| derivative(2));
        let body: Vec<[f64; 3]> = (0..n)
            .map(|i| {
                let down = dz.as_ref().map_or(0.0, |d| d[i]);
                to_body([3, 4, 5].map(|c| angle(c, i)), [dx[i], dy[i], down])
            })
            .collect();
        let along = |axis: usize| body.iter().map(|v| v[axis]).collect();
        rates[0] = Some(along(0));
        rates[1] = Some(along(1));
        rates[2] = dz.is_some().then(|| along(2));
        tank = Some([dx, dy]);
    } else if there[0] {
        rates[0] = Some(derivative(0));
    }
    for (c, own) in rates.iter_mut().enumerate().skip(2) {
        if own.is_none() {
            *own = there[c].then(|| derivative(c));
        }
    }
    Expected {
        rates,
        tank,
        heading,
    }
}

/// Straight lines over rows without a value.
fn fill(values: &mut [f64], times_s: &[f64]) {
    let mut last: Option<usize> = None;
    for i in 0..values.len() {
        if !values[i].is_finite() {
            continue;
        }
        if let Some(from) = last {
            let (v0, slope) = (
                values[from],
                (values[i] - values[from]) / (times_s[i] - times_s[from]),
            );
            for k in from + 1..i {
                values[k] = v0 + slope * (times_s[k] - times_s[from]);
            }
        }
        last = Some(i);
    }
}

/// Whether the file's velocities are in the other frame than the map says: a fault, and then nothing else is to be said of them.
fn frame(
    data: &Imported,
    expected: &Expected,
    assumed: Assumed,
    stride: usize,
    findings: &mut Vec<Finding>,
) -> bool {
    let n = data.times_s.len();
    let whole = [5, 6, 7].iter().all(|c| data.motion[*c].len() == n);
    let (Some([dx, dy]), true) = (&expected.tank, whole) else {
        return false;
    };
    // Squares: of the file's velocities, of their distance from what the map says they are, from the other.
    let (mut size, mut own, mut other) = (0.0, 0.0, 0.0);
    for i in (0..n).step_by(stride) {
        let (u, v, psi) = (data.motion[6][i], data.motion[7][i], expected.heading[i]);
        let body = (
            dx[i] * psi.cos() + dy[i] * psi.sin(),
            dy[i] * psi.cos() - dx[i] * psi.sin(),
        );
        if !(u + v + body.0 + body.1).is_finite() {
            continue;
        }
        // As they stand in the file.
        let file = if assumed.in_tank {
            (u * psi.cos() - v * psi.sin(), u * psi.sin() + v * psi.cos())
        } else {
            (u, v)
        };
        let away = |from: (f64, f64)| (file.0 - from.0).powi(2) + (file.1 - from.1).powi(2);
        let (stated, opposite) = if assumed.in_tank {
            (away((dx[i], dy[i])), away(body))
        } else {
            (away(body), away((dx[i], dy[i])))
        };
        size += file.0.powi(2) + file.1.powi(2);
        own += stated;
        other += opposite;
    }
    if !(other < 0.25 * own && other < 0.3 * size) {
        // Faster than noise, and still nothing like the way: a unit or an angle may be wrong.
        let rows = (n / stride).max(1) as f64;
        if own > 0.3 * size && size > rows * SPEED_COMPARED_MPS.powi(2) {
            findings.push(Finding::warning(
                "kinematics",
                None,
                format!(
                    "u_mps, v_mps: {:.0} % away from what the positions and the heading make: another frame, unit or heading?",
                    100.0 * (own / size).sqrt()
                ),
            ));
        }
        return false;
    }
    let (says, is) = if assumed.in_tank {
        ("tank", "body")
    } else {
        ("body", "tank")
    };
    findings.push(Finding::fault(
        "velocity_frame",
        None,
        format!(
            "u_mps, v_mps: the map says frame = \"{says}\", but they follow the positions as velocities in the {is}'s frame do (residual {:.0} % instead of {:.0} %): frame = \"{is}\"?",
            100.0 * (other / size).sqrt(),
            100.0 * (own / size).sqrt()
        ),
    ));
    true
}

/// Correlation and least-squares gain of b on a, NaN pairs left out.
fn agreement(a: &[f64], b: &[f64], stride: usize) -> (f64, f64) {
    let pairs: Vec<(f64, f64)> = a
        .iter()
        .zip(b)
        .step_by(stride)
        .map(|(x, y)| (*x, *y))
        .filter(|p| p.0.is_finite() && p.1.is_finite())
        .collect();
    let n = pairs.len().max(1) as f64;
    let (ma, mb) = (
        pairs.iter().map(|p| p.0).sum::<f64>() / n,
        pairs.iter().map(|p| p.1).sum::<f64>() / n,
    );
    let (mut aa, mut bb, mut ab) = (0.0, 0.0, 0.0);
    for (x, y) in pairs {
        aa += (x - ma).powi(2);
        bb += (y - mb).powi(2);
        ab += (x - ma) * (y - mb);
    }
    if aa <= 0.0 || bb <= 0.0 {
        (0.0, 0.0)
    } else {
        (ab / (aa * bb).sqrt(), ab / aa)
    }
}

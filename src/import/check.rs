//! Findings about a table in SI: time, kinematics, units, dead channels.

mod commands;

use std::f64::consts::{FRAC_PI_2, PI};

use hydroline_rigs::Rig;

use super::map::Map;
use super::table::Imported;
use hydroline_identify::data::{CHANNELS, unwrap_turns};
use hydroline_numerics::statistics::median;

/// Equal rows that a moving channel does not have.
pub const STUCK_ROWS: usize = 25;

/// How bad.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Severity {
    /// Good to know.
    Info,
    /// Looks wrong; nothing is lost.
    Warning,
    /// Is wrong, or would lose data: stops the import unless accepted.
    Fault,
}

/// One finding.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Finding {
    /// How bad.
    pub severity: Severity,
    /// Stable machine word.
    pub kind: &'static str,
    /// First line of the file it concerns.
    pub line: Option<u64>,
    /// For a person: what, where, what to do.
    pub message: String,
}

impl Finding {
    pub(super) fn fault(kind: &'static str, line: Option<u64>, message: String) -> Self {
        Finding {
            severity: Severity::Fault,
            kind,
            line,
            message,
        }
    }
    pub(super) fn warning(kind: &'static str, line: Option<u64>, message: String) -> Self {
        Finding {
            severity: Severity::Warning,
            kind,
            line,
            message,
        }
    }
    fn info(kind: &'static str, message: String) -> Self {
        Finding {
            severity: Severity::Info,
            kind,
            line: None,
            message,
        }
    }
}

/// Adds what the numbers show; commands are held against `rig` where one is given.
pub(super) fn check(data: &Imported, map: &Map, rig: Option<&Rig>, findings: &mut Vec<Finding>) {
    check_motion(data, findings);
    commands::check(data, map, rig, findings);
    if data.times_s.len() >= 4 {
        names(map, findings);
    }
    let sds = |range: std::ops::Range<usize>| -> Vec<usize> {
        let channels = map.channels();
        let given = |c: &usize| channels.iter().any(|(p, m, _)| p == c && m.sd.is_some());
        range.filter(given).collect()
    };
    // A log's covariance is one of all six numbers of the pose.
    let (mut ignored, pose) = (sds(6..12), sds(0..6));
    if pose.len() < 6 {
        ignored.extend(pose);
    }
    if !ignored.is_empty() {
        let names: Vec<&str> = ignored.iter().map(|c| CHANNELS[*c]).collect();
        findings.push(Finding::warning(
            "sd_ignored",
            None,
            format!(
                "sd of {}: not written, a log holds the covariance of all six pose channels or none; identify estimates the noise from a run at rest or the residuals",
                names.join(", ")
            ),
        ));
    }
}

/// The same for motion that came without a map (a log): time, units, dead channels, kinematics.
pub fn check_motion(data: &Imported, findings: &mut Vec<Finding>) {
    if data.times_s.len() < 4 {
        findings.push(Finding::fault(
            "too_short",
            None,
            format!(
                "{} usable row(s); at least 4 are needed",
                data.times_s.len()
            ),
        ));
        return;
    }
    time(data, findings);
    drift(data, findings);
    for (place, values) in data
        .motion
        .iter()
        .enumerate()
        .filter(|(_, v)| !v.is_empty())
    {
        channel(place, values, data, findings);
    }
    kinematics(data, findings);
}

fn time(data: &Imported, findings: &mut Vec<Finding>) {
    let steps: Vec<f64> = data.times_s.windows(2).map(|w| w[1] - w[0]).collect();
    let line = |i: usize| data.lines.get(i + 1).copied();
    let mut positive: Vec<f64> = steps.iter().copied().filter(|d| *d > 0.0).collect();
    let Some(interval_s) = median(&mut positive) else {
        findings.push(Finding::fault(
            "time_stands",
            None,
            "time never advances; is time.column right?".to_owned(),
        ));
        return;
    };
    findings.push(Finding::info(
        "rate",
        format!(
            "{} rows, {:.3} s, every {:.4} s ({:.2}/s)",
            data.times_s.len(),
            data.times_s.last().unwrap_or(&0.0) - data.times_s.first().unwrap_or(&0.0),
            interval_s,
            1.0 / interval_s
        ),
    ));
    if !(1e-4..=10.0).contains(&interval_s) {
        findings.push(Finding::fault(
            "time_unit",
            None,
            format!("rows are {interval_s:.3e} s apart; is time.unit right?"),
        ));
    }
    // An hour or more to the second: a change of zone or of daylight saving time.
    let hours = |d: f64| (d / 1800.0).round();
    let zone_jump =
        |d: f64| hours(d).abs() >= 1.0 && (d - hours(d) * 1800.0).abs() < 5.0 * interval_s;
    if let Some(i) = steps.iter().position(|d| zone_jump(*d)) {
        findings.push(Finding::fault(
            "time_zone_jump",
            line(i),
            format!(
                "time jumps by {:+.1} h on line {}: time zones or daylight saving mixed?",
                hours(steps[i]) / 2.0,
                line(i).unwrap_or(0)
            ),
        ));
    }
    let back: Vec<usize> = (0..steps.len())
        .filter(|i| steps[*i] < 0.0 && !zone_jump(steps[*i]))
        .collect();
    if let Some(first) = back.first() {
        findings.push(Finding::fault(
            "time_backwards",
            line(*first),
            format!(
                "time goes back {} time(s), first by {:.4} s on line {}",
                back.len(),
                -steps[*first],
                line(*first).unwrap_or(0)
            ),
        ));
    }
    let repeated: Vec<usize> = (0..steps.len()).filter(|i| steps[*i] == 0.0).collect();
    if let Some(first) = repeated.first() {
        findings.push(Finding::fault(
            "repeated_stamps",
            line(*first),
            format!(
                "{} stamp(s) repeat the one before, the first on line {}",
                repeated.len(),
                line(*first).unwrap_or(0)
            ),
        ));
    }
    let gaps: Vec<usize> = (0..steps.len())
        .filter(|i| steps[*i] > 1.6 * interval_s && !zone_jump(steps[*i]))
        .collect();
    if let Some(first) = gaps.first() {
        let longest = gaps.iter().map(|i| steps[*i]).fold(0.0, f64::max);
        let lost: f64 = gaps
            .iter()
            .map(|i| (steps[*i] / interval_s).round() - 1.0)
            .sum();
        findings.push(Finding::warning("gaps", line(*first), format!("{} gap(s), about {lost:.0} row(s) missing, the longest {longest:.3} s, the first before line {}", gaps.len(), line(*first).unwrap_or(0))));
    }
    let third = steps.len() / 3;
    if third > 20 {
        let part = |s: &[f64]| median(&mut s.to_vec()).unwrap_or(interval_s);
        let (head, tail) = (part(&steps[..third]), part(&steps[2 * third..]));
        if (tail / head - 1.0).abs() > 0.1 {
            findings.push(Finding::warning(
                "rate_changes",
                None,
                format!("rows are {head:.4} s apart at the start and {tail:.4} s at the end"),
            ));
        }
    }
}

fn drift(data: &Imported, findings: &mut Vec<Finding>) {
    let pairs: Vec<(f64, f64)> = data
        .times_s
        .iter()
        .zip(&data.compare_s)
        .map(|(a, b)| (*a, *b))
        .filter(|p| p.1.is_finite())
        .collect();
    if pairs.len() < 4 {
        return;
    }
    let slope = slope(&pairs);
    let ppm = (slope - 1.0) * 1e6;
    if ppm.abs() > 1e5 {
        findings.push(Finding::fault(
            "compare_unit",
            None,
            format!("the second clock runs {slope:.4} times as fast; is time.compare_unit right?"),
        ));
    } else if ppm.abs() > 20.0 {
        findings.push(Finding::warning(
            "clock_drift",
            None,
            format!("the second clock gains {ppm:.0} ppm on the time column"),
        ));
    } else {
        findings.push(Finding::info(
            "clock_drift",
            format!("the clocks agree within {ppm:.1} ppm"),
        ));
    }
}

fn slope(pairs: &[(f64, f64)]) -> f64 {
    let n = pairs.len() as f64;
    let (mx, my) = (
        pairs.iter().map(|p| p.0).sum::<f64>() / n,
        pairs.iter().map(|p| p.1).sum::<f64>() / n,
    );
    let (sxy, sxx) = pairs.iter().fold((0.0, 0.0), |(a, b), p| {
        (a + (p.0 - mx) * (p.1 - my), b + (p.0 - mx).powi(2))
    });
    sxy / sxx
}

fn channel(place: usize, values: &[f64], data: &Imported, findings: &mut Vec<Finding>) {
    let name = CHANNELS[place];
    let present: Vec<f64> = values.iter().copied().filter(|v| v.is_finite()).collect();
    let (low, high) = present
        .iter()
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| {
            (l.min(*v), h.max(*v))
        });
    if present.is_empty() {
        findings.push(Finding::fault(
            "empty_channel",
            None,
            format!("{name}: no usable value"),
        ));
        return;
    }
    if low == high {
        findings.push(Finding::warning(
            "dead_channel",
            None,
            format!("{name}: always {low}; a dead channel? Leave it out of the map if so"),
        ));
        return;
    }
    // Stuck: the same value for a second and so many rows in a channel that else changes with nearly every row.
    let changes = values.windows(2).filter(|w| w[0] != w[1]).count() as f64 / values.len() as f64;
    let (mut longest, mut run, mut at) = (0, 0, 0);
    for i in 1..values.len() {
        run = if values[i] == values[i - 1] {
            run + 1
        } else {
            0
        };
        if run > longest {
            (longest, at) = (run, i - run);
        }
    }
    if longest >= STUCK_ROWS && changes > 0.5 && data.times_s[at + longest] - data.times_s[at] > 1.0
    {
        findings.push(Finding::warning(
            "stuck_channel",
            data.lines.get(at).copied(),
            format!(
                "{name}: stands at {} for {} rows from line {}",
                values[at],
                longest + 1,
                data.lines[at]
            ),
        ));
    }
    match place {
        3 | 4 if high.abs().max(low.abs()) > 1.2 * FRAC_PI_2 => findings.push(Finding::fault("units", None, format!("{name}: reaches {:.2} rad ({:.0} deg), beyond any roll or pitch of a hull: degrees mapped as rad?", high.abs().max(low.abs()), high.abs().max(low.abs()).to_degrees()))),
        5 if high - low > 8.0 * PI => findings.push(Finding::fault("units", None, format!("{name}: turns by {:.1} rad: degrees mapped as rad?", high - low))),
        0..3 => {
            let (speed, far) = (largest_speed(&data.times_s, values), high - low);
            if speed > 15.0 || far > 500.0 {
                findings.push(Finding::fault("units", None, format!("{name}: covers {far:.1} m at up to {speed:.1} m/s: millimetres mapped as m?")));
            } else if far < 1e-5 {
                findings.push(Finding::warning("units", None, format!("{name}: moves by {far:.1e} m in all: metres mapped as mm?")));
            }
        }
        6..9 if high.abs().max(low.abs()) > 15.0 => findings.push(Finding::fault("units", None, format!("{name}: reaches {:.1} m/s: mm/s mapped as m/s?", high.abs().max(low.abs())))),
        9..12 if high.abs().max(low.abs()) > 12.0 => findings.push(Finding::fault("units", None, format!("{name}: reaches {:.1} rad/s: deg/s mapped as rad/s?", high.abs().max(low.abs())))),
        _ => {}
    }
}

/// Largest speed held over ten rows: single outliers do not count.
fn largest_speed(times_s: &[f64], values: &[f64]) -> f64 {
    let span = 10.min(times_s.len() - 1);
    let speeds = (0..times_s.len() - span)
        .map(|i| ((values[i + span] - values[i]) / (times_s[i + span] - times_s[i])).abs());
    let mut speeds: Vec<f64> = speeds.filter(|s| s.is_finite()).collect();
    speeds.sort_by(f64::total_cmp);
    speeds.get(speeds.len() * 95 / 100).copied().unwrap_or(0.0)
}

/// Is the column called r really d(psi)/dt? Every mapped rate against every pose channel's derivative.
fn kinematics(data: &Imported, findings: &mut Vec<Finding>) {
    let n = data.times_s.len();
    let has = |c: usize| data.motion[c].len() == n;
    let span = (n / 200).clamp(1, 10);
    // An angle that wraps jumps by a whole turn, which is no rate.
    let mut pose: Vec<Vec<f64>> = data.motion[..6].to_vec();
    for c in (3..6).filter(|c| has(*c)) {
        let jumps = unwrap_turns(pose[c].iter_mut());
        if jumps > 0 {
            findings.push(Finding::info(
                "angle_wraps",
                format!(
                    "{}: {jumps} jump(s) of a whole turn; the log keeps them, rates are compared with the angle continued without them",
                    CHANNELS[c]
                ),
            ));
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
    // Body velocities from tank positions: R^T of heading only (small roll and pitch).
    let psi = |i: usize| if has(5) { data.motion[5][i] } else { 0.0 };
    let mut expected: Vec<Option<Vec<f64>>> = vec![None; 6];
    if has(0) && has(1) {
        let (dx, dy) = (derivative(0), derivative(1));
        expected[0] = Some(
            (0..n)
                .map(|i| dx[i] * psi(i).cos() + dy[i] * psi(i).sin())
                .collect(),
        );
        expected[1] = Some(
            (0..n)
                .map(|i| dy[i] * psi(i).cos() - dx[i] * psi(i).sin())
                .collect(),
        );
    } else if has(0) {
        expected[0] = Some(derivative(0));
    }
    for (c, own) in expected.iter_mut().enumerate().skip(2) {
        *own = has(c).then(|| derivative(c));
    }
    for rate in (0..6).filter(|r| has(6 + r)) {
        let Some(own) = &expected[rate] else { continue };
        let measured = &data.motion[6 + rate];
        let (fit, gain) = agreement(own, measured);
        let (name, pose) = (CHANNELS[6 + rate], CHANNELS[rate]);
        let better = (0..6)
            .filter(|o| *o != rate)
            .filter_map(|o| expected[o].as_ref().map(|e| (o, agreement(e, measured))))
            .max_by(|a, b| a.1.0.abs().total_cmp(&b.1.0.abs()));
        if let Some((other, (other_fit, _))) =
            better.filter(|(_, (f, _))| f.abs() > 0.7 && f.abs() > fit.abs() + 0.3)
        {
            findings.push(Finding::fault("swapped_columns", None, format!("{name} follows d({})/dt (correlation {other_fit:.2}), not d({pose})/dt ({fit:.2}): columns swapped in the map?", CHANNELS[other])));
        } else if fit.abs() < 0.3 {
            findings.push(Finding::warning("kinematics", None, format!("{name} hardly follows d({pose})/dt (correlation {fit:.2}): wrong column, or noise only")));
        } else if gain < 0.0 {
            findings.push(Finding::fault(
                "sign",
                None,
                format!(
                    "{name} is -{:.2} times d({pose})/dt: one of them has the wrong sign",
                    -gain
                ),
            ));
        } else if fit > 0.8 && !(0.8..=1.25).contains(&gain) {
            let degrees = 180.0 / PI;
            let hint = [
                (degrees, "degrees against radians"),
                (1.0 / degrees, "radians against degrees"),
                (1000.0, "mm against m"),
                (1e-3, "m against mm"),
            ]
            .iter()
            .find(|(g, _)| (gain / g - 1.0).abs() < 0.2)
            .map_or("a unit or a time unit", |h| h.1);
            findings.push(Finding::fault(
                "units",
                None,
                format!("{name} is {gain:.4} times d({pose})/dt: {hint}?"),
            ));
        } else {
            findings.push(Finding::info(
                "kinematics",
                format!("{name} is d({pose})/dt (correlation {fit:.2}, gain {gain:.3})"),
            ));
        }
    }
}

/// Correlation and least-squares gain of b on a, NaN pairs left out.
fn agreement(a: &[f64], b: &[f64]) -> (f64, f64) {
    let pairs: Vec<(f64, f64)> = a
        .iter()
        .zip(b)
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

/// A column named like another channel than the one it is mapped to.
fn names(map: &Map, findings: &mut Vec<Finding>) {
    const PLAIN: [&str; 12] = [
        "x", "y", "z", "phi", "theta", "psi", "u", "v", "w", "p", "q", "r",
    ];
    const WORDS: [(&str, usize); 3] = [("roll", 3), ("pitch", 4), ("yaw", 5)];
    for (place, channel, _) in map.channels() {
        let name = channel.column.to_ascii_lowercase();
        let known = PLAIN
            .iter()
            .position(|p| *p == name)
            .or_else(|| CHANNELS.iter().position(|c| *c == name));
        let known = known.or_else(|| WORDS.iter().find(|(w, _)| *w == name).map(|w| w.1));
        if let Some(known) = known.filter(|k| *k != place) {
            findings.push(Finding::warning(
                "column_name",
                None,
                format!(
                    "column '{}' is mapped to {} though it is named like {}",
                    channel.column, CHANNELS[place], CHANNELS[known]
                ),
            ));
        }
    }
}

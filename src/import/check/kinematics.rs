//! Is the column called r really dψ/dt? Every mapped rate against every pose channel's change over the same spans.

mod agreement;
mod series;
mod spans;
mod tracks;

use std::f64::consts::PI;

use super::{Finding, name};
use crate::table::Imported;
use agreement::{Agreement, MOVES, Verdict};
use hydroline_identify::data::unwrap_turns;
use tracks::{Tracks, Vector};

/// Rows that are enough to say whether two channels agree.
const ROWS_COMPARED: usize = 20_000;
/// Slower than this velocities are not held against positions \[m/s\].
const SPEED_COMPARED_MPS: f64 = 0.05;
/// Gains that pass: calibrations differ, units by more.
const GAINS: [f64; 2] = [0.8, 1.25];
/// The same of two values that stand still, which a bias or a current may be part of.
const GAINS_STEADY: [f64; 2] = [0.5, 2.0];
/// A correlation from which on a sign or a unit can be told, and one below which nothing follows.
const FOLLOWS: f64 = 0.5;
const APART: f64 = 0.3;
/// A rate that is another channel's follows that one so well, and better than its own by so much.
const SWAPPED: f64 = 0.7;
const BETTER: f64 = 0.3;
/// Share of the way's mean square that velocities are away if they are nothing like it, and what they come closer in the right frame.
const AWAY: f64 = 0.3;
const CLOSER: f64 = 0.25;
/// Share that velocities in the wrong frame are away at least: a heading that is off by 8 degrees makes as much.
const AWAY_SOMEWHAT: f64 = 0.02;

/// What the map says.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Assumed {
    /// Rows may leave channels out: they are compared with lines between the rows that do not.
    pub sparse: bool,
    /// The file's velocities were along the tank's axes, and have been turned.
    pub in_tank: bool,
}

pub(super) fn check(data: &Imported, assumed: Assumed, findings: &mut Vec<Finding>) {
    let n = data.times_s.len();
    let pose = wraps(data, findings);
    if !(6..12).any(|c| data.motion[c].len() == n) {
        return;
    }
    let tracks = Tracks::new(data, pose, assumed);
    velocities(&tracks, assumed, findings);
    rates(&tracks, findings);
}

fn velocities(tracks: &Tracks<'_>, assumed: Assumed, findings: &mut Vec<Finding>) {
    let level = tracks.has_pose(0) && tracks.has_pose(1);
    let tank = level.then(|| tracks.in_tank());
    if tank
        .as_ref()
        .is_some_and(|tank| frame(tracks, tank, assumed, findings))
    {
        return;
    }
    let direct = tracks.direct(0);
    for rate in (0..3).filter(|r| tracks.has_rate(*r)) {
        let of = |axis: usize| -> Option<Agreement> {
            if !tracks.has_pose(axis) {
                return None;
            }
            match &tank {
                Some(tank) => Some(tracks.velocity(rate, axis, tank)),
                // A way along one axis alone is the body's.
                None => (axis != 1).then(|| tracks.scalar(rate, axis, &direct)),
            }
        };
        if let Some(own) = of(rate) {
            let others = (0..3).filter(|o| *o != rate);
            findings.push(words(rate, own, others.filter_map(|o| Some((o, of(o)?)))));
        }
    }
}

fn rates(tracks: &Tracks<'_>, findings: &mut Vec<Finding>) {
    let (raw, together) = (tracks.direct(1), tracks.of_angles());
    let whole = (3..6).all(|c| tracks.has_pose(c) && tracks.has_rate(c));
    for rate in (3..6).filter(|r| tracks.has_rate(*r)) {
        let of = |axis: usize, sums: &Vector| {
            tracks
                .has_pose(axis)
                .then(|| tracks.scalar(rate, axis, sums))
        };
        let Some(own) = of(rate, &raw) else {
            continue;
        };
        // A vehicle that is heeled turns by its pitch rate too; where angles are in another unit only the rate itself tells.
        let coupled = whole.then(|| of(rate, &together)).flatten();
        let own = coupled.filter(|c| c.fit() > own.fit()).unwrap_or(own);
        let others = (3..6).filter(|o| *o != rate);
        findings.push(words(
            rate,
            own,
            others.filter_map(|o| Some((o, of(o, &raw)?))),
        ));
    }
}

/// The other channel that a rate follows as if it were that one's.
fn swapped(
    own: &Agreement,
    others: impl Iterator<Item = (usize, Agreement)>,
) -> Option<(usize, f64)> {
    let apart = matches!(own.verdict(), Verdict::Apart { .. });
    if !(own.pose_moves() || apart) {
        return None;
    }
    let is_like = |from: f64, to: f64| to >= GAINS_STEADY[0] && from <= GAINS_STEADY[1];
    others
        .filter(|(_, a)| {
            let (from, to) = a.gains();
            let fit = a.fit().abs();
            a.pose_moves()
                && fit > SWAPPED
                && fit > own.fit().abs() + BETTER
                && (is_like(from, to) || is_like(-to, -from))
        })
        .map(|(other, a)| (other, a.fit()))
        .max_by(|a, b| a.1.abs().total_cmp(&b.1.abs()))
}

fn words(rate: usize, own: Agreement, others: impl Iterator<Item = (usize, Agreement)>) -> Finding {
    let (name, pose) = (name(6 + rate), name(rate));
    if let Some((other, other_fit)) = swapped(&own, others) {
        return Finding::fault(
            "swapped_columns",
            None,
            format!(
                "{name} follows d({})/dt (correlation {other_fit:.2}), not d({pose})/dt ({:.2}): columns swapped in the map?",
                self::name(other),
                own.fit()
            ),
        );
    }
    let apart = |fit: f64| {
        Finding::warning(
            "kinematics",
            None,
            format!(
                "{name} hardly follows d({pose})/dt (correlation {fit:.2}): wrong column, or noise only"
            ),
        )
    };
    let sign = |gain: f64| {
        Finding::fault(
            "sign",
            None,
            format!(
                "{name} is -{:.2} times d({pose})/dt: one of them has the wrong sign",
                gain.abs()
            ),
        )
    };
    let units = |gain: f64| {
        Finding::fault(
            "units",
            None,
            format!("{name} is {gain:.4} times d({pose})/dt: {}?", hint(gain)),
        )
    };
    match own.verdict() {
        Verdict::TooLittle => Finding::info(
            "kinematics",
            format!("{name} and d({pose})/dt: too little motion to hold one against the other"),
        ),
        Verdict::Apart { fit } => apart(fit),
        Verdict::Follows { fit, .. } if fit.abs() < APART => apart(fit),
        Verdict::Follows { fit, gain, to, .. } if fit < -FOLLOWS && to < 0.0 => sign(gain),
        Verdict::Follows {
            fit,
            gain,
            from,
            to,
        } if fit > FOLLOWS && (from > GAINS[1] || to < GAINS[0]) => units(gain),
        Verdict::Steady { ratio } if ratio < 0.0 => sign(ratio),
        Verdict::Steady { ratio } if !(GAINS_STEADY[0]..=GAINS_STEADY[1]).contains(&ratio) => {
            units(ratio)
        }
        Verdict::Steady { ratio } => Finding::info(
            "kinematics",
            format!("{name} is d({pose})/dt (both steady, gain {ratio:.3})"),
        ),
        Verdict::Follows { fit, gain, .. } => Finding::info(
            "kinematics",
            format!("{name} is d({pose})/dt (correlation {fit:.2}, gain {gain:.3})"),
        ),
    }
}

/// What a gain may come from.
fn hint(gain: f64) -> &'static str {
    let degrees = 180.0 / PI;
    [
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
    .map_or("a unit or a time unit", |h| h.1)
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

/// Whether the file's velocities are in the other frame than the map says: a fault, and then nothing else is to be said of them.
fn frame(
    tracks: &Tracks<'_>,
    tank: &Vector,
    assumed: Assumed,
    findings: &mut Vec<Finding>,
) -> bool {
    if !(tracks.has_pose(5) && tracks.has_rate(0) && tracks.has_rate(1)) {
        return false;
    }
    let other = tracks.in_other_frame(assumed);
    let Some(seen) = tracks.distances(tank, &other) else {
        return false;
    };
    // What is away by no more than noise and sampling make says nothing.
    let unexplained = MOVES * seen.noise + seen.unresolved;
    if seen.own <= unexplained || seen.own <= AWAY_SOMEWHAT * seen.way {
        return false;
    }
    let share = |of: f64| 100.0 * (of / seen.way).sqrt();
    if seen.other >= CLOSER * seen.own || seen.other >= AWAY * seen.way {
        // Faster than noise, and still nothing like the way: a unit or an angle may be wrong.
        if seen.own > AWAY * seen.way && seen.way.max(seen.own) > SPEED_COMPARED_MPS.powi(2) {
            findings.push(Finding::warning(
                "kinematics",
                None,
                format!(
                    "u_mps, v_mps: {:.0} % away from what the positions and the heading make: another frame, unit or heading?",
                    share(seen.own)
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
            share(seen.other),
            share(seen.own)
        ),
    ));
    true
}

//! Is the column called r really dψ/dt? Every mapped rate against every pose channel's change over the same spans.

mod agreement;
mod series;
mod spans;
mod tracks;

use std::f64::consts::PI;

use super::{Finding, FindingList, Options, name};
use crate::table::Imported;
use agreement::{Agreement, Verdict};
use hydroline_identify::data::unwrap_turns;
use spans::Distances;
use tracks::{Tracks, Vector};

/// Assumptions that the map makes about rows and velocities.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Assumed {
    /// Rows may leave channels out: they are compared with lines between the rows that do not.
    pub sparse: bool,
    /// The file's velocities were along the tank's axes, and have been rotated.
    pub in_tank: bool,
}

pub(super) fn check(
    data: &Imported,
    assumed: Assumed,
    options: &Options,
    findings: &mut Vec<Finding>,
) {
    let n = data.times_s.len();
    let pose = wraps(data, findings);
    if !(6..12).any(|c| data.motion[c].len() == n) {
        return;
    }
    let tracks = Tracks::new(data, pose, assumed, options);
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
        let of = |axis: usize| -> Option<Agreement<'_>> {
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
fn swapped<'a>(
    own: &Agreement<'a>,
    others: impl Iterator<Item = (usize, Agreement<'a>)>,
) -> Option<(usize, f64)> {
    let options = own.options;
    let apart = matches!(own.verdict(), Verdict::Apart { .. });
    if !(own.pose_moves() || apart) {
        return None;
    }
    let is_like =
        |from: f64, to: f64| to >= options.gains_steady[0] && from <= options.gains_steady[1];
    others
        .filter(|(_, a)| {
            let (from, to) = a.gains();
            let fit = a.fit().abs();
            a.pose_moves()
                && fit > options.swapped_correlation
                && fit > own.fit().abs() + options.better_correlation
                && (is_like(from, to) || is_like(-to, -from))
        })
        .map(|(other, a)| (other, a.fit()))
        .max_by(|a, b| a.1.abs().total_cmp(&b.1.abs()))
}

fn words<'a>(
    rate: usize,
    own: Agreement<'a>,
    others: impl Iterator<Item = (usize, Agreement<'a>)>,
) -> Finding {
    let options = own.options;
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
        Verdict::Follows { fit, .. } if fit.abs() < options.apart_correlation => apart(fit),
        Verdict::Follows { fit, gain, to, .. }
            if fit < -options.follows_correlation && to < 0.0 =>
        {
            sign(gain)
        }
        Verdict::Follows {
            fit,
            gain,
            from,
            to,
        } if fit > options.follows_correlation
            && (from > options.gains[1] || to < options.gains[0]) =>
        {
            units(gain)
        }
        Verdict::Steady { ratio } if ratio < 0.0 => sign(ratio),
        Verdict::Steady { ratio }
            if !(options.gains_steady[0]..=options.gains_steady[1]).contains(&ratio) =>
        {
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

/// Likely cause of a gain, for the message.
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
            findings.info(
                "angle_wraps",
                format!(
                    "{}: {jumps} jump(s) of a whole turn; the log keeps them, rates are compared with the angle continued without them",
                    name(c),
                ),
            );
        }
    }
    pose
}

/// Finding where both frames fit, since the heading hardly leaves the tank's axis; `clear` = they are away by more than noise.
fn untold(tracks: &Tracks<'_>, seen: &Distances, assumed: Assumed, clear: bool) -> Finding {
    let (says, other) = if assumed.in_tank {
        ("tank", "body")
    } else {
        ("body", "tank")
    };
    let from_axis = |a: &f64| ((a + PI).rem_euclid(2.0 * PI) - PI).abs();
    let yaw = tracks.pose[5]
        .iter()
        .filter(|a| a.is_finite())
        .map(from_axis);
    let yaw = yaw.fold(0.0, f64::max);
    // A vector and itself rotated by an angle differ by 2 sin(angle / 2) of its length.
    let (apart, speed) = (2.0 * (0.5 * yaw).sin(), seen.way.sqrt());
    let words = format!(
        "u_mps, v_mps: the positions do not tell the body's frame from the tank's: the heading stays within {:.1} deg of the tank's x axis, where the two differ by at most {:.0} % of the speed ({:.4} of {speed:.3} m/s)",
        yaw.to_degrees(),
        100.0 * apart,
        apart * speed
    );
    if clear && seen.other < tracks.options.closer_share * seen.own {
        let share = |of: f64| 100.0 * (of / seen.way).sqrt();
        return Finding::warning(
            "velocity_frame",
            None,
            format!(
                "{words}; frame = \"{other}\" fits better (residual {:.1} % instead of {:.1} %), as a heading that is off would make it too: which one does the instrument write?",
                share(seen.other),
                share(seen.own)
            ),
        );
    }
    Finding::info(
        "velocity_frame",
        format!("{words}; read as the map says, frame = \"{says}\""),
    )
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
    let options = tracks.options;
    let other = tracks.in_other_frame(assumed);
    let Some(seen) = tracks.distances(tank, &other) else {
        return false;
    };
    // A difference no larger than noise and sampling make says nothing.
    let unexplained = options.moves_variances * seen.noise + seen.unresolved;
    let is_away = |of: f64| of > unexplained && of > options.away_least_share * seen.way;
    if !is_away(seen.own) {
        if seen.way > unexplained && !is_away(seen.other) {
            findings.push(untold(tracks, &seen, assumed, seen.own > unexplained));
        }
        return false;
    }
    let share = |of: f64| 100.0 * (of / seen.way).sqrt();
    if seen.other >= options.closer_share * seen.own || seen.other >= options.away_share * seen.way
    {
        // Faster than noise, and still nothing like the way: a unit or an angle may be wrong.
        if seen.own > options.away_share * seen.way
            && seen.way.max(seen.own) > options.compared_speed_mps.powi(2)
        {
            findings.warning(
                "kinematics",
                format!(
                    "u_mps, v_mps: {:.0} % away from what the positions and the heading make: another frame, unit or heading?",
                    share(seen.own),
                ),
            );
        }
        return false;
    }
    let (says, is) = if assumed.in_tank {
        ("tank", "body")
    } else {
        ("body", "tank")
    };
    findings.fault(
        "velocity_frame",
        format!(
            "u_mps, v_mps: the map says frame = \"{says}\", but they follow the positions as velocities in the {is}'s frame do (residual {:.0} % instead of {:.0} %): frame = \"{is}\"?",
            share(seen.other),
            share(seen.own),
        ),
    );
    true
}

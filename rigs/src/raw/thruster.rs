//! `[thrusters]` and `[[thruster]]` as typed.

use super::link::read_link;
use super::section::Item;
use super::{Quantity, Section, quantity};
use crate::{BollardPull, ThrustCurve, Thruster, ThrusterSet};

/// Thrust that a controller at its neutral pulse may still be said to give \[N\].
const NEUTRAL_THRUST_N: f64 = 0.05;

/// A direction this near to unit length is typed in rounded digits and is normalised;
/// anything farther off is a mistake.
const UNIT_TOLERANCE: f64 = 0.01;

/// Type and allowed values of a thrust curve, in short.
const CURVE: (&str, &str) = (
    "points [us, N]",
    "at least two, pulses 500 to 2500 rising, thrusts -10000 to 10000 never falling; from `min_us` to `max_us`, no thrust at `neutral_us`",
);

struct PulseLimits {
    neutral_us: f64,
    min_us: f64,
    max_us: f64,
}

/// `set` is `[thrusters]`, `entries` are the `[[thruster]]`s of `root`.
pub(super) fn read_thrusters(root: &Section<'_>) -> Option<ThrusterSet> {
    let set = root.table("thrusters");
    let pulse = quantity(1000.0, 2000.0, "us");
    let limits = PulseLimits {
        neutral_us: set.number_or("neutral_us", pulse, 1500.0),
        min_us: set.number_or("min_us", pulse, 1100.0),
        max_us: set.number_or("max_us", pulse, 1900.0),
    };
    if !(limits.min_us < limits.neutral_us && limits.neutral_us < limits.max_us) {
        set.rule(
            if set.has("neutral_us") {
                "neutral_us"
            } else if set.has("min_us") {
                "min_us"
            } else {
                "max_us"
            },
            format!(
                "neutral_us = {} must lie between min_us = {} and max_us = {}",
                limits.neutral_us, limits.min_us, limits.max_us
            ),
            "Usual values: 1100, 1500, 1900",
        );
    }
    let max_slew_us_per_s =
        set.number_or("max_slew_us_per_s", quantity(1.0, 1e6, "us/s"), 10_000.0);
    set.asks_for("curve", CURVE.0, CURVE.1);
    let shared = set
        .item("curve")
        .map(|item| read_curve(&set, &item, &limits));

    let entries = root.tables("thruster", 24);
    if entries.is_empty() && !root.has("thruster") {
        root.missing("thruster", "at least one [[thruster]]");
    }
    let link = read_link(&set.table("link"), entries.len());
    set.finish();
    let read: Vec<Option<Thruster>> = entries
        .iter()
        .map(|entry| read_thruster(entry, &limits, shared.as_ref()))
        .collect();
    let thrusters: Vec<Thruster> = read.into_iter().collect::<Option<_>>()?;
    for (i, thruster) in thrusters.iter().enumerate() {
        for earlier in &thrusters[..i] {
            if earlier.name == thruster.name {
                entries[i].rule(
                    "name",
                    format!("the name {} is used twice", thruster.name),
                    "Give every thruster its own name",
                );
            }
            if earlier.channel == thruster.channel {
                entries[i].rule(
                    "channel",
                    format!(
                        "channel {} already drives {}",
                        thruster.channel, earlier.name
                    ),
                    "Give every thruster its own channel",
                );
            }
        }
    }
    Some(ThrusterSet {
        link: link?,
        thrusters,
        neutral_us: limits.neutral_us,
        min_us: limits.min_us,
        max_us: limits.max_us,
        max_slew_us_per_s,
    })
}

/// Numbers of a list.
pub(super) fn row<'d>(
    s: &Section<'d>,
    item: &Item<'d>,
    expected: &str,
    range: Quantity,
) -> Option<Vec<f64>> {
    let cells = s.elements(item, expected)?;
    cells.iter().map(|c| s.number_of(c, &range)).collect()
}

/// `[bollard]`, which `identify --bollard --write-rig` writes; `Some(None)` = there is none.
pub(super) fn read_bollard(root: &Section<'_>) -> Option<Option<BollardPull>> {
    if !root.has("bollard") {
        return Some(None);
    }
    let s = root.table("bollard");
    let voltage_v = s.number_or("voltage_v", quantity(0.0, 1000.0, "V"), 0.0);
    let scatter_n = s.number_or("scatter_n", quantity(0.0, 1e4, "N"), 0.0);
    let pulses = "the list of the curve's pulses [us]";
    s.asks_number("pulse_us", "numbers", &quantity(500.0, 2500.0, "us"));
    s.requires("pulse_us");
    s.asks_number(
        "covariance_n2",
        "rows of numbers",
        &quantity(-1e8, 1e8, "N2"),
    );
    s.requires("covariance_n2");
    let pulse_us = match s.item("pulse_us") {
        Some(item) => row(&s, &item, pulses, quantity(500.0, 2500.0, "us")),
        None => {
            s.missing("pulse_us", pulses);
            None
        }
    };
    let square = "one list of thrust covariances [N2] per pulse";
    let covariance_n2: Option<Vec<Vec<f64>>> = match s.item("covariance_n2") {
        Some(item) => s.elements(&item, square).and_then(|rows| {
            let read = rows
                .iter()
                .map(|r| row(&s, r, square, quantity(-1e8, 1e8, "N2")));
            read.collect()
        }),
        None => {
            s.missing("covariance_n2", square);
            None
        }
    };
    s.finish();
    let (pulse_us, covariance_n2) = (pulse_us?, covariance_n2?);
    let n = pulse_us.len();
    if covariance_n2.len() != n || covariance_n2.iter().any(|r| r.len() != n) {
        s.rule(
            "covariance_n2",
            format!("{n} pulses need {n} rows of {n} covariances"),
            "Write it with hydroline identify --bollard DATA.csv --write-rig",
        );
        return None;
    }
    Some(Some(BollardPull {
        voltage_v,
        scatter_n,
        pulse_us,
        covariance_n2,
    }))
}

fn read_thruster(
    s: &Section<'_>,
    limits: &PulseLimits,
    shared: Option<&Option<ThrustCurve>>,
) -> Option<Thruster> {
    let name = s.name("name");
    // 24 channels: the largest Maestro.
    let channel = s.integer("channel", 0, 23, "").map(|c| c as u8);
    let position_m = s.numbers("position_m", quantity(-50.0, 50.0, "m"));
    let direction = read_direction(s);
    s.asks_for("curve", CURVE.0, CURVE.1);
    s.default_is("curve", "`thrusters.curve`");
    let curve = match (s.item("curve"), shared) {
        (Some(item), _) => read_curve(s, &item, limits),
        // A shared curve that is wrong was reported where it stands.
        (None, Some(shared)) => shared.clone(),
        (None, None) => {
            s.missing(
                "curve",
                "`curve = [[pulse_us, thrust_n], …]` here, or once for all in [thrusters]",
            );
            None
        }
    };
    s.finish();
    Some(Thruster {
        name: name?,
        channel: channel?,
        position_m: position_m?,
        direction: direction?,
        curve: curve?,
    })
}

fn read_direction(s: &Section<'_>) -> Option<[f64; 3]> {
    let direction: [f64; 3] = s.numbers("direction", quantity(-1.01, 1.01, ""))?;
    let norm = direction.iter().map(|d| d * d).sum::<f64>().sqrt();
    if (norm - 1.0).abs() > UNIT_TOLERANCE {
        s.rule(
            "direction",
            format!("the vector is {norm:.4} long, but must be a unit vector (1 within 1 %)"),
            "Divide it by its length; at 45 deg enter 0.70711",
        );
        return None;
    }
    // Already unit to rounding: dividing again would only shuffle the last bit, and
    // the effective rig must read back as itself.
    if (norm - 1.0).abs() < 1e-12 {
        return Some(direction);
    }
    Some(direction.map(|d| d / norm))
}

fn read_curve<'d>(s: &Section<'d>, item: &Item<'d>, limits: &PulseLimits) -> Option<ThrustCurve> {
    let expected = "a list of at least two points [pulse_us, thrust_n]";
    let elements = s.elements(item, expected)?;
    let (pulse, thrust) = (quantity(500.0, 2500.0, "us"), quantity(-1e4, 1e4, "N"));
    let mut points: Vec<(f64, f64)> = Vec::with_capacity(elements.len());
    let mut sound = true;
    for element in &elements {
        let pair = s.elements(element, "a point [pulse_us, thrust_n]");
        let point = match pair.as_deref() {
            Some([p, t]) => match (s.number_of(p, &pulse), s.number_of(t, &thrust)) {
                (Some(p), Some(t)) => Some((p, t)),
                _ => None,
            },
            Some(_) => {
                s.wrong_type(element, "a point [pulse_us, thrust_n]");
                None
            }
            None => None,
        };
        let Some((p, t)) = point else {
            sound = false;
            continue;
        };
        if let Some(&(p0, t0)) = points.last() {
            if p <= p0 {
                report_point(
                    s,
                    element,
                    format!("pulse {p} us does not exceed the one before, {p0} us"),
                    "List the points by strictly ascending pulse",
                );
                sound = false;
            } else if t < t0 {
                report_point(
                    s,
                    element,
                    format!("thrust {t} N falls below the one before, {t0} N"),
                    "Thrust must not fall with rising pulse; for a propeller mounted the other way turn `direction` round",
                );
                sound = false;
            }
        }
        points.push((p, t));
    }
    if !sound {
        return None;
    }
    if points.len() < 2 {
        s.wrong_type(item, expected);
        return None;
    }
    let curve = ThrustCurve { points };
    let (first, last) = (curve.points[0].0, curve.points[curve.points.len() - 1].0);
    let mut covered = true;
    if first > limits.min_us || last < limits.max_us {
        report_point(
            s,
            item,
            format!(
                "the curve covers {first} to {last} us, but pulses from min_us = {} to max_us = {} us are allowed",
                limits.min_us, limits.max_us
            ),
            "Extend the curve or narrow min_us and max_us in [thrusters]",
        );
        covered = false;
    }
    if first <= limits.neutral_us && limits.neutral_us <= last {
        let at_neutral_n = curve.thrust_n(limits.neutral_us);
        if at_neutral_n.abs() > NEUTRAL_THRUST_N {
            report_point(
                s,
                item,
                format!(
                    "the curve gives {at_neutral_n} N at the neutral pulse, {} us: neutral must mean no thrust (within {NEUTRAL_THRUST_N} N)",
                    limits.neutral_us
                ),
                "Correct the curve or neutral_us",
            );
            covered = false;
        }
    }
    covered.then_some(curve)
}

fn report_point(s: &Section<'_>, item: &Item<'_>, what: String, next: &str) {
    s.report(
        item,
        crate::error::ProblemKind::Rule {
            what,
            next: next.to_owned(),
        },
    );
}

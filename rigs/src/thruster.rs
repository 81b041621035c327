//! Thrusters, their pulse-to-thrust curves and how well these are known.

mod curve;
mod link;
mod mavlink;

pub use curve::ThrustCurve;
pub use link::{Link, LinkKind, LinkPort};
pub use mavlink::{Mavlink, RecordOn};

use crate::raw::{Kind, Quantity, Section, list, name, number, numbers, rows, table, whole};
use curve::points;

/// A direction this near to unit length is typed in rounded digits and is normalised; anything farther off is a mistake.
const UNIT_TOLERANCE: f64 = 0.01;

/// Most thrusters: the channels of the largest Maestro.
pub(crate) const MOST: usize = 24;

/// A pulse that a controller may send.
const fn pulse() -> Quantity {
    number(1000.0, 2000.0, "us")
}

table! {
    /// Settings that all thrusters share.
    pub struct ThrusterSet as SetTyped, checked by pulses_in_order {
        /// Pulse width that means no thrust. Between `min_us` and `max_us`.
        pub neutral_us: f64 = pulse().or(1500.0),
        /// Least pulse width: none below goes out.
        pub min_us: f64 = pulse().or(1100.0),
        /// Largest pulse width: none above goes out.
        pub max_us: f64 = pulse().or(1900.0),
        /// Largest rate of change of a pulse width.
        pub max_slew_us_per_s: f64 = number(1.0, 1e6, "us/s").or(10_000.0),
        /// Standard deviation of the scale of all thrusts, as a share. Omitted: `identify` assumes 0.05, until a bollard pull measures
        /// the curve.
        pub scale_sd: Option<f64> = number(0.0, 1.0, "").optional(),
        /// Thrust over pulse width, linear between the points, of every `[[thruster]]` without a curve of its own.
        key curve: Option<ThrustCurve> = points().optional() => |_| None,
        /// The link to the thrusters' controller.
        pub link: Link = table(),
        /// Thrusters; the order is the order of channels in logs.
        made thrusters: Vec<Thruster>,
    }
}

table! {
    /// A thruster. At least one, at most 24.
    pub struct Thruster as ThrusterTyped, checked by unit_direction {
        /// Name of the thruster; each its own.
        pub name: String = name(),
        /// Channel of the controller; each its own.
        pub channel: u8 = whole(0, 23, ""),
        /// Position in the body frame, from the CG.
        pub position_m: [f64; 3] = numbers(number(-50.0, 50.0, "m")),
        /// Direction of positive thrust in the body frame: a unit vector.
        pub direction: [f64; 3] = numbers(number(-1.01, 1.01, "")),
        /// Thrust over pulse width of this thruster.
        pub curve: ThrustCurve = points().later("`thrusters.curve`"),
    }
}

table! {
    /// Covariance of the thrust curve, as `identify --bollard --write-rig` writes it. Omitted: the curve is taken as exact.
    pub struct BollardPull as BollardTyped, checked by square {
        /// Supply voltage that the curve holds at; 0 = not measured.
        pub voltage_v: f64 = number(0.0, 1000.0, "V").or(0.0),
        /// Standard deviation of the readings about the curve.
        pub scatter_n: f64 = number(0.0, 1e4, "N").or(0.0),
        /// Pulse widths of the curve's points.
        pub pulse_us: Vec<f64> = list(number(500.0, 2500.0, "us"), "the list of the curve's pulses [us]"),
        /// Covariance of their thrusts, one row per pulse.
        pub covariance_n2: Vec<Vec<f64>> =
            rows(number(-1e8, 1e8, "N2"), "one list of thrust covariances [N2] per pulse"),
    }
}

fn square(typed: &mut BollardTyped, s: &Section<'_>) {
    let (Some(pulses), Some(rows)) = (&typed.pulse_us, &typed.covariance_n2) else {
        return;
    };
    let n = pulses.len();
    if rows.len() != n || rows.iter().any(|r| r.len() != n) {
        s.rule(
            "covariance_n2",
            format!("{n} pulses need {n} rows of {n} covariances"),
            "Write it with hydroline identify --bollard DATA.csv --write-rig",
        );
    }
}

fn pulses_in_order(typed: &mut SetTyped, s: &Section<'_>) {
    let (Some(neutral), Some(min), Some(max)) = (typed.neutral_us, typed.min_us, typed.max_us)
    else {
        return;
    };
    if !(min < neutral && neutral < max) {
        let typed = ["neutral_us", "min_us"].into_iter().find(|key| s.has(key));
        s.rule(
            typed.unwrap_or("max_us"),
            format!("neutral_us = {neutral} must lie between min_us = {min} and max_us = {max}"),
            "Usual values: 1100, 1500, 1900",
        );
    }
}

fn unit_direction(typed: &mut ThrusterTyped, s: &Section<'_>) {
    let Some(direction) = typed.direction else {
        return;
    };
    let norm = direction.iter().map(|d| d * d).sum::<f64>().sqrt();
    if (norm - 1.0).abs() > UNIT_TOLERANCE {
        s.rule(
            "direction",
            format!("the vector is {norm:.4} long, but must be a unit vector (1 within 1 %)"),
            "Divide it by its length; at 45 deg enter 0.70711",
        );
    } else if (norm - 1.0).abs() >= 1e-12 {
        // Already unit to rounding, dividing again would only shuffle the last bit, and the effective rig must read
        // back as itself.
        typed.direction = Some(direction.map(|d| d / norm));
    }
}

/// `[thrusters]` and the `[[thruster]]`s of a rig.
pub(crate) fn read_thrusters(root: &Section<'_>) -> Option<ThrusterSet> {
    let table = root.table("thrusters");
    let mut set = SetTyped::read(&table);
    pulses_in_order(&mut set, &table);
    if let Some(Some(curve)) = &set.curve {
        curve.check(&set, &table);
    }
    table.finish();
    let entries = root.tables("thruster", MOST);
    if entries.is_empty() && !root.has("thruster") {
        root.missing("thruster", "at least one [[thruster]]");
    }
    if let Some(link) = &set.link {
        link.check_baud(&table, entries.len());
    }
    let read: Vec<Option<Thruster>> = entries
        .iter()
        .map(|entry| read_thruster(entry, &set))
        .collect();
    set.thrusters = read.into_iter().collect();
    let thrusters = set.thrusters.iter().flatten().enumerate();
    for (i, thruster) in thrusters {
        for earlier in set.thrusters.iter().flatten().take(i) {
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
    set.whole()
}

fn read_thruster(s: &Section<'_>, set: &SetTyped) -> Option<Thruster> {
    let mut typed = ThrusterTyped::read(s);
    unit_direction(&mut typed, s);
    match (&typed.curve, &set.curve) {
        (Some(curve), _) => curve.check(set, s),
        (None, _) if s.has("curve") => {}
        // A shared curve that is wrong was reported where it stands.
        (None, None) => {}
        (None, Some(Some(shared))) => typed.curve = Some(shared.clone()),
        (None, Some(None)) => s.missing(
            "curve",
            "`curve = [[pulse_us, thrust_n], …]` here, or once for all in [thrusters]",
        ),
    }
    s.finish();
    typed.whole()
}

impl ThrustCurve {
    /// Whether it covers the pulses that are allowed, and gives no thrust at the neutral one.
    fn check(&self, set: &SetTyped, s: &Section<'_>) {
        let (Some(neutral), Some(min), Some(max)) = (set.neutral_us, set.min_us, set.max_us) else {
            return;
        };
        let [first, last] = self.ends_us();
        if first > min || last < max {
            s.rule(
                "curve",
                format!(
                    "the curve covers {first} to {last} us, but pulses from min_us = {min} to max_us = {max} us are allowed"
                ),
                "Extend the curve or narrow min_us and max_us in [thrusters]",
            );
        }
        let at_neutral_n = self.thrust_n(neutral);
        if first <= neutral && neutral <= last && at_neutral_n.abs() > NEUTRAL_THRUST_N {
            s.rule(
                "curve",
                format!(
                    "the curve gives {at_neutral_n} N at the neutral pulse, {neutral} us: neutral must mean no thrust (within {NEUTRAL_THRUST_N} N)"
                ),
                "Correct the curve or neutral_us",
            );
        }
    }
}

/// Thrust that a controller at its neutral pulse may still be said to give \[N\].
const NEUTRAL_THRUST_N: f64 = 0.05;

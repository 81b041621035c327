//! Units of the field, their factor to SI and the names that instruments write for them.

use std::f64::consts::{PI, TAU};

/// Physical quantity that a unit measures.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Dimension {
    /// \[m\]
    Length,
    /// \[rad\]
    Angle,
    /// \[m/s\]
    Speed,
    /// \[rad/s\]
    Rate,
    /// \[N\]
    Force,
    /// \[N m\]
    Moment,
    /// \[s\]
    Time,
    /// Width of a servo pulse \[us\].
    Pulse,
}

use Dimension::{Angle, Force, Length, Moment, Pulse, Rate, Speed, Time};

/// One unit.
#[derive(Debug)]
pub struct Unit {
    /// Quantity that it measures.
    pub dimension: Dimension,
    /// As a map says it.
    pub name: &'static str,
    /// SI per unit.
    pub factor: f64,
    /// Other spellings, compared without regard to case.
    others: &'static [&'static str],
}

/// Units, each in a row: what it measures, its name, its factor, other spellings.
macro_rules! units {
    ($($dimension:ident $name:literal = $factor:expr => $($other:literal)*;)*) => {
        &[$(Unit {
            dimension: $dimension,
            name: $name,
            factor: $factor,
            others: &[$($other),*],
        }),*]
    };
}

const DEG: f64 = PI / 180.0;
/// International foot \[m\] (1959).
const FOOT_M: f64 = 0.3048;
/// Knot: 1852 m in an hour \[m/s\].
const KNOT_MPS: f64 = 1852.0 / 3600.0;
/// Standard gravity \[m/s²\] (CGPM 1901).
const GRAVITY: f64 = 9.806_65;
/// Avoirdupois pound \[kg\] (1959).
const POUND_KG: f64 = 0.453_592_37;

/// In the order in which messages list them.
pub static UNITS: &[Unit] = units! {
    Length "m" = 1.0 => "meter" "meters" "metre" "metres";
    Length "cm" = 0.01 => "centimeter" "centimeters" "centimetres";
    Length "mm" = 0.001 => "millimeter" "millimeters" "millimetres";
    Length "um" = 1e-6 => "µm" "μm" "micrometer" "micrometers";
    Length "km" = 1e3 => "kilometer" "kilometers" "kilometres";
    Length "ft" = FOOT_M => "foot" "feet";
    Length "in" = FOOT_M / 12.0 => "inch" "inches";
    Length "nmi" = 1852.0 => "nautical mile" "nautical miles";
    Angle "rad" = 1.0 => "radian" "radians";
    Angle "deg" = DEG => "°" "º" "˚" "degree" "degrees" "degs";
    Angle "mrad" = 1e-3 => "milliradian" "milliradians";
    Angle "cdeg" = 0.01 * DEG => "centidegree" "centidegrees" "centideg";
    Angle "arcmin" = DEG / 60.0 => "arcminute" "arcminutes" "minutes of arc";
    Angle "rev" = TAU => "revolution" "revolutions" "turn" "turns";
    Speed "m/s" = 1.0 => "mps" "m s-1" "m·s-1" "m s^-1" "m*s^-1" "ms-1" "meters per second";
    Speed "cm/s" = 0.01 => "cm s-1" "cmps";
    Speed "mm/s" = 0.001 => "mm s-1" "mmps";
    Speed "km/h" = 1.0 / 3.6 => "kph" "kmh" "km/hr";
    Speed "kn" = KNOT_MPS => "kt" "kts" "knot" "knots";
    Speed "ft/s" = FOOT_M => "fps" "ft s-1" "feet per second";
    Speed "in/s" = FOOT_M / 12.0 => "ips";
    Rate "rad/s" = 1.0 => "rad s-1" "rad·s-1" "rad s^-1" "radps" "rad/sec" "radians per second";
    Rate "deg/s" = DEG => "°/s" "º/s" "˚/s" "dps" "deg s-1" "deg/sec" "°/sec" "º/sec" "˚/sec" "degrees/s" "degrees per second";
    Rate "mrad/s" = 1e-3 => "mrad s-1";
    Rate "cdeg/s" = 0.01 * DEG => "cdps" "centidegrees/s";
    Rate "deg/min" = DEG / 60.0 => "°/min" "dpm";
    Rate "deg/h" = DEG / 3600.0 => "°/h" "deg/hr" "dph";
    Rate "rpm" = TAU / 60.0 => "r/min" "rev/min" "1/min" "min-1" "u/min";
    Rate "rps" = TAU => "rev/s" "1/s" "hz" "s-1";
    Force "N" = 1.0 => "newton" "newtons";
    Force "mN" = 1e-3 => "millinewton" "millinewtons";
    Force "kN" = 1e3 => "kilonewton" "kilonewtons";
    Force "gf" = 1e-3 * GRAVITY => "gram-force";
    Force "kgf" = GRAVITY => "kp" "kg-force" "kilogram-force";
    Force "lbf" = POUND_KG * GRAVITY => "lbs" "pound-force";
    Force "ozf" = POUND_KG * GRAVITY / 16.0 => "ounce-force";
    Moment "N m" = 1.0 => "nm" "n·m" "n*m" "n-m" "newton metres" "newton meters";
    Moment "mN m" = 1e-3 => "n mm" "n·mm" "nmm" "mnm";
    Moment "N cm" = 1e-2 => "ncm" "n·cm";
    Moment "kN m" = 1e3 => "knm" "kn·m";
    Moment "kgf m" = GRAVITY => "kgf·m" "kgfm";
    Moment "lbf ft" = POUND_KG * GRAVITY * FOOT_M => "ft lbf" "ft-lbf" "lb-ft" "ft-lb";
    Moment "lbf in" = POUND_KG * GRAVITY * FOOT_M / 12.0 => "in lbf" "in-lbf" "lb-in" "in-lb";
    Time "s" = 1.0 => "sec" "secs" "second" "seconds";
    Time "ms" = 1e-3 => "msec" "millis" "millisecond" "milliseconds";
    Time "us" = 1e-6 => "µs" "μs" "usec" "micros" "microsecond" "microseconds";
    Time "ns" = 1e-9 => "nsec" "nanos" "nanosecond" "nanoseconds";
    Time "min" = 60.0 => "minute" "minutes";
    Time "h" = 3600.0 => "hr" "hour" "hours";
    Time "d" = 86_400.0 => "day" "days";
    Pulse "us" = 1.0 => "µs" "μs" "pwm" "usec" "microseconds";
    Pulse "ms" = 1e3 => "msec" "milliseconds";
    // Pololu's Maestro counts quarters.
    Pulse "us/4" = 0.25 => "qus" "quarter microseconds";
};

/// A unit of a dimension by its name or another spelling of it.
pub fn find(dimension: Dimension, text: &str) -> Option<&'static Unit> {
    let text = text.trim();
    let of = || UNITS.iter().filter(|u| u.dimension == dimension);
    // Case tells units apart only among the shortest (mN and MN, kn and kN).
    let spelt = |u: &&Unit| {
        let long = u.name.len() > 2 && u.name.eq_ignore_ascii_case(text);
        long || u
            .others
            .iter()
            .any(|o| *o == text || o.to_lowercase() == text.to_lowercase())
    };
    of().find(|u| u.name == text).or_else(|| of().find(spelt))
}

/// Names of all units of a dimension.
pub fn names(dimension: Dimension) -> String {
    let names: Vec<&str> = UNITS
        .iter()
        .filter(|u| u.dimension == dimension)
        .map(|u| u.name)
        .collect();
    names.join(" ")
}

/// Sign of a degree, and two that stand in its place.
const DEGREES: [char; 3] = ['°', 'º', '˚'];

/// The unit that stands in a header cell: `x [mm]`, `Roll (deg)`, `Force, N`, `yaw / °`, `yaw °/s`.
pub fn written(cell: &str) -> Option<&str> {
    let cell = cell.trim();
    for (open, close) in [('[', ']'), ('(', ')'), ('{', '}')] {
        if let Some((_, rest)) = cell.rsplit_once(open)
            && let Some((inside, _)) = rest.split_once(close)
        {
            return Some(inside.trim());
        }
    }
    [", ", " / "]
        .iter()
        .find_map(|mark| cell.rsplit_once(mark))
        .map(|(_, unit)| unit.trim())
        .or_else(|| in_degrees(cell))
}

/// A unit of degrees that ends a cell without brackets around it.
pub fn in_degrees(cell: &str) -> Option<&str> {
    let unit = &cell[cell.find(DEGREES).filter(|at| *at > 0)?..];
    let known = [Angle, Rate].iter().any(|d| find(*d, unit).is_some());
    known.then(|| unit.trim())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_have_their_factors_and_other_spellings() {
        let factor = |d, name: &str| find(d, name).map(|u| u.factor);
        assert_eq!(factor(Speed, "knots"), Some(1852.0 / 3600.0));
        assert_eq!(factor(Length, "ft"), Some(0.3048));
        assert_eq!(factor(Time, "min"), Some(60.0));
        assert!((factor(Angle, "cdeg").unwrap() - PI / 18_000.0).abs() < 1e-18);
        assert_eq!(factor(Rate, "RPM"), Some(TAU / 60.0));
        assert_eq!(factor(Angle, "°"), factor(Angle, "Degrees"));
        assert_eq!(factor(Length, "deg"), None);
        // Case counts where it tells units apart.
        assert_eq!(factor(Force, "mN"), Some(1e-3));
        assert_eq!(factor(Length, "M"), None);
    }

    #[test]
    fn units_in_headers_are_found() {
        for (cell, unit) in [
            ("x [mm]", Some("mm")),
            ("Roll (deg)", Some("deg")),
            ("p_RS_R_x [m]", Some("m")),
            ("Force, N", Some("N")),
            ("Winkel / °", Some("°")),
            ("Roll °", Some("°")),
            ("yaw rateº/s", Some("º/s")),
            ("N° of run", None),
            ("Water °C", None),
            ("x", None),
            ("/odom/pose/x", None),
        ] {
            assert_eq!(written(cell), unit, "{cell}");
        }
    }
}

//! Recognition of units in a head.

use crate::unit::{self, UNITS};

/// Bases of units that are no channel's here by themselves or in powers, as instruments write them.
const BASES: [&str; 48] = [
    "m", "mm", "cm", "um", "km", "ft", "in", "s", "sec", "ms", "us", "ns", "min", "h", "rad",
    "mrad", "deg", "°", "N", "kN", "mN", "kg", "g", "Pa", "kPa", "hPa", "bar", "mbar", "dbar", "V",
    "mV", "A", "mA", "W", "kW", "Hz", "kHz", "K", "°C", "degC", "C", "T", "uT", "µT", "mG", "J",
    "lbf", "counts",
];

/// Whether a text is a unit made of others, such as `m/s^2`, `mm/s²`, `N m^-1`.
fn is_compound(text: &str) -> bool {
    let power = |c: char| {
        c.is_ascii_digit() || matches!(c, '^' | '-' | '²' | '³' | '⁻' | '¹' | '*' | '(' | ')')
    };
    let mut parts = text
        .split(['/', ' ', '·', '*'])
        .filter(|p| !p.is_empty())
        .peekable();
    parts.peek().is_some()
        && parts.all(|p| {
            let base = p.trim_end_matches(power);
            BASES.contains(&base) || base.is_empty() && p == "1"
        })
}

/// Whether a text is some unit, or says that there is none.
pub(in crate::guess) fn is_unit(text: &str) -> bool {
    let bare = unit::written(text).unwrap_or(text.trim());
    matches!(bare, "-" | "1" | "[]" | "%")
        || is_compound(bare)
        || UNITS
            .iter()
            .any(|u| unit::find(u.dimension, bare).is_some())
}

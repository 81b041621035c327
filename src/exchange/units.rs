//! Values with their unit as people type them, in SI: `11500 g`, `2 kn`, `30 lbf`.

/// Powers of kilogram, metre, second, and whether it is an angle or its rate.
type Powers = [i8; 4];

const MASS: Powers = [1, 0, 0, 0];
const LENGTH: Powers = [0, 1, 0, 0];
const TIME: Powers = [0, 0, 1, 0];
const SPEED: Powers = [0, 1, -1, 0];
const FORCE: Powers = [1, 1, -2, 0];
const MOMENT: Powers = [1, 2, -2, 0];
const INERTIA: Powers = [1, 2, 0, 0];
const ANGLE: Powers = [0, 0, 0, 1];
const TURN: Powers = [0, 0, -1, 1];
const ACCELERATION: Powers = [0, 1, -2, 0];
const DENSITY: Powers = [1, -3, 0, 0];
const FREQUENCY: Powers = [0, 0, -1, 0];
const LINEAR: Powers = [1, 0, -1, 0];
const QUADRATIC: Powers = [1, -1, 0, 0];
const TURNING: Powers = [1, 2, -1, 0];

const POUND_KG: f64 = 0.453_592_37;
const FOOT_M: f64 = 0.304_8;
const STANDARD_GRAVITY_MPS2: f64 = 9.806_65;
const POUND_FORCE_N: f64 = POUND_KG * STANDARD_GRAVITY_MPS2;
const KNOT_MPS: f64 = 1852.0 / 3600.0;
const DEGREE_RAD: f64 = std::f64::consts::PI / 180.0;

/// Units by their names, in SI (BIPM 2019; NIST SP 811 for those of the pound).
const UNITS: [(&str, f64, Powers); 46] = [
    ("kg", 1.0, MASS),
    ("g", 1e-3, MASS),
    ("t", 1e3, MASS),
    ("lb", POUND_KG, MASS),
    ("m", 1.0, LENGTH),
    ("mm", 1e-3, LENGTH),
    ("cm", 1e-2, LENGTH),
    ("km", 1e3, LENGTH),
    ("in", 0.0254, LENGTH),
    ("ft", FOOT_M, LENGTH),
    ("s", 1.0, TIME),
    ("ms", 1e-3, TIME),
    ("min", 60.0, TIME),
    ("m/s", 1.0, SPEED),
    ("mm/s", 1e-3, SPEED),
    ("cm/s", 1e-2, SPEED),
    ("km/h", 1.0 / 3.6, SPEED),
    ("kn", KNOT_MPS, SPEED),
    ("ft/s", FOOT_M, SPEED),
    ("N", 1.0, FORCE),
    ("kN", 1e3, FORCE),
    ("lbf", POUND_FORCE_N, FORCE),
    ("kgf", STANDARD_GRAVITY_MPS2, FORCE),
    ("N m", 1.0, MOMENT),
    ("lbf ft", POUND_FORCE_N * FOOT_M, MOMENT),
    ("kg m2", 1.0, INERTIA),
    ("g cm2", 1e-7, INERTIA),
    ("lb ft2", POUND_KG * FOOT_M * FOOT_M, INERTIA),
    ("rad", 1.0, ANGLE),
    ("deg", DEGREE_RAD, ANGLE),
    ("rad/s", 1.0, TURN),
    ("deg/s", DEGREE_RAD, TURN),
    ("rpm", std::f64::consts::TAU / 60.0, TURN),
    ("m/s2", 1.0, ACCELERATION),
    ("kg/m3", 1.0, DENSITY),
    ("g/cm3", 1e3, DENSITY),
    ("Hz", 1.0, FREQUENCY),
    ("kg/s", 1.0, LINEAR),
    ("N s/m", 1.0, LINEAR),
    ("kg/m", 1.0, QUADRATIC),
    ("N s2/m2", 1.0, QUADRATIC),
    ("kg m2/s", 1.0, TURNING),
    ("N m s", 1.0, TURNING),
    ("N m s/rad", 1.0, TURNING),
    ("N m s2", 1.0, INERTIA),
    ("N m s2/rad2", 1.0, INERTIA),
];

/// A value in the unit that a key has.
#[derive(Debug, Clone, PartialEq)]
pub struct Typed {
    /// In the unit of the key.
    pub value: f64,
    /// What was typed and what it is now, where a unit was named; `None` = a bare number.
    pub said: Option<String>,
}

/// Why a value cannot be used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[allow(missing_docs)] // Each message names its fields.
pub enum UnitError {
    #[error("'{typed}' is not a number with or without a unit, as 11.5 or \"11500 g\"")]
    NoNumber { typed: String },
    #[error("'{typed}': there is no unit '{unit}'; here one of: {known}")]
    Unknown {
        typed: String,
        unit: String,
        known: String,
    },
    #[error("'{typed}' is in {unit}, but the key is in {wanted}; here one of: {known}")]
    Another {
        typed: String,
        unit: String,
        wanted: String,
        known: String,
    },
}

/// A unit as it is compared: signs of products and powers left out.
fn plain(unit: &str) -> String {
    let spaced = unit
        .replace(['*', '·', '.'], " ")
        .replace('^', "")
        .replace('²', "2")
        .replace('³', "3");
    spaced.split_whitespace().collect::<Vec<_>>().join(" ")
}

fn find(unit: &str) -> Option<&'static (&'static str, f64, Powers)> {
    let unit = plain(unit);
    UNITS.iter().find(|u| plain(u.0) == unit)
}

/// Reads a value for a key of a unit (as the reference of rig files has it; "" = none).
///
/// # Errors
/// [`UnitError`].
pub fn read(typed: &str, wanted: &str) -> Result<Typed, UnitError> {
    let text = typed.trim();
    // The number ends where no longer beginning is one.
    let ends = (1..=text.len()).rev().filter(|k| text.is_char_boundary(*k));
    let number = ends
        .filter_map(|k| Some((text[..k].trim().parse::<f64>().ok()?, &text[k..])))
        .find(|(value, rest)| {
            value.is_finite() && !rest.starts_with(char::is_alphanumeric)
                || rest.is_empty()
                || unit_follows(rest)
        });
    let (value, rest) =
        number
            .filter(|(v, _)| v.is_finite())
            .ok_or_else(|| UnitError::NoNumber {
                typed: typed.to_owned(),
            })?;
    let unit = rest.trim();
    if unit.is_empty() {
        return Ok(Typed { value, said: None });
    }
    let of_key = find(wanted);
    let known = || {
        let alike = UNITS.iter().filter(|u| of_key.is_none_or(|k| k.2 == u.2));
        alike.map(|u| u.0).collect::<Vec<_>>().join(", ")
    };
    let (_, factor, powers) = find(unit).ok_or_else(|| UnitError::Unknown {
        typed: typed.to_owned(),
        unit: unit.to_owned(),
        known: known(),
    })?;
    let Some((name, own, _)) = of_key.filter(|k| k.2 == *powers) else {
        let is_none = wanted.is_empty();
        return Err(UnitError::Another {
            typed: typed.to_owned(),
            unit: unit.to_owned(),
            wanted: if is_none {
                "no unit".to_owned()
            } else {
                wanted.to_owned()
            },
            known: if is_none {
                "a bare number".to_owned()
            } else {
                known()
            },
        });
    };
    let value = value * (factor / own);
    Ok(Typed {
        value,
        said: (factor != own).then(|| format!("{} = {value} {name}", text)),
    })
}

/// Whether what follows a number begins as one of the units.
fn unit_follows(rest: &str) -> bool {
    find(rest).is_some()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_of_one_kind_become_that_of_the_key() {
        for (typed, wanted, expected) in [
            ("11500 g", "kg", 11.5),
            ("11500g", "kg", 11.5),
            ("2 kn", "m/s", 2.0 * 1852.0 / 3600.0),
            ("30 lbf", "N", 30.0 * 4.448_221_615_260_5),
            ("-12.5", "kg", -12.5),
            ("1e3 mm", "m", 1.0),
            ("90 deg", "rad", std::f64::consts::FRAC_PI_2),
            ("0.5 rad", "deg", 0.5f64.to_degrees()),
            ("20 N s/m", "kg/s", 20.0),
            ("20 N*s/m", "kg/s", 20.0),
            ("2 kg·m²", "kg m2", 2.0),
            ("6e-3 kN", "N", 6.0),
        ] {
            let made = read(typed, wanted).unwrap_or_else(|e| panic!("{typed}: {e}"));
            assert!(
                (made.value - expected).abs() < 1e-12 * expected.abs(),
                "{typed}: {made:?}"
            );
        }
        let said = read("11500 g", "kg").unwrap().said.unwrap();
        assert_eq!(said, "11500 g = 11.5 kg");
        assert_eq!(read("3 kg", "kg").unwrap().said, None);
    }

    #[test]
    fn another_kind_of_unit_and_no_number_are_refused_with_those_that_fit() {
        let words = read("11500 mm", "kg").unwrap_err().to_string();
        assert!(
            words.contains("the key is in kg") && words.contains("lb"),
            "{words}"
        );
        let words = read("2 furlong", "m").unwrap_err().to_string();
        assert!(
            words.contains("no unit 'furlong'") && words.contains("ft"),
            "{words}"
        );
        assert!(
            read("heavy", "kg")
                .unwrap_err()
                .to_string()
                .contains("11500 g")
        );
        assert!(
            read("3 kg", "")
                .unwrap_err()
                .to_string()
                .contains("bare number")
        );
        for nothing in ["", "nan", "inf", "e"] {
            assert!(read(nothing, "kg").is_err(), "{nothing}");
        }
    }
}

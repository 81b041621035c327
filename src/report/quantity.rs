//! Quantities as reports show them. Inside, every number is SI, and its key ends in its unit (`x_m`, `psi_rad`);
//! motions in a tank read best in millimetres and degrees.

/// A quantity as a report shows it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Quantity<'a> {
    /// Its name without the unit.
    pub name: &'a str,
    /// Unit shown; empty where the key names none.
    pub unit: &'static str,
    /// Factor from the key's unit to the one shown.
    pub factor: f64,
}

const DEG_PER_RAD: f64 = 180.0 / std::f64::consts::PI;
/// End of a key, unit shown, factor to it.
const UNITS: [(&str, &str, f64); 7] = [
    ("_m", "mm", 1e3),
    ("_rad", "deg", DEG_PER_RAD),
    ("_mps", "mm/s", 1e3),
    ("_radps", "deg/s", DEG_PER_RAD),
    ("_n", "N", 1.0),
    ("_nm", "N m", 1.0),
    ("_px", "px", 1.0),
];

impl<'a> Quantity<'a> {
    /// Quantity that a key names.
    pub fn of(key: &'a str) -> Self {
        UNITS
            .iter()
            .find_map(|(end, unit, factor)| {
                Some(Quantity {
                    name: key.strip_suffix(end)?,
                    unit,
                    factor: *factor,
                })
            })
            .unwrap_or(Quantity {
                name: key,
                unit: "",
                factor: 1.0,
            })
    }

    /// Name and unit of an axis: `x [mm]`.
    pub fn axis(&self) -> String {
        self.with_unit(self.name)
    }

    /// Other words with this quantity's unit.
    pub fn with_unit(&self, words: &str) -> String {
        if self.unit.is_empty() {
            words.to_owned()
        } else {
            format!("{words} [{}]", self.unit)
        }
    }

    /// A value with its unit, to a thousandth of it; no line breaks between the two.
    pub fn amount(&self, value: f64) -> String {
        let number = format!("{:.3}", value * self.factor);
        if self.unit.is_empty() {
            number
        } else {
            format!("{number}\u{a0}{}", self.unit)
        }
    }

    /// Values in the unit shown.
    pub fn shown(&self, values: &[f64]) -> Vec<f64> {
        values.iter().map(|v| v * self.factor).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_key_says_its_unit() {
        assert_eq!(Quantity::of("x_m").axis(), "x [mm]");
        assert_eq!(Quantity::of("q_radps").axis(), "q [deg/s]");
        assert_eq!(Quantity::of("thrust_n").axis(), "thrust [N]");
        assert_eq!(Quantity::of("torque_nm").axis(), "torque [N m]");
        assert_eq!(Quantity::of("whatever").axis(), "whatever");
        assert_eq!(Quantity::of("x_m").amount(-0.0123456), "-12.346\u{a0}mm");
        assert_eq!(Quantity::of("whatever").amount(2.0), "2.000");
        let turn = Quantity::of("psi_rad").shown(&[std::f64::consts::PI]);
        assert!((turn[0] - 180.0).abs() < 1e-9);
    }
}

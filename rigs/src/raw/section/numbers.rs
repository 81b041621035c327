//! Numbers, angles and lists of numbers.

use toml::de::DeValue;

use super::{Item, Section};
use crate::error::ProblemKind;
use crate::raw::Quantity;

impl<'d> Section<'d> {
    /// A number within its range.
    pub(crate) fn number_of(&self, item: &Item<'_>, allowed: &Quantity) -> Option<f64> {
        let Some(value) = as_f64(item.value) else {
            self.wrong_type(item, allowed.to_string());
            return None;
        };
        if allowed.contains(value) {
            // TOML knows -0.0; nothing here means anything by its sign.
            return Some(value + 0.0);
        }
        self.report(
            item,
            ProblemKind::OutOfRange {
                typed: self.typed(item),
                allowed: allowed.to_string(),
                hint: allowed.advice(),
            },
        );
        None
    }

    /// A number that may be omitted.
    pub(crate) fn number_opt(&self, key: &str, allowed: Quantity) -> Option<f64> {
        self.asks_number(key, "number", &allowed);
        self.number_of(&self.item(key)?, &allowed)
    }

    /// A number that must be there.
    pub(crate) fn number(&self, key: &str, allowed: Quantity) -> Option<f64> {
        self.asks_number(key, "number", &allowed);
        self.requires(key);
        let Some(item) = self.item(key) else {
            self.missing(key, format!("`{key} = …`, {allowed}"));
            return None;
        };
        self.number_of(&item, &allowed)
    }

    /// A number with a default.
    pub(crate) fn number_or(&self, key: &str, allowed: Quantity, default: f64) -> f64 {
        self.default_is(key, default);
        self.number_opt(key, allowed).unwrap_or(default)
    }

    /// An angle: `stem_rad` or `stem_deg`, range given in degrees, result in radians.
    pub(crate) fn angle_opt(&self, stem: &str, allowed_deg: Quantity) -> Option<f64> {
        let (rad_key, deg_key) = (format!("{stem}_rad"), format!("{stem}_deg"));
        self.asks_number(&rad_key, "number", &allowed_deg.deg_to_rad());
        self.asks_number(&deg_key, "number", &allowed_deg);
        match (self.item(&rad_key), self.item(&deg_key)) {
            (Some(_), Some(deg)) => {
                self.report(
                    &deg,
                    ProblemKind::Rule {
                        what: format!("{rad_key} and {deg_key} are both given"),
                        next: "Keep one of the two".to_owned(),
                    },
                );
                None
            }
            (Some(rad), None) => self.number_of(&rad, &allowed_deg.deg_to_rad()),
            (None, Some(deg)) => self.number_of(&deg, &allowed_deg).map(f64::to_radians),
            (None, None) => None,
        }
    }

    /// An angle with a default.
    pub(crate) fn angle_or(&self, stem: &str, allowed_deg: Quantity, default_deg: f64) -> f64 {
        self.default_is(&format!("{stem}_deg"), default_deg);
        self.angle_opt(stem, allowed_deg)
            .unwrap_or(default_deg.to_radians())
    }

    /// An angle that must be there.
    pub(crate) fn angle(&self, stem: &str, allowed_deg: Quantity) -> Option<f64> {
        self.requires(&format!("{stem}_deg"));
        let value = self.angle_opt(stem, allowed_deg);
        if value.is_none() && !self.has(&format!("{stem}_rad")) && !self.has(&format!("{stem}_deg"))
        {
            self.missing(
                &format!("{stem}_deg"),
                format!("`{stem}_deg = …`, {allowed_deg} (or `{stem}_rad`)"),
            );
        }
        value
    }

    /// A whole number that may be omitted.
    pub(crate) fn integer_opt(
        &self,
        key: &str,
        min: i64,
        max: i64,
        unit: &'static str,
    ) -> Option<i64> {
        let range = match max {
            i64::MAX => format!("from {min}"),
            _ => format!("{min} to {max}"),
        };
        self.asks_integer(key, unit, range);
        let item = self.item(key)?;
        let allowed = format!("a whole number from {min} to {max} {unit}");
        let Some(value) = as_i64(item.value) else {
            self.wrong_type(&item, allowed.trim_end());
            return None;
        };
        if (min..=max).contains(&value) {
            return Some(value);
        }
        self.report(
            &item,
            ProblemKind::OutOfRange {
                typed: self.typed(&item),
                allowed: allowed.trim_end().to_owned(),
                hint: String::new(),
            },
        );
        None
    }

    /// A whole number with a default.
    pub(crate) fn integer_or(
        &self,
        key: &str,
        [min, max]: [i64; 2],
        unit: &'static str,
        default: i64,
    ) -> i64 {
        self.default_is(key, default);
        self.integer_opt(key, min, max, unit).unwrap_or(default)
    }

    /// A whole number that must be there.
    pub(crate) fn integer(&self, key: &str, min: i64, max: i64, unit: &'static str) -> Option<i64> {
        self.requires(key);
        let value = self.integer_opt(key, min, max, unit);
        if value.is_none() && !self.has(key) {
            let expected = format!("`{key} = …`, a whole number from {min} to {max} {unit}");
            self.missing(key, expected.trim_end());
        }
        value
    }

    /// `N` numbers in the same range.
    pub(crate) fn numbers_of<const N: usize>(
        &self,
        item: &Item<'d>,
        allowed: &Quantity,
    ) -> Option<[f64; N]> {
        let expected = format!("a list of {N} numbers, each {allowed}");
        let elements = self.elements(item, &expected)?;
        if elements.len() != N {
            self.wrong_type(item, expected);
            return None;
        }
        let values: Vec<Option<f64>> = elements
            .iter()
            .map(|element| self.number_of(element, allowed))
            .collect();
        let values: Vec<f64> = values.into_iter().collect::<Option<_>>()?;
        values.try_into().ok()
    }

    /// `N` numbers that may be omitted.
    pub(crate) fn numbers_opt<const N: usize>(
        &self,
        key: &str,
        allowed: Quantity,
    ) -> Option<[f64; N]> {
        self.asks_number(key, format_args!("{N} numbers"), &allowed);
        self.numbers_of(&self.item(key)?, &allowed)
    }

    /// `N` numbers that must be there.
    pub(crate) fn numbers<const N: usize>(&self, key: &str, allowed: Quantity) -> Option<[f64; N]> {
        self.asks_number(key, format_args!("{N} numbers"), &allowed);
        self.requires(key);
        let Some(item) = self.item(key) else {
            self.missing(
                key,
                format!("`{key} = […]`, a list of {N} numbers, each {allowed}"),
            );
            return None;
        };
        self.numbers_of(&item, &allowed)
    }

    /// `[low, high]` with low below high.
    pub(crate) fn interval_opt(&self, key: &str, allowed: Quantity) -> Option<[f64; 2]> {
        let [low, high] = self.numbers_opt(key, allowed)?;
        if low < high {
            return Some([low, high]);
        }
        self.rule(
            key,
            format!("[{low}, {high}] is not an interval"),
            "Enter [lowest, highest] with the lowest first",
        );
        None
    }
}

fn as_i64(value: &DeValue<'_>) -> Option<i64> {
    let integer = value.as_integer()?;
    i64::from_str_radix(integer.as_str(), integer.radix()).ok()
}

fn as_f64(value: &DeValue<'_>) -> Option<f64> {
    match value {
        DeValue::Float(float) => float.as_str().parse().ok(),
        DeValue::Integer(integer) if integer.radix() == 10 => integer.as_str().parse().ok(),
        DeValue::Integer(_) => as_i64(value).map(|i| i as f64),
        _ => None,
    }
}

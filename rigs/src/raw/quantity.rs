//! A number's unit and range, and their text in messages.

use std::fmt;

/// Unit and allowed range of a number.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Quantity {
    min: f64,
    max: f64,
    unit: &'static str,
    min_excluded: bool,
    hint: &'static str,
}

/// `min <= value <= max`, in `unit` (empty for a pure number).
pub(crate) const fn number(min: f64, max: f64, unit: &'static str) -> Quantity {
    Quantity {
        min,
        max,
        unit,
        min_excluded: false,
        hint: "",
    }
}

impl Quantity {
    /// The lower limit itself is not allowed.
    pub(crate) const fn above(mut self) -> Self {
        self.min_excluded = true;
        self
    }

    /// Adds advice for a value that is refused.
    pub(crate) const fn hint(mut self, hint: &'static str) -> Self {
        self.hint = hint;
        self
    }

    /// The same range with degrees read as radians.
    pub(crate) fn deg_to_rad(mut self) -> Self {
        self.min = self.min.to_radians();
        self.max = self.max.to_radians();
        self.unit = "rad";
        self
    }

    pub(crate) fn contains(&self, value: f64) -> bool {
        value.is_finite()
            && value <= self.max
            && if self.min_excluded {
                value > self.min
            } else {
                value >= self.min
            }
    }

    pub(crate) fn unit(&self) -> &'static str {
        self.unit
    }

    /// The range in short, for a table.
    pub(crate) fn interval(&self) -> String {
        let above = if self.min_excluded { "above " } else { "" };
        format!("{above}{} to {}", short(self.min), short(self.max))
    }

    /// Advice to append to a message: empty or `. advice`.
    pub(crate) fn advice(&self) -> String {
        if self.hint.is_empty() {
            String::new()
        } else {
            format!(". {}", self.hint)
        }
    }
}

/// Large and small numbers as powers of ten.
fn short(number: f64) -> String {
    let size = number.abs();
    if size != 0.0 && !(1e-3..1e6).contains(&size) {
        format!("{number:e}")
    } else {
        number.to_string()
    }
}

impl fmt::Display for Quantity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let word = if self.min_excluded { "above" } else { "from" };
        let upto = if self.min_excluded { "and up to" } else { "to" };
        write!(f, "a number {word} {} {upto} {}", self.min, self.max)?;
        if !self.unit.is_empty() {
            write!(f, " {}", self.unit)?;
        }
        Ok(())
    }
}

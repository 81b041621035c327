//! A table of coefficients: name, value, and a unit where one is given.

use super::{Foreign, Number, named, particular};
use crate::units;

/// Unit in which a number is taken.
fn unit(name: &str) -> &'static str {
    match (named(name), particular(name)) {
        (Some(Ok(c)), _) => c.unit(),
        (_, Some(Number::Mass)) => "kg",
        (_, Some(Number::Inertia(_))) => "kg m2",
        (_, Some(Number::Buoyancy)) => "m",
        _ => "",
    }
}

/// Rows of name and value; a head, and rows without a number, are left out.
pub fn read(text: &str) -> Result<Foreign, String> {
    let mut found = Foreign::default();
    let separator = if text.contains('\t') {
        b'\t'
    } else if text.contains(';') {
        b';'
    } else {
        b','
    };
    let mut reader = csv::ReaderBuilder::new()
        .has_headers(false)
        .flexible(true)
        .delimiter(separator)
        .comment(Some(b'#'))
        .trim(csv::Trim::All)
        .from_reader(text.as_bytes());
    for (k, record) in reader.records().enumerate() {
        let record = record.map_err(|e| format!("row {}: {e}", k + 1))?;
        let (Some(name), Some(value)) = (record.get(0), record.get(1)) else {
            continue;
        };
        let written = match record.get(2).filter(|u| !u.is_empty()) {
            Some(unit) => format!("{value} {unit}"),
            None => value.to_owned(),
        };
        let is_number = value
            .split_whitespace()
            .next()
            .is_some_and(|v| v.parse::<f64>().is_ok());
        if !is_number {
            continue;
        }
        let known = named(name).is_some() || particular(name).is_some();
        if !known {
            found
                .left
                .push(format!("row {}: {name} is no coefficient of Eq. 1", k + 1));
            continue;
        }
        let typed =
            units::read(&written, unit(name)).map_err(|e| format!("row {}: {name}: {e}", k + 1))?;
        found.take(name, typed.value);
    }
    Ok(found)
}

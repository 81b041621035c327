//! All samples of a range as CSV.

use crate::series::Stretch;
use crate::viewed::Viewed;
use hydroline_core::lock::Lock;
use std::collections::BTreeMap;

/// Rows of a table that are written: of more, `hydroline export` writes the whole.
pub const ROWS_MAX: usize = 1_000_000;

/// Too many rows for one table.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error(
    "more than {ROWS_MAX} rows between these two times: choose a shorter range, or write the whole log with `hydroline export LOG`"
)]
pub struct TooLong;

impl Viewed {
    /// All samples of fields from one moment to another (of what is computed, those that a plot is made of), as CSV: a row for each moment at which one of them has a sample, in SI, the
    /// numbers as the log has them.
    ///
    /// # Errors
    /// [`TooLong`].
    pub fn table(&self, of: &[usize], from_ns: i64, to_ns: i64) -> Result<String, TooLong> {
        let mut rows: BTreeMap<i64, Vec<Option<f64>>> = BTreeMap::new();
        let channels = self.channels_of_fields(of);
        for place in self.places_in(of, from_ns, to_ns) {
            let messages = self.messages(place, &channels);
            self.each_number(messages.iter(), |number, at_ns, value| {
                let column = of.iter().position(|n| *n == number);
                let wanted = (from_ns..=to_ns).contains(&at_ns) && rows.len() <= ROWS_MAX;
                if let Some(column) = column.filter(|_| wanted) {
                    let row = rows.entry(at_ns).or_insert_with(|| vec![None; of.len()]);
                    row[column] = Some(value);
                }
            });
            if rows.len() > ROWS_MAX {
                return Err(TooLong);
            }
        }
        let whole = Stretch {
            from_ns,
            to_ns,
            pixels: ROWS_MAX,
        };
        let computed: Vec<usize> = of.iter().copied().filter(|n| self.is_derived(*n)).collect();
        let (_, computed) = self.derive(&computed, whole, || true);
        for (number, samples) in computed {
            let column = of.iter().position(|n| *n == number);
            let inside = samples
                .iter()
                .filter(|s| (from_ns..=to_ns).contains(&s.at_ns));
            for sample in inside {
                let row = rows.entry(sample.at_ns);
                let row = row.or_insert_with(|| vec![None; of.len()]);
                if let Some(column) = column {
                    row[column] = Some(sample.value);
                }
            }
        }
        if rows.len() > ROWS_MAX {
            return Err(TooLong);
        }
        let mut text = String::from("time_s,unix_ns");
        for number in of {
            text.push(',');
            text.push_str(&quoted(&self.field_name(*number)));
        }
        text.push('\n');
        for (at_ns, row) in rows {
            text.push_str(&seconds(at_ns));
            text.push_str(&format!(",{}", self.unix_ns(at_ns)));
            for value in row {
                text.push(',');
                if let Some(value) = value {
                    text.push_str(&format!("{value:?}"));
                }
            }
            text.push('\n');
        }
        Ok(text)
    }

    /// Topic and path of a field, with the sender in brackets where there are several.
    pub fn field_name(&self, number: usize) -> String {
        let fields = self.fields.held();
        let Some(field) = fields.all().get(number) else {
            return String::new();
        };
        let topic = self.topic(field.channel);
        match field.key.as_str() {
            "" => format!("{topic}.{}", field.path),
            key => format!("{topic}[{key}].{}", field.path),
        }
    }
}

/// Nanoseconds as seconds, to the last digit.
fn seconds(ns: i64) -> String {
    let (sign, ns) = (if ns < 0 { "-" } else { "" }, ns.unsigned_abs());
    format!("{sign}{}.{:09}", ns / 1_000_000_000, ns % 1_000_000_000)
}

/// A cell that a comma or a quote in it does not end.
fn quoted(text: &str) -> String {
    match text.contains([',', '"', '\n', '\r']) {
        true => format!("\"{}\"", text.replace('"', "\"\"")),
        false => text.to_owned(),
    }
}

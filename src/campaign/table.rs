//! One row per run, day and group: the same columns as CSV and as JSON lines, which pandas and DuckDB read as they are.

use crate::group::{Group, date};
use crate::kind::Kind;
use crate::sheet::{ChangeSheet, Coefficients, Diagnosed, RunSheet, SetSheet};
use crate::store::{StoreError, file, write_whole};
use crate::survey::Found;
use crate::unit::{Task, Unit};
use crate::work::Campaign;
use hydroline_core::plain;
use serde_json::{Map, Value, json};
use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::io::{self, BufRead, BufReader, Write};
use std::path::{Path, PathBuf};

/// Columns in this order; coefficients, noise, ranges and predictions follow by name.
const FIRST: [&str; 24] = [
    "kind",
    "group",
    "vehicle",
    "water",
    "date",
    "start_ns",
    "log",
    "plan",
    "note",
    "state",
    "sound",
    "frames_lost",
    "duration_s",
    "samples",
    "runs",
    "verdict",
    "effects",
    "sentence",
    "truncated",
    "model",
    "variance_ratio",
    "misfit",
    "outlier_ratio",
    "remarks",
];

/// A row: column to value; what is not known is absent.
pub type Row = Map<String, Value>;

/// The table as it lies on disk. It is written and read row by row: its memory does not grow with the number of logs.
#[derive(Debug)]
pub struct Table {
    lines: PathBuf,
}

impl Table {
    /// Writes `lines` (JSON, one object per row) and `csv` (RFC 4180; an empty cell is not known), each whole or not at all.
    ///
    /// # Errors
    /// [`StoreError`].
    pub fn write(campaign: &Campaign<'_>, lines: &Path, csv: &Path) -> Result<Self, StoreError> {
        let mut there: BTreeSet<String> = BTreeSet::new();
        write_whole(lines, |out| {
            each_row(campaign, |row| {
                for column in row.keys() {
                    if !there.contains(column) {
                        there.insert(column.clone());
                    }
                }
                serde_json::to_writer(&mut *out, &row)?;
                out.write_all(b"\n")
            })
        })?;
        let table = Self {
            lines: lines.to_owned(),
        };
        let columns = columns(&there);
        let rows = table.rows()?;
        write_whole(csv, |out| {
            let mut out = csv::Writer::from_writer(out);
            out.write_record(&columns)?;
            for row in rows {
                let row = row.map_err(io::Error::other)?;
                out.write_record(columns.iter().map(|c| cell(&row, c)))?;
            }
            out.flush()
        })?;
        Ok(table)
    }

    /// Rows, one by one.
    ///
    /// # Errors
    /// [`StoreError`], and each row's own.
    pub fn rows(&self) -> Result<impl Iterator<Item = Result<Row, StoreError>>, StoreError> {
        let lines = BufReader::new(File::open(&self.lines).map_err(file(&self.lines))?).lines();
        Ok(lines.map(|line| {
            let line = line.map_err(file(&self.lines))?;
            serde_json::from_str(&line).map_err(|source| StoreError::Json {
                path: self.lines.clone(),
                source,
            })
        }))
    }

    /// Rows of groups, days and changes, and of files that cannot be used: all but those of runs.
    ///
    /// # Errors
    /// [`StoreError`].
    pub fn joint(&self) -> Result<Vec<Row>, StoreError> {
        self.rows()?
            .filter(|row| !matches!(row, Ok(row) if Kind::of(row) == Some(Kind::Run)))
            .collect()
    }
}

/// Each row: bad logs, then group by group its runs by time, its days, the group, its changes.
fn each_row(
    campaign: &Campaign<'_>,
    mut each: impl FnMut(Row) -> io::Result<()>,
) -> io::Result<()> {
    for log in campaign.logs {
        if let Err(why) = &log.is {
            let mut row = Row::new();
            put(&mut row, "kind", Kind::Bad.name());
            put(&mut row, "log", log.name.as_str());
            put(&mut row, "state", "bad");
            put(&mut row, "remarks", why.as_str());
            each(row)?;
        }
    }
    let of_hash: BTreeMap<&str, &Unit> = campaign
        .units
        .iter()
        .filter_map(|u| match u.task {
            Task::Run { log } => Some((campaign.logs[log].hash.as_str(), u)),
            _ => None,
        })
        .collect();
    for (g, group) in campaign.groups.iter().enumerate() {
        let whole = campaign
            .units
            .iter()
            .find(|u| u.task == Task::Group { group: g });
        let outliers: BTreeMap<String, f64> = whole
            .and_then(|u| campaign.store.get::<SetSheet>(&u.key))
            .map_or(Vec::new(), |s| s.outliers)
            .into_iter()
            .collect();
        let dated = group.days.iter().flat_map(|d| &d.logs);
        for k in dated.chain(&group.undated) {
            let unit = of_hash.get(campaign.logs[*k].hash.as_str()).copied();
            each(run(campaign, group, *k, unit, &outliers))?;
        }
        for unit in campaign.units {
            match unit.task {
                Task::Day { group: of, day } if of == g => {
                    each(set(campaign, group, unit, Kind::Day, &group.days[day].date))?;
                }
                Task::Group { group: of } if of == g => {
                    each(set(campaign, group, unit, Kind::Group, ""))?;
                }
                Task::Changes { group: of } if of == g => {
                    changes(campaign, group, unit)
                        .into_iter()
                        .try_for_each(&mut each)?;
                }
                _ => {}
            }
        }
    }
    Ok(())
}

fn put(row: &mut Row, column: &str, value: impl Into<Value>) {
    let value = value.into();
    if !value.is_null() && value != "" {
        row.insert(column.to_owned(), value);
    }
}

fn head(group: &Group, kind: Kind) -> Row {
    let mut row = Row::new();
    put(&mut row, "kind", kind.name());
    put(&mut row, "group", group.id.as_str());
    put(&mut row, "vehicle", group.vehicle.as_str());
    put(&mut row, "water", group.water.as_str());
    row
}

/// `unit` = of the log; of a log that is there twice, the first one's.
fn run(
    campaign: &Campaign<'_>,
    group: &Group,
    k: usize,
    unit: Option<&Unit>,
    outliers: &BTreeMap<String, f64>,
) -> Row {
    let log: &Found = &campaign.logs[k];
    let mut row = head(group, Kind::Run);
    put(&mut row, "log", log.name.as_str());
    let mut remarks: Vec<String> = Vec::new();
    if let Ok(is) = &log.is {
        if group.undated.contains(&k) {
            let at = date(is.start_ns);
            remarks.push(format!(
                "no day: by its stamps it is of {at}, and its clock is wrong"
            ));
        } else {
            put(&mut row, "date", date(is.start_ns));
            put(&mut row, "start_ns", is.start_ns);
        }
        put(&mut row, "plan", is.plan.as_str());
        put(&mut row, "note", is.note.as_str());
    }
    let sheet = unit.and_then(|u| Some((u, campaign.store.get::<RunSheet>(&u.key)?)));
    let Some((unit, sheet)) = sheet else {
        put(&mut row, "state", "open");
        put(&mut row, "remarks", remarks.join("; "));
        return row;
    };
    let twice = unit.task != Task::Run { log: k };
    put(&mut row, "state", if twice { "copy" } else { "done" });
    put(&mut row, "sound", sheet.sound);
    put(&mut row, "frames_lost", sheet.frames_lost);
    put(&mut row, "duration_s", sheet.duration_s);
    put(&mut row, "samples", sheet.samples);
    for (channel, [low, high]) in &sheet.range {
        put(&mut row, &format!("least_{channel}"), *low);
        put(&mut row, &format!("greatest_{channel}"), *high);
    }
    for (dof, load) in &sheet.largest_load {
        put(&mut row, &format!("load_{dof}"), *load);
    }
    remarks.extend(sheet.findings.iter().map(ToString::to_string));
    fitted(&mut row, &sheet.identified, &mut remarks);
    diagnosed(&mut row, &sheet.diagnosed, &mut remarks);
    if let Some(ratio) = outliers.get(&log.name) {
        put(&mut row, "outlier_ratio", *ratio);
    }
    remarks.dedup();
    put(&mut row, "remarks", remarks.join("; "));
    row
}

fn set(campaign: &Campaign<'_>, group: &Group, unit: &Unit, kind: Kind, date: &str) -> Row {
    let mut row = head(group, kind);
    put(&mut row, "date", date);
    let Some(sheet) = campaign.store.get::<SetSheet>(&unit.key) else {
        put(&mut row, "state", "open");
        return row;
    };
    put(&mut row, "state", "done");
    put(&mut row, "runs", sheet.runs.len());
    let mut remarks = sheet.left.clone();
    fitted(&mut row, &sheet.identified, &mut remarks);
    diagnosed(&mut row, &sheet.diagnosed, &mut remarks);
    put(&mut row, "remarks", remarks.join("; "));
    row
}

fn changes(campaign: &Campaign<'_>, group: &Group, unit: &Unit) -> Vec<Row> {
    let Some(sheet) = campaign.store.get::<ChangeSheet>(&unit.key) else {
        let mut row = head(group, Kind::Change);
        put(&mut row, "state", "open");
        return vec![row];
    };
    let each = sheet.changes.iter().map(|found| {
        let mut row = head(group, Kind::Change);
        put(&mut row, "state", "done");
        match found {
            Ok(change) => {
                put(&mut row, "date", change.date.as_str());
                put(&mut row, "sentence", change.sentence.as_str());
                put(&mut row, "same_probability", change.same_probability);
                if let Some(first) = change.causes.first() {
                    put(&mut row, "cause", first.what.to_string());
                    put(&mut row, "cause_probability", first.probability);
                    put(
                        &mut row,
                        "cause_value",
                        first.value.map_or(Value::Null, number),
                    );
                    put(&mut row, "cause_sd", first.sd.map_or(Value::Null, number));
                }
            }
            Err(why) => put(&mut row, "remarks", why.as_str()),
        }
        row
    });
    each.collect()
}

/// JSON has no NaN.
fn number(value: f64) -> Value {
    match value.is_finite() {
        true => json!(value),
        false => Value::Null,
    }
}

/// A result that is there; why it is not is added to the remarks.
fn or_remark<'a, T>(found: &'a Result<T, String>, remarks: &mut Vec<String>) -> Option<&'a T> {
    found.as_ref().map_err(|why| remarks.push(why.clone())).ok()
}

fn fitted(row: &mut Row, found: &Result<Coefficients, String>, remarks: &mut Vec<String>) {
    let Some(found) = or_remark(found, remarks) else {
        return;
    };
    put(row, "model", found.model.as_str());
    put(row, "variance_ratio", number(found.variance_ratio));
    put(row, "misfit", found.misfit.join("; "));
    for (key, n) in &found.numbers {
        if let Some(sd) = n.sd {
            put(row, key, number(n.value));
            put(row, &format!("{key}_sd"), number(sd));
            for (end, value) in [("low", n.low), ("high", n.high)] {
                let value = value.map_or(Value::Null, number);
                put(row, &format!("{key}_{end}"), value);
            }
        }
    }
    for (slot, sd) in &found.noise_sd {
        put(row, &format!("noise_{slot}"), number(*sd));
    }
}

fn diagnosed(row: &mut Row, found: &Result<Diagnosed, String>, remarks: &mut Vec<String>) {
    let Some(found) = or_remark(found, remarks) else {
        return;
    };
    put(row, "verdict", found.verdict.name());
    put(row, "sentence", found.sentence.as_str());
    let open = found.truncated.as_ref().map(|end| end.open.join("; "));
    put(row, "truncated", open.unwrap_or_default());
    let effects: Vec<String> = found
        .effects
        .iter()
        .filter(|e| e.matters)
        .map(|e| match e.dof.is_empty() {
            true => e.effect.clone(),
            false => format!("{} in {}", e.effect, e.dof),
        })
        .collect();
    put(row, "effects", effects.join("; "));
    for (channel, [before, after, noise]) in &found.predicted {
        for (name, value) in [("before", before), ("after", after), ("noise", noise)] {
            let value = value.map_or(Value::Null, number);
            put(row, &format!("predicted_{channel}_{name}"), value);
        }
    }
    remarks.extend(found.faults.iter().cloned());
}

/// A cell as text; empty = not known.
pub fn word(row: &Row, column: &str) -> String {
    match row.get(column) {
        None => String::new(),
        Some(Value::String(words)) => words.clone(),
        Some(other) => other.to_string(),
    }
}

/// The same for a spreadsheet: plans, notes and names of logs come from anyone, and begin no formula, as in exported tables.
fn cell(row: &Row, column: &str) -> String {
    match row.get(column) {
        Some(Value::String(words)) => plain::cell(words).into_owned(),
        _ => word(row, column),
    }
}

/// Columns that are there: the fixed ones in their order, then the others by name.
fn columns(there: &BTreeSet<String>) -> Vec<&str> {
    let first = FIRST.iter().copied().filter(|c| there.contains(*c));
    let rest = there.iter().map(String::as_str);
    first.chain(rest.filter(|c| !FIRST.contains(c))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_cell_of_text_begins_as_a_formula() {
        let mut row = Row::new();
        for (text, written) in [
            (
                "=HYPERLINK(\"http://evil.example\")",
                "'=HYPERLINK(\"http://evil.example\")",
            ),
            ("+1+cmd|' /C calc'!A0", "'+1+cmd|' /C calc'!A0"),
            ("@SUM(A1)", "'@SUM(A1)"),
            ("-2+3", "'-2+3"),
            ("\t=1+1", "'\t=1+1"),
            ("\r\n=1+1", "'\r\n=1+1"),
            ("＝1+1", "'＝1+1"),
            ("still water", "still water"),
            ("a=b", "a=b"),
            ("-0.5", "-0.5"),
            ("", ""),
        ] {
            row.insert("note".to_owned(), text.into());
            assert_eq!(cell(&row, "note"), written);
            assert_eq!(word(&row, "note"), text, "the JSON has it as it was");
        }
        row.insert("X_u".to_owned(), json!(-198.2));
        assert_eq!(cell(&row, "X_u"), "-198.2");
    }
}

//! One row per run, day and group: the same columns as CSV and as JSON lines, which pandas and DuckDB read as they are.

use crate::group::{Group, date};
use crate::sheet::{ChangeSheet, Coefficients, Diagnosed, RunSheet, SetSheet};
use crate::survey::Found;
use crate::unit::{Task, Unit};
use crate::work::Campaign;
use serde_json::{Map, Value, json};
use std::collections::{BTreeMap, BTreeSet};

/// Columns in this order; coefficients, noise, ranges and predictions follow by name.
const FIRST: [&str; 23] = [
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
    "model",
    "variance_ratio",
    "misfit",
    "outlier_ratio",
    "remarks",
];

/// A row: column to value; what is not known is absent.
pub type Row = Map<String, Value>;

/// All rows: bad logs, then group by group its runs by time, its days, the group, its changes.
pub fn rows(campaign: &Campaign<'_>) -> Vec<Row> {
    let mut rows: Vec<Row> = campaign
        .logs
        .iter()
        .filter_map(|log| {
            let why = log.is.as_ref().err()?;
            let mut row = Row::new();
            put(&mut row, "kind", "bad");
            put(&mut row, "log", log.name.as_str());
            put(&mut row, "state", "bad");
            put(&mut row, "remarks", why.as_str());
            Some(row)
        })
        .collect();
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
        let outliers = whole
            .and_then(|u| campaign.store.get::<SetSheet>(&u.key))
            .map_or(Vec::new(), |s| s.outliers);
        for k in group.days.iter().flat_map(|d| &d.logs) {
            let unit = of_hash.get(campaign.logs[*k].hash.as_str()).copied();
            rows.push(run(campaign, group, *k, unit, &outliers));
        }
        for unit in campaign.units {
            match unit.task {
                Task::Day { group: of, day } if of == g => {
                    rows.push(set(campaign, group, unit, "day", &group.days[day].date));
                }
                Task::Group { group: of } if of == g => {
                    rows.push(set(campaign, group, unit, "group", ""));
                }
                Task::Changes { group: of } if of == g => {
                    rows.extend(changes(campaign, group, unit));
                }
                _ => {}
            }
        }
    }
    rows
}

fn put(row: &mut Row, column: &str, value: impl Into<Value>) {
    let value = value.into();
    if !value.is_null() && value != "" {
        row.insert(column.to_owned(), value);
    }
}

fn head(group: &Group, kind: &str) -> Row {
    let mut row = Row::new();
    put(&mut row, "kind", kind);
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
    outliers: &[(String, f64)],
) -> Row {
    let log: &Found = &campaign.logs[k];
    let mut row = head(group, "run");
    put(&mut row, "log", log.name.as_str());
    if let Ok(is) = &log.is {
        put(&mut row, "date", date(is.start_ns));
        put(&mut row, "start_ns", is.start_ns);
        put(&mut row, "plan", is.plan.as_str());
        put(&mut row, "note", is.note.as_str());
    }
    let sheet = unit.and_then(|u| Some((u, campaign.store.get::<RunSheet>(&u.key)?)));
    let Some((unit, sheet)) = sheet else {
        put(&mut row, "state", "open");
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
    let mut remarks = sheet.findings.clone();
    fitted(&mut row, &sheet.identified, &mut remarks);
    diagnosed(&mut row, &sheet.diagnosed, &mut remarks);
    if let Some((_, ratio)) = outliers.iter().find(|(name, _)| *name == log.name) {
        put(&mut row, "outlier_ratio", *ratio);
    }
    remarks.dedup();
    put(&mut row, "remarks", remarks.join("; "));
    row
}

fn set(campaign: &Campaign<'_>, group: &Group, unit: &Unit, kind: &str, date: &str) -> Row {
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
        let mut row = head(group, "change");
        put(&mut row, "state", "open");
        return vec![row];
    };
    let each = sheet.changes.iter().map(|found| {
        let mut row = head(group, "change");
        put(&mut row, "state", "done");
        match found {
            Ok(change) => {
                put(&mut row, "date", change.date.as_str());
                put(&mut row, "sentence", change.sentence.as_str());
                put(&mut row, "same_probability", change.same_probability);
                if let Some(first) = change.causes.first() {
                    put(&mut row, "cause", first.what.as_str());
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

fn fitted(row: &mut Row, found: &Result<Coefficients, String>, remarks: &mut Vec<String>) {
    let found = match found {
        Ok(found) => found,
        Err(why) => {
            remarks.push(why.clone());
            return;
        }
    };
    put(row, "model", found.model.as_str());
    put(row, "variance_ratio", number(found.variance_ratio));
    put(row, "misfit", found.misfit.join("; "));
    for (key, n) in &found.numbers {
        if let Some(sd) = n.sd {
            put(row, key, number(n.value));
            put(row, &format!("{key}_sd"), number(sd));
            put(
                row,
                &format!("{key}_low"),
                n.low.map_or(Value::Null, number),
            );
            put(
                row,
                &format!("{key}_high"),
                n.high.map_or(Value::Null, number),
            );
        }
    }
    for (slot, sd) in &found.noise_sd {
        put(row, &format!("noise_{slot}"), number(*sd));
    }
}

fn diagnosed(row: &mut Row, found: &Result<Diagnosed, String>, remarks: &mut Vec<String>) {
    let found = match found {
        Ok(found) => found,
        Err(why) => {
            remarks.push(why.clone());
            return;
        }
    };
    put(row, "verdict", found.word());
    put(row, "sentence", found.sentence.as_str());
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

/// Columns of rows: the fixed ones in their order, then the others by name.
fn columns(rows: &[Row]) -> Vec<String> {
    let there: BTreeSet<&str> = rows
        .iter()
        .flat_map(|r| r.keys())
        .map(String::as_str)
        .collect();
    let first = FIRST.iter().filter(|c| there.contains(*c));
    let rest = there.iter().filter(|c| !FIRST.contains(c));
    first.chain(rest).map(|c| (*c).to_owned()).collect()
}

/// As CSV (RFC 4180); an empty cell is not known.
///
/// # Errors
/// What the writer says.
pub fn csv(rows: &[Row]) -> Result<Vec<u8>, csv::Error> {
    let columns = columns(rows);
    let mut out = csv::Writer::from_writer(Vec::new());
    out.write_record(&columns)?;
    for row in rows {
        out.write_record(columns.iter().map(|c| word(row, c)))?;
    }
    out.into_inner().map_err(|e| e.into_error().into())
}

/// As JSON lines, one object per row.
pub fn json_lines(rows: &[Row]) -> String {
    let lines = rows.iter().map(|row| {
        let mut line = Value::Object(row.clone()).to_string();
        line.push('\n');
        line
    });
    lines.collect()
}

//! Exports of motion capture: Qualisys Track Manager, OptiTrack Motive.

use super::super::head::Head;
use super::super::shape::{self, Defaults, Named, Shape};
use crate::map::Separator;
use crate::number::number;
use crate::unit::{self, Dimension};

pub(super) fn shape(
    kind: &'static str,
    file: crate::map::FileMap,
    columns: Vec<Named>,
    rate_hz: Option<f64>,
    units: Defaults,
) -> Shape {
    Shape {
        kind,
        by_number: !file.header,
        file,
        columns,
        rate_hz,
        units,
        remarks: Vec::new(),
        open: Vec::new(),
    }
}

/// Columns of one marker in Qualisys's exports (with its residual), and of one body (with its residual and matrix).
const MARKER_WIDTHS: [usize; 2] = [3, 4];
const BODY_WIDTHS: [usize; 3] = [16, 7, 6];

/// Columns before the first group, and of each: frame and time may both, one, or none of them be exported.
fn leading(width: usize, groups: usize, widths: &[usize]) -> (usize, usize) {
    let groups = groups.max(1);
    let known = widths.iter().find_map(|w| {
        let lead = width.checked_sub(w * groups)?;
        (lead <= 2).then_some((lead, *w))
    });
    known.unwrap_or((2, width.saturating_sub(2) / groups))
}

/// Lines of keys, then `Frame Time` and the bodies.
pub(super) fn qualisys(head: &Head) -> Option<Shape> {
    if !head.lines.first()?.1.starts_with("NO_OF_FRAMES") {
        return None;
    }
    let tab = Separator::Byte(b'\t');
    let is_key = |line: &str| {
        let word = line.split('\t').next().unwrap_or("");
        word.len() > 3 && word.chars().all(|c| c.is_ascii_uppercase() || c == '_')
    };
    let after = head
        .lines
        .iter()
        .position(|l| !is_key(&l.1) && !l.1.trim().is_empty())?;
    let (line, text) = &head.lines[after];
    let cells = shape::cells(tab, text);
    let mut file = shape::file(head, tab, '.');
    let decimal_comma = head.lines[after + 1..]
        .iter()
        .take(5)
        .any(|l| l.1.contains(','));
    file.decimal = if decimal_comma { ',' } else { '.' };
    let names = |key: &str| -> Vec<String> {
        head.value(key, '\t').map_or_else(Vec::new, |n| {
            n.split('\t').map(|n| n.trim().to_owned()).collect()
        })
    };
    let mut columns: Vec<Named> = Vec::new();
    if cells
        .iter()
        .any(|c| number(c, file.decimal).is_none() && !c.is_empty())
    {
        file.header_line = Some(*line);
        let mut group = String::new();
        for name in &cells {
            // `AUV X`, then `Y`, `Z`, `Roll` of the same.
            if let Some((body, "X")) = name.rsplit_once(' ') {
                body.clone_into(&mut group);
            }
            columns.push(Named {
                name: name.clone(),
                group: if matches!(name.as_str(), "Frame" | "Time") {
                    String::new()
                } else {
                    group.clone()
                },
                unit: None,
            });
        }
    } else {
        file.header = false;
        file.first_line = Some(*line);
        let (markers, bodies) = (names("MARKER_NAMES"), names("BODY_NAMES"));
        let six = ["X", "Y", "Z", "Roll", "Pitch", "Yaw", "Residual"];
        let (groups, own): (Vec<String>, &[&str]) = if bodies.is_empty() {
            (markers, &six[..3])
        } else {
            (bodies, &six)
        };
        let width = cells
            .iter()
            .rposition(|c| !c.is_empty())
            .map_or(0, |i| i + 1);
        let widths: &[usize] = if own.len() == 3 {
            &MARKER_WIDTHS
        } else {
            &BODY_WIDTHS
        };
        let (lead, wide) = leading(width, groups.len(), widths);
        let whole = cells.first().is_some_and(|c| c.parse::<u64>().is_ok());
        let leads: &[&str] = match lead {
            0 => &[],
            1 if whole => &["Frame"],
            1 => &["Time"],
            _ => &["Frame", "Time"],
        };
        columns.extend(leads.iter().map(|name| shape::named(name)));
        for group in &groups {
            for i in 0..wide {
                columns.push(Named {
                    name: own
                        .get(i)
                        .map_or_else(|| format!("Rot[{}]", i - own.len()), |n| (*n).to_owned()),
                    group: group.clone(),
                    unit: None,
                });
            }
        }
    }
    let rate_hz = head.value("FREQUENCY", '\t').and_then(|f| number(f, '.'));
    let units = Defaults {
        length: Some("mm"),
        angle: Some("deg"),
        ..Defaults::default()
    };
    let mut found = shape("Qualisys Track Manager", file, columns, rate_hz, units);
    if let Some(stamp) = head.value("TIME_STAMP", '\t') {
        let stamp = stamp.split('\t').next().unwrap_or(stamp);
        found.remarks.push(format!(
            "the recording began {stamp}, in a zone that is not written: start_unix_s of [time] takes it, in UNIX seconds"
        ));
    }
    Some(found)
}

/// A line of keys, then rows of what each column is: type, name, id, rotation or position, axis.
pub(super) fn motive(head: &Head) -> Option<Shape> {
    let first = &head.lines.first()?.1;
    if !first.starts_with("Format Version") {
        return None;
    }
    let comma = Separator::Byte(b',');
    let keys = shape::cells(comma, first);
    let value = |key: &str| {
        let at = keys.iter().position(|k| k == key)?;
        keys.get(at + 1).map(String::as_str)
    };
    let at = head.lines.iter().position(|l| l.1.starts_with("Frame,"))?;
    let names = shape::cells(comma, &head.lines[at].1);
    let above: Vec<Vec<String>> = head.lines[1..at]
        .iter()
        .map(|l| shape::cells(comma, &l.1))
        .filter(|r| r.len() > 2)
        .collect();
    let row = |word: &str| above.iter().find(|r| r.iter().any(|c| c == word));
    let kinds = above.iter().find(|r| {
        r.iter()
            .any(|c| matches!(c.as_str(), "Rotation" | "Position"))
    });
    let types = row("Type").or_else(|| row("Rigid Body"));
    let named = row("Name").or_else(|| above.get(1));
    let of =
        |r: Option<&Vec<String>>, i: usize| r.and_then(|r| r.get(i)).cloned().unwrap_or_default();
    let columns = names
        .iter()
        .enumerate()
        .map(|(i, name)| {
            let marker = of(types, i).contains("Marker") || of(types, i).contains("Bone");
            Named {
                name: name.clone(),
                group: if i < 2 {
                    String::new()
                } else {
                    let kind = of(kinds, i);
                    format!(
                        "{}{} {kind}",
                        of(named, i),
                        if marker { " marker_quality" } else { "" }
                    )
                },
                unit: (i == 1).then(|| "s".to_owned()),
            }
        })
        .collect();
    let mut file = shape::file(head, comma, '.');
    file.header_line = Some(head.lines[at].0);
    let length = value("Length Units")
        .and_then(|u| unit::find(Dimension::Length, u))
        .map(|u| u.name);
    let rate_hz = value("Export Frame Rate")
        .or_else(|| value("Capture Frame Rate"))
        .and_then(|r| number(r, '.'));
    let units = Defaults {
        length,
        angle: Some("deg"),
        y_up: true,
        stated: length.is_some(),
    };
    let mut found = shape("OptiTrack Motive", file, columns, rate_hz, units);
    // Names repeat for every body: numbers are shorter.
    found.by_number = true;
    match value("Rotation Type") {
        None | Some("Quaternion") => {}
        Some(order) => found.remarks.push(format!(
            "rotations are angles in the order {order} about Motive's axes, which are no roll, pitch and yaw of ours: not mapped; export them as Quaternion"
        )),
    }
    if value("Coordinate Space").is_some_and(|s| s != "Global") {
        found.remarks.push(
            "coordinates are not in the global space: they are no motion in the tank".to_owned(),
        );
    }
    Some(found)
}

//! Exports of motion capture: Vicon Nexus, Qualisys Track Manager, OptiTrack Motive.

use super::super::head::Head;
use super::super::shape::{self, Defaults, Named, Shape};
use crate::map::Separator;
use crate::number::number;
use crate::unit::{self, Dimension};

/// Repeats what stands over the first of several columns.
fn spread(cells: &[String]) -> Vec<String> {
    let mut last = String::new();
    cells
        .iter()
        .map(|c| {
            if !c.is_empty() {
                last.clone_from(c);
            }
            last.clone()
        })
        .collect()
}

fn shape(
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

/// A word for the section, its rate, the bodies, names, units.
pub(super) fn vicon(head: &Head) -> Option<Shape> {
    const SECTIONS: [&str; 7] = [
        // Vicon Tracker's.
        "Objects",
        "Segments",
        "Trajectories",
        "Model Outputs",
        "Joints",
        "Global Angle (Deg)",
        "Devices",
    ];
    let bare = |i: usize| {
        head.lines
            .get(i)
            .map_or("", |l| l.1.trim_matches([',', '\t', ' ', '"']))
    };
    let sections: Vec<usize> = (0..head.lines.len().saturating_sub(4))
        .filter(|i| {
            SECTIONS.contains(&bare(*i)) && number(bare(i + 1), '.').is_some_and(|r| r > 0.0)
        })
        .collect();
    let rank = |i: &&usize| SECTIONS.iter().position(|s| *s == bare(**i));
    let start = *sections.iter().min_by_key(rank)?;
    let names_line = &head.lines[start + 3];
    let separator = if names_line.1.contains('\t') {
        b'\t'
    } else {
        b','
    };
    let separator = Separator::Byte(separator);
    let names = shape::cells(separator, &names_line.1);
    if !names.first()?.eq_ignore_ascii_case("frame") {
        return None;
    }
    let groups = spread(&shape::cells(separator, &head.lines[start + 2].1));
    let units = shape::cells(separator, &head.lines[start + 4].1);
    let columns = names
        .iter()
        .enumerate()
        .map(|(i, name)| Named {
            name: name.clone(),
            group: groups.get(i).cloned().unwrap_or_default(),
            unit: units.get(i).filter(|u| !u.is_empty()).cloned(),
        })
        .collect();
    let (columns, rotations) = turns(columns);
    let decimal = if separator != Separator::Byte(b',')
        && head.lines[start + 5..]
            .iter()
            .take(5)
            .any(|l| l.1.contains(','))
    {
        ','
    } else {
        '.'
    };
    let mut file = shape::file(head, separator, decimal);
    file.header_line = Some(names_line.0);
    file.units_line = Some(head.lines[start + 4].0);
    // Another section follows after an empty line.
    if let Some(next) = sections.iter().find(|i| **i > start) {
        let last = (start + 5..*next).rev().find(|i| !bare(*i).is_empty());
        file.last_line = last.map(|i| head.lines[i].0);
    }
    let rate_hz = number(bare(start + 1), '.');
    let units = Defaults {
        length: Some("mm"),
        ..Defaults::default()
    };
    let kind = if bare(start) == "Objects" {
        "Vicon Tracker"
    } else {
        "Vicon Nexus"
    };
    let mut found = shape(kind, file, columns, rate_hz, units);
    match rotations {
        Rotations::None => {}
        // Names are not the file's any more.
        Rotations::Quaternion => found.by_number = true,
        Rotations::Vector => found.remarks.push(
            "RX RY RZ are a rotation vector, no roll, pitch and yaw: not mapped; an export with quaternions (RX RY RZ RW) or of a model's angles is".to_owned(),
        ),
    }
    Some(found)
}

/// How a file of Vicon's writes orientations.
enum Rotations {
    None,
    Vector,
    Quaternion,
}

/// RX RY RZ are a rotation vector, no angles of roll, pitch and yaw; with RW beside them they are a quaternion.
fn turns(mut columns: Vec<Named>) -> (Vec<Named>, Rotations) {
    let has = |name: &str| columns.iter().any(|c| c.name == name);
    let kind = match (has("RX"), has("RW")) {
        (_, true) => Rotations::Quaternion,
        (true, false) => Rotations::Vector,
        (false, false) => Rotations::None,
    };
    for column in &mut columns {
        let axis = match column.name.as_str() {
            "RX" => "x",
            "RY" => "y",
            "RZ" => "z",
            "RW" => "w",
            _ => continue,
        };
        match kind {
            Rotations::Quaternion => column.name = format!("q{axis}"),
            _ => column.group += " rot",
        }
    }
    (columns, kind)
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

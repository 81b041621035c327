//! Exports of Vicon Nexus and Tracker.

use super::super::head::Head;
use super::super::shape::{self, Defaults, Named, Shape};
use super::mocap::shape;
use crate::map::Separator;
use crate::number::number;

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

/// Form of the orientations in a file of Vicon's.
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

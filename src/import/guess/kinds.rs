//! Heads and layouts that known instruments and programs write around their tables.

mod mocap;
mod ros;
mod vicon;

use super::head::Head;
use super::shape::{self, Defaults, Named, Shape};
use crate::map::Separator;
use crate::number::number;

/// A kind that is known by its first lines.
pub(super) fn known(head: &Head) -> Option<Shape> {
    vicon::vicon(head)
        .or_else(|| mocap::qualisys(head))
        .or_else(|| mocap::motive(head))
        .or_else(|| labview(head))
        .or_else(|| ros::echo(head))
        .or_else(|| shape::plain(head).map(|s| refine(s, head)))
}

/// Kinds that are plain tables with names of their own.
fn refine(mut shape: Shape, head: &Head) -> Shape {
    let has = |text: &str| shape.columns.iter().any(|c| c.name.contains(text));
    let first = shape.columns.first().map_or("", |c| c.name.as_str());
    if first.starts_with("#timestamp") && has("_R") {
        shape.kind = "EuRoC (ASL dataset format)";
        shape.units = SI;
    } else if first == "%time" {
        shape.kind = "rostopic echo -p (ROS 1)";
        shape.units = SI;
    } else if first == "__time" {
        shape.kind = "PlotJuggler";
    } else if let Some(tum) = tum(&shape, head) {
        return tum;
    } else if matlab(head) {
        shape.kind = "MATLAB (save -ascii)";
    }
    shape
}

/// ROS and what comes from it: metres and radians.
pub(super) const SI: Defaults = Defaults {
    length: Some("m"),
    angle: Some("rad"),
    y_up: false,
    stated: false,
};

/// Whether four numbers are a rotation.
pub(super) fn is_quaternion(cells: &[String], decimal: char) -> bool {
    let parts: Vec<f64> = cells.iter().filter_map(|c| number(c, decimal)).collect();
    parts.len() == 4 && (parts.iter().map(|v| v * v).sum::<f64>() - 1.0).abs() < 1e-2
}

/// `timestamp tx ty tz qx qy qz qw` without names, or with names in a line of notes.
fn tum(shape: &Shape, head: &Head) -> Option<Shape> {
    if shape.file.header
        || shape
            .columns
            .iter()
            .any(|c| !c.name.is_empty() && !is_tum_name(&c.name))
    {
        return None;
    }
    let separator = shape.file.separator?;
    let rows: Vec<Vec<String>> = head
        .lines
        .iter()
        .filter(|l| !l.1.trim_start().starts_with('#') && !l.1.trim().is_empty())
        .map(|l| shape::cells(separator, &l.1))
        .collect();
    let fits = |r: &Vec<String>| r.len() == 8 && is_quaternion(&r[4..], shape.file.decimal);
    if rows.len() < 2 || 10 * rows.iter().filter(|r| fits(r)).count() < 9 * rows.len() {
        return None;
    }
    let names = ["timestamp", "tx", "ty", "tz", "qx", "qy", "qz", "qw"];
    Some(Shape {
        kind: "TUM (trajectory format)",
        columns: names.map(shape::named).to_vec(),
        by_number: true,
        units: SI,
        ..shape.clone()
    })
}

fn is_tum_name(name: &str) -> bool {
    matches!(
        name,
        "timestamp"
            | "time"
            | "t"
            | "stamp"
            | "tx"
            | "ty"
            | "tz"
            | "x"
            | "y"
            | "z"
            | "qx"
            | "qy"
            | "qz"
            | "qw"
            | "q_x"
            | "q_y"
            | "q_z"
            | "q_w"
            | "timestamp(s)"
    )
}

/// Every number as `   1.0000000e+00`, and nothing else.
fn matlab(head: &Head) -> bool {
    let like = |line: &str| {
        line.starts_with(' ')
            && line.split_whitespace().all(|c| {
                let bare = c.trim_start_matches('-');
                bare.len() >= 13 && bare.as_bytes().get(1) == Some(&b'.') && bare.contains('e')
            })
    };
    head.lines.len() > 2 && head.lines.iter().all(|l| like(&l.1) || l.1.is_empty())
}

/// A LabVIEW measurement file: two heads, each ended by a line that says so.
fn labview(head: &Head) -> Option<Shape> {
    let first = &head.lines.first()?.1;
    if !first.starts_with("LabVIEW Measurement") {
        return None;
    }
    let tab = first.contains('\t') || head.lines.iter().any(|l| l.1.starts_with("Separator\t"));
    let (separator, mark) = if tab {
        (Separator::Byte(b'\t'), '\t')
    } else {
        (Separator::Byte(b','), ',')
    };
    let decimal = if head.value("Decimal_Separator", mark) == Some(",") {
        ','
    } else {
        '.'
    };
    let ends: Vec<usize> = (0..head.lines.len())
        .filter(|i| head.lines[*i].1.starts_with("***End_of_Header***"))
        .collect();
    let last = *ends.get(1).or(ends.first())?;
    let names = head.lines[last + 1..]
        .iter()
        .find(|l| !l.1.trim().is_empty())?;
    let mut file = shape::file(head, separator, decimal);
    file.header_line = Some(names.0);
    let mut columns: Vec<Named> = shape::cells(separator, &names.1)
        .iter()
        .map(|n| shape::named(n))
        .collect();
    let labels = |key: &str| -> Vec<String> {
        let line = head.lines[..last]
            .iter()
            .rev()
            .find(|l| l.1.starts_with(key));
        line.map_or_else(Vec::new, |l| {
            shape::cells(separator, &l.1).into_iter().skip(1).collect()
        })
    };
    for (column, unit) in columns.iter_mut().skip(1).zip(labels("Y_Unit_Label")) {
        column.unit = Some(unit).filter(|u| shape::is_unit(u));
    }
    if let Some(time) = columns.first_mut() {
        // X_Dimension is Time, whose unit is the second unless it is stated.
        let stated = labels("X_Unit_Label").into_iter().next();
        time.unit = Some(
            stated
                .filter(|u| shape::is_unit(u))
                .unwrap_or_else(|| "s".to_owned()),
        );
    }
    let mut remarks = Vec::new();
    if let (Some(date), Some(clock)) = (head.value("Date", mark), head.value("Time", mark)) {
        remarks.push(format!(
            "the recording began {date} {clock}, in a zone that is not written: start_unix_s of [time] takes it, in UNIX seconds",
            clock = clock.trim(), date = date.trim()
        ));
    }
    if let [_, first, others @ ..] = &ends[..]
        && !others.is_empty()
    {
        let line = |i: usize| head.lines[i].0;
        let starts: Vec<String> = std::iter::once(first)
            .chain(others)
            .map(|i| (line(*i) + 1).to_string())
            .collect();
        remarks.push(format!(
            "{} segments, or more: each has its names on a line of its own ({}), and a map reads one: import each by itself, with header_line on that line and last_line before the next segment's head",
            starts.len(),
            starts.join(", ")
        ));
    }
    let step_s = labels("Delta_X")
        .first()
        .and_then(|d| number(d, decimal))
        .filter(|d| *d > 0.0);
    Some(Shape {
        kind: "LabVIEW (measurement file)",
        by_number: false,
        file,
        columns,
        rate_hz: step_s.map(|d| 1.0 / d),
        units: Defaults::default(),
        remarks,
        open: Vec::new(),
    })
}

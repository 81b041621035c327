//! Findings about commands: dead, twice, unknown to the rig, or beyond what it can do.

use hydroline_rigs::{Dof, Rig};

use super::super::map::Map;
use super::super::table::Imported;
use super::Finding;
use hydroline_identify::data::capacity;

/// A thrust this many times the thruster's largest is another unit, not a strong thruster.
const ABSURD: f64 = 20.0;
/// The same of a component `surge` .. `yaw` against what all thrusters make together.
const ABSURD_TOGETHER: f64 = 5.0;

/// Adds what commands show by themselves and, with a rig, against it.
pub(super) fn check(data: &Imported, map: &Map, rig: Option<&Rig>, findings: &mut Vec<Finding>) {
    for (i, c) in map.commands.iter().enumerate() {
        if map.commands[..i].iter().any(|o| o.thruster == c.thruster) {
            findings.push(Finding::fault(
                "duplicate_thruster",
                None,
                format!(
                    "command {}: more than one column is mapped to it; the last would overrule the others at every stamp",
                    c.thruster
                ),
            ));
        }
    }
    for (c, values) in map.commands.iter().zip(&data.commands) {
        let present = || values.iter().copied().filter(|v| v.is_finite());
        let (low, high) = present().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| {
            (l.min(v), h.max(v))
        });
        if low == high && values.len() >= 4 {
            let words = if low == 0.0 {
                "always 0: a run at rest or a decay, or a dead column".to_owned()
            } else {
                format!("always {low}, also in the first row: a constant load, or a dead column")
            };
            findings.push(Finding::warning(
                "dead_command",
                None,
                format!("command {} (column '{}'): {words}", c.thruster, c.column),
            ));
        }
        let Some(rig) = rig else { continue };
        let Some(limit) = capacity(rig, &c.thruster) else {
            let known: Vec<&str> = rig
                .thrusters
                .thrusters
                .iter()
                .map(|t| t.name.as_str())
                .chain(Dof::ALL.map(Dof::name))
                .collect();
            findings.push(Finding::fault(
                "unknown_thruster",
                None,
                format!(
                    "command {}: no thruster of the rig {} and no component; there are {}",
                    c.thruster,
                    rig.name,
                    known.join(", ")
                ),
            ));
            continue;
        };
        let (largest, row) = values.iter().enumerate().fold((0.0_f64, 0), |m, (k, v)| {
            if v.abs() > m.0 { (v.abs(), k) } else { m }
        });
        let component = Dof::ALL.iter().any(|d| d.name() == c.thruster);
        let absurd = if component { ABSURD_TOGETHER } else { ABSURD };
        if limit > 0.0 && largest >= absurd * limit {
            findings.push(Finding::fault(
                "command_size",
                data.lines.get(row).copied(),
                format!(
                    "command {}: reaches {largest:.4}, {:.0} times the most the rig can make ({limit:.4}): millinewtons or pulses mapped as newtons? scale of the map",
                    c.thruster,
                    largest / limit
                ),
            ));
        }
    }
    if rig.is_none() && !map.commands.is_empty() {
        findings.push(Finding::info(
            "commands_unchecked",
            "names and sizes of the commands were not held against a rig; give --rig".to_owned(),
        ));
    }
}

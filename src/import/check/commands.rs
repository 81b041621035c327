//! Findings about commands: dead, twice, unknown to the rig, or beyond what it can do.

use hydroline_rigs::{Dof, Rig};

use super::channel::Extent;
use super::{Finding, FindingList};
use crate::map::{CommandMap, Map, Origin};
use crate::table::Imported;
use hydroline_identify::data::capacity;

/// A thrust this many times the thruster's largest is another unit, not a strong thruster.
const ABSURD: f64 = 20.0;
/// The same of a component `surge` .. `yaw` against what all thrusters make together.
const ABSURD_TOGETHER: f64 = 5.0;

/// Extent and largest size of each command's load so far.
#[derive(Debug)]
pub(super) struct Loads {
    extents: Vec<Extent>,
    /// Largest size and its line.
    largest: Vec<(f64, Option<u64>)>,
    rows: usize,
}

impl Loads {
    pub fn new(map: &Map) -> Self {
        Loads {
            extents: vec![Extent::default(); map.commands.len()],
            largest: vec![(0.0, None); map.commands.len()],
            rows: 0,
        }
    }

    /// The rows of a stretch from `fresh` on.
    pub fn stretch(&mut self, data: &Imported, fresh: usize) {
        self.rows += data.times_s.len() - fresh;
        for (i, values) in data.commands.iter().enumerate() {
            self.extents[i].add(&values[fresh..]);
            for (k, v) in values.iter().enumerate().skip(fresh) {
                if v.abs() > self.largest[i].0 {
                    self.largest[i] = (v.abs(), data.lines.get(k).copied());
                }
            }
        }
    }

    /// Adds what commands show by themselves and, with a rig, against it.
    pub fn report(&self, map: &Map, rig: Option<&Rig>, findings: &mut Vec<Finding>) {
        for (i, c) in map.commands.iter().enumerate() {
            if map.commands[..i].iter().any(|o| o.thruster == c.thruster) {
                findings.fault(
                    "duplicate_thruster",
                    format!(
                        "command {}: more than one column is mapped to it; the last would overrule the others at every stamp",
                        c.thruster,
                    ),
                );
            }
            self.alone(i, c, findings);
            if let Some(rig) = rig {
                self.against(i, c, rig, findings);
            }
        }
        if rig.is_none() && !map.commands.is_empty() {
            findings.info(
                "commands_unchecked",
                "names and sizes of the commands were not held against a rig; give --rig"
                    .to_owned(),
            );
        }
    }

    fn alone(&self, i: usize, c: &CommandMap, findings: &mut Vec<Finding>) {
        let Extent { count, low, high } = self.extents[i];
        if count == 0 || low != high || self.rows < 4 || matches!(c.origin, Origin::Value(_)) {
            return;
        }
        let words = if low == 0.0 {
            "always 0: a run at rest or a decay, or a dead column".to_owned()
        } else {
            format!("always {low}, also in the first row: a constant load, or a dead column")
        };
        findings.warning(
            "dead_command",
            format!("command {} ({}): {words}", c.thruster, c.origin.words()),
        );
    }

    fn against(&self, i: usize, c: &CommandMap, rig: &Rig, findings: &mut Vec<Finding>) {
        let Some(limit) = capacity(rig, &c.thruster) else {
            let known: Vec<&str> = rig
                .thrusters
                .thrusters
                .iter()
                .map(|t| t.name.as_str())
                .chain(Dof::ALL.map(Dof::name))
                .collect();
            findings.fault(
                "unknown_thruster",
                format!(
                    "command {}: no thruster of the rig {} and no component; there are {}",
                    c.thruster,
                    rig.name,
                    known.join(", ")
                ),
            );
            return;
        };
        let (largest, line) = self.largest[i];
        let component = Dof::ALL.iter().any(|d| d.name() == c.thruster);
        let absurd = if component { ABSURD_TOGETHER } else { ABSURD };
        if limit > 0.0 && largest >= absurd * limit {
            findings.fault_at(
                "command_size",
                line,
                format!(
                    "command {}: reaches {largest:.4}, {:.0} times the most the rig can make ({limit:.4}): millinewtons or pulses mapped as newtons? unit of the map",
                    c.thruster,
                    largest / limit,
                ),
            );
        }
    }
}

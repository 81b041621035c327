//! One row's cells to SI.

use super::{Columns, Sample};
use crate::attitude::{euler, to_body};
use crate::cells::Cells;
use crate::check::{Finding, FindingList};
use crate::map::{FileMap, Map, Missing, Origin, PLACES, place_name};
use crate::number::{BadCells, number, says_nothing, ungrouped};

/// Reads the cells of one row after the other.
pub(crate) struct Reader<'a> {
    map: &'a Map,
    columns: &'a Columns<'a>,
    pub bad: BadCells,
    /// Last value per place, quaternion and command, for what holds.
    held: [f64; PLACES],
    held_quaternion: [f64; 4],
    held_commands: Vec<f64>,
    sample: Sample,
    /// Rows whose quaternion has another length than 1: count, first line, its length.
    no_unit: (usize, u64, f64),
    /// Rows with velocities and without the angles to turn them.
    not_rotated: (usize, u64),
    /// Last whole attitude and its time \[s\]: of a row that holds none, where rows need not.
    attitude: Option<([f64; 3], f64)>,
    /// Rows rotated by it, and how old it was at most \[s\].
    rotated_by_last: (usize, f64),
    /// Pulses beyond the curve: count, first line, pulse, name.
    beyond: Option<(usize, u64, f64, String)>,
}

/// An attitude this old still turns a velocity \[s\].
const ATTITUDE_AGE_S: f64 = 0.5;

/// Meaning of an empty cell, and a number that means one.
type Empty = (Missing, Option<f64>);

/// A cell's number, or what stands for it; NaN = nothing.
fn value(
    cell: &str,
    file: &FileMap,
    (missing, missing_value): Empty,
    held: &mut f64,
    note: impl FnOnce(&str),
) -> f64 {
    match number(&ungrouped(cell, file.thousands, file.decimal), file.decimal) {
        Some(v) if missing_value != Some(v) => {
            *held = v;
            v
        }
        empty if missing != Missing::Fault && (empty.is_some() || says_nothing(cell)) => {
            match missing {
                Missing::Hold => *held,
                _ => f64::NAN,
            }
        }
        _ => {
            note(cell);
            f64::NAN
        }
    }
}

impl<'a> Reader<'a> {
    pub fn new(map: &'a Map, columns: &'a Columns<'a>) -> Self {
        let nothing = vec![f64::NAN; map.commands.len()];
        Reader {
            map,
            columns,
            bad: BadCells::default(),
            held: [f64::NAN; PLACES],
            held_quaternion: [f64::NAN; 4],
            held_commands: nothing.clone(),
            sample: Sample {
                line: 0,
                t_s: 0.0,
                values: [f64::NAN; PLACES],
                commands: nothing,
                pulses_us: vec![0.0; map.commands.len()],
                compare_s: f64::NAN,
            },
            no_unit: (0, 0, 0.0),
            not_rotated: (0, 0),
            attitude: None,
            rotated_by_last: (0, 0.0),
            beyond: None,
        }
    }

    pub fn read(&mut self, cells: Cells<'_>, line: u64, t_s: f64) -> &Sample {
        let file = &self.map.file;
        self.sample.line = line;
        self.sample.t_s = t_s;
        for (channel, column) in &self.columns.channels {
            let place = channel.place;
            let raw = match (&channel.origin, column) {
                (Origin::Value(v), _) => *v,
                (_, None) => f64::NAN,
                (Origin::Column(name), Some(column)) => {
                    let bad = &mut self.bad;
                    value(
                        cells.get(*column),
                        file,
                        (channel.missing, channel.missing_value),
                        &mut self.held[place],
                        |cell| {
                            bad.note(&name.to_string(), line, cell);
                        },
                    )
                }
            };
            self.sample.values[place] = raw * channel.factor + channel.offset;
        }
        self.quaternion(cells, line);
        if self.columns.in_tank {
            self.turn(line);
        }
        self.commands(cells, line);
        if let Some((column, unit_s)) = self.columns.compare {
            let cell = ungrouped(cells.get(column), file.thousands, file.decimal);
            let second = number(&cell, file.decimal);
            self.sample.compare_s = second.map_or(f64::NAN, |v| v * unit_s);
        }
        &self.sample
    }

    fn quaternion(&mut self, cells: Cells<'_>, line: u64) {
        let Some((map, places)) = &self.columns.quaternion else {
            return;
        };
        let mut wxyz = [f64::NAN; 4];
        for (i, place) in places.iter().enumerate() {
            let Some(place) = place else { continue };
            let bad = &mut self.bad;
            let (file, held) = (&self.map.file, &mut self.held_quaternion[i]);
            wxyz[i] = value(cells.get(*place), file, (map.missing, None), held, |cell| {
                bad.note(&map.wxyz[i].to_string(), line, cell);
            });
        }
        // One part of a quaternion may well be 0: only all of them together stand for none.
        if map.missing_value.is_some_and(|v| wxyz == [v; 4]) {
            wxyz = [f64::NAN; 4];
        }
        let angles = euler(wxyz, map.axes);
        let whole = wxyz.iter().all(|v| v.is_finite());
        if angles.is_none() && whole {
            if self.no_unit.0 == 0 {
                let length = wxyz.iter().map(|v| v * v).sum::<f64>().sqrt();
                (self.no_unit.1, self.no_unit.2) = (line, length);
            }
            self.no_unit.0 += 1;
        }
        self.sample.values[3..6].copy_from_slice(&angles.unwrap_or([f64::NAN; 3]));
    }

    /// Velocities along the tank's axes into the body's; what the map leaves out is 0.
    fn turn(&mut self, line: u64) {
        let values = &mut self.sample.values;
        let of = |p: usize| match self.map.missing(p) {
            Some(_) => values[p],
            None => 0.0,
        };
        let (mut angles, tank) = ([3, 4, 5].map(of), [6, 7, 8].map(of));
        let measured = tank.iter().all(|v| v.is_finite());
        let t_s = self.sample.t_s;
        let may_lack = (3..6).any(|p| self.map.missing(p) == Some(Missing::Skip));
        let mut is_early = false;
        if angles.iter().all(|a| a.is_finite()) {
            self.attitude = Some((angles, t_s));
        } else if measured && may_lack {
            // Measured in other rows than the velocities.
            match self.attitude {
                Some((last, at_s)) if t_s - at_s <= ATTITUDE_AGE_S => {
                    angles = last;
                    self.rotated_by_last.0 += 1;
                    self.rotated_by_last.1 = self.rotated_by_last.1.max(t_s - at_s);
                }
                Some(_) => {}
                None => is_early = true,
            }
        }
        if measured && !is_early && angles.iter().any(|a| !a.is_finite()) {
            if self.not_rotated.0 == 0 {
                self.not_rotated.1 = line;
            }
            self.not_rotated.0 += 1;
        }
        let body = to_body(angles, tank);
        for (c, own) in (6..9).zip(body) {
            if self.map.missing(c).is_some() {
                values[c] = own;
            }
        }
    }

    fn commands(&mut self, cells: Cells<'_>, line: u64) {
        for (i, load) in self.columns.commands.iter().enumerate() {
            let command = load.map;
            let raw = match (&command.origin, load.place) {
                (Origin::Value(v), _) => *v,
                (_, None) => f64::NAN,
                (Origin::Column(name), Some(column)) => {
                    let (bad, held) = (&mut self.bad, &mut self.held_commands[i]);
                    // A command that is not given holds anyway: nothing is repeated.
                    let missing = match command.missing {
                        Missing::Hold => Missing::Skip,
                        other => other,
                    };
                    value(
                        cells.get(column),
                        &self.map.file,
                        (missing, command.missing_value),
                        held,
                        |cell| {
                            bad.note(&name.to_string(), line, cell);
                        },
                    )
                }
            };
            let own = raw * command.factor + command.offset;
            self.sample.commands[i] = own;
            if !command.pulse {
                continue;
            }
            self.sample.pulses_us[i] = if own.is_finite() { own } else { 0.0 };
            self.sample.commands[i] = load.curve.map_or(f64::NAN, |curve| {
                let ends = (curve.points.first(), curve.points.last());
                if let (Some(first), Some(last)) = ends
                    && own.is_finite()
                    && !(first.0..=last.0).contains(&own)
                {
                    match &mut self.beyond {
                        Some(b) => b.0 += 1,
                        None => self.beyond = Some((1, line, own, command.thruster.clone())),
                    }
                    return f64::NAN;
                }
                if own.is_finite() {
                    curve.thrust_n(own)
                } else {
                    f64::NAN
                }
            });
        }
    }

    /// Adds what was found in cells.
    pub fn report(&self, findings: &mut Vec<Finding>) {
        self.bad.report(self.map, findings);
        let (count, line, length) = self.no_unit;
        if count > 0 {
            findings.fault_at("quaternion", Some(line), format!("{count} quaternion(s) are none of rotation, the first on line {line} of length {length:.4}: a lost body, or other columns?"));
        }
        let (count, line) = self.not_rotated;
        if count > 0 {
            let names: Vec<&str> = (3..6)
                .filter(|p| self.map.missing(*p).is_some())
                .map(place_name)
                .collect();
            findings.fault_at(
                "velocity_frame",
                Some(line),
                format!(
                    "{count} row(s) have velocities in the tank's frame and no {} to turn them by, the first on line {line}; missing = \"hold\" on the angles takes the last ones",
                    names.join(", "),
                ),
            );
        }
        let (count, age_s) = self.rotated_by_last;
        if count > 0 {
            findings.info("velocity_frame", format!("{count} row(s) with velocities in the tank's frame hold no angles: rotated by those of a row up to {age_s:.3} s before"));
        }
        if let Some((count, line, pulse_us, name)) = &self.beyond {
            findings.fault_at("pulse_range", Some(*line), format!("command {name}: {count} pulse(s) beyond the rig's curve, the first on line {line}: {pulse_us} us; is it a pulse width, and the unit of the map right?"));
        }
    }
}

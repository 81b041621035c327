//! One row's cells to SI.

use super::{Columns, Sample};
use crate::attitude::{euler, to_body};
use crate::cells::Cells;
use crate::check::{Finding, FindingList};
use crate::map::{FileMap, Map, Missing, MissingValues, Origin, PLACES, place_name};
use crate::number::{BadCells, has_bare_exponent, number, says_nothing, ungrouped};

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
    /// Texts of a quaternion's cells that mean nothing; its numbers do so only all four together.
    quaternion_texts: MissingValues,
    /// Rows whose quaternion is of zeros, where it may be missing: count, first line.
    no_rotation: (usize, u64),
    /// Numbers whose exponent stands without its letter: count, first line, column, cell.
    bare_exponent: Option<(usize, u64, String, String)>,
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

/// Meaning of an empty cell, and what else means one.
type Empty<'a> = (Missing, &'a MissingValues);

/// Kind of a cell that gives no number, though one is needed.
enum Bad<'a> {
    /// It is none.
    Unreadable(&'a str),
    /// The map says that it means nothing.
    Stated(&'a str),
    /// It is read, though its exponent has no letter.
    BareExponent(&'a str),
}

/// A cell's number, or what stands for it; NaN = nothing.
fn value(
    cell: &str,
    file: &FileMap,
    (missing, missing_values): Empty<'_>,
    held: &mut f64,
    note: impl FnOnce(Bad<'_>),
) -> f64 {
    let found = number(&ungrouped(cell, file.thousands, file.decimal), file.decimal);
    let is_stated = missing_values.has(cell, found);
    match found {
        Some(v) if !is_stated => {
            if has_bare_exponent(cell) {
                note(Bad::BareExponent(cell));
            }
            *held = v;
            v
        }
        _ if missing != Missing::Fault && (is_stated || says_nothing(cell)) => match missing {
            Missing::Hold => *held,
            _ => f64::NAN,
        },
        _ => {
            note(if is_stated {
                Bad::Stated(cell)
            } else {
                Bad::Unreadable(cell)
            });
            f64::NAN
        }
    }
}

/// Notes of cells that are no plain numbers.
struct Notes<'a> {
    bad: &'a mut BadCells,
    bare_exponent: &'a mut Option<(usize, u64, String, String)>,
    line: u64,
}

impl Notes<'_> {
    fn add(self, column: &str, cell: Bad<'_>) {
        match cell {
            Bad::Unreadable(cell) => self.bad.note(column, self.line, cell),
            Bad::Stated(cell) => self.bad.note_stated(column, self.line, cell),
            Bad::BareExponent(cell) => match self.bare_exponent {
                Some(seen) => seen.0 += 1,
                None => {
                    *self.bare_exponent = Some((1, self.line, column.to_owned(), cell.to_owned()));
                }
            },
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
            quaternion_texts: MissingValues {
                numbers: Vec::new(),
                texts: map
                    .quaternion
                    .as_ref()
                    .map_or_else(Vec::new, |q| q.missing_values.texts.clone()),
            },
            no_rotation: (0, 0),
            bare_exponent: None,
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
                    let notes = Notes {
                        bad: &mut self.bad,
                        bare_exponent: &mut self.bare_exponent,
                        line,
                    };
                    value(
                        cells.get(*column),
                        file,
                        (channel.missing, &channel.missing_values),
                        &mut self.held[place],
                        |cell| notes.add(&name.to_string(), cell),
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
        // What holds is filled in when all four are known.
        let missing = match map.missing {
            Missing::Hold => Missing::Skip,
            other => other,
        };
        let mut wxyz = [f64::NAN; 4];
        for (i, place) in places.iter().enumerate() {
            let Some(place) = place else { continue };
            let notes = Notes {
                bad: &mut self.bad,
                bare_exponent: &mut self.bare_exponent,
                line,
            };
            let empty = (missing, &self.quaternion_texts);
            let (file, mut unused) = (&self.map.file, f64::NAN);
            wxyz[i] = value(cells.get(*place), file, empty, &mut unused, |cell| {
                notes.add(&map.wxyz[i].to_string(), cell);
            });
        }
        // One part of a quaternion may well be 0: only all of them together stand for none, and four zeros are no rotation.
        let is_stated = map.missing_values.numbers.iter().any(|v| wxyz == [*v; 4]);
        if is_stated || (map.missing != Missing::Fault && wxyz == [0.0; 4]) {
            wxyz = [f64::NAN; 4];
            if map.missing == Missing::Fault {
                let cell = places[0].map_or("", |p| cells.get(p));
                self.bad.note_stated(&map.wxyz[0].to_string(), line, cell);
            } else {
                if self.no_rotation.0 == 0 {
                    self.no_rotation.1 = line;
                }
                self.no_rotation.0 += 1;
            }
        }
        if map.missing == Missing::Hold {
            for (own, held) in wxyz.iter_mut().zip(&mut self.held_quaternion) {
                if own.is_nan() {
                    *own = *held;
                } else {
                    *held = *own;
                }
            }
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
                    let held = &mut self.held_commands[i];
                    let notes = Notes {
                        bad: &mut self.bad,
                        bare_exponent: &mut self.bare_exponent,
                        line,
                    };
                    // A command that is not given holds anyway: nothing is repeated.
                    let missing = match command.missing {
                        Missing::Hold => Missing::Skip,
                        other => other,
                    };
                    value(
                        cells.get(column),
                        &self.map.file,
                        (missing, &command.missing_values),
                        held,
                        |cell| notes.add(&name.to_string(), cell),
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
        let (count, line) = self.no_rotation;
        if count > 0 {
            findings.info("quaternion", format!("{count} quaternion(s) of nothing but zeros or the map's missing_value, the first on line {line}: not measured there"));
        }
        if let Some((count, line, column, cell)) = &self.bare_exponent {
            findings.info("bare_exponent", format!("column '{column}': {count} number(s) like '{cell}' (line {line}) are read with an exponent whose letter is left out, as Fortran writes 3.1E-114"));
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

//! A run as one table: pose with its sds, velocities, loads and thrusts, what is to be known of each row.
//!
//! Commands are given at stamps of their own, between those of the poses. A row holds a load's mean from its stamp to the
//! next row's: held until there, as a table is read, it gives the impulse that the commands gave when they did, so that a
//! fit to the table finds what a fit to the log does. The load in force at the stamp would come up to a row late.

use std::collections::BTreeMap;
use std::fmt::Display;
use std::io::{self, Write};
use std::path::Path;

use hydroline_log::messages::{Stamped, pb};
use hydroline_log::{LogReader, MetadataMap, Record};
use hydroline_numerics::statistics::median;
use hydroline_rigs::{Dof, Rig};

use super::data::{LoadError, load_messages};
use hydroline_core::run::{COMPANIONS, Channel, Command, Run};

/// Longer than so many usual steps is a gap.
const GAP_STEPS: f64 = 3.0;
/// Names of the load's components with their units.
const LOADS: [&str; 6] = [
    "surge_n", "sway_n", "heave_n", "roll_nm", "pitch_nm", "yaw_nm",
];

/// A run, ready to be written.
#[derive(Debug, Clone, Default)]
pub struct Merged {
    run: Run,
    /// Stamps of the samples \[ns\], exact however long the run; empty = of no use.
    stamps_ns: Vec<u64>,
    /// Companions per sample.
    companions: BTreeMap<u64, [Option<f64>; COMPANIONS.len()]>,
    /// Thrusts by thruster: (t \[s\], N), ascending.
    thrusts: BTreeMap<String, Vec<(f64, f64)>>,
    /// Load over time; `None` = it is not known what the thrusters make.
    wrench: Option<Vec<Command>>,
    /// Faults of frames and losses before them, in words, by the frames' stamps.
    frames: BTreeMap<u64, String>,
    /// What the log says of its session.
    session: MetadataMap,
    /// Reason why the load is not known.
    pub note: Option<String>,
}

impl Merged {
    /// Reads a log. The load is that of `rig`, or of the rig in the log.
    ///
    /// # Errors
    /// [`LoadError`].
    pub fn read(path: &Path, rig: Option<&Rig>) -> Result<Merged, LoadError> {
        let (mut commands, mut motion, mut frames) = (Vec::new(), Vec::new(), BTreeMap::new());
        let mut companions = BTreeMap::new();
        let mut reader = LogReader::open(path)?;
        for message in reader.by_ref() {
            match message?.record {
                Record::Command(c) => commands.push(c),
                Record::Motion(m) => {
                    let own = [m.rudder_rad, m.elevator_rad, m.shaft_radps, m.wave_m];
                    if own.iter().any(Option::is_some) {
                        companions.insert(m.stamp_ns().unwrap_or(0), own);
                    }
                    motion.push(m);
                }
                Record::FrameInfo(f) => {
                    let mut words = Vec::new();
                    if !f.fault.is_empty() {
                        words.push(format!("frame_{}", f.fault));
                    }
                    if f.sequence_gap_before + f.time_gap_before > 0 {
                        words.push("frames_lost_before".to_owned());
                    }
                    if let (false, Some(ns)) = (words.is_empty(), f.stamp_ns()) {
                        frames.insert(ns, words.join(" "));
                    }
                }
                _ => {}
            }
        }
        if motion.is_empty() {
            return Err(LoadError::NoMotion {
                log: path.display().to_string(),
                frames: frames.len(),
            });
        }
        let session = reader.metadata().get("session").cloned();
        let own = reader
            .rig_toml()
            .and_then(|t| Rig::from_toml(t, "the log's rig", None).ok());
        let name = path.display().to_string();
        let mut note = None;
        let (run, wrench) = match rig.or(own.as_ref()) {
            Some(rig) => {
                let run = load_messages(&name, &commands, &motion, rig)?;
                let wrench = run.commands.clone();
                (run, Some(wrench))
            }
            None => alone(&name, &commands, &motion, &mut note)?,
        };
        let start_ns = run.start_ns;
        let mut thrusts: BTreeMap<String, Vec<(f64, f64)>> = BTreeMap::new();
        for c in &commands {
            if Dof::ALL.iter().all(|d| d.name() != c.thruster) {
                let since = c.stamp_ns().unwrap_or(0).saturating_sub(start_ns);
                let own = thrusts.entry(c.thruster.clone()).or_default();
                own.push((since as f64 * 1e-9, c.thrust_n));
            }
        }
        for own in thrusts.values_mut() {
            own.sort_by(|a, b| a.0.total_cmp(&b.0));
        }
        let mut stamps_ns: Vec<u64> = motion
            .iter()
            .filter(|m| m.channels().into_iter().flatten().any(f64::is_finite))
            .map(|m| m.stamp_ns().unwrap_or(0))
            .collect();
        stamps_ns.sort_unstable();
        stamps_ns.dedup();
        if stamps_ns.len() != run.samples.len() {
            stamps_ns.clear();
        }
        Ok(Merged {
            run,
            stamps_ns,
            companions,
            thrusts,
            wrench,
            frames,
            session: session.unwrap_or_default(),
            note,
        })
    }

    /// The run that the table is of.
    pub fn run(&self) -> &Run {
        &self.run
    }

    /// What the log says of its session.
    pub fn session(&self) -> &MetadataMap {
        &self.session
    }

    /// Number of rows of the table, without its header.
    pub fn rows(&self) -> usize {
        self.run.samples.len()
    }

    /// Writes the table: numbers as short as they read back, nothing where nothing is known.
    ///
    /// # Errors
    /// Those of `out`.
    pub fn write(&self, mut out: impl Write) -> io::Result<()> {
        let mut names: Vec<String> = vec!["t_s".to_owned(), "timestamp_ns".to_owned()];
        let own = |c: Channel| c.name().to_owned();
        names.extend(Channel::POSES.map(own));
        // x_m -> x_sd_m
        names.extend(Channel::POSES.map(|c| c.name().replacen('_', "_sd_", 1)));
        names.extend(Channel::RATES.map(own));
        names.extend(COMPANIONS.iter().map(|c| (*c).to_owned()));
        names.extend(LOADS.iter().map(|l| (*l).to_owned()));
        names.extend(self.thrusts.keys().map(|t| plain(&format!("thrust_{t}_n"))));
        names.push("flags".to_owned());
        writeln!(out, "{}", names.join(","))?;
        let mut steps: Vec<f64> = self
            .run
            .samples
            .windows(2)
            .map(|w| w[1].t_s - w[0].t_s)
            .collect();
        let usual_s = median(&mut steps).unwrap_or(0.0);
        let mut before_s = None;
        for (k, sample) in self.run.samples.iter().enumerate() {
            let next_s = self.run.samples.get(k + 1).map_or(sample.t_s, |s| s.t_s);
            let row_s = [sample.t_s, next_s];
            let since_ns = (sample.t_s * 1e9).round() as u64;
            let rounded = || self.run.start_ns.saturating_add(since_ns);
            let stamp_ns = self.stamps_ns.get(k).copied().unwrap_or_else(rounded);
            let mut cells: Vec<String> = vec![number(sample.t_s), stamp_ns.to_string()];
            cells.extend(sample.values.pose().map(number));
            cells.extend(Channel::POSES.map(|c| {
                let own = sample.variance(c).map(f64::sqrt);
                // Of what is not measured there is no sd.
                own.filter(|_| sample.values[c].is_finite())
                    .map_or(String::new(), number)
            }));
            cells.extend(sample.values.rates().map(number));
            let beside = self.companions.get(&stamp_ns).copied().unwrap_or_default();
            cells.extend(beside.iter().map(|v| v.map_or(String::new(), number)));
            let loads = (0..6).map(|d| {
                let own = self.wrench.as_deref()?;
                mean(own, |c| (c.t_s, c.wrench[d]), row_s)
            });
            let thrusts = self.thrusts.values().map(|own| mean(own, |c| *c, row_s));
            let all: Vec<Option<Mean>> = loads.chain(thrusts).collect();
            let cell = |m: &Option<Mean>| m.map_or(String::new(), |m| number(m.value));
            cells.extend(all.iter().map(cell));
            let mut flags: Vec<&str> = Vec::new();
            // Over a gap the impulse is right, the way is not.
            let is_gap = next_s - sample.t_s > GAP_STEPS * usual_s;
            if is_gap && all.iter().flatten().any(|m| m.changes) {
                flags.push("loads_change_in_gap");
            }
            if self.first_command_s().is_some_and(|t| sample.t_s < t) {
                flags.push("before_commands");
            }
            if before_s.is_some_and(|b| sample.t_s - b > GAP_STEPS * usual_s) {
                flags.push("gap_before");
            }
            if let Some(words) = self.frames.get(&stamp_ns) {
                flags.push(words);
            }
            before_s = Some(sample.t_s);
            cells.push(plain(&flags.join(" ")));
            writeln!(out, "{}", cells.join(","))?;
        }
        out.flush()
    }

    fn first_command_s(&self) -> Option<f64> {
        let thrusts = self.thrusts.values().filter_map(|t| t.first()).map(|c| c.0);
        let loads = self.wrench.iter().flatten().map(|c| c.t_s);
        thrusts.chain(loads).reduce(f64::min)
    }
}

/// Mean of a load over a row.
#[derive(Debug, Clone, Copy)]
struct Mean {
    value: f64,
    /// Whether it changes within the row.
    changes: bool,
}

/// Mean over a row of what each command holds until the next, 0 before the first, given as (stamp \[s\], value), ascending;
/// of a row without length the value in force. `None` = nothing is commanded before the row's end.
fn mean<C>(
    commands: &[C],
    of: impl Fn(&C) -> (f64, f64),
    [from_s, to_s]: [f64; 2],
) -> Option<Mean> {
    let before = commands.partition_point(|c| of(c).0 <= from_s);
    let within = commands[before..].iter().map(&of);
    let within: Vec<(f64, f64)> = within.take_while(|c| c.0 < to_s).collect();
    let in_force = before.checked_sub(1).map(|k| of(&commands[k]).1);
    if in_force.is_none() && within.is_empty() {
        return None;
    }
    let (mut now_s, mut value, mut impulse) = (from_s, in_force.unwrap_or(0.0), 0.0);
    let mut changes = false;
    for (t_s, next) in within {
        impulse += value * (t_s - now_s);
        changes |= next != value;
        (now_s, value) = (t_s, next);
    }
    if !changes {
        // As it was commanded, to the last digit.
        return Some(Mean { value, changes });
    }
    let value = (impulse + value * (to_s - now_s)) / (to_s - from_s);
    Some(Mean { value, changes })
}

/// Without a rig: components of the load are known as they are, what thrusters make is not.
fn alone(
    name: &str,
    commands: &[pb::ThrusterCommand],
    motion: &[pb::VehicleMotion],
    note: &mut Option<String>,
) -> Result<(Run, Option<Vec<Command>>), LoadError> {
    let Ok(any) = Rig::builtin("lshpi") else {
        return Ok((Run::default(), None));
    };
    let foreign = commands
        .iter()
        .find(|c| Dof::ALL.iter().all(|d| d.name() != c.thruster));
    if let Some(c) = foreign {
        *note = Some(format!(
            "the log holds no rig, so that the load of '{}' is not known: give --rig",
            c.thruster
        ));
        return Ok((load_messages(name, &[], motion, &any)?, None));
    }
    let run = load_messages(name, commands, motion, &any)?;
    let wrench = run.commands.clone();
    Ok((run, Some(wrench)))
}

/// Nothing for what is not known.
fn number(value: f64) -> String {
    if value.is_finite() {
        display(value)
    } else {
        String::new()
    }
}

fn display(value: impl Display) -> String {
    value.to_string()
}

/// A text of a log as a cell: no separator, no line end, no formula.
fn plain(text: &str) -> String {
    let own = text.replace([',', '"', '\n', '\r'], " ");
    hydroline_core::plain::cell(&own).into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;
    use hydroline_core::run::{PerChannel, Sample};

    /// The load in force at a pose's stamp stood in its row: up to a row late for what was commanded between.
    #[test]
    fn a_row_holds_the_impulse_of_the_commands_between_it_and_the_next() {
        let commands = [
            (0.06, 2.0),
            (0.14, -4.0),
            (0.14, 8.0),
            (0.5, 8.0),
            (0.7, 0.0),
        ];
        let of = |from_s: f64, to_s: f64| mean(&commands, |c| *c, [from_s, to_s]).map(|m| m.value);
        assert_eq!(of(0.0, 0.05), None);
        assert!((of(0.05, 0.1).unwrap() - 0.8 * 2.0).abs() < 1e-12);
        assert!((of(0.1, 0.2).unwrap() - (0.4 * 2.0 + 0.6 * 8.0)).abs() < 1e-12);
        assert_eq!((of(0.2, 0.6), of(0.9, 1.0)), (Some(8.0), Some(0.0)));
        // The last row, and one that begins at a command.
        assert_eq!((of(0.6, 0.6), of(0.14, 0.2)), (Some(8.0), Some(8.0)));
        let edges: Vec<f64> = (0..=20).map(|k| 0.05 * f64::from(k)).collect();
        let rows = edges
            .windows(2)
            .map(|w| of(w[0], w[1]).unwrap_or(0.0) * (w[1] - w[0]));
        assert!((rows.sum::<f64>() - (2.0 * 0.08 + 8.0 * 0.56)).abs() < 1e-12);
    }

    #[test]
    fn cells_are_numbers_or_empty() {
        let sample = |t_s: f64, x: f64| Sample {
            t_s,
            values: PerChannel::from_fn(|c| if c == Channel::X { x } else { f64::NAN }),
            covariance: Some(Box::new([4.0; 36])),
        };
        let merged = Merged {
            run: Run {
                samples: vec![
                    sample(0.0, 1.5),
                    sample(0.1, f64::NAN),
                    sample(0.2, 1e-7),
                    sample(2.0, 2.0),
                ],
                ..Run::default()
            },
            thrusts: [("=bow".to_owned(), vec![(0.1, -2.5)])].into(),
            wrench: Some(vec![Command {
                t_s: 0.1,
                wrench: [3.0, 0.0, 0.0, 0.0, 0.0, 0.0],
            }]),
            ..Merged::default()
        };
        let mut text = Vec::new();
        merged.write(&mut text).unwrap();
        let text = String::from_utf8(text).unwrap();
        let rows: Vec<Vec<&str>> = text.lines().map(|l| l.split(',').collect()).collect();
        assert!(rows.iter().all(|r| r.len() == rows[0].len()), "{text}");
        let cell = |row: usize, name: &str| {
            let place = rows[0].iter().position(|n| *n == name).unwrap();
            rows[row][place].to_owned()
        };
        assert_eq!(cell(1, "x_m"), "1.5");
        assert_eq!(cell(1, "x_sd_m"), "2");
        assert_eq!(
            (cell(2, "x_m"), cell(2, "x_sd_m")),
            (String::new(), String::new())
        );
        assert_eq!(cell(3, "x_m").parse::<f64>().unwrap(), 1e-7);
        assert_eq!(
            (cell(1, "surge_n"), cell(2, "surge_n")),
            (String::new(), "3".to_owned())
        );
        assert_eq!(cell(2, "thrust_=bow_n"), "-2.5");
        assert_eq!(
            (cell(1, "flags"), cell(2, "flags")),
            ("before_commands".to_owned(), String::new())
        );
        assert_eq!(cell(4, "flags"), "gap_before");
        assert!(!text.contains("NaN") && !text.contains("inf"));
    }
}

//! A run as one table: pose with its sds, velocities, load and thrusts in force, what is to be known of each row.

use std::collections::BTreeMap;
use std::fmt::Display;
use std::io::{self, Write};
use std::path::Path;

use hydroline_log::messages::{Stamped, pb};
use hydroline_log::{LogReader, Record};
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
    /// Companions per sample.
    companions: BTreeMap<u64, [Option<f64>; COMPANIONS.len()]>,
    /// Thrusts by thruster: (t \[s\], N), ascending.
    thrusts: BTreeMap<String, Vec<(f64, f64)>>,
    /// Load over time; `None` = it is not known what the thrusters make.
    wrench: Option<Vec<Command>>,
    /// Faults of frames and losses before them, in words, by the frames' stamps.
    frames: BTreeMap<u64, String>,
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
        Ok(Merged {
            run,
            companions,
            thrusts,
            wrench,
            frames,
            note,
        })
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
        for sample in &self.run.samples {
            let stamp_ns = self.run.start_ns + (sample.t_s * 1e9).round() as u64;
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
            cells.extend((0..6).map(|d| self.load(sample.t_s, d).map_or(String::new(), number)));
            for own in self.thrusts.values() {
                let after = own.partition_point(|c| c.0 <= sample.t_s);
                let value = after.checked_sub(1).map(|i| own[i].1);
                cells.push(value.map_or(String::new(), number));
            }
            let mut flags: Vec<&str> = Vec::new();
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

    /// The load's component in force; `None` = nothing was commanded yet, or it is not known.
    fn load(&self, t_s: f64, dof: usize) -> Option<f64> {
        let own = self.wrench.as_ref()?;
        let after = own.partition_point(|c| c.t_s <= t_s);
        Some(own.get(after.checked_sub(1)?)?.wrench[dof])
    }
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
    if own.starts_with(['=', '+', '-', '@']) {
        format!("'{own}")
    } else {
        own
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hydroline_core::run::{PerChannel, Sample};

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

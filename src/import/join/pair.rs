//! Both logs, as far as the clocks need them.

use std::path::Path;

use hydroline_identify::data::load_messages;
use hydroline_log::messages::{Stamped, pb};
use hydroline_log::{LogReader, Record};
use hydroline_rigs::{Dof, Rig};

use super::clocks::Pairs;
use super::estimate::align;
use super::problem::Problem;
use super::{From, Given, JoinError, Relation};

/// Samples that are looked at: half an hour at 100 Hz.
const SAMPLES_MAX: usize = 200_000;
/// Commands that are looked at.
const COMMANDS_MAX: usize = 200_000;

/// What both logs hold of motion, commands and clocks.
pub struct Pair {
    motion_name: String,
    command_name: String,
    motion: Vec<pb::VehicleMotion>,
    commands: Vec<pb::ThrusterCommand>,
    pub(super) motion_clocks: Pairs,
    pub(super) command_clocks: Pairs,
    /// First and last stamp of all motion and of all commands \[ns\].
    pub(super) motion_ns: (u64, u64),
    pub(super) commands_ns: (u64, u64),
    /// The rig that a log carries.
    rig_toml: Option<String>,
}

fn widen(ends: &mut Option<(u64, u64)>, ns: u64) {
    let (first, last) = ends.unwrap_or((ns, ns));
    *ends = Some((first.min(ns), last.max(ns)));
}

impl Pair {
    /// Reads both logs, in bounded memory.
    pub fn read(motion: &Path, commands: &Path) -> Result<Pair, JoinError> {
        let name = |p: &Path| p.display().to_string();
        let mut pair = Pair {
            motion_name: name(motion),
            command_name: name(commands),
            motion: Vec::new(),
            commands: Vec::new(),
            motion_clocks: Vec::new(),
            command_clocks: Vec::new(),
            motion_ns: (0, 0),
            commands_ns: (0, 0),
            rig_toml: None,
        };
        let clock = |c: &pb::ClockPair| (i128::from(c.monotonic_ns), i128::from(c.realtime_ns));
        let mut ends = None;
        let mut reader = LogReader::open(motion)?;
        for message in reader.by_ref() {
            match message?.record {
                Record::Motion(m) => {
                    widen(&mut ends, m.stamp_ns().unwrap_or(0));
                    if pair.motion.len() < SAMPLES_MAX {
                        pair.motion.push(m);
                    }
                }
                Record::Clock(c) if pair.motion_clocks.len() < SAMPLES_MAX => {
                    pair.motion_clocks.push(clock(&c));
                }
                _ => {}
            }
        }
        pair.motion_ns = ends.ok_or(JoinError::NoMotion { log: name(motion) })?;
        let own_rig = |toml: &str| Rig::from_toml(toml, "the log's rig", None).is_ok();
        pair.rig_toml = reader.rig_toml().filter(|t| own_rig(t)).map(str::to_owned);
        let mut ends = None;
        let mut reader = LogReader::open(commands)?;
        for message in reader.by_ref() {
            match message?.record {
                Record::Command(c) => {
                    widen(&mut ends, c.stamp_ns().unwrap_or(0));
                    if pair.commands.len() < COMMANDS_MAX {
                        pair.commands.push(c);
                    }
                }
                Record::Clock(c) if pair.command_clocks.len() < SAMPLES_MAX => {
                    pair.command_clocks.push(clock(&c));
                }
                _ => {}
            }
        }
        pair.commands_ns = ends.ok_or(JoinError::NoCommands {
            log: name(commands),
        })?;
        if let Some(rig) = reader.rig_toml().filter(|t| own_rig(t)) {
            pair.rig_toml = Some(rig.to_owned());
        }
        Ok(pair)
    }

    /// The rig that the joined log carries.
    pub(super) fn rig_toml(&self) -> Option<&str> {
        self.rig_toml.as_deref()
    }

    /// The first command by its own clock.
    pub fn reference_ns(&self) -> u64 {
        self.commands_ns.0
    }

    fn rig(&self, given: Option<&Rig>) -> Result<Rig, JoinError> {
        if let Some(rig) = given {
            return Ok(rig.clone());
        }
        if let Some(rig) = self.rig_toml() {
            return Rig::from_toml(rig, "the log's rig", None)
                .map_err(|e| JoinError::NotFound { why: e.to_string() });
        }
        let foreign = self
            .commands
            .iter()
            .find(|c| Dof::ALL.iter().all(|d| d.name() != c.thruster));
        if let Some(command) = foreign {
            return Err(JoinError::Rig {
                log: self.command_name.clone(),
                thruster: command.thruster.clone(),
            });
        }
        // Components act directly, whatever the rig.
        Rig::builtin("lshpi").map_err(|e| JoinError::NotFound { why: e.to_string() })
    }

    /// Offset and drift from the motion's answer.
    pub fn estimate(&self, rig: Option<&Rig>, given: Given) -> Result<Relation, JoinError> {
        let rig = self.rig(rig)?;
        let motion = load_messages(&self.motion_name, &[], &self.motion, &rig)?;
        let commands = load_messages(&self.command_name, &self.commands, &[], &rig)?;
        let problem = Problem::new(&motion, &commands);
        // Between the two zeros, as the stamps have it.
        let nominal_s = (i128::from(commands.start_ns) - i128::from(motion.start_ns)) as f64 * 1e-9;
        let drift = given.drift_ppm.map(|d| d * 1e-6);
        let found =
            align(&problem, drift, given.search_s).map_err(|why| JoinError::NotFound { why })?;
        let mut warnings = vec![
            "the offset is estimated from how the motion answers to the commands: any latency between command and load is part of it, and neither this log nor its diagnosis can tell the two apart".to_owned(),
        ];
        warnings.extend(found.warnings);
        Ok(Relation {
            from: From::Estimated,
            offset_s: found.offset_s - nominal_s,
            offset_sd_s: found.offset_sd_s,
            drift_ppm: found.drift * 1e6,
            drift_sd_ppm: found.drift_sd * 1e6,
            reference_ns: self.reference_ns(),
            warnings,
        })
    }
}

//! Both logs, as far as the clocks need them.

use std::collections::BTreeMap;
use std::path::Path;

use hydroline_core::run::instrument_sd;
use hydroline_identify::data::load_messages;
use hydroline_log::messages::{Stamped, pb};
use hydroline_log::{LogReader, Record};
use hydroline_rigs::{Dof, Rig};

use super::clocks::Pairs;
use super::estimate::align;
use super::problem::Problem;
use super::{From, Given, JoinError, Relation};
use crate::write::{RELATIVE_ORIGIN, RELATIVE_START};

/// Samples, and clock records, that are looked at; of more every second one is dropped, again and again: half an hour at
/// 100 Hz.
const SAMPLES_MAX: usize = 200_000;
/// Changes of a command that an estimate takes: half a day at 20 Hz.
const CHANGES_MAX: usize = 1_000_000;

/// Values of which there may be any number: every n-th of them, n as small as memory allows.
struct Thinned<T> {
    kept: Vec<T>,
    every: usize,
    seen: usize,
}

impl<T> Thinned<T> {
    fn new() -> Thinned<T> {
        Thinned {
            kept: Vec::new(),
            every: 1,
            seen: 0,
        }
    }

    fn push(&mut self, value: T) {
        if self.kept.len() == SAMPLES_MAX {
            let mut place = 0;
            self.kept.retain(|_| {
                place += 1;
                place % 2 == 1
            });
            self.every *= 2;
        }
        if self.seen.is_multiple_of(self.every) {
            self.kept.push(value);
        }
        self.seen += 1;
    }
}

/// Which start of which host a log was written in; a log of others says none.
fn boot_id(reader: &LogReader) -> Option<String> {
    let id = reader.metadata().get("session")?.get("boot_id")?;
    (!id.is_empty()).then(|| id.clone())
}

/// From a log's stamps back to the clock of the file it was imported from, which counts from any zero \[ns\].
fn own_clock_ns(reader: &LogReader) -> Option<i128> {
    let session = reader.metadata().get("session")?;
    let number = |key: &str| session.get(key)?.parse::<i128>().ok();
    number(RELATIVE_ORIGIN)?.checked_sub(number(RELATIVE_START)?)
}

/// Motion, commands and clocks of both logs.
pub struct Pair {
    motion_name: String,
    command_name: String,
    motion: Vec<pb::VehicleMotion>,
    /// Commands that change a load.
    commands: Vec<pb::ThrusterCommand>,
    /// Changes beyond what an estimate takes.
    more_changes: usize,
    /// From the stamps of either log to its file's own clock.
    pub(super) own_clocks_ns: [Option<i128>; 2],
    /// Start of the host of either log.
    pub(super) boots: [Option<String>; 2],
    pub(super) motion_clocks: Pairs,
    pub(super) command_clocks: Pairs,
    /// First and last stamp of all motion and of all commands \[ns\].
    pub(super) motion_ns: (u64, u64),
    pub(super) commands_ns: (u64, u64),
    /// The rig that a log carries.
    rig_toml: Option<String>,
    /// Noise of the motion's instruments, as its log's session states it.
    pub(super) instrument_sd: Vec<(String, String)>,
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
            more_changes: 0,
            own_clocks_ns: [None, None],
            boots: [None, None],
            motion_clocks: Vec::new(),
            command_clocks: Vec::new(),
            motion_ns: (0, 0),
            commands_ns: (0, 0),
            rig_toml: None,
            instrument_sd: Vec::new(),
        };
        let clock = |c: &pb::ClockPair| (i128::from(c.monotonic_ns), i128::from(c.realtime_ns));
        let mut ends = None;
        let (mut samples, mut clocks) = (Thinned::new(), Thinned::new());
        let mut reader = LogReader::open(motion)?;
        for message in reader.by_ref() {
            match message?.record {
                Record::Motion(m) => {
                    widen(&mut ends, m.stamp_ns().unwrap_or(0));
                    samples.push(m);
                }
                Record::Clock(c) => clocks.push(clock(&c)),
                _ => {}
            }
        }
        pair.motion_ns = ends.ok_or(JoinError::NoMotion { log: name(motion) })?;
        (pair.motion, pair.motion_clocks) = (samples.kept, clocks.kept);
        pair.boots[0] = boot_id(&reader);
        pair.own_clocks_ns[0] = own_clock_ns(&reader);
        if let Some(session) = reader.metadata().get("session") {
            pair.instrument_sd = instrument_sd::entries(session).collect();
        }
        let own_rig = |toml: &str| Rig::from_toml(toml, "the log's rig", None).is_ok();
        pair.rig_toml = reader.rig_toml().filter(|t| own_rig(t)).map(str::to_owned);
        let mut ends = None;
        let mut clocks = Thinned::new();
        let mut last: BTreeMap<String, (u64, u64)> = BTreeMap::new();
        let mut again = None;
        let mut reader = LogReader::open(commands)?;
        for message in reader.by_ref() {
            match message?.record {
                Record::Command(c) => {
                    widen(&mut ends, c.stamp_ns().unwrap_or(0));
                    // A command that is sent again says nothing of the offset.
                    // Of a pulse the load is the curve's, whatever stands beside it.
                    let value = (c.thrust_n.to_bits(), c.pulse_us.to_bits());
                    if last.insert(c.thruster.clone(), value) == Some(value) {
                        again = Some(c);
                        continue;
                    }
                    again = None;
                    if pair.commands.len() < CHANGES_MAX {
                        pair.commands.push(c);
                    } else {
                        pair.more_changes += 1;
                    }
                }
                Record::Clock(c) => clocks.push(clock(&c)),
                _ => {}
            }
        }
        pair.commands_ns = ends.ok_or(JoinError::NoCommands {
            log: name(commands),
        })?;
        // Until when there are commands is known by the last one.
        pair.commands.extend(again);
        pair.command_clocks = clocks.kept;
        pair.boots[1] = boot_id(&reader);
        pair.own_clocks_ns[1] = own_clock_ns(&reader);
        if let Some(rig) = reader.rig_toml().filter(|t| own_rig(t)) {
            pair.rig_toml = Some(rig.to_owned());
        }
        Ok(pair)
    }

    /// The rig that the joined log carries.
    pub(super) fn rig_toml(&self) -> Option<&str> {
        self.rig_toml.as_deref()
    }

    /// Seconds to add to the commands' stamps so that both logs go by their files' own clocks as if those were one
    /// \[s\]; `None` = one of them was on UNIX time.
    pub(super) fn zeros_s(&self) -> Option<f64> {
        let [motion, commands] = self.own_clocks_ns;
        Some((commands? - motion?) as f64 * 1e-9)
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
        if self.more_changes > 0 {
            return Err(JoinError::NotFound {
                why: format!(
                    "the commands change {} times, and an estimate takes {CHANGES_MAX}",
                    CHANGES_MAX + self.more_changes
                ),
            });
        }
        let rig = self.rig(rig)?;
        let motion = load_messages(&self.motion_name, &[], &self.motion, &rig)?;
        let commands = load_messages(&self.command_name, &self.commands, &[], &rig)?;
        let problem = Problem::new(&motion, &commands);
        // Between the two zeros, as the stamps have it.
        let nominal_s = (i128::from(commands.start_ns) - i128::from(motion.start_ns)) as f64 * 1e-9;
        let drift = given.drift_ppm.map(|d| d * 1e-6);
        let within_s = (nominal_s - given.search_s, nominal_s + given.search_s);
        let found = align(&problem, drift, within_s).map_err(|why| JoinError::NotFound { why })?;
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

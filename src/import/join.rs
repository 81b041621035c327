//! Motion from one log and commands from another become one log: the second clock is put onto the first.
//!
//! `clocks` (records of one clock in both) or `estimate` (what the motion answers to) say offset and drift unless they
//! are given. Only stamps change: t_A = t_B + offset + drift (t_B - t_0), t_0 being the first command. No value is
//! resampled. How well the offset is known goes into the log, where `diagnose` reads it: a latency is an offset too.

mod clocks;
mod coarse;
mod estimate;
mod pair;
mod problem;
mod response;
#[cfg(test)]
mod tests;
mod write;

use std::path::Path;

use hydroline_core::build_info::BuildInfo;
use hydroline_log::LogError;
use hydroline_rigs::Rig;

pub use estimate::align;
pub use problem::{Aligned, Problem};

/// Source of offset and drift.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum From {
    /// The caller.
    Given,
    /// Records of one clock in both logs.
    Clocks,
    /// The motion's answer to the commands: a latency is part of it.
    Estimated,
}

impl From {
    /// As the log has it.
    pub fn word(self) -> &'static str {
        match self {
            From::Given => "given",
            From::Clocks => "clocks",
            From::Estimated => "estimated",
        }
    }
}

/// The second clock against the first.
#[derive(Debug, Clone, PartialEq, serde::Serialize, schemars::JsonSchema)]
pub struct Relation {
    /// Source of offset and drift.
    pub from: From,
    /// To be added to the stamps of the commands' log at [`Relation::reference_ns`] \[s\].
    pub offset_s: f64,
    /// Its standard deviation \[s\]; of an estimate without what a latency may be.
    pub offset_sd_s: f64,
    /// Excess rate of the first clock over the second \[ppm\].
    pub drift_ppm: f64,
    /// Its standard deviation.
    pub drift_sd_ppm: f64,
    /// The first command by its own clock, UNIX \[ns\]: where the offset holds.
    pub reference_ns: u64,
    /// For a person.
    pub warnings: Vec<String>,
}

impl Relation {
    /// A stamp of the commands' log on the clock of the motion's \[ns\].
    pub fn moved(&self, ns: u64) -> u64 {
        let since_s = (i128::from(ns) - i128::from(self.reference_ns)) as f64 * 1e-9;
        let shift_s = self.offset_s + self.drift_ppm * 1e-6 * since_s;
        let moved = i128::from(ns) + (shift_s * 1e9).round() as i128;
        u64::try_from(moved.max(0)).unwrap_or(u64::MAX)
    }
}

/// Usual difference in rate between two computers' crystals: each is specified to some 20-50 ppm \[ppm\].
const CRYSTALS_PPM: f64 = 50.0;

/// Offset and drift between the two clocks, and search range, as the caller gives them.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Given {
    /// Added to the commands' stamps \[s\]; `None` = to be found.
    pub offset_s: Option<f64>,
    /// Its standard deviation \[s\].
    pub offset_sd_s: f64,
    /// `None` = to be found with the offset; beside a given one 0, known as well as two crystals are alike.
    pub drift_ppm: Option<f64>,
    /// Standard deviation of a given drift \[ppm\].
    pub drift_sd_ppm: f64,
    /// An estimated offset is looked for within so much of that given by the stamps \[s\].
    pub search_s: f64,
}

/// Reason why two logs are not joined.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)]
pub enum JoinError {
    #[error(
        "{log}: holds no motion (/vehicle/motion); name the log with the motion first, the one with the commands second"
    )]
    NoMotion { log: String },
    #[error(
        "{log}: holds no commands (/thruster/command); name the log with the motion first, the one with the commands second"
    )]
    NoCommands { log: String },
    #[error(
        "the offset cannot be found: {why}; give it with --offset-s (and --offset-sd-s, how well it is known)"
    )]
    NotFound { why: String },
    #[error(
        "with an offset of {offset_s} s no command falls within the motion ({motion}); the commands would stand at {commands}; check --offset-s: it is added to the stamps of the commands"
    )]
    Apart {
        offset_s: f64,
        motion: String,
        commands: String,
    },
    #[error(
        "{log}: the command to '{thruster}' is none of surge sway heave roll pitch yaw, and no rig says what load it is; give --rig, or --offset-s"
    )]
    Rig { log: String, thruster: String },
    #[error(transparent)]
    Load(#[from] hydroline_identify::data::LoadError),
    #[error(transparent)]
    Log(#[from] LogError),
}

/// Outcome of a join: the clocks, and numbers of records.
#[derive(Debug, Clone, PartialEq, serde::Serialize, schemars::JsonSchema)]
pub struct Joined {
    /// The clocks.
    pub relation: Relation,
    /// Motion samples.
    pub samples: usize,
    /// Number of commands.
    pub commands: usize,
    /// Commands outside of the motion's time: they stand in the log all the same.
    pub outside: usize,
    /// Other records of both logs, which are left out.
    pub left_out: usize,
}

/// Joins two logs.
///
/// # Errors
/// [`JoinError`].
pub fn join(
    motion: &Path,
    commands: &Path,
    given: Given,
    rig: Option<&Rig>,
    out: &Path,
    build: BuildInfo,
) -> Result<Joined, JoinError> {
    let read = pair::Pair::read(motion, commands)?;
    let relation = match given.offset_s {
        Some(offset_s) => Relation {
            from: From::Given,
            offset_s: offset_s + read.zeros_s().unwrap_or(0.0),
            offset_sd_s: given.offset_sd_s,
            drift_ppm: given.drift_ppm.unwrap_or(0.0),
            drift_sd_ppm: given.drift_ppm.map_or(CRYSTALS_PPM, |_| given.drift_sd_ppm),
            reference_ns: read.reference_ns(),
            warnings: given_warnings(&read, given.offset_sd_s, offset_s),
        },
        None => match clocks::relation(&read) {
            Some(relation) => relation,
            None => {
                let mut found = read.estimate(rig, given)?;
                if let Some(zeros_s) = read.zeros_s().filter(|z| z.abs() > 0.0) {
                    found.warnings.push(format!(
                        "both files' clocks count from zeros of their own, which import moved: between those clocks, as --offset-s counts, the offset is {:.6} s",
                        found.offset_s - zeros_s
                    ));
                }
                found
            }
        },
    };
    write::write(&read, motion, commands, relation, out, build)
}

fn given_warnings(read: &pair::Pair, offset_sd_s: f64, offset_s: f64) -> Vec<String> {
    let mut out = Vec::new();
    // Where import left the zeros where they were there is nothing to say.
    if let Some(zeros_s) = read.zeros_s().filter(|z| z.abs() > 0.0) {
        out.push(format!(
            "both files' clocks count from zeros of their own, which import moved: the offset given counts between those clocks, so that the log's stamps are moved by {offset_s} + {zeros_s:.6} s"
        ));
    }
    if offset_sd_s <= 0.0 {
        out.push("the offset is taken as exact: --offset-sd-s says how well it is known, and a diagnosis then names no latency within it".to_owned());
    }
    out
}

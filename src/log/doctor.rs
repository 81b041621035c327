//! Is a log sound? Every check that can be made from the file alone, with what to do next.

mod checks;
mod conclude;
mod obeyed;

use hydroline_core::clock::{Clock, SystemClock};
use hydroline_core::plain::Lines;
use std::fmt;
use std::path::{Path, PathBuf};

use serde::Serialize;

use super::LogError;
use super::reader::{decode, grey_rule};
use super::scan::{self, Step};
use checks::Checks;

/// Grade of a finding, the mildest first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Grade {
    /// Worth knowing.
    Note,
    /// Use with care.
    Warning,
    /// Something is damaged or missing.
    Error,
}

/// One thing found.
#[derive(Debug, Clone, PartialEq, Serialize, schemars::JsonSchema)]
pub struct Finding {
    /// Grade of the finding.
    pub grade: Grade,
    /// Stable machine word: `damage`, `end`, `summary`, `head`, `log_time`, `frame_gap`,
    /// `command_gap`, `echo`, `ledger`, `metadata`, `unchecked`, `clock`, `schema`, `decode`, `image`, `event`, `clipping`.
    pub check: &'static str,
    /// One sentence with the numbers.
    pub message: String,
    /// Action to take, in words.
    pub next_step: String,
    /// Offset in the file \[bytes\].
    pub offset: Option<u64>,
}

/// Everything found.
#[derive(Debug, Clone, PartialEq, Serialize, schemars::JsonSchema)]
pub struct Diagnosis {
    /// Path of the log.
    pub path: PathBuf,
    /// Messages read.
    pub messages: u64,
    /// Worst first.
    pub findings: Vec<Finding>,
    /// No finding worse than a note.
    pub sound: bool,
    /// Of a recording that broke off and was recovered: frames known to be missing.
    pub recovered_lost: Option<u64>,
    /// Frames that the camera, driver or daemon lost, by the marks on the frames or by the account, whichever states
    /// more: a sound file lists them, but they are not there.
    pub frames_lost: u64,
}

/// Examines a log. Damage is a finding, not an error.
///
/// # Errors
/// [`LogError::Read`], [`LogError::NotMcap`].
pub fn doctor(path: &Path) -> Result<Diagnosis, LogError> {
    let mut scan = scan::open(path)?;
    let mut checks = Checks::default();
    let (mut info, mut headed) = (None, false);
    while let Some(step) = scan.next() {
        match step {
            Step::Message {
                offset,
                channel,
                message,
            } => {
                let schema = scan.learnt.declared.schema_name(&channel).to_owned();
                if !std::mem::replace(&mut headed, true) {
                    checks.rule = grey_rule(&scan.learnt.metadata);
                }
                checks.message(offset, &channel, &schema, message.log_ns);
                match decode(&channel, &schema, message, &mut info) {
                    Ok(record) => checks.record(offset, &record),
                    Err(reason) => checks.undecodable(offset, &channel.topic, &schema, &reason),
                }
            }
            Step::Damage { offset, damage } => checks.damage(offset, &damage),
            Step::Truncated { .. } | Step::Metadata { .. } => {}
        }
    }
    let frames_lost = checks.frames_lost(&scan.learnt);
    let mut findings = checks.conclude(&scan.learnt, SystemClock.triple().realtime_ns);
    findings.sort_by_key(|f| std::cmp::Reverse(f.grade));
    let recovered_lost = scan
        .learnt
        .metadata
        .get("summary")
        .and_then(conclude::recovered_lost);
    let sound = findings.iter().all(|f| f.grade == Grade::Note);
    Ok(Diagnosis {
        path: path.to_owned(),
        messages: scan.learnt.messages,
        findings,
        sound,
        recovered_lost,
        frames_lost,
    })
}

impl Diagnosis {
    /// Nothing is damaged or missing: the file is sound, and no frame was lost on the way to it.
    pub fn complete(&self) -> bool {
        self.sound && self.frames_lost == 0
    }

    /// Whether a check found something at least this bad.
    pub fn found(&self, check: &str, at_least: Grade) -> bool {
        self.findings
            .iter()
            .any(|f| f.check == check && f.grade >= at_least)
    }
}

impl fmt::Display for Diagnosis {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut f = Lines(f);
        let verdict = if self.sound { "sound" } else { "NOT sound" };
        let recovered = match (self.recovered_lost, self.frames_lost) {
            (Some(_), lost) => format!("recovered, {lost} frames lost; "),
            (None, 0) => String::new(),
            (None, lost) => format!("{lost} frames lost; "),
        };
        let empty = if self.messages == 0 {
            " (nothing was recorded)"
        } else {
            ""
        };
        writeln!(
            f,
            "{}: {} messages{empty}, {recovered}{verdict}",
            self.path.display(),
            self.messages
        )?;
        for finding in &self.findings {
            let grade = match finding.grade {
                Grade::Note => "note",
                Grade::Warning => "WARNING",
                Grade::Error => "ERROR",
            };
            let place = finding
                .offset
                .map_or_else(String::new, |o| format!(" (byte {o})"));
            writeln!(
                f,
                "  {grade}: {}: {}{place}",
                finding.check, finding.message
            )?;
            writeln!(f, "      -> {}", finding.next_step)?;
        }
        Ok(())
    }
}

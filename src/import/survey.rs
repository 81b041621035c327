//! The pass over a table that says everything there is to be said of it, and keeps its samples for the log.

use std::io;

use hydroline_rigs::Rig;

use crate::check::{self, Finding, Spoilt, Watch};
use crate::map::Map;
use crate::source::Source;
use crate::spool::{Spool, Spooler};
use crate::table::{Imported, has_faults, pass};

/// Findings about a table, with its start, losses and samples.
#[derive(Debug, Clone)]
pub struct Survey {
    /// UNIX time of the first row \[ns\].
    pub start_ns: u64,
    /// First row's time by the file's own clock, where it counts from a zero of its own; else `None` \[ns\].
    pub relative_origin_ns: Option<i128>,
    /// Findings about form, time, cells, channels and commands.
    pub findings: Vec<Finding>,
    pub(crate) spoilt: Spoilt,
    /// Rows left out.
    pub(crate) lost_rows: usize,
    /// Every sample, for the log; `None` = the table is to be read again.
    pub(crate) spool: Option<Spool>,
}

impl Survey {
    /// Whether a finding forbids the import.
    pub fn has_faults(&self) -> bool {
        has_faults(&self.findings)
    }
}

/// Reads a table once, in bounded memory; commands are held against `rig` where one is given.
///
/// # Errors
/// Those of the file.
pub fn survey(source: &(impl Source + ?Sized), map: &Map, rig: Option<&Rig>) -> io::Result<Survey> {
    let mut watch = Watch::new(map, rig, check::Options::default());
    let mut spooler = Spooler::new(map);
    let passed = pass(source, map, rig, |sample, _| {
        watch.row(sample);
        spooler.row(sample);
        Ok(())
    })?;
    source.unchanged()?;
    let (found, spoilt) = watch.finish();
    Ok(Survey {
        start_ns: passed.start_ns,
        relative_origin_ns: passed.relative_origin_ns,
        findings: together(passed.findings, found),
        spoilt,
        lost_rows: passed.lost_rows,
        spool: spooler.finish(),
    })
}

/// The same, keeping every row.
///
/// # Errors
/// Those of the file.
pub fn read_table(
    source: &(impl Source + ?Sized),
    map: &Map,
    rig: Option<&Rig>,
) -> io::Result<Imported> {
    let mut watch = Watch::new(map, rig, check::Options::default());
    let mut data = Imported::empty(map);
    let passed = pass(source, map, rig, |sample, _| {
        watch.row(sample);
        data.push(sample, map);
        Ok(())
    })?;
    source.unchanged()?;
    let (found, spoilt) = watch.finish();
    data.start_ns = passed.start_ns;
    data.relative_origin_ns = passed.relative_origin_ns;
    data.lost_rows = passed.lost_rows;
    data.findings = together(passed.findings, found);
    spoilt.clear_all(&mut data);
    Ok(data)
}

/// A column that is not there leaves its channel empty: said once.
fn together(mut findings: Vec<Finding>, found: Vec<Finding>) -> Vec<Finding> {
    let gone: Vec<String> = findings
        .iter()
        .filter(|f| matches!(f.kind, "column_missing" | "column_twice"))
        .map(|f| f.message.clone())
        .collect();
    let is_said = |f: &Finding| {
        let channel = f.message.split(':').next().unwrap_or("");
        f.kind == "empty_channel"
            && gone.iter().any(|m| {
                m.starts_with(&format!("motion.{channel}:")) || m.starts_with("quaternion:")
            })
    };
    findings.extend(found.into_iter().filter(|f| !is_said(f)));
    findings
}

//! Motion and commands recorded by something else: a table and a map become a log.
//!
//! `map` (what which column means) -> `table` (cells, with their line numbers) -> `check`
//! (findings) -> `write` (the log). Nothing is mended on the way: what is wrong is a finding;
//! faults stop the import unless the caller accepts the loss, and then every lost value is counted.

pub mod check;
mod map;
mod stamp;
mod table;
mod write;

pub use check::{Finding, Severity};
pub use map::{Between, ChannelMap, CommandMap, Map, MapError};
pub use table::{Imported, Table};
pub use write::{ImportError, ImportOutcome, Lost, Options, import};

/// Reads a table's text with a map; never fails: everything wrong is in the findings.
pub fn read(text: &str, map: &Map) -> Imported {
    read_for(text, map, None)
}

/// The same, with commands held against the rig they are meant for.
pub fn read_for(text: &str, map: &Map, rig: Option<&hydroline_rigs::Rig>) -> Imported {
    let (table, mut findings) = table::cells(text, map);
    let mut imported = table::convert(&table, map, &mut findings);
    check::check(&imported, map, rig, &mut findings);
    imported.findings = findings;
    imported
}

#[cfg(test)]
mod tests;

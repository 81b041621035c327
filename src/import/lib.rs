//! Motion and commands recorded by something else: a table and a map become a log.
//!
//! `map` (what which column means) -> `layout` (where names and data stand) -> `rows` (cells, with the
//! lines that an editor shows) -> `table` (samples in SI) -> `check` (findings) -> `write` (the log).
//! A table is read once, for the findings; its samples wait in a scratch file (`spool`) for the log, so that
//! memory is bounded whatever its size. Nothing is mended on the way: what is wrong is a finding; faults stop
//! the import unless the caller accepts the loss, and then every lost value is counted.
//!
//! ```
//! use hydroline_import::{Map, read};
//!
//! let map = "[time]\ncolumn = \"t\"\nunit = \"ms\"\n[motion.phi_rad]\ncolumn = \"roll\"\nunit = \"deg\"\n";
//! let map = Map::from_toml(map, "map.toml")?;
//! let table = read("t,roll\n0,0.0\n100,1.8\n200,3.6\n300,5.4\n", &map);
//! assert!(!table.has_faults());
//! assert_eq!(table.times_s.len(), 4);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod attitude;
mod cells;
pub mod check;
mod clock;
pub mod guess;
pub mod join;
mod layout;
mod map;
mod number;
pub mod recorded;
mod rows;
mod source;
mod spool;
mod stamp;
mod survey;
mod table;
mod text;
pub mod unit;
mod widths;
mod write;

pub use check::{Finding, Severity};
pub use map::{Map, MapError};
pub use source::{Source, TableFile};
pub use survey::{Survey, read_table, survey};
pub use table::Imported;
pub use write::{ImportError, ImportOutcome, Lost, Options, import, import_table};

/// Reads a table's text with a map; never fails: everything wrong is in the findings.
pub fn read(text: &str, map: &Map) -> Imported {
    read_for(text, map, None)
}

/// The same, with commands held against the rig they are meant for.
pub fn read_for(text: &str, map: &Map, rig: Option<&hydroline_rigs::Rig>) -> Imported {
    read_table(text.as_bytes(), map, rig).unwrap_or_else(|error| Imported {
        findings: vec![Finding::fault("unreadable", None, error.to_string())],
        ..Imported::default()
    })
}

#[cfg(test)]
mod tests;

//! Rows of cells become samples in SI.

mod cell;
mod columns;
mod taken;

use std::io;

use hydroline_rigs::Rig;

use crate::check::{Finding, FindingList, Severity};
use crate::clock::{Boots, Clock, granularity};
use crate::layout::Layout;
use crate::map::{Map, PLACES};
use crate::number::BadCells;
use crate::rows::{Form, each_row};
use crate::source::Source;
pub(crate) use columns::{Columns, stated_unit};
use taken::{HeldRow, Taken};

/// Rows from which the rounding of the stamps is known.
const ROWS_FOR_GRANULARITY: usize = 500;

/// One row in SI.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Sample {
    pub line: u64,
    /// Since the first row \[s\].
    pub t_s: f64,
    /// Channels and companions; NaN = nothing usable, or not mapped.
    pub values: [f64; PLACES],
    /// Per `[[command]]` \[N, N m\]; NaN = nothing.
    pub commands: Vec<f64>,
    /// Their pulses \[us\], where the column is one; else 0.
    pub pulses_us: Vec<f64>,
    /// Second clock \[s\].
    pub compare_s: f64,
}

impl Sample {
    /// Whether another row is of the same time and holds nothing that differs.
    fn takes(&self, other: &Sample) -> bool {
        let fits = |a: &f64, b: &f64| a == b || !(a.is_finite() && b.is_finite());
        self.t_s == other.t_s
            && fits(&self.compare_s, &other.compare_s)
            && self
                .values
                .iter()
                .zip(&other.values)
                .all(|(a, b)| fits(a, b))
            && self
                .commands
                .iter()
                .zip(&other.commands)
                .all(|(a, b)| fits(a, b))
    }

    fn take(&mut self, other: &Sample) {
        let fill = |own: &mut f64, more: f64| {
            if !own.is_finite() {
                *own = more;
            }
        };
        for (own, more) in self.values.iter_mut().zip(&other.values) {
            fill(own, *more);
        }
        for (i, more) in other.commands.iter().enumerate() {
            if !self.commands[i].is_finite() {
                self.commands[i] = *more;
                self.pulses_us[i] = other.pulses_us[i];
            }
        }
        fill(&mut self.compare_s, other.compare_s);
    }
}

/// A table in SI, or a stretch of one.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Imported {
    /// Since the first row \[s\], ascending only if the file is.
    pub times_s: Vec<f64>,
    /// UNIX time of the first row \[ns\].
    pub start_ns: u64,
    /// First row's time by the file's own clock, where it counts from a zero of its own; else `None` \[ns\].
    pub relative_origin_ns: Option<i128>,
    /// Line of each row.
    pub lines: Vec<u64>,
    /// Per channel of `/vehicle/motion`, then companions; NaN = nothing usable in the cell. Empty = not mapped.
    pub motion: [Vec<f64>; PLACES],
    /// Per `[[command]]` of the map \[N, N m\].
    pub commands: Vec<Vec<f64>>,
    /// Their pulses \[us\], where the column is one.
    pub pulses_us: Vec<Vec<f64>>,
    /// Second clock \[s\]; empty = none.
    pub compare_s: Vec<f64>,
    /// Rows left out: too few or too many cells, or no time that can be read.
    pub lost_rows: usize,
    /// Findings about the table.
    pub findings: Vec<Finding>,
}

impl Imported {
    /// Whether a finding forbids the import.
    pub fn has_faults(&self) -> bool {
        has_faults(&self.findings)
    }

    /// Nothing yet, for a map's channels and commands.
    pub(crate) fn empty(map: &Map) -> Self {
        let columns = || vec![Vec::new(); map.commands.len()];
        Imported {
            commands: columns(),
            pulses_us: columns(),
            ..Imported::default()
        }
    }

    pub(crate) fn push(&mut self, sample: &Sample, map: &Map) {
        self.times_s.push(sample.t_s);
        self.lines.push(sample.line);
        for (place, values) in self.motion.iter_mut().enumerate() {
            if map.missing(place).is_some() {
                values.push(sample.values[place]);
            }
        }
        for (i, (value, pulse)) in sample.commands.iter().zip(&sample.pulses_us).enumerate() {
            self.commands[i].push(*value);
            self.pulses_us[i].push(*pulse);
        }
        if map.time.compare.is_some() {
            self.compare_s.push(sample.compare_s);
        }
    }

    /// Row `k` as it came.
    pub(crate) fn sample(&self, k: usize) -> Sample {
        let of = |v: &Vec<f64>| v.get(k).copied().unwrap_or(f64::NAN);
        Sample {
            line: self.lines.get(k).copied().unwrap_or(0),
            t_s: self.times_s.get(k).copied().unwrap_or(f64::NAN),
            values: std::array::from_fn(|c| of(&self.motion[c])),
            commands: self.commands.iter().map(of).collect(),
            pulses_us: self
                .pulses_us
                .iter()
                .map(|v| v.get(k).copied().unwrap_or(0.0))
                .collect(),
            compare_s: of(&self.compare_s),
        }
    }
}

pub(crate) fn has_faults(findings: &[Finding]) -> bool {
    findings.iter().any(|f| f.severity == Severity::Fault)
}

/// Start, losses and findings of one pass through a table.
pub(crate) struct Passed {
    /// UNIX time of the first row \[ns\].
    pub start_ns: u64,
    /// First row's time by the file's own clock, where it counts from a zero of its own; else `None` \[ns\].
    pub relative_origin_ns: Option<i128>,
    /// Rows left out.
    pub lost_rows: usize,
    /// About form, time and cells.
    pub findings: Vec<Finding>,
}

/// Goes once through a table and hands every row on; nothing is kept.
pub(crate) fn pass(
    source: &(impl Source + ?Sized),
    map: &Map,
    rig: Option<&Rig>,
    mut each: impl FnMut(&Sample, u64) -> io::Result<()>,
) -> io::Result<Passed> {
    let layout = Layout::find(source, &map.file)?;
    let mut findings = layout.notes();
    let nothing = |findings| Passed {
        start_ns: 0,
        relative_origin_ns: None,
        lost_rows: 0,
        findings,
    };
    if layout.header.is_empty() {
        findings.fault_at(
            "header",
            map.file.header_line,
            "there is no row to read: is the file empty, or file.header_line beyond its end?"
                .to_owned(),
        );
        return Ok(nothing(findings));
    }
    let columns = Columns::find(map, &layout, rig, &mut findings);
    let Some(mut clock) = Clock::new(map, &layout, &mut findings) else {
        return Ok(nothing(findings));
    };
    let mut even = None;
    if map.time.rate_hz.is_some() {
        let stamps = first_stamps(source, &layout, map, &mut clock)?;
        // The stamps read ahead are read again.
        let Some(again) = Clock::new(map, &layout, &mut Vec::new()) else {
            return Ok(nothing(findings));
        };
        clock = again;
        even = clock.even(&map.time, granularity(&stamps));
    }
    let mut boots = Boots::new(map);
    let mut taken = Taken::new(map, &columns, even, &mut each);
    let mut lost_rows = 0;
    let mut held: Vec<HeldRow> = Vec::new();
    let form: Form = each_row(source.open()?, &layout, &map.file, |line, cells| {
        let Some(cells) = cells else {
            clock.skip();
            lost_rows += 1;
            return Ok(true);
        };
        let Some(ns) = clock.read(cells, line, taken.bad_cells()) else {
            lost_rows += 1;
            return Ok(true);
        };
        let seen = boots.see(ns, line);
        if let Some(run) = seen.held {
            taken.rows(&mut held, run, &mut boots, &mut findings)?;
        }
        match seen.own {
            Some(run) if boots.takes(run) => taken.row(cells, line, ns, &mut findings)?,
            Some(_) => boots.others += 1,
            None => held.push(HeldRow {
                line,
                ns,
                cells: cells.keep(),
            }),
        }
        Ok(true)
    })?;
    let rest = boots.rest();
    taken.rows(&mut held, rest, &mut boots, &mut findings)?;
    let (origin, even) = taken.finish(&mut findings, |findings| form.report(&layout, findings))?;
    boots.report(&mut findings);
    clock.report(&map.time, even.as_ref(), origin.map(|o| o.0), &mut findings);
    if map.time.boot.is_none() {
        lost_rows += boots.others;
    }
    let own_zero = !map.time.unix && map.time.start_unix_s.is_none();
    Ok(Passed {
        start_ns: origin.map_or(0, |o| o.1),
        relative_origin_ns: origin.map(|o| o.0).filter(|_| own_zero),
        lost_rows,
        findings,
    })
}

/// The first stamps as they stand in the file \[ns\].
fn first_stamps(
    source: &(impl Source + ?Sized),
    layout: &Layout,
    map: &Map,
    clock: &mut Clock,
) -> io::Result<Vec<i128>> {
    let (mut stamps, mut bad) = (Vec::new(), BadCells::default());
    each_row(source.open()?, layout, &map.file, |line, cells| {
        if let Some(ns) = cells.and_then(|c| clock.read(c, line, &mut bad)) {
            stamps.push(ns);
        }
        Ok(stamps.len() < ROWS_FOR_GRANULARITY)
    })?;
    Ok(stamps)
}

//! Rows of the run that is taken: from the first one's time to samples.

use std::io;

use super::cell::Reader;
use super::{Columns, Sample};
use crate::cells::{Cells, KeptCells};
use crate::check::Finding;
use crate::clock::{Boots, EvenRows, start_ns};
use crate::map::{Map, Missing};
use crate::number::BadCells;

/// A row that waits until it is known to which run it belongs.
pub(super) struct HeldRow {
    pub line: u64,
    /// Its time \[ns\].
    pub ns: i128,
    pub cells: KeptCells,
}

/// Time of the first row by the file's clock and as UNIX time \[ns\].
type Origin = (i128, u64);

pub(super) struct Taken<'a, F> {
    map: &'a Map,
    reader: Reader<'a>,
    even: Option<EvenRows>,
    origin: Option<Origin>,
    /// Values of one time may be in several rows.
    may_share: bool,
    waiting: Option<(Sample, u64)>,
    each: F,
}

impl<'a, F: FnMut(&Sample, u64) -> io::Result<()>> Taken<'a, F> {
    pub fn new(map: &'a Map, columns: &'a Columns<'a>, even: Option<EvenRows>, each: F) -> Self {
        Taken {
            map,
            reader: Reader::new(map, columns),
            even,
            origin: None,
            may_share: map.sparse() || map.commands.iter().any(|c| c.missing != Missing::Fault),
            waiting: None,
            each,
        }
    }

    pub fn bad_cells(&mut self) -> &mut BadCells {
        &mut self.reader.bad
    }

    /// Rows that waited, of one run.
    pub fn rows(
        &mut self,
        held: &mut Vec<HeldRow>,
        run: u32,
        boots: &mut Boots,
        findings: &mut Vec<Finding>,
    ) -> io::Result<()> {
        for row in held.drain(..) {
            if boots.takes(run) {
                self.row(row.cells.cells(), row.line, row.ns, findings)?;
            } else {
                boots.others += 1;
            }
        }
        Ok(())
    }

    /// The next row.
    pub fn row(
        &mut self,
        cells: Cells<'_>,
        line: u64,
        ns: i128,
        findings: &mut Vec<Finding>,
    ) -> io::Result<()> {
        let ns = match &mut self.even {
            Some(even) => even.put_back(ns, line),
            None => ns,
        };
        let time = &self.map.time;
        let (zero_ns, start) = *self
            .origin
            .get_or_insert_with(|| (ns, start_ns(time, ns, findings)));
        // Through whole nanoseconds: as exact as the file is.
        let t_s = (ns - zero_ns) as f64 / 1e9;
        if time.from_s.is_some_and(|from| t_s < from) || time.to_s.is_some_and(|to| t_s > to) {
            return Ok(());
        }
        let sample = self.reader.read(cells, line, t_s);
        if !self.may_share {
            return (self.each)(sample, start);
        }
        match &mut self.waiting {
            Some((before, _)) if before.takes(sample) => before.take(sample),
            Some((before, at)) => {
                (self.each)(before, *at)?;
                before.clone_from(sample);
                *at = start;
            }
            None => self.waiting = Some((sample.clone(), start)),
        }
        Ok(())
    }

    /// Hands on the last sample, and adds what was found in cells behind what `form` adds.
    pub fn finish(
        mut self,
        findings: &mut Vec<Finding>,
        form: impl FnOnce(&mut Vec<Finding>),
    ) -> io::Result<(Option<Origin>, Option<EvenRows>)> {
        if let Some((last, at)) = &self.waiting {
            (self.each)(last, *at)?;
        }
        form(findings);
        self.reader.report(findings);
        Ok((self.origin, self.even))
    }
}

//! Numbers over time: read from the log once, place by place, as far as somebody looks.
//!
//! A request never reads for long: it goes on where the one before ended, and says how much of the log is in what it
//! returns. A short stretch is read from its own places at once.

use crate::column::{Column, Sample, decimated};
use crate::viewed::{Viewed, places_of};
use hydroline_core::lock::Lock;
use std::collections::{BTreeMap, BTreeSet};

/// Columns that are kept: of more, the one asked for longest ago goes.
const COLUMNS_MAX: usize = 48;
/// Places that are read at once for a short stretch: 64 MB at the most.
const DIRECT_MAX: usize = 64;
/// A message is logged after what it says was true: a pose on a busy computer, by seconds.
const LAG_NS: i64 = 10_000_000_000;
/// A column as far as it was read.
#[derive(Debug, Default)]
struct Reading {
    column: Column,
    /// First place that was not read yet.
    next: usize,
    /// Number of the request that wanted it last.
    wanted: u64,
}

/// All of them, by the numbers of their fields.
#[derive(Debug, Default)]
pub(crate) struct Columns {
    readings: BTreeMap<usize, Reading>,
    requests: u64,
}

/// A stretch of time as a plot shows it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Stretch {
    /// Since the log's zero \[ns\].
    pub from_ns: i64,
    /// Its last moment.
    pub to_ns: i64,
    /// Width of the plot.
    pub pixels: usize,
}

/// Numbers of some fields in a stretch.
#[derive(Debug, Clone, PartialEq)]
pub struct Series {
    /// Share of the log's places that these numbers were read from, 0..1.
    pub read: f64,
    /// Samples of each field, in the order asked.
    pub samples: Vec<Vec<Sample>>,
    /// Number of samples of each that were NaN or infinite, in what was read.
    pub not_finite: Vec<u64>,
}

impl Viewed {
    /// Numbers of fields in a stretch, the least and the greatest of each pixel. Reads on while `more` says so, one place at the
    /// least.
    pub fn series(&self, of: &[usize], stretch: Stretch, more: impl Fn() -> bool) -> Series {
        let (computed, logged): (Vec<usize>, Vec<usize>) =
            of.iter().partition(|n| self.is_derived(**n));
        let (mut read, mut found) = (1.0, BTreeMap::new());
        if !logged.is_empty() {
            let share = self.logged(&logged, stretch, &more, &mut found);
            read = share.min(read);
        }
        if !computed.is_empty() {
            let (share, samples) = self.derive(&computed, stretch, &more);
            found.extend(samples.into_iter().map(|(number, s)| (number, (s, 0))));
            read = share.min(read);
        }
        let (mut samples, mut not_finite) = (Vec::new(), Vec::new());
        for number in of {
            let (own, bad) = found.get(number).cloned().unwrap_or_default();
            samples.push(own);
            not_finite.push(bad);
        }
        Series {
            read,
            samples,
            not_finite,
        }
    }

    /// The same of fields that stand in the log; the share that is read.
    fn logged(
        &self,
        of: &[usize],
        stretch: Stretch,
        more: impl Fn() -> bool,
        found: &mut BTreeMap<usize, (Vec<Sample>, u64)>,
    ) -> f64 {
        let mut columns = self.columns.held();
        let read = self.read_on(&mut columns, of, more);
        let all = self.log().all_places().len();
        let is_partial = |k: &usize| {
            let reading = columns.readings.get(k);
            reading.is_some_and(|r| r.column.is_thinned() || r.next < all)
        };
        let direct = match of.iter().any(is_partial) {
            true => self.direct(of, stretch),
            false => None,
        };
        let is_whole = direct.is_some();
        let mut direct = direct.unwrap_or_default();
        let Stretch {
            from_ns,
            to_ns,
            pixels,
        } = stretch;
        for number in of {
            let kept = columns.readings.get_mut(number).map(|r| &mut r.column);
            if let Some(column) = direct.get_mut(number).or(kept) {
                let shown = decimated(column.samples(), from_ns, to_ns, pixels);
                found.insert(*number, (shown, column.not_finite()));
            }
        }
        if is_whole { 1.0 } else { read }
    }

    /// Reads on for these fields; share of the places that is read.
    fn read_on(&self, columns: &mut Columns, of: &[usize], more: impl Fn() -> bool) -> f64 {
        columns.requests += 1;
        let request = columns.requests;
        for number in of {
            columns.readings.entry(*number).or_default().wanted = request;
        }
        while columns.readings.len() > COLUMNS_MAX.max(of.len()) {
            let oldest = columns.readings.iter().min_by_key(|(_, r)| r.wanted);
            let Some(oldest) = oldest.map(|(number, _)| *number) else {
                break;
            };
            columns.readings.remove(&oldest);
        }
        let places = self.log().all_places();
        let channels: BTreeMap<usize, u16> = {
            let fields = self.fields.held();
            let all = fields.all();
            of.iter()
                .filter_map(|n| Some((*n, all.get(*n)?.channel)))
                .collect()
        };
        let next_of = |columns: &Columns| {
            let each = of.iter().filter_map(|n| columns.readings.get(n));
            each.map(|r| r.next).min().unwrap_or(places.len())
        };
        loop {
            let at = next_of(columns);
            if at >= places.len() {
                return 1.0;
            }
            // Those that have come as far go on together.
            let along: BTreeSet<usize> = (of.iter().copied())
                .filter(|n| columns.readings.get(n).is_some_and(|r| r.next == at))
                .collect();
            let wanted: BTreeSet<u16> = along
                .iter()
                .filter_map(|n| channels.get(n).copied())
                .collect();
            let wanted: Vec<u16> = wanted.into_iter().collect();
            let is_read = places[at].holds(&wanted);
            if is_read {
                let messages = self.messages(at, &wanted);
                self.each_number(messages.iter(), |number, at_ns, value| {
                    if along.contains(&number)
                        && let Some(reading) = columns.readings.get_mut(&number)
                    {
                        reading.column.push(at_ns, value);
                    }
                });
            }
            for number in &along {
                if let Some(reading) = columns.readings.get_mut(number) {
                    reading.next = at + 1;
                }
            }
            if is_read && !more() {
                return next_of(columns) as f64 / places.len() as f64;
            }
        }
    }

    /// A short stretch from its own places; `None` = it is not short.
    fn direct(&self, of: &[usize], stretch: Stretch) -> Option<BTreeMap<usize, Column>> {
        let places = self.places_in(of, stretch.from_ns, stretch.to_ns);
        if places.len() > DIRECT_MAX {
            return None;
        }
        let mut columns: BTreeMap<usize, Column> = of
            .iter()
            .map(|number| (*number, Column::default()))
            .collect();
        let channels = self.channels_of_fields(of);
        for place in places {
            let messages = self.messages(place, &channels);
            self.each_number(messages.iter(), |number, at_ns, value| {
                if let Some(column) = columns.get_mut(&number) {
                    column.push(at_ns, value);
                }
            });
        }
        Some(columns)
    }

    pub(crate) fn channels_of_fields(&self, of: &[usize]) -> Vec<u16> {
        let fields = self.fields.held();
        let channels: BTreeSet<u16> = (of.iter())
            .filter_map(|n| Some(fields.all().get(*n)?.channel))
            .collect();
        channels.into_iter().collect()
    }

    /// Places that may hold samples of fields in a stretch.
    pub(crate) fn places_in(&self, of: &[usize], from_ns: i64, to_ns: i64) -> Vec<usize> {
        let all = self.log().all_places();
        let mut places = places_of(self.log(), &self.channels_of_fields(of));
        places.retain(|k| {
            let (first, last) = all[*k].span_ns();
            let (first, last) = (self.since_zero(first), self.since_zero(last));
            last >= from_ns && first <= to_ns.saturating_add(LAG_NS)
        });
        places
    }
}

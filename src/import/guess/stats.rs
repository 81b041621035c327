//! Each column in numbers.

use std::io;

use crate::clock::Sexagesimal;
use crate::layout::Layout;
use crate::map::FileMap;
use crate::number::{exact, number, says_nothing, ungrouped};
use crate::rows::each_row;
use crate::source::Source;

/// Rows looked at: what a column is shows long before.
const ROWS_MAX: usize = 1 << 20;
/// Rows kept as they stand.
const ROWS_KEPT: usize = 2000;
/// Characters from which on a double may be too coarse for a number.
const CHARACTERS_EXACT: usize = 15;
/// Largest ratio between the steps of a time: of its tenth and nine tenths.
const STEPS_EVEN: f64 = 10.0;
/// Rows of several topics come in groups: a step so many times the median is that from group to group.
const STEPS_GROUPED: f64 = 10.0;

fn value(cell: &str, file: &FileMap) -> Option<f64> {
    number(&ungrouped(cell, file.thousands, file.decimal), file.decimal)
}

#[derive(Debug, Clone, Default)]
pub(super) struct Column {
    pub numbers: usize,
    pub empty: usize,
    pub words: usize,
    pub low: f64,
    pub high: f64,
    pub first: f64,
    pub last: f64,
    /// Equal to the row before.
    pub repeats: usize,
    /// Below the row before, and by how much at most.
    pub back: usize,
    pub back_most: f64,
    pub whole: bool,
    /// Median of the size of the steps between the first rows.
    pub step: f64,
    /// The same between groups of rows, where they come in groups.
    pub group_step: f64,
    /// Steps are about equal.
    pub even: bool,
    /// First number, exactly, and the last one's distance from it.
    origin: Option<(i128, i32)>,
    last_since: f64,
    /// Its numbers as clocks.
    pub clock: Sexagesimal,
    /// A cell that is no number, and how many are another text.
    pub word: Option<String>,
    pub other_words: usize,
    /// Largest size of change per row, nineteen of twenty.
    pub usual: f64,
    /// First cells.
    pub cells: Vec<String>,
}

impl Column {
    pub fn rows(&self) -> usize {
        self.numbers + self.empty + self.words
    }
    pub fn is_numeric(&self) -> bool {
        // One text among numbers is what stands for none.
        let one_word = self.other_words == 0 && self.words <= 2 * self.numbers;
        self.numbers > 0 && (one_word || self.words * 50 <= self.rows())
    }
    /// Whether it goes on like a time: never back but for a counter's turns, seldom standing, in steps that are about equal.
    pub fn goes_on_evenly(&self) -> bool {
        let turns = self.whole && 2.0 * self.back_most > self.high - self.low;
        self.ascends() && (self.back == 0 || turns) && 2 * self.repeats < self.numbers && self.even
    }
    /// Whether it never goes back but for a counter's turns.
    pub fn ascends(&self) -> bool {
        self.is_numeric() && self.high > self.low && self.back * 200 <= self.numbers
    }
    pub fn largest(&self) -> f64 {
        self.low.abs().max(self.high.abs())
    }

    fn add(&mut self, cell: &str, file: &FileMap) {
        if self.cells.len() < ROWS_KEPT {
            self.cells.push(cell.chars().take(64).collect());
        }
        if says_nothing(cell) {
            self.empty += 1;
            return;
        }
        let Some(v) = value(cell, file) else {
            self.words += 1;
            let word = self.word.get_or_insert_with(|| cell.to_owned());
            self.other_words += usize::from(word.as_str() != cell);
            return;
        };
        if self.numbers == 0 {
            (self.first, self.low, self.high, self.whole) = (v, v, v, true);
            self.origin = exact(&ungrouped(cell, file.thousands, file.decimal), file.decimal);
        } else {
            let since = self.since(cell, v, file);
            self.repeats += usize::from(since == self.last_since);
            if since < self.last_since {
                self.back += 1;
                self.back_most = self.back_most.max(self.last_since - since);
            }
            self.last_since = since;
        }
        self.clock.row(v, 0);
        self.low = self.low.min(v);
        self.high = self.high.max(v);
        self.whole &= v.fract() == 0.0;
        self.last = v;
        self.numbers += 1;
    }

    /// Distance from the first number, also where doubles are too coarse for it: stamps of 19 digits.
    fn since(&self, cell: &str, v: f64, file: &FileMap) -> f64 {
        let exactly = || {
            let (own, power) = exact(&ungrouped(cell, file.thousands, file.decimal), file.decimal)?;
            let (first, first_power) = self.origin?;
            let least = power.min(first_power);
            let scaled = |m: i128, p: i32| m.checked_mul(10_i128.checked_pow(p.abs_diff(least))?);
            let distance = scaled(own, power)?.checked_sub(scaled(first, first_power)?)?;
            Some(distance as f64 * 10_f64.powi(least))
        };
        let long = cell.len() > CHARACTERS_EXACT;
        long.then(exactly).flatten().unwrap_or(v - self.first)
    }

    fn finish(&mut self, file: &FileMap) {
        let kept = self.cells.iter().filter_map(|c| Some((c, value(c, file)?)));
        let values: Vec<f64> = kept.map(|(c, v)| self.since(c, v, file)).collect();
        let mut steps: Vec<f64> = values.windows(2).map(|w| (w[1] - w[0]).abs()).collect();
        self.usual = crate::check::quantile(&mut steps, 0.95).unwrap_or(0.0);
        steps.retain(|s| *s > 0.0);
        let mut at = |share| crate::check::quantile(&mut steps, share).unwrap_or(0.0);
        let [tenth, half, most, nine_tenths] = [0.1, 0.5, 0.75, 0.9].map(&mut at);
        self.step = half;
        self.group_step = if most > STEPS_GROUPED * half {
            most
        } else {
            half
        };
        self.even = nine_tenths <= STEPS_EVEN * tenth;
    }
}

#[derive(Debug, Clone, Default)]
pub(super) struct Stats {
    pub rows: usize,
    pub columns: Vec<Column>,
}

impl Stats {
    pub fn of(source: &(impl Source + ?Sized), file: &FileMap) -> io::Result<Stats> {
        let layout = Layout::find(source, file)?;
        let width = layout.width().max(layout.usual);
        let mut stats = Stats {
            rows: 0,
            columns: vec![Column::default(); width],
        };
        each_row(source.open()?, &layout, file, |_, cells| {
            if let Some(cells) = cells {
                stats.rows += 1;
                for (i, column) in stats.columns.iter_mut().enumerate() {
                    column.add(cells.get(i), file);
                }
            }
            Ok(stats.rows < ROWS_MAX)
        })?;
        for column in &mut stats.columns {
            column.finish(file);
        }
        Ok(stats)
    }
}

//! Each column in numbers.

use std::io;

use crate::layout::Layout;
use crate::map::FileMap;
use crate::number::{number, says_nothing, ungrouped};
use crate::rows::each_row;
use crate::source::Source;

/// Rows looked at: what a column is shows long before.
const ROWS_MAX: usize = 1 << 20;
/// Rows kept as they stand.
const ROWS_KEPT: usize = 2000;

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
        self.numbers > 0 && self.words * 50 <= self.rows()
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
            return;
        };
        if self.numbers == 0 {
            (self.first, self.low, self.high, self.whole) = (v, v, v, true);
        } else {
            self.repeats += usize::from(v == self.last);
            if v < self.last {
                self.back += 1;
                self.back_most = self.back_most.max(self.last - v);
            }
        }
        self.low = self.low.min(v);
        self.high = self.high.max(v);
        self.whole &= v.fract() == 0.0;
        self.last = v;
        self.numbers += 1;
    }

    fn finish(&mut self, file: &FileMap) {
        let values: Vec<f64> = self.cells.iter().filter_map(|c| value(c, file)).collect();
        let mut steps: Vec<f64> = values.windows(2).map(|w| (w[1] - w[0]).abs()).collect();
        self.usual = crate::check::quantile(&mut steps, 0.95).unwrap_or(0.0);
        steps.retain(|s| *s > 0.0);
        self.step = crate::check::quantile(&mut steps, 0.5).unwrap_or(0.0);
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

//! The cells of a line.

use std::ops::Range;

use crate::map::Separator;
use crate::widths::borders;

/// Splits lines; keeps its buffers between them.
pub(crate) struct Splitter {
    pub separator: Separator,
    /// Characters of each column; empty = the separator stands between cells.
    widths: Vec<usize>,
    ranges: Vec<Range<usize>>,
    plain: Vec<u8>,
    ends: Vec<usize>,
    unquoted: String,
    quoted: csv_core::Reader,
}

/// The cells of one line, without blanks around them.
#[derive(Clone, Copy)]
pub(crate) struct Cells<'a> {
    text: &'a str,
    ranges: &'a [Range<usize>],
}

/// The same for a line that is read on.
pub(crate) struct KeptCells {
    text: String,
    ranges: Vec<Range<usize>>,
}

impl KeptCells {
    pub fn cells(&self) -> Cells<'_> {
        Cells {
            text: &self.text,
            ranges: &self.ranges,
        }
    }
}

impl<'a> Cells<'a> {
    pub fn keep(&self) -> KeptCells {
        KeptCells {
            text: self.text.to_owned(),
            ranges: self.ranges.to_vec(),
        }
    }
    pub fn len(&self) -> usize {
        self.ranges.len()
    }
    /// A cell from 0; empty beyond the last.
    pub fn get(&self, index: usize) -> &'a str {
        self.ranges
            .get(index)
            .and_then(|r| self.text.get(r.clone()))
            .map_or("", str::trim)
    }
    pub fn iter(&self) -> impl Iterator<Item = &'a str> + '_ {
        (0..self.len()).map(|i| self.get(i))
    }
    /// Number of cells up to the last that holds something.
    pub fn filled(&self) -> usize {
        let holds = |i: &usize| !self.get(*i).is_empty();
        (0..self.len()).rev().find(holds).map_or(0, |i| i + 1)
    }
    /// Whether all cells from this one on are empty.
    pub fn empty_from(&self, index: usize) -> bool {
        (index..self.len()).all(|i| self.get(i).is_empty())
    }
}

impl Splitter {
    pub fn new(separator: Separator) -> Self {
        let delimiter = match separator {
            Separator::Byte(b) => b,
            Separator::Blanks => b' ',
        };
        Splitter {
            separator,
            widths: Vec::new(),
            ranges: Vec::new(),
            plain: Vec::new(),
            ends: Vec::new(),
            unquoted: String::new(),
            quoted: csv_core::ReaderBuilder::new().delimiter(delimiter).build(),
        }
    }

    /// The same for columns of fixed widths, where there are any.
    pub fn of(separator: Separator, widths: &[usize]) -> Self {
        Splitter {
            widths: widths.to_vec(),
            ..Splitter::new(separator)
        }
    }

    /// Whether a line ends inside a quoted cell, which then goes on in the next line.
    pub fn is_open(&self, line: &str) -> bool {
        let Separator::Byte(separator) = self.separator else {
            return false;
        };
        if !self.widths.is_empty() {
            return false;
        }
        if !line.contains('"') {
            return false;
        }
        let (mut inside, mut starts) = (false, true);
        for b in line.bytes() {
            match b {
                b'"' if inside => inside = false,
                // A doubled quote ends and begins again.
                b'"' if starts => inside = true,
                _ if inside => {}
                _ if b == separator => starts = true,
                b' ' => {}
                _ => starts = false,
            }
        }
        inside
    }

    pub fn split<'a>(&'a mut self, line: &'a str) -> Cells<'a> {
        self.ranges.clear();
        match self.separator {
            _ if !self.widths.is_empty() => {
                let mut from = 0;
                for to in borders(line, &self.widths) {
                    self.ranges.push(from..to);
                    from = to;
                }
                // What stands beyond the columns is a cell too many.
                if !line[from..].trim().is_empty() {
                    self.ranges.push(from..line.len());
                }
            }
            Separator::Blanks => {
                let mut start = None;
                for (i, b) in line.bytes().enumerate() {
                    match (b == b' ' || b == b'\t', start) {
                        (false, None) => start = Some(i),
                        (true, Some(from)) => {
                            self.ranges.push(from..i);
                            start = None;
                        }
                        _ => {}
                    }
                }
                if let Some(from) = start {
                    self.ranges.push(from..line.len());
                }
            }
            Separator::Byte(_) if line.contains('"') => return self.split_quoted(line),
            Separator::Byte(separator) => {
                let mut from = 0;
                for (i, b) in line.bytes().enumerate() {
                    if b == separator {
                        self.ranges.push(from..i);
                        from = i + 1;
                    }
                }
                self.ranges.push(from..line.len());
            }
        }
        Cells {
            text: line,
            ranges: &self.ranges,
        }
    }

    /// By the csv library: quotes and doubled quotes.
    fn split_quoted<'a>(&'a mut self, line: &'a str) -> Cells<'a> {
        self.quoted.reset();
        self.plain.resize(line.len() + 1, 0);
        self.ends.resize(line.len() + 2, 0);
        let (mut read, mut written, mut cells) = (0, 0, 0);
        loop {
            let (result, r, w, e) = self.quoted.read_record(
                &line.as_bytes()[read..],
                &mut self.plain[written..],
                &mut self.ends[cells..],
            );
            (read, written, cells) = (read + r, written + w, cells + e);
            // Without input left the library closes the record; its buffers hold any line.
            if !matches!(result, csv_core::ReadRecordResult::InputEmpty) {
                break;
            }
        }
        self.unquoted.clear();
        self.unquoted
            .push_str(&String::from_utf8_lossy(&self.plain[..written]));
        let mut from = 0;
        for &end in &self.ends[..cells] {
            self.ranges.push(from..end);
            from = end;
        }
        Cells {
            text: &self.unquoted,
            ranges: &self.ranges,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn cells(separator: Separator, line: &str) -> Vec<String> {
        let mut splitter = Splitter::new(separator);
        splitter.split(line).iter().map(str::to_owned).collect()
    }

    #[test]
    fn cells_are_split_at_separators_blanks_and_quotes() {
        let comma = Separator::Byte(b',');
        assert_eq!(cells(comma, "1, 2,,3 ,"), ["1", "2", "", "3", ""]);
        assert_eq!(
            cells(comma, "\"a,b\",\"c \"\"d\"\"\",4"),
            ["a,b", "c \"d\"", "4"]
        );
        assert_eq!(cells(comma, ""), [""]);
        assert_eq!(cells(Separator::Blanks, "  1 \t2  x"), ["1", "2", "x"]);
        let mut fixed = Splitter::of(comma, &[4, 3, 3]);
        let of = |cells: Cells<'_>| cells.iter().map(str::to_owned).collect::<Vec<_>>();
        assert_eq!(of(fixed.split(" 1.5-2°-3 x")), ["1.5", "-2°", "-3", "x"]);
        assert_eq!(of(fixed.split(" 1.5")), ["1.5", "", ""]);
        assert!(Splitter::new(comma).is_open("1,\"a"));
        assert!(!Splitter::new(comma).is_open("1,5\",2"));
    }

    proptest! {
        #[test]
        fn whatever_is_quoted_comes_back(fields in proptest::collection::vec("[a-z0-9,;\" é]{0,8}", 1..6)) {
            let line: Vec<String> = fields.iter().map(|f| format!("\"{}\"", f.replace('"', "\"\""))).collect();
            let found = cells(Separator::Byte(b','), &line.join(","));
            let expected: Vec<&str> = fields.iter().map(|f| f.trim()).collect();
            prop_assert_eq!(found, expected);
        }

        #[test]
        fn any_line_is_split(line in "\\PC{0,80}") {
            for separator in [Separator::Blanks, Separator::Byte(b','), Separator::Byte(b'\t')] {
                prop_assert!(cells(separator, &line).len() <= line.len() + 1);
            }
        }
    }
}

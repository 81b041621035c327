//! A log of another program as a table: one row for each stamp, a column for each field that the map names.
//!
//! Topics are brought into the order of their stamps, as far as they were recorded within [`WINDOW_NS`] of each
//! other; within a topic the order stays as it is, so that stamps which go back show. Nothing is resampled: a
//! row holds what was measured at its stamp, and messages of several topics share one only if their stamps are equal.

use std::collections::{HashMap, VecDeque};
use std::io::{self, BufWriter, Write};

use super::columns::Columns;
use super::contents::TopicContents;
use super::message::{Message, Number, Sink};
use super::order::{Cause, Times, follows};
use crate::check::{Finding, FindingList};
use crate::map::Missing;

/// Topics that were recorded so far apart are still brought into order \[ns\].
const WINDOW_NS: i128 = 2_000_000_000;
/// Rows that wait at most.
const ROWS_MAX: usize = 1 << 16;
/// Name of the column of stamps, and of that of the times at which messages were recorded.
pub(crate) const STAMP: &str = "stamp";
pub(crate) const LOG_TIME: &str = "log_time";

struct Row {
    /// Time by which the row is ordered \[ns\]; `None` = before all others.
    key: Option<i128>,
    /// Rows of several topics with the same one are one.
    own_key: Option<i128>,
    stamp_ns: Option<i128>,
    log_ns: Option<i128>,
    cells: Vec<(usize, Number)>,
}

impl Row {
    fn times(&self) -> Option<Times> {
        Some(Times {
            own_ns: self.own_key?,
            log_ns: self.log_ns?,
        })
    }
}

/// Writes the table while the log is read.
pub(super) struct Writer<'a, W: Write> {
    columns: Columns,
    out: BufWriter<W>,
    /// The wanted columns by topic and path.
    places: HashMap<String, HashMap<String, usize>>,
    /// Column numbers of a topic.
    of_topic: HashMap<String, (usize, Vec<usize>)>,
    queues: Vec<VecDeque<Row>>,
    /// Of each queue's newest row: what orders it, and its times.
    last: Vec<Option<(i128, Times)>>,
    /// Of each queue, a row whose stamp went back: the next one tells whether its clock was started anew.
    suspects: Vec<Option<Row>>,
    /// Last finite number of each column.
    held: Vec<Option<Number>>,
    waiting: usize,
    newest: i128,
    /// A message without a stamp takes the time at which it was recorded, where that is the same clock.
    log_time_stands_in: bool,
    stood_in: HashMap<usize, u64>,
    /// Messages with the stamp 0, which nobody set, by topic.
    never_set: HashMap<usize, u64>,
    topics: &'a [TopicContents],
    cells: Vec<Option<Number>>,
    rows: u64,
}

fn quoted(cell: &str) -> String {
    if cell.contains([',', '"']) || cell.trim() != cell {
        format!("\"{}\"", cell.replace('"', "\"\""))
    } else {
        cell.to_owned()
    }
}

impl<'a, W: Write> Writer<'a, W> {
    pub fn new(
        columns: Columns,
        topics: &'a [TopicContents],
        log_time_stands_in: bool,
        out: W,
    ) -> io::Result<Self> {
        let mut places: HashMap<String, HashMap<String, usize>> = HashMap::new();
        let mut of_topic: HashMap<String, (usize, Vec<usize>)> = HashMap::new();
        let own = columns.topics();
        for (i, wanted) in columns.wanted.iter().enumerate() {
            let topic = topics[wanted.topic].topic.clone();
            let queue = own.iter().position(|t| *t == wanted.topic).unwrap_or(0);
            of_topic
                .entry(topic.clone())
                .or_insert_with(|| (queue, Vec::new()))
                .1
                .push(i);
            places
                .entry(topic)
                .or_default()
                .insert(wanted.path.clone(), i);
        }
        let mut out = BufWriter::new(out);
        let mut names: Vec<String> = vec![STAMP.to_owned(), LOG_TIME.to_owned()];
        names.extend(columns.wanted.iter().map(|w| quoted(&w.name)));
        writeln!(out, "{}", names.join(","))?;
        Ok(Writer {
            cells: vec![None; columns.wanted.len()],
            queues: own.iter().map(|_| VecDeque::new()).collect(),
            last: vec![None; own.len()],
            suspects: own.iter().map(|_| None).collect(),
            held: vec![None; columns.wanted.len()],
            columns,
            out,
            places,
            of_topic,
            waiting: 0,
            newest: i128::MIN,
            log_time_stands_in,
            stood_in: HashMap::new(),
            never_set: HashMap::new(),
            topics,
            rows: 0,
        })
    }

    /// The queue whose first row comes next.
    fn next(&self) -> Option<usize> {
        let first = |q: &VecDeque<Row>| q.front().map(|r| r.key.unwrap_or(i128::MIN));
        (0..self.queues.len())
            .filter_map(|i| Some((first(&self.queues[i])?, i)))
            .min()
            .map(|(_, i)| i)
    }

    /// Rows that nothing can come before any more.
    fn drain(&mut self, all: bool) -> io::Result<()> {
        loop {
            let Some(next) = self.next() else {
                return Ok(());
            };
            let every = self.queues.iter().all(|q| !q.is_empty());
            let front = self.queues[next].front();
            let old = front
                .and_then(|r| r.log_ns)
                .is_none_or(|ns| self.newest - ns > WINDOW_NS);
            if !(all || every || old || self.waiting > ROWS_MAX) {
                return Ok(());
            }
            let Some(mut row) = self.queues[next].pop_front() else {
                return Ok(());
            };
            self.waiting -= 1;
            for queue in &mut self.queues {
                if row.own_key.is_some() && queue.front().is_some_and(|r| r.own_key == row.own_key)
                {
                    // Of one topic two equal stamps stay two rows: one of them is wrong.
                    let same = queue.front().is_some_and(|r| {
                        r.cells.iter().any(|c| row.cells.iter().any(|o| o.0 == c.0))
                    });
                    if let Some(other) = (!same).then(|| queue.pop_front()).flatten() {
                        self.waiting -= 1;
                        row.cells.extend(other.cells);
                    }
                }
            }
            self.write(&row)?;
        }
    }

    /// A row whose stamp does not follow the one before waits for the next of its topic, which tells why. Before a clock that
    /// was started anew all rows of the old one are written.
    fn take(&mut self, queue: usize, row: Row) -> io::Result<()> {
        let before_ns = self.last[queue].map(|l| l.1.own_ns);
        if let Some(suspect) = self.suspects[queue].take() {
            let cause = match (suspect.own_key, before_ns, row.own_key) {
                (Some(suspect), Some(before), Some(next)) => Cause::of(suspect, before, next),
                _ => Cause::Other,
            };
            match cause {
                Cause::Restart => {
                    self.drain(true)?;
                    self.last.fill(None);
                    self.newest = i128::MIN;
                    for other in 0..self.queues.len() {
                        if let Some(waiting) = self.suspects[other].take() {
                            self.push(other, waiting);
                        }
                    }
                    self.push(queue, suspect);
                }
                Cause::Wrong => self.push_wrong(queue, suspect),
                Cause::Other => self.push(queue, suspect),
            }
        } else if let (Some(own), Some(before)) = (row.own_key, before_ns)
            && !follows(own, before)
        {
            self.suspects[queue] = Some(row);
            return Ok(());
        }
        self.push(queue, row);
        self.drain(false)
    }

    /// A stamp orders its row where it went on from the one before, else the log's own time goes on.
    fn push(&mut self, queue: usize, mut row: Row) {
        row.key = match (row.times(), self.last[queue]) {
            (Some(own), Some((key, before))) => Some(if own.goes_on_from(before) {
                own.own_ns
            } else {
                key + own.log_ns - before.log_ns
            }),
            _ => row.own_key,
        };
        if let (Some(key), Some(own)) = (row.key, row.times()) {
            self.last[queue] = Some((key, own));
        }
        self.newest = self.newest.max(row.log_ns.unwrap_or(i128::MIN));
        self.queues[queue].push_back(row);
        self.waiting += 1;
    }

    /// One absurd stamp must not hold up all that comes after it: its row stays behind the one before.
    fn push_wrong(&mut self, queue: usize, mut row: Row) {
        row.key = self.last[queue].map(|l| l.0);
        self.queues[queue].push_back(row);
        self.waiting += 1;
    }

    fn write(&mut self, row: &Row) -> io::Result<()> {
        let out = &mut self.out;
        if let Some(ns) = row.stamp_ns {
            write!(out, "{ns}")?;
        }
        write!(out, ",")?;
        if let Some(ns) = row.log_ns {
            write!(out, "{ns}")?;
        }
        self.cells.fill(None);
        for (place, value) in &row.cells {
            self.cells[*place] = Some(*value);
        }
        for cell in &self.cells {
            match cell {
                Some(value) if value.is_finite() => write!(out, ",{value}")?,
                Some(_) => write!(out, ",nan")?,
                None => write!(out, ",")?,
            }
        }
        writeln!(out)?;
        self.rows += 1;
        Ok(())
    }

    /// The rest of the rows: how many there are, and what was found.
    pub fn finish(mut self) -> io::Result<(u64, Vec<Finding>)> {
        for queue in 0..self.queues.len() {
            if let Some(suspect) = self.suspects[queue].take() {
                self.push(queue, suspect);
            }
        }
        self.drain(true)?;
        self.out.flush()?;
        let mut findings = Vec::new();
        let mut stood_in: Vec<(&usize, &u64)> = self.stood_in.iter().collect();
        stood_in.sort();
        for (topic, count) in stood_in {
            findings.warning(
                "no_stamp",
                format!(
                    "topic {}: {count} message(s) carry no stamp of their own: the time at which they were recorded stands in its place, and how long they were under way looks like a latency (all by that clock: time.column = \"{LOG_TIME}\")",
                    self.topics[*topic].topic,
                ),
            );
        }
        let mut never_set: Vec<(&usize, &u64)> = self.never_set.iter().collect();
        never_set.sort();
        for (topic, count) in never_set {
            findings.fault(
                "zero_stamps",
                format!(
                    "topic {}: {count} message(s) have the stamp 0, which stands where none was ever set: when they were true is not known, and they are left out; import the others with --accept-faults",
                    self.topics[*topic].topic,
                ),
            );
        }
        // A table of one topic is read with the map's own words for what is empty.
        let several = self.columns.topics().len() > 1;
        for w in self.columns.wanted.iter().filter(|_| several) {
            let topic = &self.topics[w.topic].topic;
            for (kind, count, what) in [
                ("empty_cells", w.absent, "do not hold it"),
                ("nan", w.not_finite, "hold no finite number"),
            ] {
                if count > 0 && w.missing == Missing::Fault {
                    findings.fault(
                        kind,
                        format!(
                            "column '{}': {count} message(s) of {topic} {what}; where that is no loss, the map says missing = \"skip\" or \"hold\" there",
                            w.name,
                        ),
                    );
                }
            }
        }
        Ok((self.rows, findings))
    }
}

impl<W: Write> Sink for Writer<'_, W> {
    fn wants(&mut self, topic: &str, schema: &str, _: usize) -> bool {
        // Lists of transforms become topics of their own.
        let is_list = schema.ends_with("TFMessage") || schema == "foxglove.FrameTransforms";
        is_list || self.of_topic.contains_key(topic)
    }

    fn message(&mut self, message: &Message<'_>) -> io::Result<()> {
        let Some(places) = self.places.get(message.topic) else {
            return Ok(());
        };
        let Some((queue, own)) = self.of_topic.get(message.topic) else {
            return Ok(());
        };
        let topic = self.columns.wanted[own[0]].topic;
        let time_ns = if self.columns.by_log_time {
            message.log_ns
        } else {
            message.stamp_ns
        };
        if time_ns == Some(0) && self.topics[topic].zero_stamps > 0 {
            *self.never_set.entry(topic).or_default() += 1;
            return Ok(());
        }
        let several = self.queues.len() > 1;
        let mut cells = Vec::with_capacity(own.len());
        for (path, mut value) in message.leaves.numbers() {
            if let Some(place) = places.get(path) {
                let wanted = &mut self.columns.wanted[*place];
                wanted.not_finite += u64::from(!value.is_finite());
                if value.is_finite() {
                    self.held[*place] = Some(value);
                } else if several && wanted.missing == Missing::Hold {
                    value = self.held[*place].unwrap_or(value);
                }
                cells.push((*place, value));
            }
        }
        if cells.len() < own.len() {
            for place in own {
                if cells.iter().any(|c| c.0 == *place) {
                    continue;
                }
                let wanted = &mut self.columns.wanted[*place];
                wanted.absent += 1;
                let holds = several && wanted.missing == Missing::Hold;
                cells.extend(self.held[*place].filter(|_| holds).map(|v| (*place, v)));
            }
        }
        let mut stamp_ns = message.stamp_ns;
        if stamp_ns.is_none() && self.log_time_stands_in {
            stamp_ns = message.log_ns;
            if self.columns.has_stamp {
                *self.stood_in.entry(topic).or_default() += 1;
            }
        }
        let own_key = if self.columns.by_log_time {
            message.log_ns
        } else {
            stamp_ns
        };
        let queue = *queue;
        let row = Row {
            key: None,
            own_key,
            stamp_ns,
            log_ns: message.log_ns,
            cells,
        };
        self.take(queue, row)
    }

    fn other(&mut self, _: &str, _: &str, _: Option<i128>) {}
}

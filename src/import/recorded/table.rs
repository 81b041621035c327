//! A log of another program as a table: one row for each stamp, a column for each field that the map names.
//!
//! Topics are brought into the order of their stamps, as far as they were recorded within [`WINDOW_NS`] of each
//! other; within a topic the order stays as it is, so that stamps which go back show. Nothing is resampled: a
//! row holds what was measured at its stamp, and messages of several topics share one only if their stamps are equal.

use std::collections::{HashMap, VecDeque};
use std::io::{self, BufWriter, Write};

use super::contents::{Contents, TopicContents};
use super::message::{Message, Number, Sink};
use crate::check::Finding;
use crate::map::{Column, Map, Missing, Origin, TimeSource};

/// Topics that were recorded so far apart are still brought into order \[ns\].
const WINDOW_NS: i128 = 2_000_000_000;
/// Rows that wait at most.
const ROWS_MAX: usize = 1 << 16;
/// Name of the column of stamps, and of that of the times at which messages were recorded.
pub(crate) const STAMP: &str = "stamp";
pub(crate) const LOG_TIME: &str = "log_time";

/// A field that the map names.
#[derive(Debug, Clone, PartialEq)]
struct Wanted {
    /// As the map has it: the column's name.
    name: String,
    /// Place in the contents' topics, and path within.
    topic: usize,
    path: String,
    /// What an empty cell means there.
    missing: Missing,
    /// Messages without the field, and with one that is no finite number.
    absent: u64,
    not_finite: u64,
}

/// Columns of a table, from a map.
#[derive(Debug, Clone, Default)]
pub(super) struct Columns {
    /// Also by when they were recorded.
    has_stamp: bool,
    has_log_time: bool,
    by_log_time: bool,
    wanted: Vec<Wanted>,
}

/// Every column of a map, with what an empty cell of it means.
fn named(map: &Map) -> Vec<(Column, Missing, String)> {
    let mut all = Vec::new();
    let mut add = |c: &Column, missing, key: String| all.push((c.clone(), missing, key));
    match &map.time.source {
        TimeSource::Rows => {}
        TimeSource::Frames(c) => add(c, Missing::Skip, "time".to_owned()),
        TimeSource::Numbers(list) => {
            for (c, _) in list {
                add(c, Missing::Skip, "time".to_owned());
            }
        }
        TimeSource::Iso(list) | TimeSource::Pattern(list, _) => {
            for c in list {
                add(c, Missing::Skip, "time".to_owned());
            }
        }
    }
    if let Some((c, _)) = &map.time.compare {
        add(c, Missing::Skip, "time.compare".to_owned());
    }
    for channel in &map.channels {
        if let Origin::Column(c) = &channel.origin {
            let name = crate::map::place_name(channel.place);
            add(c, channel.missing, format!("motion.{name}"));
        }
    }
    if let Some(q) = &map.quaternion {
        for c in &q.wxyz {
            add(c, q.missing, "quaternion".to_owned());
        }
    }
    for (i, command) in map.commands.iter().enumerate() {
        if let Origin::Column(c) = &command.origin {
            add(c, command.missing, format!("command {}", i + 1));
        }
    }
    all
}

/// Topic and path of a name: `TOPIC.path`, `TOPIC/path/with/slashes`, or a path that one topic alone has.
fn resolve(
    name: &str,
    topics: &[TopicContents],
    chosen: &dyn Fn(&str) -> bool,
) -> Result<(usize, String), String> {
    let dotted = |rest: &str| rest.replace('/', ".");
    let mut best: Option<(usize, &str)> = None;
    for (place, t) in topics.iter().enumerate() {
        let Some(rest) = name.strip_prefix(t.topic.as_str()) else {
            continue;
        };
        let rest = rest.strip_prefix(['.', '/']);
        if let Some(rest) = rest
            && best.is_none_or(|b| topics[b.0].topic.len() < t.topic.len())
        {
            best = Some((place, rest));
        }
    }
    if let Some((place, rest)) = best {
        let t = &topics[place];
        let own = [rest.to_owned(), dotted(rest)];
        if let Some(path) = own.iter().find(|p| t.fields.iter().any(|f| f.path == **p)) {
            return Ok((place, path.clone()));
        }
        let fields: Vec<&str> = t.fields.iter().map(|f| f.path.as_str()).take(60).collect();
        return Err(format!(
            "topic {} has no field '{rest}'; name one of: {}",
            t.topic,
            fields.join(" ")
        ));
    }
    let own = [name.to_owned(), dotted(name.trim_start_matches('/'))];
    let holders: Vec<(usize, &String)> = topics
        .iter()
        .enumerate()
        .filter(|(_, t)| chosen(&t.topic))
        .filter_map(|(place, t)| {
            let path = own.iter().find(|p| t.fields.iter().any(|f| f.path == **p));
            Some((place, path?))
        })
        .collect();
    match holders.as_slice() {
        [(place, path)] => Ok((*place, (*path).clone())),
        [] => {
            let names: Vec<&str> = topics.iter().map(|t| t.topic.as_str()).take(40).collect();
            Err(format!(
                "no topic or field '{name}' in the log: a column is TOPIC.FIELD, such as {}; `hydroline info LOG` lists them; topics: {}",
                topics
                    .iter()
                    .find_map(|t| Some(format!("{}.{}", t.topic, t.fields.first()?.path)))
                    .unwrap_or_default(),
                names.join(" ")
            ))
        }
        several => {
            let names: Vec<&str> = several
                .iter()
                .map(|(p, _)| topics[*p].topic.as_str())
                .collect();
            Err(format!(
                "the field '{name}' is in {} topics: name one, {}.{name} (or --topic): {}",
                several.len(),
                names[0],
                names.join(" ")
            ))
        }
    }
}

impl Columns {
    /// The columns that a map names; what it names wrongly is a finding.
    pub fn of(
        map: &Map,
        contents: &Contents,
        chosen: &dyn Fn(&str) -> bool,
        findings: &mut Vec<Finding>,
    ) -> Columns {
        let mut columns = Columns::default();
        for (column, missing, key) in named(map) {
            let name = match column {
                Column::Name { name, nth: None } => name,
                other => {
                    findings.push(Finding::fault(
                        "column_missing",
                        None,
                        format!(
                            "{key}: column {other}: fields of a log go by their names, TOPIC.FIELD"
                        ),
                    ));
                    continue;
                }
            };
            if name == STAMP || name == LOG_TIME {
                let is_ns = matches!(&map.time.source, TimeSource::Numbers(n) if n.len() == 1 && n[0].1 == 1);
                if key == "time" && !is_ns {
                    findings.push(Finding::fault(
                        "time_unit",
                        None,
                        format!("time.unit is '{}', but column '{name}' of a log is in ns: set unit = \"ns\"", map.time.unit),
                    ));
                }
                columns.has_stamp |= name == STAMP;
                columns.has_log_time |= name == LOG_TIME;
                columns.by_log_time |= name == LOG_TIME && key == "time";
                continue;
            }
            match resolve(&name, &contents.topics, chosen) {
                Ok((topic, path)) => {
                    if !columns.wanted.iter().any(|w| w.name == name) {
                        columns.wanted.push(Wanted {
                            name,
                            topic,
                            path,
                            missing,
                            absent: 0,
                            not_finite: 0,
                        });
                    }
                }
                Err(words) => {
                    findings.push(Finding::fault(
                        "column_missing",
                        None,
                        format!("{key}: {words}"),
                    ));
                }
            }
        }
        columns
    }

    /// Topics that stand in the table, by their places.
    pub fn topics(&self) -> Vec<usize> {
        let mut all: Vec<usize> = self.wanted.iter().map(|w| w.topic).collect();
        all.sort_unstable();
        all.dedup();
        all
    }

    /// The same map for the table: where several topics share it, a row need not hold them all.
    pub fn map_for_table(&self, map: &Map) -> Map {
        let mut own = map.clone();
        own.file = plain_file();
        if self.topics().len() > 1 {
            let relax = |m: &mut Missing| {
                if *m == Missing::Fault {
                    *m = Missing::Skip;
                }
            };
            own.channels
                .iter_mut()
                .filter(|c| matches!(c.origin, Origin::Column(_)))
                .for_each(|c| relax(&mut c.missing));
            own.commands.iter_mut().for_each(|c| relax(&mut c.missing));
            if let Some(q) = &mut own.quaternion {
                relax(&mut q.missing);
            }
        }
        own
    }
}

/// The table as it is written here.
pub(crate) fn plain_file() -> crate::map::FileMap {
    crate::map::FileMap {
        separator: None,
        decimal: '.',
        encoding: None,
        comment: None,
        header: true,
        header_line: None,
        units_line: None,
        first_line: None,
        last_line: None,
    }
}

struct Row {
    /// What orders it.
    key: Option<i128>,
    stamp_ns: Option<i128>,
    log_ns: Option<i128>,
    cells: Vec<(usize, Number)>,
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
    waiting: usize,
    newest: i128,
    /// A message without a stamp takes the time at which it was recorded, where that is the same clock.
    log_time_stands_in: bool,
    stood_in: HashMap<usize, u64>,
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
            columns,
            out,
            places,
            of_topic,
            waiting: 0,
            newest: i128::MIN,
            log_time_stands_in,
            stood_in: HashMap::new(),
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
                if row.key.is_some() && queue.front().is_some_and(|r| r.key == row.key) {
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
        self.drain(true)?;
        self.out.flush()?;
        let mut findings = Vec::new();
        let mut stood_in: Vec<(&usize, &u64)> = self.stood_in.iter().collect();
        stood_in.sort();
        for (topic, count) in stood_in {
            findings.push(Finding::warning(
                "no_stamp",
                None,
                format!(
                    "topic {}: {count} message(s) carry no stamp of their own: the time at which they were recorded stands in its place, and how long they were under way looks like a latency (all by that clock: time.column = \"{LOG_TIME}\")",
                    self.topics[*topic].topic
                ),
            ));
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
                    findings.push(Finding::fault(
                        kind,
                        None,
                        format!(
                            "column '{}': {count} message(s) of {topic} {what}; where that is no loss, the map says missing = \"skip\" or \"hold\" there",
                            w.name
                        ),
                    ));
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
        let mut cells = Vec::with_capacity(own.len());
        for (path, value) in message.leaves.numbers() {
            if let Some(place) = places.get(path) {
                self.columns.wanted[*place].not_finite += u64::from(!value.is_finite());
                cells.push((*place, value));
            }
        }
        if cells.len() < own.len() {
            for place in own {
                let there = cells.iter().any(|c| c.0 == *place);
                self.columns.wanted[*place].absent += u64::from(!there);
            }
        }
        let mut stamp_ns = message.stamp_ns;
        if stamp_ns.is_none() && self.log_time_stands_in {
            stamp_ns = message.log_ns;
            if self.columns.has_stamp {
                let topic = self.columns.wanted[own[0]].topic;
                *self.stood_in.entry(topic).or_default() += 1;
            }
        }
        let key = if self.columns.by_log_time {
            message.log_ns
        } else {
            stamp_ns
        };
        self.newest = self.newest.max(message.log_ns.unwrap_or(i128::MIN));
        let row = Row {
            key,
            stamp_ns,
            log_ns: message.log_ns,
            cells,
        };
        let queue = *queue;
        self.queues[queue].push_back(row);
        self.waiting += 1;
        self.drain(false)
    }

    fn other(&mut self, _: &str, _: &str, _: Option<i128>) {}
}

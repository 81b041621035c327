//! The fields that a map names in a log.

use super::contents::{Contents, TopicContents};
use super::table::{LOG_TIME, STAMP};
use crate::check::{Finding, FindingList};
use crate::map::{Column, Map, Missing, Origin, TimeSource};

/// Fields of a topic that are named where a map names one that it has not.
const FIELDS_NAMED: usize = 60;

/// A field that the map names.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Wanted {
    /// As the map has it: the column's name.
    pub(super) name: String,
    /// Place in the contents' topics, and path within.
    pub(super) topic: usize,
    pub(super) path: String,
    /// Meaning of an empty cell there.
    pub(super) missing: Missing,
    /// Messages without the field, and with one that is no finite number.
    pub(super) absent: u64,
    pub(super) not_finite: u64,
}

/// Columns of a table, from a map.
#[derive(Debug, Clone, Default)]
pub(super) struct Columns {
    /// Also by when they were recorded.
    pub(super) has_stamp: bool,
    pub(super) has_log_time: bool,
    pub(super) by_log_time: bool,
    pub(super) wanted: Vec<Wanted>,
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
    contents: &Contents,
    chosen: &dyn Fn(&str) -> bool,
) -> Result<(usize, String), String> {
    let topics = contents.topics.as_slice();
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
        return Err(without_field(t, rest, contents));
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
            let example = topics
                .iter()
                .find_map(|t| Some(format!("{}.{}", t.topic, t.fields.first()?.path)));
            let Some(example) = example else {
                return Err(format!(
                    "no topic or field '{name}' in the log: {}; `hydroline info LOG` says why",
                    contents.nameable()
                ));
            };
            let names: Vec<&str> = topics.iter().map(|t| t.topic.as_str()).take(40).collect();
            Err(format!(
                "no topic or field '{name}' in the log: a column is TOPIC.FIELD, such as {example}; `hydroline info LOG` lists them; topics: {}",
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

/// Words for a topic that is there and lacks a field: the fields it has, or why it has none.
fn without_field(topic: &TopicContents, field: &str, contents: &Contents) -> String {
    let name = &topic.topic;
    let fields: Vec<&str> = topic.fields.iter().map(|f| f.path.as_str()).collect();
    match (fields.as_slice(), contents.undecoded_of(name)) {
        ([], Some(u)) => format!(
            "topic {name} has no field '{field}': {} of its messages cannot be decoded ({})",
            u.count, u.reason
        ),
        ([], None) => format!(
            "topic {name} has no field '{field}': its messages ({}) hold no numbers; {}",
            topic.schema,
            contents.nameable()
        ),
        (some, _) => format!(
            "topic {name} has no field '{field}'; name one of: {}",
            some[..some.len().min(FIELDS_NAMED)].join(" ")
        ),
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
                    findings.fault(
                        "column_missing",
                        format!(
                            "{key}: column {other}: fields of a log go by their names, TOPIC.FIELD"
                        ),
                    );
                    continue;
                }
            };
            if name == STAMP || name == LOG_TIME {
                let is_ns = matches!(&map.time.source, TimeSource::Numbers(n) if n.len() == 1 && n[0].1 == 1);
                if key == "time" && !is_ns {
                    findings.fault("time_unit", format!("time.unit is '{}', but column '{name}' of a log is in ns: set unit = \"ns\"", map.time.unit));
                }
                columns.has_stamp |= name == STAMP;
                columns.has_log_time |= name == LOG_TIME;
                columns.by_log_time |= name == LOG_TIME && key == "time";
                continue;
            }
            match resolve(&name, contents, chosen) {
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
                    findings.fault("column_missing", format!("{key}: {words}"));
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
        own.file = crate::map::FileMap::plain();
        if self.topics().len() > 1 {
            // A value that holds does so within its own topic, where the table is written: in a row of another topic nothing was
            // measured. A command holds anyway.
            own.channels
                .iter_mut()
                .filter(|c| matches!(c.origin, Origin::Column(_)))
                .for_each(|c| c.missing = Missing::Skip);
            for c in &mut own.commands {
                if c.missing == Missing::Fault {
                    c.missing = Missing::Skip;
                }
            }
            if let Some(q) = &mut own.quaternion {
                q.missing = Missing::Skip;
            }
        }
        own
    }
}

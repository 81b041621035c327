//! A map for a log of another program: what its kinds of messages mean is known, which of them the vehicle's is not.

mod fields;

use std::collections::BTreeSet;
use std::io;

use super::file::quoted;
use super::{Draft, Guess, GuessError};
use crate::check::{Finding, Severity};
use crate::map::{Map, dimension, place_name};
use crate::recorded::{RecordedError, Recording, TopicContents};
use crate::survey::survey;
use crate::unit::{self, Dimension};
use fields::What::{Channel, Load, Quaternion, Thruster};
use fields::{GROUPS, What, autopilot, group, is_wish, ros};

const LOADS: [&str; 6] = ["surge", "sway", "heave", "roll", "pitch", "yaw"];

/// One topic with what its fields are.
struct Bundle<'a> {
    topic: &'a TopicContents,
    fields: Vec<(What, &'a str, Option<&'a str>)>,
}

impl Bundle<'_> {
    /// Whole groups: three axes or angles, or a quaternion.
    fn has(&self, own: usize) -> bool {
        let count = self
            .fields
            .iter()
            .filter(|f| group(f.0) == Some(own))
            .count();
        count >= 3 || (own != 1 && count > 0)
    }

    fn groups(&self) -> usize {
        (0..GROUPS.len()).filter(|g| self.has(*g)).count()
    }
}

fn is_ros(recording: &Recording) -> bool {
    recording.one_clock()
}

/// Channels that never move in this log, by their topic: a field that its writer leaves at nothing.
type Dead = BTreeSet<(String, usize)>;

fn bundles<'a>(recording: &'a Recording, dead: &Dead) -> Vec<Bundle<'a>> {
    let mut all: Vec<Bundle<'_>> = Vec::new();
    for topic in &recording.contents().topics {
        if !recording.is_chosen(&topic.topic) || topic.messages < 4 || is_wish(&topic.topic) {
            continue;
        }
        let fields = topic
            .fields
            .iter()
            .filter_map(|f| {
                let what = if is_ros(recording) {
                    ros(topic, &f.path)
                } else {
                    autopilot(topic, &f.path)
                }?;
                let is_dead = matches!(what, Channel(place, ..) if dead.contains(&(topic.topic.clone(), place)));
                (!is_dead).then_some((what, f.path.as_str(), f.unit.as_deref()))
            })
            .collect::<Vec<_>>();
        if !fields.is_empty() {
            all.push(Bundle { topic, fields });
        }
    }
    // A topic with more groups together comes first; of equals the one that is first in the log.
    all.sort_by_key(|b| std::cmp::Reverse(b.groups()));
    all
}

/// Unit of a field: as the log states it, or as its kind has it; and whether that was stated.
fn unit_of(place: usize, stated: Option<&str>, recording: &Recording) -> (String, bool) {
    let dimension = dimension(place);
    let stated = stated.map(|s| if s == "degheading" { "deg" } else { s });
    if let Some(u) = stated.and_then(|s| unit::find(dimension, s)) {
        return (u.name.to_owned(), true);
    }
    let dataflash = recording.contents().kind.starts_with("ArduPilot");
    let own = match dimension {
        Dimension::Length => "m",
        Dimension::Angle if dataflash => "deg",
        Dimension::Angle => "rad",
        Dimension::Speed => "m/s",
        _ => "rad/s",
    };
    (own.to_owned(), false)
}

/// The list and the element that a field lies in: `poses`, 1 of `poses[1].position.x`.
fn element(path: &str) -> Option<(&str, usize)> {
    let (list, rest) = path.split_once('[')?;
    let (number, _) = rest.split_once("].")?;
    Some((list, number.parse().ok()?))
}

/// Choices of a draft where the log leaves something open.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Open {
    in_tank: bool,
    unix: bool,
}

struct Plan<'a> {
    recording: &'a Recording,
    bundles: Vec<Bundle<'a>>,
    /// Bundle of each group.
    sources: [Option<usize>; 4],
}

impl<'a> Plan<'a> {
    fn of(recording: &'a Recording, dead: &Dead) -> Plan<'a> {
        let bundles = bundles(recording, dead);
        let sources = std::array::from_fn(|g| bundles.iter().position(|b| b.has(g)));
        Plan {
            recording,
            bundles,
            sources,
        }
    }

    /// Fields of a group.
    fn fields(&self, own: usize) -> impl Iterator<Item = (What, String, Option<&'a str>)> + '_ {
        let bundle = self.sources[own].map(|s| &self.bundles[s]);
        bundle.into_iter().flat_map(move |b| {
            b.fields
                .iter()
                .filter(move |f| group(f.0) == Some(own))
                .map(|f| (f.0, format!("{}.{}", b.topic.topic, f.1), f.2))
        })
    }

    /// The topic that a channel of a name is taken from, and its place.
    fn source_of(&self, name: &str) -> Option<(String, usize)> {
        let (own, bundle) = self.sources.iter().enumerate().find_map(|(own, source)| {
            let bundle = &self.bundles[(*source)?];
            let is_own = |w: &What| {
                matches!(*w, Channel(place, ..) if place_name(place) == name)
                    && group(*w) == Some(own)
            };
            let what = bundle.fields.iter().map(|f| f.0).find(is_own)?;
            Some((what, bundle))
        })?;
        let Channel(place, ..) = own else { return None };
        Some((bundle.topic.topic.clone(), place))
    }

    fn loads(&self) -> Vec<(usize, bool, String)> {
        let mut loads: Vec<(usize, bool, String)> = Vec::new();
        for b in &self.bundles {
            for (what, path, _) in &b.fields {
                if let Load(d, rotated) = what
                    && !loads.iter().any(|l| l.0 == *d)
                {
                    loads.push((*d, *rotated, format!("{}.{path}", b.topic.topic)));
                }
            }
        }
        loads
    }

    fn thrusters(&self) -> Vec<String> {
        let of = |b: &Bundle<'_>| -> Vec<String> {
            b.fields
                .iter()
                .filter(|f| f.0 == Thruster)
                .map(|f| format!("{}.{}", b.topic.topic, f.1))
                .collect()
        };
        self.bundles.iter().flat_map(of).collect()
    }

    /// Topics that the map will name.
    fn topics(&self) -> Vec<&TopicContents> {
        let mut own: Vec<usize> = self.sources.iter().flatten().copied().collect();
        let loaded = |b: &Bundle<'_>| b.fields.iter().any(|f| matches!(f.0, Load(..)));
        own.extend((0..self.bundles.len()).filter(|i| loaded(&self.bundles[*i])));
        own.sort_unstable();
        own.dedup();
        own.iter().map(|i| self.bundles[*i].topic).collect()
    }

    fn is_empty(&self) -> bool {
        self.sources.iter().all(Option::is_none) && self.loads().is_empty()
    }

    /// Frame of velocities, where their topic leaves it open.
    fn frame_open(&self) -> bool {
        self.fields(2).any(|f| matches!(f.0, Channel(_, _, None)))
    }

    fn write(&self, open: Open) -> Draft {
        let mut draft = Draft::default();
        let title = format!(
            "map guessed by hydroline from {}",
            self.recording.contents().kind
        );
        draft.line(format!("# {title}"));
        draft.remarks.push(title);
        self.write_time(open, &mut draft);
        self.write_axes(&mut draft);
        self.write_bodies(&mut draft);
        let rotated_axes = is_ros(self.recording);
        if let Some(quaternion) = self.quaternion() {
            draft.line("[quaternion]");
            let list: Vec<String> = quaternion.iter().map(|c| quoted(c)).collect();
            draft.line(format!("columns = [{}]", list.join(", ")));
            draft.line("order = \"wxyz\"");
            if rotated_axes {
                draft.line("axes = \"z_up\"");
            }
        }
        for own in 0..GROUPS.len() {
            self.write_group(own, open, &mut draft);
        }
        for (dof, rotated, column) in self.loads() {
            draft.line("[[command]]");
            let unit = if dof < 3 { "N" } else { "N m" };
            draft.question(format!("{column}: taken as the load commanded in {}; whether it was commanded or measured, and that it is in {unit}, is not written", LOADS[dof]));
            draft.line(format!("thruster = \"{}\"", LOADS[dof]));
            draft.line(format!("column = {}", quoted(&column)));
            draft.line(format!("unit = \"{unit}\""));
            if rotated {
                draft.line("sign = -1");
            }
        }
        self.write_thrusters(&mut draft);
        self.write_others(&mut draft);
        draft
    }

    fn quaternion(&self) -> Option<[String; 4]> {
        let mut parts: [Option<String>; 4] = Default::default();
        for (what, column, _) in self.fields(1) {
            // Of several bodies in one message the first, as of their places.
            if let Quaternion(c @ 0..4) = what {
                parts[c].get_or_insert(column);
            }
        }
        let [Some(w), Some(x), Some(y), Some(z)] = parts else {
            return None;
        };
        Some([w, x, y, z])
    }

    fn write_time(&self, open: Open, draft: &mut Draft) {
        draft.line("[time]");
        let without: Vec<&str> = self
            .topics()
            .iter()
            .filter(|t| t.stamped < t.messages)
            .map(|t| t.topic.as_str())
            .collect();
        let mut unix = open.unix && is_ros(self.recording);
        let column = if without.is_empty() {
            "stamp"
        } else {
            unix = true;
            draft.question(format!(
                "{}: messages without a stamp of their own, so that all go by when they were recorded; how long they were under way looks like a latency",
                without.join(", ")
            ));
            "log_time"
        };
        draft.line(format!("column = \"{column}\""));
        draft.line("unit = \"ns\"");
        if unix {
            draft.line("clock = \"unix\"");
        }
    }

    fn write_axes(&self, draft: &mut Draft) {
        if is_ros(self.recording) {
            draft.question("axes: x forward, y to port, z up, and metres, radians, seconds, as REP 103 has them and the log does not say: rotated to y to starboard, z down");
        } else {
            draft.question("axes: x forward (north), y to starboard (east), z down, as the autopilot has them: those of the tank are rotated by its heading");
        }
    }

    /// Of an array of bodies the first is taken: which one that is only who recorded it knows.
    fn write_bodies(&self, draft: &mut Draft) {
        let mut own: Vec<usize> = self.sources.iter().flatten().copied().collect();
        own.sort_unstable();
        own.dedup();
        for bundle in own.into_iter().map(|i| &self.bundles[i]) {
            let elements = bundle
                .fields
                .iter()
                .filter_map(|(_, path, _)| element(path));
            if let Some((list, last @ 1..)) = elements.max_by_key(|e| e.1) {
                let topic = &bundle.topic.topic;
                draft.question(format!(
                    "{topic}: {list}[0] is taken, of up to {} in a message: which body stands there, and that it stays there, is not written; another's number in its place takes that one",
                    last + 1
                ));
            }
        }
    }

    fn write_group(&self, own: usize, open: Open, draft: &mut Draft) {
        if own == 1 && self.quaternion().is_some() {
            return;
        }
        let frame_open = own == 2 && self.frame_open();
        if frame_open {
            let (frame, other) = if open.in_tank {
                ("tank", "body")
            } else {
                ("body", "tank")
            };
            draft.question(format!("velocities are taken to be along the {frame}'s axes, which the log does not say: else frame = \"{other}\""));
        }
        let mut fields: Vec<_> = self.fields(own).collect();
        fields.sort_by_key(|f| match f.0 {
            Channel(place, ..) => place,
            _ => 99,
        });
        let mut before = None;
        for (what, column, stated) in fields {
            let Channel(place, rotated, tank) = what else {
                continue;
            };
            if before.replace(place) == Some(place) {
                continue;
            }
            let (unit, is_stated) = unit_of(place, stated, self.recording);
            draft.line(format!("[motion.{}]", place_name(place)));
            draft.line(format!("column = {}", quoted(&column)));
            if !is_stated && !is_ros(self.recording) {
                let kind = self.recording.contents().kind;
                let words =
                    format!("unit of {column}: {unit}, as {kind} has it; the log does not say");
                draft.question(words);
            }
            draft.line(format!("unit = \"{unit}\""));
            if rotated {
                draft.line("sign = -1");
            }
            if (6..9).contains(&place) && tank.unwrap_or(open.in_tank) {
                draft.line("frame = \"tank\"");
            }
        }
    }

    fn write_thrusters(&self, draft: &mut Draft) {
        let thrusters = self.thrusters();
        if thrusters.is_empty() {
            return;
        }
        draft.question("these look like commands of single thrusters: which is which in the rig is not written; for each that is, without the #:");
        for column in thrusters.iter().take(16) {
            let unit = if column.contains("control[") || column.contains(".data") {
                "N\"   # and scale = newtons per unit"
            } else {
                "us\"   # a pulse, by the rig's curve: import --rig RIG"
            };
            draft.toml.push("# [[command]]".to_owned());
            draft
                .toml
                .push("# thruster = \"NAME IN THE RIG\"".to_owned());
            draft.toml.push(format!("# column = {}", quoted(column)));
            draft.toml.push(format!("# unit = \"{unit}"));
        }
    }

    /// Topics that could stand in a chosen one's place.
    fn write_others(&self, draft: &mut Draft) {
        for (own, name) in GROUPS.iter().enumerate() {
            let Some(source) = self.sources[own] else {
                continue;
            };
            let others: Vec<&str> = self
                .bundles
                .iter()
                .enumerate()
                .filter(|(i, b)| *i != source && b.has(own))
                .map(|(_, b)| b.topic.topic.as_str())
                .take(12)
                .collect();
            if !others.is_empty() {
                draft.question(format!(
                    "{name} from {}; it is in others too: {} (--topic names those to look at)",
                    self.bundles[source].topic.topic,
                    others.join(" ")
                ));
            }
        }
    }
}

/// Proposes a map for a log.
///
/// # Errors
/// Those of its files.
pub fn guess_recording(recording: &Recording) -> Result<Result<Guess, GuessError>, RecordedError> {
    let mut dead = Dead::new();
    let mut plan = Plan::of(recording, &dead);
    if plan.is_empty() {
        let topics = recording.contents().topics.iter();
        let columns = topics
            .filter(|t| recording.is_chosen(&t.topic))
            .map(|t| format!("{} ({})", t.topic, t.schema))
            .collect::<Vec<_>>()
            .join(" | ");
        return Ok(Err(GuessError::NoMotion {
            columns,
            hint: String::new(),
        }));
    }
    let first = Open {
        in_tank: false,
        unix: true,
    };
    let mut draft = plan.write(first);
    let mut found = faults(recording, &draft)?;
    // A channel that never moves is left out, or taken from another topic that has it; each time some channel goes.
    loop {
        let own = found.2.iter().filter_map(|name| plan.source_of(name));
        let more: Vec<(String, usize)> = own.collect();
        let next = Plan::of(
            recording,
            &dead.iter().cloned().chain(more.clone()).collect(),
        );
        if more.is_empty() || next.sources.iter().all(Option::is_none) {
            break;
        }
        let without = next.write(first);
        let tried = faults(recording, &without)?;
        if tried.1 > found.1 {
            break;
        }
        dead.extend(more);
        (plan, draft, found) = (next, without, tried);
    }
    let others = [
        Open {
            unix: false,
            ..first
        },
        Open {
            in_tank: true,
            ..first
        },
        Open {
            in_tank: true,
            unix: false,
        },
    ];
    for open in others {
        let other = plan.write(open);
        if found.1 == 0 || other.toml == draft.toml {
            continue;
        }
        let tried = faults(recording, &other)?;
        if tried.1 < found.1 {
            (draft, found) = (other, tried);
        }
    }
    if !dead.is_empty() {
        let all: Vec<String> = dead
            .iter()
            .map(|(topic, place)| format!("{} of {topic}", place_name(*place)))
            .collect();
        let words = format!("left out, for they never change: {}", all.join(", "));
        draft.toml.insert(1, format!("# {words}"));
        draft.remarks.push(words);
    }
    for (kind, message) in found.0 {
        draft
            .remarks
            .push(format!("with this map: {kind}: {message}"));
    }
    Ok(Ok(Guess {
        kind: recording.contents().kind,
        toml: draft.toml.join("\n") + "\n",
        remarks: draft.remarks,
    }))
}

/// Faults of an import with the drafted map, their score, and the channels that never move.
type Found = (Vec<(&'static str, String)>, usize, Vec<String>);

fn faults(recording: &Recording, draft: &Draft) -> Result<Found, RecordedError> {
    let map = match Map::from_toml(&draft.toml.join("\n"), "guessed map") {
        Ok(map) => map,
        Err(error) => {
            return Ok((vec![("map", error.to_string())], usize::MAX, Vec::new()));
        }
    };
    let table = recording.table(&map)?;
    let own = survey(&table, &table.map, None).map_err(io::Error::other)?;
    let all: Vec<&Finding> = table.findings.iter().chain(&own.findings).collect();
    let suspect = all
        .iter()
        .filter(|f| f.severity == Severity::Warning && f.kind == "kinematics")
        .count();
    let serious: Vec<(&'static str, String)> = all
        .iter()
        .filter(|f| f.severity == Severity::Fault)
        .map(|f| (f.kind, f.message.clone()))
        .collect();
    let bad = 100 * serious.len() + suspect;
    let dead = all.iter().filter(|f| f.kind == "dead_channel");
    let dead = dead.map(|f| f.subject().to_owned()).collect();
    Ok((serious, bad, dead))
}

//! A bag of ROS 2 as its recorder left it: the parts and counts of its `metadata.yaml`, held against what is there.

use std::collections::{BTreeMap, HashMap};
use std::io::{self, Read};
use std::path::Path;

use hydroline_rigs::bounded;

mod numbering;

use super::contents::is_topic;
use super::packed_file::unpacked_name;
use super::yaml::Yaml;
use crate::check::Finding;
use numbering::numbering;

/// Name of a bag's account of itself.
const METADATA: &str = "metadata.yaml";
/// Longest account that is read: that of a thousand parts takes some 200 kB.
const METADATA_BYTES: u64 = 8 << 20;
/// Parts that are named one by one.
const PARTS_NAMED: usize = 12;

/// A bag's account of itself.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
struct Stated {
    /// Names of its files, as they were recorded, without the ending of those that are packed.
    parts: Vec<String>,
    messages: Option<u64>,
    of_topic: BTreeMap<String, u64>,
    of_part: BTreeMap<String, u64>,
}

/// The last part of a path, without the ending of a packed file.
fn file_name(path: &str) -> &str {
    let name = path.rsplit(['/', '\\']).next().unwrap_or(path);
    unpacked_name(name)
}

impl Stated {
    fn read(text: &str) -> Result<Stated, String> {
        let yaml = Yaml::parse(text)?;
        let own = yaml
            .get("rosbag2_bagfile_information")
            .ok_or("it has no 'rosbag2_bagfile_information'")?;
        let list = |key: &str| own.get(key).map_or(&[][..], Yaml::list).iter();
        let name = |node: &Yaml, key: &str| Some(node.get(key)?.text()?.to_owned());
        let count = |node: &Yaml| node.get("message_count").and_then(Yaml::count);
        let of_topic = list("topics_with_message_count").filter_map(|t| {
            let topic = name(t.get("topic_metadata")?, "name")?;
            Some((topic, count(t)?))
        });
        let of_part = list("files").filter_map(|f| {
            let path = name(f, "path")?;
            Some((file_name(&path).to_owned(), count(f)?))
        });
        let parts = list("relative_file_paths").filter_map(Yaml::text);
        Ok(Stated {
            parts: parts.map(|p| file_name(p).to_owned()).collect(),
            messages: count(own),
            of_topic: of_topic.collect(),
            of_part: of_part.collect(),
        })
    }
}

/// Messages of each topic in one file.
type Counts = HashMap<String, u64>;

/// A file of a bag.
#[derive(Debug)]
struct Part {
    name: String,
    counts: Counts,
}

impl Part {
    fn messages(&self) -> u64 {
        self.counts.values().sum()
    }
}

/// The files that are read, and the account of the bag that they are (or are of); `Err` = why it cannot be read.
#[derive(Debug, Default)]
pub(super) struct Bag {
    stated: Option<Result<Stated, String>>,
    parts: Vec<Part>,
    /// One file was named, not the folder: the others are not asked for.
    single: bool,
}

impl Bag {
    /// The account beside these files.
    ///
    /// # Errors
    /// The system's, but not that there is none.
    pub fn beside(path: &Path) -> io::Result<Bag> {
        let single = !path.is_dir();
        let folder = match single {
            true => path.parent().unwrap_or(Path::new("")),
            false => path,
        };
        let account = folder.join(METADATA);
        let file = match bounded::open(&account) {
            Ok(file) => file,
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Bag::default()),
            // A file that is read by itself needs no other.
            Err(_) if single => return Ok(Bag::default()),
            Err(error) => {
                let words = format!("{}: {error}", account.display());
                return Err(io::Error::new(error.kind(), words));
            }
        };
        let mut bytes = Vec::new();
        let read = file.take(METADATA_BYTES).read_to_end(&mut bytes);
        let text = read
            .map_err(|e| e.to_string())
            .map(|_| String::from_utf8_lossy(&bytes).into_owned());
        let stated = text.and_then(|text| Stated::read(&text));
        let own = path.file_name().and_then(|n| n.to_str()).map(file_name);
        let names_it = |s: &Stated| s.parts.iter().any(|p| Some(p.as_str()) == own);
        // What lies beside a file says something of it only if it names it.
        if single && !stated.as_ref().is_ok_and(names_it) {
            return Ok(Bag::default());
        }
        Ok(Bag {
            stated: Some(stated),
            parts: Vec::new(),
            single,
        })
    }

    fn account(&self) -> Option<&Stated> {
        self.stated.as_ref()?.as_ref().ok()
    }

    /// Names of the parts that should be there, as words; `None` = nothing says so.
    pub fn named(&self) -> Option<String> {
        let parts = &self.account()?.parts;
        (!parts.is_empty()).then(|| listed(parts.iter().map(String::as_str)))
    }

    /// Place of a file in the order in which the parts were recorded, if it is one.
    pub fn place_of(&self, path: &Path) -> Option<usize> {
        let name = path.file_name()?.to_str().map(file_name)?;
        self.account()?.parts.iter().position(|p| p == name)
    }

    /// Takes down what was counted in a file.
    pub fn add(&mut self, path: &Path, counts: Counts) {
        let name = path.file_name().and_then(|n| n.to_str()).unwrap_or("");
        self.parts.push(Part {
            name: file_name(name).to_owned(),
            counts,
        });
    }

    /// Contradictions between the account and the files. A loss is a fault if it may be of a topic in `mapped`; `None` = of any.
    pub fn findings(&self, mapped: Option<&[String]>) -> Vec<Finding> {
        match &self.stated {
            None => numbering(&self.parts).into_iter().collect(),
            Some(Err(why)) => {
                let words = format!(
                    "{METADATA} cannot be read ({why}): parts and counts are held against nothing"
                );
                let own = Finding::warning("bag_metadata", None, words);
                [own].into_iter().chain(numbering(&self.parts)).collect()
            }
            Some(Ok(stated)) if self.single => self.of_one(stated),
            Some(Ok(stated)) => self.of_all(stated, mapped),
        }
    }

    /// One part by itself.
    fn of_one(&self, stated: &Stated) -> Vec<Finding> {
        let Some(part) = self.parts.first() else {
            return Vec::new();
        };
        let alone = stated.messages.filter(|_| stated.parts.len() == 1);
        let count = stated.of_part.get(&part.name).copied().or(alone);
        let found = part.messages();
        let Some(count) = count.filter(|c| *c > found) else {
            return Vec::new();
        };
        vec![Finding::fault(
            "missing_messages",
            None,
            format!(
                "{}: {METADATA} counts {count} messages in it, {found} are there: {} are lost (was it copied to its end?); import the rest with --accept-faults",
                part.name,
                count - found
            ),
        )]
    }

    fn found_of(&self, topic: &str) -> u64 {
        let counts = self.parts.iter().filter_map(|p| p.counts.get(topic));
        counts.sum()
    }

    /// Messages that are missing of the mapped topics, by their own counts where the account has those; else of all together.
    fn missing(&self, stated: &Stated, mapped: Option<&[String]>) -> Option<u64> {
        let short = |topic: &str, count: u64| count.saturating_sub(self.found_of(topic));
        let own = mapped.and_then(|mapped| {
            let counts = mapped.iter().map(|m| {
                // Of transforms each child is a topic of its own here.
                let mut topics = stated.of_topic.iter().filter(|(t, _)| is_topic(m, t));
                topics.next().map(|(t, count)| short(t, *count))
            });
            counts.sum::<Option<u64>>()
        });
        let found: u64 = self.parts.iter().map(Part::messages).sum();
        let by_topic: u64 = stated.of_topic.iter().map(|(t, c)| short(t, *c)).sum();
        match (own, stated.messages) {
            (Some(own), _) => Some(own),
            (None, Some(count)) => Some(count.saturating_sub(found).max(by_topic)),
            (None, None) => (!stated.of_topic.is_empty()).then_some(by_topic),
        }
    }

    fn of_all(&self, stated: &Stated, mapped: Option<&[String]>) -> Vec<Finding> {
        let is_there = |name: &str| self.parts.iter().any(|p| p.name == name);
        let gone: Vec<&str> = stated.parts.iter().map(String::as_str).collect();
        let gone: Vec<&str> = gone.into_iter().filter(|p| !is_there(p)).collect();
        let is_named = |part: &&Part| stated.parts.contains(&part.name);
        let extra = self.parts.iter().filter(|p| !is_named(p));
        let extra: Vec<&str> = extra.map(|p| p.name.as_str()).collect();
        let found: u64 = self.parts.iter().map(Part::messages).sum();
        let missing = self.missing(stated, mapped);
        let mut findings = Vec::new();
        if !gone.is_empty() {
            let of = format!(
                "{} of {} part(s) that {METADATA} names are not in the folder: {}",
                gone.len(),
                stated.parts.len(),
                listed(gone.iter().copied())
            );
            findings.push(match missing {
                Some(0) if mapped.is_none() || !extra.is_empty() => Finding::warning(
                    "renamed_parts",
                    None,
                    format!(
                        "{of}; all messages that it counts are there, so they have other names"
                    ),
                ),
                Some(0) => Finding::warning(
                    "missing_parts",
                    None,
                    format!("{of}; none of their messages is of a topic that the map names"),
                ),
                lost => {
                    let lost =
                        lost.map_or(String::new(), |n| format!(", and {n} messages with them"));
                    Finding::fault(
                        "missing_parts",
                        None,
                        format!(
                            "{of}{lost}; put them back, or import the rest with --accept-faults"
                        ),
                    )
                }
            });
        } else if let Some(lost) = missing.filter(|n| *n > 0) {
            let short = self.parts.iter().filter_map(|p| {
                let count = stated.of_part.get(&p.name)?;
                (*count > p.messages()).then(|| format!("{}: {} of {count}", p.name, p.messages()))
            });
            let short: Vec<String> = short.take(PARTS_NAMED).collect();
            let where_ = match short.is_empty() {
                true => String::new(),
                false => format!(" ({})", short.join(", ")),
            };
            let count = stated.messages.map_or_else(
                || format!("{METADATA} counts {lost} more messages than are there"),
                |count| format!("{METADATA} counts {count} messages, {found} are there"),
            );
            findings.push(Finding::fault(
                "missing_messages",
                None,
                format!(
                    "{count}{where_}: {lost} are lost (was it copied to its end, or was the recorder killed?); import the rest with --accept-faults"
                ),
            ));
        } else if let Some(count) = stated.messages.filter(|c| *c > found) {
            findings.push(Finding::warning(
                "missing_messages",
                None,
                format!(
                    "{METADATA} counts {count} messages, {found} are there; those that are missing are of topics that the map does not name"
                ),
            ));
        }
        if let Some(count) = stated.messages.filter(|c| *c < found) {
            let named = match extra.is_empty() {
                true => String::new(),
                false => format!(
                    "; it does not name {}: move away what belongs to another recording",
                    listed(extra.iter().copied())
                ),
            };
            findings.push(Finding::warning(
                "bag_metadata",
                None,
                format!("{METADATA} counts {count} messages, {found} are there, and all are read: it is older than the files{named}"),
            ));
        }
        findings
    }
}

/// Names as words, not more than a few.
fn listed<'a>(names: impl ExactSizeIterator<Item = &'a str>) -> String {
    let left = names.len().saturating_sub(PARTS_NAMED);
    let shown: Vec<&str> = names.take(PARTS_NAMED).collect();
    match left {
        0 => shown.join(", "),
        n => format!("{} and {n} more", shown.join(", ")),
    }
}

#[cfg(test)]
mod tests;

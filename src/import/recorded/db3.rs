//! ROS 2 bags in SQLite.

use std::borrow::Cow;
use std::collections::HashMap;
use std::path::Path;

use hydroline_log::{holds_packed_images, image_damage};
use rusqlite::{Connection, ErrorCode, OpenFlags};

use super::message::{Account, Leaves, Message, RecordedError, Sink};
use super::ros::Layout;
use super::stamps;
use pages::Pages;

mod pages;

/// The way on of SQLite's own program.
const RECOVER: &str = "sqlite3 BAG.db3 .recover | sqlite3 NEW.db3";
/// A message by itself, packed by rosbag2, unpacks to at most this.
const UNPACKED_MAX: usize = 64 << 20;
const ZSTD_MAGIC: [u8; 4] = [0x28, 0xb5, 0x2f, 0xfd];

/// Bytes of a message, as they were before rosbag2 packed it by itself.
fn unpacked(data: &[u8]) -> Result<Cow<'_, [u8]>, String> {
    if !data.starts_with(&ZSTD_MAGIC) {
        return Ok(Cow::Borrowed(data));
    }
    // Bounded by what the frame states and by the limit.
    zstd::bulk::decompress(data, UNPACKED_MAX)
        .map(Cow::Owned)
        .map_err(|e| format!("it does not unpack: {e}"))
}

struct Topic {
    name: String,
    schema: String,
    layout: Result<Layout, String>,
}

fn broken(error: &rusqlite::Error) -> RecordedError {
    let next = match error.sqlite_error_code() {
        Some(ErrorCode::DatabaseCorrupt | ErrorCode::NotADatabase) => {
            format!("; what is left of it, `{RECOVER}` may save")
        }
        _ => String::new(),
    };
    RecordedError::Container(format!("not a bag of ROS 2 in SQLite: {error}{next}"))
}

/// Topics with their definitions: the bag's own, or those that are known here.
fn topics(bag: &Connection) -> rusqlite::Result<HashMap<i64, Topic>> {
    let mut own: HashMap<String, (String, String)> = HashMap::new();
    // Bags of before 2023 have no such table.
    if let Ok(mut statement) = bag
        .prepare("SELECT topic_type, encoding, encoded_message_definition FROM message_definitions")
    {
        let rows =
            statement.query_map([], |r| Ok((r.get::<_, String>(0)?, (r.get(1)?, r.get(2)?))))?;
        own.extend(rows.flatten());
    }
    let mut statement = bag.prepare("SELECT id, name, type, serialization_format FROM topics")?;
    let rows = statement.query_map([], |r| {
        let (id, name, schema, format): (i64, String, String, String) =
            (r.get(0)?, r.get(1)?, r.get(2)?, r.get(3)?);
        Ok((id, name, schema, format))
    })?;
    let mut topics = HashMap::new();
    for row in rows {
        let (id, name, schema, format) = row?;
        let stated = own
            .get(&schema)
            .filter(|d| d.0 == "ros2msg" && !d.1.trim().is_empty())
            .map(|d| d.1.as_str());
        let text = stated.ok_or_else(|| {
            format!("the bag does not define '{schema}', and it is none of the usual messages; write the bag as MCAP (`ros2 bag convert`), which does")
        });
        let layout = match format.as_str() {
            "cdr" => Ok(Layout::of(&schema, text)),
            other => Err(format!("messages in '{other}' are not read: cdr is")),
        };
        let topic = Topic {
            name,
            schema,
            layout,
        };
        topics.insert(id, topic);
    }
    Ok(topics)
}

/// Opens a bag and reads its topics. SQLite refuses a file that is shorter than its head says, unless it may write the schema, which a
/// connection that only reads cannot; `true` = it took that.
fn open(path: &Path) -> rusqlite::Result<(Connection, HashMap<i64, Topic>, bool)> {
    let flags = OpenFlags::SQLITE_OPEN_READ_ONLY | OpenFlags::SQLITE_OPEN_NO_MUTEX;
    let with = |lenient: &str| {
        let bag = Connection::open_with_flags(path, flags)?;
        // Views and triggers of a file from elsewhere run no functions, and cells are checked.
        bag.execute_batch(&format!("{lenient}PRAGMA trusted_schema = OFF; PRAGMA cell_size_check = ON; PRAGMA mmap_size = 0; PRAGMA cache_size = -16000;"))?;
        let topics = topics(&bag)?;
        Ok::<_, rusqlite::Error>((bag, topics))
    };
    match with("") {
        Err(error) if error.sqlite_error_code() == Some(ErrorCode::DatabaseCorrupt) => {
            let (bag, topics) = with("PRAGMA writable_schema = ON; ").map_err(|_| error)?;
            Ok((bag, topics, true))
        }
        other => other.map(|(bag, topics)| (bag, topics, false)),
    }
}

/// Rows on their way to a sink.
struct Rows<'a> {
    topics: HashMap<i64, Topic>,
    account: Account,
    leaves: Leaves,
    sink: &'a mut dyn Sink,
}

impl Rows<'_> {
    fn damaged(&mut self, row: u64, reason: impl FnOnce() -> String) {
        self.account.note(super::DAMAGED, row, reason);
    }

    fn row(
        &mut self,
        id: u64,
        topic: Option<i64>,
        log_ns: Option<i64>,
        data: Option<&[u8]>,
    ) -> Result<(), RecordedError> {
        let topic = topic.and_then(|id| self.topics.get(&id));
        let (Some(topic), Some(log_ns)) = (topic, log_ns) else {
            self.damaged(id, || {
                format!("row {id} names no topic of the bag, or has no time")
            });
            return Ok(());
        };
        let log_ns = Some(i128::from(log_ns));
        self.account.count(&topic.name);
        let Some(data) = data else {
            self.damaged(id, || format!("row {id} holds no bytes"));
            return Ok(());
        };
        let checks = self.sink.checks_images() && holds_packed_images(&topic.schema, "cdr");
        let wants = self.sink.wants(&topic.name, &topic.schema, data.len());
        let data = match checks || wants {
            true => unpacked(data),
            false => Ok(Cow::Borrowed(data)),
        };
        if checks
            && let Ok(data) = &data
            && let Some(damage) = image_damage(&topic.schema, "cdr", data)
        {
            let what = format!("images of {}", topic.name);
            self.account.note(&what, id, || damage.to_string());
        }
        self.leaves.clear();
        let decoded = data.and_then(|data| match &topic.layout {
            _ if !wants => Ok(()),
            Ok(layout) => layout.decode(&data, &mut self.leaves),
            Err(why) => Err(why.clone()),
        });
        let is_lost = decoded.is_err();
        if let Err(reason) = decoded {
            self.account.undecoded(&topic.name, id, || reason);
        }
        if is_lost || !wants {
            self.sink.other(&topic.name, &topic.schema, log_ns);
            return Ok(());
        }
        let message = Message {
            topic: &topic.name,
            schema: &topic.schema,
            log_ns,
            stamp_ns: stamps::of(&self.leaves, ""),
            leaves: &self.leaves,
            unit: &|_| None,
        };
        Ok(stamps::divided(&message, self.sink)?)
    }

    /// Rows behind `last` in pages that SQLite does not reach, and how many there are.
    fn beyond(&mut self, path: &Path, last: i64) -> Result<u64, RecordedError> {
        let Some(mut pages) = Pages::open(path)? else {
            return Ok(0);
        };
        let mut found = 0;
        for place in pages.rows(last)? {
            // A topic that the bag does not have is another table's number.
            let row = pages
                .row(&place)?
                .filter(|r| self.topics.contains_key(&r.topic));
            if let Some(row) = row {
                found += 1;
                let id = u64::try_from(place.row).unwrap_or(0);
                self.row(id, Some(row.topic), Some(row.log_ns), Some(&row.data))?;
            }
        }
        Ok(found)
    }
}

pub(super) fn read(path: &Path, sink: &mut dyn Sink) -> Result<Account, RecordedError> {
    let (bag, topics, cut) = open(path).map_err(|e| broken(&e))?;
    let mut rows = Rows {
        topics,
        account: Account::default(),
        leaves: Leaves::default(),
        sink,
    };
    let mut statement = bag
        .prepare("SELECT rowid, topic_id, timestamp, data FROM messages NOT INDEXED")
        .map_err(|e| broken(&e))?;
    let mut own = statement.query([]).map_err(|e| broken(&e))?;
    let mut last: Option<i64> = None;
    let stopped = loop {
        match own.next() {
            Ok(Some(row)) => {
                let id: i64 = row.get(0).unwrap_or(0);
                // Of a page of which only the beginning is there SQLite reads the rest as zeros: rows without a number.
                if last.is_some_and(|l| id <= l) {
                    break Some("the numbers of its rows do not ascend".to_owned());
                }
                last = Some(id);
                let data = row.get_ref(3).ok().and_then(|v| v.as_blob().ok());
                let (topic, log_ns) = (row.get(1).ok(), row.get(2).ok());
                rows.row(u64::try_from(id).unwrap_or(0), topic, log_ns, data)?;
            }
            Ok(None) => break None,
            Err(error) => break Some(error.to_string()),
        }
    };
    if stopped.is_none() && !cut {
        return Ok(rows.account);
    }
    // SQLite goes no further than a damaged page.
    let before = last.map_or(0, |l| u64::try_from(l).unwrap_or(0));
    let beyond = match stopped {
        Some(_) => rows.beyond(path, last.unwrap_or(i64::MIN))?,
        None => 0,
    };
    let why = stopped.unwrap_or_else(|| "the file is shorter than its head says".to_owned());
    if last.is_none() && beyond == 0 {
        return Err(RecordedError::Container(format!(
            "no message of this bag of ROS 2 in SQLite can be read ({why}); what is left of it, `{RECOVER}` may save"
        )));
    }
    rows.damaged(before, || {
        format!(
            "after row {before}: {why}; {beyond} rows behind it were found in pages that are whole; `{RECOVER}` may save more"
        )
    });
    Ok(rows.account)
}

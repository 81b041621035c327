//! ROS 2 bags in SQLite.

use std::collections::HashMap;
use std::path::Path;

use hydroline_log::image_damage;
use rusqlite::{Connection, OpenFlags};

use super::message::{Account, Leaves, Message, RecordedError, Sink};
use super::ros::{self, cdr, definition::Definition};
use super::stamps;

/// A message by itself, packed by rosbag2, unpacks to at most this.
const UNPACKED_MAX: usize = 64 << 20;
const ZSTD_MAGIC: [u8; 4] = [0x28, 0xb5, 0x2f, 0xfd];

struct Topic {
    name: String,
    schema: String,
    definition: Result<Definition, String>,
}

fn broken(error: &rusqlite::Error) -> RecordedError {
    RecordedError::Container(format!("not a bag of ROS 2 in SQLite: {error}"))
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
            .map(|d| Definition::parse(&schema, &d.1));
        let definition = if format != "cdr" {
            Err(format!("messages in '{format}' are not read: cdr is"))
        } else {
            stated.unwrap_or_else(|| {
                ros::known(&schema).ok_or_else(|| {
                    format!("the bag does not define '{schema}', and it is none of the usual messages; write the bag as MCAP (`ros2 bag convert`), which does")
                })
            })
        };
        let topic = Topic {
            name,
            schema,
            definition,
        };
        topics.insert(id, topic);
    }
    Ok(topics)
}

pub(super) fn read(path: &Path, sink: &mut dyn Sink) -> Result<Account, RecordedError> {
    let flags = OpenFlags::SQLITE_OPEN_READ_ONLY | OpenFlags::SQLITE_OPEN_NO_MUTEX;
    let bag = Connection::open_with_flags(path, flags).map_err(|e| broken(&e))?;
    // Views and triggers of a file from elsewhere run no functions, and cells are checked.
    bag.execute_batch("PRAGMA trusted_schema = OFF; PRAGMA cell_size_check = ON; PRAGMA mmap_size = 0; PRAGMA cache_size = -16000;")
        .map_err(|e| broken(&e))?;
    let topics = topics(&bag).map_err(|e| broken(&e))?;
    let mut account = Account::default();
    let mut leaves = Leaves::default();
    let mut statement = bag
        .prepare("SELECT rowid, topic_id, timestamp, data FROM messages NOT INDEXED")
        .map_err(|e| broken(&e))?;
    let mut rows = statement.query([]).map_err(|e| broken(&e))?;
    let mut last = 0;
    loop {
        let row = match rows.next() {
            Ok(Some(row)) => row,
            Ok(None) => break,
            Err(error) => {
                // SQLite goes no further than a damaged page.
                account.note("damaged records", last, || {
                    format!("after row {last}: {error}; what follows is lost")
                });
                break;
            }
        };
        let id: i64 = row.get(0).unwrap_or(0);
        last = u64::try_from(id).unwrap_or(0);
        let topic = row.get::<_, i64>(1).ok().and_then(|id| topics.get(&id));
        let (Some(topic), Ok(log_ns)) = (topic, row.get::<_, i64>(2)) else {
            account.note("damaged records", last, || {
                format!("row {last} names no topic of the bag, or has no time")
            });
            continue;
        };
        let log_ns = Some(i128::from(log_ns));
        let data = row.get_ref(3).ok().and_then(|v| v.as_blob().ok());
        let Some(data) = data else {
            account.note("damaged records", last, || {
                format!("row {last} holds no bytes")
            });
            continue;
        };
        if sink.checks_images()
            && let Some(damage) = image_damage(&topic.schema, "cdr", data)
        {
            let what = format!("images of {}", topic.name);
            account.note(&what, last, || damage.to_string());
        }
        if !sink.wants(&topic.name, &topic.schema, data.len()) {
            sink.other(&topic.name, &topic.schema, log_ns);
            continue;
        }
        leaves.clear();
        let decoded = match &topic.definition {
            Ok(definition) if data.starts_with(&ZSTD_MAGIC) => {
                // Bounded by what the frame states and by the limit.
                zstd::bulk::decompress(data, UNPACKED_MAX)
                    .map_err(|e| format!("it does not unpack: {e}"))
                    .and_then(|data| cdr::decode(definition, &data, &mut leaves))
            }
            Ok(definition) => cdr::decode(definition, data, &mut leaves),
            Err(why) => Err(why.clone()),
        };
        if let Err(reason) = decoded {
            account.note(&format!("messages of {}", topic.name), last, || reason);
            sink.other(&topic.name, &topic.schema, log_ns);
            continue;
        }
        let message = Message {
            topic: &topic.name,
            schema: &topic.schema,
            log_ns,
            stamp_ns: stamps::of(&leaves, ""),
            leaves: &leaves,
            unit: &|_| None,
        };
        stamps::divided(&message, sink)?;
    }
    Ok(account)
}

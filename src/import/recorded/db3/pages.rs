//! Rows of a bag's messages, page by page, where the tree over its pages is broken: SQLite's own way ends at the first page that is
//! gone (https://www.sqlite.org/fileformat2.html, sections 1.3, 1.6 and 2.1).

use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::path::Path;

/// Kind of a page that holds rows.
const LEAF: u8 = 0x0d;
/// Bytes of such a page before the places of its cells.
const LEAF_HEAD_BYTES: usize = 8;
/// Longest row: a message is an image at most.
const ROW_BYTES_MAX: u64 = 64 << 20;
/// Columns of `messages`: id, topic_id, timestamp, data.
const COLUMNS: usize = 4;

pub(super) struct Pages {
    file: File,
    page_bytes: u64,
    /// Without what is reserved at each page's end.
    usable_bytes: u64,
    count: u64,
    /// The page that was read last: the rows of one follow each other.
    last: Option<(u64, Vec<u8>)>,
    /// Bytes that rows may still hold together: they share no pages, whatever a damaged one says.
    left_bytes: u64,
}

/// A row's number, and where it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Place {
    pub row: i64,
    page: u64,
    at: usize,
}

/// A row of `messages`.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Row {
    pub topic: i64,
    pub log_ns: i64,
    pub data: Vec<u8>,
}

/// A whole number of one to nine bytes, the first the highest, and how many they are.
fn varint(bytes: &[u8]) -> Option<(u64, usize)> {
    let mut value = 0;
    for (n, byte) in bytes.iter().take(9).enumerate() {
        if n == 8 {
            return Some(((value << 8) | u64::from(*byte), 9));
        }
        value = (value << 7) | u64::from(byte & 0x7f);
        if byte & 0x80 == 0 {
            return Some((value, n + 1));
        }
    }
    None
}

/// A row's cell: bytes of its content, its number, and where the content begins in the page.
fn cell(page: &[u8], at: usize) -> Option<(u64, i64, usize)> {
    let (bytes, one) = varint(page.get(at..)?)?;
    let (row, two) = varint(page.get(at + one..)?)?;
    Some((bytes, row as i64, at + one + two))
}

/// Types of the columns and where their values begin, if they are those of a message.
fn columns(content: &[u8]) -> Option<([u64; COLUMNS], usize)> {
    let (head_bytes, mut at) = varint(content)?;
    let mut types = [0; COLUMNS];
    for kind in &mut types {
        let (value, bytes) = varint(content.get(at..)?)?;
        (*kind, at) = (value, at + bytes);
    }
    let is_whole = |kind: u64| matches!(kind, 1..=6 | 8 | 9);
    let is_blob = |kind: u64| kind >= 12 && kind.is_multiple_of(2);
    // The row's number stands in place of the first.
    let fits = types[0] == 0 && is_whole(types[1]) && is_whole(types[2]) && is_blob(types[3]);
    (fits && head_bytes == at as u64).then_some((types, at))
}

/// A whole number of a type, and its bytes.
fn whole(content: &[u8], kind: u64) -> Option<(i64, usize)> {
    let bytes = match kind {
        8 => return Some((0, 0)),
        9 => return Some((1, 0)),
        5 => 6,
        6 => 8,
        1..=4 => kind as usize,
        _ => return None,
    };
    let own = content.get(..bytes)?;
    let sign = if own[0] & 0x80 == 0 { 0 } else { -1 };
    let value = own.iter().fold(sign, |v: i64, b| (v << 8) | i64::from(*b));
    Some((value, bytes))
}

impl Pages {
    /// Opens a file; `None` = its head states no size of pages.
    pub fn open(path: &Path) -> io::Result<Option<Pages>> {
        let mut file = File::open(path)?;
        let mut head = [0; 100];
        if file.read_exact(&mut head).is_err() {
            return Ok(None);
        }
        let page_bytes = match u64::from(u16::from_be_bytes([head[16], head[17]])) {
            1 => 65536,
            bytes => bytes,
        };
        let usable_bytes = page_bytes.saturating_sub(u64::from(head[20]));
        // As SQLite itself has it.
        if !page_bytes.is_power_of_two() || page_bytes < 512 || usable_bytes < 480 {
            return Ok(None);
        }
        let file_bytes = file.metadata()?.len();
        Ok(Some(Pages {
            file,
            page_bytes,
            usable_bytes,
            count: file_bytes / page_bytes,
            last: None,
            left_bytes: file_bytes,
        }))
    }

    fn page(&mut self, number: u64) -> io::Result<Vec<u8>> {
        let mut page = vec![0; self.page_bytes as usize];
        let at = (number - 1) * self.page_bytes;
        self.file.seek(SeekFrom::Start(at))?;
        self.file.read_exact(&mut page)?;
        Ok(page)
    }

    /// Bytes of a row's content that stand in its own page.
    fn local_bytes(&self, bytes: u64) -> u64 {
        let usable = self.usable_bytes;
        let most = usable - 35;
        if bytes <= most {
            return bytes;
        }
        let least = (usable - 12) * 32 / 255 - 23;
        let own = least + (bytes - least) % (usable - 4);
        if own <= most { own } else { least }
    }

    /// Rows behind number `after` that look like messages, in their order.
    pub fn rows(&mut self, after: i64) -> io::Result<Vec<Place>> {
        let mut rows = Vec::new();
        // The first page holds the schema.
        for number in 2..=self.count {
            let page = self.page(number)?;
            if page[0] != LEAF {
                continue;
            }
            let cells = usize::from(u16::from_be_bytes([page[3], page[4]]));
            for pointer in page[LEAF_HEAD_BYTES..].chunks_exact(2).take(cells) {
                let at = usize::from(u16::from_be_bytes([pointer[0], pointer[1]]));
                let Some((_, row, begin)) = cell(&page, at).filter(|c| c.1 > after) else {
                    continue;
                };
                if page.get(begin..).and_then(columns).is_some() {
                    let page = number;
                    rows.push(Place { row, page, at });
                }
            }
        }
        rows.sort_unstable();
        rows.dedup_by_key(|p| p.row);
        Ok(rows)
    }

    /// A row; `None` = part of it is in pages that are not there.
    pub fn row(&mut self, place: &Place) -> io::Result<Option<Row>> {
        let page = match self.last.take() {
            Some((number, page)) if number == place.page => page,
            _ => self.page(place.page)?,
        };
        let content = self.content(&page, place.at);
        self.last = Some((place.page, page));
        Ok(content?.as_deref().and_then(message))
    }

    /// A cell's content, with what stands in other pages.
    fn content(&mut self, page: &[u8], at: usize) -> io::Result<Option<Vec<u8>>> {
        let Some((bytes, _, begin)) = cell(page, at).filter(|c| c.0 <= ROW_BYTES_MAX) else {
            return Ok(None);
        };
        let Some(left) = self.left_bytes.checked_sub(bytes) else {
            return Ok(None);
        };
        self.left_bytes = left;
        let local = self.local_bytes(bytes) as usize;
        let Some(own) = page.get(begin..begin + local) else {
            return Ok(None);
        };
        let mut content = own.to_vec();
        let mut next = page.get(begin + local..begin + local + 4).map(page_number);
        while (content.len() as u64) < bytes {
            let Some(number) = next.filter(|n| (2..=self.count).contains(n)) else {
                return Ok(None);
            };
            let page = self.page(number)?;
            next = page.get(..4).map(page_number);
            let rest = (bytes - content.len() as u64).min(self.usable_bytes - 4) as usize;
            content.extend(&page[4..4 + rest]);
        }
        Ok(Some(content))
    }
}

fn page_number(bytes: &[u8]) -> u64 {
    bytes.iter().fold(0, |v, b| (v << 8) | u64::from(*b))
}

fn message(content: &[u8]) -> Option<Row> {
    let (types, at) = columns(content)?;
    let (topic, one) = whole(content.get(at..)?, types[1])?;
    let (log_ns, two) = whole(content.get(at + one..)?, types[2])?;
    let begin = at + one + two;
    let bytes = usize::try_from((types[3] - 12) / 2).ok()?;
    let data = content.get(begin..begin.checked_add(bytes)?)?.to_vec();
    Some(Row {
        topic,
        log_ns,
        data,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use rusqlite::Connection;

    #[test]
    fn every_row_is_found_without_the_tree_as_sqlite_finds_it() {
        for page_bytes in [512, 4096] {
            let dir = tempfile::tempdir().unwrap();
            let path = dir.path().join("a.db3");
            let bag = Connection::open(&path).unwrap();
            bag.execute_batch(&format!("PRAGMA page_size = {page_bytes}; CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL); CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, timestamp INTEGER NOT NULL, data BLOB NOT NULL); CREATE INDEX timestamp_idx ON messages(timestamp ASC); BEGIN"))
                .unwrap();
            let mut expected = Vec::new();
            for k in 0..900_usize {
                let row = Row {
                    topic: [0, 1, -3, 300][k % 4],
                    log_ns: 1_760_000_000_000_000_000 + 40_000_000 * k as i64,
                    data: (0..k * k % 5000).map(|n| n as u8).collect(),
                };
                bag.execute(
                    "INSERT INTO messages(topic_id, timestamp, data) VALUES(?, ?, ?)",
                    (row.topic, row.log_ns, &row.data),
                )
                .unwrap();
                expected.push(row);
            }
            bag.execute_batch("COMMIT").unwrap();
            drop(bag);
            let mut pages = Pages::open(&path).unwrap().unwrap();
            let places = pages.rows(100).unwrap();
            assert_eq!(places.len(), 800);
            for (place, expected) in places.iter().zip(&expected[100..]) {
                assert_eq!(pages.row(place).unwrap().as_ref(), Some(expected));
            }
        }
    }

    #[test]
    fn bytes_that_are_no_pages_hold_no_rows() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.db3");
        for bytes in [vec![0; 50], vec![0; 5000], vec![0x0d; 9000]] {
            std::fs::write(&path, bytes).unwrap();
            if let Some(mut pages) = Pages::open(&path).unwrap() {
                for place in pages.rows(i64::MIN).unwrap() {
                    pages.row(&place).unwrap();
                }
            }
        }
    }
}

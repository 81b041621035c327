//! Bytes of a file with a view ahead: records are looked at before they are taken.

use std::fs::File;
use std::io::{self, Read};
use std::path::Path;

use hydroline_rigs::bounded;

use super::DAMAGED;
use super::message::{Account, RecordedError};

const READ_BYTES: usize = 1 << 18;

pub(super) struct Window<R> {
    source: R,
    bytes: Vec<u8>,
    at: usize,
    /// Of `bytes[at]` in the file.
    pub offset: u64,
    ended: bool,
}

impl<R: Read> Window<R> {
    pub fn new(source: R) -> Self {
        Window {
            source,
            bytes: Vec::new(),
            at: 0,
            offset: 0,
            ended: false,
        }
    }

    /// The next bytes, so many or as many as there are.
    pub fn ahead(&mut self, count: usize) -> io::Result<&[u8]> {
        while self.bytes.len() - self.at < count && !self.ended {
            self.bytes.drain(..self.at);
            self.at = 0;
            let had = self.bytes.len();
            let more = READ_BYTES.max(count) as u64;
            let read = self
                .source
                .by_ref()
                .take(more)
                .read_to_end(&mut self.bytes)?;
            self.ended = read == 0 || self.bytes.len() - had < more as usize;
        }
        let end = self.bytes.len().min(self.at.saturating_add(count));
        Ok(&self.bytes[self.at..end])
    }

    pub fn skip(&mut self, count: usize) {
        let there = count.min(self.bytes.len() - self.at);
        self.at += there;
        self.offset += there as u64;
    }
}

/// Why no record begins at a byte.
pub(super) type Damage = fn(u64) -> String;

/// The usual one.
pub(super) const NO_RECORD: Damage = |at| format!("at byte {at} begins no record");

/// Goes through a file record by record. `take` looks at what stands ahead and says how many bytes it was; where no record
/// begins, the next byte is tried, and each such place is noted once. Its last argument: whether the byte before began none.
pub(super) fn each_record(
    path: &Path,
    mut take: impl FnMut(
        &mut Window<File>,
        &mut Account,
        bool,
    ) -> Result<Result<usize, Damage>, RecordedError>,
) -> Result<Account, RecordedError> {
    let mut window = Window::new(bounded::open(path)?);
    let mut account = Account::default();
    let mut broken = false;
    while !window.ahead(1)?.is_empty() {
        let at = window.offset;
        match take(&mut window, &mut account, broken)? {
            Ok(bytes) => {
                broken = false;
                window.skip(bytes);
            }
            Err(damage) => {
                if !broken {
                    account.note(DAMAGED, at, || damage(at));
                }
                broken = true;
                account.skipped_bytes += 1;
                window.skip(1);
            }
        }
    }
    Ok(account)
}

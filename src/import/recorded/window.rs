//! Bytes of a file with a view ahead: records are looked at before they are taken.

use std::io::{self, Read};

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

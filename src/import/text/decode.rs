//! Bytes of any encoding as UTF-8, a piece at a time.

use std::io::{self, Read};

use crate::map::Encoding;

/// What Windows puts in the place of ISO 8859-1's control characters 0x80 .. 0x9F (code page 1252).
const WINDOWS: [char; 32] = [
    '€', '\u{81}', '‚', 'ƒ', '„', '…', '†', '‡', 'ˆ', '‰', 'Š', '‹', 'Œ', '\u{8d}', 'Ž', '\u{8f}',
    '\u{90}', '‘', '’', '“', '”', '•', '–', '—', '˜', '™', 'š', '›', 'œ', '\u{9d}', 'ž', 'Ÿ',
];

/// A reader of UTF-8 over one of any encoding.
pub(crate) struct Decoder<R> {
    source: R,
    encoding: Encoding,
    /// Decoded and not yet taken.
    ready: Vec<u8>,
    taken: usize,
    /// Bytes of a character that is not complete yet.
    pending: Vec<u8>,
}

impl<R: Read> Decoder<R> {
    pub fn new(source: R, encoding: Encoding) -> Self {
        Decoder {
            source,
            encoding,
            ready: Vec::new(),
            taken: 0,
            pending: Vec::new(),
        }
    }

    /// Decodes the next piece; nothing is ready at the end.
    fn refill(&mut self) -> io::Result<()> {
        self.ready.clear();
        self.taken = 0;
        let mut piece = [0; 1 << 13];
        while self.ready.is_empty() {
            let read = self.source.read(&mut piece)?;
            self.pending.extend(&piece[..read]);
            if read == 0 {
                // Half a character at the end.
                if !self.pending.is_empty() {
                    self.pending.clear();
                    self.push('\u{fffd}');
                }
                return Ok(());
            }
            self.decode();
        }
        Ok(())
    }

    fn push(&mut self, c: char) {
        self.ready
            .extend_from_slice(c.encode_utf8(&mut [0; 4]).as_bytes());
    }

    fn decode(&mut self) {
        let bytes = std::mem::take(&mut self.pending);
        if matches!(self.encoding, Encoding::Latin1 | Encoding::Utf8) {
            for &b in &bytes {
                self.push(match b {
                    0x80..=0x9F => WINDOWS[usize::from(b - 0x80)],
                    _ => char::from(b),
                });
            }
            return;
        }
        let mut units: Vec<u16> = bytes
            .chunks_exact(2)
            .map(|b| {
                if self.encoding == Encoding::Utf16Le {
                    u16::from_le_bytes([b[0], b[1]])
                } else {
                    u16::from_be_bytes([b[0], b[1]])
                }
            })
            .collect();
        let mut used = 2 * units.len();
        // The first half of a pair waits for the second.
        if units.last().is_some_and(|u| (0xD800..0xDC00).contains(u)) {
            units.pop();
            used -= 2;
        }
        for c in char::decode_utf16(units) {
            self.push(c.unwrap_or('\u{fffd}'));
        }
        self.pending = bytes[used..].to_vec();
    }
}

impl<R: Read> Read for Decoder<R> {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        // Most files: nothing to decode.
        if self.encoding == Encoding::Utf8 {
            return self.source.read(out);
        }
        if self.taken == self.ready.len() {
            self.refill()?;
        }
        let left = &self.ready[self.taken..];
        let count = left.len().min(out.len());
        out[..count].copy_from_slice(&left[..count]);
        self.taken += count;
        Ok(count)
    }
}

//! Bytes of any encoding as UTF-8, a piece at a time.

use std::io::{self, Read};

use encoding_rs::{UTF_16BE, UTF_16LE, WINDOWS_1252};

use crate::map::Encoding;

/// A reader of UTF-8 over one of any encoding.
pub(crate) struct Decoder<R> {
    source: R,
    /// `None` = UTF-8 already, or all is decoded.
    decoder: Option<encoding_rs::Decoder>,
    is_utf8: bool,
    /// Decoded and not yet taken.
    ready: Vec<u8>,
    taken: usize,
}

impl<R: Read> Decoder<R> {
    pub fn new(source: R, encoding: Encoding) -> Self {
        let other = match encoding {
            Encoding::Utf8 => None,
            // With what Windows puts in the place of its control characters 0x80 .. 0x9F.
            Encoding::Latin1 => Some(WINDOWS_1252),
            Encoding::Utf16Le => Some(UTF_16LE),
            Encoding::Utf16Be => Some(UTF_16BE),
        };
        Decoder {
            source,
            decoder: other.map(|e| e.new_decoder_without_bom_handling()),
            is_utf8: other.is_none(),
            ready: Vec::new(),
            taken: 0,
        }
    }

    /// Decodes the next piece; nothing is ready at the end. What is no character becomes U+FFFD.
    fn refill(&mut self) -> io::Result<()> {
        self.ready.clear();
        self.taken = 0;
        let mut piece = [0; 1 << 13];
        while self.ready.is_empty()
            && let Some(decoder) = &mut self.decoder
        {
            let read = self.source.read(&mut piece)?;
            let room = decoder
                .max_utf8_buffer_length(read)
                .unwrap_or(4 * (read + 1));
            self.ready.resize(room, 0);
            let (.., written, _) =
                decoder.decode_to_utf8(&piece[..read], &mut self.ready, read == 0);
            self.ready.truncate(written);
            if read == 0 {
                self.decoder = None;
            }
        }
        Ok(())
    }
}

impl<R: Read> Read for Decoder<R> {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        // Most files: nothing to decode.
        if self.is_utf8 {
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

//! An MCAP file, record by record, with every length and checksum verified before use.
//!
//! The mcap crate's readers hide the offset of a record, stop at the first damage and trust some
//! lengths; `doctor`, `recover` and errors that name the place need the opposite. Lengths are held
//! against what is really there and against [`LIMIT_BYTES`] before anything is allocated, chunks
//! are decompressed into a bounded buffer and their CRC is checked before a record is used. Tests
//! hold this reader against `mcap::io::MessageReader`.

use std::io::{self, BufRead, Read};

use bytes::{Buf, Bytes};
use hydroline_rigs::FRAME_BYTES_MAX;
use mcap::records::op;

mod fields;
mod find;

pub(super) use fields::*;
pub(super) use find::RecordFinder;

/// Longest record that is read into memory, and longest decompressed chunk: the largest frame, what stands around it,
/// and what compressing noise adds (zstd: n / 256).
pub const LIMIT_BYTES: u64 = FRAME_BYTES_MAX + (FRAME_BYTES_MAX >> 6);

/// Bytes that chunks may unpack to for each byte read of the file, beyond [`LIMIT_BYTES`] once, where the log does not
/// say how large its frames are, or a chunk is larger than one of them ([`super::expansion`]).
pub const EXPANSION_MAX: u64 = 4096;

/// Bytes to which one byte of zstd unpacks at most: a block has up to 128 KiB and takes 4 bytes or more (RFC 8878,
/// section 3.1.1.2).
const ZSTD_EXPANSION_MAX: u64 = (128 << 10) / 4;

/// Opcode and length.
pub(super) const PREFIX_BYTES: u64 = 9;

/// Damage in the bytes of a log.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[allow(missing_docs)]
pub enum Damage {
    #[error("the file ends inside a record: {need} bytes needed, {have} there")]
    Cut { need: u64, have: u64 },
    #[error("the file ends without a footer: the recording was not stopped cleanly")]
    NoEnd,
    #[error(
        "only zeros stand where a record should begin: this stretch was wiped, or never written"
    )]
    Zeros,
    #[error("a record (opcode {opcode:#04x}) of {len} bytes is beyond the {LIMIT_BYTES} allowed")]
    TooLong { opcode: u8, len: u64 },
    #[error("a record (opcode {opcode:#04x}) does not hold a whole {field}")]
    Malformed { opcode: u8, field: &'static str },
    #[error("a record (opcode {opcode:#04x}) is {surplus} bytes longer than what it holds")]
    Surplus { opcode: u8, surplus: u64 },
    #[error("a chunk's checksum is {saved:08x}, its content's {calculated:08x}")]
    ChunkCrc { saved: u32, calculated: u32 },
    #[error("compression `{0}` is not known; MCAP has none, lz4 and zstd")]
    Compression(String),
    #[error("a chunk does not decompress: {0}")]
    Decompress(String),
    #[error("a chunk should hold {declared} bytes, it holds {got}")]
    ChunkSize { declared: u64, got: u64 },
    #[error("a message names channel {0}, which is not declared before it")]
    UnknownChannel(u16),
    #[error("channel {topic} names schema {schema}, which is not declared before it")]
    UnknownSchema { topic: String, schema: u16 },
    #[error("{what} {id} is declared twice, differently")]
    Redeclared { what: &'static str, id: u16 },
    #[error("the data section's checksum is {saved:08x}, its content's {calculated:08x}")]
    DataCrc { saved: u32, calculated: u32 },
    #[error("the summary's checksum is {saved:08x}, its content's {calculated:08x}")]
    SummaryCrc { saved: u32, calculated: u32 },
    #[error("the summary counts {stated} messages, the file holds {found}")]
    MessageCount { stated: u64, found: u64 },
    #[error("the summary counts {stated} chunks, the file holds {found}")]
    ChunkCount { stated: u64, found: u64 },
    #[error("the file does not end with the MCAP magic")]
    EndMagic,
    #[error(
        "another log begins behind the end of this one: files were joined end to end; `hydroline recover` writes the messages of both into a new log"
    )]
    JoinedLog,
    #[error("{bytes} bytes stand behind the end of the log; they are no log")]
    AfterEnd { bytes: u64 },
    #[error(
        "a chunk would unpack to {bytes} bytes: with those before it more than {EXPANSION_MAX} times what has been read, and more than the {largest} of the largest chunk by the log's head: no recording shrinks like that"
    )]
    Expansion { bytes: u64, largest: u64 },
    #[error("{0}")]
    Io(String),
}

impl Damage {
    /// The bytes that are there are sound, only the end is missing.
    pub fn is_missing_end(&self) -> bool {
        matches!(self, Damage::Cut { .. } | Damage::NoEnd)
    }
}

impl Damage {
    /// Where the next record begins is no longer certain.
    pub(super) fn loses_the_thread(&self) -> bool {
        matches!(
            self,
            Damage::Cut { .. }
                | Damage::Zeros
                | Damage::TooLong { .. }
                | Damage::ChunkSize { .. }
                | Damage::Surplus { .. }
        )
    }
}

/// A record at the file's top level.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Outer {
    pub offset: u64,
    pub opcode: u8,
    /// Bytes after the length; empty for attachments, which are hashed and skipped.
    pub body: Bytes,
}

/// Walks the top level. After an error about a length there is no next record.
pub(super) struct Records<R> {
    source: R,
    offset: u64,
    hasher: crc32fast::Hasher,
    truncated: Option<ChunkRecord>,
    opcode: u8,
    done: bool,
}

/// Offset of a damaged place, and its damage.
pub(super) type Located = (u64, Damage);

impl<R: BufRead> Records<R> {
    /// Reads the magic.
    ///
    /// # Errors
    /// The first bytes, when they are not MCAP's.
    pub fn new(mut source: R) -> io::Result<Result<Self, Vec<u8>>> {
        let mut magic = Vec::new();
        source
            .by_ref()
            .take(mcap::MAGIC.len() as u64)
            .read_to_end(&mut magic)?;
        if magic != mcap::MAGIC {
            return Ok(Err(magic));
        }
        let mut hasher = crc32fast::Hasher::new();
        hasher.update(&magic);
        Ok(Ok(Self {
            source,
            offset: magic.len() as u64,
            hasher,
            truncated: None,
            opcode: op::HEADER,
            done: false,
        }))
    }

    /// Offset of the next record.
    pub fn offset(&self) -> u64 {
        self.offset
    }

    /// CRC of everything since the start or since [`Records::restart_crc`].
    pub fn crc(&self) -> u32 {
        self.hasher.clone().finalize()
    }

    /// Starts the summary's CRC.
    pub fn restart_crc(&mut self) {
        self.hasher = crc32fast::Hasher::new();
    }

    /// The next record; `None` at the end of the bytes, which is only right after a footer.
    /// DataEnd and Footer are not hashed here: their CRC covers what is before them.
    pub fn next(&mut self) -> Option<Result<Outer, Located>> {
        if self.done {
            return None;
        }
        let result = self.read_one();
        match &result {
            Ok(None) | Err(_) => self.done = true,
            Ok(Some(_)) => {}
        }
        result.map_err(|damage| (self.offset, damage)).transpose()
    }

    fn read_one(&mut self) -> Result<Option<Outer>, Damage> {
        let mut prefix = [0; PREFIX_BYTES as usize];
        let have = self.fill(&mut prefix)?;
        if have == 0 {
            return Ok(None);
        }
        let opcode = prefix[0];
        self.opcode = opcode;
        if have < PREFIX_BYTES {
            return Err(Damage::Cut {
                need: PREFIX_BYTES,
                have,
            });
        }
        // No record of MCAP has this opcode; taken for records without content, zeros would be walked through in steps of nine.
        if opcode == 0 {
            return Err(Damage::Zeros);
        }
        let len = (&prefix[1..]).get_u64_le();
        let hashed = opcode != op::DATA_END && opcode != op::FOOTER;
        if hashed {
            self.hasher.update(&prefix);
        }
        let body = if opcode == op::ATTACHMENT {
            self.skip(len)?;
            Bytes::new()
        } else {
            if len > LIMIT_BYTES {
                return Err(Damage::TooLong { opcode, len });
            }
            let mut body = Vec::new();
            // `take` grows with what is really there, not with what the length claims.
            self.source
                .by_ref()
                .take(len)
                .read_to_end(&mut body)
                .map_err(io_damage)?;
            let have = body.len() as u64;
            if have < len {
                if opcode == op::CHUNK {
                    self.truncated = chunk(&Bytes::from(std::mem::take(&mut body)), true).ok();
                }
                return Err(Damage::Cut { need: len, have });
            }
            if hashed {
                self.hasher.update(&body);
            }
            Bytes::from(body)
        };
        let offset = self.offset;
        self.offset = offset.saturating_add(PREFIX_BYTES).saturating_add(len);
        Ok(Some(Outer {
            offset,
            opcode,
            body,
        }))
    }

    /// Opcode of the record read last, or of the one in which the file ends.
    pub fn opcode(&self) -> u8 {
        self.opcode
    }

    /// Takes the readable part of the chunk in which the file ends.
    pub fn take_truncated(&mut self) -> Option<ChunkRecord> {
        self.truncated.take()
    }

    /// The summary's CRC: it covers the footer up to the CRC itself.
    pub fn crc_with_footer(&self, body: &Bytes) -> u32 {
        let mut hasher = self.hasher.clone();
        hasher.update(&[op::FOOTER]);
        hasher.update(&(body.len() as u64).to_le_bytes());
        hasher.update(body.get(..16).unwrap_or_default());
        hasher.finalize()
    }

    /// The magic after the footer.
    pub fn end_magic(&mut self) -> Result<(), Located> {
        let mut magic = [0; 8];
        match self.fill(&mut magic) {
            Ok(8) if magic == mcap::MAGIC => {
                self.offset += magic.len() as u64;
                Ok(())
            }
            Ok(_) => Err((self.offset, Damage::EndMagic)),
            Err(damage) => Err((self.offset, damage)),
        }
    }

    /// Looks behind the end: there is nothing, another log (reading goes on with it), or bytes that are none.
    pub fn behind_the_end(&mut self) -> Result<(), Located> {
        let mut magic = [0; 8];
        let at = self.offset;
        match self.fill(&mut magic) {
            Ok(0) => Ok(()),
            Ok(8) if magic == mcap::MAGIC => {
                self.offset = at + magic.len() as u64;
                self.restart_crc();
                self.hasher.update(&magic);
                self.done = false;
                Err((at, Damage::JoinedLog))
            }
            Ok(some) => {
                let rest = io::copy(&mut self.source, &mut io::sink()).unwrap_or(0);
                let bytes = some + rest;
                self.offset = at + bytes;
                Err((at, Damage::AfterEnd { bytes }))
            }
            Err(damage) => Err((at, damage)),
        }
    }

    fn fill(&mut self, buffer: &mut [u8]) -> Result<u64, Damage> {
        let mut have = 0;
        while have < buffer.len() {
            match self.source.read(&mut buffer[have..]) {
                Ok(0) => break,
                Ok(n) => have += n,
                Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
                Err(e) => return Err(io_damage(e)),
            }
        }
        Ok(have as u64)
    }

    fn skip(&mut self, len: u64) -> Result<(), Damage> {
        let mut left = len;
        while left > 0 {
            let buffer = self.source.fill_buf().map_err(io_damage)?;
            if buffer.is_empty() {
                return Err(Damage::Cut {
                    need: len,
                    have: len - left,
                });
            }
            let n = (buffer.len() as u64).min(left) as usize;
            self.hasher.update(&buffer[..n]);
            self.source.consume(n);
            left -= n as u64;
        }
        Ok(())
    }
}

impl<R: BufRead + io::Seek> Records<R> {
    /// Goes on reading at `offset`.
    pub fn jump(&mut self, offset: u64) -> io::Result<()> {
        self.source.seek(io::SeekFrom::Start(offset))?;
        self.offset = offset;
        self.truncated = None;
        self.done = false;
        Ok(())
    }
}

fn io_damage(e: io::Error) -> Damage {
    Damage::Io(e.to_string())
}

//! After damage that hides where the next record begins: the next sound one, wherever it is.

use std::collections::BTreeSet;
use std::io::{self, Read, Seek, SeekFrom};

use bytes::Bytes;
use mcap::records::op;

use super::{LIMIT_BYTES, PREFIX_BYTES, channel, chunk, next_inner, schema};

/// Bytes looked through at a time.
const BLOCK_BYTES: usize = 1 << 20;
/// A chunk up to its content: prefix, two times, uncompressed size, checksum, the compression's name of at most four
/// letters behind its length, the content's length.
const HEADER_BYTES: usize = PREFIX_BYTES as usize + 8 + 8 + 8 + 4 + 4 + 4 + 8;
/// Bytes of candidates that are read and unpacked for each byte of the file. Eight fields of a header must fit together
/// before a candidate costs anything: an honest file offers the chunks that are in it, a forged one must not make
/// work without end.
const EFFORT: u64 = 8;
/// Records that must follow each other where no checksum vouches for the first: opcode, length and channel of one fit by chance
/// once in some 10^14 bytes, but bytes of images are no chance.
const CHAIN: usize = 3;
/// Bytes that a chain of candidates costs beside what is read of it: so many as the system reads ahead for each.
const CHAIN_BYTES: u64 = 512;
/// Longest declaration that may begin a chain; those of ROS 2 with all they contain take some 10 kB.
const DECLARATION_BYTES: u64 = 1 << 20;
/// A message without its bytes: channel, sequence, two times.
const MESSAGE_BYTES: u64 = 2 + 4 + 8 + 8;

/// Looks for records in a file's bytes.
pub(crate) struct RecordFinder<R> {
    source: R,
    file_bytes: u64,
    effort_bytes: u64,
    chain_effort_bytes: u64,
}

impl<R: Read + Seek> RecordFinder<R> {
    pub fn new(mut source: R) -> io::Result<Self> {
        let bytes = source.seek(SeekFrom::End(0))?;
        let effort_bytes = bytes.saturating_mul(EFFORT).saturating_add(LIMIT_BYTES);
        Ok(Self {
            source,
            file_bytes: bytes,
            effort_bytes,
            chain_effort_bytes: effort_bytes,
        })
    }

    /// Offset of the next sound record at or after `from`: a chunk whose checksum holds (one that states none: whose content has the
    /// stated size and is nothing but records), or, where messages stand outside chunks in these channels, [`CHAIN`] records one after
    /// the other.
    pub fn find(&mut self, from: u64, outside: &BTreeSet<u16>) -> io::Result<Option<u64>> {
        let (mut block, mut start) = (Vec::new(), from);
        loop {
            block.clear();
            self.source.seek(SeekFrom::Start(start))?;
            self.source
                .by_ref()
                .take((BLOCK_BYTES + HEADER_BYTES) as u64)
                .read_to_end(&mut block)?;
            for at in 0..block.len().min(BLOCK_BYTES) {
                let offset = start + at as u64;
                let is_sound = match block[at] {
                    op::CHUNK => match Candidate::of(&block[at..]) {
                        Some(candidate) => self.is_sound(offset, &candidate)?,
                        None => false,
                    },
                    op::SCHEMA | op::CHANNEL | op::MESSAGE if !outside.is_empty() => {
                        let head = Head::of(&block[at..], outside);
                        head.is_some_and(|h| self.fits(offset, &h))
                            && self.begins_chain(offset, outside)?
                    }
                    _ => false,
                };
                if is_sound {
                    return Ok(Some(offset));
                }
            }
            if block.len() < BLOCK_BYTES {
                return Ok(None);
            }
            start += BLOCK_BYTES as u64;
        }
    }

    /// Whether all of the candidate is there and its checksum holds; no, once the effort is spent.
    fn is_sound(&mut self, offset: u64, candidate: &Candidate) -> io::Result<bool> {
        let cost = candidate.len + candidate.uncompressed_bytes;
        let Some(left) = self.effort_bytes.checked_sub(cost) else {
            return Ok(false);
        };
        self.effort_bytes = left;
        let body = self.body(offset, candidate.len)?;
        let whole = body.len() as u64 == candidate.len;
        Ok(whole
            && chunk(&body, false).is_ok_and(|c| {
                c.open()
                    .is_ok_and(|content| c.crc != 0 || is_records(content))
            }))
    }

    fn body(&mut self, offset: u64, len: u64) -> io::Result<Bytes> {
        let mut body = Vec::new();
        self.source.seek(SeekFrom::Start(offset + PREFIX_BYTES))?;
        self.source.by_ref().take(len).read_to_end(&mut body)?;
        Ok(Bytes::from(body))
    }

    /// Whether a record of that head ends within the file.
    fn fits(&self, offset: u64, head: &Head) -> bool {
        offset
            .checked_add(PREFIX_BYTES + head.len)
            .is_some_and(|end| end <= self.file_bytes)
    }

    /// Whether records follow each other from here on; no, once the effort is spent.
    fn begins_chain(&mut self, offset: u64, outside: &BTreeSet<u16>) -> io::Result<bool> {
        let mut at = offset;
        for nth in 0..CHAIN {
            let Some(left) = self.chain_effort_bytes.checked_sub(CHAIN_BYTES) else {
                return Ok(false);
            };
            self.chain_effort_bytes = left;
            let mut bytes = Vec::new();
            self.source.seek(SeekFrom::Start(at))?;
            self.source
                .by_ref()
                .take(HEADER_BYTES as u64)
                .read_to_end(&mut bytes)?;
            if bytes.is_empty() {
                // The file ends behind a record.
                return Ok(nth > 0);
            }
            let head = Head::of(&bytes, outside).filter(|h| self.fits(at, h));
            let Some(head) = head else {
                return Ok(false);
            };
            if matches!(head.opcode, op::SCHEMA | op::CHANNEL) && !self.declares(at, &head)? {
                return Ok(false);
            }
            if head.opcode == op::DATA_END {
                return Ok(nth > 0);
            }
            at += PREFIX_BYTES + head.len;
        }
        Ok(true)
    }

    /// Whether a record is a whole schema or channel.
    fn declares(&mut self, offset: u64, head: &Head) -> io::Result<bool> {
        let Some(left) = self.chain_effort_bytes.checked_sub(head.len) else {
            return Ok(false);
        };
        self.chain_effort_bytes = left;
        if head.len > DECLARATION_BYTES {
            return Ok(false);
        }
        let body = self.body(offset, head.len)?;
        Ok(match head.opcode {
            op::SCHEMA => schema(&body).is_ok(),
            _ => channel(&body).is_ok(),
        })
    }
}

/// Whether bytes are records of a chunk, one or more, to the last byte.
fn is_records(mut content: Bytes) -> bool {
    !content.is_empty()
        && std::iter::from_fn(|| next_inner(&mut content)).all(|record| {
            record.is_ok_and(|(opcode, _)| matches!(opcode, op::SCHEMA | op::CHANNEL | op::MESSAGE))
        })
}

/// Bytes that may begin a record outside chunks.
struct Head {
    opcode: u8,
    len: u64,
}

impl Head {
    fn of(bytes: &[u8], outside: &BTreeSet<u16>) -> Option<Self> {
        let opcode = *bytes.first()?;
        let len = u64::from_le_bytes(bytes.get(1..9)?.try_into().ok()?);
        let fits = len <= LIMIT_BYTES
            && match opcode {
                op::MESSAGE => {
                    let channel = bytes.get(9..11)?.try_into().ok()?;
                    len >= MESSAGE_BYTES && outside.contains(&u16::from_le_bytes(channel))
                }
                op::SCHEMA | op::CHANNEL | op::CHUNK | op::ATTACHMENT | op::METADATA => len > 0,
                op::DATA_END => len == 4,
                _ => false,
            };
        fits.then_some(Self { opcode, len })
    }
}

/// Bytes that may be the head of a chunk.
struct Candidate {
    len: u64,
    uncompressed_bytes: u64,
}

impl Candidate {
    fn of(bytes: &[u8]) -> Option<Self> {
        let u64_at = |at: usize| -> Option<u64> {
            let field = bytes.get(at..at + 8)?;
            Some(u64::from_le_bytes(field.try_into().ok()?))
        };
        let u32_at = |at: usize| -> Option<u32> {
            let field = bytes.get(at..at + 4)?;
            Some(u32::from_le_bytes(field.try_into().ok()?))
        };
        let body = PREFIX_BYTES as usize;
        let len = u64_at(1)?;
        let (start_ns, end_ns) = (u64_at(body)?, u64_at(body + 8)?);
        let uncompressed_bytes = u64_at(body + 16)?;
        let name_bytes = u32_at(body + 28)? as usize;
        let name = bytes.get(body + 32..body + 32 + name_bytes.min(4))?;
        let content_bytes = u64_at(body + 32 + name_bytes.min(4))?;
        let fits = match (name, name_bytes) {
            (b"", 0) => content_bytes == uncompressed_bytes,
            (b"lz4", 3) | (b"zstd", 4) => content_bytes > 0,
            _ => false,
        };
        let header_bytes = (40 + name_bytes) as u64;
        let sized = len <= LIMIT_BYTES
            && uncompressed_bytes <= LIMIT_BYTES
            && content_bytes.checked_add(header_bytes) == Some(len);
        (fits && sized && start_ns <= end_ns).then_some(Self {
            len,
            uncompressed_bytes,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Cursor;

    fn chunk_record(content: &[u8]) -> Vec<u8> {
        let mut body = Vec::new();
        body.extend(1u64.to_le_bytes());
        body.extend(2u64.to_le_bytes());
        body.extend((content.len() as u64).to_le_bytes());
        body.extend(crc32fast::hash(content).to_le_bytes());
        body.extend(0u32.to_le_bytes());
        body.extend((content.len() as u64).to_le_bytes());
        body.extend(content);
        let mut record = vec![op::CHUNK];
        record.extend((body.len() as u64).to_le_bytes());
        record.extend(body);
        record
    }

    fn found(file: &[u8], from: u64) -> Option<u64> {
        let mut finder = RecordFinder::new(Cursor::new(file)).unwrap();
        finder.find(from, &BTreeSet::new()).unwrap()
    }

    #[test]
    fn a_chunk_is_found_behind_rubbish_and_across_the_border_of_blocks() {
        for rubbish in [0, 1, 77, BLOCK_BYTES - 30, BLOCK_BYTES, BLOCK_BYTES + 1] {
            let mut file = vec![op::CHUNK; rubbish];
            file.extend(chunk_record(b"content"));
            assert_eq!(found(&file, 0), Some(rubbish as u64));
            assert_eq!(found(&file, rubbish as u64 + 1), None);
        }
    }

    #[test]
    fn a_chunk_whose_checksum_fails_is_passed_over() {
        let mut file = chunk_record(b"content");
        let second = file.len() as u64;
        *file.last_mut().unwrap() ^= 1;
        file.extend(chunk_record(b"sound"));
        assert_eq!(found(&file, 0), Some(second));
    }

    /// Each byte of this file begins a candidate of half its length: trying them all would read it 100000 times over.
    #[test]
    fn quadratic_chunk_search_the_effort_is_bounded_by_the_size_of_the_file() {
        let step = HEADER_BYTES;
        let n = 20_000;
        let mut file = Vec::new();
        for k in 0..n {
            let left = ((n - k) * step - PREFIX_BYTES as usize) as u64;
            let mut head = vec![op::CHUNK];
            head.extend(left.to_le_bytes());
            head.extend(1u64.to_le_bytes());
            head.extend(2u64.to_le_bytes());
            head.extend((left - 40).to_le_bytes());
            head.extend(7u32.to_le_bytes());
            head.extend(0u32.to_le_bytes());
            head.extend((left - 40).to_le_bytes());
            head.resize(step, 0);
            file.extend(head);
        }
        let mut finder = RecordFinder::new(Cursor::new(&file)).unwrap();
        let before = finder.effort_bytes;
        assert_eq!(finder.find(0, &BTreeSet::new()).unwrap(), None);
        assert!(before <= EFFORT * file.len() as u64 + LIMIT_BYTES);
        let largest = 2 * file.len() as u64;
        assert!(
            finder.effort_bytes < largest,
            "nothing was tried: {}",
            finder.effort_bytes
        );
    }
}

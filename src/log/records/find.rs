//! After damage to a length: the next sound chunk, wherever it is.

use std::io::{self, Read, Seek, SeekFrom};

use bytes::Bytes;
use mcap::records::op;

use super::{LIMIT_BYTES, PREFIX_BYTES, chunk};

/// Bytes looked through at a time.
const BLOCK_BYTES: usize = 1 << 20;
/// A chunk up to its content: prefix, two times, uncompressed size, checksum, the compression's name of at most four
/// letters behind its length, the content's length.
const HEADER_BYTES: usize = PREFIX_BYTES as usize + 8 + 8 + 8 + 4 + 4 + 4 + 8;
/// Bytes of candidates that are read and unpacked for each byte of the file. Eight fields of a header must fit together
/// before a candidate costs anything: an honest file offers the chunks that are in it, a forged one must not make
/// work without end.
const EFFORT: u64 = 8;

pub(crate) struct ChunkFinder<R> {
    source: R,
    effort_bytes: u64,
}

impl<R: Read + Seek> ChunkFinder<R> {
    pub fn new(mut source: R) -> io::Result<Self> {
        let bytes = source.seek(SeekFrom::End(0))?;
        Ok(Self {
            source,
            effort_bytes: bytes.saturating_mul(EFFORT).saturating_add(LIMIT_BYTES),
        })
    }

    /// Where the next chunk begins whose checksum holds, at or after `from`. A chunk that states no checksum cannot
    /// be distinguished from chance and is passed over.
    pub fn find(&mut self, from: u64) -> io::Result<Option<u64>> {
        let (mut block, mut start) = (Vec::new(), from);
        loop {
            block.clear();
            self.source.seek(SeekFrom::Start(start))?;
            self.source
                .by_ref()
                .take((BLOCK_BYTES + HEADER_BYTES) as u64)
                .read_to_end(&mut block)?;
            for at in 0..block.len().min(BLOCK_BYTES) {
                if block[at] != op::CHUNK {
                    continue;
                }
                let Some(candidate) = Candidate::of(&block[at..]) else {
                    continue;
                };
                let offset = start + at as u64;
                if self.is_sound(offset, &candidate)? {
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
        let mut body = Vec::new();
        self.source.seek(SeekFrom::Start(offset + PREFIX_BYTES))?;
        let there = self
            .source
            .by_ref()
            .take(candidate.len)
            .read_to_end(&mut body)?;
        let whole = there as u64 == candidate.len;
        Ok(whole && chunk(&Bytes::from(body), false).is_ok_and(|c| c.open().is_ok()))
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
        let crc = u32_at(body + 24)?;
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
        (fits && sized && crc != 0 && start_ns <= end_ns).then_some(Self {
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
        let mut finder = ChunkFinder::new(Cursor::new(file)).unwrap();
        finder.find(from).unwrap()
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
        let mut finder = ChunkFinder::new(Cursor::new(&file)).unwrap();
        let before = finder.effort_bytes;
        assert_eq!(finder.find(0).unwrap(), None);
        assert!(before <= EFFORT * file.len() as u64 + LIMIT_BYTES);
        let largest = 2 * file.len() as u64;
        assert!(
            finder.effort_bytes < largest,
            "nothing was tried: {}",
            finder.effort_bytes
        );
    }
}

//! Any bytes as a log: messages and errors that come to an end, never a panic.
#![no_main]

use std::io::Cursor;
use std::path::Path;

use hydroline::log::{EXPANSION_MAX, LIMIT_BYTES, LogReader};
use libfuzzer_sys::fuzz_target;

#[path = "support/memory.rs"]
mod memory;
use memory::bounded;

fuzz_target!(|bytes: &[u8]| {
    // One decompressed chunk, one record and what they hold: what is allocated never goes by what a length claims.
    bounded(bytes.len(), 4 * LIMIT_BYTES as usize, 64, || {
        if let Ok(reader) = LogReader::from_source(Path::new("fuzz.mcap"), Cursor::new(bytes)) {
            // No record is shorter than its opcode and length, and chunks unpack to so much at most: it ends.
            let unpacked = EXPANSION_MAX * bytes.len() as u64 + LIMIT_BYTES;
            let most = unpacked as usize / 9 + 2;
            assert!(reader.take(most + 1).count() <= most);
        }
    });
});

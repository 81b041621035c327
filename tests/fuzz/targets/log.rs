//! Any bytes as a log: messages and errors that come to an end, never a panic.
#![no_main]

use std::io::Cursor;
use std::path::Path;

use hydroline::log::LogReader;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    if let Ok(reader) = LogReader::from_source(Path::new("fuzz.mcap"), Cursor::new(bytes)) {
        // No record is shorter than its opcode and length: more steps than bytes never end.
        assert!(reader.take(bytes.len() + 2).count() <= bytes.len() + 1);
    }
});

//! A map file and a table, divided by the first line that is `---`: findings, never a panic.
#![no_main]

use hydroline::import::{Map, read_table};
use libfuzzer_sys::fuzz_target;

#[path = "support/memory.rs"]
mod memory;
use memory::bounded;

const BETWEEN: &[u8] = b"\n---\n";

fuzz_target!(|bytes: &[u8]| {
    let at = bytes.windows(BETWEEN.len()).position(|w| w == BETWEEN);
    let (map, table) = match at {
        Some(at) => (&bytes[..at], &bytes[at + BETWEEN.len()..]),
        None => (bytes, &[][..]),
    };
    // The table in any encoding, the map in TOML's.
    let Ok(map) = std::str::from_utf8(map) else {
        return;
    };
    bounded(bytes.len(), 1 << 20, 512, || {
        if let Ok(map) = Map::from_toml(map, "fuzz.toml") {
            let _ = read_table(table, &map, None);
        }
    });
});

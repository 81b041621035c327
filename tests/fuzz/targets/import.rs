//! A map file and a table, divided by the first line that is `---`: findings, never a panic.
#![no_main]

use hydroline::import::{Map, read};
use libfuzzer_sys::fuzz_target;

#[path = "support/memory.rs"]
mod memory;
use memory::bounded;

fuzz_target!(|text: &str| {
    let (map, table) = text.split_once("\n---\n").unwrap_or((text, ""));
    bounded(text.len(), 1 << 20, 512, || {
        if let Ok(map) = Map::from_toml(map, "fuzz.toml") {
            let _ = read(table, &map);
        }
    });
});

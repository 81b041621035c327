//! Any bytes as a table without a map: a guess or a refusal, and a guessed map loads; never a panic.
#![no_main]

use hydroline::import::{Map, guess::guess};
use libfuzzer_sys::fuzz_target;

#[path = "support/memory.rs"]
mod memory;
use memory::bounded;

fuzz_target!(|bytes: &[u8]| {
    bounded(bytes.len(), 4 << 20, 1024, || {
        if let Ok(Ok(found)) = guess(bytes) {
            assert!(Map::from_toml(&found.toml, "fuzz.toml").is_ok(), "{}", found.toml);
        }
    });
});

//! Any bytes as a log of another program (MCAP, db3, DataFlash, telemetry, ULog): contents, a guessed map that loads, the
//! table of that map, and what is found in it; never a panic.
#![no_main]

use std::io::Write;

use hydroline::import::{Map, survey};
use hydroline::import::guess::guess_recording;
use hydroline::import::recorded::Recording;
use libfuzzer_sys::fuzz_target;

#[path = "support/memory.rs"]
mod memory;
use memory::bounded;

fuzz_target!(|bytes: &[u8]| {
    let mut file = tempfile::NamedTempFile::new().expect("a scratch file");
    file.write_all(bytes).expect("room for it");
    // A chunk of MCAP may unpack to 64 MiB, whatever the input's size.
    bounded(bytes.len(), 160 << 20, 4096, || {
        let Ok(Some(recording)) = Recording::open(file.path()) else {
            return;
        };
        let _ = recording.contents().to_string();
        if let Ok(Ok(found)) = guess_recording(&recording) {
            let map = Map::from_toml(&found.toml, "fuzz.toml");
            let Ok(map) = map else {
                panic!("{map:?}\n{}", found.toml);
            };
            if let Ok(table) = recording.table(&map) {
                let _ = survey(&table, &table.map, None);
            }
        }
    });
});

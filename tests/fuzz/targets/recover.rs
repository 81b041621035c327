//! Any bytes as a log to recover, to examine and to tell about: what is recovered reads back
//! without an error, the original stays as it was.
#![no_main]

use hydroline::log::doctor::doctor;
use hydroline::log::info::info;
use hydroline::log::recover::recover;
use hydroline::log::{LIMIT_BYTES, LogError, LogReader};
use libfuzzer_sys::fuzz_target;

#[path = "support/memory.rs"]
mod memory;
use memory::bounded;

fuzz_target!(|bytes: &[u8]| {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (path, mended) = (folder.path().join("a.mcap"), folder.path().join("b.mcap"));
    std::fs::write(&path, bytes).expect("written");
    // As in `log`; written chunk by chunk.
    bounded(bytes.len(), 4 * LIMIT_BYTES as usize, 64, || {
        let _ = info(&path);
        let _ = doctor(&path);
        if recover(&path, &mended).is_ok() {
            let reader = LogReader::open(&mended).expect("a recovered log opens");
            for message in reader {
                // A message that does not decode is kept as it is, and reported.
                if !matches!(message, Err(LogError::Message { .. })) {
                    message.expect("a recovered log reads back");
                }
            }
        } else {
            assert!(!mended.exists(), "half a recovery was left");
        }
    });
    assert_eq!(std::fs::read(&path).expect("still there"), bytes);
});

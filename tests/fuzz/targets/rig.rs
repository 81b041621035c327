//! Rig, target, board and calibration files: an error or a checked value, never a panic; the
//! effective rig that goes into a log reads back as the same rig.
#![no_main]

use hydroline_calib::calibration::Calibration;
use hydroline_rigs::{Board, Rig, Target};
use libfuzzer_sys::fuzz_target;

#[path = "support/memory.rs"]
mod memory;
use memory::bounded;

fuzz_target!(|text: &str| {
    bounded(text.len(), 1 << 20, 512, || {
        if let Ok(rig) = Rig::from_toml(text, "fuzz.toml", None) {
            let again = Rig::from_toml(&rig.effective_toml, "effective.toml", None)
                .unwrap_or_else(|e| panic!("the effective rig does not read back: {e}"));
            assert_eq!(again.effective_toml, rig.effective_toml);
        }
        let _ = Target::from_toml(text, "fuzz.toml");
        let _ = Board::from_toml(text, "fuzz.toml");
        let _ = Calibration::from_toml(text, "fuzz.toml");
    });
});

//! Plan files: an error or a checked plan, never a panic; a plan reads back from its own text.
#![no_main]

use hydroline_rigs::Plan;
use libfuzzer_sys::fuzz_target;

#[path = "support/memory.rs"]
mod memory;
use memory::bounded;

fuzz_target!(|text: &str| {
    bounded(text.len(), 1 << 20, 512, || {
        if let Ok(plan) = Plan::from_toml(text, "fuzz.toml") {
            Plan::from_toml(&plan.source_toml, "fuzz.toml")
                .unwrap_or_else(|e| panic!("the plan does not read back: {e}"));
        }
    });
});

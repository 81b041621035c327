//! Faults found under attack, each shown by the binary alone and named by what broke.
//!
//! `HYDROLINE_BINARY=OLD cargo test --test recording attacks` asks another build: on one from before the mending
//! (4042f4f) every test here fails.

use crate::support::hydroline;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

mod controller;
mod files;
mod logs;
mod process;

/// Longest that anything asked here may take; before the mending some took minutes, or never ended.
const PATIENCE_S: &str = "20";
/// Most address space \[KiB\]: 1.5 GB.
const MEMORY_KIB: &str = "1500000";

/// Runs the binary with these words, bounded in time and memory (exit code 124 or a signal then).
fn bounded(words: &[&str]) -> Output {
    let binary = hydroline().get_program().to_owned();
    Command::new("bash")
        .args(["-c", "ulimit -v $1; shift; exec timeout \"$@\"", "bash"])
        .args([MEMORY_KIB, PATIENCE_S])
        .arg(binary)
        .args(words)
        .env("XDG_DATA_HOME", crate::support::data_home())
        .env_remove("RUST_LOG")
        .stdin(std::process::Stdio::null())
        .output()
        .unwrap()
}

fn words(output: &Output) -> String {
    format!(
        "{:?}\n{}{}",
        output.status.code(),
        String::from_utf8_lossy(&output.stdout),
        String::from_utf8_lossy(&output.stderr)
    )
}

fn path(dir: &Path, name: &str) -> String {
    dir.join(name).to_str().unwrap().to_owned()
}

fn ours(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests/data/attacks")
        .join(name)
}

/// A simulated run without images, of the built-in rig or of a rig file.
fn simulated(dir: &Path, name: &str, rig: &str) -> String {
    simulated_by(dir, name, rig, "surge-4n")
}

fn simulated_by(dir: &Path, name: &str, rig: &str, plan: &str) -> String {
    let log = path(dir, name);
    let words_of = format!("simulate --rig {rig} --plan {plan} --motion-only --out {log}");
    let output = bounded(&words_of.split(' ').collect::<Vec<_>>());
    assert!(output.status.success(), "{}", words(&output));
    log
}

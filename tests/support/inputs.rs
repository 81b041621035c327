//! Reference inputs of the tests: where they lie, and what a test says that has to do without.
//!
//! `tests/data` comes with every clone and holds a small fixed set (its README says what and whose). The full set lies
//! beside the clone in `../shared`, or where `HYDROLINE_SHARED` says; paths below are the same in both.
#![allow(dead_code)] // every test binary takes what it needs

use std::ffi::OsString;
use std::fmt::Display;
use std::panic::Location;
use std::path::{Path, PathBuf};

/// An input of an everyday test: the committed one, else that of the full set. `None` where neither is there,
/// which has then been said: leave the test.
#[track_caller]
pub fn input(what: &str) -> Option<PathBuf> {
    let committed = repository().join("tests/data").join(what);
    if committed.exists() {
        return Some(committed);
    }
    full(what)
}

/// An input of the full set, for the larger version of a test. `None` where it is not there, which has then been said.
#[track_caller]
pub fn full(what: &str) -> Option<PathBuf> {
    let root = std::env::var_os("HYDROLINE_SHARED")
        .map_or_else(|| repository().join("../shared"), PathBuf::from);
    let path = root.join(what);
    if path.exists() {
        return Some(path);
    }
    skip(format_args!(
        "{what} of the full set (not in {}; HYDROLINE_SHARED names another place)",
        root.display()
    ));
    None
}

/// Says that this test is left out, in the one form that `tests/run` looks for and lists by name.
#[track_caller]
pub fn skip(needs: impl Display) {
    let thread = std::thread::current();
    // The harness names each test's thread after the test; with one thread it runs them all in `main`.
    let test = match thread.name() {
        Some(name) if name != "main" => name.to_owned(),
        _ => Location::caller().to_string(),
    };
    println!(
        "SKIPPED: {}::{test}: needs {needs}",
        env!("CARGO_CRATE_NAME")
    );
}

/// A Python that can import these modules: `HYDROLINE_PYTHON`, which has to, else `python3`; `None` where that lacks one,
/// which has then been said.
#[track_caller]
pub fn python(modules: &[&str]) -> Option<OsString> {
    let named = std::env::var_os("HYDROLINE_PYTHON");
    let python = named.clone().unwrap_or_else(|| "python3".into());
    let tried = std::process::Command::new(&python)
        .args(["-c", &format!("import {}", modules.join(", "))])
        .output();
    let problem = match tried {
        Ok(output) if output.status.success() => return Some(python),
        Ok(output) => String::from_utf8_lossy(&output.stderr).trim().to_owned(),
        Err(e) => e.to_string(),
    };
    assert!(
        named.is_none(),
        "HYDROLINE_PYTHON={}: {problem}; tests/setup --tests installs what is needed",
        python.display()
    );
    skip(format_args!(
        "a python3 with {} (tests/setup --tests, or set HYDROLINE_PYTHON)",
        modules.join(", ")
    ));
    None
}

/// Those of `names` whose log lies in a folder: the committed set leaves some of the full one's out.
pub fn logs_of<'a>(folder: &Path, names: &[&'a str]) -> Vec<&'a str> {
    let there: Vec<&str> = names
        .iter()
        .filter(|name| folder.join(format!("{name}.mcap")).is_file())
        .copied()
        .collect();
    assert!(
        !there.is_empty(),
        "none of {names:?} lies in {}",
        folder.display()
    );
    there
}

/// Tests `committed::body`, on the committed set, and `full_set::body`, on the full one, of functions that take the folder.
/// The committed set has every behaviour and is what runs every day; `cargo test full_set -- --ignored` runs the other.
#[allow(unused_macros)]
macro_rules! on_both_sets {
    ($folder:literal: $($body:ident),+ $(,)?) => {
        mod committed {
            $(#[test]
            fn $body() {
                if let Some(folder) = crate::inputs::input($folder) {
                    super::$body(&folder);
                }
            })+
        }

        mod full_set {
            $(#[test]
            #[ignore = "the full set; the everyday test runs on the committed one"]
            fn $body() {
                if let Some(folder) = crate::inputs::full($folder) {
                    super::$body(&folder);
                }
            })+
        }
    };
}
#[allow(unused_imports)]
pub(crate) use on_both_sets;

/// The repository's root, from whichever crate of it the test belongs to.
fn repository() -> &'static Path {
    let crate_root = Path::new(env!("CARGO_MANIFEST_DIR"));
    crate_root
        .ancestors()
        .find(|dir| dir.join("tests/data/README.md").is_file())
        .unwrap_or(crate_root)
}

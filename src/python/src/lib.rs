//! The native half of the Python package `hydroline`: a thin layer over the crates, in which nothing is computed.
//!
//! - [`call`]: a command of the command line, run on threads of its own while Python goes on (no GIL), which a signal ends;
//! - [`log`]: a log's tables over Arrow's C interface, its frames as NumPy arrays;
//! - [`extract`]: the stripe of an array, without a copy;
//! - [`files`]: rigs and plans.
//!
//! The part that a person sees (signatures, docstrings, result types) is Python, in `hydroline/`.

mod call;
mod columns;
mod errors;
mod extract;
mod files;
mod frames;
mod kinds;
mod log;
mod table;

use hydroline_core::build_info::BuildInfo;
use pyo3::prelude::*;

/// Build of the package; without a commit: a wheel is built from a copy of the sources.
fn build() -> BuildInfo {
    BuildInfo::default()
}

#[pymodule]
mod _hydroline {
    use super::*;

    #[pymodule_export]
    use super::call::{Called, call, definition};
    #[pymodule_export]
    use super::extract::{Profile, extract, extract_file};
    #[pymodule_export]
    use super::files::{Calibration, Plan, Rig};
    #[pymodule_export]
    use super::frames::{Frame, Frames};
    #[pymodule_export]
    use super::log::Log;
    #[pymodule_export]
    use super::table::Table;

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("__version__", env!("CARGO_PKG_VERSION"))
    }
}

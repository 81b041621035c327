//! A log: its tables, its frames, and what its head says.

use crate::columns::Kind;
use crate::errors;
use crate::files::{Calibration, Rig};
use crate::frames::Frames;
use crate::table::Table;
use hydroline_log::{IndexedLog, LogError, LogMessage};
use pyo3::prelude::*;
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};

/// A log that is open. What it holds is read when it is asked for; several threads may.
#[pyclass(frozen, module = "hydroline._hydroline")]
pub struct Log {
    log: Arc<IndexedLog>,
    /// Tables that were made: asked for again, they are the same.
    tables: Mutex<BTreeMap<Kind, Py<Table>>>,
}

/// The messages of these kinds, by kind, in the file's order; chunks are unpacked on all cores.
fn messages(log: &IndexedLog, kinds: &[Kind]) -> Result<BTreeMap<Kind, Vec<LogMessage>>, LogError> {
    let topics: Vec<&str> = kinds.iter().map(|k| k.topic()).collect();
    let places = log.places(&topics).into_par_iter();
    let read: Vec<Vec<LogMessage>> = places
        .map(|place| log.messages(place, &topics))
        .collect::<Result<_, LogError>>()?;
    let mut found: BTreeMap<Kind, Vec<LogMessage>> =
        kinds.iter().map(|k| (*k, Vec::new())).collect();
    for message in read.into_iter().flatten() {
        let of = Kind::of(&message.record).and_then(|kind| found.get_mut(&kind));
        if let Some(of) = of {
            of.push(message);
        }
    }
    Ok(found)
}

impl Log {
    fn table(&self, py: Python<'_>, kind: Kind) -> PyResult<Py<Table>> {
        let known = |log: &Log| {
            let tables = log.tables.lock().unwrap_or_else(PoisonError::into_inner);
            tables.get(&kind).map(|table| table.clone_ref(py))
        };
        if let Some(table) = known(self) {
            return Ok(table);
        }
        let kinds = match kind {
            Kind::Stripes => &[Kind::Stripes][..],
            _ => &Kind::SMALL,
        };
        let read = py.detach(|| messages(&self.log, kinds));
        for (kind, messages) in read.map_err(|e| errors::sorted(py, e))? {
            let batch = py.detach(|| kind.table(messages));
            let table = Py::new(py, Table::new(batch.map_err(|e| errors::run(py, e))?))?;
            let mut tables = self.tables.lock().unwrap_or_else(PoisonError::into_inner);
            // Another thread may have been here first: then its table stays.
            tables.entry(kind).or_insert(table);
        }
        known(self).ok_or_else(|| errors::run(py, "a table was not made"))
    }

    fn text(&self, name: &str, key: &str) -> Option<&str> {
        let map = self.log.metadata().get(name)?;
        map.get(key).map(String::as_str)
    }
}

#[pymethods]
impl Log {
    #[new]
    fn new(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        let log = py.detach(|| IndexedLog::open(&path));
        Ok(Log {
            log: Arc::new(log.map_err(|e| errors::sorted(py, e))?),
            tables: Mutex::default(),
        })
    }

    /// The file.
    #[getter]
    fn path(&self) -> PathBuf {
        self.log.path().to_owned()
    }

    /// Why the log ends before its end; None = it is whole.
    #[getter]
    fn end_missing(&self) -> Option<String> {
        self.log.end_missing().map(ToString::to_string)
    }

    /// Messages of each topic.
    #[getter]
    fn counts(&self) -> BTreeMap<String, u64> {
        let counts = self.log.counts().into_iter();
        counts.map(|(topic, n)| (topic.to_owned(), n)).collect()
    }

    /// /vehicle/motion.
    #[getter]
    fn motion(&self, py: Python<'_>) -> PyResult<Py<Table>> {
        self.table(py, Kind::Motion)
    }

    /// /sim/truth.
    #[getter]
    fn truth(&self, py: Python<'_>) -> PyResult<Py<Table>> {
        self.table(py, Kind::Truth)
    }

    /// /thruster/command.
    #[getter]
    fn commands(&self, py: Python<'_>) -> PyResult<Py<Table>> {
        self.table(py, Kind::Commands)
    }

    /// /thruster/echo.
    #[getter]
    fn echoes(&self, py: Python<'_>) -> PyResult<Py<Table>> {
        self.table(py, Kind::Echoes)
    }

    /// /laser/profile.
    #[getter]
    fn stripes(&self, py: Python<'_>) -> PyResult<Py<Table>> {
        self.table(py, Kind::Stripes)
    }

    /// /daemon/event.
    #[getter]
    fn events(&self, py: Python<'_>) -> PyResult<Py<Table>> {
        self.table(py, Kind::Events)
    }

    /// /camera/image.
    #[getter]
    fn frames(&self) -> Frames {
        Frames::of(&self.log)
    }

    /// The rig that stands in the log; None in one made elsewhere.
    #[getter]
    fn rig(&self, py: Python<'_>) -> PyResult<Option<Rig>> {
        let name = format!("rig in {}", self.log.path().display());
        let toml = self.text("rig", "toml");
        toml.map(|toml| Rig::of_log(py, toml, &name)).transpose()
    }

    /// The calibration that stands in the log; None = none.
    #[getter]
    fn calibration(&self, py: Python<'_>) -> PyResult<Option<Calibration>> {
        let name = format!("calibration in {}", self.log.path().display());
        let toml = self.text("calibration", "toml");
        let read = toml.map(|toml| Calibration::of_log(py, toml, &name));
        read.transpose()
    }

    /// Circumstances of the recording by name: host, water, plan, versions; empty in a log made elsewhere.
    #[getter]
    fn session(&self) -> BTreeMap<String, String> {
        self.metadata("session").unwrap_or_default()
    }

    /// A metadata record by name; None = the log has none of that name.
    fn metadata(&self, name: &str) -> Option<BTreeMap<String, String>> {
        self.log.metadata().get(name).cloned()
    }

    fn __repr__(&self) -> String {
        let counts = self.log.counts();
        let of = |topic: &str| counts.get(topic).copied().unwrap_or(0);
        format!(
            "<hydroline.Log {}: {} poses, {} commands, {} frames>",
            self.log.path().display(),
            of(Kind::Motion.topic()),
            of(Kind::Commands.topic()),
            of(crate::frames::IMAGE)
        )
    }
}

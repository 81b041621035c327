//! A log: its tables, its frames, and what its head says.

use crate::call;
use crate::columns::{Table as Columns, joined};
use crate::errors;
use crate::files::{Calibration, Rig};
use crate::frames::Frames;
use crate::kinds::Kind;
use crate::table::Table;
use arrow_array::{ArrayRef, RecordBatch};
use arrow_schema::ArrowError;
use hydroline_log::{IndexedLog, LogError, Place, Topic};
use hydroline_numerics::cancel::Token;
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

/// Shares of a log that are read at once, per thread: the last ones to end leave little waiting.
const SHARES: usize = 4;

/// Why there is no table.
enum Failure {
    Log(LogError),
    Table(ArrowError),
}

/// The tables of these kinds, of one part of the log.
fn part(
    log: &IndexedLog,
    places: &[&Place],
    kinds: &[Kind],
) -> Result<Vec<Vec<(&'static str, ArrayRef)>>, LogError> {
    let topics: Vec<Topic> = kinds.iter().map(|k| k.topic()).collect();
    let mut tables: Vec<Box<dyn Columns>> = kinds.iter().map(|k| k.table()).collect();
    log.visit(places, &topics, |topic, log_ns, data| {
        let mut tables = topics.iter().zip(&mut tables);
        let table = tables.find(|(of, _)| **of == topic);
        table.map_or(Ok(()), |(_, table)| table.push(log_ns, data))
    })?;
    Ok(tables.iter_mut().map(|table| table.finish()).collect())
}

/// The tables of these kinds: chunks that hold none of them are skipped, the others unpacked on all cores.
fn tables(log: &IndexedLog, kinds: &[Kind], token: &Token) -> Result<Vec<RecordBatch>, Failure> {
    let topics: Vec<&str> = kinds.iter().map(|k| k.topic().name()).collect();
    let places = log.places(&topics);
    let share = places.len().div_ceil(SHARES * rayon::current_num_threads());
    let shares: Vec<&[&Place]> = match places.is_empty() {
        true => vec![&[]],
        false => places.chunks(share).collect(),
    };
    let parts = shares.into_par_iter().map(|places| {
        let _bound = token.bind();
        part(log, places, kinds)
    });
    let mut parts: Vec<_> = parts.collect::<Result<_, _>>().map_err(Failure::Log)?;
    let of = |k: usize| {
        let parts = parts.iter_mut().map(|part| std::mem::take(&mut part[k]));
        joined(parts.collect()).map_err(Failure::Table)
    };
    let tables: Vec<RecordBatch> = (0..kinds.len()).map(of).collect::<Result<_, _>>()?;
    for (kind, table) in kinds.iter().zip(&tables) {
        let found = table.num_rows() as u64;
        log.all_found(kind.topic(), found).map_err(Failure::Log)?;
    }
    Ok(tables)
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
        let kinds = kind.together();
        let read = call::interruptible(py, |token| tables(&self.log, kinds, token))?;
        let read = read.map_err(|failure| match failure {
            Failure::Log(error) => errors::sorted(py, error),
            Failure::Table(error) => errors::run(py, error),
        })?;
        for (kind, batch) in kinds.iter().zip(read) {
            let table = Py::new(py, Table::new(batch))?;
            let mut tables = self.tables.lock().unwrap_or_else(PoisonError::into_inner);
            // Another thread may have been here first: then its table stays.
            tables.entry(*kind).or_insert(table);
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
        let log = call::interruptible(py, |_| IndexedLog::open(&path))?;
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
            of(Topic::Motion.name()),
            of(Topic::Command.name()),
            of(crate::frames::IMAGE)
        )
    }
}

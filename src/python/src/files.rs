//! Rigs, plans and calibrations: checked when they are loaded.

use crate::errors;
use pyo3::prelude::*;

/// A rig, checked.
#[pyclass(frozen, module = "hydroline._hydroline")]
pub struct Rig {
    pub rig: hydroline_rigs::Rig,
    /// Argument for it on the command line: its file or built-in name. None = it comes from a log.
    #[pyo3(get)]
    source: Option<String>,
}

impl Rig {
    /// A rig that stands in a log.
    pub fn of_log(py: Python<'_>, toml: &str, name: &str) -> PyResult<Self> {
        let rig = hydroline_rigs::Rig::from_toml(toml, name, None);
        Ok(Rig {
            rig: rig.map_err(|e| errors::sorted(py, e))?,
            source: None,
        })
    }
}

#[pymethods]
impl Rig {
    /// Loads a rig file, or one that is built in, by its name.
    #[staticmethod]
    fn load(py: Python<'_>, source: std::path::PathBuf) -> PyResult<Self> {
        let source = source.to_string_lossy().into_owned();
        let rig = py.detach(|| hydroline_cli::load_rig(&source));
        Ok(Rig {
            rig: rig.map_err(|e| errors::sorted(py, e))?,
            source: Some(source),
        })
    }

    /// Its name.
    #[getter]
    fn name(&self) -> &str {
        &self.rig.name
    }

    /// The rig file, with what its defaults come to.
    fn to_toml(&self) -> String {
        self.rig.to_toml()
    }

    fn __repr__(&self) -> String {
        format!("<hydroline.Rig: {}>", self.rig.name)
    }
}

/// A plan, checked.
#[pyclass(frozen, module = "hydroline._hydroline")]
pub struct Plan {
    plan: hydroline_rigs::Plan,
    /// Argument for it on the command line: its file or built-in name.
    #[pyo3(get)]
    source: Option<String>,
}

#[pymethods]
impl Plan {
    /// Loads a plan file, or one that is built in, by its name.
    #[staticmethod]
    fn load(py: Python<'_>, source: std::path::PathBuf) -> PyResult<Self> {
        let source = source.to_string_lossy().into_owned();
        let plan = hydroline_rigs::Plan::load_or_builtin(&source);
        Ok(Plan {
            plan: plan.map_err(|e| errors::sorted(py, e))?,
            source: Some(source),
        })
    }

    /// Its name.
    #[getter]
    fn name(&self) -> &str {
        &self.plan.name
    }

    /// Length [s].
    #[getter]
    fn duration_s(&self) -> f64 {
        self.plan.duration_s()
    }

    /// The plan file.
    fn to_toml(&self) -> String {
        self.plan.to_toml()
    }

    fn __repr__(&self) -> String {
        let (name, length_s) = (&self.plan.name, self.plan.duration_s());
        format!("<hydroline.Plan: {name}, {length_s} s>")
    }
}

/// A map from image to laser plane, checked.
#[pyclass(frozen, module = "hydroline._hydroline")]
pub struct Calibration {
    calibration: hydroline_calib::calibration::Calibration,
}

impl Calibration {
    /// A calibration that stands in a log.
    pub fn of_log(py: Python<'_>, toml: &str, name: &str) -> PyResult<Self> {
        let calibration = hydroline_calib::calibration::Calibration::from_toml(toml, name)
            .map_err(|e| errors::sorted(py, e))?;
        Ok(Calibration { calibration })
    }
}

#[pymethods]
impl Calibration {
    /// Loads a calibration file.
    #[staticmethod]
    fn load(py: Python<'_>, path: std::path::PathBuf) -> PyResult<Self> {
        let calibration = hydroline_calib::calibration::Calibration::load(&path)
            .map_err(|e| errors::sorted(py, e))?;
        Ok(Calibration { calibration })
    }

    /// Method of the map, such as homography.
    #[getter]
    fn method(&self) -> &'static str {
        self.calibration.map.method()
    }

    /// Medium that the light went through: air, fresh or salt.
    #[getter]
    fn medium(&self) -> &'static str {
        self.calibration.medium.name()
    }

    /// When it was made; None = not known.
    #[getter]
    fn date(&self) -> Option<&str> {
        self.calibration.date.as_deref()
    }

    /// Name of the board; None = not known.
    #[getter]
    fn board(&self) -> Option<&str> {
        self.calibration.board.as_deref()
    }

    /// The calibration file.
    fn to_toml(&self, py: Python<'_>) -> PyResult<String> {
        let text = self.calibration.to_toml();
        text.map_err(|e| errors::sorted(py, e))
    }

    fn __repr__(&self) -> String {
        format!(
            "<hydroline.Calibration: {}, {}>",
            self.method(),
            self.medium()
        )
    }
}

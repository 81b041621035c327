//! The laser stripe of an image that lies in Python's memory.

use crate::errors;
use hydroline_core::frame::GreyView;
use hydroline_stripe::{Extractor, ExtractorConfig, Orientation, StripePoint};
use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyTuple;
use std::path::PathBuf;
use std::sync::{Mutex, PoisonError};

/// Extractors that wait for their next image: one per call at a time. They keep scratch memory and no results.
static WAITING: Mutex<Vec<Extractor>> = Mutex::new(Vec::new());

/// An extractor with these settings, and one that has worked before where there is one.
fn extractor(config: &ExtractorConfig) -> Extractor {
    let mut waiting = WAITING.lock().unwrap_or_else(PoisonError::into_inner);
    let same = waiting.iter().position(|e| e.config() == config);
    match same {
        Some(place) => waiting.swap_remove(place),
        None => Extractor::new(config.clone()),
    }
}

/// Most that are kept: as many as may be at work at once on a small computer.
const KEPT: usize = 8;

fn give_back(extractor: Extractor) {
    let mut waiting = WAITING.lock().unwrap_or_else(PoisonError::into_inner);
    if waiting.len() < KEPT {
        waiting.push(extractor);
    }
}

/// The stripe of an image: one point per column (per row where the line is vertical).
#[pyclass(frozen, module = "hydroline._hydroline")]
pub struct Profile {
    profile: hydroline_stripe::Profile,
    /// File of the image; empty = an array.
    image: PathBuf,
}

#[pymethods]
impl Profile {
    /// Size of the image: height and width [px].
    #[getter]
    fn shape(&self) -> (usize, usize) {
        (self.profile.size_px.1, self.profile.size_px.0)
    }

    /// Noise of the image, standard deviation [grey levels].
    #[getter]
    fn noise_sd(&self) -> f64 {
        self.profile.noise_sd
    }

    /// Scattering halo about the line, as a fraction of its peak.
    #[getter]
    fn haze_level(&self) -> f64 {
        self.profile.haze_level
    }

    /// Why the stripe is not to be trusted; None = nothing is known against it.
    #[getter]
    fn fault(&self) -> Option<String> {
        self.profile.fault.as_ref().map(ToString::to_string)
    }

    /// Columns of the points [px], float64, shape (n,); 0 = the centre of the top left pixel.
    #[getter]
    fn column_px<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.column(py, |p| p.column_px)
    }

    /// Rows of the points [px], float64, shape (n,); they grow downwards.
    #[getter]
    fn row_px<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.column(py, |p| p.row_px)
    }

    /// Peaks over the background [grey levels], float64, shape (n,).
    #[getter]
    fn peak<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.column(py, |p| p.peak)
    }

    /// Standard deviations of the place across the line [px], float64, shape (n,).
    #[getter]
    fn sd_px<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.column(py, |p| p.sd_px)
    }

    /// Widths of the line: standard deviation of its cross-section [px], float64, shape (n,).
    #[getter]
    fn sigma_px<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.column(py, |p| p.sigma_px)
    }

    /// Flags, uint32, shape (n,): 1 saturated, 2 haze corrected, 4 second candidate, 8 near step.
    #[getter]
    fn quality<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u32>> {
        let points = self.profile.points.iter();
        PyArray1::from_iter(py, points.map(|p| p.quality))
    }

    /// Output of `hydroline extract --json` for the image, as a dict.
    fn to_dict<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let text = hydroline_cli::extracted(&self.image, &self.profile)
            .map_err(|error| errors::sorted(py, error))?;
        py.import("json")?.call_method1("loads", (text,))
    }

    fn __len__(&self) -> usize {
        self.profile.points.len()
    }

    fn __repr__(&self) -> String {
        let (height, width) = self.shape();
        let fault = self.fault().map_or(String::new(), |f| format!(", {f}"));
        format!(
            "<hydroline.Profile: {} points in an image of {width} x {height} px{fault}>",
            self.profile.points.len()
        )
    }
}

impl Profile {
    fn column<'py>(
        &self,
        py: Python<'py>,
        value: fn(&StripePoint) -> f64,
    ) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_iter(py, self.profile.points.iter().map(value))
    }
}

/// Says what an image must be, and what this one is.
fn refused(image: &Bound<'_, PyAny>) -> PyErr {
    let text = |name: &str| {
        let value = image.getattr(name).and_then(|v| v.str());
        value.map_or_else(|_| "none".to_owned(), |v| v.to_string())
    };
    let kind = image
        .get_type()
        .name()
        .map_or_else(|_| "an object".to_owned(), |name| name.to_string());
    errors::input(
        image.py(),
        format_args!(
            "image: a {kind} of dtype {} and shape {}; allowed: a NumPy array of dtype uint8 and shape (height, width), or a path",
            text("dtype"),
            text("shape")
        ),
    )
}

/// The stripe of an array (height, width) of uint8. Memory in C order is read where it is; any other is copied first.
/// The GIL is released meanwhile: do not write to the array then.
#[pyfunction]
#[pyo3(signature = (image, whole_pixel=false, vertical=false))]
pub fn extract(
    py: Python<'_>,
    image: &Bound<'_, PyAny>,
    whole_pixel: bool,
    vertical: bool,
) -> PyResult<Profile> {
    let array = image.cast::<PyArray2<u8>>().map_err(|_| refused(image))?;
    let array = match array.is_c_contiguous() {
        true => array.clone(),
        false => py
            .import("numpy")?
            .call_method1("ascontiguousarray", PyTuple::new(py, [array])?)?
            .cast_into::<PyArray2<u8>>()
            .map_err(|_| refused(image))?,
    };
    let borrowed: PyReadonlyArray2<'_, u8> = array.try_readonly().map_err(|_| refused(image))?;
    let pixels = borrowed.as_slice().map_err(|_| refused(image))?;
    let &[height_px, width_px] = array.shape() else {
        return Err(refused(image));
    };
    let config = config(whole_pixel, vertical);
    let view = GreyView {
        width_px,
        height_px,
        pixels,
    };
    let profile = py.detach(|| {
        let mut extractor = extractor(&config);
        let profile = extractor.extract(view);
        give_back(extractor);
        profile
    });
    let image = PathBuf::new();
    Ok(Profile { profile, image })
}

/// The stripe of an image file.
#[pyfunction]
#[pyo3(signature = (image, whole_pixel=false, vertical=false))]
pub fn extract_file(
    py: Python<'_>,
    image: PathBuf,
    whole_pixel: bool,
    vertical: bool,
) -> PyResult<Profile> {
    let config = config(whole_pixel, vertical);
    let profile = py.detach(|| {
        let mut extractor = extractor(&config);
        let profile = hydroline_cli::extract_file(&image, &mut extractor);
        give_back(extractor);
        profile
    });
    let profile = profile.map_err(|error| errors::sorted(py, error))?;
    Ok(Profile { profile, image })
}

fn config(whole_pixel: bool, vertical: bool) -> ExtractorConfig {
    ExtractorConfig {
        whole_pixel,
        orientation: match vertical {
            true => Orientation::Vertical,
            false => Orientation::Horizontal,
        },
        ..ExtractorConfig::default()
    }
}

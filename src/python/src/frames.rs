//! A log's frames, each decoded when it is asked for.

use crate::errors;
use hydroline_core::frame::GreyRule;
use hydroline_log::{IndexedLog, Record};
use numpy::{PyArray1, PyArray2, PyArrayMethods};
use pyo3::exceptions::PyIndexError;
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use std::sync::Arc;

/// Topic of the frames.
pub const IMAGE: &str = "/camera/image";

/// The frames of a log: a sequence that reads each when it is asked for.
#[pyclass(frozen, sequence, module = "hydroline._hydroline")]
pub struct Frames {
    log: Arc<IndexedLog>,
    rule: GreyRule,
    count: usize,
}

impl Frames {
    pub fn of(log: &Arc<IndexedLog>) -> Self {
        let count = log.counts().get(IMAGE).copied().unwrap_or(0);
        Frames {
            log: log.clone(),
            rule: log.grey_rule(),
            count: count as usize,
        }
    }
}

#[pymethods]
impl Frames {
    fn __len__(&self) -> usize {
        self.count
    }

    fn __getitem__(&self, py: Python<'_>, index: isize) -> PyResult<Frame> {
        let place = match index {
            0.. => index as usize,
            _ => self.count.wrapping_sub(index.unsigned_abs()),
        };
        let none = || {
            let words = format!("frame {index}: the log has {}, from 0", self.count);
            PyIndexError::new_err(words)
        };
        if place >= self.count {
            return Err(none());
        }
        let read = py.detach(|| self.log.nth(IMAGE, place as u64));
        let message = read.map_err(|e| errors::sorted(py, e))?.ok_or_else(none)?;
        match message.record {
            Record::Frame(frame) => Ok(Frame {
                frame,
                rule: self.rule,
            }),
            _ => Err(errors::input(
                py,
                format_args!(
                    "{}: {IMAGE} is not of a type that is read: allowed are foxglove.RawImage and foxglove.CompressedImage",
                    self.log.path().display()
                ),
            )),
        }
    }

    fn __repr__(&self) -> String {
        format!("<hydroline.Frames: {}>", self.count)
    }
}

/// One frame.
#[pyclass(frozen, module = "hydroline._hydroline")]
pub struct Frame {
    frame: hydroline_core::frame::Frame,
    rule: GreyRule,
}

#[pymethods]
impl Frame {
    /// Grey levels as the analysis reads them (the rig's channel and bits): uint8, shape (height, width). Made anew at
    /// each call; the array owns them.
    #[getter]
    fn grey<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<u8>>> {
        let image = py.detach(|| self.frame.to_grey(&self.rule));
        let image = image.map_err(|e| errors::sorted(py, e))?;
        PyArray1::from_vec(py, image.pixels).reshape([image.height_px, image.width_px])
    }

    /// The bytes as the camera delivered them.
    #[getter]
    fn data<'py>(&self, py: Python<'py>) -> Bound<'py, PyBytes> {
        PyBytes::new(py, &self.frame.data)
    }

    /// Pixel format by V4L2's code, such as GREY or MJPG.
    #[getter]
    fn pixel_format(&self) -> String {
        hydroline_log::messages::format_name(self.frame.format)
    }

    /// Height and width [px].
    #[getter]
    fn shape(&self) -> (u32, u32) {
        (self.frame.height_px, self.frame.width_px)
    }

    /// The driver's sequence number.
    #[getter]
    fn sequence(&self) -> u32 {
        self.frame.meta.sequence
    }

    /// Mid-exposure, UNIX [ns].
    #[getter]
    fn timestamp_ns(&self) -> u64 {
        self.frame.meta.mid_exposure_ns
    }

    fn __repr__(&self) -> String {
        format!(
            "<hydroline.Frame {}: {} x {} px, {}>",
            self.frame.meta.sequence,
            self.frame.width_px,
            self.frame.height_px,
            self.pixel_format()
        )
    }
}

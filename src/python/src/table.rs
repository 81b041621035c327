//! A table that pandas, polars and pyarrow take over Arrow's C interface.

use crate::errors;
use arrow_array::cast::AsArray;
use arrow_array::ffi::{FFI_ArrowArray, FFI_ArrowSchema, to_ffi};
use arrow_array::ffi_stream::FFI_ArrowArrayStream;
use arrow_array::types::{Float32Type, Float64Type, UInt32Type, UInt64Type};
use arrow_array::{Array, RecordBatch, RecordBatchIterator, StructArray};
use arrow_schema::DataType;
use numpy::{PyArray1, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyCapsule;

/// One kind of message of a log, a row each.
#[pyclass(frozen, module = "hydroline._hydroline")]
pub struct Table {
    batch: RecordBatch,
}

impl Table {
    pub fn new(batch: RecordBatch) -> Self {
        Table { batch }
    }
}

#[pymethods]
impl Table {
    /// The rows as an Arrow stream of one batch; the consumer shares the memory.
    #[pyo3(signature = (requested_schema=None))]
    fn __arrow_c_stream__<'py>(
        &self,
        py: Python<'py>,
        requested_schema: Option<Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyCapsule>> {
        // The protocol lets a producer that cannot cast answer with its own schema.
        let _ = requested_schema;
        let batches = RecordBatchIterator::new([Ok(self.batch.clone())], self.batch.schema());
        let stream = FFI_ArrowArrayStream::new(Box::new(batches));
        PyCapsule::new_with_value(py, stream, c"arrow_array_stream")
    }

    /// The rows as one Arrow struct array: schema and array.
    #[pyo3(signature = (requested_schema=None))]
    fn __arrow_c_array__<'py>(
        &self,
        py: Python<'py>,
        requested_schema: Option<Bound<'py, PyAny>>,
    ) -> PyResult<(Bound<'py, PyCapsule>, Bound<'py, PyCapsule>)> {
        let _ = requested_schema;
        let data = StructArray::from(self.batch.clone()).into_data();
        let (array, schema): (FFI_ArrowArray, FFI_ArrowSchema) =
            to_ffi(&data).map_err(|e| errors::run(py, e))?;
        Ok((
            PyCapsule::new_with_value(py, schema, c"arrow_schema")?,
            PyCapsule::new_with_value(py, array, c"arrow_array")?,
        ))
    }

    /// Columns and their types.
    fn __arrow_c_schema__<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyCapsule>> {
        let schema = FFI_ArrowSchema::try_from(self.batch.schema().as_ref())
            .map_err(|e| errors::run(py, e))?;
        PyCapsule::new_with_value(py, schema, c"arrow_schema")
    }

    fn __len__(&self) -> usize {
        self.batch.num_rows()
    }

    /// Names of the columns, in their order.
    #[getter]
    fn column_names(&self) -> Vec<String> {
        let schema = self.batch.schema();
        schema.fields().iter().map(|f| f.name().clone()).collect()
    }

    /// A column of numbers as a NumPy array (a copy; NaN where nothing was measured), of texts as a list.
    fn __getitem__<'py>(&self, py: Python<'py>, name: &str) -> PyResult<Bound<'py, PyAny>> {
        let Some(column) = self.batch.column_by_name(name) else {
            let names = self.column_names().join(", ");
            let words = format!("column {name:?}: the table has {names}");
            return Err(pyo3::exceptions::PyKeyError::new_err(words));
        };
        Ok(match column.data_type() {
            DataType::Float64 => {
                let values = column.as_primitive::<Float64Type>();
                let values = values.iter().map(|v| v.unwrap_or(f64::NAN));
                PyArray1::from_vec(py, values.collect()).into_any()
            }
            DataType::UInt64 => {
                let values = column.as_primitive::<UInt64Type>();
                PyArray1::from_slice(py, values.values()).into_any()
            }
            DataType::UInt32 => {
                let values = column.as_primitive::<UInt32Type>();
                PyArray1::from_slice(py, values.values()).into_any()
            }
            DataType::Float32 => {
                let values = column.as_primitive::<Float32Type>();
                PyArray1::from_slice(py, values.values()).into_any()
            }
            DataType::Utf8 => {
                let values = column.as_string::<i32>();
                let texts: Vec<Option<&str>> = values.iter().collect();
                texts.into_pyobject(py)?.into_any()
            }
            DataType::FixedSizeList(_, width) => {
                let (rows, width) = (column.len(), *width as usize);
                let lists = column.as_fixed_size_list();
                let values = lists.values().as_primitive::<Float64Type>();
                let of = |row: usize| {
                    (0..width).map(move |k| match lists.is_null(row) {
                        true => f64::NAN,
                        false => values.value(row * width + k),
                    })
                };
                let all: Vec<f64> = (0..rows).flat_map(of).collect();
                let side = width.isqrt();
                PyArray1::from_vec(py, all)
                    .reshape([rows, side, width / side.max(1)])?
                    .into_any()
            }
            other => {
                let words = format!(
                    "column {name:?} is a {other}: take the table with pyarrow, polars or pandas"
                );
                return Err(pyo3::exceptions::PyTypeError::new_err(words));
            }
        })
    }

    fn __repr__(&self) -> String {
        let (rows, columns) = (self.batch.num_rows(), self.batch.num_columns());
        format!("<hydroline.Table: {rows} rows, {columns} columns>")
    }
}

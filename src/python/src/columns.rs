//! Messages of one kind as columns: names carry their units, times are UNIX [ns], NULL = not measured or not known.
//!
//! Messages are decoded into memory that is used again, a block at a time, and a block goes into the columns one by one.

use arrow_array::builder::{
    ArrayBuilder, FixedSizeListBuilder, Float32Builder, Float64Builder, ListBuilder, StringBuilder,
    StructBuilder, UInt32Builder, UInt64Builder,
};
use arrow_array::{Array, ArrayRef, RecordBatch, make_array};
use arrow_data::transform::MutableArrayData;
use arrow_schema::{ArrowError, DataType, Field, Schema};
use hydroline_log::messages::{DecodeOver, Stamped};
use rayon::prelude::*;
use std::sync::Arc;

/// Rows of a block: its messages stay in the processor's cache.
const BLOCK_ROWS: usize = 512;

/// A message and its own time; the time of logging where it says none.
pub struct Row<M> {
    stamp_ns: u64,
    message: M,
}

/// A column that grows.
trait Column<M>: Send {
    fn append(&mut self, rows: &[Row<M>]);
    fn finish(&mut self) -> ArrayRef;
}

/// A builder, and what a row gives it.
struct Made<B, F> {
    builder: B,
    append: F,
}

impl<M, B: ArrayBuilder, F: Fn(&mut B, &Row<M>) + Send> Column<M> for Made<B, F> {
    fn append(&mut self, rows: &[Row<M>]) {
        for row in rows {
            (self.append)(&mut self.builder, row);
        }
    }

    fn finish(&mut self) -> ArrayRef {
        self.builder.finish()
    }
}

/// A table's columns, as messages `M` come.
pub struct Columns<M> {
    columns: Vec<(&'static str, Box<dyn Column<M>>)>,
    /// The block; the first `filled` are in use.
    block: Vec<Row<M>>,
    filled: usize,
}

/// Columns of any kind of message.
pub trait Table: Send {
    /// Takes a message, encoded.
    ///
    /// # Errors
    /// The fault of the bytes, in words.
    fn push(&mut self, log_ns: u64, data: &[u8]) -> Result<(), String>;
    /// The columns, with their names.
    fn finish(&mut self) -> Vec<(&'static str, ArrayRef)>;
}

impl<M: Stamped + DecodeOver + Send + 'static> Table for Columns<M> {
    fn push(&mut self, log_ns: u64, data: &[u8]) -> Result<(), String> {
        if self.filled == self.block.len() {
            let (stamp_ns, message) = (0, M::default());
            self.block.push(Row { stamp_ns, message });
        }
        let row = &mut self.block[self.filled];
        row.message.decode_over(data)?;
        row.stamp_ns = row.message.stamp_ns().unwrap_or(log_ns);
        self.filled += 1;
        if self.filled == BLOCK_ROWS {
            self.append();
        }
        Ok(())
    }

    fn finish(&mut self) -> Vec<(&'static str, ArrayRef)> {
        self.append();
        let columns = self.columns.iter_mut();
        columns.map(|(name, c)| (*name, c.finish())).collect()
    }
}

impl<M: 'static> Columns<M> {
    /// The first column: the time.
    pub fn stamped() -> Self {
        let mut columns = Columns {
            columns: Vec::new(),
            block: Vec::new(),
            filled: 0,
        };
        columns.add("timestamp_ns", UInt64Builder::new(), |builder, row| {
            builder.append_value(row.stamp_ns);
        });
        columns
    }

    fn append(&mut self) {
        for (_, column) in &mut self.columns {
            column.append(&self.block[..self.filled]);
        }
        self.filled = 0;
    }

    fn add<B: ArrayBuilder>(
        &mut self,
        name: &'static str,
        builder: B,
        append: impl Fn(&mut B, &Row<M>) + Send + 'static,
    ) {
        let column = Box::new(Made { builder, append });
        self.columns.push((name, column));
    }

    /// A column of 64-bit counts or times.
    pub fn u64s(&mut self, name: &'static str, of: impl Fn(&M) -> u64 + Send + 'static) {
        self.add(name, UInt64Builder::new(), move |builder, row| {
            builder.append_value(of(&row.message));
        });
    }

    /// A column of 32-bit counts.
    pub fn u32s(&mut self, name: &'static str, of: impl Fn(&M) -> u32 + Send + 'static) {
        self.add(name, UInt32Builder::new(), move |builder, row| {
            builder.append_value(of(&row.message));
        });
    }

    /// A column of numbers.
    pub fn f64s(&mut self, name: &'static str, of: impl Fn(&M) -> Option<f64> + Send + 'static) {
        self.add(name, Float64Builder::new(), move |builder, row| {
            builder.append_option(of(&row.message));
        });
    }

    /// A column of texts.
    pub fn texts(&mut self, name: &'static str, of: impl Fn(&M) -> &str + Send + 'static) {
        self.add(name, StringBuilder::new(), move |builder, row| {
            builder.append_value(of(&row.message));
        });
    }

    /// A column of lists of single-precision numbers.
    pub fn f32_lists(&mut self, name: &'static str, of: impl Fn(&M) -> &[f32] + Send + 'static) {
        let lists = ListBuilder::new(Float32Builder::new());
        self.add(name, lists, move |builder, row| {
            builder.values().append_slice(of(&row.message));
            builder.append(true);
        });
    }

    /// A column of lists of flags.
    pub fn u32_lists(&mut self, name: &'static str, of: impl Fn(&M) -> &[u32] + Send + 'static) {
        let lists = ListBuilder::new(UInt32Builder::new());
        self.add(name, lists, move |builder, row| {
            builder.values().append_slice(of(&row.message));
            builder.append(true);
        });
    }

    /// A column of `width` numbers each; of another length they are not known.
    pub fn fixed_lists(
        &mut self,
        name: &'static str,
        width: usize,
        of: impl Fn(&M) -> &[f64] + Send + 'static,
    ) {
        let lists = FixedSizeListBuilder::new(Float64Builder::new(), width as i32);
        self.add(name, lists, move |builder, row| {
            let numbers = of(&row.message);
            let known = numbers.len() == width;
            match known {
                true => builder.values().append_slice(numbers),
                false => builder.values().append_nulls(width),
            }
            builder.append(known);
        });
    }

    /// A column of lists of names and values.
    pub fn named_lists(
        &mut self,
        name: &'static str,
        of: impl Fn(&M) -> Vec<(&str, f64)> + Send + 'static,
    ) {
        let fields = vec![
            Field::new("name", DataType::Utf8, true),
            Field::new("value", DataType::Float64, true),
        ];
        let lists = ListBuilder::new(StructBuilder::from_fields(fields, 0));
        self.add(name, lists, move |builder, row| {
            for (name, value) in of(&row.message) {
                let pair = builder.values();
                if let Some(names) = pair.field_builder::<StringBuilder>(0) {
                    names.append_value(name);
                }
                if let Some(numbers) = pair.field_builder::<Float64Builder>(1) {
                    numbers.append_value(value);
                }
                pair.append(true);
            }
            builder.append(true);
        });
    }
}

/// One table of parts of it, in their order.
pub fn joined(parts: Vec<Vec<(&'static str, ArrayRef)>>) -> Result<RecordBatch, ArrowError> {
    let mut columns: Vec<(&str, Vec<ArrayRef>)> = Vec::new();
    for (place, (name, array)) in parts
        .into_iter()
        .flat_map(|part| part.into_iter().enumerate())
    {
        match columns.get_mut(place) {
            Some((_, arrays)) => arrays.push(array),
            None => columns.push((name, vec![array])),
        }
    }
    let whole = columns.into_par_iter().map(|(name, arrays)| {
        let array = in_one(arrays)?;
        let field = Field::new(name, array.data_type().clone(), true);
        Ok((field, array))
    });
    let whole: Vec<(Field, ArrayRef)> = whole.collect::<Result<_, ArrowError>>()?;
    let (fields, arrays): (Vec<Field>, Vec<ArrayRef>) = whole.into_iter().unzip();
    RecordBatch::try_new(Arc::new(Schema::new(fields)), arrays)
}

fn in_one(mut arrays: Vec<ArrayRef>) -> Result<ArrayRef, ArrowError> {
    arrays.retain({
        let mut kept = 0;
        let rows: usize = arrays.iter().map(|a| a.len()).sum();
        move |array| {
            // Of arrays without rows one stays, where there are no others.
            let keep = !array.is_empty() || (rows == 0 && kept == 0);
            kept += usize::from(keep);
            keep
        }
    });
    if arrays.len() == 1 {
        return Ok(arrays.swap_remove(0));
    }
    let data: Vec<_> = arrays.iter().map(|a| a.to_data()).collect();
    let rows = data.iter().map(|d| d.len()).sum();
    let mut whole = MutableArrayData::new(data.iter().collect(), false, rows);
    for (place, part) in data.iter().enumerate() {
        whole.try_extend(place, 0, part.len())?;
    }
    Ok(make_array(whole.freeze()))
}

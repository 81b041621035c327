//! Files as typed.
//!
//! A file is its TOML tree with the place of every value ([`Document`], read through [`Section`]): a derive with
//! `deny_unknown_fields` stops at the first mistake and does not distinguish a line from a range, whereas reading key
//! by key reports all mistakes of a file at once, each with its line. What keys there are is declared beside the structs
//! that are made of them ([`table!`]).

mod document;
mod include;
mod kinds;
#[macro_use]
mod nested;
mod quantity;
mod section;
#[macro_use]
mod table;
mod writer;

use document::Document;
pub(crate) use document::{Problems, read_document, read_text};
pub(crate) use include::{Includes, included};
pub(crate) use kinds::{
    Columns, One, angle, angles, flag, interval, is_name, list, name, numbers, one, ordered, rows,
    spellings, text, whole, words,
};
pub(crate) use nested::{keys_of, table, table_or_defaults, tables};
pub(crate) use quantity::{Quantity, number};
pub(crate) use section::{Item, Section};
pub(crate) use table::{Kind, Table, kind_of};
pub(crate) use writer::Writer;

pub(crate) use crate::reference::Described;

#[cfg(test)]
pub(crate) mod tests;

//! Files as typed.
//!
//! The raw form of a file is its TOML tree with the place of every value
//! ([`Document`], read through [`Section`]). A derive with `deny_unknown_fields`
//! stops at the first mistake and does not distinguish a line from a range; reading the tree
//! key by key reports all mistakes of a file at once, each with its line, and keeps
//! a key's unit, range and default in the one place that reads it.

mod asked;
mod camera;
mod document;
mod include;
mod laser;
mod link;
mod physics;
mod plan;
mod quantity;
mod response;
mod rig;
mod section;
mod settings;
mod target;
mod thruster;
mod vehicle;

pub(crate) use asked::{Asked, Need};
use document::Document;
pub(crate) use document::{Problems, read_document, read_text};
pub(crate) use include::Includes;
pub(crate) use plan::read_plan;
use quantity::{Quantity, quantity};
pub(crate) use rig::read_rig;
use section::Section;
pub(crate) use section::is_name;
pub(crate) use target::{read_board, read_target};
pub(crate) use vehicle::axis_keys;

#[cfg(test)]
mod tests;

//! Finished logs, looked at again: what `hydroline view` shows.
//!
//! ```text
//! column    samples of one number, bounded; least and greatest of each pixel
//! fields    numbers that a log's topics hold
//! numbers   values of messages, by field
//! viewed    a log by its index: zero of its time, topics, damage
//! series    numbers over time, read as far as somebody looks
//! table     all samples of a range as CSV
//! derived   motion that a model makes of the commands, and what is beyond it
//! frames    the frame nearest to a moment, and its neighbours
//! events    what happened
//! query     parameters of a request
//! site      requests and answers, without sockets: the server is the live page's
//! ```
//!
//! A log is opened by its index alone; every request reads a bounded number of chunks.
//!
//! ```
//! use hydroline_log::{Entry, FileRecorder, Head, SummaryInput, WriteSettings};
//! use hydroline_log::messages::{pb, timestamp};
//! use hydroline_view::{Stretch, Viewed};
//!
//! let folder = tempfile::tempdir()?;
//! let path = folder.path().join("run.mcap");
//! let head = Head { rig_toml: "# a rig".to_owned(), ..Head::default() };
//! let mut log = FileRecorder::create(&path, false, head, WriteSettings::offline(None))?;
//! for k in 0..5u64 {
//!     let at_ns = 1_000_000_000 * (k + 1);
//!     let motion = pb::VehicleMotion {
//!         timestamp: Some(timestamp(at_ns)),
//!         x_m: Some(0.1 * k as f64),
//!         ..pb::VehicleMotion::default()
//!     };
//!     log.write(at_ns, &Entry::motion(&motion))?;
//! }
//! log.finish(&SummaryInput::clean("done"))?;
//!
//! let viewed = Viewed::open(&path)?;
//! let fields = viewed.fields();
//! let x = fields.iter().find(|f| f.path == "x_m").expect("motion was logged");
//! let whole = Stretch { from_ns: 0, to_ns: 4_000_000_000, pixels: 100 };
//! let series = viewed.series(&[x.number], whole, || true);
//! assert_eq!((series.read, series.samples[0].len()), (1.0, 5));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

#![cfg_attr(test, allow(clippy::unwrap_used, clippy::expect_used, clippy::panic))]

pub mod column;
mod derived;
mod events;
mod fields;
mod frames;
mod numbers;
mod query;
mod series;
mod site;
mod table;
mod viewed;

pub use derived::Model;
pub use events::ShownEvent;
pub use fields::Field;
pub use frames::{Shown, Wanted};
pub use series::{Series, Stretch};
pub use site::{Finder, Found, LogSite, NamedLog};
pub use table::{ROWS_MAX, TooLong};
pub use viewed::{Images, ListedField, Undecoded, Viewed, Zero};

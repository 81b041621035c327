//! Figures and pages: the one way in which hydroline writes SVG and HTML.
//!
//! ```text
//! markup   elements, and the only escape      colour   one palette
//! svg      shapes, text, a file               figure   panels with axes, drawn with svg
//! page     head, style, sections, tables, lists, figures, written with markup
//! quantity the unit that a quantity is shown in
//! document sentences and tables, written once for a terminal and a page
//! ```
//!
//! A report is one file: no script, no font, nothing fetched. Text reaches the output only through
//! [`markup::Element::text`] and [`markup::Element::with`], which escape; so a page needs no care for what
//! is in a name, a path or a message.
//!
//! Why no library: `kuva` 0.6 writes NaN into its paths, which ends a line at its first gap, and takes twenty times
//! as long to build as this crate; `plotters` 0.3 rounds to whole pixels, draws a gap as a fall to the edge and the
//! legend over the data; `charming` 0.6 needs a JavaScript engine; `askama` 0.16 would be a second escape, past which
//! every figure goes unescaped, and takes three times as long to build.
//!
//! ```
//! use hydroline_report::Page;
//!
//! let mut page = Page::new("run 7", "Run 7");
//! page.body.paragraph("lag < 0.3 s");
//! assert!(page.html().contains("lag &lt; 0.3 s"));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub mod colour;
pub mod document;
pub mod figure;
pub mod markup;
pub mod number;
pub mod page;
pub mod quantity;
pub mod svg;

pub use colour::Colour;
pub use document::Document;
pub use figure::{Axis, Cell, Figure, Panel, points};
pub use number::significant;
pub use page::{Body, Inline, Page, Table};
pub use quantity::Quantity;

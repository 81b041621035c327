//! Proofs and reproductions, which are not the product: sealed cases diagnosed blind ([`benchmark`]), the paper's tables and
//! figures computed ([`reproduce`]), and the methods that both are compared with: other searches for coefficients
//! ([`search`]), all [`maps`] from image to laser plane.
//!
//! ```
//! use hydroline_lab::benchmark::{Category, catalogue, make};
//!
//! assert_eq!(catalogue(460, None).len(), 460);
//! let case = make(1, Category::Single, 0)?;
//! assert_eq!((case.id.as_str(), case.category), ("single-0", Category::Single));
//! // Figure 12 of every hundredth frame.
//! assert!(hydroline_lab::reproduce::figure12(100)?.csv().starts_with("series,"));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub mod benchmark;
pub mod maps;
pub mod reproduce;
pub mod search;

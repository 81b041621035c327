//! The extractor on synthetic stripes with known truth.

mod accuracy;
mod robustness;
mod room;

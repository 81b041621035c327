//! Fixtures that the tests of this crate share, and the evidence of a fit against the integral itself.

mod exact;
pub(crate) mod fixtures;

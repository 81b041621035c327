//! What the tests of this room share, and the evidence of a fit against the integral itself.

mod exact;
pub(crate) mod fixtures;

//! Table 11 from Table 10: no images needed.

pub use hydroline_identify::paper::{TABLE11_THRUST_N, Table11Row, table11};

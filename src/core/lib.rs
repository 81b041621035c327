//! Types that all rooms share: clocks, events, frames, recorded runs, shutdown, build, conditions of a session. No devices, no files.
//!
//! ```
//! use hydroline_core::{clock::{Clock, ManualClock}, water::refractive_index};
//! use std::time::Duration;
//!
//! let clock = ManualClock::new(0, 1_000);
//! clock.advance(Duration::from_nanos(5));
//! assert_eq!(clock.triple().realtime_ns, 1_005);
//!
//! let fresh = refractive_index(20.0, 0.0, 520.0).ok_or("outside of the formula's range")?;
//! assert!((fresh - 1.335).abs() < 1e-3);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub mod build_info;
pub mod clock;
pub mod descriptors;
pub mod event;
pub mod frame;
pub mod heartbeat;
pub mod lock;
pub mod plain;
pub mod run;
pub mod session;
pub mod shutdown;
pub mod thread_class;
pub mod water;

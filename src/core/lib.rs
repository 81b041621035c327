//! What every room speaks of: clocks, events, frames, shutdown, the build and the conditions of a session. No devices, no files.

pub mod build_info;
pub mod clock;
pub mod event;
pub mod frame;
pub mod heartbeat;
pub mod plain;
pub mod session;
pub mod shutdown;
pub mod synthetic;
pub mod thread_class;
pub mod water;

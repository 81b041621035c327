//! The chain put together: recording, replay, simulation and calibration. Devices, clocks and files are injected.

pub mod analysis;
pub mod bring_back;
pub mod calibrate;
pub mod diagnostics;
pub mod live;
pub mod record;
pub mod replay;
pub mod response;
pub mod signals;
pub mod simulate;
pub mod simulated;

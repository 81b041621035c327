//! hydroline: a laser line on a tank floor, from camera frames to hydrodynamic parameters.
//!
//! One way for data: capture -> log; log/capture -> stripe (-> pose -> identify -> diagnose -> report).
//! No module reaches backwards. Devices, clocks and files are injected.

pub mod capture;
pub mod clock;
pub mod event;
pub mod frame;
pub mod log;
pub mod stripe;
pub mod thruster;

//! hydroline: a laser line on a tank floor, from camera frames to hydrodynamic parameters.
//!
//! One way for data: capture -> log; log/capture -> stripe (-> pose -> identify -> diagnose -> report).
//! No module reaches backwards. Devices, clocks and files are injected.

pub mod analysis;
pub mod calibrate;
pub mod capture;
pub mod cli;
pub mod clock;
pub mod diagnose;
pub mod diagnostics;
pub mod event;
pub mod frame;
pub mod identify;
pub mod import;
pub mod log;
pub mod pose;
pub mod predict;
pub mod prove;
pub mod record;
pub mod replay;
pub mod reproduce;
pub mod setpoint;
pub mod shutdown;
pub mod signals;
pub mod simulate;
pub mod simulated;
pub mod smooth;
pub mod stripe;
pub mod thread_class;
pub mod thruster;
pub mod water;

//! What was left out: where simulation and recording differ, and which physics explains it.

pub mod bank;
pub mod candidate;
pub mod family;
pub mod fit;
pub mod search;
pub mod setting;
pub mod weight;
pub mod weights;
